//! What one frame measures: which pairs drive, which sense, for how long.

use crate::hello::Hello;
use crate::plan_error::PlanError;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most slots of a plan.
pub const MAX_SLOTS: usize = 32;
/// Most values of a frame.
pub const MAX_VALUES: usize = 256;
/// Most electrodes: a slot has one bit for each.
pub const MAX_ELECTRODES: u8 = 32;

/// Two electrodes, counted from 0 counter-clockwise as seen from the touched side. As a drive pair the current flows into
/// `plus` and out of `minus`; as a sense pair the value is the potential of `plus` less that of `minus`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Pair {
    /// Where the current enters, or the positive input.
    pub plus: u8,
    /// Where the current leaves, or the negative input.
    pub minus: u8,
}

/// How the sense pairs of a slot are sampled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Sampling {
    /// One pair after the other, each switched to, left to settle and integrated by itself.
    Sequential,
    /// All pairs of a slot at once, on one channel each.
    #[default]
    Simultaneous,
}

/// One drive pair and what is sensed while it drives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Slot {
    /// The drive pair.
    pub drive: Pair,
    /// Distance between the two electrodes of a sense pair.
    pub sense_step: u8,
    /// Bit n: measure the potential of electrode `n + sense_step` (modulo the number of electrodes) less that of n.
    pub sense: u32,
    /// Which of the board's gains to use, from 0 ([`Hello::gains_milli`]).
    pub gain: u8,
}

impl Slot {
    /// The sense pairs by rising n, on a board of `electrodes`.
    pub fn sense_pairs(self, electrodes: u8) -> impl Iterator<Item = Pair> {
        (0..electrodes.min(MAX_ELECTRODES))
            .filter(move |n| self.sense >> n & 1 == 1)
            .map(move |n| sense_pair(n, self.sense_step, electrodes))
    }
}

/// Sense pair number `n`: its positive input is `step` further than its negative one.
fn sense_pair(n: u8, step: u8, electrodes: u8) -> Pair {
    let plus = (u16::from(n) + u16::from(step)) % u16::from(electrodes.max(1));
    Pair {
        plus: plus as u8,
        minus: n,
    }
}

/// What one frame measures. The values come in slot order and, within a slot, by rising bit of [`Slot::sense`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    /// Chosen by whoever made the plan; every frame carries it.
    pub id: u16,
    /// Whole periods to wait after every switch.
    pub settle_periods: u16,
    /// Whole periods to integrate for every value.
    pub integrate_periods: u16,
    /// One value after the other, or all of a slot at once.
    pub sampling: Sampling,
    /// Whether to send the quadrature amplitudes too.
    pub quadrature: bool,
    /// Drive pairs in the order of measuring.
    pub slots: Vec<Slot, MAX_SLOTS>,
}

impl Plan {
    /// The paper's way: 16 electrodes, 208 neighbouring pairs one after the other, six periods each: 1248 periods a
    /// frame, 339 ms at 3684 Hz.
    pub fn paper() -> Self {
        Self {
            id: 1,
            settle_periods: 0,
            integrate_periods: 6,
            sampling: Sampling::Sequential,
            quadrature: false,
            slots: adjacent_slots(16),
        }
    }

    /// The same 208 values with all pairs of a drive at once, one period to settle and one to integrate: 32 periods a
    /// frame, 115 frames/s at 3684 Hz.
    pub fn fast() -> Self {
        Self {
            id: 2,
            settle_periods: 1,
            integrate_periods: 1,
            sampling: Sampling::Simultaneous,
            ..Self::paper()
        }
    }

    /// Neighbouring electrodes drive in order, neighbouring electrodes that touch neither drive electrode sense: the
    /// plan of [`Plan::fast`] for another number of electrodes, 4 to [`MAX_ELECTRODES`].
    ///
    /// # Errors
    /// Too few electrodes to measure anything; more than 17, whose values no longer fit a frame.
    pub fn adjacent(electrodes: u8) -> Result<Self, PlanError> {
        if electrodes > MAX_ELECTRODES {
            return Err(PlanError::Slots {
                given: electrodes,
                most: MAX_ELECTRODES,
            });
        }
        let plan = Self {
            slots: adjacent_slots(electrodes),
            ..Self::fast()
        };
        if plan.slots.is_empty() {
            return Err(PlanError::Empty);
        }
        plan.check_values(MAX_VALUES as u16)?;
        Ok(plan)
    }

    /// How many values a frame has.
    pub fn value_count(&self) -> usize {
        self.slots.iter().map(|s| s.sense.count_ones() as usize).sum()
    }

    /// How many periods of the excitation a frame takes.
    pub fn periods(&self) -> u32 {
        let routes = match self.sampling {
            Sampling::Sequential => self.value_count(),
            Sampling::Simultaneous => self.slots.len(),
        };
        routes as u32 * (u32::from(self.settle_periods) + u32::from(self.integrate_periods))
    }

    /// Drive and sense pair of every value, in order, on a board of `electrodes`.
    pub fn measurements(&self, electrodes: u8) -> impl Iterator<Item = (Pair, Pair)> + '_ {
        self.slots
            .iter()
            .flat_map(move |s| s.sense_pairs(electrodes).map(|sense| (s.drive, sense)))
    }

    /// Whether a board can carry the plan out.
    ///
    /// # Errors
    /// The first thing wrong, naming the slot.
    pub fn check(&self, board: &Hello) -> Result<(), PlanError> {
        let limits = &board.limits;
        let count = board.electrodes.min(MAX_ELECTRODES);
        if self.slots.is_empty() {
            return Err(PlanError::Empty);
        }
        if self.slots.len() > usize::from(limits.slots) {
            return Err(PlanError::Slots {
                given: self.slots.len() as u8,
                most: limits.slots,
            });
        }
        if self.integrate_periods == 0 || self.integrate_periods > limits.integrate_periods {
            return Err(PlanError::Integrate {
                given: self.integrate_periods,
                most: limits.integrate_periods,
            });
        }
        if self.settle_periods > limits.settle_periods {
            return Err(PlanError::Settle {
                given: self.settle_periods,
                most: limits.settle_periods,
            });
        }
        if self.sampling == Sampling::Simultaneous && limits.channels < count {
            return Err(PlanError::Channels {
                needed: count,
                count: limits.channels,
            });
        }
        let gains = board.gains_milli.len() as u8;
        for (k, slot) in self.slots.iter().enumerate() {
            slot.check(k as u8, count, gains)?;
        }
        self.check_values(limits.values.min(MAX_VALUES as u16))
    }

    fn check_values(&self, most: u16) -> Result<(), PlanError> {
        let given = self.value_count() as u16;
        if given > most {
            return Err(PlanError::Values { given, most });
        }
        Ok(())
    }
}

impl Slot {
    fn check(self, slot: u8, count: u8, gains: u8) -> Result<(), PlanError> {
        for electrode in [self.drive.plus, self.drive.minus] {
            if electrode >= count {
                return Err(PlanError::Electrode { slot, electrode, count });
            }
        }
        if self.drive.plus == self.drive.minus {
            return Err(PlanError::SameElectrode {
                slot,
                electrode: self.drive.plus,
            });
        }
        if self.sense_step == 0 || self.sense_step >= count {
            return Err(PlanError::SenseStep {
                slot,
                step: self.sense_step,
                count,
            });
        }
        if self.sense == 0 {
            return Err(PlanError::NoSense { slot });
        }
        let highest = 31 - self.sense.leading_zeros() as u8;
        if highest >= count {
            return Err(PlanError::Electrode {
                slot,
                electrode: highest,
                count,
            });
        }
        if self.gain >= gains {
            return Err(PlanError::Gain {
                slot,
                gain: self.gain,
                count: gains,
            });
        }
        Ok(())
    }
}

/// Neighbour drives, neighbours sense. No slots for fewer than 4 electrodes: nothing would be left to sense.
fn adjacent_slots(electrodes: u8) -> Vec<Slot, MAX_SLOTS> {
    if electrodes < 4 {
        return Vec::new();
    }
    (0..electrodes)
        .take(MAX_SLOTS)
        .map(|m| {
            let next = (m + 1) % electrodes;
            let sense = (0..electrodes)
                .filter(|n| {
                    let pair = sense_pair(*n, 1, electrodes);
                    ![m, next].contains(&pair.plus) && ![m, next].contains(&pair.minus)
                })
                .fold(0, |bits, n| bits | 1 << n);
            Slot {
                drive: Pair { plus: m, minus: next },
                sense_step: 1,
                sense,
                gain: 0,
            }
        })
        .collect()
}
