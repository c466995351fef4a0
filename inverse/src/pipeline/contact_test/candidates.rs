//! Contacts and leaks that a frame names, and those that were accepted.

use super::{ContactTest, Detectors};
use crate::pipeline::frame_solver::{Candidate, FrameSolver, Task};
use crate::pipeline::result::FrameResult;
use crate::quality::contact::{Cause, Decision, Evidence};
use crate::reference::drift::Drifting;

impl ContactTest {
    /// Tests what was accepted once more.
    pub(super) fn test_again(
        &mut self,
        changed: Vec<Cause>,
        solver: &mut FrameSolver,
        task: Task,
        detectors: &mut Detectors,
        result: &mut FrameResult,
    ) {
        let before = std::mem::replace(&mut self.drifting, Drifting::Contacts);
        let without = self.solve_with(solver, task, detectors, result);
        let named = solver.candidate((&[], None, &[]), self.drifting, result);
        if named.is_some_and(|c| c.linear && changed.contains(&c.cause)) {
            self.monitor.keep(changed);
            self.drifting = before;
            self.solve_with(solver, task, detectors, result);
            self.monitor.stay();
            self.note_leaks(solver, result);
            return;
        }
        if task.quiet {
            self.monitor.clear();
            return;
        }
        let kept = result.clone();
        self.monitor.keep(changed);
        let with = self.solve_with(solver, task, detectors, result);
        if self.monitor.decide_again(with, without) {
            *result = kept;
            solver.forget_touches();
        } else {
            self.note_leaks(solver, result);
        }
    }

    /// Takes note of the resistances that a frame tells of the leaks that are known. One that conducts nothing has gone.
    fn note_leaks(&mut self, solver: &FrameSolver, result: &FrameResult) {
        let mut changed = self.monitor.changed().to_vec();
        for (pair, _) in &result.drift.leaks {
            let ohm = solver.leak_ohm(*pair, result);
            self.leaks.retain(|(known, _)| known != pair);
            self.leaks.extend(ohm.map(|ohm| (*pair, ohm)));
            if ohm.is_none() {
                changed.retain(|cause| *cause != Cause::Leak(*pair));
            }
        }
        self.monitor.keep(changed);
    }

    /// Whether contacts are looked for.
    pub(super) fn may_ask(&self, solver: &FrameSolver) -> bool {
        solver.imager().is_searched() && self.monitor.changed().len() < self.options.most_contacts
    }

    /// A contact or a leak that the frame names, of those of which nothing is known.
    pub(super) fn candidate(&self, solver: &FrameSolver, result: &FrameResult) -> Option<Candidate> {
        let (known, rejected) = (self.monitor.changed(), self.monitor.rejected());
        solver.candidate((known, rejected, &self.left_out), self.drifting, result)
    }

    /// Tests contacts and leaks that the frame names.
    pub(super) fn test_candidates(
        &mut self,
        mut without: Option<Evidence>,
        solver: &mut FrameSolver,
        task: Task,
        detectors: &mut Detectors,
        result: &mut FrameResult,
    ) -> Option<Evidence> {
        while self.may_ask(solver) {
            let candidate = self.candidate(solver, result);
            if candidate.is_none() && self.waits_for_rest() && !self.leaves(result) {
                // Contacts were not asked for.
                break;
            }
            let linear = candidate.is_some_and(|c| c.linear);
            if !self.monitor.propose(candidate.map(|c| c.cause), linear) {
                if self.rests {
                    self.doubt_candidate((candidate, without), solver, task, detectors, result);
                }
                break;
            }
            if self.monitor.is_linear() && !linear {
                // Noise alone is what this frame leaves: the next one that touches explain tells.
                self.monitor.take_back();
                break;
            }
            if linear {
                tracing::debug!(?candidate, "a contact stands out");
                self.monitor.accept();
                without = self.solve_with(solver, task, detectors, result);
                continue;
            }
            let kept = result.clone();
            let with = self.solve_with(solver, task, detectors, result);
            // What conducts nothing is no leak.
            let may_be = |cause: Cause| match cause {
                Cause::Leak(pair) => solver.leak_ohm(pair, result).is_some(),
                Cause::Contact(_) => true,
            };
            let with = with.filter(|_| candidate.is_some_and(|c| may_be(c.cause)));
            let at_rim = candidate.is_some_and(|c| c.at_rim);
            if self.monitor.decide(with, without, at_rim) != Decision::Changed {
                tracing::debug!(?candidate, ?with, ?without, "nothing at the rim yet");
                *result = kept;
                solver.forget_touches();
                break;
            }
            tracing::debug!(?candidate, ?with, ?without, "a change at the rim");
            let contact = candidate.filter(|c| !c.at_rim).and_then(|c| c.cause.contact());
            self.decided.extend(contact);
            self.note_leaks(solver, result);
            self.polarity.unlearn();
            without = with;
        }
        without
    }

    /// A contact that would explain alone what touches explain is compared with them in the first frame at rest, so that a touch which
    /// looks like one is averaged.
    fn doubt_candidate(
        &mut self,
        (candidate, without): (Option<Candidate>, Option<Evidence>),
        solver: &mut FrameSolver,
        task: Task,
        detectors: &mut Detectors,
        result: &mut FrameResult,
    ) {
        solver.fit_beside(self.drifting);
        let explained = !result.touches.is_empty() && !self.leaves(result) && solver.is_settled();
        let cause = candidate.filter(|c| !c.linear).map(|c| c.cause);
        if !explained || solver.is_spent() || !self.monitor.propose_early(cause) {
            return;
        }
        self.kept.copy_from(result);
        solver.begin_other(self.drifting);
        let with = self.solve_with(solver, Task { patient: true, ..task }, detectors, result);
        // Where nothing is left, nothing was fitted.
        if !result.changed || solver.is_settled() {
            self.monitor.doubt(with, without);
        } else {
            self.monitor.take_back();
        }
        result.copy_from(&self.kept);
        solver.end_other();
    }
}
