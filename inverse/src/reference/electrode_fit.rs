//! Where the electrodes are and how well they make contact, estimated from the unpressed sheet's own values.
//!
//! Nobody places electrodes to a tenth of a millimetre, and half a millimetre moves touches by as much as the noise does.
//! But the baseline shows it: each value's logarithm against the model is linear in small moves of the electrodes along
//! the rim and in their contacts. Everything unknown is given a prior and fitted at once (Gauss and Newton, each step a
//! linear Gaussian model): moves, contacts, the common gain, a smooth unevenness of the sheet, and an error of every
//! value. How large these are is chosen by the evidence of the baseline itself (MacKay 1992), so that a sheet that
//! is not like the model keeps its electrodes where they were said to be.

mod amplifiers;

pub use amplifiers::{Amplifier, AmplifierError};

use crate::reference::imager::Imager;
use forward::{Pattern, Sensitivity, Solver};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// What the baseline says of the electrodes.
#[derive(Clone, Debug)]
pub struct ElectrodeFit {
    /// The imager with its electrodes where they were found, and what is still uncertain of them.
    pub imager: Imager,
    /// How far every electrode was moved along the rim, mm.
    pub moved_mm: Vec<f64>,
    /// By what every contact impedance was multiplied.
    pub contact: Vec<f64>,
    /// Relative error of one value that the fit leaves, one standard deviation.
    pub error: f64,
    /// Standard deviation of the sheet's relative unevenness.
    pub unevenness: f64,
    /// Values that disagree with all others and take no part, with what was measured over what was expected.
    pub outliers: Vec<(usize, f64)>,
    /// Amplifiers with a gain or an offset of their own. The values of a gain are divided by it in the fit, those of an offset take no
    /// part.
    pub amplifiers: Vec<Amplifier>,
    /// What the fit leaves of the baseline: relative, root mean square over the values that take part.
    pub misfit: f64,
}

/// Why no electrodes were found.
#[derive(Clone, Debug, PartialEq)]
pub enum NoFit {
    /// Too few values that can be used.
    TooFew,
    /// The sheet that comes out makes no sense: electrodes that overlap, or numbers that are not finite.
    NoSheet,
    /// An electrode would be further from its place than hands put it.
    TooFar {
        /// The electrode, from 0.
        electrode: usize,
        /// By how much it would be moved, mm.
        moved_mm: f64,
        /// The most that is accepted, mm.
        most_mm: f64,
    },
}

/// What is expected of electrodes and sheet before the baseline is looked at. Lengths are for the paper's disc (97.5 mm) and
/// grow with the sheet.
///
/// The candidates span what is built by hand, a factor of three to five apart: the evidence is flat between neighbours.
/// `cargo run --release -p studies --example mismatch` and `--example uneven_sheet` measure what comes of them (docs/results.md,
/// "Misplaced electrodes" and "Uneven sheets"); the single values were chosen by hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElectrodeFitOptions {
    /// Candidates for the relative error of a value, one standard deviation. The largest is for sheets that the model hardly
    /// describes: their electrodes stay where they were said to be.
    pub errors: [f64; 5],
    /// Candidates for the standard deviation of the sheet's relative unevenness.
    pub unevennesses: [f64; 3],
    /// Candidates for the standard deviation of an electrode's place along the rim, mm.
    pub places_mm: [f64; 3],
    /// Candidates for the standard deviation of the logarithm of a contact impedance.
    pub contacts: [f64; 2],
    /// Standard deviation of the logarithm of what all contacts have in common.
    pub common_contact: f64,
    /// Standard deviation of the logarithm of the common gain: nothing is known of it.
    pub gain: f64,
    /// Distance of the bumps that an unevenness is made of, over the sheet's reach. Less follows finer unevenness and takes
    /// longer.
    pub bumps: f64,
    /// Most steps of Gauss and Newton, one model each.
    pub most_rounds: usize,
    /// A step that moves no electrode by more than this is the last, mm.
    pub settled_mm: f64,
    /// Fewest values for every electrode. Fewer cannot tell a place from a contact.
    pub least_values: usize,
    /// Most standard deviations of the widest candidate for a place that an electrode is moved. What is further was not put there by
    /// hand: the baseline is wrong in another way, and the electrodes are left where they were said to be.
    pub most_moves: f64,
    /// A value this many standard deviations from what the others predict is left out. Of 208 with Gaussian errors one is in
    /// 100,000 baselines.
    pub outlier: f64,
    /// A value that is off by less than this part of itself is never left out, and no amplifier is named for less: what it does to the
    /// electrodes is small.
    pub least_outlier: f64,
    /// Most amplifiers with a gain or an offset of their own. More of them are a sheet that is not like the model.
    pub most_amplifiers: usize,
    /// Largest part of the values that are left out as outliers. More of them are a sheet that is not like the model.
    pub most_outliers: f64,
}

impl Default for ElectrodeFitOptions {
    fn default() -> Self {
        Self {
            errors: [3e-4, 1e-3, 3e-3, 1e-2, 3e-2],
            unevennesses: [0.0, 0.02, 0.1],
            places_mm: [0.1, 0.5, 2.0],
            contacts: [0.1, 0.5],
            common_contact: 1.0,
            gain: 10.0,
            bumps: 0.3,
            most_rounds: 4,
            settled_mm: 0.01,
            least_values: 4,
            most_moves: 3.0,
            outlier: 6.0,
            least_outlier: 0.03,
            most_amplifiers: 2,
            most_outliers: 0.05,
        }
    }
}

/// Reach of the paper's disc, mm.
const PAPER_REACH_MM: f64 = 97.5;

/// One choice of the standard deviations.
#[derive(Clone, Copy)]
struct Scales {
    error: f64,
    unevenness: f64,
    place_mm: f64,
    contact: f64,
}

/// The linear model of the baseline's logarithms about some sheet.
struct Linear {
    options: ElectrodeFitOptions,
    /// Which values of the baseline are in use.
    used: Vec<usize>,
    /// What the linear part makes of the logarithms where the electrodes are.
    about: DVector<f64>,
    /// Logarithm of the baseline over the model, for the values in use.
    residual: DVector<f64>,
    /// Its derivatives by the logarithms of the contacts and by the places.
    slopes: DMatrix<f64>,
    /// Covariance that an unevenness of 1 makes.
    uneven: DMatrix<f64>,
    /// Relative error of every value, in units of the common one: small values are less certain.
    spread: DVector<f64>,
}

/// Finds the electrodes of an imager's sheet from a baseline (any unit; not a number where a value is missing). `None` when too few
/// values can be used or what comes out makes no sense; the electrodes are then best left where they are.
pub fn find(imager: &Imager, baseline: &[f64]) -> Option<ElectrodeFit> {
    find_with(imager, baseline, &ElectrodeFitOptions::default()).ok()
}

/// The same with other expectations.
///
/// # Errors
/// [`NoFit`] says why nothing was found.
pub fn find_with(imager: &Imager, baseline: &[f64], options: &ElectrodeFitOptions) -> Result<ElectrodeFit, NoFit> {
    let mut kept = baseline.to_vec();
    let mut outliers: Vec<(usize, f64)> = Vec::new();
    let mut amplifiers: Vec<Amplifier> = Vec::new();
    let most = (options.most_outliers * baseline.len() as f64) as usize;
    loop {
        let (mut fit, linear, scales) = settle(imager, &kept, options)?;
        let (more, amplifier) = linear.stand_out(scales, &kept, &imager.pattern);
        if let Some(amplifier) = amplifier.filter(|_| amplifiers.len() < options.most_amplifiers) {
            for (kept, m) in kept.iter_mut().zip(imager.pattern.measurements()) {
                if amplifier.carries(m) {
                    *kept /= match amplifier.error {
                        AmplifierError::Gain(gain) => gain,
                        AmplifierError::Offset(_) => f64::NAN,
                    };
                }
            }
            amplifiers.push(amplifier);
            continue;
        }
        if more.is_empty() || outliers.len() + more.len() > most {
            (fit.outliers, fit.amplifiers) = (outliers, amplifiers);
            let most_mm =
                options.most_moves * options.places_mm.iter().fold(0.0_f64, |m, p| m.max(*p)) * imager.reach_mm()
                    / PAPER_REACH_MM;
            let far = fit.moved_mm.iter().copied().enumerate();
            return match far.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())) {
                Some((electrode, moved_mm)) if moved_mm.abs() > most_mm => Err(NoFit::TooFar {
                    electrode,
                    moved_mm,
                    most_mm,
                }),
                _ => Ok(fit),
            };
        }
        for (k, _) in &more {
            kept[*k] = f64::NAN;
        }
        outliers.extend(more);
    }
}

/// Steps of Gauss and Newton until the electrodes stay; with the linear model about where they are.
fn settle(
    imager: &Imager,
    baseline: &[f64],
    options: &ElectrodeFitOptions,
) -> Result<(ElectrodeFit, Linear, Scales), NoFit> {
    let sheet = imager.model.sheet();
    let geometry = imager.model.geometry();
    let n = sheet.electrodes.len();
    let reach = imager.reach_mm() / PAPER_REACH_MM;
    let mut at = DVector::zeros(2 * n);
    let mut here = imager.clone();
    let mut linear = Linear::new(&here, baseline, options).ok_or(NoFit::TooFew)?;
    let mut scales = None;
    let mut round = 0;
    loop {
        round += 1;
        // Beyond the linear part: what the values would be if all were linear about the prior's mean.
        let y = &linear.residual + &linear.slopes * &at;
        let s = *scales.get_or_insert_with(|| linear.best(&y, reach));
        let (mean, covariance) = linear.solve(&y, s).ok_or(NoFit::NoSheet)?;
        let step = (&mean - &at).rows(n, n).amax();
        at = mean;
        let found = geometry.displaced(sheet, at.as_slice()).ok_or(NoFit::NoSheet)?;
        here = Imager::new(&found, imager.drive, imager.pattern.clone(), imager.grid.cell_mm())
            .map_err(|_| NoFit::NoSheet)?;
        here.electrode_covariance = Some(covariance);
        let last = round >= options.most_rounds || step <= options.settled_mm * reach;
        // About where the electrodes are now: for the next step, or for what the last one leaves.
        linear = Linear::new(&here, baseline, options).ok_or(NoFit::TooFew)?;
        if last {
            linear.about = &linear.slopes * &at;
            let fit = ElectrodeFit {
                misfit: linear.misfit(),
                imager: here,
                moved_mm: at.rows(n, n).iter().copied().collect(),
                contact: at.rows(0, n).map(f64::exp).iter().copied().collect(),
                error: s.error,
                unevenness: s.unevenness,
                outliers: Vec::new(),
                amplifiers: Vec::new(),
            };
            return Ok((fit, linear, s));
        }
    }
}

impl Linear {
    fn new(imager: &Imager, baseline: &[f64], options: &ElectrodeFitOptions) -> Option<Self> {
        let n = imager.model.electrodes();
        let mut sizes: Vec<f64> = baseline.iter().copied().filter(|v| *v > 0.0 && v.is_finite()).collect();
        sizes.sort_by(f64::total_cmp);
        let middle = *sizes.get(sizes.len() / 2)?;
        let used: Vec<usize> = (0..imager.pattern.len().min(baseline.len()))
            .filter(|k| baseline[*k] > 1e-3 * middle && baseline[*k].is_finite() && imager.model_v[*k] > 0.0)
            .collect();
        if used.len() < options.least_values * n {
            return None;
        }
        let solver = Solver::new(imager.model.clone()).ok()?;
        let all = Sensitivity::by_electrode(&solver).matrix_v(imager.drive, solver.electrode_matrix(), &imager.pattern);
        let slopes = DMatrix::from_fn(used.len(), 2 * n, |k, p| all[(used[k], p)] / imager.model_v[used[k]]);
        let bumps = &imager.sensitivity * bumps(imager, options.bumps);
        let bumps = DMatrix::from_fn(used.len(), bumps.ncols(), |k, p| {
            bumps[(used[k], p)] / imager.model_v[used[k]]
        });
        Some(Self {
            options: *options,
            about: DVector::zeros(used.len()),
            residual: DVector::from_iterator(
                used.len(),
                used.iter().map(|k| (baseline[*k] / imager.model_v[*k]).ln()),
            ),
            slopes,
            uneven: &bumps * bumps.transpose(),
            spread: DVector::from_iterator(used.len(), used.iter().map(|k| (middle / baseline[*k]).hypot(1.0))),
            used,
        })
    }

    /// What the logarithms deviate by from the model but for the common gain, root mean square.
    fn misfit(&self) -> f64 {
        let mean = self.residual.mean();
        self.residual.map(|r| (r - mean).powi(2)).mean().sqrt()
    }

    /// Values that the others do not predict, with measured over predicted; or an amplifier that does so better.
    fn stand_out(&self, s: Scales, baseline: &[f64], pattern: &Pattern) -> (Vec<(usize, f64)>, Option<Amplifier>) {
        let Some(factor) = Cholesky::<f64, Dyn>::new(self.covariance(s)) else {
            return (Vec::new(), None);
        };
        let inverse = factor.inverse();
        let weighted = &inverse * (&self.residual + &self.about);
        // Residual against all others, and that over its standard deviation.
        let against: Vec<(f64, f64)> = (0..self.used.len())
            .map(|k| (weighted[k] / inverse[(k, k)], weighted[k] / inverse[(k, k)].sqrt()))
            .collect();
        let worst = against.iter().fold(0.0_f64, |m, (_, z)| m.max(z.abs()));
        let amplifier = amplifiers::most(&inverse, &weighted, &self.used, baseline, pattern);
        let stands_out = |(found, z): &(Amplifier, f64)| {
            *z > self.options.outlier.max(worst) && found.off(baseline, pattern) > self.options.least_outlier
        };
        if let Some((amplifier, _)) = amplifier.filter(stands_out) {
            return (Vec::new(), Some(amplifier));
        }
        let outliers = against.iter().zip(&self.used);
        // Next to a much worse one a value is not judged yet.
        let outliers = outliers.filter(|((off, z), _)| {
            z.abs() > self.options.outlier.max(0.5 * worst) && off.abs() > self.options.least_outlier
        });
        (outliers.map(|((off, _), k)| (*k, off.exp())).collect(), None)
    }

    fn prior(&self, s: Scales) -> DMatrix<f64> {
        let n = self.slopes.ncols() / 2;
        let mut prior = DMatrix::zeros(2 * n, 2 * n);
        for l in 0..n {
            for k in 0..n {
                prior[(l, k)] = self.options.common_contact * self.options.common_contact;
            }
            prior[(l, l)] += s.contact * s.contact;
            prior[(n + l, n + l)] = s.place_mm * s.place_mm;
        }
        prior
    }

    /// Covariance of the values under a choice of scales.
    fn covariance(&self, s: Scales) -> DMatrix<f64> {
        let mut m = &self.slopes * self.prior(s) * self.slopes.transpose();
        m += &self.uneven * (s.unevenness * s.unevenness);
        m.add_scalar_mut(self.options.gain * self.options.gain);
        for (k, spread) in self.spread.iter().enumerate() {
            m[(k, k)] += (s.error * spread).powi(2);
        }
        m
    }

    /// The scales with the greatest evidence.
    fn best(&self, y: &DVector<f64>, reach: f64) -> Scales {
        let mut best = (
            f64::NEG_INFINITY,
            Scales {
                error: self.options.errors[self.options.errors.len() - 1],
                unevenness: 0.0,
                place_mm: self.options.places_mm[0] * reach,
                contact: self.options.contacts[0],
            },
        );
        for error in self.options.errors {
            for unevenness in self.options.unevennesses {
                for place in self.options.places_mm {
                    for contact in self.options.contacts {
                        let s = Scales {
                            error,
                            unevenness,
                            place_mm: place * reach,
                            contact,
                        };
                        let Some(factor) = Cholesky::new(self.covariance(s)) else {
                            continue;
                        };
                        let determinant: f64 = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
                        let evidence = -0.5 * (y.dot(&factor.solve(y)) + determinant);
                        if evidence > best.0 {
                            best = (evidence, s);
                        }
                    }
                }
            }
        }
        best.1
    }

    /// Mean and covariance of contacts and places.
    fn solve(&self, y: &DVector<f64>, s: Scales) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let prior = self.prior(s);
        let factor: Cholesky<f64, Dyn> = Cholesky::new(self.covariance(s))?;
        let across = &self.slopes * &prior;
        let mean = across.tr_mul(&factor.solve(y));
        let covariance = &prior - across.tr_mul(&factor.solve(&across));
        mean.iter().all(|v| v.is_finite()).then_some((mean, covariance))
    }
}

/// Smooth bumps over the cells whose squares add up to 1 on average: what an uneven sheet is made of.
fn bumps(imager: &Imager, distance: f64) -> DMatrix<f64> {
    let step = distance * imager.reach_mm();
    let count = (1.0 / distance).ceil() as i32;
    let centres: Vec<[f64; 2]> = (-count..=count)
        .flat_map(|i| (-count..=count).map(move |k| [f64::from(i) * step, f64::from(k) * step]))
        .collect();
    let mut out = DMatrix::from_fn(imager.grid.len(), centres.len(), |cell, k| {
        let [x, y] = imager.grid.centre(cell);
        let d2 = (x - centres[k][0]).powi(2) + (y - centres[k][1]).powi(2);
        (-0.5 * d2 / (0.75 * step).powi(2)).exp()
    });
    out /= (out.norm_squared() / imager.grid.len() as f64)
        .sqrt()
        .max(f64::MIN_POSITIVE);
    out
}
