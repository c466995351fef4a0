//! Frames that no discs explain: the touches that explain most of them.

use super::{FrameSolver, Task, is_placed};
use crate::linalg::vector::square;
use crate::pipeline::result::FrameResult;
use crate::reference::drift::Drifting;
use crate::touches::fit::matched_filter::Remainder;
use crate::touches::polarity::Polarity;

/// Values for each electrode whose errors are independent, where discs do not explain a frame: the errors of real skins lie in few
/// directions.
const INDEPENDENT: f64 = 2.0;

/// Logarithms of how probable a frame is with errors of unknown size.
#[derive(Clone, Copy)]
struct Evidence {
    drifting: Drifting,
    /// Nothing but drift.
    alone: f64,
    /// A touch somewhere as well.
    touched: f64,
}

impl FrameSolver {
    /// The polarity that was said. Of what discs do not explain, nothing else tells that it is a touch.
    pub(super) fn said(&self) -> Polarity {
        self.options.polarity.unwrap_or(Polarity::Either)
    }

    /// Whether a touch stands out of a frame that is like noise, of which nothing but the frame itself tells the size.
    pub(super) fn stands_out(&mut self, task: Task) -> bool {
        let used = task.difference.used.iter().filter(|used| **used).count();
        // What contacts do is like touches at the rim.
        let of = self.evidence_by_drift(
            task,
            &[Drifting::Nothing, Drifting::Common, Drifting::Contacts],
            used as f64,
        );
        let touched = of.iter().map(|e| e.touched).fold(f64::NEG_INFINITY, f64::max);
        let alone = of.iter().map(|e| e.alone).fold(f64::NEG_INFINITY, f64::max);
        let stands_out = touched.is_finite() && touched - alone > -self.options.false_alarm.ln();
        // Contacts that drift by no more than is usual are more probable than any that do.
        let common = of
            .iter()
            .find(|e| e.drifting == Drifting::Common)
            .filter(|_| stands_out);
        let usual = common.map(|e| e.alone + self.contacts_alone(task));
        stands_out && usual.is_none_or(|usual| touched > usual)
    }

    /// How much more probable a frame without touches is with contacts that drift than without, as a logarithm.
    fn contacts_alone(&mut self, task: Task) -> f64 {
        self.look(task, Drifting::Contacts);
        self.drift_beside(task).map_or(0.0, |drift| drift.evidence)
    }

    /// The touches that explain most of a frame that no discs explain, nor a picture.
    pub(super) fn explain_most(&mut self, task: Task, result: &mut FrameResult) {
        let Some(fit) = self.options.fit else { return };
        let independent = INDEPENDENT * self.imager.model.electrodes() as f64;
        let of = self.evidence_by_drift(task, &[Drifting::Nothing, task.drifting], independent);
        result.touches.clear();
        let Some(most) = of.iter().max_by(|a, b| a.touched.total_cmp(&b.touched)) else {
            return;
        };
        self.look(task, most.drifting);
        let said = self.said();
        let Some(tables) = self.weightings.current().and_then(|w| w.tables.as_ref()) else {
            return;
        };
        // What the picture leaves, no touches explain.
        let left = result.residual * result.residual * square(&self.values);
        let frame = remainder(&self.values, &self.reduced);
        let frame = Remainder {
            outside: frame.outside.max(left),
            ..frame
        };
        let chance = (independent, fit.false_touch);
        let explained = self.filter.find(&tables.touches, frame, said, chance, &mut self.spare);
        result.explained = Some(explained);
        let (geometry, unplaced) = (self.imager.model.geometry(), self.options.unplaced_mm);
        let placed = self
            .spare
            .iter()
            .filter(|t| is_placed(t, &self.spare, geometry, unplaced));
        result.touches.extend(placed.copied());
    }

    /// What speaks for a touch beside each of these drifts, of which the first is none. `independent`: values with errors of their own.
    fn evidence_by_drift(&mut self, task: Task, ways: &[Drifting], independent: f64) -> Vec<Evidence> {
        let said = self.said();
        // Responses that no other step needs would have to be made first: as long as many frames take, or a second for many values.
        let ways = match (self.options.drifts, self.options.sequence) {
            (false, _) => &ways[..1],
            (true, true) => &ways[ways.len() - 1..],
            (true, false) if !self.imager.is_searched() => &ways[1..],
            (true, false) => ways,
        };
        let mut whole = None;
        let mut found = Vec::with_capacity(ways.len());
        for drifting in ways {
            self.look(task, *drifting);
            let Some(weighted) = self.weightings.current() else {
                continue;
            };
            let Some(tables) = &weighted.tables else { continue };
            let left = square(&self.values);
            let whole = *whole.get_or_insert(left);
            // A direction that is left out takes its share of any frame (the criterion of Schwarz).
            let directions = weighted.directions() as f64;
            let alone = -0.5 * (independent * (left / whole).ln() + directions * independent.ln());
            let frame = remainder(&self.values, &self.reduced);
            let touched = alone + self.filter.log_evidence(&tables.touches, frame, said, independent);
            found.push(Evidence {
                drifting: *drifting,
                alone,
                touched,
            });
        }
        found
    }

    /// Makes the frame ready with this drift left out.
    fn look(&mut self, task: Task, drifting: Drifting) {
        self.weigh(task.difference, (drifting, task.changed));
        self.reduce(task.difference);
        self.tabulate(false);
    }
}

fn remainder<'a>(values: &[f64], reduced: &'a [f64]) -> Remainder<'a> {
    Remainder {
        reduced,
        outside: square(values) - square(reduced),
    }
}
