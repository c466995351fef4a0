//! `skin export --to rosbag2`: a folder with an MCAP file of ROS 2's messages, and metadata.yaml.

use crate::files::cdr::Cdr;
use crate::files::replace::beside;
use crate::recorded::SessionRecord;
use crate::recorded_frames::{Part, RecordedFrame, RecordedFrames};
use anyhow::{Context, Result, bail};
use recording::{Reader, Topic, Writer};
use serde_json::Value;
use std::fmt::Write;
use std::fs::File;
use std::path::Path;

/// Name, type and definition of a topic.
struct BagTopic {
    name: &'static str,
    kind: &'static str,
    definition: &'static str,
}

const TOPICS: [BagTopic; 3] = [
    BagTopic {
        name: "/skin/frames",
        kind: "skin_msgs/msg/Frame",
        definition: include_str!("ros/Frame.msg"),
    },
    BagTopic {
        name: "/skin/touches",
        kind: "skin_msgs/msg/Touches",
        definition: include_str!("ros/Touches.msg"),
    },
    BagTopic {
        name: "/skin/picture",
        kind: "sensor_msgs/msg/CompressedImage",
        definition: include_str!("ros/CompressedImage.msg"),
    },
];
const FRAMES: usize = 0;
const TOUCHES: usize = 1;
const PICTURES: usize = 2;
/// Where places are given in.
const FRAME_ID: &str = "sheet";

/// A bag that is written.
struct Bag {
    file: Writer<File>,
    channels: Vec<u16>,
    counts: [u32; TOPICS.len()],
    from_to_ns: Option<(u64, u64)>,
}

impl Bag {
    fn put(&mut self, topic: usize, unix_ns: u64, message: Cdr) -> Result<()> {
        let count = &mut self.counts[topic];
        self.file
            .write(self.channels[topic], *count, unix_ns, unix_ns, &message.into_bytes())?;
        *count += 1;
        let (from, to) = self.from_to_ns.unwrap_or((unix_ns, unix_ns));
        self.from_to_ns = Some((from.min(unix_ns), to.max(unix_ns)));
        Ok(())
    }

    fn frame(&mut self, frame: &RecordedFrame) -> Result<()> {
        let mut message = Cdr::new();
        message
            .header(frame.unix_ns, FRAME_ID)
            .u32(frame.measured.sequence)
            .f64(frame.measured.time_s)
            .f64s(&frame.measured.values_v);
        self.put(FRAMES, frame.unix_ns, message)
    }

    fn touches(&mut self, unix_ns: u64, line: &Value) -> Result<()> {
        let number = |of: &Value| of.as_f64().unwrap_or(f64::NAN);
        let mut message = Cdr::new();
        let touches = line["touches"].as_array().map_or(&[][..], Vec::as_slice);
        message
            .header(unix_ns, FRAME_ID)
            .u32(line["frame"].as_u64().unwrap_or(0) as u32)
            .f64(number(&line["time_s"]))
            .u32(touches.len() as u32);
        for touch in touches {
            // Numbers begin at 1.
            message.u32(touch["id"].as_u64().unwrap_or(0) as u32);
            for key in ["x_mm", "y_mm", "rise", "area_mm2", "total_mm2", "force_n"] {
                message.f64(number(&touch[key]));
            }
            message.bool(touch["uncalibrated"].as_bool().unwrap_or(false));
        }
        self.put(TOUCHES, unix_ns, message)
    }

    fn picture(&mut self, unix_ns: u64, line: &Value) -> Result<()> {
        let png = recording::from_base64(line["data"].as_str().unwrap_or_default());
        let mut message = Cdr::new();
        message
            .header(unix_ns, FRAME_ID)
            .text("png")
            .bytes(&png.context("a picture of the recording is damaged")?);
        self.put(PICTURES, unix_ns, message)
    }
}

/// Writes a bag; what was written.
///
/// # Errors
/// The recording cannot be read, there is such a folder, or it cannot be written.
pub(super) fn export(from: &Path, out: Option<&Path>) -> Result<String> {
    let out = out.map_or_else(|| from.with_extension("rosbag2"), Path::to_owned);
    let name = out.display();
    SessionRecord::read(from)?;
    if out.exists() {
        bail!("{name}: there is a file of this name; name a new folder with --out");
    }
    // No part passes for the whole: it gets its name at the end.
    let beside = beside(&out);
    let written = std::fs::create_dir_all(&beside)
        .with_context(|| format!("{name}: cannot be made; name a new folder with --out"))
        .and_then(|()| write(from, &beside))
        .and_then(|counts| {
            std::fs::rename(&beside, &out).with_context(|| format!("{name}: cannot be written"))?;
            Ok(counts)
        });
    if written.is_err() {
        let _ = std::fs::remove_dir_all(&beside);
    }
    let [frames, touches, pictures] = written?;
    Ok(format!(
        "{name}: {frames} frames, the touches of {touches} pictures, {pictures} pictures as PNG"
    ))
}

/// The messages in the order of their times, as far as the recording has it.
fn write(from: &Path, folder: &Path) -> Result<[u32; TOPICS.len()]> {
    let mut file = Writer::create_ros2(&folder.join(STORAGE))?;
    let mut channels = Vec::new();
    for topic in &TOPICS {
        let schema = (topic.kind, "ros2msg", topic.definition.as_bytes());
        channels.push(file.channel(topic.name, "cdr", Some(schema))?);
    }
    let mut bag = Bag {
        file,
        channels,
        counts: [0; TOPICS.len()],
        from_to_ns: None,
    };
    let mut frames = RecordedFrames::open(from, &Part::default(), false)?;
    let mut frame = frames.next()?;
    let mut others = Reader::open(from)?;
    while let Some(message) = others.next()? {
        let topic = message.topic.filter(|t| matches!(t, Topic::Touches | Topic::Picture));
        let (Some(topic), unix_ns) = (topic, message.publish_ns) else {
            continue;
        };
        while let Some(due) = frame.take_if(|f| f.unix_ns <= unix_ns) {
            bag.frame(&due)?;
            frame = frames.next()?;
        }
        let line: Value = serde_json::from_slice(message.data).context("touches and pictures of the recording")?;
        match topic {
            Topic::Touches => bag.touches(unix_ns, &line)?,
            _ => bag.picture(unix_ns, &line)?,
        }
    }
    while let Some(rest) = frame {
        bag.frame(&rest)?;
        frame = frames.next()?;
    }
    let counts = bag.counts;
    let metadata = metadata(&counts, bag.from_to_ns)?;
    bag.file.finish()?;
    std::fs::write(folder.join("metadata.yaml"), metadata)?;
    Ok(counts)
}

/// Name of the file with the messages.
const STORAGE: &str = "skin_0.mcap";

/// What ROS 2 reads first; version 5 is that of Humble, which later ones read too.
fn metadata(counts: &[u32], from_to_ns: Option<(u64, u64)>) -> Result<String> {
    let (from, to) = from_to_ns.unwrap_or_default();
    let all: u32 = counts.iter().sum();
    let lasts = to - from;
    let mut out = format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  duration:\n    nanoseconds: {lasts}\n  \
         starting_time:\n    nanoseconds_since_epoch: {from}\n  message_count: {all}\n  topics_with_message_count:\n"
    );
    for (topic, count) in TOPICS.iter().zip(counts) {
        writeln!(
            out,
            "    - topic_metadata:\n        name: {}\n        type: {}\n        serialization_format: cdr\n        \
             offered_qos_profiles: \"\"\n      message_count: {count}",
            topic.name, topic.kind
        )?;
    }
    writeln!(
        out,
        "  compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - {STORAGE}\n  files:\n    - path: {STORAGE}\n      \
         starting_time:\n        nanoseconds_since_epoch: {from}\n      duration:\n        nanoseconds: {lasts}\n      message_count: {all}"
    )?;
    Ok(out)
}
