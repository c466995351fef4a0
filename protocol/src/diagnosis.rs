//! What the board reports about itself: the self-test, and folded periods.

use crate::plan::{MAX_ELECTRODES, Pair};
use crate::value::Value;
use crate::variance::Variance;
use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Samples in a folded period.
pub const PERIOD_BINS: usize = 16;

/// Ask for one folded period as it is, before the lock-in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct PeriodRequest {
    /// Where the current enters and leaves.
    pub drive: Pair,
    /// What is measured.
    pub sense: Pair,
    /// Which of the board's gains to use.
    pub gain: u8,
    /// Quarter periods to wait after the switch.
    pub settle_quarters: u16,
    /// Whole periods to fold, 1 or more.
    pub periods: u16,
}

/// Sixteen sums, one for each phase: mean, shape, settling, harmonics and clipping are all in them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct FoldedPeriod {
    /// What was asked for.
    pub request: PeriodRequest,
    /// When the first sample was taken, in samples since power-up. Bin 0 is phase 0 all the same.
    pub time: u64,
    /// Whether a sample touched the converter's rails.
    pub clipped: bool,
    /// Sums of the converter's own codes by phase; divided by the number of periods, the mean sample.
    pub bins: [u32; PERIOD_BINS],
}

/// Parts of the self-test.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Check {
    /// The source is within a tenth of what it is set to.
    Source,
    /// No drive pair is without current or shorted.
    Electrodes,
    /// The mean of the samples is within a tenth of the middle of its range.
    Offset,
    /// The samples scatter less than 16 squared codes.
    Noise,
    /// The store can be read.
    Store,
    /// The amplifier of gain 0 gives a signal.
    Amplifier,
    /// A sense pair's period through that amplifier is the same upside down, and no sample touches the converter's rails.
    Linearity,
    /// Source and sense pairs are within ten degrees of the phase that the lock-in takes them at.
    Phase,
}

impl Check {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Source,
        Self::Electrodes,
        Self::Offset,
        Self::Noise,
        Self::Store,
        Self::Amplifier,
        Self::Linearity,
        Self::Phase,
    ];

    /// Its bit in [`SelfTest::failed`].
    pub const fn bit(self) -> u8 {
        1 << self as u8
    }
}

/// Result of the self-test.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct SelfTest {
    /// One bit for each [`Check`] that failed; 0 for a healthy board.
    pub failed: u8,
    /// Amplitude of the source as measured, in thousandths of what it is at full scale.
    pub source_permille: u16,
    /// How far the mean code is from the middle of the range, in sixteenths of a code; the farthest of all measured.
    pub offset: Value,
    /// Variance of one sample; the largest of all measured, but for bent periods.
    pub noise: Variance,
    /// One bit for each drive pair (m, m + 1) of which an electrode is open or shorted: the sense pairs beside it see less than
    /// a quarter of the mean, or its own voltage is less than 2 % of the source's.
    pub suspect: u32,
    /// The voltage of each drive pair, through the gain that the test chose.
    pub drive_pairs: Vec<Value, { MAX_ELECTRODES as usize }>,
    /// That gain's number.
    pub gain: u8,
    /// How far the mean code is from the middle of the range where the source itself is measured, in sixteenths of a code.
    pub source_offset: Value,
    /// For each drive pair (m, m + 1) the larger one of the two sense pairs (m + 3, m + 2) and (m - 1, m - 2), through
    /// gain 0.
    pub sense_pairs: Vec<Value, { MAX_ELECTRODES as usize }>,
    /// One bit for each drive pair beside which a sense pair's period is not the same upside down.
    pub bent: u32,
}

impl SelfTest {
    /// Nothing tested yet.
    pub const NONE: Self = Self {
        failed: 0,
        source_permille: 0,
        offset: Value::new(0),
        noise: Variance::new(0),
        suspect: 0,
        drive_pairs: Vec::new(),
        gain: 0,
        source_offset: Value::new(0),
        sense_pairs: Vec::new(),
        bent: 0,
    };

    /// Whether a part of it passed.
    pub const fn passed(&self, check: Check) -> bool {
        self.failed & check.bit() == 0
    }
}
