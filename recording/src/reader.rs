//! Reads a file from its beginning, message by message, in bounded memory; whether it is whole, was cut short or is damaged.

use crate::error::RecordingError;
use crate::topic::{PROFILE, Topic};
use mcap::McapError;
use mcap::records::{MessageHeader, Record, op};
use mcap::sans_io::LinearReader;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReaderOptions};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// How a file ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// Closed, with its index.
    Whole,
    /// Closed without an index: the disk was full.
    Short,
    /// Cut off: by a power cut, a kill, or a copy that was not finished.
    Cut,
}

/// A message, as long as the next one is not read.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    /// Its topic; none for a topic of another program.
    pub topic: Option<Topic>,
    /// Its channel in this file.
    pub channel: u16,
    /// Number within the channel, wrapping.
    pub sequence: u32,
    /// When it was recorded, ns since 1970.
    pub log_ns: u64,
    /// When what it is of was measured, ns since 1970.
    pub publish_ns: u64,
    /// Its bytes.
    pub data: &'a [u8],
}

/// A channel, with its schema's name, encoding and text.
#[derive(Clone, Debug, Default)]
pub(crate) struct Channel {
    pub(crate) name: String,
    pub(crate) encoding: String,
    pub(crate) schema: Option<(String, String, Vec<u8>)>,
    topic: Option<Topic>,
}

/// What is known of a file once it was read: whoever has it can read from [any place](Reader::place) on.
#[derive(Clone, Debug)]
pub struct Known {
    channels: BTreeMap<u16, Channel>,
}

/// Bytes before the first record, and before the data of any.
const MAGIC: u64 = 8;
const RECORD_HEAD: u64 = 9;

/// A file that is being read.
pub struct Reader<R> {
    source: R,
    /// The file, chunk by chunk.
    records: LinearReader,
    /// What is in the chunks. Only this has checksums: a message elsewhere is damage.
    chunks: LinearReader,
    file: String,
    schemas: BTreeMap<u16, (String, String, Vec<u8>)>,
    channels: BTreeMap<u16, Channel>,
    data: Vec<u8>,
    bytes: u64,
    /// Where the next record begins, and where the chunk began that the last message is in.
    at: u64,
    chunk_at: u64,
    profile: Option<String>,
    /// The skin of several that is asked for.
    skin: Option<String>,
    /// Whether there is an index, once the end was read.
    index: Option<bool>,
    ended: Option<Ended>,
    /// Chunks that are damaged, and messages of channels that only these named.
    damaged: usize,
    nameless: u64,
}

/// The file and the skin's name of `FILE#NAME`; a file that has such a name itself is one.
pub fn split(path: &Path) -> (PathBuf, Option<String>) {
    let whole = || (path.to_owned(), None);
    let Some(text) = path.to_str().filter(|_| !path.exists()) else {
        return whole();
    };
    match text.rsplit_once('#') {
        Some((file, skin)) if !skin.is_empty() => (PathBuf::from(file), Some(skin.to_owned())),
        _ => whole(),
    }
}

/// A reader of chunks.
fn in_chunks() -> LinearReader {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MOST);
    LinearReader::new_with_options(options)
}

/// Longest record that is believed, bytes. The writer's chunks are 1 MB.
const MOST: usize = 256 << 20;

impl Reader<BufReader<File>> {
    /// Opens a file.
    ///
    /// `FILE#NAME` is the skin of this name in a recording of several: all topics of the others have no topic.
    ///
    /// # Errors
    /// What the system said, or it is no recording of skin.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let (source, file, skin) = opened(path)?;
        let mut reader = Self::new(source, &file)?;
        reader.skin = skin;
        Ok(reader)
    }

    /// Opens a file at a [place](Reader::place) of it.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn open_at(path: &Path, known: &Known, place: u64) -> Result<Self, RecordingError> {
        let (mut source, file, skin) = opened(path)?;
        source
            .seek(SeekFrom::Start(place))
            .map_err(|e| RecordingError::io(&file, e))?;
        Ok(Self {
            channels: known.channels.clone(),
            profile: Some(PROFILE.to_owned()),
            skin,
            at: place,
            ..Self::before(source, &file, true)
        })
    }
}

/// A file, its name in messages, and the skin that is asked for.
fn opened(path: &Path) -> Result<(BufReader<File>, String, Option<String>), RecordingError> {
    let (of_file, skin) = split(path);
    let file = path.display().to_string();
    let source = File::open(of_file).map_err(|e| RecordingError::io(&file, e))?;
    Ok((BufReader::with_capacity(1 << 16, source), file, skin))
}

impl<R: Read> Reader<R> {
    /// Reads the beginning; `file` is its name in messages.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn new(source: R, file: &str) -> Result<Self, RecordingError> {
        let mut reader = Self::before(source, file, false);
        while reader.profile.is_none() && reader.ended.is_none() {
            reader.step()?;
        }
        match &reader.profile {
            Some(profile) if profile == PROFILE => Ok(reader),
            Some(profile) => Err(RecordingError::Foreign {
                file: reader.file,
                what: format!("an MCAP file of profile {profile:?}"),
            }),
            None => Err(RecordingError::Foreign {
                file: reader.file,
                what: "it does not begin as one".to_owned(),
            }),
        }
    }

    /// Before anything of it was read; within are no bytes before its first record.
    fn before(source: R, file: &str, within: bool) -> Self {
        let options = LinearReaderOptions::default()
            .with_emit_chunks(true)
            .with_skip_start_magic(within)
            .with_record_length_limit(MOST);
        Self {
            source,
            records: LinearReader::new_with_options(options),
            chunks: in_chunks(),
            file: file.to_owned(),
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            data: Vec::new(),
            bytes: 0,
            at: MAGIC,
            chunk_at: MAGIC,
            profile: None,
            skin: None,
            index: None,
            ended: None,
            damaged: 0,
            nameless: 0,
        }
    }

    /// Where the chunk begins that the last message is in: from there on the file can be read.
    pub fn place(&self) -> u64 {
        self.chunk_at
    }

    /// What is known of the file so far; at its end, enough to read it from any place on.
    pub fn known(&self) -> Known {
        Known {
            channels: self.channels.clone(),
        }
    }

    /// The file's name.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Bytes read so far.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// How the file ended; none before its end was reached.
    pub fn ended(&self) -> Option<Ended> {
        self.ended
    }

    /// Chunks so far that are damaged, and left out. Each has up to 1 MB.
    pub fn damaged(&self) -> usize {
        self.damaged
    }

    /// Messages so far of which nothing tells the topic: a damaged chunk did.
    pub fn nameless(&self) -> u64 {
        self.nameless
    }

    pub(crate) fn channel(&self, id: u16) -> Option<&Channel> {
        self.channels.get(&id)
    }

    /// The next message, or none at the end. What was written half ends the file like its end does. What is in a damaged chunk is left
    /// out ([`Reader::damaged`]).
    ///
    /// # Errors
    /// The file cannot be read.
    #[expect(clippy::should_implement_trait, reason = "a message lends from the reader")]
    pub fn next(&mut self) -> Result<Option<Message<'_>>, RecordingError> {
        while self.ended.is_none() {
            if let Some(header) = self.step()? {
                self.nameless += u64::from(!self.channels.contains_key(&header.channel_id));
                return Ok(Some(Message {
                    topic: self.channels.get(&header.channel_id).and_then(|c| c.topic),
                    channel: header.channel_id,
                    sequence: header.sequence,
                    log_ns: header.log_time,
                    publish_ns: header.publish_time,
                    data: &self.data,
                }));
            }
        }
        Ok(None)
    }

    /// The first message of a topic from here on.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn find(&mut self, topic: Topic) -> Result<Option<Vec<u8>>, RecordingError> {
        while let Some(message) = self.next()? {
            if message.topic == Some(topic) {
                return Ok(Some(message.data.to_vec()));
            }
        }
        Ok(None)
    }

    /// Reads on; a message's header where it read one.
    fn step(&mut self) -> Result<Option<MessageHeader>, RecordingError> {
        let record = match self.chunks.next_event() {
            Some(Ok(LinearReadEvent::Record { opcode, data })) => mcap::parse_record(opcode, data),
            Some(Ok(LinearReadEvent::ReadRequest(_))) => {
                self.read_on()?;
                return Ok(None);
            }
            Some(Err(why)) => Err(why),
            None => Err(McapError::UnexpectedEof),
        };
        match record {
            Ok(Record::Message { header, data }) => {
                self.data.clear();
                self.data.extend_from_slice(&data);
                return Ok(Some(header));
            }
            Ok(Record::Schema { header, data }) => {
                let schema = (header.name, header.encoding, data.into_owned());
                self.schemas.insert(header.id, schema);
            }
            Ok(Record::Channel(channel)) => {
                // What is of no skin is of the whole recording.
                let topic = Topic::skin_of(&channel.topic)
                    .filter(|(skin, _)| skin.is_none_or(|skin| self.skin.as_deref() == Some(skin)))
                    .map(|(_, topic)| topic);
                let known = Channel {
                    topic,
                    schema: self.schemas.get(&channel.schema_id).cloned(),
                    name: channel.topic,
                    encoding: channel.message_encoding,
                };
                self.channels.insert(channel.id, known);
            }
            Ok(_) => {}
            Err(why) => {
                // The file goes on behind it.
                tracing::debug!("{}: a chunk at byte {}: {why}", self.file, self.chunk_at);
                self.damaged += 1;
                self.chunks = in_chunks();
            }
        }
        Ok(None)
    }

    /// Reads a part of the file, or takes a record of it: a chunk is handed on.
    fn read_on(&mut self) -> Result<(), RecordingError> {
        let record = match self.records.next_event() {
            None => {
                self.ended = Some(match self.index {
                    Some(true) => Ended::Whole,
                    Some(false) => Ended::Short,
                    None => Ended::Cut,
                });
                return Ok(());
            }
            Some(Ok(LinearReadEvent::ReadRequest(need))) => {
                let room = self.records.insert(need);
                let read = loop {
                    match self.source.read(room) {
                        Err(e) if e.kind() == ErrorKind::Interrupted => {}
                        other => break other,
                    }
                };
                let read = read.map_err(|e| RecordingError::io(&self.file, e))?;
                self.bytes += read as u64;
                self.records.notify_read(read);
                return Ok(());
            }
            Some(Ok(LinearReadEvent::Record {
                opcode: op::CHUNK,
                data,
            })) => {
                let length = (data.len() as u64).to_le_bytes();
                let size = 1 + length.len() + data.len();
                let room = self.chunks.insert(size);
                room[0] = op::CHUNK;
                room[1..9].copy_from_slice(&length);
                room[9..size].copy_from_slice(data);
                self.chunks.notify_read(size);
                self.chunk_at = self.at;
                self.at += size as u64;
                return Ok(());
            }
            Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                self.at += RECORD_HEAD + data.len() as u64;
                mcap::parse_record(opcode, data)
            }
            Some(Err(why)) => Err(why),
        };
        match record {
            Ok(Record::Header(header)) => self.profile = Some(header.profile),
            Ok(Record::Footer(footer)) => self.index = Some(footer.summary_start > 0),
            Ok(Record::Message { header, .. }) => {
                self.cut(&McapError::UnknownChannel(header.sequence, header.channel_id));
            }
            // A chunk, or what comes after all of them, whose first byte is another.
            Ok(Record::Unknown { .. }) => self.damaged += 1,
            Ok(_) => {}
            Err(why) => self.cut(&why),
        }
        Ok(())
    }

    /// What follows cannot be told from anything else.
    fn cut(&mut self, why: &McapError) {
        tracing::debug!("{}: {why}", self.file);
        self.ended = Some(Ended::Cut);
    }
}
