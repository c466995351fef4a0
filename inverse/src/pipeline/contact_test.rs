//! Whether a frame is one of touches, or of touches and contacts that changed.

use crate::change::detector::ChangeDetector;
use crate::pipeline::frame_solver::{FrameSolver, Task};
use crate::pipeline::options::ReconstructorOptions;
use crate::pipeline::result::FrameResult;
use crate::quality::contact::{ContactMonitor, Decision, Evidence};
use crate::reference::Difference;

/// Tests frames for contacts that changed, one frame after another.
pub(crate) struct ContactTest {
    monitor: ContactMonitor,
    sequence: bool,
    most_contacts: usize,
    /// A frame without its contacts' scales.
    evened: Option<Difference>,
}

impl ContactTest {
    pub(crate) fn new(options: &ReconstructorOptions) -> Self {
        Self {
            monitor: ContactMonitor::new(
                if options.sequence { options.contacts.frames } else { 1 },
                options.contacts,
            ),
            sequence: options.sequence,
            most_contacts: options.contacts.most_contacts,
            evened: None,
        }
    }

    /// Electrodes whose contact is accepted to have changed.
    pub(crate) fn changed(&self) -> &[usize] {
        self.monitor.changed()
    }

    /// Whether an electrode is a candidate: then every frame counts.
    pub(crate) fn is_open(&self) -> bool {
        self.monitor.is_open()
    }

    /// Forgets all that earlier frames said.
    pub(crate) fn clear(&mut self) {
        self.monitor.clear();
    }

    /// Solves a frame into the result, with the contacts that changed left out. The contacts of the task are not looked at.
    pub(crate) fn solve(
        &mut self,
        solver: &mut FrameSolver,
        task: Task,
        mut detector: Option<&mut ChangeDetector>,
        result: &mut FrameResult,
    ) {
        if task.averaged.frames > 1 {
            // Contacts are tested on single frames only: the error of the disc model shows more in a mean.
            let task = Task { patient: false, ..task };
            self.solve_with(solver, task, detector, result);
            return;
        }
        // The decision for or against a contact compares what both come to in the end.
        let patient = !self.sequence || self.monitor.asks_next();
        let task = Task { patient, ..task };
        if let Some(changed) = self.monitor.begin() {
            let without = self.solve_with(solver, task, detector.as_deref_mut(), result);
            let kept = result.clone();
            self.monitor.keep(changed);
            let with = self.solve_with(solver, task, detector, result);
            if self.monitor.decide_again(with, without) {
                *result = kept;
                solver.forget_touches();
            }
            return;
        }
        let mut without = self.solve_with(solver, task, detector.as_deref_mut(), result);
        while self.monitor.changed().len() < self.most_contacts {
            let changed = self.monitor.changed();
            let candidate = solver.candidate(Task { changed, ..task }, result);
            if !self.monitor.propose(candidate) {
                break;
            }
            let kept = result.clone();
            let with = self.solve_with(solver, task, detector.as_deref_mut(), result);
            if self.monitor.decide(with, without) != Decision::Changed {
                tracing::debug!(candidate, ?with, ?without, "no contact yet");
                *result = kept;
                solver.forget_touches();
                break;
            }
            tracing::debug!(candidate, ?with, ?without, "a contact");
            without = with;
        }
    }

    /// Solves a frame without what the contacts did that changed.
    fn solve_with(
        &mut self,
        solver: &mut FrameSolver,
        task: Task,
        detector: Option<&mut ChangeDetector>,
        result: &mut FrameResult,
    ) -> Option<Evidence> {
        let changed = self.monitor.changed();
        let task = Task { changed, ..task };
        if changed.is_empty() {
            solver.solve(task, detector, result);
        } else {
            let difference = match &mut self.evened {
                Some(evened) => {
                    evened.clone_from(task.difference);
                    evened
                }
                none => none.insert(task.difference.clone()),
            };
            solver.even_out(changed, difference);
            solver.solve(Task { difference, ..task }, detector, result);
        }
        solver.evidence(task, result)
    }
}
