//! Bins into phasors.

use super::{Folded, IN_PHASE, MAX_CHANNELS, QUADRATURE, VARIANCE, word_of};
use crate::codes::extra_bits;
use crate::phasor::Phasor;
use crate::reference::{HALF, SINE};
use crate::scatter::Scatter;

impl Folded {
    #[inline(always)]
    pub(super) fn correlated(&self, bin: impl Fn(&[u32; MAX_CHANNELS]) -> u32) -> (Phasor, Scatter) {
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
        let scatter = Scatter::of_one(squares.wrapping_mul(HALF as u64).wrapping_sub(square));
        (phasor, scatter)
    }

    /// Correlates a channel of wide codes, and counts it in codes of 12 bits.
    #[inline(never)]
    pub(super) fn wide(&self, channel: usize) -> (Phasor, Scatter) {
        let extra = extra_bits(self.bits);
        let word = channel % MAX_CHANNELS;
        let (phasor, scatter) = self.correlated(|bins| word_of(bins, word));
        (phasor.in_units_of(extra), scatter.in_units_of(extra))
    }

    /// The phasor that a channel was given.
    #[inline(never)]
    pub(super) fn given(&self, channel: usize) -> (Phasor, Scatter) {
        let word = |row: usize| self.bins.get(row).map_or(0, |bins| word_of(bins, channel));
        let periods = self.periods();
        (
            Phasor::of(word(IN_PHASE).cast_signed(), word(QUADRATURE).cast_signed(), periods),
            Scatter::of_variance(word(VARIANCE), periods),
        )
    }
}
