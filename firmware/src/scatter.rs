//! The noise of samples, from what the reference cannot see of them.

use crate::reference::HALF;
use protocol::Variance;

/// How much the even part of folded periods scatters about its mean. A sine in step with the excitation has no even part,
/// so that whatever it has is noise, settling, drift, or clipping on one side. Eight sums of two bins have seven degrees
/// of freedom.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Scatter {
    sum: u64,
    channels: u16,
}

/// Degrees of freedom of a variance, in samples of a period and channel: a bin has `periods` times the variance of a sample, the
/// sum of two bins has twice that, and the scatter of a channel is on average 8 * 7 times the variance of the sum.
const PER_SAMPLE: u64 = (HALF * (HALF - 1) * 2) as u64;

impl Scatter {
    /// Of no channel.
    pub const NONE: Self = Self { sum: 0, channels: 0 };

    /// Of one channel.
    pub(crate) const fn of_one(sum: u64) -> Self {
        Self { sum, channels: 1 }
    }

    /// Of one channel whose samples are known to have this variance, in 256ths of a squared code.
    pub(crate) fn of_variance(parts: u32, periods: u16) -> Self {
        // Below 2^32 * 2^7 * 2^16.
        Self::of_one((u64::from(parts) * PER_SAMPLE * u64::from(periods)).div_ceil(256))
    }

    /// The same in units of 2^extra codes, rounded down.
    pub(crate) fn in_units_of(self, extra: u32) -> Self {
        Self {
            sum: self.sum >> (2 * extra),
            ..self
        }
    }

    /// Takes another channel's in; sums stop at their largest.
    pub fn add(&mut self, other: Self) {
        self.sum = self.sum.saturating_add(other.sum);
        self.channels = self.channels.saturating_add(other.channels);
    }

    /// Variance of one sample, when `periods` were folded.
    pub fn variance(self, periods: u16) -> Variance {
        let samples = PER_SAMPLE * u64::from(periods) * u64::from(self.channels);
        // 256ths; a scatter too large for that is beyond any variance of 12 bits.
        let parts = self.sum.saturating_mul(256).checked_div(samples).unwrap_or(0);
        Variance::new(parts.min(u32::MAX.into()) as u32)
    }
}
