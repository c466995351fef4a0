//! The source's checks: before the board measures, with every heartbeat, and between two frames every second.

use super::Measuring;
use crate::error::Error;
use crate::front_end::FrontEnd;
use crate::memory::Memory;
use crate::self_test;
use crate::support::Support;
use crate::task::Task;
use core::ops::DerefMut;
use protocol::{Counters, FrontEndFault, Notice, Outgoing, QUARTERS};

/// Largest error of the source's amplitude: one part in this many of what was set. A source that is further off has failed:
/// the board stops. A larger share lets a failing source pass.
const SOURCE_TOLERANCE: u32 = 10;

/// Further error allowed to the source's amplitude, in thousandths of full scale: the converter's codes and whole thousandths
/// round that much. It is the larger of the two allowances below 20 thousandths.
const ROUNDING_PERMILLE: u32 = 2;

/// Largest change of the source's amplitude while the board measures: one part in this many of what it was at the start. All
/// values change by as much, and a touch of 25 N changes a value by some hundredths. A smaller share tells the noise of two
/// periods.
const SOURCE_CHANGE: u32 = 50;

/// Quarter periods that the sheet rests after the source was measured between two frames: also the first value of a plan
/// without settling is then as in other frames.
const REST_QUARTERS: u16 = QUARTERS as u16;

impl<F, S, M> Measuring<'_, F, S, M>
where
    F: FrontEnd,
    S: Support,
    M: DerefMut<Target = Memory>,
{
    /// Switches the source on at the amplitude that is set.
    pub(super) fn excite(&mut self) -> bool {
        let set = self.front.set_amplitude(self.memory.settings.excitation_permille);
        match set.and_then(|()| self.front.switch_on()) {
            Ok(()) => true,
            Err(e) => {
                self.fail(e.kind());
                false
            }
        }
    }

    /// The source was measured: go on if its amplitude is what was set.
    pub(super) fn source(&mut self) {
        if !self.source_is(self.memory.settings.excitation_permille, SOURCE_TOLERANCE) {
            Counters::add(&mut self.counters.front_end_faults, 1);
            return self.halt(FrontEndFault::Source);
        }
        if self.began_permille == 0 {
            self.began_permille = self.source_permille();
        }
        self.measured_on();
        self.resume();
    }

    /// The source was measured between two frames: tell if it is not what it was, and on with the next frame.
    pub(super) fn checked(&mut self) {
        // A start in the middle of a test has not measured it.
        let (began_permille, part) = match self.began_permille {
            0 => (self.memory.settings.excitation_permille, SOURCE_TOLERANCE),
            began => (began, SOURCE_CHANGE),
        };
        let (permille, right) = (self.source_permille(), self.source_is(began_permille, part));
        if self.began_permille == 0 && right {
            self.began_permille = permille;
        }
        let tell = !right || self.source_is_off;
        self.source_is_off = !right;
        self.measured_on();
        if self.begin_after(Task::Frames, REST_QUARTERS) && tell {
            self.send(Outgoing::Notice(Notice::Source {
                permille,
                began_permille,
                right,
            }));
        }
    }

    /// The source was measured: again in a second, if frames are. Long enough without a fault, and the life is a good one.
    pub(super) fn measured_on(&mut self) {
        let second = self.info.samples_per_second();
        self.check_at = self.went_on.saturating_add(second);
        if self.lives.still_measures(self.went_on, second) {
            self.support.keep(self.lives.word());
        }
    }

    /// Whether the source as it was just measured has this amplitude, to one part in so many, and is in phase.
    pub(super) fn source_is(&self, permille: u16, part: u32) -> bool {
        let measured = self.source_permille();
        let most = u32::from(permille).checked_div(part).unwrap_or(0) + ROUNDING_PERMILLE;
        u32::from(measured.abs_diff(permille)) <= most && self_test::in_phase(&self.memory.scan)
    }

    /// The source's amplitude as it was just measured, in thousandths of full scale.
    pub(super) fn source_permille(&self) -> u16 {
        let values = self.memory.scan.frame(0, 0, true);
        let amplitude = match (values.values, values.quadrature) {
            // Whatever phase it has: that is tested by itself, and less strictly.
            ([i], [q]) => {
                let square = |v: &protocol::Value| u32::from(v.sixteenths().unsigned_abs()).pow(2);
                square(i).saturating_add(square(q)).isqrt()
            }
            _ => 0,
        };
        let permille = i64::from(amplitude) * 1000;
        let permille = permille.checked_div(self.info.source_full_scale()).unwrap_or(0);
        permille.clamp(0, u16::MAX.into()) as u16
    }
}
