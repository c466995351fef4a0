//! Integrate-and-dump lock-in: fold whole periods onto one, then correlate that one with the reference.
//!
//! Folding sums all samples of one phase in a bin. The sum of samples times reference over all periods equals the sum of bins
//! times reference over one period, to the last bit. A sample costs one addition instead of two multiplications and two
//! additions.
//!
//! Overflow budget, with codes of 12 bits and at most [`MAX_PERIODS`] periods:
//!
//! | number | bound | bits | held in |
//! |---|---|---|---|
//! | sample | 4095 | 12 | u16 |
//! | bin: sum of one phase's samples | 4095 * 65535 | 28 | u32 |
//! | low part of a bin: what 4096 leaves of it, and 15 samples | 4095 + 15 * 4095 | 16 | half a u32 |
//! | high part of a bin, in 4096s | 4095 * 65535 / 4096 | 16 | half a u32 |
//! | odd part: bin less the bin half a period later | the same, signed | 29 | i32 |
//! | reference | 2^30 | 31 signed | i32 |
//! | sum or difference of two odd parts | 2 * 4095 * 65535 | 30 signed | i32 |
//! | sum of 4 products of those | 2^29 * 2^30 * 4 | 62 signed | i64 |
//! | even part: bin and the bin half a period later | 2 * 4095 * 65535 | 29 | u32 |
//! | sum of 8 even parts | 16 * 4095 * 65535 | 32 | u32 |
//! | 8 times the sum of the squares of 8 even parts | 64 * (2 * 4095 * 65535)^2 | 64 | u64 |
//!
//! Where several channels are sampled at once, a bin has a low and a high part, and the parts of two channels share a word:
//! two samples are one addition, as they come from memory. After 15 periods at the latest the bits above 12 are carried over
//! to the high part.

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

/// Most periods that the low part of a bin takes before its bits above [`LOW_BITS`] are carried over to the high part. As many
/// as 16 bits hold beside the rest; fewer carry over more often.
const PERIODS_A_SPILL: u32 = 15;
/// Bits that stay in the low part.
const LOW_BITS: u32 = 12;
/// Words of the low and of the high parts of a phase's bins.
const WORDS: usize = MAX_CHANNELS / 2;

// The budget of the table above.
const _: () = assert!((1 << LOW_BITS) - 1 + PERIODS_A_SPILL * FULL_SCALE as u32 <= u16::MAX as u32);
const _: () = assert!(MAX_BIN >> LOW_BITS <= u16::MAX as u64);
const _: () = assert!(2 * MAX_BIN <= i32::MAX as u64);
const _: () = assert!(2 * MAX_BIN as i64 <= i64::MAX / (HALF as i64 / 2 * ONE as i64));
const _: () = assert!(SAMPLES_PER_PERIOD as u64 * MAX_BIN <= u32::MAX as u64);
const _: () = assert!((2 * MAX_BIN).checked_pow(2).is_some());
const _: () = assert!((2 * MAX_BIN).pow(2) <= u64::MAX / (HALF * HALF) as u64);

/// Why a block was not folded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FoldError {
    /// It does not hold whole quarter periods of the expected number of channels.
    Shape,
    /// More than [`MAX_PERIODS`] in all.
    TooManyPeriods,
}

/// One period, each sample the sum of that phase's samples in all periods folded, for up to [`MAX_CHANNELS`] channels.
#[derive(Clone, Debug)]
pub struct Folded {
    /// By phase. One channel has its bin in word 0. Several channels have their low parts in the first [`WORDS`] words, two
    /// channels in a word in the order of the samples. Their high parts, once there are any, are in the words after those.
    bins: [[u32; MAX_CHANNELS]; SAMPLES_PER_PERIOD],
    /// Most samples added to any low part since the last spill, and whether there was one.
    unspilled: u32,
    spilled: bool,
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
            unspilled: 0,
            spilled: false,
            railed: 0,
            channels: 1,
            quarters: 0,
        }
    }

    /// Empties all bins and makes ready for blocks of `channels` (1 to [`MAX_CHANNELS`]).
    pub fn reset(&mut self, channels: u8) {
        match channels {
            1 => self.bins.iter_mut().for_each(|bins| bins[0] = 0),
            // The high parts are written before they are read.
            _ => self.bins.iter_mut().for_each(|bins| bins[..WORDS].fill(0)),
        }
        (self.unspilled, self.spilled) = (0, false);
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
        let touched = match (self.channels, block.rails) {
            (1, _) => self.add_one(phase, block.samples),
            // The loops that count: their length is known.
            (16, Rails::Clear) => self.add_rows::<MAX_CHANNELS, false>(phase, block.samples),
            (16, Rails::Unknown) => self.add_rows::<MAX_CHANNELS, true>(phase, block.samples),
            (_, _) => self.add_any(phase, block.samples, channels.max(1)),
        } && block.rails == Rails::Unknown;
        if touched {
            self.name_railed(block.samples, channels);
        }
        self.quarters = quarters;
        Ok(())
    }

    /// Adds samples of one channel, the first at `phase`; whether any touched a rail.
    fn add_one(&mut self, phase: usize, samples: &[u16]) -> bool {
        let mut touched = 0;
        let (mut samples, mut phase) = (samples.iter(), phase % SAMPLES_PER_PERIOD);
        while samples.len() > 0 {
            for (bins, sample) in self.bins.iter_mut().skip(phase).zip(&mut samples) {
                let code = u32::from(*sample);
                // Cannot wrap while the duties are kept; a wrapped sum is better than a stopped board.
                bins[0] = bins[0].wrapping_add(code);
                // Bit 12 of code + 1 is set from full scale on, that of code - 1 for 0.
                touched |= (code + 1) | code.wrapping_sub(1);
            }
            phase = 0;
        }
        touched & (u32::from(FULL_SCALE) + 1) != 0
    }

    /// Adds rows of `N` samples, an even number, the first at `phase`; whether any sample touched a rail, if it is to look.
    #[inline(always)]
    fn add_rows<const N: usize, const LOOK: bool>(&mut self, mut phase: usize, samples: &[u16]) -> bool {
        let mut rails = RailCheck::NONE;
        for rows in samples
            .as_chunks::<N>()
            .0
            .chunks(PERIODS_A_SPILL as usize * SAMPLES_PER_PERIOD)
        {
            self.make_room(rows.len());
            for row in rows {
                if let Some(bins) = self.bins.get_mut(phase % SAMPLES_PER_PERIOD) {
                    for (bin, pair) in bins.iter_mut().take(WORDS).zip(row.as_chunks::<2>().0) {
                        let word = pack(pair);
                        *bin = bin.wrapping_add(word);
                        if LOOK {
                            rails.look(word);
                        }
                    }
                }
                phase += 1;
            }
        }
        LOOK && rails.touched()
    }

    /// The same for any number of channels.
    fn add_any(&mut self, mut phase: usize, samples: &[u16], channels: usize) -> bool {
        let mut rails = RailCheck::NONE;
        for rows in samples.chunks(PERIODS_A_SPILL as usize * SAMPLES_PER_PERIOD * channels) {
            self.make_room(rows.len() / channels);
            for row in rows.chunks_exact(channels) {
                if let Some(bins) = self.bins.get_mut(phase % SAMPLES_PER_PERIOD) {
                    let (pairs, last) = row.as_chunks::<2>();
                    let mut bins = bins.iter_mut().take(WORDS);
                    for (pair, bin) in pairs.iter().zip(&mut bins) {
                        let word = pack(pair);
                        *bin = bin.wrapping_add(word);
                        rails.look(word);
                    }
                    if let (Some(bin), [last]) = (bins.next(), last) {
                        *bin = bin.wrapping_add(u32::from(*last));
                        // Beside it a code that touches nothing.
                        rails.look(pack(&[*last, 1]));
                    }
                }
                phase += 1;
            }
        }
        rails.touched()
    }

    /// Makes sure that so many rows more, [`PERIODS_A_SPILL`] periods at most, can be added to the low parts.
    #[inline]
    fn make_room(&mut self, rows: usize) {
        let more = rows.div_ceil(SAMPLES_PER_PERIOD) as u32;
        if self.unspilled + more > PERIODS_A_SPILL {
            self.spill();
            self.unspilled = 0;
        }
        self.unspilled += more;
    }

    /// Carries what is above [`LOW_BITS`] over to the high parts.
    #[inline(never)]
    fn spill(&mut self) {
        const REST: u32 = 0x0FFF_0FFF;
        for bins in &mut self.bins {
            let (low, high) = bins.split_at_mut(WORDS);
            for (low, high) in low.iter_mut().zip(high) {
                let over = (*low >> LOW_BITS) & !(REST << (16 - LOW_BITS));
                let before = if self.spilled { *high } else { 0 };
                *high = before.wrapping_add(over);
                *low &= REST;
            }
        }
        self.spilled = true;
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
        match self.channels {
            1 if channel == 0 => self.bins.each_ref().map(|bins| bins[0]),
            channels if channel < usize::from(channels) => self.bins.each_ref().map(|bins| self.bin(bins, channel)),
            _ => [0; SAMPLES_PER_PERIOD],
        }
    }

    /// One of several channels' bin of a phase.
    #[inline]
    fn bin(&self, bins: &[u32; MAX_CHANNELS], channel: usize) -> u32 {
        let (word, shift) = (channel / 2 % WORDS, 16 * (channel % 2));
        let half = |word: usize| word_of(bins, word) >> shift & 0xFFFF;
        let high = if self.spilled { half(WORDS + word) } else { 0 };
        half(word) + (high << LOW_BITS)
    }

    /// Whether any sample of the channel touched a rail of the converter.
    pub fn railed(&self, channel: usize) -> bool {
        channel < MAX_CHANNELS && self.railed >> channel & 1 == 1
    }

    /// Correlates a channel's period with the reference, and scatters what the reference cannot see.
    #[inline]
    pub fn correlate(&self, channel: usize) -> (Phasor, Scatter) {
        // The same in four ways of reading a bin, so that none of them is asked for in the loop.
        let word = channel / 2 % WORDS;
        if channel >= usize::from(self.channels) {
            (Phasor::default(), Scatter { sum: 0, channels: 1 })
        } else if self.channels == 1 {
            self.correlated(|bins| bins[0])
        } else if self.spilled {
            self.correlated(|bins| self.bin(bins, channel))
        } else if channel.is_multiple_of(2) {
            self.correlated(|bins| word_of(bins, word) & 0xFFFF)
        } else {
            self.correlated(|bins| word_of(bins, word) >> 16)
        }
    }

    #[inline(always)]
    fn correlated(&self, bin: impl Fn(&[u32; MAX_CHANNELS]) -> u32) -> (Phasor, Scatter) {
        let (early, late) = self.bins.split_at(HALF);
        let [zero, one, two, three, four, five, six, seven] = early else {
            return (Phasor::default(), Scatter::NONE);
        };
        let [eight, nine, ten, eleven, twelve, thirteen, fourteen, fifteen] = late else {
            return (Phasor::default(), Scatter::NONE);
        };
        let (mut sum, mut squares) = (0u32, 0u64);
        // Two bins half a period apart: what they have in common goes to the scatter; of their difference equal samples are
        // gone, to the last bit.
        let mut odd = |a, b| {
            let (a, b): (u32, u32) = (bin(a), bin(b));
            let even = a.wrapping_add(b);
            sum = sum.wrapping_add(even);
            squares = squares.wrapping_add(u64::from(even) * u64::from(even));
            a.wrapping_sub(b) as i32
        };
        let [_, s1, s2, s3, s4, ..] = SINE;
        let product = |a: i32, b: i32| i64::from(a) * i64::from(b);
        let mut phasor = Phasor {
            in_phase: product(odd(four, twelve), s4),
            quadrature: product(odd(zero, eight), s4),
        };
        // The sine is the same at k and 8 - k, the cosine the opposite, and one is the other a quarter period later. Two bins
        // after the other: what they give is added at once, so that few numbers wait.
        for (a, b, sine, cosine) in [
            ((one, nine), (seven, fifteen), s1, s3),
            ((two, ten), (six, fourteen), s2, s2),
            ((three, eleven), (five, thirteen), s3, s1),
        ] {
            let (a, b) = (odd(a.0, a.1), odd(b.0, b.1));
            phasor.in_phase += product(a.wrapping_add(b), sine);
            phasor.quadrature += product(a.wrapping_sub(b), cosine);
        }
        // Eight times the sum of squares about the mean: Cauchy says that it is not negative.
        let square = u64::from(sum) * u64::from(sum);
        let scatter = Scatter {
            sum: squares.wrapping_mul(HALF as u64).wrapping_sub(square),
            channels: 1,
        };
        (phasor, scatter)
    }
}

/// A word of a phase's bins; there are so many.
#[inline]
fn word_of(bins: &[u32; MAX_CHANNELS], word: usize) -> u32 {
    bins.get(word).copied().unwrap_or(0)
}

/// Two samples in a word, as they are in memory.
#[inline]
fn pack([low, high]: &[u16; 2]) -> u32 {
    u32::from(*low) | u32::from(*high) << 16
}

/// Whether any sample touched a rail, two at a time.
#[derive(Clone, Copy)]
struct RailCheck {
    any: u32,
    all: u32,
}

impl RailCheck {
    /// Bit 12 of code + 1 is set from full scale on, that of code + 4095 for all but 0; neither sum carries into the other half
    /// of the word.
    const RAIL: u32 = 0x1000_1000;
    const NONE: Self = Self {
        any: 0,
        all: Self::RAIL,
    };

    #[inline]
    fn look(&mut self, word: u32) {
        self.any |= word.wrapping_add(0x0001_0001);
        self.all &= word.wrapping_add(0x0FFF_0FFF);
    }

    fn touched(self) -> bool {
        self.any & Self::RAIL != 0 || self.all & Self::RAIL != Self::RAIL
    }
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

    /// Variance of one sample, when `periods` were folded. A bin has `periods` times the variance of a sample; the sum of two
    /// bins has twice that; the scatter of a channel is on average 8 * 7 times the variance of the sum.
    pub fn variance(self, periods: u16) -> Variance {
        const PER_SAMPLE: u64 = (HALF * (HALF - 1) * 2) as u64;
        let samples = PER_SAMPLE * u64::from(periods) * u64::from(self.channels);
        // 256ths; a scatter too large for that is beyond any variance of 12 bits.
        let parts = self.sum.saturating_mul(256).checked_div(samples).unwrap_or(0);
        Variance::new(parts.min(u32::MAX.into()) as u32)
    }
}
