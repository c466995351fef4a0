//! Amplitude and phase of one channel: turned back by the skew of its samples, and rounded to a value.

use crate::reference::{FRACTION, HALF, ONE, SAMPLES_PER_PERIOD};
use protocol::Value;

/// The sums of a correlation, in ADC codes of 12 bits times 2^30 times samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Phasor {
    /// With the sine: in phase with the excitation.
    pub in_phase: i64,
    /// With the cosine: a quarter period ahead of it.
    pub quadrature: i64,
}

/// An angle by which a channel's samples come late.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rotation {
    cos: i32,
    sin: i32,
}

// A value's unit is `periods * 2^UNIT` of a phasor: a sine of amplitude A codes sums to `8 A 2^30` in a period.
const UNIT: u32 = FRACTION + HALF.ilog2() - (Value::PER_CODE as u32).ilog2();

impl Rotation {
    /// No skew.
    pub const NONE: Self = Self { cos: ONE, sin: 0 };

    /// For a channel sampled `ticks` after the row's first one, where samples are `ticks_per_sample` apart. More than a
    /// sample's time counts as a sample's time. The angle is right to 2^-29.
    pub fn new(ticks: u32, ticks_per_sample: u32) -> Self {
        /// 2 pi / 16 with 32 bits of fraction.
        const SAMPLE: u64 = 1_686_629_713;
        let sample = u64::from(ticks_per_sample).max(1);
        let x = (u64::from(ticks).min(sample) * SAMPLE / sample) as i64;
        let (mut cos, mut sin) = (1i64 << 32, x);
        let (mut even, mut odd) = (cos, sin);
        for n in 1..6 {
            even = -((((even * x) >> 32) * x) >> 32) / ((2 * n - 1) * (2 * n));
            odd = -((((odd * x) >> 32) * x) >> 32) / ((2 * n) * (2 * n + 1));
            cos += even;
            sin += odd;
        }
        let fixed = |v: i64| ((v + 2) >> (32 - FRACTION)) as i32;
        Self {
            cos: fixed(cos),
            sin: fixed(sin),
        }
    }
}

/// `a b / 2^30`, rounded down; a below 2^61, b not above 2^30.
#[inline]
fn scaled(a: i64, b: i32) -> i64 {
    // In two halves, so that 64 bits are enough: a = high 2^32 + low.
    let (high, low) = (a >> 32, a & 0xFFFF_FFFF);
    ((high * i64::from(b)) << (32 - FRACTION)) + ((low * i64::from(b)) >> FRACTION)
}

/// Bits of fraction of a [`Reading`](crate::Reading)'s amplitudes.
const READING: u32 = 20;

impl Phasor {
    /// What a lock-in of so many periods would sum of these amplitudes, in 2^-20 codes.
    pub(crate) fn of(in_phase: i32, quadrature: i32, periods: u16) -> Self {
        // Below 2^31 * 2^16 * 2^13 = 2^60.
        let sum = |a: i32| (i64::from(a) * i64::from(periods)) << (FRACTION + HALF.ilog2() - READING);
        Self {
            in_phase: sum(in_phase),
            quadrature: sum(quadrature),
        }
    }

    /// The same in units of 2^extra codes, rounded towards zero: values round to the nearest, as before.
    pub(crate) fn in_units_of(self, extra: u32) -> Self {
        let cut = |sum: i64| if sum < 0 { -(-sum >> extra) } else { sum >> extra };
        Self {
            in_phase: cut(self.in_phase),
            quadrature: cut(self.quadrature),
        }
    }

    /// [`Phasor::in_phase`] of what the sums would be had the samples come at their time: half the work where the
    /// quadrature is not wanted.
    #[inline]
    pub fn in_phase_turned_back(self, by: Rotation) -> i64 {
        if by == Rotation::NONE {
            return self.in_phase;
        }
        scaled(self.in_phase, by.cos) + scaled(self.quadrature, by.sin)
    }

    /// What the sums would be had the samples come at their time.
    pub fn turned_back(self, by: Rotation) -> Self {
        if by == Rotation::NONE {
            return self;
        }
        Self {
            in_phase: self.in_phase_turned_back(by),
            quadrature: scaled(self.quadrature, by.cos) - scaled(self.in_phase, by.sin),
        }
    }

    /// In-phase amplitude after `periods`, rounded to the nearest sixteenth of a code of 12 bits, and whether it
    /// fitted. Zero periods have no amplitude.
    pub fn in_phase_value(self, periods: u16) -> (Value, bool) {
        value(self.in_phase, periods)
    }

    /// Quadrature amplitude in the same way.
    pub fn quadrature_value(self, periods: u16) -> (Value, bool) {
        value(self.quadrature, periods)
    }
}

/// `sum / (periods * 2^UNIT)` to the nearest, halves away from zero.
fn value(sum: i64, periods: u16) -> (Value, bool) {
    // Rounding down twice, by 2^UNIT and then by the periods, is rounding down once: the division needs 32 bits only.
    let half = u64::from(periods) << (UNIT - 1);
    let units = ((sum.unsigned_abs() + half) >> UNIT).min(u32::MAX.into()) as u32;
    let magnitude = i64::from(units.checked_div(periods.into()).unwrap_or(0));
    Value::saturating(if sum < 0 { -magnitude } else { magnitude })
}

const _: () = assert!(SAMPLES_PER_PERIOD == 2 * HALF);

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_product_in_halves_is_the_product(a in -(1i64 << 61)..1i64 << 61, b in -ONE..=ONE) {
            prop_assert_eq!(i128::from(scaled(a, b)), (i128::from(a) * i128::from(b)) >> FRACTION);
        }

        #[test]
        fn rounding_twice_is_rounding_once(sum in -(1i64 << 61)..1i64 << 61, periods in 1..=u16::MAX) {
            let unit = i128::from(periods) << UNIT;
            let exact = (2 * i128::from(sum).abs() + unit) / (2 * unit) * i128::from(sum.signum());
            let (v, fitted) = value(sum, periods);
            prop_assert_eq!(fitted, i16::try_from(exact).is_ok());
            prop_assert_eq!(i128::from(v.sixteenths()), exact.clamp(-32_768, 32_767));
        }

        #[test]
        fn angles_are_right(ticks in 0..=1425u32) {
            let r = Rotation::new(ticks, 1425);
            let x = core::f64::consts::TAU / 16.0 * f64::from(ticks) / 1425.0;
            prop_assert!((f64::from(r.cos) / f64::from(ONE) - x.cos()).abs() < 2e-9);
            prop_assert!((f64::from(r.sin) / f64::from(ONE) - x.sin()).abs() < 2e-9);
        }
    }

    #[test]
    fn no_ticks_are_no_rotation() {
        assert_eq!(Rotation::new(0, 1425), Rotation::NONE);
        assert_eq!(Rotation::new(5000, 1425), Rotation::new(1425, 1425));
    }
}
