//! Whether a contact changed: what frame after frame says of it.
//!
//! A contact that changed stays so, while noise, and a touch that comes down or moves while a frame is measured, speak for a contact in
//! one frame and for another in the next. So a contact is tried once linear fits have named it in frame after frame, and believed when
//! the whole fits of some frames, taken together, are better with it than without.

use super::Outcome;

/// Frames at the end in which the whole fit is asked.
const ASKED: usize = 4;
/// So many frames that name an electrode are undone by one that does not.
const NOT_NAMED: usize = 2;
/// A contact that is believed is asked after again after so many frames, and one that is not is not for so many.
const ASKED_AGAIN: usize = 16;
const NOT_ASKED: usize = 64;

/// An inquiry into the contacts of a sheet, frame after frame.
#[derive(Clone, Debug)]
pub(crate) struct Inquiry {
    /// Frames that it takes.
    frames: usize,
    /// Electrodes whose contact is believed to have changed.
    changed: Vec<usize>,
    /// Frames since that was asked last.
    since: usize,
    suspicion: Option<Suspicion>,
    /// An electrode that was asked for in vain, and for how many frames it is not again.
    innocent: Option<(usize, usize)>,
}

/// An electrode named by the linear fits.
#[derive(Clone, Copy, Debug)]
struct Suspicion {
    electrode: usize,
    named: usize,
    asked: usize,
    /// Sums over the frames asked.
    with: Outcome,
    without: Outcome,
}

/// What the whole fits say of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// It changed.
    Changed,
    /// It did not.
    DidNot,
    /// More frames are wanted.
    Open,
}

impl Inquiry {
    /// That takes so many frames, one or more.
    pub(crate) fn new(frames: usize) -> Self {
        Self {
            frames: frames.max(1),
            changed: Vec::new(),
            since: 0,
            suspicion: None,
            innocent: None,
        }
    }

    /// Electrodes whose contact changed.
    pub(crate) fn changed(&self) -> &[usize] {
        &self.changed
    }

    /// Whether an electrode is suspected: then every frame counts.
    pub(crate) fn is_open(&self) -> bool {
        self.suspicion.is_some()
    }

    /// Knows nothing any more: of another baseline, or of a sheet on which there is nothing.
    pub(crate) fn clear(&mut self) {
        self.changed.clear();
        self.suspicion = None;
        self.innocent = None;
    }

    /// Begins a frame. Gives the electrodes believed to have changed where it is time to ask whether they still are: then
    /// [`Inquiry::changed`] has none until [`Inquiry::keep`].
    pub(crate) fn begin(&mut self) -> Option<Vec<usize>> {
        self.innocent = self.innocent.and_then(|(l, frames)| Some((l, frames.checked_sub(1)?)));
        self.since += 1;
        let due = !self.changed.is_empty() && self.since >= ASKED_AGAIN;
        due.then(|| {
            self.since = 0;
            std::mem::take(&mut self.changed)
        })
    }

    /// Believes these.
    pub(crate) fn keep(&mut self, changed: Vec<usize>) {
        self.changed = changed;
    }

    /// Hears which electrode the linear fits of a frame name, and says which one the whole fit is to be asked of: it is then in
    /// [`Inquiry::changed`] until [`Inquiry::hear`].
    pub(crate) fn suspect(&mut self, electrode: Option<usize>) -> bool {
        let electrode = electrode.filter(|l| self.innocent.is_none_or(|(innocent, _)| innocent != *l));
        self.suspicion = match self.suspicion {
            Some(s) if Some(s.electrode) == electrode => Some(Suspicion {
                named: s.named + 1,
                ..s
            }),
            // Noise may hide it in a frame.
            Some(s) if s.named > NOT_NAMED => Some(Suspicion {
                named: s.named - NOT_NAMED,
                ..s
            }),
            _ => electrode.map(|electrode| Suspicion {
                electrode,
                named: 1,
                asked: 0,
                with: Outcome::default(),
                without: Outcome::default(),
            }),
        };
        let ripe = self
            .suspicion
            .filter(|s| Some(s.electrode) == electrode && s.named + self.asked() > self.frames);
        self.changed.extend(ripe.map(|s| s.electrode));
        ripe.is_some()
    }

    /// Hears what the whole fits of a frame make of it with the contact asked for and without.
    pub(crate) fn hear(&mut self, with: Option<Outcome>, without: Option<Outcome>) -> Verdict {
        let asked = self.asked();
        let verdict = match (&mut self.suspicion, with.zip(without)) {
            (Some(s), Some((with, without))) => {
                s.asked += 1;
                s.with = s.with + with;
                s.without = s.without + without;
                let (with, without) = (s.with.mean_of(s.asked), s.without.mean_of(s.asked));
                match (with.instead_of(without), s.asked >= asked) {
                    (true, true) => Verdict::Changed,
                    (true, false) => Verdict::Open,
                    (false, _) => Verdict::DidNot,
                }
            }
            _ => Verdict::DidNot,
        };
        match verdict {
            Verdict::Changed => {
                self.suspicion = None;
                self.since = 0;
            }
            Verdict::DidNot => {
                self.innocent = self.changed.pop().map(|l| (l, NOT_ASKED));
                self.suspicion = None;
            }
            Verdict::Open => {
                self.changed.pop();
            }
        }
        verdict
    }

    fn asked(&self) -> usize {
        self.frames.min(ASKED)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BETTER: Outcome = Outcome {
        cost: 100.0,
        misfit: 1.0,
    };
    const WORSE: Outcome = Outcome {
        cost: 300.0,
        misfit: 2.5,
    };

    /// Frames until it is believed, of at most `most`.
    fn frames(inquiry: &mut Inquiry, most: usize, named: impl Fn(usize) -> Option<usize>) -> Option<usize> {
        (0..most).find(|k| {
            inquiry.begin();
            inquiry.suspect(named(*k)) && inquiry.hear(Some(BETTER), Some(WORSE)) == Verdict::Changed
        })
    }

    #[test]
    fn it_takes_as_many_frames_as_it_was_told() {
        for n in [1, 2, 3, 4, 5, 16, 40] {
            let mut inquiry = Inquiry::new(n);
            assert_eq!(frames(&mut inquiry, 100, |_| Some(3)), Some(n - 1));
            assert_eq!(inquiry.changed(), [3]);
        }
    }

    #[test]
    fn one_that_is_named_in_two_frames_of_three_or_as_often_as_others_is_none() {
        let mut inquiry = Inquiry::new(16);
        assert_eq!(frames(&mut inquiry, 1000, |k| (k % 3 != 0).then_some(5)), None);
        assert_eq!(frames(&mut inquiry, 1000, |k| Some(k / 12 % 2)), None);
        assert!(inquiry.changed().is_empty());
        // In seven of eight it is.
        assert!(frames(&mut inquiry, 40, |k| (k % 8 != 0).then_some(5)).is_some());
    }

    #[test]
    fn one_that_the_whole_fit_does_not_confirm_is_left_alone_for_a_while() {
        let mut inquiry = Inquiry::new(16);
        let asked = (0..16 + NOT_ASKED + 16).filter(|_| {
            inquiry.begin();
            let asked = inquiry.suspect(Some(2));
            if asked {
                assert_eq!(inquiry.changed(), [2]);
                assert_eq!(inquiry.hear(Some(WORSE), Some(BETTER)), Verdict::DidNot);
            }
            assert!(inquiry.changed().is_empty());
            asked
        });
        assert_eq!(asked.count(), 2);
    }
}
