//! The rubber's parameters from a press-and-hold.
//!
//! The integrated rise under a force F is `total = A (s / (A p1))^n` with `s = F + k w(tau)`. A is the area of the
//! touch, p1 the pressure of a unit rise, w the lag of F with time constant tau.
//!
//! For n = 1 this is linear in 1/p1 and k/p1. Both are eliminated (variable projection, Golub and Pereyra 1973), and
//! tau is searched for. From there Levenberg's and Marquardt's method fits the logarithms of all parameters, with n on
//! demand.

use crate::force::meter::Calibration;
use crate::force::recording::Sample;
use crate::force::solid::{Solid, SolidState};
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Why no parameters could be estimated.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CalibrationError {
    /// Too little of the recording can be used.
    #[error(
        "{pressed} frames under force and {rested} before the press are too few; record at least {least_pressed} and {least_rested}"
    )]
    TooFew {
        /// Frames under force.
        pressed: usize,
        /// Frames before it.
        rested: usize,
        /// Least frames under force.
        least_pressed: usize,
        /// Least frames before it.
        least_rested: usize,
    },
    /// The rise does not follow the force.
    #[error("the rise does not grow with the force; is it the touch under the gauge, and the force in newtons?")]
    NoRise,
    /// Numbers that overflow, or vanish, where they are multiplied.
    #[error("the numbers of the recording are too large or too small to be fitted; give s, N and mm2")]
    Numbers,
    /// The recording does not determine a parameter.
    #[error(
        "the recording does not determine {name}: {value:.3} with a standard error of {error:.3}; hold the press for three time \
         constants or longer, and go on recording after the release{more}"
    )]
    Undetermined {
        /// The parameter.
        name: &'static str,
        /// Its fitted value.
        value: f64,
        /// Its standard error.
        error: f64,
        /// Further advice.
        more: &'static str,
    },
}

/// Which recordings are good enough, and when the rubber counts as creeping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationOptions {
    /// Least samples under force.
    ///
    /// More refuses short recordings; with less the standard errors are themselves uncertain. Chosen by hand.
    pub least_pressed: usize,
    /// Least samples before the press.
    ///
    /// More asks for a longer wait; without any, a recording that begins under load is not noticed. Chosen by hand.
    pub least_rested: usize,
    /// Largest relative standard error of a parameter that counts as determined.
    ///
    /// More accepts recordings that are too short for the time constant; less asks for longer ones. Chosen by hand:
    /// docs/creep.md has standard errors below 3 % for good recordings.
    pub largest_error: f64,
    /// Least delayed ratio, in units of its standard error, of a rubber that surely creeps. Below it a fit without
    /// creep is tried.
    ///
    /// More drops weak creep; less keeps creep that is noise. 3 is passed by noise once in 700 recordings. No
    /// experiment is on record.
    pub least_creep: f64,
    /// Fall of chi-square that creep must bring where its ratio is uncertain.
    ///
    /// More drops weak creep; less keeps creep that is noise. The value is the 99.9 % quantile of chi-square with two
    /// degrees of freedom, one for each parameter of creep.
    pub creep_chi_square: f64,
}

impl Default for CalibrationOptions {
    fn default() -> Self {
        Self {
            least_pressed: 20,
            least_rested: 3,
            largest_error: 0.25,
            least_creep: 3.0,
            creep_chi_square: 13.8,
        }
    }
}

/// Time constants tried for the start, less one. They span four decades, so that neighbours differ by a sixth.
const TIME_CONSTANTS: i32 = 60;
/// Shortest time constant tried, over the length of the recording. The longest is ten times that length.
const SHORTEST: f64 = 1e-3;
const DECADES: f64 = 4.0;

/// Standard errors of the parameters; 0 for one that was not fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StandardErrors {
    /// Of the delayed over the instant compliance.
    pub delayed_ratio: f64,
    /// Of the time constant, s.
    pub tau_s: f64,
    /// Of the exponent.
    pub exponent: f64,
    /// Of the pressure of a unit rise, MPa.
    pub unit_rise_mpa: f64,
}

/// Parameters estimated from a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The parameters, and the noise of a force.
    pub calibration: Calibration,
    /// Standard errors of its parameters.
    pub errors: StandardErrors,
    /// Standard deviation of the integrated rise about the fit, mm², under force.
    pub residual_mm2: f64,
    /// The integrated rise of the fit at every sample, mm².
    pub fitted_mm2: Vec<f64>,
}

/// Fits the parameters: [`fit_by`] at the default options.
///
/// # Errors
/// [`CalibrationError`] says what to record instead.
pub fn fit(samples: &[Sample], with_exponent: bool) -> Result<Fit, CalibrationError> {
    fit_by(samples, with_exponent, &CalibrationOptions::default())
}

/// Fits the parameters, with the exponent on demand. A recording determines the exponent only with more than one force;
/// without the demand it is 1.
///
/// # Errors
/// [`CalibrationError`] says what to record instead.
pub fn fit_by(samples: &[Sample], with_exponent: bool, options: &CalibrationOptions) -> Result<Fit, CalibrationError> {
    let problem = Recording::new(samples, options)?;
    let start = problem.start().ok_or(CalibrationError::NoRise)?;
    if start.delayed_ratio <= 0.0 {
        return problem.finish(start, StandardErrors::default());
    }
    let count = if with_exponent { 4 } else { 3 };
    let (theta, covariance) = problem.levenberg_marquardt(logarithms(&start), count);
    let solid = from_logarithms(&theta);
    let relative = |k: usize| covariance.as_ref().map_or(f64::INFINITY, |c| c[(k, k)].max(0.0).sqrt());
    if relative(1) > 1.0 / options.least_creep
        && let Some(instant) = problem.instant()
        && !problem.is_worse(&instant, &solid, options.creep_chi_square)
    {
        // The delayed part is not above the noise: the instant part alone.
        return problem.finish(instant, StandardErrors::default());
    }
    let exponent_error = if with_exponent { relative(3) } else { 0.0 };
    let more = ["", ", with more than one force"][usize::from(with_exponent)];
    for (name, value, error) in [
        ("unit_rise_mpa", solid.unit_rise_mpa, relative(0)),
        ("delayed_ratio", solid.delayed_ratio, relative(1)),
        ("tau_s", solid.tau_s, relative(2)),
        ("exponent", solid.exponent, exponent_error),
    ] {
        if error.is_nan() || error > options.largest_error {
            let error = error * value;
            return Err(CalibrationError::Undetermined {
                name,
                value,
                error,
                more,
            });
        }
    }
    let errors = StandardErrors {
        unit_rise_mpa: relative(0) * solid.unit_rise_mpa,
        delayed_ratio: relative(1) * solid.delayed_ratio,
        tau_s: relative(2) * solid.tau_s,
        exponent: exponent_error * solid.exponent,
    };
    problem.finish(solid, errors)
}

/// The parameters' logarithms: unit rise, delayed ratio, time constant, exponent.
fn logarithms(s: &Solid) -> [f64; 4] {
    [s.unit_rise_mpa, s.delayed_ratio, s.tau_s, s.exponent].map(f64::ln)
}

/// The solid that has these logarithms of its parameters.
fn from_logarithms(theta: &[f64; 4]) -> Solid {
    let [unit_rise_mpa, delayed_ratio, tau_s, exponent] = theta.map(f64::exp);
    Solid {
        delayed_ratio,
        tau_s,
        exponent,
        unit_rise_mpa,
    }
}

/// A recording that is long enough to be fitted.
struct Recording<'a> {
    samples: &'a [Sample],
    /// Median area of the touch under force, mm².
    area_mm2: f64,
}

impl<'a> Recording<'a> {
    fn new(samples: &'a [Sample], options: &CalibrationOptions) -> Result<Self, CalibrationError> {
        let CalibrationOptions {
            least_pressed,
            least_rested,
            ..
        } = *options;
        let pressed = samples.iter().filter(|s| s.used && s.force_n > 0.0).count();
        let rested = samples
            .iter()
            .take_while(|s| s.force_n <= 0.0)
            .filter(|s| s.used)
            .count();
        if pressed < least_pressed || rested < least_rested {
            return Err(CalibrationError::TooFew {
                pressed,
                rested,
                least_pressed,
                least_rested,
            });
        }
        let mut areas: Vec<f64> = samples
            .iter()
            .filter(|s| s.used && s.force_n > 0.0)
            .filter_map(|s| s.area_mm2)
            .collect();
        areas.sort_by(f64::total_cmp);
        Ok(Self {
            samples,
            // Without any, the area only scales the unit rise of an exponent other than 1.
            area_mm2: areas.get(areas.len() / 2).copied().unwrap_or(1.0),
        })
    }

    /// The lag of the forces (N) at every sample, for a time constant (s).
    fn lags(&self, tau_s: f64) -> Vec<f64> {
        let solid = Solid {
            delayed_ratio: 1.0,
            tau_s,
            exponent: 1.0,
            unit_rise_mpa: 1.0,
        };
        let mut state = SolidState::default();
        let mut before = self.samples[0].time_s;
        let lag = |s: &Sample| {
            let step = solid.step(s.time_s - before);
            before = s.time_s;
            state.press(&step, s.force_n);
            state.delayed_mpa
        };
        self.samples.iter().map(lag).collect()
    }

    /// Integrated rise of a solid at every sample, mm².
    fn model(&self, solid: &Solid) -> Vec<f64> {
        let force = |(s, w): (&Sample, f64)| s.force_n.max(0.0) + solid.delayed_ratio * w;
        let totals = self.samples.iter().zip(self.lags(solid.tau_s)).map(force);
        totals.map(|f| self.area_mm2 * solid.rise(f / self.area_mm2)).collect()
    }

    /// Data minus model at the samples that take part, mm².
    fn residuals(&self, solid: &Solid) -> DVector<f64> {
        let pairs = self.samples.iter().zip(self.model(solid));
        let used: Vec<f64> = pairs.filter(|(s, _)| s.used).map(|(s, m)| s.total_mm2 - m).collect();
        DVector::from_vec(used)
    }

    /// Whether a solid without a delayed part explains the recording worse than one with it, by more than `chi_square`
    /// in units of the residual variance.
    fn is_worse(&self, instant: &Solid, with: &Solid, chi_square: f64) -> bool {
        let squares = [instant, with].map(|s| self.residuals(s).norm_squared());
        let count = self.samples.iter().filter(|s| s.used).count() as f64;
        squares[0] - squares[1] > chi_square * squares[1] / (count - 3.0).max(1.0)
    }

    /// The best solid without a delayed part, in proportion.
    fn instant(&self) -> Option<Solid> {
        let (mut ft, mut ff) = (0.0, 0.0);
        for s in self.samples.iter().filter(|s| s.used) {
            ft += s.force_n * s.total_mm2;
            ff += s.force_n * s.force_n;
        }
        (ft > 0.0).then(|| Solid {
            delayed_ratio: 0.0,
            tau_s: 1.0,
            exponent: 1.0,
            unit_rise_mpa: ff / ft,
        })
    }

    /// The best solid with an exponent of 1, by variable projection over the time constant.
    fn start(&self) -> Option<Solid> {
        let span = self.samples.last()?.time_s - self.samples.first()?.time_s;
        let mut best: Option<(f64, Solid)> = None;
        for k in 0..=TIME_CONSTANTS {
            let tau_s = SHORTEST * span * 10.0_f64.powf(DECADES * f64::from(k) / f64::from(TIME_CONSTANTS));
            let lags = self.lags(tau_s);
            let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
            for (s, w) in self.samples.iter().zip(&lags).filter(|(s, _)| s.used) {
                let row = Vector2::new(s.force_n, *w);
                normal += row * row.transpose();
                right += row * s.total_mm2;
            }
            let Some(found) = normal.cholesky().map(|c| c.solve(&right)) else {
                continue;
            };
            if found[0] <= 0.0 || found[1] <= 0.0 {
                continue;
            }
            let solid = Solid {
                delayed_ratio: found[1] / found[0],
                tau_s,
                exponent: 1.0,
                unit_rise_mpa: 1.0 / found[0],
            };
            let square = self.residuals(&solid).norm_squared();
            if best.as_ref().is_none_or(|(least, _)| square < *least) {
                best = Some((square, solid));
            }
        }
        best.map(|(_, solid)| solid).or_else(|| self.instant())
    }

    /// The best logarithms of the first `count` parameters, and their covariance where it exists.
    fn levenberg_marquardt(&self, mut theta: [f64; 4], count: usize) -> ([f64; 4], Option<DMatrix<f64>>) {
        let mut residuals = self.residuals(&from_logarithms(&theta));
        let mut damping = 1e-3;
        for _ in 0..100 {
            let slopes = self.slopes(&theta, count);
            let normal = slopes.transpose() * &slopes;
            let gradient = slopes.transpose() * &residuals;
            let mut damped = normal.clone();
            for k in 0..count {
                damped[(k, k)] *= 1.0 + damping;
            }
            let Some(step) = damped.cholesky().map(|c| c.solve(&gradient)) else {
                break;
            };
            let mut next = theta;
            for k in 0..count {
                // A factor of e at most: far from the solution the model is not even nearly linear.
                next[k] += step[k].clamp(-1.0, 1.0);
            }
            let then = self.residuals(&from_logarithms(&next));
            if then.norm_squared().is_finite() && then.norm_squared() <= residuals.norm_squared() {
                theta = next;
                residuals = then;
                damping = (0.2 * damping).max(1e-12);
                if step.amax() < 1e-10 {
                    break;
                }
            } else if damping > 1e12 {
                break;
            } else {
                damping *= 8.0;
            }
        }
        let slopes = self.slopes(&theta, count);
        let freedom = residuals.len().saturating_sub(count).max(1) as f64;
        let covariance = (slopes.transpose() * &slopes).cholesky().map(|c| c.inverse());
        (theta, covariance.map(|c| c * (residuals.norm_squared() / freedom)))
    }

    /// Derivatives of the model with respect to the logarithms, by central differences.
    fn slopes(&self, theta: &[f64; 4], count: usize) -> DMatrix<f64> {
        const STEP: f64 = 1e-5;
        let columns: Vec<DVector<f64>> = (0..count)
            .map(|k| {
                let at = |sign: f64| {
                    let mut moved = *theta;
                    moved[k] += sign * STEP;
                    self.residuals(&from_logarithms(&moved))
                };
                (at(-1.0) - at(1.0)) / (2.0 * STEP)
            })
            .collect();
        DMatrix::from_columns(&columns)
    }

    /// The fit of a solid, with the noise about it.
    fn finish(&self, solid: Solid, errors: StandardErrors) -> Result<Fit, CalibrationError> {
        let fitted_mm2 = self.model(&solid);
        // Only under force: without a press nothing is found, without any noise.
        let pressed = self
            .samples
            .iter()
            .zip(&fitted_mm2)
            .filter(|(s, _)| s.used && s.force_n > 0.0);
        let squares: Vec<f64> = pressed.map(|(s, m)| (s.total_mm2 - m).powi(2)).collect();
        let residual_mm2 = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
        // The noise in newtons follows from the slope of the rise at the mean force under load.
        let forces: Vec<f64> = self
            .samples
            .iter()
            .filter(|s| s.force_n > 0.0)
            .map(|s| s.force_n)
            .collect();
        let mean_mpa = forces.iter().sum::<f64>() / forces.len().max(1) as f64 / self.area_mm2;
        let slope_mm2_per_n = solid.exponent * solid.rise(mean_mpa) / mean_mpa;
        let force_sd_n = residual_mm2 / slope_mm2_per_n;
        // Squares of such numbers overflow, or are lost.
        if solid.check().is_err() || !force_sd_n.is_finite() || !fitted_mm2.iter().all(|v| v.is_finite()) {
            return Err(CalibrationError::Numbers);
        }
        Ok(Fit {
            calibration: Calibration { solid, force_sd_n },
            errors,
            residual_mm2,
            fitted_mm2,
        })
    }
}

#[cfg(test)]
mod tests;
