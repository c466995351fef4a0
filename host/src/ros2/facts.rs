//! How a skin is, for `~/diagnostics`.

use super::messages::{Level, Status};
use std::sync::Arc;
use std::time::{Duration, Instant};
use view::picture::Picture;

/// A picture that is older than this is no picture of now.
const STALE: Duration = Duration::from_secs(3);

/// What is known of a skin.
#[derive(Default)]
pub(super) struct Facts {
    /// What is shown, and since when.
    pub(super) shown: Option<(Arc<Picture>, Instant)>,
    /// Whether touches are doubted or something is broken.
    pub(super) trouble: bool,
    /// Frames that were lost when it was told last.
    lost_told: u64,
}

/// What became of the messages of a skin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Sent {
    pub(super) frames: u64,
    /// Frames that were passed over for newer ones before they were sent.
    pub(super) passed_over: u64,
    /// Messages that DDS did not take.
    pub(super) refused: u64,
    pub(super) subscribers: usize,
}

impl Sent {
    fn lost(&self) -> u64 {
        self.passed_over + self.refused
    }
}

impl Facts {
    /// How it is now: the board, what is on the sheet, its baseline and what is sent.
    pub(super) fn statuses(&mut self, skin: &str, now_unix_s: f64, sent: &Sent, sent_before: &Sent) -> Vec<Status> {
        let status = |part: &str, level, message: String, values| Status {
            level,
            name: format!("{skin}: {part}"),
            message,
            values,
        };
        let mut out = Vec::new();
        let old = self
            .shown
            .as_ref()
            .map(|(_, at)| at.elapsed())
            .filter(|age| *age > STALE);
        match &self.shown {
            None => {
                let message = "no frame yet: the program looks for the board and models the sheet".to_owned();
                out.push(status("board", Level::Stale, message, Vec::new()));
            }
            Some((picture, _)) => {
                let stats = &picture.stats;
                let values = vec![
                    ("source", stats.source.clone()),
                    ("frames_per_s", format!("{:.1}", stats.frames_per_s)),
                    ("lost_frames", stats.lost_frames.to_string()),
                    ("skipped_frames", stats.skipped_frames.to_string()),
                ];
                let (level, message) = match (&stats.away, old) {
                    (Some(why), _) => (Level::Error, why.clone()),
                    (None, Some(age)) => (Level::Stale, format!("no frame for {:.0} s", age.as_secs_f64())),
                    (None, None) => {
                        let lost = stats.lost_frames > self.lost_told;
                        let level = if lost { Level::Warn } else { Level::Ok };
                        let lost = if lost { ", frames are lost" } else { "" };
                        (level, format!("{:.1} frames/s{lost}", stats.frames_per_s))
                    }
                };
                self.lost_told = stats.lost_frames;
                out.push(status("board", level, message, values));
                let numbers: Vec<String> = stats.faulty.iter().map(|e| (e + 1).to_string()).collect();
                let unknown = || "unknown".to_owned();
                let values = vec![
                    ("residual", stats.residual.map_or_else(unknown, |r| format!("{r:.3}"))),
                    ("uncalibrated", stats.uncalibrated.to_string()),
                    ("faulty_electrodes", numbers.join(" ")),
                ];
                let level = if self.trouble { Level::Warn } else { Level::Ok };
                let touches = || format!("{} touches", picture.touches.len());
                let message = stats.status.clone().unwrap_or_else(touches);
                out.push(status("touches", level, message, values));
                let (level, message) = match &stats.baseline {
                    _ if stats.preparing => (Level::Warn, "taking the baseline, do not touch".to_owned()),
                    None => (Level::Warn, "no baseline yet".to_owned()),
                    Some(note) => match &note.warning {
                        Some(warning) => (Level::Warn, warning.clone()),
                        None => {
                            let age_s = (now_unix_s - note.taken_unix_s).max(0.0);
                            (Level::Ok, format!("taken {age_s:.0} s ago"))
                        }
                    },
                };
                let stored = stats.baseline.as_ref().is_some_and(|note| note.stored);
                out.push(status("baseline", level, message, vec![("stored", stored.to_string())]));
            }
        }
        let lost = sent.lost() - sent_before.lost();
        let (level, message) = match lost {
            0 => (Level::Ok, format!("{} subscribers", sent.subscribers)),
            lost => (Level::Warn, format!("{lost} messages lost within a second")),
        };
        let values = vec![
            ("frames", sent.frames.to_string()),
            ("passed_over", sent.passed_over.to_string()),
            ("refused", sent.refused.to_string()),
        ];
        out.push(status("publisher", level, message, values));
        out
    }
}
