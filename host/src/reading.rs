//! A recording that is read from its beginning to its end; how far it is, is told.

use crate::progress::Progress;
use anyhow::{Context, Result};
use recording::{Ended, Message, Reader, RecordingError};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// The messages of a recording, one after the other.
pub(crate) struct Reading {
    reader: Reader<BufReader<File>>,
    bytes: usize,
    progress: Progress,
}

impl Reading {
    /// Opens `FILE`, or `FILE#NAME` for one of several skins.
    ///
    /// # Errors
    /// It is no recording, or cannot be read.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let reader = Reader::open(path)?;
        let size = std::fs::metadata(recording::split(path).0).with_context(|| path.display().to_string())?;
        Ok(Self {
            reader,
            bytes: size.len() as usize,
            progress: Progress::new("reading the recording"),
        })
    }

    /// The next message; none at the end.
    ///
    /// # Errors
    /// The file cannot be read.
    pub(crate) fn next(&mut self) -> Result<Option<Message<'_>>, RecordingError> {
        self.progress.at(self.reader.bytes() as usize, self.bytes);
        self.reader.next()
    }

    /// How the file ended, once its end was read.
    pub(crate) fn ended(&self) -> Option<Ended> {
        self.reader.ended()
    }

    /// Chunks so far that are damaged.
    pub(crate) fn damaged(&self) -> usize {
        self.reader.damaged()
    }

    /// Messages so far of which nothing tells the topic.
    pub(crate) fn nameless(&self) -> u64 {
        self.reader.nameless()
    }

    /// Its name.
    pub(crate) fn file(&self) -> &str {
        self.reader.file()
    }

    /// Bytes of the file.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes as u64
    }
}
