//! When a frame's touches should not be believed, and why.

use crate::reference::Difference;
use crate::reference::diagnosis::Fault;
use serde::{Serialize, Serializer};
use std::fmt;

/// What speaks against a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Doubt {
    /// Most values are missing, clipped or contradict the others.
    FewValues {
        /// How many are used.
        used: usize,
        /// Of how many.
        of: usize,
    },
    /// The frame is not that of the sheet whose baseline was taken.
    NotThisSheet,
    /// The baseline is not that of the sheet as it was described.
    OtherSheet,
    /// The sheet moved while its baseline was taken.
    MovedBaseline,
    /// Something changed, but no touches explain it.
    NotTouches,
    /// Touches explain the change, but where they are is not known: none is listed.
    Unplaced,
    /// At rest values that are the same on every sheet, with drive and sense exchanged, are not: what measures is wrong, or the wires.
    NotReciprocal,
    /// The frame's time went into what frames are solved with from now on. What is shown is of the last one solved.
    NotSolved,
    /// The frame is the same to the last bit as those before it, though noise makes frames differ.
    Repeated,
    /// With a calibration from presses: what touches leave over is larger than in those presses.
    UnlikePresses {
        /// By so many times.
        times: f64,
    },
    /// Something is broken, and touches are not to be had, or less certain: contacts that changed are taken out.
    Fault(Fault),
    /// Something that lay on the sheet when the baseline was taken has gone.
    Gone {
        /// Where it lay, mm.
        x_mm: i32,
        /// Where it lay, mm.
        y_mm: i32,
        /// Whether the resistivity fell there: on a sheet whose touches lower it, that would be one.
        fell: bool,
    },
}

/// When the values of a frame speak against it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DoubtOptions {
    /// Part of the values that a frame needs. Without three electrodes of sixteen there are 76 of 208; the touches of such frames
    /// are still right.
    pub least_values: f64,
    /// Largest change over the unpressed values, 2-norms. A lost or reversed source changes more than this.
    pub largest_change: f64,
    /// What a whole hand with +300 % changes over the unpressed values, on the paper's sheet. Where touches leave more than that, none comes
    /// down.
    pub largest_hand: f64,
}

impl Default for DoubtOptions {
    fn default() -> Self {
        Self {
            least_values: 0.35,
            largest_change: 0.6,
            largest_hand: 0.06,
        }
    }
}

impl Doubt {
    /// What the values themselves say.
    pub(crate) fn of(difference: &Difference, model_v: &[f64], options: DoubtOptions) -> Option<Self> {
        let of = difference.used.len();
        let used = difference.used.iter().filter(|used| **used).count();
        if (used as f64) < options.least_values * of as f64 {
            return Some(Self::FewValues { used, of });
        }
        // What is no number is not small.
        let small = difference.part_of(model_v) <= options.largest_change;
        (!small).then_some(Self::NotThisSheet)
    }
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FewValues { used, of } => {
                write!(
                    f,
                    "only {used} of {of} values can be used: look at cables, electrodes and range"
                )
            }
            Self::NotThisSheet => {
                write!(
                    f,
                    "not the sheet of the baseline: look at excitation, cables and multiplexers"
                )
            }
            Self::Fault(fault) => write!(f, "{fault}"),
            Self::Gone { x_mm, y_mm, fell } => {
                let [change, rise] = if *fell { ["lower", "down"] } else { ["raise", "up"] };
                let wet = if *fell { ", or water lies there" } else { "" };
                write!(
                    f,
                    "something that lay at ({x_mm}, {y_mm}) mm when the baseline was taken has gone{wet}: take a new baseline; or, if \
                     touches {change} the resistance of this sheet, say --rise {rise}"
                )
            }
            Self::UnlikePresses { times } => write!(
                f,
                "what the touches leave over is {times:.1} times as large as in the presses of the calibration; look at the \
                 contacts, or calibrate anew"
            ),
            Self::NotSolved => write!(
                f,
                "the frame was not solved: its time went into what the next ones are solved with; shown is the last one that was"
            ),
            Self::Repeated => write!(
                f,
                "the same frame comes again and again: the board, or what passes its frames on, repeats an old one"
            ),
            Self::NotReciprocal => write!(
                f,
                "values with drive and sense exchanged disagree, as on no sheet: look at cables, multiplexers, amplifiers and the time to \
                 settle; touches are less certain than they say"
            ),
            Self::OtherSheet => write!(
                f,
                "the baseline is not that of the sheet as described, so that places and strengths may be wrong: look at the sheet's size, \
                 and at the order and the sign of the values"
            ),
            Self::MovedBaseline => write!(
                f,
                "the sheet moved while the baseline was taken: touches are of a sheet that something already pressed; take a baseline at rest"
            ),
            Self::Unplaced => write!(
                f,
                "touches explain the change, but these values do not tell where they are, and none is listed: another pattern, or \
                 electrodes whose places are known, would tell"
            ),
            Self::NotTouches => write!(
                f,
                "no touches of the expected size explain the change: shown is what explains most of it, of other objects or of \
                 contacts that changed since the baseline"
            ),
        }
    }
}

impl Serialize for Doubt {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_without_values_or_of_another_sheet_is_doubted() {
        let model = [1.0, -2.0, 3.0, 4.0];
        let of = |frame: [f64; 4]| {
            Doubt::of(
                &Difference::new(&model, &model, &frame),
                &model,
                DoubtOptions::default(),
            )
        };
        assert_eq!(of([1.1, -2.2, 3.3, 4.4]), None);
        assert_eq!(of([f64::NAN, f64::NAN, 3.0, 4.0]), None);
        assert_eq!(
            of([f64::NAN, f64::NAN, f64::NAN, 4.0]),
            Some(Doubt::FewValues { used: 1, of: 4 })
        );
        // A source that is lost, one that is turned round.
        assert_eq!(of([0.0; 4]), Some(Doubt::NotThisSheet));
        assert_eq!(of([-1.0, 2.0, -3.0, -4.0]), Some(Doubt::NotThisSheet));
    }

    /// The other way is named, by which it would be a touch.
    #[test]
    fn what_has_gone_is_said_with_the_way_in_which_it_would_be_a_touch() {
        for (fell, rise) in [
            (true, "touches lower the resistance of this sheet, say --rise down"),
            (false, "--rise up"),
        ] {
            let doubt = Doubt::Gone {
                x_mm: -3,
                y_mm: 20,
                fell,
            };
            let text = doubt.to_string();
            assert!(text.contains("(-3, 20) mm") && text.ends_with(rise), "{text}");
        }
    }
}
