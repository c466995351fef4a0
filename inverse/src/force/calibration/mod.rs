//! The rubber's parameters from a press-and-hold.
//!
//! The rise that a force history leaves is `total = A (s / (A p1))^n` with `s = F + k w(tau)`, w the lag of F with time constant
//! tau. For n = 1 this is linear in 1/p1 and k/p1: those are eliminated (variable projection, Golub and Pereyra 1973) and tau
//! is searched for. From there Levenberg's and Marquardt's method fits the logarithms of all parameters, with n where it is asked
//! for.

use crate::force::meter::Calibration;
use crate::force::recording::Sample;
use crate::force::solid::{Solid, SolidState};
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Why no parameters could be told.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CalibrationError {
    /// Too little of the recording can be used.
    #[error(
        "{pressed} frames under force and {rested} before the press are too few; record at least {LEAST_PRESSED} and {LEAST_RESTED}"
    )]
    TooFew {
        /// Frames under force.
        pressed: usize,
        /// Frames before it.
        rested: usize,
    },
    /// The rise does not follow the force.
    #[error("the rise does not grow with the force; is it the touch under the gauge, and the force in newtons?")]
    NoRise,
    /// A parameter that the recording does not determine.
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
        /// What else would help.
        more: &'static str,
    },
}

const LEAST_PRESSED: usize = 20;
const LEAST_RESTED: usize = 3;
/// Largest relative standard error of a parameter that counts as determined.
const LARGEST_ERROR: f64 = 0.25;
/// Delayed ratio in units of its standard error below which the rubber is taken not to creep.
const LEAST_CREEP: f64 = 3.0;

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

/// Parameters told from a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// What forces are computed with.
    pub calibration: Calibration,
    /// Standard errors of its parameters.
    pub errors: StandardErrors,
    /// Standard deviation of the integrated rise about the fit, mm².
    pub residual_mm2: f64,
    /// The integrated rise that the fit has at every sample, mm².
    pub fitted_mm2: Vec<f64>,
}

/// Fits the parameters; with the exponent too, if asked for, which takes more than one force to tell, else it is 1.
///
/// # Errors
/// [`CalibrationError`] says what to record instead.
pub fn fit(samples: &[Sample], with_exponent: bool) -> Result<Fit, CalibrationError> {
    let problem = Recording::new(samples)?;
    let start = problem.start().ok_or(CalibrationError::NoRise)?;
    if start.delayed_ratio <= 0.0 {
        return Ok(problem.finish(start, StandardErrors::default()));
    }
    let count = if with_exponent { 4 } else { 3 };
    let (theta, covariance) = problem.levenberg_marquardt(logarithms(&start), count);
    let solid = of(&theta);
    let relative = |k: usize| covariance.as_ref().map_or(f64::INFINITY, |c| c[(k, k)].max(0.0).sqrt());
    if relative(1) > 1.0 / LEAST_CREEP
        && let Some(instant) = problem.instant()
        && !problem.is_worse(&instant, &solid)
    {
        // Nothing delayed above the noise: the instant part alone.
        return Ok(problem.finish(instant, StandardErrors::default()));
    }
    let exponent_error = if with_exponent { relative(3) } else { 0.0 };
    let more = ["", ", with more than one force"][usize::from(with_exponent)];
    for (name, value, error) in [
        ("unit_rise_mpa", solid.unit_rise_mpa, relative(0)),
        ("delayed_ratio", solid.delayed_ratio, relative(1)),
        ("tau_s", solid.tau_s, relative(2)),
        ("exponent", solid.exponent, exponent_error),
    ] {
        if error.is_nan() || error > LARGEST_ERROR {
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
    Ok(problem.finish(solid, errors))
}

/// The parameters' logarithms: unit rise, delayed ratio, time constant, exponent.
fn logarithms(s: &Solid) -> [f64; 4] {
    [s.unit_rise_mpa, s.delayed_ratio, s.tau_s, s.exponent].map(f64::ln)
}

fn of(theta: &[f64; 4]) -> Solid {
    let [unit_rise_mpa, delayed_ratio, tau_s, exponent] = theta.map(f64::exp);
    Solid {
        delayed_ratio,
        tau_s,
        exponent,
        unit_rise_mpa,
    }
}

struct Recording<'a> {
    samples: &'a [Sample],
    /// Area under force, mm².
    area_mm2: f64,
}

impl<'a> Recording<'a> {
    fn new(samples: &'a [Sample]) -> Result<Self, CalibrationError> {
        let pressed = samples.iter().filter(|s| s.used && s.force_n > 0.0).count();
        let rested = samples
            .iter()
            .take_while(|s| s.force_n <= 0.0)
            .filter(|s| s.used)
            .count();
        if pressed < LEAST_PRESSED || rested < LEAST_RESTED {
            return Err(CalibrationError::TooFew { pressed, rested });
        }
        let mut areas: Vec<f64> = samples
            .iter()
            .filter(|s| s.used && s.force_n > 0.0)
            .filter_map(|s| s.area_mm2)
            .collect();
        areas.sort_by(f64::total_cmp);
        Ok(Self {
            samples,
            // Without any, it only scales what an exponent other than 1 calls a unit.
            area_mm2: areas.get(areas.len() / 2).copied().unwrap_or(1.0),
        })
    }

    /// Forces and the lag of the forces (N) at every sample, for a time constant.
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

    fn model(&self, solid: &Solid) -> Vec<f64> {
        let force = |(s, w): (&Sample, f64)| s.force_n.max(0.0) + solid.delayed_ratio * w;
        let totals = self.samples.iter().zip(self.lags(solid.tau_s)).map(force);
        totals.map(|f| self.area_mm2 * solid.rise(f / self.area_mm2)).collect()
    }

    fn residuals(&self, solid: &Solid) -> DVector<f64> {
        let pairs = self.samples.iter().zip(self.model(solid));
        let used: Vec<f64> = pairs.filter(|(s, _)| s.used).map(|(s, m)| s.total_mm2 - m).collect();
        DVector::from_vec(used)
    }

    /// Whether a solid without a delayed part explains the recording worse than one with it by more than chance: two
    /// parameters fewer, 99.9 % of chi-square.
    fn is_worse(&self, instant: &Solid, with: &Solid) -> bool {
        let squares = [instant, with].map(|s| self.residuals(s).norm_squared());
        let count = self.samples.iter().filter(|s| s.used).count() as f64;
        squares[0] - squares[1] > 13.8 * squares[1] / (count - 3.0).max(1.0)
    }

    /// Without a delayed part, in proportion.
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

    /// Variable projection over the time constant, in proportion.
    fn start(&self) -> Option<Solid> {
        let span = self.samples.last()?.time_s - self.samples.first()?.time_s;
        let mut best: Option<(f64, Solid)> = None;
        let steps = 60;
        for k in 0..=steps {
            let tau_s = 1e-3 * span * 10.0_f64.powf(4.0 * f64::from(k) / f64::from(steps));
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
        let mut residuals = self.residuals(&of(&theta));
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
            let then = self.residuals(&of(&next));
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

    /// Derivatives of the model by the logarithms, by central differences.
    fn slopes(&self, theta: &[f64; 4], count: usize) -> DMatrix<f64> {
        const STEP: f64 = 1e-5;
        let columns: Vec<DVector<f64>> = (0..count)
            .map(|k| {
                let at = |sign: f64| {
                    let mut moved = *theta;
                    moved[k] += sign * STEP;
                    self.residuals(&of(&moved))
                };
                (at(-1.0) - at(1.0)) / (2.0 * STEP)
            })
            .collect();
        DMatrix::from_columns(&columns)
    }

    fn finish(&self, solid: Solid, errors: StandardErrors) -> Fit {
        let fitted_mm2 = self.model(&solid);
        // Under force: where nothing is pressed, nothing is found, without any noise.
        let pressed = self
            .samples
            .iter()
            .zip(&fitted_mm2)
            .filter(|(s, _)| s.used && s.force_n > 0.0);
        let squares: Vec<f64> = pressed.map(|(s, m)| (s.total_mm2 - m).powi(2)).collect();
        let residual_mm2 = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
        // What that is in newtons where a newton more raises it least steeply: at the mean force under load.
        let forces: Vec<f64> = self
            .samples
            .iter()
            .filter(|s| s.force_n > 0.0)
            .map(|s| s.force_n)
            .collect();
        let mean_mpa = forces.iter().sum::<f64>() / forces.len().max(1) as f64 / self.area_mm2;
        let slope_mm2_per_n = solid.exponent * solid.rise(mean_mpa) / mean_mpa;
        Fit {
            calibration: Calibration {
                solid,
                force_sd_n: residual_mm2 / slope_mm2_per_n,
            },
            errors,
            residual_mm2,
            fitted_mm2,
        }
    }
}

#[cfg(test)]
mod tests;
