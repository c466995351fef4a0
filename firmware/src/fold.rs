//! Integrate-and-dump lock-in: fold whole periods onto one, then correlate that one with the reference.
//!
//! The sum over all samples of sample times reference is the same, term by term, as the reference times the sum of all
//! samples at its phase. Folding first costs one addition a sample instead of two multiplications and two additions,
//! and the result is identical to the last bit.
//!
//! Overflow budget, with codes of 12 bits and at most [`MAX_PERIODS`] periods:
//!
//! | number | bound | bits | held in |
//! |---|---|---|---|
//! | sample | 4095 | 12 | u16 |
//! | bin: sum of one phase's samples | 4095 * 65535 | 28 | u32 |
//! | odd part: bin less the bin half a period later | the same, signed | 29 | i32 |
//! | reference | 2^30 | 31 signed | i32 |
//! | sum or difference of two odd parts | 2 * 4095 * 65535 | 30 signed | i32 |
//! | sum of 4 products of those | 2^29 * 2^30 * 4 | 62 signed | i64 |
//! | even part: bin and the bin half a period later | 2 * 4095 * 65535 | 29 | u32 |
//! | sum of 8 even parts | 16 * 4095 * 65535 | 32 | u32 |
//! | 8 times the sum of the squares of 8 even parts | 64 * (2 * 4095 * 65535)^2 | 64 | u64 |

use crate::FULL_SCALE;
use crate::capture::{Block, Rails};
use crate::phasor::Phasor;
use crate::reference::{HALF, ONE, SAMPLES_PER_PERIOD, SINE};
use protocol::{QUARTERS, Variance};

/// Most channels sampled at once.
pub const MAX_CHANNELS: usize = 16;

/// Most periods that can be folded: all that a plan can count.
pub const MAX_PERIODS: u16 = u16::MAX;

/// Largest sum in a bin.
const MAX_BIN: u64 = FULL_SCALE as u64 * MAX_PERIODS as u64;

// The budget of the table above.
const _: () = assert!(2 * MAX_BIN <= i32::MAX as u64);
const _: () = assert!(2 * MAX_BIN as i64 <= i64::MAX / (HALF as i64 / 2 * ONE as i64));
const _: () = assert!(SAMPLES_PER_PERIOD as u64 * MAX_BIN <= u32::MAX as u64);
const _: () = assert!((2 * MAX_BIN).checked_pow(2).is_some());
const _: () = assert!((2 * MAX_BIN).pow(2) <= u64::MAX / (HALF * HALF) as u64);

/// Why a block was not folded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FoldError {
    /// It does not hold whole quarter periods of the expected number of channels.
    Shape,
    /// More than [`MAX_PERIODS`] in all.
    TooManyPeriods,
}

/// One period, each sample the sum of that phase's samples in all periods folded, for up to [`MAX_CHANNELS`] channels.
#[derive(Clone, Debug)]
pub struct Folded {
    /// By phase, then by channel: the order in which samples come.
    bins: [[u32; MAX_CHANNELS]; SAMPLES_PER_PERIOD],
    /// A bit for each channel: whether any sample touched a rail.
    railed: u32,
    channels: u8,
    quarters: u32,
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
            railed: 0,
            channels: 1,
            quarters: 0,
        }
    }

    /// Empties all bins and makes ready for blocks of `channels` (1 to [`MAX_CHANNELS`]).
    pub fn reset(&mut self, channels: u8) {
        match channels {
            // The others stay zero as long as there is one channel only.
            1 if self.channels == 1 => self.bins.iter_mut().for_each(|bins| bins[0] = 0),
            _ => self.bins.as_flattened_mut().fill(0),
        }
        self.railed = 0;
        self.channels = channels;
        self.quarters = 0;
    }

    /// Adds the quarter periods of a block, each sample to the bin of its phase. Samples are 12-bit codes, 0 to
    /// [`FULL_SCALE`]; that is the implementor's duty.
    ///
    /// # Errors
    /// A block of another shape, or one too many. Nothing is added then.
    pub fn add(&mut self, block: &Block<'_>) -> Result<(), FoldError> {
        let channels = usize::from(self.channels);
        if block.channels != self.channels || channels > MAX_CHANNELS {
            return Err(FoldError::Shape);
        }
        let more = block.quarters().ok_or(FoldError::Shape)?;
        let quarters = self
            .quarters
            .checked_add(more)
            .filter(|q| *q <= QUARTERS * u32::from(MAX_PERIODS))
            .ok_or(FoldError::TooManyPeriods)?;
        let phase = (block.time % SAMPLES_PER_PERIOD as u64) as usize;
        // A rail is rare and costs a look at every sample to name its channel; that there is none, two instructions each.
        let sixteen = || block.samples.as_chunks::<MAX_CHANNELS>().0.iter().map(|row| &row[..]);
        let touched = match (self.channels, block.rails) {
            // The loops that count: their length is known.
            (16, Rails::Clear) => self.add_rows::<false>(phase, sixteen()),
            (16, Rails::Unknown) => self.add_rows::<true>(phase, sixteen()),
            (1, Rails::Unknown) => self.add_one(phase, block.samples),
            (_, Rails::Clear) => self.add_rows::<false>(phase, block.samples.chunks_exact(channels.max(1))),
            (_, Rails::Unknown) => self.add_rows::<true>(phase, block.samples.chunks_exact(channels.max(1))),
        };
        if touched {
            self.name_railed(block.samples, channels);
        }
        self.quarters = quarters;
        Ok(())
    }

    /// The same as `add_rows::<true>` for rows of one sample, which need no loop over a row.
    fn add_one(&mut self, phase: usize, samples: &[u16]) -> bool {
        let mut touched = 0;
        let (mut samples, mut phase) = (samples.iter(), phase % SAMPLES_PER_PERIOD);
        while samples.len() > 0 {
            for (bins, sample) in self.bins.iter_mut().skip(phase).zip(&mut samples) {
                let code = u32::from(*sample);
                bins[0] = bins[0].wrapping_add(code);
                // Bit 12 of code + 1 is set from full scale on, that of code - 1 for 0.
                touched |= (code + 1) | code.wrapping_sub(1);
            }
            phase = 0;
        }
        touched & (u32::from(FULL_SCALE) + 1) != 0
    }

    /// Adds rows, the first at `phase`; whether any sample touched a rail, if it is to look.
    #[inline(always)]
    fn add_rows<'a, const LOOK: bool>(&mut self, mut phase: usize, rows: impl Iterator<Item = &'a [u16]>) -> bool {
        // Two samples in a word. Bit 12 of code + 1 is set from full scale on, that of code + 4095 for all but 0; neither
        // sum carries into the other half of the word.
        const RAIL: u32 = 0x1000_1000;
        let (mut any, mut all) = (0, RAIL);
        for row in rows {
            if let Some(bins) = self.bins.get_mut(phase % SAMPLES_PER_PERIOD) {
                let (pairs, last) = row.as_chunks::<2>();
                for ([a, b], [low, high]) in bins.as_chunks_mut::<2>().0.iter_mut().zip(pairs) {
                    let word = u32::from(*low) | u32::from(*high) << 16;
                    // Cannot wrap while the duties are kept; a wrapped sum is better than a stopped board.
                    *a = a.wrapping_add(word & 0xFFFF);
                    *b = b.wrapping_add(word >> 16);
                    if LOOK {
                        any |= word.wrapping_add(0x0001_0001);
                        all &= word.wrapping_add(0x0FFF_0FFF);
                    }
                }
                if let (Some(bin), [last]) = (bins.get_mut(row.len() - last.len()), last) {
                    let code = u32::from(*last);
                    *bin = bin.wrapping_add(code);
                    if LOOK {
                        any |= code.wrapping_add(1);
                        all &= code.wrapping_add(0x0FFF) | 0xFFFF_0000;
                    }
                }
            }
            phase += 1;
        }
        LOOK && (any & RAIL != 0 || all & RAIL != RAIL)
    }

    #[cold]
    fn name_railed(&mut self, samples: &[u16], channels: usize) {
        for row in samples.chunks_exact(channels.max(1)) {
            for (channel, sample) in row.iter().enumerate() {
                if *sample == 0 || *sample >= FULL_SCALE {
                    self.railed |= 1 << channel;
                }
            }
        }
    }

    /// Whole periods folded so far.
    pub fn periods(&self) -> u16 {
        // Cannot be more: see `add`.
        (self.quarters / QUARTERS) as u16
    }

    /// Quarter periods folded so far.
    pub fn quarters(&self) -> u32 {
        self.quarters
    }

    /// The folded period of a channel, beginning with phase 0; zeros for a channel that is not there.
    pub fn period(&self, channel: usize) -> [u32; SAMPLES_PER_PERIOD] {
        self.bins.each_ref().map(|bins| bins.get(channel).copied().unwrap_or(0))
    }

    /// Whether any sample of the channel touched a rail of the converter.
    pub fn railed(&self, channel: usize) -> bool {
        channel < MAX_CHANNELS && self.railed >> channel & 1 == 1
    }

    /// Correlates a channel's period with the reference, and scatters what the reference cannot see.
    #[inline]
    pub fn correlate(&self, channel: usize) -> (Phasor, Scatter) {
        let [zero, one, two, three, four, five, six, seven] = self.parts(channel);
        let ([_, s1, s2, s3, s4, ..], product) = (SINE, |a: i32, b: i32| i64::from(a) * i64::from(b));
        // The sine is the same at k and 8 - k, the cosine the opposite, and one is the other a quarter period later.
        let phasor = Phasor {
            in_phase: product(one.odd.wrapping_add(seven.odd), s1)
                + product(two.odd.wrapping_add(six.odd), s2)
                + product(three.odd.wrapping_add(five.odd), s3)
                + product(four.odd, s4),
            quadrature: product(zero.odd, s4)
                + product(one.odd.wrapping_sub(seven.odd), s3)
                + product(two.odd.wrapping_sub(six.odd), s2)
                + product(three.odd.wrapping_sub(five.odd), s1),
        };
        let (mut sum, mut squares) = (0u32, 0u64);
        for part in [zero, one, two, three, four, five, six, seven] {
            sum = sum.wrapping_add(part.even);
            squares = squares.wrapping_add(u64::from(part.even) * u64::from(part.even));
        }
        // Eight times the sum of squares about the mean: Cauchy says that it is not negative.
        let square = u64::from(sum) * u64::from(sum);
        let scatter = squares.wrapping_mul(HALF as u64).wrapping_sub(square);
        (
            phasor,
            Scatter {
                sum: scatter,
                channels: 1,
            },
        )
    }

    /// The odd and the even part of a channel's period. In the odd part equal samples cancel, to the last bit.
    #[inline]
    fn parts(&self, channel: usize) -> [Part; HALF] {
        let (early, late) = self.bins.split_at(HALF);
        let mut out = [Part { odd: 0, even: 0 }; HALF];
        for ((part, a), b) in out.iter_mut().zip(early).zip(late) {
            if let (Some(a), Some(b)) = (a.get(channel), b.get(channel)) {
                *part = Part {
                    odd: a.wrapping_sub(*b) as i32,
                    even: a.wrapping_add(*b),
                };
            }
        }
        out
    }
}

/// Two bins half a period apart: their difference and their sum.
#[derive(Clone, Copy)]
struct Part {
    odd: i32,
    even: u32,
}

/// How much the even part of folded periods scatters about its mean. A sine in step with the excitation has no even part,
/// so that whatever it has is noise, settling, drift, or clipping on one side. Eight sums of two bins have seven degrees
/// of freedom.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Scatter {
    sum: u64,
    channels: u16,
}

impl Scatter {
    /// Of no channel.
    pub const NONE: Self = Self { sum: 0, channels: 0 };

    /// Takes another channel's in; sums stop at their largest.
    pub fn add(&mut self, other: Self) {
        self.sum = self.sum.saturating_add(other.sum);
        self.channels = self.channels.saturating_add(other.channels);
    }

    /// Variance of one sample, when `periods` were folded: a bin has `periods` times that, the sum of two bins twice as
    /// much, and the scatter of a channel is on average 8 * 7 times that.
    pub fn variance(self, periods: u16) -> Variance {
        const PER_SAMPLE: u64 = (HALF * (HALF - 1) * 2) as u64;
        let samples = PER_SAMPLE * u64::from(periods) * u64::from(self.channels);
        // 256ths; a scatter too large for that is beyond any variance of 12 bits.
        let parts = self.sum.saturating_mul(256).checked_div(samples).unwrap_or(0);
        Variance::new(parts.min(u32::MAX.into()) as u32)
    }
}
