//! What drifts in the frames of a test.

use super::{ContactTest, Detectors, MOST_PUT_OFF, is_rare};
use crate::pipeline::frame_solver::{FrameSolver, Task};
use crate::pipeline::result::FrameResult;
use crate::quality::contact::Evidence;
use crate::reference::drift::{Drifting, MOST_OFFSET, MOST_UNEVEN};
use crate::touches::polarity::Polarity;

impl ContactTest {
    /// Decides what drifts: a new touch must explain the frame better than that. What is rare is not asked for while a touch `lands`, nor
    /// while what touches leave came at once (`SUDDEN`). It is asked for in the next such frame after.
    pub(super) fn test_drifting(
        &mut self,
        (evidence, lands, from): (Option<Evidence>, bool, Option<(usize, usize, bool)>),
        solver: &mut FrameSolver,
        task: Task,
        detectors: &mut Detectors,
        result: &mut FrameResult,
    ) -> Option<Evidence> {
        self.until = self.until.saturating_sub(1);
        let touches = result.touches.len();
        // A frame that changed without a touch is asked as well: a contact may be what changed it.
        let due = self.until == 0 && (self.leaves(result) || touches == 0 || self.drifting != Drifting::Common);
        // Beside touches that explain it a candidate waits until they rest.
        let open = self.monitor.is_open() && (self.leaves(result) || !self.waits_for_rest());
        let asked = touches > self.stood || due || from.is_some() || open;
        if !(solver.fits() && result.changed && asked) {
            self.stood = self.stood.min(touches);
            return evidence;
        }
        if !solver.is_finished() && self.put_off < MOST_PUT_OFF {
            // What drifts would take the place of touches that are not found yet.
            self.put_off += 1;
            return evidence;
        }
        self.put_off = 0;
        self.until = self.wait;
        let (before, mut best) = (self.drifting, evidence);
        let (next, mut waited, mut late) = from.unwrap_or_default();
        let others = Drifting::ALL.into_iter().filter(|d| *d != before && d.index() >= next);
        for other in others {
            // What hides touches more than contacts do is asked for only where something is left to explain, and where that takes no
            // seconds.
            if is_rare(other) && !(solver.imager().is_searched() && self.leaves(result)) {
                continue;
            }
            if is_rare(other) && (lands || self.sudden > 0) {
                self.until = if lands { 1 } else { self.until.min(self.sudden) };
                continue;
            }
            // A problem is made in one frame, its tables in the same or the next, and it is solved in the one after.
            let own = Task {
                drifting: self.drifting,
                changed: self.monitor.changed(),
                ..task
            };
            let (late, waited) = (std::mem::take(&mut late), std::mem::take(&mut waited));
            if (!late && solver.is_spent()) || (waited < MOST_PUT_OFF && solver.make_ready(own, other)) {
                self.owed.drifting = Some((other.index(), waited + 1));
                return best;
            }
            best = self.compare_with(other, best, solver, task, detectors, result);
        }
        if self.drifting != before {
            tracing::debug!(now = ?self.drifting, ?evidence, ?best, "what drifts");
        }
        self.stood = result.touches.len();
        best
    }

    /// Solves a frame with something else that drifts, and keeps what explains it better. What drifts less often needs more.
    fn compare_with(
        &mut self,
        other: Drifting,
        evidence: Option<Evidence>,
        solver: &mut FrameSolver,
        task: Task,
        detectors: &mut Detectors,
        result: &mut FrameResult,
    ) -> Option<Evidence> {
        let unexplained = self.leaves(result);
        self.kept.copy_from(result);
        let before = std::mem::replace(&mut self.drifting, other);
        // Where more drifts, the next frame takes the error of the linear model off.
        let quick = Task {
            corrected: task.patient,
            ..task
        };
        let found = self.solve_with(solver, quick, detectors, result);
        // An unevenness hides many touches, and many touches look like one: they pay for what they leave open.
        let better = if is_rare(other) || is_rare(before) {
            Evidence::more_probable_than
        } else {
            Evidence::cheaper_than
        };
        // What is rare is taken only where with it touches explain the frame, or nothing changed. The error of the model of touches,
        // and what is no touch at all, look like anything smooth.
        let explains = |drifting, result: &FrameResult, with: Evidence, without| {
            let is_explained = result.misfit.is_some() || !result.changed;
            let may_be = result.drift.uneven <= MOST_UNEVEN && result.drift.offset.abs() <= MOST_OFFSET;
            !is_rare(drifting) || (is_explained && may_be && with.explains_of(without, &self.options))
        };
        let takes = evidence.zip(found).is_some_and(|(evidence, found)| {
            // What is at the rim is no drift, and much like one.
            let (evidence, found) = (solver.with_rim(evidence, before), solver.with_rim(found, other));
            if other.index() < before.index() {
                return !(explains(before, &self.kept, evidence, found)
                    && better(evidence, found, self.options.margin));
            }
            if !explains(other, result, found, evidence) {
                return false;
            }
            // What drift alone explains, and no touches do, is drift.
            let alone = !result.changed && found.misfit <= self.options.explained && unexplained;
            alone || better(found, evidence, self.options.margin_accepted)
        });
        match (before, other, evidence.zip(found)) {
            (Drifting::Contacts, _, Some((evidence, found))) if takes => solver.forget_alone(other, found, evidence),
            (_, Drifting::Contacts, Some((evidence, found))) if !takes => solver.forget_alone(before, evidence, found),
            _ => {}
        }
        if takes && is_rare(other) && !is_rare(before) {
            return self.with_both_signs(before, found, solver, task, detectors, result);
        }
        if takes {
            return found;
        }
        self.drifting = before;
        result.copy_from(&self.kept);
        evidence
    }

    /// What lay on the sheet in its baseline and is lifted while others press looks like an unevenness that came at once. Where a touch of the
    /// other sign explains the frame beside what drifted `before`, no less probably than what is rare now, it is that.
    fn with_both_signs(
        &mut self,
        before: Drifting,
        evidence: Option<Evidence>,
        solver: &mut FrameSolver,
        task: Task,
        detectors: &mut Detectors,
        result: &mut FrameResult,
    ) -> Option<Evidence> {
        let sign = self.polarity.now();
        if !self.sequence || sign == Polarity::Either {
            return evidence;
        }
        self.kept.copy_from(result);
        let rare = std::mem::replace(&mut self.drifting, before);
        let unplaced = self.polarity.is_unplaced();
        self.polarity.widen();
        solver.begin_other(before);
        let other = self.solve_with(solver, task, detectors, result);
        let found = solver.is_finished() && result.misfit.is_some();
        let lifted = found && result.touches.iter().any(|t| !sign.allows(t.rise));
        let probable = (evidence.zip(other))
            .is_some_and(|(evidence, other)| !evidence.more_probable_than(other, self.options.margin_accepted));
        tracing::debug!(?rare, ?evidence, ?other, lifted, probable, "both signs in its place");
        if lifted && probable {
            return other;
        }
        self.polarity.narrow(sign, unplaced);
        result.copy_from(&self.kept);
        solver.end_other();
        self.drifting = rare;
        evidence
    }
}
