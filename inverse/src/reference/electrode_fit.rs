//! Where the electrodes are and how well they make contact, estimated from the unpressed sheet's own values.
//!
//! Nobody places electrodes to a tenth of a millimetre, and half a millimetre moves touches by as much as the noise does.
//! But the baseline shows it: each value's logarithm against the model is linear in small moves of the electrodes along
//! the rim and in their contacts. Everything unknown is given a prior and fitted at once (Gauss and Newton, each step a
//! linear Gaussian model): moves, contacts, the common gain, a smooth unevenness of the sheet, and an error of every
//! value. How large these are is chosen by the evidence of the baseline itself (MacKay 1992), so that a sheet that
//! is not like the model keeps its electrodes where they were said to be.

use crate::reference::imager::Imager;
use forward::{Sensitivity, Solver};
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
    /// Logarithm of the baseline over the model, for the values in use.
    residual: DVector<f64>,
    /// Its derivatives by the logarithms of the contacts and by the places.
    slopes: DMatrix<f64>,
    /// Covariance that an unevenness of 1 makes.
    uneven: DMatrix<f64>,
    /// Relative error of every value, in units of the common one: small values are less certain.
    spread: DVector<f64>,
}

/// Finds the electrodes of an imager's sheet from a baseline (any unit). `None` when too few values can be used or the
/// sheet that comes out makes no sense; the electrodes are then best left where they are.
pub fn find(imager: &Imager, baseline: &[f64]) -> Option<ElectrodeFit> {
    find_with(imager, baseline, &ElectrodeFitOptions::default())
}

/// The same with other expectations.
pub fn find_with(imager: &Imager, baseline: &[f64], options: &ElectrodeFitOptions) -> Option<ElectrodeFit> {
    let sheet = imager.model.sheet();
    let geometry = imager.model.geometry();
    let n = sheet.electrodes.len();
    let reach = imager.reach_mm() / PAPER_REACH_MM;
    let mut at = DVector::zeros(2 * n);
    let mut here = imager.clone();
    let mut scales = None;
    let mut fit = None;
    for _ in 0..options.most_rounds {
        let linear = Linear::new(&here, baseline, options)?;
        // Beyond the linear part: what the values would be if all were linear about the prior's mean.
        let y = &linear.residual + &linear.slopes * &at;
        let s = *scales.get_or_insert_with(|| linear.best(&y, reach));
        let (mean, covariance) = linear.solve(&y, s)?;
        let step = (&mean - &at).rows(n, n).amax();
        at = mean;
        let found = geometry.displaced(sheet, at.as_slice())?;
        here = Imager::new(&found, imager.drive, imager.pattern.clone(), imager.grid.cell_mm()).ok()?;
        here.electrode_covariance = Some(covariance);
        fit = Some(ElectrodeFit {
            imager: here.clone(),
            moved_mm: at.rows(n, n).iter().copied().collect(),
            contact: at.rows(0, n).map(f64::exp).iter().copied().collect(),
            error: s.error,
            unevenness: s.unevenness,
        });
        if step <= options.settled_mm * reach {
            break;
        }
    }
    fit
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
            residual: DVector::from_iterator(
                used.len(),
                used.iter().map(|k| (baseline[*k] / imager.model_v[*k]).ln()),
            ),
            slopes,
            uneven: &bumps * bumps.transpose(),
            spread: DVector::from_iterator(used.len(), used.iter().map(|k| (middle / baseline[*k]).hypot(1.0))),
        })
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
