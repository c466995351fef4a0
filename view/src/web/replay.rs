//! What a page shows of a recording that is played.

use serde::Serialize;

/// Where a replay is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Replay {
    /// Time since the first step of the recording, ms.
    pub at_ms: u64,
    /// Time to the last one, ms.
    pub length_ms: u64,
    /// Whether it stands still.
    pub paused: bool,
}

/// The message that tells it.
#[derive(Serialize)]
pub(super) struct Told {
    kind: &'static str,
    #[serde(flatten)]
    replay: Replay,
}

impl From<Replay> for Told {
    fn from(replay: Replay) -> Self {
        Self { kind: "replay", replay }
    }
}
