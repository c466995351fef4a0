//! What is measured by itself: the self-test, and folded periods.

use super::Measuring;
use crate::front_end::FrontEnd;
use crate::memory::Memory;
use crate::self_test;
use crate::settings;
use crate::support::Support;
use crate::task::{Probe, Task};
use core::ops::DerefMut;
use protocol::{Counters, FoldedPeriod, Outgoing, PeriodRequest};

impl<F, S, M> Measuring<'_, F, S, M>
where
    F: FrontEnd,
    S: Support,
    M: DerefMut<Target = Memory>,
{
    /// Begins to measure a folded period. The request was checked.
    pub(crate) fn measure_period(&mut self, request: PeriodRequest) {
        self.probe = Probe::period(request, self.info.electrodes);
        self.begin(Task::Period);
    }

    /// Begins the self-test.
    pub(crate) fn test(&mut self) {
        let store_works = settings::load_with(&mut self.support, |_| {}).is_ok();
        self.memory.report = self_test::begun(&self.info, store_works);
        self.probe = Probe::drive_pair(0, self.info.electrodes, self.memory.report.gain);
        if self.excite() {
            self.begin(Task::TestSource);
        }
    }

    /// The source was measured for the self-test; on to the first drive pair.
    pub(super) fn tested_source(&mut self) {
        let (measured, set) = (self.source_permille(), self.memory.settings.excitation_permille);
        let memory = &mut *self.memory;
        self_test::source_measured(&mut memory.report, &memory.scan, measured, set);
        self.begin(Task::TestPair);
    }

    /// A drive pair was measured for the self-test; on to the next one, or to the sense pairs.
    pub(super) fn tested_pair(&mut self) {
        let memory = &mut *self.memory;
        self_test::pair_measured(&mut memory.report, &memory.scan);
        let next = self_test::next_pair(&memory.report, &self.info);
        let (probe, task) = match next {
            Some(probe) => (probe, Task::TestPair),
            None => (Probe::beside(0, false, self.info.electrodes), Task::TestSense),
        };
        self.probe = probe;
        self.begin(task);
    }

    /// A sense pair was measured for the self-test; on to the next one, or the end.
    pub(super) fn tested_sense(&mut self) {
        let memory = &mut *self.memory;
        self_test::sense_measured(&mut memory.report, &self.probe, &memory.scan);
        if let Some(next) = self_test::next_sense(&memory.report, &self.probe, &self.info) {
            self.probe = next;
            self.begin(Task::TestSense);
        } else {
            self_test::judge(&mut memory.report, &self.info);
            let dropped = memory.outbox.push(&Outgoing::SelfTest(&memory.report));
            Counters::add(&mut self.counters.dropped, dropped);
            self.resume();
        }
    }

    /// A folded period is complete.
    pub(super) fn period(&mut self) {
        let folded = self.memory.scan.folded();
        let period = FoldedPeriod {
            request: self.probe.request,
            time: self.memory.scan.time(),
            clipped: folded.railed(0),
            bins: folded.period(0),
        };
        self.send(Outgoing::Period(&period));
        self.resume();
    }
}
