//! Creep of the rubber: pressure from the history of the resistivity.
//!
//! The rubber is a standard linear solid (Zener 1948) whose resistivity rises with its strain:
//!
//! ```text
//! e = J0 p + e1,   tau de1/dt = J1 p - e1,   rise = gauge |e|^exponent
//! ```
//!
//! Strain is counted in units of the instant compliance, `s = e / J0` (MPa), so that the four parameters of [`Solid`] are
//! all that can be told from outside. [`SolidState`] is the solid and its causal, exact inverse.

use thiserror::Error;

/// Parameters of the rubber.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    /// Delayed over instant compliance, J1 / J0: 0 for rubber that does not creep.
    pub delayed_ratio: f64,
    /// Time constant of the delayed part, s.
    pub tau_s: f64,
    /// How the rise grows with the strain: 1 in proportion.
    pub exponent: f64,
    /// Pressure that at once raises the resistivity by its own value (+100 %), MPa. With an exponent of 1 this is the force
    /// of each mm² of integrated instant rise, N/mm².
    pub unit_rise_mpa: f64,
}

/// A parameter of a [`Solid`] that no rubber has.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{name} is {value}; give {wanted}")]
pub struct SolidError {
    /// The parameter.
    pub name: &'static str,
    /// What it is.
    pub value: f64,
    /// What it may be.
    pub wanted: &'static str,
}

impl Solid {
    /// Checks that all parameters are those of a solid.
    ///
    /// # Errors
    /// [`SolidError`] names the first that is not.
    pub fn check(&self) -> Result<(), SolidError> {
        let positive = |value: f64| value.is_finite() && value > 0.0;
        let wrong = |name, value, wanted| Err(SolidError { name, value, wanted });
        if !(self.delayed_ratio.is_finite() && self.delayed_ratio >= 0.0) {
            return wrong("delayed_ratio", self.delayed_ratio, "0 or a positive number");
        }
        for (name, value) in [
            ("tau_s", self.tau_s),
            ("exponent", self.exponent),
            ("unit_rise_mpa", self.unit_rise_mpa),
        ] {
            if !positive(value) {
                return wrong(name, value, "a positive number");
            }
        }
        Ok(())
    }

    /// Strain (MPa of instant pressure) that has a relative rise of the resistivity; 0 for a fall.
    pub fn strain_mpa(&self, rise: f64) -> f64 {
        self.unit_rise_mpa * rise.max(0.0).powf(1.0 / self.exponent)
    }

    /// Relative rise of the resistivity at a strain (MPa of instant pressure) of either sign.
    pub fn rise(&self, strain_mpa: f64) -> f64 {
        (strain_mpa.abs() / self.unit_rise_mpa).powf(self.exponent)
    }

    /// Advance over an interval of `dt_s`; a negative one counts as 0.
    pub fn step(&self, dt_s: f64) -> Step {
        let h = dt_s.max(0.0) / self.tau_s;
        if h == 0.0 {
            return Step {
                keep: 1.0,
                before: 0.0,
                now: 0.0,
            };
        }
        let keep = (-h).exp();
        let mean = -(-h).exp_m1() / h;
        // The differences lose digits for short intervals, where the series is exact.
        let (before, now) = if h < 1e-2 {
            (
                h / 2.0 - h * h / 3.0 + h.powi(3) / 8.0 - h.powi(4) / 30.0 + h.powi(5) / 144.0,
                h / 2.0 - h * h / 6.0 + h.powi(3) / 24.0 - h.powi(4) / 120.0 + h.powi(5) / 720.0,
            )
        } else {
            (mean - keep, 1.0 - mean)
        };
        Step {
            keep,
            before: self.delayed_ratio * before,
            now: self.delayed_ratio * now,
        }
    }

    /// Largest error of the pressure over the largest error of the strain that causes it, whatever the history: the inverse's
    /// response to an impulse is `delta(t) - (k / tau) exp(-(1 + k) t / tau)` with k the delayed ratio, whose absolute integral
    /// is `1 + k / (1 + k)`, always below 2.
    pub fn worst_gain(&self) -> f64 {
        1.0 + self.delayed_ratio / (1.0 + self.delayed_ratio)
    }
}

/// The exact solution of `tau dq/dt = k p - q` over an interval in which p changes linearly:
/// `q = keep q + before p(start) + now p(end)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    keep: f64,
    before: f64,
    now: f64,
}

/// Where a piece of rubber is: the pressure at the last time and the delayed part of its strain, both MPa.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SolidState {
    /// Pressure at the last time, MPa.
    pub pressure_mpa: f64,
    /// Delayed part of the strain, MPa of instant pressure.
    pub delayed_mpa: f64,
}

impl SolidState {
    /// The solid: its strain (MPa) at the end of an interval that ends with this pressure (MPa).
    pub fn press(&mut self, step: &Step, pressure_mpa: f64) -> f64 {
        self.delayed_mpa = step.keep * self.delayed_mpa + step.before * self.pressure_mpa + step.now * pressure_mpa;
        self.pressure_mpa = pressure_mpa;
        pressure_mpa + self.delayed_mpa
    }

    /// Its inverse: the pressure (MPa) at the end of an interval at whose end there is this strain (MPa).
    ///
    /// Stable for any intervals: its one pole is at `-(1 + k) / tau`. The gain is 1 for what changes at once and falls to
    /// `1 / (1 + k)` for what is slow, so the noise of the pressure is never more than that of the strain; see
    /// [`Solid::worst_gain`] for any other error.
    pub fn pressure(&mut self, step: &Step, strain_mpa: f64) -> f64 {
        let settled = step.keep * self.delayed_mpa + step.before * self.pressure_mpa;
        let pressure_mpa = (strain_mpa - settled) / (1.0 + step.now);
        self.delayed_mpa = settled + step.now * pressure_mpa;
        self.pressure_mpa = pressure_mpa;
        pressure_mpa
    }
}

#[cfg(test)]
mod tests;
