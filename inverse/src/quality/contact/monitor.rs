//! Whether a contact changed: what frame after frame says of it.
//!
//! A contact that changed stays so, while noise, and a touch that comes down or moves while a frame is measured, speak for a contact in
//! one frame and for another in the next. So a contact is tried once linear fits have named it in frame after frame, and believed when
//! the whole fits of some frames, taken together, are better with it than without.

use crate::quality::contact::Outcome;

/// Frames at the end in which the whole fit is asked.
const ASKED: usize = 4;
/// So many frames that name an electrode are undone by one that does not.
const NOT_NAMED: usize = 2;
/// A contact that is believed is asked after again after so many frames, or so few if that was in doubt; one that is not believed is
/// not for so many.
const ASKED_AGAIN: usize = 16;
const ASKED_SOON: usize = 4;
const NOT_ASKED: usize = 64;

/// An inquiry into the contacts of a sheet, frame after frame.
#[derive(Clone, Debug)]
pub(crate) struct Inquiry {
    /// Frames that it takes.
    frames: usize,
    /// Electrodes whose contact is believed to have changed.
    changed: Vec<usize>,
    /// Frames until that is asked again, and whether it was in doubt the last time.
    until: usize,
    doubted: bool,
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
            until: 0,
            doubted: false,
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
        self.doubted = false;
    }

    /// Whether a frame that names the suspect once more is one in which the whole fits are asked, or it is time to ask again.
    pub(crate) fn asks_next(&self) -> bool {
        let ripe = self.suspicion.is_some_and(|s| s.named + self.asked() >= self.frames);
        ripe || self.is_due()
    }

    fn is_due(&self) -> bool {
        !self.changed.is_empty() && self.until <= 1
    }

    /// Begins a frame. Gives the electrodes believed to have changed where it is time to ask whether they still are: then
    /// [`Inquiry::changed`] has none until [`Inquiry::hear_again`].
    pub(crate) fn begin(&mut self) -> Option<Vec<usize>> {
        self.innocent = self.innocent.and_then(|(l, frames)| Some((l, frames.checked_sub(1)?)));
        if self.is_due() {
            return Some(std::mem::take(&mut self.changed));
        }
        self.until = self.until.saturating_sub(1);
        None
    }

    /// Believes these while the whole fit is asked of them again.
    pub(crate) fn keep(&mut self, changed: Vec<usize>) {
        self.changed = changed;
    }

    /// Hears what the whole fits make of a frame with the contacts that are believed to have changed and without. They are not believed
    /// any more, which is said, when two frames speak against them.
    pub(crate) fn hear_again(&mut self, with: Option<Outcome>, without: Option<Outcome>) -> bool {
        let stays = with.zip(without).is_some_and(|(with, without)| with.stays(without));
        let gone = !stays && (self.doubted || self.frames == 1);
        self.doubted = !stays && !gone;
        self.until = if stays { self.asked_again() } else { ASKED_SOON };
        if gone {
            self.changed.clear();
        }
        gone
    }

    /// Hears which electrode the linear fits of a frame name, and says whether the whole fit is to be asked of it: it is then in
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
                match s.asked >= asked {
                    true if with.instead_of(without) => Verdict::Changed,
                    false if with.cost < without.cost => Verdict::Open,
                    _ => Verdict::DidNot,
                }
            }
            _ => Verdict::DidNot,
        };
        match verdict {
            Verdict::Changed => {
                self.suspicion = None;
                (self.until, self.doubted) = (self.asked_again(), false);
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

    /// Frames that are believed by themselves are asked by themselves.
    fn asked_again(&self) -> usize {
        if self.frames == 1 { 1 } else { ASKED_AGAIN }
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
        model: 5.0,
    };
    const WORSE: Outcome = Outcome {
        cost: 300.0,
        misfit: 2.5,
        model: 5.0,
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
    fn one_that_is_believed_goes_when_two_frames_speak_against_it() {
        let mut inquiry = Inquiry::new(2);
        assert_eq!(frames(&mut inquiry, 2, |_| Some(3)), Some(1));
        let mut ask = |with, without| {
            for wait in 1.. {
                let asks = inquiry.asks_next();
                let Some(changed) = inquiry.begin() else {
                    assert!(!asks && inquiry.changed() == [3]);
                    continue;
                };
                assert!(asks && changed == [3] && inquiry.changed().is_empty());
                inquiry.keep(changed);
                return (wait, inquiry.hear_again(Some(with), Some(without)));
            }
            unreachable!()
        };
        assert_eq!(ask(WORSE, BETTER), (ASKED_AGAIN, false));
        assert_eq!(ask(BETTER, WORSE), (ASKED_SOON, false));
        assert_eq!(ask(WORSE, BETTER), (ASKED_AGAIN, false));
        assert_eq!(ask(WORSE, BETTER), (ASKED_SOON, true));
        assert!(inquiry.changed().is_empty());
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
