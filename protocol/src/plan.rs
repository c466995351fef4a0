//! What one frame measures: which pairs drive, which sense, for how long.

use crate::hello::{Hello, Limits};
use crate::plan_error::PlanError;
use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Quarter periods in a period: settling is counted in quarters.
pub const QUARTERS: u32 = 4;
/// Most slots of a plan.
pub const MAX_SLOTS: usize = 32;
/// Most values of a frame.
pub const MAX_VALUES: usize = 256;
/// Most electrodes: a slot has one bit for each.
pub const MAX_ELECTRODES: u8 = 32;

/// Two electrodes, counted from 0 counter-clockwise as seen from the touched side. As a drive pair the current flows into
/// `plus` and out of `minus`; as a sense pair the value is the potential of `plus` less that of `minus`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Pair {
    /// Where the current enters, or the positive input.
    pub plus: u8,
    /// Where the current leaves, or the negative input.
    pub minus: u8,
}

/// How the sense pairs of a slot are sampled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Sampling {
    /// One pair after the other, each switched to, left to settle and integrated by itself.
    Sequential,
    /// All pairs of a slot at once, on one channel each.
    #[default]
    Simultaneous,
}

/// One drive pair and what is sensed while it drives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
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
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Plan {
    /// Chosen by whoever made the plan; every frame carries it.
    pub id: u16,
    /// Quarter periods to wait after every switch.
    pub settle_quarters: u16,
    /// Whole periods to integrate for every value.
    pub integrate_periods: u16,
    /// One value after the other, or all of a slot at once.
    pub sampling: Sampling,
    /// Whether to send the quadrature amplitudes too.
    pub quadrature: bool,
    /// Drive pairs in the order of measuring.
    pub slots: Vec<Slot, MAX_SLOTS>,
}

/// What a scan needs to know of a [`Plan`] or of a [`crate::Watch`].
#[derive(Clone, Copy, Debug)]
pub struct Recipe<'a> {
    /// Quarter periods to wait after every switch.
    pub settle_quarters: u16,
    /// Whole periods to integrate for every value.
    pub integrate_periods: u16,
    /// One value after the other, or all of a slot at once.
    pub sampling: Sampling,
    /// Whether the quadrature amplitudes are wanted too.
    pub quadrature: bool,
    /// Drive pairs in the order of measuring.
    pub slots: &'a [Slot],
}

impl<'a> Recipe<'a> {
    /// How many values there are.
    pub fn value_count(self) -> usize {
        self.slots.iter().map(|s| s.sense.count_ones() as usize).sum()
    }

    /// Quarter periods of the excitation that measuring all of them takes.
    pub fn quarters(self) -> u32 {
        let routes = match self.sampling {
            Sampling::Sequential => self.value_count(),
            Sampling::Simultaneous => self.slots.len(),
        };
        routes as u32 * (u32::from(self.settle_quarters) + QUARTERS * u32::from(self.integrate_periods))
    }

    /// Drive and sense pair of every value, in order, on a board of `electrodes`.
    pub fn measurements(self, electrodes: u8) -> impl Iterator<Item = (Pair, Pair)> + 'a {
        self.slots
            .iter()
            .flat_map(move |s| s.sense_pairs(electrodes).map(|sense| (s.drive, sense)))
    }

    /// Whether a board of `electrodes` and `gains` with these limits can carry it out.
    ///
    /// # Errors
    /// The first thing wrong, naming the slot.
    pub fn check(self, electrodes: u8, gains: u8, limits: &Limits) -> Result<(), PlanError> {
        let count = electrodes.min(MAX_ELECTRODES);
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
        if self.settle_quarters > limits.settle_quarters {
            return Err(PlanError::Settle {
                given: self.settle_quarters,
                most: limits.settle_quarters,
            });
        }
        if self.sampling == Sampling::Simultaneous && limits.channels < count {
            return Err(PlanError::Channels {
                needed: count,
                count: limits.channels,
            });
        }
        for (k, slot) in self.slots.iter().enumerate() {
            slot.check(k as u8, count, gains)?;
        }
        let given = self.value_count() as u16;
        let most = limits.values.min(MAX_VALUES as u16);
        if given > most {
            return Err(PlanError::Values { given, most });
        }
        if self.quadrature && 2 * given > limits.amplitudes {
            return Err(PlanError::Quadrature {
                needed: 2 * given,
                most: limits.amplitudes,
            });
        }
        Ok(())
    }
}

impl Plan {
    /// Nothing; no board accepts it.
    pub const NONE: Self = Self {
        id: 0,
        settle_quarters: 0,
        integrate_periods: 0,
        sampling: Sampling::Simultaneous,
        quadrature: false,
        slots: Vec::new(),
    };

    /// The paper's way: 16 electrodes, 208 neighbouring pairs one after the other, six periods each: 1248 periods a
    /// frame, 339 ms at 3684 Hz.
    pub fn paper() -> Self {
        Self {
            id: 1,
            settle_quarters: 0,
            integrate_periods: 6,
            sampling: Sampling::Sequential,
            quadrature: false,
            slots: adjacent_slots(16),
        }
    }

    /// The same 208 values one after the other, one period to settle and one to integrate: 416 periods, 113 ms.
    pub fn sequential() -> Self {
        Self {
            id: 5,
            settle_quarters: 4,
            integrate_periods: 1,
            ..Self::paper()
        }
    }

    /// The same 208 values one after the other, a quarter period to settle and one to integrate: 260 periods, 70.6 ms.
    pub fn sequential_fast() -> Self {
        Self {
            id: 11,
            settle_quarters: 1,
            ..Self::sequential()
        }
    }

    /// One value of each of the 104 pairs of values that reciprocity joins, that of the drive pair with the lower number;
    /// one after the other, one period to settle and one to integrate: 208 periods, 56 ms.
    pub fn independent() -> Self {
        Self {
            id: 6,
            ..Self::sequential()
        }
        .without_reciprocals()
    }

    /// The paper's 208 values with all pairs of a drive at once, one period to settle and six to integrate: 112 periods a
    /// frame, 32.9 frames/s, at the paper's noise.
    pub fn quiet() -> Self {
        Self {
            id: 3,
            integrate_periods: 6,
            ..Self::fast()
        }
    }

    /// The paper's 208 values with all pairs of a drive at once, one period to settle and one to integrate: 32 periods a
    /// frame, 115 frames/s at 3684 Hz.
    pub fn fast() -> Self {
        Self {
            id: 2,
            settle_quarters: 4,
            integrate_periods: 1,
            sampling: Sampling::Simultaneous,
            ..Self::paper()
        }
    }

    /// The same with a quarter period to settle: 20 periods a frame, 184 frames/s.
    pub fn fastest() -> Self {
        Self {
            id: 7,
            settle_quarters: 1,
            ..Self::fast()
        }
    }

    /// The first 14 drives of [`Plan::fastest`]. They suffice: what the last two would add is the other half of a pair that
    /// reciprocity joins. 182 values, among them all 104 independent ones; 17.5 periods a frame.
    pub fn fourteen() -> Self {
        Self {
            id: 8,
            ..Self::fastest()
        }
        .without_spare_drives(16)
    }

    /// [`Plan::fast`] and after it the voltage of each drive pair itself, through gain number `gain`: 224 values, the last
    /// 16 negative, since a sense pair counts against the direction of the current; 64 periods.
    pub fn with_drive_pairs(gain: u8) -> Self {
        let mut plan = Self { id: 9, ..Self::fast() };
        let own = drive_pair_slots(16, gain);
        // Cannot fail: 16 and 16 slots fit.
        let _ = plan.slots.extend_from_slice(&own);
        plan
    }

    /// The voltage of each neighbouring drive pair itself, through gain number `gain`, for up to [`MAX_ELECTRODES`]
    /// electrodes: whether every electrode has contact.
    pub fn drive_pairs(electrodes: u8, gain: u8) -> Self {
        Self {
            id: 10,
            slots: drive_pair_slots(electrodes, gain),
            ..Self::fast()
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
        let (given, most) = (plan.value_count() as u16, MAX_VALUES as u16);
        if given > most {
            return Err(PlanError::Values { given, most });
        }
        Ok(plan)
    }

    /// A plan for up to [`MAX_ELECTRODES`]: neighbouring electrodes drive in order, and of the neighbouring pairs that share
    /// no electrode with the drive as many sense as a frame holds. One after the other, a quarter period to settle and one
    /// to integrate: one channel is enough. On 32 electrodes these are 256 values in 320 periods.
    ///
    /// Where not all fit, the nearest pair senses on either side, and others from there to half the rim, evenly spread. Pairs
    /// beyond would mostly measure what reciprocity tells already; the nearest are measured both ways, since their
    /// disagreement shows the noise and faults.
    ///
    /// # Errors
    /// Too few electrodes to measure anything; more than [`MAX_ELECTRODES`].
    pub fn sparse(electrodes: u8) -> Result<Self, PlanError> {
        if electrodes > MAX_ELECTRODES {
            return Err(PlanError::Slots {
                given: electrodes,
                most: MAX_ELECTRODES,
            });
        }
        let mut plan = Self {
            id: 12,
            slots: adjacent_slots(electrodes),
            ..Self::sequential_fast()
        };
        if plan.slots.is_empty() {
            return Err(PlanError::Empty);
        }
        if plan.value_count() <= MAX_VALUES {
            return Ok(plan);
        }
        // 18 electrodes or more: half the rim is 9 or more, and there is room for 8 values a drive or more.
        let (nearest, half) = (2, electrodes / 2);
        let room = (MAX_VALUES / usize::from(electrodes)) as u8;
        let spread = (room - 2).min(half - nearest);
        let between = |k: u8| nearest + 1 + k * (half - nearest - 1) / (spread - 1);
        let distances = [nearest, electrodes - nearest]
            .into_iter()
            .chain((0..spread).map(between));
        for (m, slot) in (0..electrodes).zip(&mut plan.slots) {
            slot.sense = distances.clone().fold(0, |bits, d| bits | 1 << ((m + d) % electrodes));
        }
        Ok(plan)
    }

    /// Keeps one of each two values that reciprocity joins, in a plan of neighbouring pairs: the one of the drive with the
    /// lower number.
    pub(crate) fn without_reciprocals(mut self) -> Self {
        for (m, slot) in self.slots.iter_mut().enumerate() {
            slot.sense &= u32::MAX << m;
        }
        self.slots.retain(|slot| slot.sense != 0);
        self
    }

    /// Leaves the last two drives out, in a plan of neighbouring pairs: reciprocity joins all of their values to others.
    pub(crate) fn without_spare_drives(mut self, electrodes: u8) -> Self {
        self.slots.truncate(usize::from(electrodes).saturating_sub(2));
        self
    }

    /// What a scan needs to know.
    pub fn recipe(&self) -> Recipe<'_> {
        Recipe {
            settle_quarters: self.settle_quarters,
            integrate_periods: self.integrate_periods,
            sampling: self.sampling,
            quadrature: self.quadrature,
            slots: &self.slots,
        }
    }

    /// How many values a frame has.
    pub fn value_count(&self) -> usize {
        self.recipe().value_count()
    }

    /// How many quarter periods of the excitation a frame takes.
    pub fn quarters(&self) -> u32 {
        self.recipe().quarters()
    }

    /// Drive and sense pair of every value, in order, on a board of `electrodes`.
    pub fn measurements(&self, electrodes: u8) -> impl Iterator<Item = (Pair, Pair)> + '_ {
        self.recipe().measurements(electrodes)
    }

    /// Whether a board can carry the plan out.
    ///
    /// # Errors
    /// The first thing wrong, naming the slot.
    pub fn check(&self, board: &Hello) -> Result<(), PlanError> {
        self.recipe()
            .check(board.electrodes, board.gains_milli.len() as u8, &board.limits)
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

/// Neighbour drives and its own voltage is sensed.
fn drive_pair_slots(electrodes: u8, gain: u8) -> Vec<Slot, MAX_SLOTS> {
    (0..electrodes)
        .take(MAX_SLOTS)
        .map(|m| Slot {
            drive: Pair {
                plus: m,
                minus: (m + 1) % electrodes.max(1),
            },
            sense_step: 1,
            sense: 1 << m,
            gain,
        })
        .collect()
}
