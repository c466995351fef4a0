//! What is being measured, and by which recipe.

use crate::settings::Settings;
use protocol::{Pair, PeriodRequest, QUARTERS, Recipe, Sampling, Slot};

/// What is being measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) enum Task {
    /// Nothing.
    Off,
    /// The plan's values.
    Frames,
    /// The watch's values.
    Watch,
    /// The source's amplitude, before the board measures and with every heartbeat.
    Source,
    /// The same between two frames, every second.
    Check,
    /// The source's amplitude, first part of the self-test.
    TestSource,
    /// The voltage of one drive pair after the other, second part of the self-test.
    TestPair,
    /// The sense pairs beside one drive pair after the other, third part of the self-test.
    TestSense,
    /// One folded period.
    Period,
}

/// One value that is measured by itself.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Probe {
    pub(crate) request: PeriodRequest,
    slot: Slot,
    /// Of two sense pairs beside a drive pair, whether this is the second one.
    pub(crate) second: bool,
}

impl Probe {
    /// A value asked for, on a board of `electrodes`, which the sense pair's are.
    pub(crate) fn period(request: PeriodRequest, electrodes: u8) -> Self {
        let Pair { plus, minus } = request.sense;
        let step = (u16::from(plus) + u16::from(electrodes) - u16::from(minus)) % u16::from(electrodes.max(1));
        Self {
            request,
            slot: Slot {
                drive: request.drive,
                sense_step: step as u8,
                sense: 1u32.checked_shl(minus.into()).unwrap_or(0),
                gain: request.gain,
            },
            second: false,
        }
    }

    /// The source, or the voltage of drive pair `m`.
    pub(crate) fn drive_pair(m: u8, electrodes: u8, gain: u8) -> Self {
        let next = at(u16::from(m) + 1, electrodes);
        Self::tested(m, Pair { plus: next, minus: m }, electrodes, gain)
    }

    /// The nearest sense pair on either side of drive pair `m` that shares no electrode with it, through gain 0.
    pub(crate) fn beside(m: u8, second: bool, electrodes: u8) -> Self {
        let minus = u16::from(m)
            + if second {
                u16::from(electrodes).saturating_sub(2)
            } else {
                2
            };
        let sense = Pair {
            plus: at(minus + 1, electrodes),
            minus: at(minus, electrodes),
        };
        Self {
            second,
            ..Self::tested(m, sense, electrodes, 0)
        }
    }

    /// The source, between two frames: as short as its tolerance bears.
    pub(crate) fn source(electrodes: u8) -> Self {
        let Self { request, .. } = Self::drive_pair(0, electrodes, 0);
        let request = PeriodRequest {
            settle_quarters: QUARTERS as u16,
            periods: 2,
            ..request
        };
        Self::period(request, electrodes)
    }

    fn tested(m: u8, sense: Pair, electrodes: u8, gain: u8) -> Self {
        let request = PeriodRequest {
            drive: Pair {
                plus: m,
                minus: at(u16::from(m) + 1, electrodes),
            },
            sense,
            gain,
            settle_quarters: 2 * QUARTERS as u16,
            periods: 8,
        };
        Self::period(request, electrodes)
    }

    pub(crate) fn recipe(&self) -> Recipe<'_> {
        Recipe {
            settle_quarters: self.request.settle_quarters,
            integrate_periods: self.request.periods,
            sampling: Sampling::Sequential,
            quadrature: true,
            slots: core::slice::from_ref(&self.slot),
        }
    }
}

/// An electrode's number on the rim, whatever number it was counted to.
fn at(n: u16, electrodes: u8) -> u8 {
    (n % u16::from(electrodes.max(1))) as u8
}

/// The recipe of a task.
pub(crate) fn recipe<'b>(task: Task, settings: &'b Settings, probe: &'b Probe) -> Recipe<'b> {
    match (task, &settings.watch) {
        (Task::Frames | Task::Off, _) => settings.plan.recipe(),
        (Task::Watch, Some(watch)) => watch.recipe(),
        _ => probe.recipe(),
    }
}
