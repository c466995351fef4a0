//! The self-test: the source, then the voltage of every drive pair, and what the samples look like on the way.

use crate::FULL_SCALE;
use crate::controller::{Controller, Memory};
use crate::front_end::FrontEnd;
use crate::measuring::{Probe, Task};
use crate::settings;
use crate::support::Support;
use core::ops::DerefMut;
use embedded_hal_nb::serial::{Read, Write};
use protocol::{Check, Outgoing, SelfTest, Value, Variance};

/// Most scatter of a healthy board's samples, squared codes.
const MOST_NOISE: u32 = 16;

/// A drive pair whose voltage is this many thousandths of the source's, or more, carries no current.
const OPEN: i64 = 980;
/// One with this many or fewer is shorted.
const SHORTED: i64 = 20;

impl<F, L, S, M> Controller<'_, F, L, S, M>
where
    F: FrontEnd,
    L: Read<u8> + Write<u8>,
    S: Support,
    M: DerefMut<Target = Memory>,
{
    /// Begins the self-test.
    pub(crate) fn test(&mut self) {
        self.memory.report = SelfTest {
            gain: self.info.gains().saturating_sub(1),
            ..SelfTest::default()
        };
        if settings::load_with(&mut self.support, |_| {}).is_err() {
            self.memory.report.failed |= Check::Store.bit();
        }
        self.probe = Probe::drive_pair(0, self.info.electrodes, self.memory.report.gain);
        if self.excite() {
            self.begin(Task::TestSource);
        }
    }

    /// The source was measured; on to the first drive pair.
    pub(crate) fn tested_source(&mut self) {
        self.memory.report.source_permille = self.source_permille();
        let set = u32::from(self.memory.settings.excitation_permille);
        if u32::from(self.memory.report.source_permille).abs_diff(set) * 10 > set {
            self.memory.report.failed |= Check::Source.bit();
        }
        self.begin(Task::TestPair);
    }

    /// A drive pair was measured; on to the next one, or the end.
    pub(crate) fn tested_pair(&mut self) {
        let m = self.memory.report.drive_pairs.len() as u8;
        let value = self.memory.scan.values().first().copied().unwrap_or_default();
        let noise = self.memory.scan.noise().first().copied().unwrap_or_default();
        let periods = u32::from(self.memory.scan.folded().periods());
        let sum: u32 = self.memory.scan.folded().period(0).iter().sum();
        let offset = (i64::from(sum)).checked_div(i64::from(periods)).unwrap_or(0);
        let report = &mut self.memory.report;
        // Cannot fail: there is room for as many pairs as electrodes.
        let _ = report.drive_pairs.push(value);
        // The voltage against the source's: both amplitudes, each through its own gain.
        let gain = self
            .info
            .gains_milli
            .get(usize::from(report.gain))
            .copied()
            .unwrap_or(0);
        let source = self.info.source_full_scale() * i64::from(report.source_permille) * i64::from(gain);
        let source = source.checked_div(i64::from(self.info.source_gain_milli)).unwrap_or(0) / 1000;
        let voltage = i64::from(value.sixteenths()).abs() * 1000;
        if voltage >= source * OPEN || voltage <= source * SHORTED {
            report.suspect |= 1u32.checked_shl(m.into()).unwrap_or(0);
            report.failed |= Check::Electrodes.bit();
        }
        report.noise = report.noise.max(noise);
        if noise > Variance::new(MOST_NOISE * 256) {
            report.failed |= Check::Noise.bit();
        }
        // The sum of 16 bins over the periods is the mean in sixteenths of a code.
        let middle = i64::from(FULL_SCALE) * i64::from(Value::PER_CODE) / 2;
        if m == 0 || (offset - middle).abs() > (i64::from(report.offset.sixteenths())).abs() {
            report.offset = Value::saturating(offset - middle).0;
        }
        if (offset - middle).abs() > middle / 10 {
            report.failed |= Check::Offset.bit();
        }
        if m + 1 < self.info.electrodes {
            self.probe = Probe::drive_pair(m + 1, self.info.electrodes, self.memory.report.gain);
            self.begin(Task::TestPair);
        } else {
            let report = core::mem::take(&mut self.memory.report);
            self.send(Outgoing::SelfTest(&report));
            self.resume();
        }
    }
}
