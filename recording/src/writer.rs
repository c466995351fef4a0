//! Writes messages into a file.

use crate::error::RecordingError;
use crate::sink::{Sink, Target};
use crate::topic::{PROFILE, Topic};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::path::Path;

/// A file that is being written.
pub struct Writer<T: Target> {
    mcap: mcap::Writer<Sink<T>>,
    /// The same sink as the writer's.
    sink: Sink<T>,
    file: String,
    /// Number of the topic's channel, and of its next message.
    topics: BTreeMap<(Option<String>, Topic), (u16, u32)>,
    /// Bytes of messages since the last flush.
    unflushed: usize,
}

/// A chunk is closed at this size at the latest, bytes before compression. So much memory a reader needs.
const CHUNK: u64 = 1 << 20;

impl Writer<File> {
    /// Makes a new file.
    ///
    /// # Errors
    /// [`RecordingError::Exists`] where there is one; what the system said.
    pub fn create(path: &Path) -> Result<Self, RecordingError> {
        Self::create_of(path, PROFILE)
    }

    /// Makes a new file of ROS 2's profile, for channels of its messages.
    ///
    /// # Errors
    /// As [`Writer::create`].
    pub fn create_ros2(path: &Path) -> Result<Self, RecordingError> {
        Self::create_of(path, "ros2")
    }

    fn create_of(path: &Path, profile: &str) -> Result<Self, RecordingError> {
        let file = path.display().to_string();
        let target = OpenOptions::new()
            .write(true)
            .create_new(true)
            .open(path)
            .map_err(|e| RecordingError::io(&file, e))?;
        Self::of_profile(target, file, profile)
    }
}

impl<T: Target> Writer<T> {
    /// A recording of skin.
    ///
    /// # Errors
    /// What the system said.
    #[cfg(test)]
    pub(crate) fn of(target: T, file: String) -> Result<Self, RecordingError> {
        Self::of_profile(target, file, PROFILE)
    }

    /// Begins a file; `file` is its name in messages.
    fn of_profile(target: T, file: String, profile: &str) -> Result<Self, RecordingError> {
        let options = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .profile(profile)
            .library(concat!("skin ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK))
            // Chunks are written at once: what is cut off is one that was not written whole.
            .disable_seeking(true)
            // Every chunk has its own.
            .calculate_data_section_crc(false);
        let sink = Sink::new(target);
        let mut writer = Self {
            mcap: options
                .create(sink.clone())
                .map_err(|e| RecordingError::mcap(&file, e))?,
            sink,
            file,
            topics: BTreeMap::new(),
            unflushed: 0,
        };
        writer.flush()?;
        Ok(writer)
    }

    /// The file's name.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// A channel by what describes it; the same one where that was asked for before. Schema: name, encoding, text.
    ///
    /// # Errors
    /// Too many of them.
    pub fn channel(
        &mut self,
        topic: &str,
        encoding: &str,
        schema: Option<(&str, &str, &[u8])>,
    ) -> Result<u16, RecordingError> {
        let add = |mcap: &mut mcap::Writer<Sink<T>>| {
            let schema = schema.map_or(Ok(0), |(name, kind, text)| mcap.add_schema(name, kind, text))?;
            mcap.add_channel(schema, topic, encoding, &BTreeMap::new())
        };
        add(&mut self.mcap).map_err(|e| RecordingError::mcap(&self.file, e))
    }

    /// Writes a message of a topic; times in ns since 1970.
    ///
    /// # Errors
    /// What the system said.
    pub fn message(&mut self, topic: Topic, log_ns: u64, publish_ns: u64, data: &[u8]) -> Result<(), RecordingError> {
        self.message_of(None, topic, log_ns, publish_ns, data)
    }

    /// Writes a message of a topic of one skin of several.
    ///
    /// # Errors
    /// What the system said.
    pub fn message_of(
        &mut self,
        skin: Option<&str>,
        topic: Topic,
        log_ns: u64,
        publish_ns: u64,
        data: &[u8],
    ) -> Result<(), RecordingError> {
        let key = (skin.map(str::to_owned), topic);
        let (channel, sequence) = match self.topics.get(&key) {
            Some(known) => *known,
            None => {
                let schema = topic.schema().map(|(name, text)| (name, "jsonschema", text.as_bytes()));
                (self.channel(&topic.name_of(skin), topic.encoding(), schema)?, 0)
            }
        };
        self.topics.insert(key, (channel, sequence.wrapping_add(1)));
        self.write(channel, sequence, log_ns, publish_ns, data)
    }

    /// Writes a message of a channel.
    ///
    /// # Errors
    /// What the system said.
    pub fn write(
        &mut self,
        channel_id: u16,
        sequence: u32,
        log_time: u64,
        publish_time: u64,
        data: &[u8],
    ) -> Result<(), RecordingError> {
        let header = MessageHeader {
            channel_id,
            sequence,
            log_time,
            publish_time,
        };
        let written = self.mcap.write_to_known_channel(&header, data);
        written.map_err(|e| RecordingError::mcap(&self.file, e))?;
        self.unflushed += data.len();
        // What waits for a flush is in memory.
        if self.unflushed as u64 >= CHUNK {
            self.flush()?;
        }
        Ok(())
    }

    /// Closes the chunk and writes it: what was given so far can be read from now on, whatever happens to this program.
    ///
    /// # Errors
    /// What the system said.
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        self.unflushed = 0;
        self.mcap.flush().map_err(|e| RecordingError::mcap(&self.file, e))
    }

    /// Makes what was flushed survive a power cut.
    ///
    /// # Errors
    /// What the system said.
    pub(crate) fn settle(&self) -> Result<(), RecordingError> {
        self.sink.settle().map_err(|e| RecordingError::io(&self.file, e))
    }

    /// Bytes in the file.
    pub(crate) fn len(&self) -> u64 {
        self.sink.len()
    }

    /// Writes index and end.
    ///
    /// # Errors
    /// What the system said. The file is closed then without an index, after the last flush that succeeded, where there is room
    /// for that.
    pub fn finish(mut self) -> Result<u64, RecordingError> {
        let finished = self
            .flush()
            .and_then(|()| self.mcap.finish().map_err(|e| RecordingError::mcap(&self.file, e)));
        match finished {
            Ok(_) => {
                self.settle()?;
                Ok(self.sink.len())
            }
            Err(why) => {
                self.abandon()?;
                Err(why)
            }
        }
    }

    /// Closes the file without an index after the last flush that succeeded: for a disk that is full.
    ///
    /// # Errors
    /// There is no room for even that, or the disk is gone; `skin recover` reads what is there.
    pub fn abandon(self) -> Result<(), RecordingError> {
        self.sink.close_short().map_err(|e| RecordingError::io(&self.file, e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reader::{Ended, Reader};
    use crate::sink::full_disk::Disk;
    use std::io::Cursor;

    /// Whatever room there is, the file is closed, and holds the first messages.
    #[test]
    fn a_full_disk_leaves_a_closed_file_with_the_first_messages() {
        let data = |k: u32| -> Vec<u8> { (0..200_u32).map(|n| (n * n * 7 + k * 31) as u8).collect() };
        let mut kept = Vec::new();
        for room in (400..40_000).step_by(1_111) {
            let disk = Disk {
                room,
                ..Disk::default()
            };
            let mut writer = Writer::of(disk.clone(), "disk".to_owned()).unwrap();
            let mut outcome = Ok(());
            let mut k = 0;
            while outcome.is_ok() && k < 100 {
                outcome = writer.message(Topic::Board, u64::from(k), u64::from(k), &data(k));
                if k % 5 == 4 {
                    outcome = outcome.and_then(|()| writer.flush());
                }
                k += 1;
            }
            let full = match outcome {
                Ok(()) => writer.finish().is_err(),
                Err(_) => {
                    writer.abandon().unwrap();
                    true
                }
            };
            let bytes = disk.bytes.lock().unwrap().clone();
            let mut reader = Reader::new(Cursor::new(bytes), "disk").unwrap();
            let mut count = 0;
            while let Some(message) = reader.next().unwrap() {
                assert_eq!(message.data, data(count), "room {room}");
                count += 1;
            }
            assert_eq!(
                reader.ended(),
                Some(if full { Ended::Short } else { Ended::Whole }),
                "room {room}"
            );
            assert_eq!(count == 100, !full || count == 100, "room {room}");
            kept.push(count);
        }
        assert!(
            kept.is_sorted() && kept[0] == 0 && kept.last() == Some(&100),
            "{kept:?}"
        );
    }

    /// Takes everything and keeps nothing.
    struct Nowhere;

    impl std::io::Write for Nowhere {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    impl Target for Nowhere {
        fn cut(&mut self, _: u64) -> std::io::Result<()> {
            Ok(())
        }

        fn settle(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    /// `cargo test -p recording -- --ignored the_index_of_a_day --nocapture`
    #[cfg(target_os = "linux")]
    #[test]
    #[ignore = "a measurement"]
    fn the_index_of_a_day_in_memory() {
        let resident_kb = || -> u64 {
            let status = std::fs::read_to_string("/proc/self/status").unwrap();
            let line = status.lines().find(|l| l.starts_with("VmRSS")).unwrap();
            line.split_whitespace().nth(1).unwrap().parse().unwrap()
        };
        let mut writer = Writer::of(Nowhere, "nowhere".to_owned()).unwrap();
        let before = resident_kb();
        for k in 0..2 * 86_400_u64 {
            for topic in Topic::ALL {
                writer.message(topic, k, k, &[7; 60]).unwrap();
            }
            writer.flush().unwrap();
        }
        let kb = resident_kb() - before;
        let start = std::time::Instant::now();
        writer.finish().unwrap();
        println!(
            "a day of chunks: {} MB, closed in {:.2} s",
            kb / 1024,
            start.elapsed().as_secs_f64()
        );
        assert!(kb < 200_000);
    }
}
