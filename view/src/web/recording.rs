//! What a page shows of the recording.

use serde::Serialize;

/// What is recorded now, or why nothing is.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Recording {
    /// The file that is written; none while nothing is recorded.
    pub file: Option<String>,
    /// Bytes in it.
    pub bytes: u64,
    /// Whole seconds since it was begun.
    pub seconds: u64,
    /// What to tell whoever asked: where the last recording is, or why there is none.
    pub note: Option<String>,
}

/// The message that tells it.
#[derive(Serialize)]
pub(super) struct Told<'a> {
    kind: &'static str,
    #[serde(flatten)]
    recording: &'a Recording,
}

impl<'a> From<&'a Recording> for Told<'a> {
    fn from(recording: &'a Recording) -> Self {
        Self {
            kind: "recording",
            recording,
        }
    }
}
