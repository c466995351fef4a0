//! Rows of samples into bins, and the look at the rails on the way.

use super::{Folded, LOW_BITS, MAX_CHANNELS, PERIODS_A_SPILL, WORDS};
use crate::codes::FULL_SCALE;
use crate::reference::SAMPLES_PER_PERIOD;

impl Folded {
    /// Adds samples of one channel, the first at `phase`; whether any touched a rail.
    pub(super) fn add_one(&mut self, phase: usize, samples: &[u16]) -> bool {
        let mut touched = 0;
        let (mut samples, mut phase) = (samples.iter(), phase % SAMPLES_PER_PERIOD);
        while samples.len() > 0 {
            for (bins, sample) in self.bins.iter_mut().skip(phase).zip(&mut samples) {
                let code = u32::from(*sample);
                // Cannot wrap while the duties are kept; a wrapped sum is better than a stopped board.
                bins[0] = bins[0].wrapping_add(code);
                touched |= rails(code);
            }
            phase = 0;
        }
        touched & (u32::from(FULL_SCALE) + 1) != 0
    }

    /// Adds rows of `N` samples, an even number, the first at `phase`; whether any sample touched a rail, if it is to look.
    #[inline(always)]
    pub(super) fn add_rows<const N: usize, const LOOK: bool>(&mut self, mut phase: usize, samples: &[u16]) -> bool {
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
    pub(super) fn add_any(&mut self, mut phase: usize, samples: &[u16], channels: usize) -> bool {
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

    /// Adds rows of sixteen wide codes; whether any touched a rail, if it is to look.
    #[inline(never)]
    pub(super) fn add_wide_rows<const LOOK: bool>(&mut self, mut phase: usize, samples: &[u16]) -> bool {
        let mut touched = 0;
        for row in samples.as_chunks::<MAX_CHANNELS>().0 {
            if let Some(bins) = self.bins.get_mut(phase % SAMPLES_PER_PERIOD) {
                // Two samples are one word in memory.
                for (two, pair) in bins.as_chunks_mut::<2>().0.iter_mut().zip(row.as_chunks::<2>().0) {
                    let word = pack(pair);
                    let (low, high) = (word & 0xFFFF, word >> 16);
                    let [first, second] = two;
                    *first = first.wrapping_add(low);
                    *second = second.wrapping_add(high);
                    if LOOK {
                        touched |= rails(low) | rails(high);
                    }
                }
            }
            phase += 1;
        }
        touched >> self.bits & 1 == 1
    }

    /// The same for any number of channels.
    #[inline(never)]
    pub(super) fn add_wide(&mut self, mut phase: usize, samples: &[u16], channels: usize) -> bool {
        let mut touched = 0;
        for row in samples.chunks_exact(channels) {
            if let Some(bins) = self.bins.get_mut(phase % SAMPLES_PER_PERIOD) {
                for (bin, sample) in bins.iter_mut().zip(row) {
                    let code = u32::from(*sample);
                    *bin = bin.wrapping_add(code);
                    touched |= rails(code);
                }
            }
            phase += 1;
        }
        touched >> self.bits & 1 == 1
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
}

/// Of a code of n bits bit n is set here if it touches a rail: that of code + 1 from full scale on, that of code - 1 for 0.
#[inline]
fn rails(code: u32) -> u32 {
    (code + 1) | code.wrapping_sub(1)
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
