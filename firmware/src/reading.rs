//! What a front end that measures amplitude and phase itself gives for a channel.

use protocol::Variance;

/// Amplitude and phase of one channel, as a front end measured them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Reading {
    /// Amplitude in phase with the excitation, in 2^-20 codes of 12 bits: 2^32 of these are the range that
    /// [`adc_span_uv`](crate::BoardInfo::adc_span_uv) tells.
    pub in_phase: i32,
    /// Amplitude a quarter period ahead of it, in the same units.
    pub quadrature: i32,
    /// Noise, as the variance of one sample of a lock-in with sixteen samples a period that is as noisy: the variance of
    /// `in_phase` times 8 times the periods of the window. The smallest one where it is not known.
    pub noise: Variance,
    /// Whether the converter behind it was overdriven.
    pub clipped: bool,
}
