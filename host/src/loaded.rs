//! A recording in memory: every frame in volts, and the touches that were found then.

use crate::recorded::SessionRecord;
use crate::recorded_frames::{Part, RecordedFrames};
use crate::script::{PictureRecord, Script, Step};
use ::forward::{Pattern, Sheet};
use anyhow::{Context, Result, bail};
use inverse::touches::touch::Touch;
use std::path::Path;

/// Most numbers of all frames together, 2 GB.
const MOST: usize = 250_000_000;

/// The touches of one picture.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedPicture {
    /// The board's number of its frame.
    pub sequence: u32,
    /// Those that press, strongest first.
    pub touches: Vec<Touch>,
}

/// A recording.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The sheet.
    pub sheet: Sheet,
    /// What the values of a frame are, with the wires where they lead.
    pub pattern: Pattern,
    /// Where the frames came from, in words.
    pub source: String,
    /// When it was begun, s since 1970 (UTC).
    pub started_unix_s: f64,
    /// The board's numbers of the frames; they begin anew when a board is reset.
    pub sequences: Vec<u32>,
    /// Times of the frames since the first one, s.
    pub at_s: Vec<f64>,
    /// Values of all frames, V, frame by frame; not a number where the converter clipped.
    pub values_v: Vec<f64>,
    /// Numbers of the frames that made the first baseline; empty where not all of them are known.
    pub baseline: Vec<u32>,
    /// What was found then, picture by picture.
    pub pictures: Vec<LoadedPicture>,
}

impl Loaded {
    /// Reads a recording: `FILE`, or `FILE#NAME` for one of several skins.
    ///
    /// # Errors
    /// It cannot be read, is no recording, has no frames, or is too long for this.
    pub fn read(path: &Path) -> Result<Self> {
        let session = SessionRecord::read(path)?;
        let mut frames = RecordedFrames::open(path, &Part::default())?;
        let pattern = frames.pattern(&session.wires)?;
        let mut loaded = Self {
            sheet: session.sheet()?,
            pattern,
            source: session.source.clone(),
            started_unix_s: session.started_unix_s,
            sequences: Vec::new(),
            at_s: Vec::new(),
            values_v: Vec::new(),
            baseline: Vec::new(),
            pictures: pictures(path)?,
        };
        while let Some(frame) = frames.next()? {
            if loaded.values_v.len() + frame.measured.values_v.len() > MOST {
                bail!(
                    "{}: more than {MOST} values, too many to hold at once; take a part with skin export --from-s and --to-s",
                    path.display()
                );
            }
            loaded.sequences.push(frame.measured.sequence);
            loaded.at_s.push(frame.at_s);
            loaded.values_v.extend(frame.measured.values_v);
        }
        if loaded.at_s.is_empty() {
            bail!("{}: no frames in it", path.display());
        }
        loaded.baseline = frames.baseline().to_vec();
        Ok(loaded)
    }
}

/// The touches of every picture that was recorded.
///
/// # Errors
/// The file cannot be read.
pub(crate) fn pictures(path: &Path) -> Result<Vec<LoadedPicture>> {
    let mut script = Script::open(path)?;
    let mut pictures = Vec::new();
    while let Some(step) = script.next()? {
        if let Step::Frame {
            frame,
            picture: Some(PictureRecord { touches, .. }),
        } = step
        {
            let touches = serde_json::from_value(touches).with_context(|| format!("{}: touches", path.display()))?;
            pictures.push(LoadedPicture {
                sequence: frame,
                touches,
            });
        }
    }
    Ok(pictures)
}
