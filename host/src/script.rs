//! What a recording says of the live reconstruction, step by step, for its replay.

use crate::event::Said;
use crate::recorded::{LiveRecord, Touching};
use crate::recover::lacks;
use anyhow::{Result, anyhow};
use inverse::reference::baseline::Baseline;
use recording::{Known, Reader, Topic};
use serde::Deserialize;
use serde_json::Value;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use view::picture::BaselineNote;

/// A step that a replay takes.
pub(crate) enum Step {
    /// A frame was taken: into the baseline, or to a picture with these touches.
    Frame {
        frame: u32,
        picture: Option<PictureRecord>,
    },
    Tare,
    Resume(Baseline, Option<Box<Touching>>),
    InForce(Option<BaselineNote>),
    Event(Said),
}

/// What a recording says of a picture.
#[derive(Deserialize)]
pub(crate) struct PictureRecord {
    frame: u32,
    pub(crate) touches: Value,
    /// None in recordings of a program that did not record them.
    #[serde(default)]
    pub(crate) faults: Option<Value>,
    /// As the faults.
    #[serde(default)]
    pub(crate) events: Option<Value>,
    pub(crate) lost_frames: u64,
    pub(crate) skipped_frames: u64,
}

impl PictureRecord {
    /// The board's number of the frame.
    pub(crate) fn frame(&self) -> u32 {
        self.frame
    }
}

/// What the live reconstruction did, step by step.
pub(crate) struct Script {
    reader: Reader<BufReader<File>>,
    log_ns: u64,
}

impl Script {
    /// That of a recording.
    ///
    /// # Errors
    /// It cannot be read.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        Ok(Self {
            reader: Reader::open(path)?,
            log_ns: 0,
        })
    }

    /// That of a recording, from a place on.
    ///
    /// # Errors
    /// It cannot be read.
    pub(crate) fn open_at(path: &Path, known: &Known, place: u64) -> Result<Self> {
        Ok(Self {
            reader: Reader::open_at(path, known, place)?,
            log_ns: 0,
        })
    }

    /// Where in the file it is.
    pub(crate) fn place(&self) -> u64 {
        self.reader.place()
    }

    /// When the last step was recorded, s since 1970.
    pub(crate) fn unix_s(&self) -> f64 {
        1e-9 * self.log_ns as f64
    }

    /// The same, ns.
    pub(crate) fn log_ns(&self) -> u64 {
        self.log_ns
    }

    /// The next step; none at the end.
    ///
    /// # Errors
    /// The file cannot be read, or a step cannot be understood.
    pub(crate) fn next(&mut self) -> Result<Option<Step>> {
        self.next_from(0)
    }

    /// The next step, where pictures that were recorded before a time are passed over.
    ///
    /// # Errors
    /// As [`Script::next`].
    pub(crate) fn next_from(&mut self, from_ns: u64) -> Result<Option<Step>> {
        let file = self.reader.file().to_owned();
        let bad = |e: serde_json::Error| anyhow!("{file}: a step of the recording cannot be understood: {e}");
        while let Some(message) = self.reader.next()? {
            self.log_ns = message.log_ns;
            match message.topic {
                Some(Topic::Touches) if message.log_ns >= from_ns => {
                    let picture: PictureRecord = serde_json::from_slice(message.data).map_err(bad)?;
                    return Ok(Some(Step::Frame {
                        frame: picture.frame,
                        picture: Some(picture),
                    }));
                }
                Some(Topic::Live) => {
                    let step = serde_json::from_slice(message.data).map_err(bad)?;
                    return Ok(Some(match step {
                        LiveRecord::Baseline { frame, .. } => Step::Frame { frame, picture: None },
                        LiveRecord::Tare => Step::Tare,
                        LiveRecord::Resume { baseline, touching } => Step::Resume(baseline.into(), touching),
                        LiveRecord::InForce { note } => Step::InForce(note.map(BaselineNote::from)),
                        LiveRecord::Event { said } => Step::Event(said),
                        LiveRecord::Port => continue,
                    }));
                }
                _ => {}
            }
        }
        Ok(None)
    }

    /// What the file lacks, once it was read to its end.
    pub(crate) fn lacks(&self) -> Option<String> {
        lacks(self.reader.ended(), self.reader.damaged(), self.reader.nameless())
    }
}
