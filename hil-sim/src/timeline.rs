//! Faults on their time line.

use crate::fault::{Fault, FaultKind};
use std::sync::Arc;

/// The faults of a simulation, and which of them are there at a time. Clones share the list.
#[derive(Clone, Debug, Default)]
pub(crate) struct Timeline {
    faults: Arc<[Fault]>,
    /// Times at which something changes, in order.
    changes: Arc<[f64]>,
}

impl Timeline {
    pub(crate) fn new(mut faults: Vec<Fault>) -> Self {
        faults.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        let mut changes: Vec<f64> = faults.iter().flat_map(|f| [f.at_s, f.end_s()]).collect();
        changes.sort_by(f64::total_cmp);
        Self {
            faults: faults.into(),
            changes: changes.into(),
        }
    }

    /// What is broken at a time.
    pub(crate) fn active(&self, time_s: f64) -> impl Iterator<Item = &FaultKind> {
        let there = move |f: &&Fault| f.at_s <= time_s && time_s < f.end_s();
        self.faults.iter().filter(there).map(|f| &f.kind)
    }

    /// When something changes next after a time; infinite for never.
    pub(crate) fn next_change_s(&self, time_s: f64) -> f64 {
        let next = self.changes.partition_point(|t| *t <= time_s);
        self.changes.get(next).copied().unwrap_or(f64::INFINITY)
    }

    /// How often the cable was put back by a time; `None` while it is pulled.
    pub(crate) fn plugged(&self, time_s: f64) -> Option<u32> {
        let mut count = 0;
        for fault in self
            .faults
            .iter()
            .filter(|f| f.kind == FaultKind::CablePulled && f.at_s <= time_s)
        {
            if time_s < fault.end_s() {
                return None;
            }
            count += 1;
        }
        Some(count)
    }

    /// The reset after the first `done` ones, if its time has come.
    pub(crate) fn reset(&self, time_s: f64, done: usize) -> Option<&Fault> {
        self.faults
            .iter()
            .filter(|f| matches!(f.kind, FaultKind::BoardReset | FaultKind::BoardHangs))
            .nth(done)
            .filter(|f| f.at_s <= time_s)
    }
}
