//! `skin export --to rosbag2`: a folder with an MCAP file of ROS 2's messages, and metadata.yaml.

use crate::files::cdr::Cdr;
use crate::files::replace::beside;
use crate::reading::Reading;
use crate::recorded::SessionRecord;
use crate::recorded_frames::{Part, RecordedFrame, RecordedFrames};
use crate::ros2::SKIN;
use crate::ros2::messages::{self, Header};
use crate::skin_file;
use anyhow::{Context, Result, bail};
use inverse::touches::touch::Touch;
use recording::{Topic, Writer};
use serde::Deserialize;
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
    /// The types that it is made of.
    parts: &'static [(&'static str, &'static str)],
}

const HEADER: (&str, &str) = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n");
const TIME: (&str, &str) = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
const POINT: (&str, &str) = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n");
const TOUCH: (&str, &str) = ("skin_msgs/Touch", include_str!("ros/Touch.msg"));

/// Definitions of `skin_msgs` are those of contrib/ros2, which a test holds.
const TOPICS: [BagTopic; 3] = [
    BagTopic {
        name: "frames",
        kind: "skin_msgs/msg/Frame",
        definition: include_str!("ros/Frame.msg"),
        parts: &[HEADER, TIME],
    },
    BagTopic {
        name: "touches",
        kind: "skin_msgs/msg/Touches",
        definition: include_str!("ros/Touches.msg"),
        parts: &[HEADER, TIME, TOUCH, POINT],
    },
    BagTopic {
        name: "picture",
        kind: "sensor_msgs/msg/CompressedImage",
        definition: include_str!("ros/CompressedImage.msg"),
        parts: &[HEADER, TIME],
    },
];

impl BagTopic {
    /// The definition with those of its parts behind it.
    fn whole_definition(&self) -> String {
        let mut out = self.definition.to_owned();
        for (name, definition) in self.parts {
            out += &format!("{}\nMSG: {name}\n{definition}", "=".repeat(80));
        }
        out
    }
}
const FRAMES: usize = 0;
const TOUCHES: usize = 1;
const PICTURES: usize = 2;

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
    /// The frame of the sheet whose messages are written.
    sheet_frame: String,
    from_to_ns: Option<(u64, u64)>,
}

impl Bag {
    /// Adds the topics of a skin, named as those of `--ros2`.
    fn add_skin(&mut self, skin: &str) -> Result<()> {
        let skin = messages::name(skin);
        self.sheet_frame = messages::sheet_frame(&skin);
        for topic in &TOPICS {
            let name = format!("/{skin}/{}", topic.name);
            let definition = topic.whole_definition();
            let schema = (topic.kind, "ros2msg", definition.as_bytes());
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

    fn header(&self, unix_ns: u64) -> Header<'_> {
        Header {
            unix_ns,
            frame: &self.sheet_frame,
        }
    }

    fn frame(&mut self, frame: &RecordedFrame) -> Result<()> {
        let of = &frame.measured;
        let message = messages::frame(self.header(frame.unix_ns), of.sequence, of.time_s, &of.values_v);
        self.put(FRAMES, frame.unix_ns, message)
    }

    fn touches(&mut self, unix_ns: u64, line: &Value) -> Result<()> {
        let touches: Vec<Touch> = match &line["touches"] {
            Value::Null => Vec::new(),
            list => Vec::deserialize(list).context("the touches of the recording")?,
        };
        let sequence = line["frame"].as_u64().unwrap_or(0) as u32;
        let time_s = line["time_s"].as_f64().unwrap_or(f64::NAN);
        let doubt = line["doubt"].as_str().unwrap_or_default();
        let message = messages::touches(self.header(unix_ns), sequence, time_s, &touches, doubt);
        self.put(TOUCHES, unix_ns, message)
    }

    fn picture(&mut self, unix_ns: u64, line: &Value) -> Result<()> {
        let png = recording::from_base64(line["data"].as_str().unwrap_or_default());
        let png = png.context("a picture of the recording is damaged")?;
        let message = messages::picture(self.header(unix_ns), &png);
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
        sheet_frame: String::new(),
        from_to_ns: None,
    };
    for (name, skin) in skin_file::asked(from)? {
        SessionRecord::read(&skin)?;
        bag.add_skin(name.as_deref().unwrap_or(SKIN))?;
        write_skin(&mut bag, &skin)?;
    }
    let counts = [FRAMES, TOUCHES, PICTURES].map(|topic| bag.count(topic));
    let metadata = metadata(&bag.channels, bag.from_to_ns)?;
    bag.file.finish()?;
    std::fs::write(folder.join("metadata.yaml"), metadata)?;
    Ok(counts)
}

fn write_skin(bag: &mut Bag, from: &Path) -> Result<()> {
    let mut frames = RecordedFrames::open(from, &Part::default())?;
    let mut frame = frames.next()?;
    let mut others = Reading::open(from)?;
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
