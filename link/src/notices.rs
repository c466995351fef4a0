//! What a person is told of the line: frames that are lost, silence, a board that was reset.

use crate::port::{Arrival, LinkCounters};
use crate::session::MeasuredFrame;
use std::collections::VecDeque;
use std::fmt;
use std::time::Duration;

/// Frames lost are counted over so long, s of the board's time.
const WINDOW_S: f64 = 1.0;
/// They are said from this part of all on, and from so many: one alone is a glitch.
const LEAST_PART: f64 = 0.01;
const LEAST_LOST: u64 = 2;
/// What goes on is said again after so long, s of the board's time.
const AGAIN_S: f64 = 10.0;
/// Silence is said after so long, and not before so many frames would have come.
const SILENCE: Duration = Duration::from_millis(500);
const SILENT_FRAMES: f64 = 3.0;

/// Something about the line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LinkNotice {
    /// Frames are lost.
    Lost {
        /// How many.
        lost: u64,
        /// Of how many.
        of: u64,
        /// How messages arrived meanwhile.
        arrival: Arrival,
    },
    /// Nothing comes.
    Silent {
        /// For so long, s.
        s: f64,
    },
    /// The board was reset, and its time began anew.
    Reset,
}

impl fmt::Display for LinkNotice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lost { lost, of, arrival } => {
                write!(f, "{lost} of {of} frames are lost: ")?;
                match arrival {
                    Arrival { damaged: 1.., .. } => write!(
                        f,
                        "{} messages arrived damaged; look at the cable and what runs beside it",
                        arrival.damaged
                    ),
                    Arrival { late: 1.., .. } => write!(
                        f,
                        "they were read too late; this computer is too busy, or the program takes frames too slowly"
                    ),
                    _ => write!(f, "the board gave them up; look at its supply, and take a slower plan"),
                }
            }
            Self::Silent { s } => write!(
                f,
                "the board has sent nothing for {s:.1} s: the picture is old; look at its cable and power"
            ),
            Self::Reset => write!(f, "the board was reset and measures again: look at its supply"),
        }
    }
}

/// A frame, and the counters with it.
#[derive(Clone, Copy, Debug)]
struct At {
    time_s: f64,
    sequence: u32,
    /// Frames taken so far.
    taken: u64,
    skipped: u64,
    arrival: Arrival,
}

/// Watches the counters of a link.
#[derive(Clone, Debug, Default)]
pub struct LinkNotices {
    frames: VecDeque<At>,
    taken: u64,
    /// When lost frames were said last, s.
    said_s: Option<f64>,
    silent: bool,
}

impl LinkNotices {
    /// Takes the counters and the frame that came, or none after a wait in which none came. Gives what is new, or has gone on for
    /// long. The link reads ahead of who takes frames: what is lost is told by the frames' own numbers.
    pub fn take(&mut self, counters: &LinkCounters, frame: Option<&MeasuredFrame>) -> Option<LinkNotice> {
        let Some(&MeasuredFrame { time_s, sequence, .. }) = frame else {
            return self.wait(counters);
        };
        self.taken += 1;
        let now = At {
            time_s,
            sequence,
            taken: self.taken,
            skipped: counters.skipped_frames,
            arrival: counters.arrival,
        };
        self.silent = false;
        let reset = self.frames.back().is_some_and(|last| time_s < last.time_s);
        if reset {
            self.frames.clear();
            self.said_s = None;
        }
        self.frames.push_back(now);
        // The last one that is older than the window stays: what is counted is since it.
        while self
            .frames
            .get(1)
            .is_some_and(|second| time_s - second.time_s > WINDOW_S)
        {
            self.frames.pop_front();
        }
        if reset {
            return Some(LinkNotice::Reset);
        }
        let before = self.frames.front()?;
        let all = u64::from(now.sequence.wrapping_sub(before.sequence));
        let came = now.taken - before.taken + now.skipped.saturating_sub(before.skipped);
        let lost = all.saturating_sub(came);
        if lost < LEAST_LOST || (lost as f64) <= LEAST_PART * all as f64 {
            return None;
        }
        if self.said_s.is_some_and(|said_s| time_s - said_s < AGAIN_S) {
            return None;
        }
        self.said_s = Some(time_s);
        Some(LinkNotice::Lost {
            lost,
            of: all,
            arrival: Arrival {
                damaged: now.arrival.damaged.saturating_sub(before.arrival.damaged),
                late: now.arrival.late.saturating_sub(before.arrival.late),
            },
        })
    }

    fn wait(&mut self, counters: &LinkCounters) -> Option<LinkNotice> {
        let [a, b] = [2, 1].map(|k| self.frames.len().checked_sub(k).and_then(|k| self.frames.get(k)));
        let interval_s = a.zip(b).map_or(0.0, |(a, b)| b.time_s - a.time_s);
        let silent_s = counters.silent.as_secs_f64();
        if self.silent || silent_s < SILENCE.as_secs_f64().max(SILENT_FRAMES * interval_s) {
            return None;
        }
        self.silent = true;
        Some(LinkNotice::Silent { s: silent_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn frame(sequence: u32, time_s: f64) -> MeasuredFrame {
        MeasuredFrame {
            sequence,
            time_s,
            values_v: Vec::new(),
        }
    }

    fn skipped(skipped_frames: u64) -> LinkCounters {
        LinkCounters {
            skipped_frames,
            ..LinkCounters::default()
        }
    }

    /// Frames at 100 a second, of which every n-th is lost: when it is said, and how many of how many.
    fn said(every: u32, seconds: f64) -> Vec<(f64, LinkNotice)> {
        let mut notices = LinkNotices::default();
        let came = (1..=(100.0 * seconds) as u32).filter(|k| k % every != 0);
        came.filter_map(|k| {
            let time_s = 0.01 * f64::from(k);
            let said = notices.take(&LinkCounters::default(), Some(&frame(k, time_s)));
            said.map(|n| (time_s, n))
        })
        .collect()
    }

    #[test]
    fn more_than_one_in_a_hundred_is_said_within_a_second_and_again_after_ten() {
        for every in [2, 10, 40] {
            let said = said(every, 25.0);
            assert_eq!(said.len(), 3, "{every}: {said:?}");
            assert!(
                said[0].0 <= 1.0 && (9.9..10.1).contains(&(said[1].0 - said[0].0)),
                "{said:?}"
            );
        }
        assert!(said(150, 25.0).is_empty());
    }

    #[test]
    fn almost_all_lost_is_said_with_the_next_frame_and_frames_passed_over_are_not_lost() {
        for over in [0, 98, 99] {
            let mut notices = LinkNotices::default();
            assert_eq!(notices.take(&skipped(5), Some(&frame(u32::MAX, 0.0))), None);
            let said = notices.take(&skipped(5 + over), Some(&frame(99, 1.0)));
            let lost = 99 - over;
            let expected = LinkNotice::Lost {
                lost,
                of: 100,
                arrival: Arrival::default(),
            };
            assert_eq!(said, (lost > 1).then_some(expected));
        }
    }

    #[test]
    fn silence_is_said_once_until_a_frame_comes_and_a_reset_at_once() {
        let mut notices = LinkNotices::default();
        let silent = |ms| LinkCounters {
            silent: Duration::from_millis(ms),
            ..LinkCounters::default()
        };
        notices.take(&silent(0), Some(&frame(1, 5.0)));
        notices.take(&silent(0), Some(&frame(2, 5.1)));
        assert_eq!(notices.take(&silent(400), None), None);
        assert_eq!(notices.take(&silent(600), None), Some(LinkNotice::Silent { s: 0.6 }));
        assert_eq!(notices.take(&silent(900), None), None);
        assert_eq!(notices.take(&silent(0), Some(&frame(0, 0.1))), Some(LinkNotice::Reset));
        assert_eq!(notices.take(&silent(600), None), Some(LinkNotice::Silent { s: 0.6 }));
    }

    proptest! {
        /// Frames a third of a second apart are no silence.
        #[test]
        fn slow_frames_are_no_silence(interval_s in 0.2_f64..2.0, part in 0.0_f64..2.9) {
            let mut notices = LinkNotices::default();
            notices.take(&LinkCounters::default(), Some(&frame(1, 0.0)));
            notices.take(&LinkCounters::default(), Some(&frame(2, interval_s)));
            let silent = Duration::from_secs_f64(part * interval_s);
            let said = notices.take(&LinkCounters { silent, ..LinkCounters::default() }, None);
            prop_assert!(said.is_none());
        }
    }
}
