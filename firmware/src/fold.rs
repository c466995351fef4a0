//! Integrate-and-dump lock-in: fold whole periods onto one, then correlate that one with the reference.
//!
//! Folding sums all samples of one phase in a bin. The sum of samples times reference over all periods equals the sum of bins
//! times reference over one period, to the last bit. A sample costs one addition instead of two multiplications and two
//! additions.
//!
//! Overflow budget, with codes of 12 to 16 bits and at most [`max_periods`] of so many bits. Each bit more halves the
//! periods, so that a bin has 28 bits for all of them. The compiler checks every line for every number of bits:
//!
//! | number | bound | bits | held in |
//! |---|---|---|---|
//! | sample | 65535 | 16 | u16 |
//! | bin: sum of one phase's samples, B | 4095 * 65535 to 65535 * 4095 | 28 | u32 |
//! | odd part: bin less the bin half a period later | B, signed | 29 | i32 |
//! | reference | 2^30 | 31 signed | i32 |
//! | sum or difference of two odd parts | 2 B | 30 signed | i32 |
//! | sum of 4 products of those | 2^29 * 2^30 * 4 | 62 signed | i64 |
//! | even part: bin and the bin half a period later | 2 B | 29 | u32 |
//! | sum of 8 even parts | 16 B | 32 | u32 |
//! | 8 times the sum of the squares of 8 even parts | 64 * (2 B)^2 | 64 | u64 |
//! | of several channels of 12 bits: low part of a bin, what 4096 leaves and 15 samples | 4095 + 15 * 4095 | 16 | half a u32 |
//! | their high part, in 4096s | 4095 * 65535 / 4096 | 16 | half a u32 |
//!
//! Where several channels of 12 bits are sampled at once, a bin has a low and a high part, and the parts of two channels share
//! a word: two samples are one addition, as they come from memory. After 15 periods at the latest the bits above 12 are
//! carried over to the high part. Wider codes leave no room in half a word: each channel has its own.
//!
//! A front end that gives phasors itself puts them here in the place of samples ([`Folded::put`]).

mod correlation;
mod rows;

use crate::capture::{Block, Rails};
use crate::codes::{FULL_SCALE, LEAST_BITS, MOST_BITS, extra_bits, full_scale, max_periods};
use crate::phasor::Phasor;
use crate::reading::Reading;
use crate::reference::{HALF, ONE, SAMPLES_PER_PERIOD};
use crate::scatter::Scatter;
use protocol::QUARTERS;

/// Most channels sampled at once.
pub const MAX_CHANNELS: usize = 16;

/// Most periods that can be folded of codes of 12 bits: all that a plan can count.
pub const MAX_PERIODS: u16 = max_periods(LEAST_BITS);

/// Largest sum in a bin, of codes of any number of bits.
const MAX_BIN: u64 = max_bin();

const fn max_bin() -> u64 {
    let (mut most, mut bits) = (0, LEAST_BITS);
    while bits <= MOST_BITS {
        let sum = full_scale(bits) as u64 * max_periods(bits) as u64;
        most = if sum > most { sum } else { most };
        bits += 1;
    }
    most
}

/// Most periods that the low part of a bin takes before its bits above [`LOW_BITS`] are carried over to the high part. As many
/// as 16 bits hold beside the rest; fewer carry over more often.
const PERIODS_A_SPILL: u32 = 15;
/// Bits that stay in the low part.
const LOW_BITS: u32 = 12;
/// Words of the low and of the high parts of a phase's bins.
const WORDS: usize = MAX_CHANNELS / 2;

// The budget of the table above.
const _: () = assert!((1 << LOW_BITS) - 1 + PERIODS_A_SPILL * FULL_SCALE as u32 <= u16::MAX as u32);
const _: () = assert!((FULL_SCALE as u64 * MAX_PERIODS as u64) >> LOW_BITS <= u16::MAX as u64);
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
    /// More than [`max_periods`] in all.
    TooManyPeriods,
}

/// What the words of the bins hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layout {
    /// One channel of 12 bits: a phase's bin is its word 0.
    Single,
    /// Several channels of 12 bits: their low parts in the first [`WORDS`] words of a phase, two channels in a word in the
    /// order of the samples. Their high parts, once there are any, are in the words after those.
    Pairs,
    /// Wider codes: a word for each channel.
    Wide,
    /// No samples: rows [`IN_PHASE`], [`QUADRATURE`] and [`VARIANCE`] have a channel's phasor in its word.
    Phasors,
}

impl Layout {
    /// Of one channel of codes of so many bits.
    const fn of_one(bits: u8) -> Self {
        if extra_bits(bits) == 0 {
            Self::Single
        } else {
            Self::Wide
        }
    }
}

/// Rows of [`Layout::Phasors`].
const IN_PHASE: usize = 0;
const QUADRATURE: usize = 1;
const VARIANCE: usize = 2;

/// One period, each sample the sum of that phase's samples in all periods folded, for up to [`MAX_CHANNELS`] channels.
#[derive(Clone, Debug)]
pub struct Folded {
    /// By phase; see [`Layout`].
    bins: [[u32; MAX_CHANNELS]; SAMPLES_PER_PERIOD],
    layout: Layout,
    /// The layout of one channel.
    single: Layout,
    /// Bits of a code.
    bits: u8,
    /// Most samples added to any low part since the last spill, and whether there was one.
    unspilled: u32,
    spilled: bool,
    /// A bit for each channel: whether any sample touched a rail.
    railed: u32,
    channels: u8,
    quarters: u32,
    most_quarters: u32,
}

impl Default for Folded {
    fn default() -> Self {
        Self::new()
    }
}

impl Folded {
    /// Nothing folded, one channel, codes of 12 bits.
    pub const fn new() -> Self {
        Self::of_bits(LEAST_BITS)
    }

    /// Nothing folded, one channel, codes of so many bits: 12 to 16.
    pub const fn of_bits(bits: u8) -> Self {
        Self {
            bins: [[0; MAX_CHANNELS]; SAMPLES_PER_PERIOD],
            layout: Layout::of_one(bits),
            single: Layout::of_one(bits),
            bits,
            unspilled: 0,
            spilled: false,
            railed: 0,
            channels: 1,
            quarters: 0,
            most_quarters: QUARTERS * max_periods(bits) as u32,
        }
    }

    /// Empties all bins and makes ready for blocks of `channels` (1 to [`MAX_CHANNELS`]).
    pub fn reset(&mut self, channels: u8) {
        if channels == 1 {
            // One channel's bin is in word 0, whatever its bits.
            self.layout = self.single;
            self.bins.iter_mut().for_each(|bins| bins[0] = 0);
        } else if self.single == Layout::Single {
            self.layout = Layout::Pairs;
            // The high parts are written before they are read.
            self.bins.iter_mut().for_each(|bins| bins[..WORDS].fill(0));
        } else {
            self.layout = Layout::Wide;
            self.bins.iter_mut().for_each(|bins| bins.fill(0));
        }
        (self.unspilled, self.spilled) = (0, false);
        self.railed = 0;
        self.channels = channels;
        self.quarters = 0;
    }

    /// Adds the quarter periods of a block, each sample to the bin of its phase. Samples are codes, 0 to the highest of their
    /// bits; that is the implementor's duty.
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
            .filter(|q| *q <= self.most_quarters)
            .ok_or(FoldError::TooManyPeriods)?;
        let phase = (block.time % SAMPLES_PER_PERIOD as u64) as usize;
        // A rail is rare and costs a look at every sample to name its channel; that there is none, two instructions each.
        let touched = match (self.layout, self.channels, block.rails) {
            (Layout::Single, ..) => self.add_one(phase, block.samples),
            // The loops that count: their length is known.
            (Layout::Pairs, 16, Rails::Clear) => self.add_rows::<MAX_CHANNELS, false>(phase, block.samples),
            (Layout::Pairs, 16, Rails::Unknown) => self.add_rows::<MAX_CHANNELS, true>(phase, block.samples),
            (Layout::Pairs, ..) => self.add_any(phase, block.samples, channels.max(1)),
            (Layout::Wide, 16, Rails::Clear) => self.add_wide_rows::<false>(phase, block.samples),
            (Layout::Wide, 16, Rails::Unknown) => self.add_wide_rows::<true>(phase, block.samples),
            (Layout::Wide, ..) => self.add_wide(phase, block.samples, channels.max(1)),
            (Layout::Phasors, ..) => return Err(FoldError::Shape),
        } && block.rails == Rails::Unknown;
        if touched {
            self.name_railed(block.samples, channels);
        }
        self.quarters = quarters;
        Ok(())
    }

    #[cold]
    fn name_railed(&mut self, samples: &[u16], channels: usize) {
        let highest = full_scale(self.bits);
        for row in samples.chunks_exact(channels.max(1)) {
            for (channel, sample) in row.iter().enumerate() {
                if *sample == 0 || *sample >= highest {
                    self.railed |= 1 << channel;
                }
            }
        }
    }

    /// Takes the phasors of whole periods in, in the place of samples, one for each channel; all of a window at once.
    ///
    /// # Errors
    /// Another number of channels, or too many periods. Nothing is taken then.
    pub fn put(&mut self, readings: &[Reading], periods: u16) -> Result<(), FoldError> {
        if readings.len() != usize::from(self.channels) || readings.len() > MAX_CHANNELS || periods == 0 {
            return Err(FoldError::Shape);
        }
        let quarters = QUARTERS * u32::from(periods);
        if self.quarters > 0 || quarters > self.most_quarters {
            return Err(FoldError::TooManyPeriods);
        }
        self.layout = Layout::Phasors;
        let rows: [fn(&Reading) -> u32; 3] = [
            |r| r.in_phase.cast_unsigned(),
            |r| r.quadrature.cast_unsigned(),
            |r| r.noise.parts(),
        ];
        for (row, word) in self.bins.iter_mut().zip(rows) {
            for (place, reading) in row.iter_mut().zip(readings) {
                *place = word(reading);
            }
        }
        for (channel, reading) in readings.iter().enumerate() {
            self.railed |= u32::from(reading.clipped) << channel;
        }
        self.quarters = quarters;
        Ok(())
    }

    /// Whether samples were folded; if not, only phasors are known: no shape, no mean.
    pub fn is_sampled(&self) -> bool {
        self.layout != Layout::Phasors
    }

    /// Bits of a sample's code.
    pub fn bits(&self) -> u8 {
        self.bits
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

    /// The folded period of a channel, beginning with phase 0; zeros for a channel that is not there, or that was not sampled.
    pub fn period(&self, channel: usize) -> [u32; SAMPLES_PER_PERIOD] {
        if channel >= usize::from(self.channels) {
            return [0; SAMPLES_PER_PERIOD];
        }
        match self.layout {
            Layout::Single => self.bins.each_ref().map(|bins| bins[0]),
            Layout::Pairs => self.bins.each_ref().map(|bins| self.bin(bins, channel)),
            Layout::Wide => self.bins.each_ref().map(|bins| word_of(bins, channel)),
            Layout::Phasors => [0; SAMPLES_PER_PERIOD],
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
            return (Phasor::default(), Scatter::of_one(0));
        }
        match self.layout {
            Layout::Single => self.correlated(|bins| bins[0]),
            Layout::Pairs if self.spilled => self.correlated(|bins| self.bin(bins, channel)),
            Layout::Pairs if channel.is_multiple_of(2) => self.correlated(|bins| word_of(bins, word) & 0xFFFF),
            Layout::Pairs => self.correlated(|bins| word_of(bins, word) >> 16),
            Layout::Wide => self.wide(channel),
            Layout::Phasors => self.given(channel),
        }
    }
}

/// A word of a phase's bins; there are so many.
#[inline]
fn word_of(bins: &[u32; MAX_CHANNELS], word: usize) -> u32 {
    bins.get(word).copied().unwrap_or(0)
}
