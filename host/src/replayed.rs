//! How a recording that is played compares with what was recorded.

use crate::recorded::pressed;
use crate::say::say;
use crate::script::PictureRecord;
use anyhow::Result;
use inverse::pipeline::FrameResult;
use inverse::touches::gestures::TouchEvent;
use link::LinkCounters;

/// A recording that is played, and how it compares with what was found when it was recorded.
#[derive(Default)]
pub(crate) struct Replayed {
    pub(crate) expected: Option<PictureRecord>,
    same: u64,
    different: u64,
    first_different: Option<u32>,
    /// Frames that were taken, but are not in the file.
    pub(crate) missing: u64,
    /// Whether the page went to another place: from there on numbers of touches are others than then.
    pub(crate) jumped: bool,
}

impl Replayed {
    /// Holds a picture against what was recorded of it, and counts as was counted then.
    ///
    /// # Errors
    /// The touches cannot be compared.
    pub(crate) fn compare(
        &mut self,
        result: &FrameResult,
        events: &[TouchEvent],
        counters: &mut LinkCounters,
    ) -> Result<()> {
        let Some(expected) = self.expected.take() else {
            return Ok(());
        };
        counters.lost_frames = expected.lost_frames;
        counters.skipped_frames = expected.skipped_frames;
        if self.jumped {
            return Ok(());
        }
        let faults = serde_json::to_value(&result.faults)?;
        let same_faults = expected.faults.as_ref().is_none_or(|expected| *expected == faults);
        let events = serde_json::to_value(events)?;
        let same_events = expected.events.as_ref().is_none_or(|expected| *expected == events);
        if serde_json::to_value(pressed(result))? == expected.touches && same_faults && same_events {
            self.same += 1;
        } else {
            self.different += 1;
            self.first_different.get_or_insert(expected.frame());
        }
        Ok(())
    }

    /// Says how many pictures were the same.
    pub(crate) fn say(&self, file: &str, ended: bool) {
        let pictures = self.same + self.different;
        if self.jumped {
            say!("{file}: after the page went to another place pictures are not compared with what was recorded");
        }
        if pictures == 0 && !self.jumped {
            say!("{file}: no picture in it; skin info says what there is");
        } else if self.different > 0 {
            say!(
                "warning: {file}: {} of {pictures} pictures have other touches, events or faults than were recorded, from frame {} on",
                self.different,
                self.first_different.unwrap_or(0)
            );
        } else if pictures > 0 {
            say!("{file}: {pictures} pictures, every one with the recorded touches");
        }
        if self.missing > 0 {
            say!(
                "warning: {file}: {} frames that were shown are not in the file",
                self.missing
            );
        }
        if !ended && !self.jumped {
            say!("{file}: not played to its end");
        }
    }
}
