//! What a page shows of a guided calibration: where to press next.

use serde::Serialize;

/// Where to press next, and what was pressed so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Guide {
    /// The next mark, mm; none where nothing guides, or at the end.
    pub mark_mm: Option<[f64; 2]>,
    /// Marks that were pressed, mm.
    pub taken_mm: Vec<[f64; 2]>,
    /// Presses that are wanted; 0 where nothing guides.
    pub count: usize,
    /// What to do now, for people.
    pub text: String,
    /// What became of the last press, for people.
    pub note: String,
}

/// The message that tells it.
#[derive(Serialize)]
pub(super) struct Told<'a> {
    kind: &'static str,
    #[serde(flatten)]
    guide: &'a Guide,
}

impl<'a> From<&'a Guide> for Told<'a> {
    fn from(guide: &'a Guide) -> Self {
        Self { kind: "guide", guide }
    }
}
