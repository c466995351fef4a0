//! `skin export --to rosbag2`: a folder with an MCAP file of ROS 2's messages, and metadata.yaml.

use crate::files::cdr::Cdr;
use crate::files::replace::beside;
use crate::recorded::SessionRecord;
use crate::recorded_frames::{Part, RecordedFrame, RecordedFrames};
use crate::skin_file;
use anyhow::{Context, Result, bail};
use recording::{Reader, Topic, Writer};
use serde_json::Value;
use std::fmt::Write;
use std::fs::File;
use std::path::Path;

/// Name, type and definition of a topic.
struct BagTopic {
    /// Behind the skin's name.
    name: &'static str,
    kind: &'static str,
    definition: &'static str,
}

const TOPICS: [BagTopic; 3] = [
    BagTopic {
        name: "frames",
        kind: "skin_msgs/msg/Frame",
        definition: include_str!("ros/Frame.msg"),
    },
    BagTopic {
        name: "touches",
        kind: "skin_msgs/msg/Touches",
        definition: include_str!("ros/Touches.msg"),
    },
    BagTopic {
        name: "picture",
        kind: "sensor_msgs/msg/CompressedImage",
        definition: include_str!("ros/CompressedImage.msg"),
    },
];
const FRAMES: usize = 0;
const TOUCHES: usize = 1;
const PICTURES: usize = 2;
/// Where places are given in.
const FRAME_ID: &str = "sheet";

/// A topic of a bag that is written.
struct Channel {
    name: String,
    kind: &'static str,
    id: u16,
    count: u32,
}

/// A bag that is written.
struct Bag {
    file: Writer<File>,
    /// Of the skins one after the other, as in [`TOPICS`].
    channels: Vec<Channel>,
    from_to_ns: Option<(u64, u64)>,
}

impl Bag {
    /// Adds the topics of a skin.
    fn add_skin(&mut self, name: &str) -> Result<()> {
        for topic in &TOPICS {
            let name = format!("/{name}/{}", topic.name);
            let schema = (topic.kind, "ros2msg", topic.definition.as_bytes());
            let id = self.file.channel(&name, "cdr", Some(schema))?;
            self.channels.push(Channel {
                name,
                kind: topic.kind,
                id,
                count: 0,
            });
        }
        Ok(())
    }

    /// Messages of a topic, of all skins.
    fn count(&self, topic: usize) -> u32 {
        self.channels
            .iter()
            .skip(topic)
            .step_by(TOPICS.len())
            .map(|c| c.count)
            .sum()
    }

    fn put(&mut self, topic: usize, unix_ns: u64, message: Cdr) -> Result<()> {
        // Of the skin that was added last.
        let first = self.channels.len().saturating_sub(TOPICS.len());
        let channel = &mut self.channels[first + topic];
        self.file
            .write(channel.id, channel.count, unix_ns, unix_ns, &message.into_bytes())?;
        channel.count += 1;
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
    let out = out.map_or_else(|| skin_file::beside(from, "rosbag2"), Path::to_owned);
    let name = out.display();
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

/// Of every skin the messages in the order of their times, one skin after the other: readers go by the index.
fn write(from: &Path, folder: &Path) -> Result<[u32; TOPICS.len()]> {
    let mut bag = Bag {
        file: Writer::create_ros2(&folder.join(STORAGE))?,
        channels: Vec::new(),
        from_to_ns: None,
    };
    for (name, skin) in skin_file::asked(from)? {
        SessionRecord::read(&skin)?;
        bag.add_skin(name.as_deref().unwrap_or("skin"))?;
        write_skin(&mut bag, &skin)?;
    }
    let counts = [FRAMES, TOUCHES, PICTURES].map(|topic| bag.count(topic));
    let metadata = metadata(&bag.channels, bag.from_to_ns)?;
    bag.file.finish()?;
    std::fs::write(folder.join("metadata.yaml"), metadata)?;
    Ok(counts)
}

fn write_skin(bag: &mut Bag, from: &Path) -> Result<()> {
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
    Ok(())
}

/// Name of the file with the messages.
const STORAGE: &str = "skin_0.mcap";

/// What ROS 2 reads first; version 5 is that of Humble, which later ones read too.
fn metadata(channels: &[Channel], from_to_ns: Option<(u64, u64)>) -> Result<String> {
    let (from, to) = from_to_ns.unwrap_or_default();
    let all: u32 = channels.iter().map(|c| c.count).sum();
    let lasts = to - from;
    let mut out = format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  duration:\n    nanoseconds: {lasts}\n  \
         starting_time:\n    nanoseconds_since_epoch: {from}\n  message_count: {all}\n  topics_with_message_count:\n"
    );
    for Channel { name, kind, count, .. } in channels {
        writeln!(
            out,
            "    - topic_metadata:\n        name: {name}\n        type: {kind}\n        serialization_format: cdr\n        \
             offered_qos_profiles: \"\"\n      message_count: {count}"
        )?;
    }
    writeln!(
        out,
        "  compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - {STORAGE}\n  files:\n    - path: {STORAGE}\n      \
         starting_time:\n        nanoseconds_since_epoch: {from}\n      duration:\n        nanoseconds: {lasts}\n      message_count: {all}"
    )?;
    Ok(out)
}
