//! Whether a frame is one of touches, or of touches and contacts that changed.

mod candidates;
mod drifting;

use crate::change::detector::ChangeDetector;
use crate::pipeline::frame_solver::{Averaged, FrameSolver, Task};
use crate::pipeline::options::ReconstructorOptions;
use crate::pipeline::polarity_test::PolarityTest;
use crate::pipeline::result::FrameResult;
use crate::quality::contact::{Cause, ContactMonitor, ContactOptions, Evidence};
use crate::reference::Difference;
use crate::reference::diagnosis::{Electrodes, Fault, MOST_ELECTRODES};
use crate::reference::drift::Drifting;
use crate::touches::polarity::Polarity;
use crate::touches::touch::Touch;
use arrayvec::ArrayVec;

/// Frames for which the test of new touches waits for a search that does not come to its end; then the search is patient.
const MOST_PUT_OFF: usize = 2;
/// Frames one after another that touches leave unexplained because one is coming down.
const LANDING: usize = 2;
/// What comes from one frame to the next is a touch or a fault, and nothing that drifts slowly. For so many frames what is rare is not
/// asked for then: so long it may take to tell which.
const SUDDEN: usize = 64;

/// Misfit of touches that noise leaves now and then in a single frame: five standard deviations of the mean of 118 squares.
const BY_CHANCE: f64 = 1.65;
/// Most frames until a scene at rest that touches do not explain is asked once more what drifts. Each time the wait doubles.
const MOST_WAIT: usize = 256;

/// The detectors of changes, by what drifts.
pub(crate) type Detectors = [Option<ChangeDetector>; Drifting::ALL.len()];

/// What a frame was not asked, since it had taken long enough: the next one is.
#[derive(Clone, Copy, Debug, Default)]
struct Owed {
    /// Which kind of drift comes next, and for how many frames it was put off.
    drifting: Option<(usize, usize)>,
    candidates: bool,
    /// Whether touches of the other sign are to be tried, and whether because a touch is new.
    polarity: Option<bool>,
}

impl Owed {
    fn is_something(self) -> bool {
        self.drifting.is_some() || self.candidates || self.polarity.is_some()
    }
}

/// Tests frames for contacts that drifted or changed, one frame after another.
pub(crate) struct ContactTest {
    options: ContactOptions,
    monitor: ContactMonitor,
    polarity: PolarityTest,
    sequence: bool,
    /// What drifts in the frames now; how many touches have stood the test against it; and frames until the next test.
    drifting: Drifting,
    /// The detector that has seen the frame.
    asked: usize,
    stood: usize,
    until: usize,
    /// Frames from one test to the next.
    wait: usize,
    /// Frames one after another before this one that touches left some of unexplained.
    left_before: usize,
    /// Whether a frame was explained before, by touches or by nothing; frames for which what came after it is sudden; and what drifted
    /// until then.
    explained_before: bool,
    sudden: usize,
    drifted_before: Drifting,
    /// Frames one after another in which that test was put off.
    put_off: usize,
    owed: Owed,
    /// Contacts that full fits of this frame decided on.
    decided: Vec<usize>,
    /// Leaks that were accepted, and their resistances as they were told last, ohm.
    leaks: Vec<([usize; 2], f64)>,
    /// Electrodes whose values are left out.
    left_out: Vec<usize>,
    /// Whether a mean of frames at rest leaves what drift may explain: the next frame is asked by itself.
    left_at_rest: bool,
    /// Whether the frame is like the one before, and nothing was open there but a candidate.
    rests: bool,
    /// A frame without its contacts' scales.
    evened: Option<Difference>,
    /// The result of a frame with other contacts.
    kept: FrameResult,
}

impl ContactTest {
    pub(crate) fn new(options: &ReconstructorOptions) -> Self {
        Self {
            options: options.contacts,
            monitor: ContactMonitor::new(
                if options.sequence { options.contacts.frames } else { 1 },
                options.contacts,
            ),
            polarity: PolarityTest::new(options.polarity, options.sequence),
            sequence: options.sequence,
            drifting: Drifting::Common,
            asked: 0,
            stood: 0,
            until: 0,
            wait: options.contacts.retest_frames,
            left_before: 0,
            explained_before: false,
            sudden: 0,
            drifted_before: Drifting::Common,
            put_off: 0,
            owed: Owed::default(),
            decided: Vec::new(),
            leaks: Vec::new(),
            left_out: Vec::new(),
            left_at_rest: false,
            rests: false,
            evened: None,
            kept: FrameResult::default(),
        }
    }

    /// Electrodes whose contact is accepted to have changed.
    pub(crate) fn changed(&self) -> impl Iterator<Item = usize> + '_ {
        self.monitor.changed().iter().filter_map(|cause| cause.contact())
    }

    /// What is accepted to have changed at the rim, the contacts together.
    pub(crate) fn faults(&self) -> impl Iterator<Item = Fault> + '_ {
        let contacts: ArrayVec<usize, MOST_ELECTRODES> = self.changed().take(MOST_ELECTRODES).collect();
        let contacts = (!contacts.is_empty()).then(|| Fault::Contacts(Electrodes::of(&contacts)));
        let leaks = self.leaks.iter().filter(|(pair, _)| self.is_known(*pair));
        let leaks = leaks.map(|(pair, ohm)| Fault::Leak {
            electrodes: *pair,
            ohm: *ohm,
        });
        contacts.into_iter().chain(leaks)
    }

    fn is_known(&self, leak: [usize; 2]) -> bool {
        self.monitor.changed().contains(&Cause::Leak(leak))
    }

    /// What is accepted to have changed.
    pub(crate) fn causes(&self) -> &[Cause] {
        self.monitor.changed()
    }

    /// Contacts that full fits of this frame decided on.
    pub(crate) fn decided(&self) -> &[usize] {
        &self.decided
    }

    /// Takes electrodes whose values are left out: nothing more is to be known of their contacts.
    pub(crate) fn leave_out(&mut self, electrodes: &[usize]) {
        if self.left_out == electrodes {
            return;
        }
        self.left_out.clear();
        self.left_out.extend_from_slice(electrodes);
        let mut changed = self.monitor.changed().to_vec();
        changed.retain(|cause| !cause.is_of(electrodes));
        self.monitor.keep(changed);
    }

    /// What frames taught of the signs of touches.
    pub(crate) fn learned_polarity(&self) -> Option<Polarity> {
        self.polarity.learned()
    }

    /// That frames before these taught it.
    pub(crate) fn learn_polarity(&mut self, polarity: Option<Polarity>) {
        self.polarity.know(polarity);
    }

    /// A fault was named: what it looked like was no touch.
    pub(crate) fn unlearn_signs(&mut self) {
        self.polarity.unlearn();
    }

    /// A task with the signs of touches that are believed now.
    pub(crate) fn signed<'a>(&self, task: Task<'a>) -> Task<'a> {
        Task {
            polarity: self.polarity.now(),
            ..task
        }
    }

    /// Which detector tells whether the next frame is a change.
    pub(crate) fn detector(&self) -> usize {
        self.drifting.index()
    }

    /// What is asked of a frame that shows no touch whether it drifted.
    pub(crate) fn may_drift(&self) -> Drifting {
        match self.drifting {
            Drifting::Nothing | Drifting::Common => Drifting::Contacts,
            other => other,
        }
    }

    /// Whether something rare drifts, and the touches beside it leave some of a frame unexplained.
    pub(crate) fn leaves_beside_rare(&self, result: &FrameResult) -> bool {
        is_rare(self.drifting) && self.leaves(result)
    }

    /// Whether what the frames show came from one to the next, not long ago.
    pub(crate) fn is_sudden(&self) -> bool {
        self.sudden > 0
    }

    /// Whether an electrode is a candidate, or something is still to be asked: then every frame counts.
    pub(crate) fn is_open(&self) -> bool {
        self.monitor.is_open() || self.left_at_rest || self.owed.is_something()
    }

    /// Whether nothing is open but a candidate that is compared in the first frame that is like the one before.
    pub(crate) fn waits_for_rest(&self) -> bool {
        self.monitor.asks_early() && !self.rests && !self.left_at_rest && !self.owed.is_something()
    }

    /// Takes note whether the next frame is like the one before.
    pub(crate) fn note_rest(&mut self, rests: bool) {
        self.rests = rests;
    }

    /// Forgets all that earlier frames said, but that there was one: it shows nothing.
    pub(crate) fn clear(&mut self) {
        self.monitor.clear();
        self.polarity.clear();
        (self.drifting, self.stood, self.until) = (Drifting::Common, 0, 0);
        (self.left_before, self.explained_before, self.sudden) = (0, true, 0);
        self.left_at_rest = false;
        self.wait = self.options.retest_frames;
        self.owed = Owed::default();
    }

    /// Forgets all that earlier frames said, and what was put off in them: the next one stands alone.
    pub(crate) fn stand_alone(&mut self) {
        self.clear();
        (self.asked, self.put_off, self.rests) = (0, 0, false);
        self.leaks.clear();
        self.drifted_before = Drifting::Common;
        self.decided.clear();
        self.left_out.clear();
    }

    /// Solves a frame into the result, with the contacts that changed left out. What drifts and the contacts of the task are
    /// not looked at, nor its polarity. Returns the change where something lay on the sheet in its baseline that has gone.
    pub(crate) fn solve(
        &mut self,
        solver: &mut FrameSolver,
        task: Task,
        detectors: &mut Detectors,
        result: &mut FrameResult,
    ) -> Option<Touch> {
        self.asked = self.detector();
        self.decided.clear();
        self.judge(solver, task, detectors, result);
        let gone = self.polarity.learn(result);
        self.without_contacts(solver, task, |solver, task| solver.finish(task, result));
        if self.detector() != self.asked
            && let Some(detector) = &mut detectors[self.detector()]
        {
            // It knows nothing of the frames that the other has seen.
            detector.forget();
        }
        gone
    }

    /// Makes ready what a frame is solved with first. Whether that took all of its time.
    pub(crate) fn prepare(&self, solver: &mut FrameSolver, difference: &Difference, quiet: bool) -> bool {
        let first = match (self.monitor.tests_again(quiet), quiet) {
            (true, _) => (Drifting::Contacts, &[][..]),
            (false, true) => (self.may_drift(), self.monitor.changed()),
            (false, false) => (self.drifting, self.monitor.changed()),
        };
        solver.prepare(difference, first)
    }

    /// Makes the picture of the frame that was solved last.
    pub(crate) fn picture(&mut self, solver: &mut FrameSolver, task: Task, result: &mut FrameResult) {
        self.without_contacts(solver, task, |solver, task| solver.picture(task, result));
    }

    fn judge(&mut self, solver: &mut FrameSolver, task: Task, detectors: &mut Detectors, result: &mut FrameResult) {
        if task.averaged.frames > 1 {
            // Contacts are tested on single frames only: the error of the disc model shows more in a mean.
            let task = Task { patient: false, ..task };
            self.solve_with(solver, task, detectors, result);
            let Averaged { frames, grown, .. } = task.averaged;
            let new = if grown { frames / 2 } else { frames };
            self.until = self.until.saturating_sub(new);
            // In variances of one frame's noise, as the test of a frame has it.
            let misfit = result.misfit.map(|misfit| 1.0 + (misfit - 1.0) / task.averaged.gain);
            // A frame like many before is not sudden any more.
            self.sudden = self.sudden.saturating_sub(task.averaged.frames);
            let left = misfit.is_none_or(|m| m > self.options.explained);
            if !left {
                self.polarity.note_explained();
            }
            self.left_at_rest = self.until == 0 && left;
            if self.left_at_rest {
                self.wait = (2 * self.wait).min(MOST_WAIT);
            }
            return;
        }
        if !self.is_open() {
            self.wait = self.options.retest_frames;
        }
        self.left_at_rest = false;
        if !self.sequence {
            self.clear();
        }
        let task = solver.begin(task);
        let before = self.drifting;
        if task.quiet {
            self.drifting = self.may_drift();
        }
        // What a frame has of a touch while it comes down differs from value to value, which is like anything smooth.
        let lands = self.sequence && self.left_before < LANDING;
        // The decision for or against a contact compares what both come to in the end, or as far as a frame may go.
        let patient = !self.sequence || self.monitor.asks_next() || self.put_off >= MOST_PUT_OFF;
        let task = Task { patient, ..task };
        if let Some(changed) = self.monitor.begin(task.quiet) {
            self.test_again(changed, solver, task, detectors, result);
        } else {
            let mut evidence = self.solve_with(solver, task, detectors, result);
            let owed = std::mem::take(&mut self.owed);
            let new = result.touches.len() > self.stood || owed.polarity == Some(true);
            // What was put off comes first, whatever the frame has taken; the cheapest of it before the others.
            let may = !solver.keeps_free();
            let (polarity, candidates) = (may && owed.polarity.is_some(), may && owed.candidates);
            if polarity || candidates {
                self.owed.drifting = owed.drifting;
            } else if !task.quiet {
                let from = owed.drifting.map(|(next, waited)| (next, waited, may));
                evidence = self.test_drifting((evidence, lands, from), solver, task, detectors, result);
            }
            if polarity || (solver.is_spent() && !candidates) {
                self.owed.candidates = owed.candidates || self.monitor.asks_next();
                if !self.owed.candidates && self.may_ask(solver) {
                    // What a frame names costs nothing.
                    let candidate = self.candidate(solver, result);
                    self.monitor
                        .note(candidate.map(|c| c.cause), candidate.is_some_and(|c| c.linear));
                }
            } else {
                evidence = self.test_candidates(evidence, solver, task, detectors, result);
            }
            if !task.quiet {
                self.test_polarity((evidence, new, lands, polarity), solver, task, detectors, result);
            }
        }
        if task.quiet {
            // Without touches the frame itself says it.
            if !result.drift.by_own {
                self.drifting = Drifting::Common;
            }
            self.stood = 0;
        }
        let left = result.changed && self.leaves(result);
        let far = left && !result.misfit.is_some_and(|m| solver.explains(m, task.averaged.gain));
        if self.sudden == 0 && far && self.explained_before && self.left_before < LANDING {
            // A contact is asked for as soon as no touch comes down any more.
            (self.sudden, self.until) = (SUDDEN, self.until.min(LANDING));
            self.drifted_before = before;
        } else if !left && self.drifting.index() <= self.drifted_before.index() {
            self.sudden = 0;
        }
        self.sudden = self.sudden.saturating_sub(1);
        if !left {
            self.polarity.note_explained();
        }
        self.explained_before |= !left;
        self.left_before = if left { self.left_before + 1 } else { 0 };
    }

    /// Decides whether some touches change the resistivity the other way. While a touch `lands`, only of frames that no touches
    /// explain.
    fn test_polarity(
        &mut self,
        (evidence, new, lands, late): (Option<Evidence>, bool, bool, bool),
        solver: &mut FrameSolver,
        task: Task,
        detectors: &mut Detectors,
        result: &mut FrameResult,
    ) {
        let explains = |misfit| {
            if lands {
                solver.explains(misfit, task.averaged.gain)
            } else {
                misfit <= self.options.explained
            }
        };
        let unexplained = result.touches.is_empty() || !result.misfit.is_some_and(explains);
        let may = solver.fits() && result.changed;
        // Whether contacts drifted or changed is decided first, but for what this frame has no time for. A leak is held against touches of
        // the other sign.
        let decided = self.put_off == 0 && (!self.monitor.asks_contact() || self.waits_for_rest());
        if !(may && (new || unexplained)) {
            return;
        }
        self.polarity.pass();
        if !decided {
            return;
        }
        if !self.polarity.asks(new, unexplained) {
            return;
        }
        if solver.is_spent() && !late {
            self.owed.polarity = Some(new);
            return;
        }
        let before = self.polarity.now();
        self.kept.copy_from(result);
        self.polarity.widen();
        solver.begin_other(self.drifting);
        let other = self.solve_with(solver, task, detectors, result);
        // A fall beside a rise, as where a finger that lay on the sheet slides off, is much like a ring of rises.
        let fewer = result.touches.len() < self.kept.touches.len();
        let better = evidence.zip(other).is_some_and(|(evidence, other)| {
            other.cheaper_than(evidence, self.options.margin_accepted)
                || (fewer && other.more_probable_than(evidence, self.options.margin_accepted))
        });
        // The other search may not have come to its end yet; this one has.
        let explained = solver.is_finished() && result.misfit.is_some();

        if better && explained && result.touches.iter().any(|t| !before.allows(t.rise)) {
            return;
        }
        self.polarity.narrow(
            before,
            better && explained && !lands && has_pair(solver.fitted_touches()),
        );
        result.copy_from(&self.kept);
        solver.end_other();
    }

    /// Whether touches of both signs would explain a frame that is not explained by those of one, in places that it does not tell.
    pub(crate) fn hides_both_signs(&self, result: &FrameResult) -> bool {
        result.changed && self.polarity.is_unplaced()
    }

    /// Whether touches leave some of a frame unexplained.
    pub(crate) fn leaves(&self, result: &FrameResult) -> bool {
        result.misfit.is_none_or(|misfit| misfit > self.options.explained)
    }

    /// Whether touches beside what changed at the rim leave some of a frame unexplained, by more than one frame may have it by chance.
    pub(crate) fn leaves_beside_changed(&self, result: &FrameResult, averaged: Averaged) -> bool {
        let single = self.sequence && averaged.frames == 1 && self.left_before < 2;
        let by_chance = single && result.misfit.is_some_and(|misfit| misfit <= BY_CHANCE);
        self.leaves(result) && !by_chance
    }

    /// Solves a frame without what drifted, and what the contacts did that changed.
    fn solve_with(
        &mut self,
        solver: &mut FrameSolver,
        task: Task,
        detectors: &mut Detectors,
        result: &mut FrameResult,
    ) -> Option<Evidence> {
        // A frame at rest by itself is followed by the mean.
        let (index, seen) = (self.detector(), self.detector() == self.asked && !self.rests);
        let detector = detectors[index].as_mut();
        self.without_contacts(solver, Task { seen, ..task }, |solver, task| {
            solver.solve(task, detector, result);
            solver.evidence(task, result)
        })
    }

    /// Does something with a frame without what drifted, and without what the contacts did that changed.
    fn without_contacts<R>(
        &mut self,
        solver: &mut FrameSolver,
        task: Task,
        act: impl FnOnce(&mut FrameSolver, Task) -> R,
    ) -> R {
        let (changed, drifting) = (self.monitor.changed(), self.drifting);
        let task = Task {
            drifting,
            changed,
            polarity: self.polarity.now(),
            ..task
        };
        if changed.is_empty() {
            return act(solver, task);
        }
        let difference = match &mut self.evened {
            Some(evened) => {
                evened.clone_from(task.difference);
                evened
            }
            none => none.insert(task.difference.clone()),
        };
        solver.even_out(changed, difference);
        act(solver, Task { difference, ..task })
    }
}

/// Whether the strongest touch has one of the other sign beside it that is half as strong.
fn has_pair(touches: &[Touch]) -> bool {
    let strongest = |sign: f64| touches.iter().map(|t| sign * t.total_mm2).fold(0.0, f64::max);
    let (rise, fall) = (strongest(1.0), strongest(-1.0));
    rise.min(fall) >= 0.5 * rise.max(fall) && rise > 0.0
}

/// Whether it drifts less often than contacts do.
pub(crate) fn is_rare(drifting: Drifting) -> bool {
    !matches!(drifting, Drifting::Nothing | Drifting::Common | Drifting::Contacts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::imager::Imager;
    use crate::solvers::Method;
    use forward::{Drive, Pattern, Sheet};

    /// Noise leaves so much in one frame now and then, but not in two, and not in a row of a table that nobody sees again.
    #[test]
    fn one_frame_of_noise_beside_a_known_change_is_no_doubt() {
        let pattern = Pattern::adjacent(16).unwrap();
        let imager = Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 10.0).unwrap();
        for (sequence, before, misfit, leaves) in [
            (true, 1, Some(1.2), false),
            (true, 1, Some(1.5), false),
            (true, 2, Some(1.5), true),
            (true, 1, Some(1.7), true),
            (true, 1, None, true),
            (false, 1, Some(1.5), true),
        ] {
            let options = ReconstructorOptions {
                sequence,
                ..ReconstructorOptions::for_imager(&imager, Method::Nnls)
            };
            let mut test = ContactTest::new(&options);
            test.left_before = before;
            let result = FrameResult {
                changed: true,
                misfit,
                ..FrameResult::default()
            };
            let found = test.leaves_beside_changed(&result, Averaged::ONE);
            assert_eq!(found, leaves, "{sequence} {before} {misfit:?}");
        }
    }
}
