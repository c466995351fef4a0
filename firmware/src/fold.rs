//! Integrate-and-dump lock-in: fold whole periods onto one, then correlate that one with the reference.
//!
//! The sum over all samples of sample times reference is the same, term by term, as the reference times the sum of all
//! samples at its phase. Folding first costs one addition a sample instead of two multiplications and two additions,
//! and the result is identical to the last bit.

use crate::FULL_SCALE;
use crate::capture::Block;
use crate::reference::{COSINE, ONE, SAMPLES_PER_PERIOD, SINE};
use protocol::Value;

/// Most channels sampled at once.
pub const MAX_CHANNELS: usize = 16;

/// Most periods that can be folded: with every sample at full scale a bin of 32 bits is then just not full.
pub const MAX_PERIODS: u32 = u32::MAX / FULL_SCALE as u32;

// A plan counts its periods in 16 bits, so that no plan can overflow a bin.
const _: () = assert!(u16::MAX as u32 <= MAX_PERIODS);
// Sixteen full bins times the reference, added up, stay inside 63 bits.
const _: () = assert!((u32::MAX as i64) < i64::MAX / (SAMPLES_PER_PERIOD as i64 * ONE as i64));

/// Why a block was not folded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FoldError {
    /// It does not hold whole periods of the expected number of channels.
    Shape,
    /// More than [`MAX_PERIODS`] in all.
    TooManyPeriods,
}

/// The sums of a correlation: in units of ADC code times Q14 times samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Phasor {
    /// With the sine: in phase with the excitation.
    pub in_phase: i64,
    /// With the cosine: a quarter period ahead of it.
    pub quadrature: i64,
}

/// One period, each sample the sum of that phase's samples in all periods folded, for up to [`MAX_CHANNELS`] channels.
#[derive(Clone, Debug)]
pub struct Folded {
    /// By phase, then by channel: the order in which samples come.
    bins: [[u32; MAX_CHANNELS]; SAMPLES_PER_PERIOD],
    /// By channel: whether any sample touched a rail.
    railed: [bool; MAX_CHANNELS],
    channels: u8,
    periods: u32,
}

impl Default for Folded {
    fn default() -> Self {
        Self::new()
    }
}

impl Folded {
    /// Nothing folded, one channel.
    pub const fn new() -> Self {
        Self {
            bins: [[0; MAX_CHANNELS]; SAMPLES_PER_PERIOD],
            railed: [false; MAX_CHANNELS],
            channels: 1,
            periods: 0,
        }
    }

    /// Empties all bins and makes ready for blocks of `channels` (1 to [`MAX_CHANNELS`]).
    pub fn reset(&mut self, channels: u8) {
        *self = Self {
            channels,
            ..Self::new()
        };
    }

    /// Adds the periods of a block. Samples are 12-bit codes, 0 to [`FULL_SCALE`]; that is the implementor's duty.
    ///
    /// # Errors
    /// A block of another shape, or one too many. Nothing is added then.
    pub fn add(&mut self, block: &Block<'_>) -> Result<(), FoldError> {
        let channels = usize::from(self.channels);
        if block.channels != self.channels || channels > MAX_CHANNELS {
            return Err(FoldError::Shape);
        }
        let more = block.periods().ok_or(FoldError::Shape)?;
        let periods = self
            .periods
            .checked_add(more)
            .filter(|p| *p <= MAX_PERIODS)
            .ok_or(FoldError::TooManyPeriods)?;
        let mut rows = block.samples.chunks_exact(channels);
        while rows.len() > 0 {
            for (bins, row) in self.bins.iter_mut().zip(&mut rows) {
                for ((bin, railed), sample) in bins.iter_mut().zip(&mut self.railed).zip(row) {
                    // Cannot wrap while the duties are kept; a wrapped sum is better than a stopped board.
                    *bin = bin.wrapping_add(u32::from(*sample));
                    *railed |= *sample == 0 || *sample >= FULL_SCALE;
                }
            }
        }
        self.periods = periods;
        Ok(())
    }

    /// Periods folded so far.
    pub fn periods(&self) -> u32 {
        self.periods
    }

    /// The folded period of a channel; zeros for a channel that is not there.
    pub fn period(&self, channel: usize) -> [u32; SAMPLES_PER_PERIOD] {
        self.bins.map(|bins| bins.get(channel).copied().unwrap_or(0))
    }

    /// Whether any sample of the channel touched a rail of the converter.
    pub fn railed(&self, channel: usize) -> bool {
        self.railed.get(channel).copied().unwrap_or(false)
    }

    /// Correlates a channel's period with the reference.
    pub fn correlate(&self, channel: usize) -> Phasor {
        let mut sums = Phasor::default();
        for ((bin, sine), cosine) in self.period(channel).iter().zip(SINE).zip(COSINE) {
            sums.in_phase += i64::from(*bin) * i64::from(sine);
            sums.quadrature += i64::from(*bin) * i64::from(cosine);
        }
        sums
    }
}

impl Phasor {
    /// In-phase and quadrature amplitude after `periods`, rounded to the nearest sixteenth of a code, and whether both
    /// fitted. Zero periods have no amplitude.
    ///
    /// A sine of amplitude A codes sums to `A * 8 * 2^14` in one period of 16 samples.
    pub fn values(self, periods: u32) -> (Value, Value, bool) {
        let per_unit =
            i64::from(periods) * (SAMPLES_PER_PERIOD as i64 / 2) * i64::from(ONE) / i64::from(Value::PER_CODE);
        let (in_phase, a) = Value::saturating(rounded(self.in_phase, per_unit));
        let (quadrature, b) = Value::saturating(rounded(self.quadrature, per_unit));
        (in_phase, quadrature, a && b)
    }
}

/// `a / b` to the nearest, halves away from zero; 0 for b = 0.
fn rounded(a: i64, b: i64) -> i64 {
    let half = if a < 0 { -(b / 2) } else { b / 2 };
    (a + half).checked_div(b).unwrap_or(0)
}
