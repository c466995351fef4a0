//! Whether a contact changed, or two leak: what frame after frame says of it.
//!
//! A contact that changed stays so. Noise names one contact in a frame and another in the next. A touch that comes down or
//! moves while a frame is measured does the same. A contact is therefore tested once linear fits have named it in frame after
//! frame. It is accepted when the full fits of some frames, taken together, are better with it than without.

use crate::quality::contact::cause::Cause;
use crate::quality::contact::evidence::Evidence;
use crate::quality::contact::options::ContactOptions;

/// Tests the contacts of a sheet, frame after frame.
#[derive(Clone, Debug)]
pub(crate) struct ContactMonitor {
    options: ContactOptions,
    /// Frames that a decision takes.
    frames: usize,
    /// What is accepted to have changed.
    changed: Vec<Cause>,
    /// Frames until they are tested again, and whether the last test was inconclusive.
    until: usize,
    inconclusive: bool,
    candidate: Option<Candidate>,
    /// What was rejected, and for how many frames it is no candidate.
    rejected: Option<(Cause, usize)>,
}

/// What the linear fits name, and the frames that named it and that were compared.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    cause: Cause,
    named: usize,
    /// Frames that named it beside touches that explain them, less those that did not.
    balance: isize,
    compared: usize,
    /// Whether it was compared once when touches explained the frame.
    doubted: bool,
    /// Sums over the frames compared.
    with: Evidence,
    without: Evidence,
}

/// What the full fits decide on a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Decision {
    /// It changed.
    Changed,
    /// It did not.
    Unchanged,
    /// More frames are wanted.
    Open,
}

impl ContactMonitor {
    /// A decision takes so many frames, one or more.
    pub(crate) fn new(frames: usize, options: ContactOptions) -> Self {
        Self {
            options,
            frames: frames.max(1),
            changed: Vec::new(),
            until: 0,
            inconclusive: false,
            candidate: None,
            rejected: None,
        }
    }

    /// What changed.
    pub(crate) fn changed(&self) -> &[Cause] {
        &self.changed
    }

    /// Whether there is a candidate that is a contact.
    pub(crate) fn asks_contact(&self) -> bool {
        self.candidate.is_some_and(|s| s.cause.contact().is_some())
    }

    /// What was rejected, and is no candidate for a while.
    pub(crate) fn rejected(&self) -> Option<Cause> {
        self.rejected.map(|(cause, _)| cause)
    }

    /// Whether there is a candidate: then every frame counts.
    pub(crate) fn is_open(&self) -> bool {
        self.candidate.is_some()
    }

    /// Forgets everything: the sheet is unpressed.
    pub(crate) fn clear(&mut self) {
        self.changed.clear();
        self.candidate = None;
        self.rejected = None;
        self.inconclusive = false;
    }

    /// Whether there is a candidate that was not doubted yet.
    pub(crate) fn asks_early(&self) -> bool {
        self.candidate.is_some_and(|s| !s.doubted)
    }

    /// Whether the full fits are compared in the next frame: one that names the candidate once more, or one in which accepted
    /// contacts are tested again.
    pub(crate) fn asks_next(&self) -> bool {
        let ripe = self
            .candidate
            .is_some_and(|s| s.named + self.full_fits() >= self.frames);
        ripe || self.is_due()
    }

    fn is_due(&self) -> bool {
        !self.changed.is_empty() && self.until <= 1
    }

    /// Whether the next frame tests accepted electrodes again.
    pub(crate) fn tests_again(&self, quiet: bool) -> bool {
        self.is_due() || (quiet && !self.changed.is_empty())
    }

    /// Begins a frame. Gives the accepted electrodes where it is time to test them again, or where that costs nothing
    /// (`quiet`): then [`ContactMonitor::changed`] has none until [`ContactMonitor::keep`].
    pub(crate) fn begin(&mut self, quiet: bool) -> Option<Vec<Cause>> {
        self.rejected = self.rejected.and_then(|(l, frames)| Some((l, frames.checked_sub(1)?)));
        if self.tests_again(quiet) {
            return Some(std::mem::take(&mut self.changed));
        }
        self.until = self.until.saturating_sub(1);
        None
    }

    /// Leaves these out again while the full fit with them is computed.
    pub(crate) fn keep(&mut self, changed: Vec<Cause>) {
        self.changed = changed;
    }

    /// Decides on accepted contacts from the full fits of a frame with and without them. True when they are rejected: when
    /// two tests one after the other speak against them.
    pub(crate) fn decide_again(&mut self, with: Option<Evidence>, without: Option<Evidence>) -> bool {
        let options = self.options;
        let stays = with
            .zip(without)
            .is_some_and(|(with, without)| with.stays(without, &options));
        let gone = !stays && (self.inconclusive || self.frames == 1);
        self.inconclusive = !stays && !gone;
        self.until = if stays {
            self.retest_frames()
        } else {
            self.options.retest_soon_frames
        };
        if gone {
            self.changed.clear();
        }
        gone
    }

    /// Takes what the linear fits of a frame name, and whether its touches explain the frame beside it. True when the full fits
    /// with and without it are to be compared: it is then in [`ContactMonitor::changed`] until [`ContactMonitor::decide`].
    pub(crate) fn propose(&mut self, cause: Option<Cause>, linear: bool) -> bool {
        let cause = cause.filter(|l| self.rejected.is_none_or(|(rejected, _)| rejected != *l));
        let balance = if linear { 1 } else { -1 };
        self.candidate = match self.candidate {
            Some(s) if Some(s.cause) == cause => Some(Candidate {
                named: s.named + 1,
                balance: s.balance + balance,
                ..s
            }),
            // Noise may hide it in a frame.
            Some(s) if s.named > self.options.miss_penalty => {
                let named = s.named - self.options.miss_penalty;
                let most = named.cast_signed();
                Some(Candidate {
                    named,
                    balance: s.balance.clamp(-most, most),
                    ..s
                })
            }
            _ => cause.map(|cause| Candidate {
                cause,
                named: 1,
                balance,
                compared: 0,
                doubted: false,
                with: Evidence::default(),
                without: Evidence::default(),
            }),
        };
        let ripe = self
            .candidate
            .filter(|s| Some(s.cause) == cause && s.named + self.full_fits() > self.frames);
        self.changed.extend(ripe.map(|s| s.cause));
        ripe.is_some()
    }

    /// The same of a frame in which there is no time to compare.
    pub(crate) fn note(&mut self, cause: Option<Cause>, linear: bool) {
        if self.propose(cause, linear) {
            self.take_back();
        }
    }

    /// Whether touches explain most of the frames that named the candidate.
    pub(crate) fn is_linear(&self) -> bool {
        self.candidate.is_some_and(|s| s.balance > 0)
    }

    /// Proposes the candidate that `cause` is, once, before it is ripe: until [`ContactMonitor::doubt`] or
    /// [`ContactMonitor::take_back`]. False where it was doubted before.
    pub(crate) fn propose_early(&mut self, cause: Option<Cause>) -> bool {
        let early = self.candidate.filter(|s| Some(s.cause) == cause && !s.doubted);
        self.changed.extend(early.map(|s| s.cause));
        early.is_some()
    }

    /// Takes the full fits of one frame with and without it: it is none where it would not stay one.
    pub(crate) fn doubt(&mut self, with: Option<Evidence>, without: Option<Evidence>) {
        let stays = with
            .zip(without)
            .is_some_and(|(with, without)| with.stays(without, &self.options));
        match &mut self.candidate {
            Some(candidate) if stays => {
                candidate.doubted = true;
                self.take_back();
            }
            _ => self.reject(),
        }
    }

    /// What was proposed is compared later.
    pub(crate) fn take_back(&mut self) {
        self.changed.pop();
    }

    fn reject(&mut self) {
        self.rejected = self.changed.pop().map(|l| (l, self.options.rejected_frames));
        self.candidate = None;
    }

    /// Decides on the candidate from the full fits of a frame with and without it. Of a slip or a leak, `at_rim`, touches and its shapes
    /// must explain all: they are those of its change.
    pub(crate) fn decide(&mut self, with: Option<Evidence>, without: Option<Evidence>, at_rim: bool) -> Decision {
        let full_fits = self.full_fits();
        let options = self.options;
        let decision = match (&mut self.candidate, with.zip(without)) {
            (Some(s), Some((with, without))) => {
                s.compared += 1;
                s.with = s.with + with;
                s.without = s.without + without;
                let (with, without) = (s.with.mean_of(s.compared), s.without.mean_of(s.compared));
                match s.compared >= full_fits {
                    true if at_rim && with.misfit > options.explained => Decision::Unchanged,
                    true if with.instead_of(without, &options) => Decision::Changed,
                    false if with.cost < without.cost => Decision::Open,
                    _ => Decision::Unchanged,
                }
            }
            _ => Decision::Unchanged,
        };
        match decision {
            Decision::Changed => {
                self.candidate = None;
                (self.until, self.inconclusive) = (self.retest_frames(), false);
            }
            Decision::Unchanged => self.reject(),
            Decision::Open => self.take_back(),
        }
        decision
    }

    /// Accepts the candidate without a comparison.
    pub(crate) fn accept(&mut self) {
        self.candidate = None;
        (self.until, self.inconclusive) = (self.retest_frames(), false);
    }

    /// Accepted contacts stay so without a comparison.
    pub(crate) fn stay(&mut self) {
        (self.until, self.inconclusive) = (self.retest_frames(), false);
    }

    /// Where one frame decides, every frame decides anew.
    fn retest_frames(&self) -> usize {
        if self.frames == 1 {
            1
        } else {
            self.options.retest_frames
        }
    }

    fn full_fits(&self) -> usize {
        self.frames.min(self.options.full_fits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options() -> ContactOptions {
        ContactOptions::default()
    }

    const THIRD: Cause = Cause::Contact(3);
    const BETTER: Evidence = Evidence {
        cost: 100.0,
        open: 0.0,
        misfit: 1.0,
        model: 5.0,
    };
    const WORSE: Evidence = Evidence {
        cost: 300.0,
        open: 0.0,
        misfit: 2.5,
        model: 5.0,
    };

    /// Frames until it is accepted, of at most `most`.
    fn frames(monitor: &mut ContactMonitor, most: usize, named: impl Fn(usize) -> Option<usize>) -> Option<usize> {
        (0..most).find(|k| {
            monitor.begin(false);
            monitor.propose(named(*k).map(Cause::Contact), false)
                && monitor.decide(Some(BETTER), Some(WORSE), false) == Decision::Changed
        })
    }

    #[test]
    fn it_takes_as_many_frames_as_it_was_told() {
        for n in [1, 2, 3, 4, 5, 16, 40] {
            let mut monitor = ContactMonitor::new(n, ContactOptions::default());
            assert_eq!(frames(&mut monitor, 100, |_| Some(3)), Some(n - 1));
            assert_eq!(monitor.changed(), [THIRD]);
        }
    }

    #[test]
    fn one_that_is_named_in_two_frames_of_three_or_as_often_as_others_is_none() {
        let mut monitor = ContactMonitor::new(16, ContactOptions::default());
        assert_eq!(frames(&mut monitor, 1000, |k| (k % 3 != 0).then_some(5)), None);
        assert_eq!(frames(&mut monitor, 1000, |k| Some(k / 12 % 2)), None);
        assert!(monitor.changed().is_empty());
        // In seven of eight it is.
        assert!(frames(&mut monitor, 40, |k| (k % 8 != 0).then_some(5)).is_some());
    }

    /// A third of the frames of a contact that drift describes leaves more than 1.3 variances, by noise alone.
    #[test]
    fn what_most_frames_say_of_it_counts() {
        for (part, linear) in [(1, false), (2, true), (3, true)] {
            let mut monitor = ContactMonitor::new(16, ContactOptions::default());
            for k in 0..12 {
                monitor.begin(false);
                assert!(!monitor.propose(Some(THIRD), k % 3 < part));
            }
            assert_eq!(monitor.is_linear(), linear, "{part} of three");
        }
    }

    #[test]
    fn one_that_costs_more_than_touches_is_none_before_it_is_ripe() {
        let mut monitor = ContactMonitor::new(16, ContactOptions::default());
        for (with, without, stays) in [(WORSE, BETTER, false), (BETTER, BETTER, false), (BETTER, WORSE, true)] {
            monitor.clear();
            monitor.begin(false);
            assert!(!monitor.propose(Some(THIRD), false) && monitor.propose_early(Some(THIRD)));
            assert_eq!(monitor.changed(), [THIRD]);
            monitor.doubt(Some(with), Some(without));
            assert_eq!((monitor.changed(), monitor.is_open()), (&[][..], stays));
            // It is doubted once.
            assert!(!monitor.propose_early(Some(THIRD)));
            assert_eq!(frames(&mut monitor, 20, |_| Some(3)).is_some(), stays);
        }
    }

    #[test]
    fn an_accepted_contact_is_rejected_when_two_tests_speak_against_it() {
        let mut monitor = ContactMonitor::new(2, ContactOptions::default());
        assert_eq!(frames(&mut monitor, 2, |_| Some(3)), Some(1));
        let mut ask = |with, without| {
            for wait in 1.. {
                let asks = monitor.asks_next();
                let Some(changed) = monitor.begin(false) else {
                    assert!(!asks && monitor.changed() == [THIRD]);
                    continue;
                };
                assert!(asks && changed == [THIRD] && monitor.changed().is_empty());
                monitor.keep(changed);
                return (wait, monitor.decide_again(Some(with), Some(without)));
            }
            unreachable!()
        };
        assert_eq!(ask(WORSE, BETTER), (options().retest_frames, false));
        assert_eq!(ask(BETTER, WORSE), (options().retest_soon_frames, false));
        assert_eq!(ask(WORSE, BETTER), (options().retest_frames, false));
        assert_eq!(ask(WORSE, BETTER), (options().retest_soon_frames, true));
        assert!(monitor.changed().is_empty());
    }

    #[test]
    fn a_candidate_that_the_full_fit_rejects_is_none_for_a_while() {
        let mut monitor = ContactMonitor::new(16, ContactOptions::default());
        let asked = (0..16 + options().rejected_frames + 16).filter(|_| {
            monitor.begin(false);
            let asked = monitor.propose(Some(Cause::Contact(2)), false);
            if asked {
                assert_eq!(monitor.changed(), [Cause::Contact(2)]);
                assert_eq!(monitor.decide(Some(WORSE), Some(BETTER), false), Decision::Unchanged);
            }
            assert!(monitor.changed().is_empty());
            asked
        });
        assert_eq!(asked.count(), 2);
    }
}
