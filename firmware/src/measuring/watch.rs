//! The watch while nothing touches.

use super::Measuring;
use crate::front_end::FrontEnd;
use crate::memory::Memory;
use crate::support::Support;
use crate::task::{Probe, Task};
use crate::watch_state::AfterScan;
use core::ops::DerefMut;
use protocol::Counters;

impl<F, S, M> Measuring<'_, F, S, M>
where
    F: FrontEnd,
    S: Support,
    M: DerefMut<Target = Memory>,
{
    /// A drive of the watch is over: the next one, or the plan if it showed a change.
    pub(super) fn watch_slot(&mut self) {
        if self.look() {
            return;
        }
        let memory = &mut *self.memory;
        if let Some(watch) = &memory.settings.watch {
            let went = memory.scan.go_on(watch.recipe(), &mut self.front);
            self.survived(went);
        }
    }

    /// Puts the newest slot to the test; true if it woke the board.
    pub(super) fn look(&mut self) -> bool {
        let memory = &mut *self.memory;
        let Some(watch) = &memory.settings.watch else {
            return false;
        };
        let Some(slot) = memory.scan.noise().len().checked_sub(1) else {
            return false;
        };
        let values = memory.scan.values();
        let size = watch.slots.get(slot).map_or(0, |s| s.sense.count_ones() as usize);
        let start = values.len().saturating_sub(size);
        memory.change.put(slot, start, values.get(start..).unwrap_or_default());
        if !self.watch.wakes(memory.change.level(), watch) {
            return false;
        }
        Counters::add(&mut self.counters.wakes, 1);
        if self.begin(Task::Frames) {
            self.beat();
        }
        true
    }

    /// A scan of the watch is over.
    pub(super) fn watch_scan(&mut self) {
        Counters::add(&mut self.counters.watch_scans, 1);
        if self.look() {
            return;
        }
        let memory = &mut *self.memory;
        let Some(watch) = &memory.settings.watch else {
            return self.resume();
        };
        let (after, rest) = (self.watch.after_scan(memory.change.level(), watch), watch.rest_quarters);
        match after {
            AfterScan::Learn => {
                let ends = watch.slots.iter().scan(0, |end, slot| {
                    *end += slot.sense.count_ones() as usize;
                    Some(*end)
                });
                memory.change.learn_from(memory.scan.values(), ends);
                self.resume();
            }
            AfterScan::Sleep => {
                memory.change.follow(memory.scan.values());
                self.begin_after(Task::Watch, rest);
            }
            AfterScan::Heartbeat => {
                memory.change.follow(memory.scan.values());
                // With each sign of life a look at the source.
                self.probe = Probe::drive_pair(0, self.info.electrodes, 0);
                if self.begin(Task::Source) {
                    self.beat();
                }
            }
            AfterScan::FallAsleep => {
                if self.begin_after(Task::Watch, rest) {
                    self.beat();
                }
            }
            AfterScan::Frames => {
                self.begin(Task::Frames);
            }
        }
    }
}
