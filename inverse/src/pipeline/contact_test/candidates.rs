//! Contacts that a frame names, and those that were accepted.

use super::{ContactTest, Detectors};
use crate::pipeline::frame_solver::{Candidate, FrameSolver, Task};
use crate::pipeline::result::FrameResult;
use crate::quality::contact::{Decision, Evidence};
use crate::reference::drift::Drifting;

impl ContactTest {
    /// Tests the accepted contacts once more.
    pub(super) fn test_again(
        &mut self,
        changed: Vec<usize>,
        solver: &mut FrameSolver,
        task: Task,
        detectors: &mut Detectors,
        result: &mut FrameResult,
    ) {
        let before = std::mem::replace(&mut self.drifting, Drifting::Contacts);
        let without = self.solve_with(solver, task, detectors, result);
        let named = solver.candidate(&[], self.drifting, result);
        if named.is_some_and(|c| c.linear && changed.contains(&c.electrode)) {
            self.monitor.keep(changed);
            self.drifting = before;
            self.solve_with(solver, task, detectors, result);
            self.monitor.stay();
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
        }
    }

    /// Whether contacts are looked for.
    pub(super) fn may_ask(&self, solver: &FrameSolver) -> bool {
        solver.imager().is_searched() && self.monitor.changed().len() < self.options.most_contacts
    }

    /// A contact that the frame names, of those of which nothing is known.
    pub(super) fn candidate(&self, solver: &FrameSolver, result: &FrameResult) -> Option<Candidate> {
        let known = [self.monitor.changed(), &self.left_out].concat();
        solver.candidate(&known, self.drifting, result)
    }

    /// Tests contacts that the frame names.
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
            if !self.monitor.propose(candidate.map(|c| c.electrode), linear) {
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
            let slips = candidate.is_some_and(|c| c.slips);
            if self.monitor.decide(with, without, slips) != Decision::Changed {
                tracing::debug!(?candidate, ?with, ?without, "no contact yet");
                *result = kept;
                solver.forget_touches();
                break;
            }
            tracing::debug!(?candidate, ?with, ?without, "a contact");
            self.decided.extend(candidate.filter(|c| !c.slips).map(|c| c.electrode));
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
        let electrode = candidate.filter(|c| !c.linear).map(|c| c.electrode);
        if !explained || solver.is_spent() || !self.monitor.propose_early(electrode) {
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
