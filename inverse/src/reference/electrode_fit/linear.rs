//! The linear Gaussian model of a baseline: what contacts, places, unevenness and gain do to the logarithms of its values.

use super::{ElectrodeFitOptions, OddPair, odd_pairs};
use crate::reference::imager::Imager;
use crate::reference::low_rank::LowRankInverse;
use forward::{Pattern, Sensitivity, Solver};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// One choice of the standard deviations.
#[derive(Clone, Copy)]
pub(super) struct Scales {
    pub(super) error: f64,
    pub(super) unevenness: f64,
    place_mm: f64,
    contact: f64,
}

/// The linear model of the baseline's logarithms about some sheet.
pub(super) struct Linear {
    options: ElectrodeFitOptions,
    /// Which values of the baseline are in use.
    used: Vec<usize>,
    /// What the linear part makes of the logarithms where the electrodes are.
    pub(super) about: DVector<f64>,
    /// Logarithm of the baseline over the model, for the values in use.
    pub(super) residual: DVector<f64>,
    /// Its derivatives: by the logarithms of the contacts and by the places (2 for an electrode), by the bumps of an unevenness, by
    /// what all contacts have in common, and by the gain. Each of these unknowns is independent of the others.
    columns: DMatrix<f64>,
    /// Number of electrodes.
    n: usize,
    /// Relative error of every value, in units of the common one: small values are less certain.
    spread: DVector<f64>,
    /// Products of the columns, each value over its spread.
    gram: DMatrix<f64>,
}

/// What is known of the unknowns after a baseline.
struct Posterior {
    /// Standard deviations before it.
    sd: DVector<f64>,
    /// Factor of their inverse covariance, in units of these.
    factor: Cholesky<f64, Dyn>,
    /// Products of the columns with the baseline, in the same units.
    along: DVector<f64>,
    /// Logarithm of the baseline's density, without its constant.
    evidence: f64,
}

impl Linear {
    pub(super) fn new(imager: &Imager, baseline: &[f64], options: &ElectrodeFitOptions) -> Option<Self> {
        let solver = Solver::new(imager.model.clone()).ok()?;
        Self::solved(imager, &solver, baseline, options)
    }

    /// About a sheet that is solved, which an imager's voltages and sensitivity are of.
    pub(super) fn solved(
        imager: &Imager,
        solver: &Solver,
        baseline: &[f64],
        options: &ElectrodeFitOptions,
    ) -> Option<Self> {
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
        let slopes =
            Sensitivity::by_electrode(solver).matrix_v(imager.drive, solver.electrode_matrix(), &imager.pattern);
        let bumps = &imager.sensitivity * Bumps::new(imager, options.bumps).over_cells(imager);
        let bump_count = bumps.ncols();
        let mut columns = DMatrix::zeros(used.len(), 2 * n + bump_count + 2);
        for (row, k) in used.iter().enumerate() {
            let model_v = imager.model_v[*k];
            for p in 0..2 * n {
                columns[(row, p)] = slopes[(*k, p)] / model_v;
            }
            for p in 0..bump_count {
                columns[(row, 2 * n + p)] = bumps[(*k, p)] / model_v;
            }
            columns[(row, 2 * n + bump_count)] = columns.row(row).columns(0, n).sum();
            columns[(row, 2 * n + bump_count + 1)] = 1.0;
        }
        let spread = DVector::from_iterator(used.len(), used.iter().map(|k| (middle / baseline[*k]).hypot(1.0)));
        let mut scaled = columns.clone();
        for (mut row, spread) in scaled.row_iter_mut().zip(&spread) {
            row /= *spread;
        }
        Some(Self {
            options: *options,
            about: DVector::zeros(used.len()),
            residual: DVector::from_iterator(
                used.len(),
                used.iter().map(|k| (baseline[*k] / imager.model_v[*k]).ln()),
            ),
            gram: scaled.transpose() * &scaled,
            columns,
            n,
            spread,
            used,
        })
    }

    /// The derivatives by contacts and places.
    pub(super) fn slopes(&self) -> nalgebra::DMatrixView<'_, f64> {
        self.columns.columns(0, 2 * self.n)
    }

    /// What the logarithms deviate by from the model but for the common gain, root mean square.
    pub(super) fn misfit(&self) -> f64 {
        let mean = self.residual.mean();
        self.residual.map(|r| (r - mean).powi(2)).mean().sqrt()
    }

    /// Which values of the baseline are in use.
    pub(super) fn used(&self) -> &[usize] {
        &self.used
    }

    /// The inverse of the values' covariance under a choice of scales.
    pub(super) fn inverse(&self, s: Scales) -> Option<LowRankInverse> {
        let mut columns = self.columns.clone();
        for (mut column, sd) in columns.column_iter_mut().zip(&self.sd(s)) {
            column *= *sd;
        }
        let own_sd: Vec<f64> = self.spread.iter().map(|spread| s.error * spread).collect();
        LowRankInverse::new(&columns, &own_sd)
    }

    /// Values that the others do not predict, with measured over predicted; or a pair that does so better.
    pub(super) fn stand_out(
        &self,
        s: Scales,
        baseline: &[f64],
        pattern: &Pattern,
    ) -> (Vec<(usize, f64)>, Option<OddPair>) {
        let Some(inverse) = self.inverse(s) else {
            return (Vec::new(), None);
        };
        let weighted = inverse.times(&(&self.residual + &self.about));
        // Residual against all others, and that over its standard deviation.
        let against: Vec<(f64, f64)> = (0..self.used.len())
            .map(|k| {
                let own = inverse.diagonal(k);
                (weighted[k] / own, weighted[k] / own.sqrt())
            })
            .collect();
        let worst = against.iter().fold(0.0_f64, |m, (_, z)| m.max(z.abs()));
        let odd = odd_pairs::most(&inverse, &weighted, &self.used, baseline, pattern);
        let stands_out = |(found, z): &(OddPair, f64)| {
            *z > self.options.outlier.max(worst) && found.off(baseline, pattern) > self.options.least_outlier
        };
        if let Some((odd, _)) = odd.filter(stands_out) {
            return (Vec::new(), Some(odd));
        }
        let outliers = against.iter().zip(&self.used);
        // Next to a much worse one a value is not judged yet.
        let outliers = outliers.filter(|((off, z), _)| {
            z.abs() > self.options.outlier.max(0.5 * worst) && off.abs() > self.options.least_outlier
        });
        (outliers.map(|((off, _), k)| (*k, off.exp())).collect(), None)
    }

    /// Standard deviations of the unknowns under a choice of scales.
    fn sd(&self, s: Scales) -> DVector<f64> {
        let mut sd = DVector::from_element(self.columns.ncols(), s.unevenness);
        sd.rows_mut(0, self.n).fill(s.contact);
        sd.rows_mut(self.n, self.n).fill(s.place_mm);
        sd[self.columns.ncols() - 2] = self.options.common_contact;
        sd[self.columns.ncols() - 1] = self.options.gain;
        sd
    }

    /// The values over their spread: their square, and their products with the columns.
    fn products(&self, y: &DVector<f64>) -> (f64, DVector<f64>) {
        let over = y.component_div(&self.spread);
        (
            over.norm_squared(),
            self.columns.tr_mul(&over.component_div(&self.spread)),
        )
    }

    /// The unknowns under a choice of scales, from these products. None where they are not finite.
    fn posterior(&self, s: Scales, (square, products): &(f64, DVector<f64>)) -> Option<Posterior> {
        let sd = self.sd(s);
        let precision = s.error.powi(-2);
        let mut m = DMatrix::from_fn(sd.len(), sd.len(), |i, k| sd[i] * self.gram[(i, k)] * sd[k] * precision);
        for k in 0..sd.len() {
            m[(k, k)] += 1.0;
        }
        let factor = Cholesky::new(m)?;
        let along = products.component_mul(&sd) * precision;
        let determinant: f64 = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
        let own: f64 = self.spread.iter().map(|spread| 2.0 * (s.error * spread).ln()).sum();
        let explained = along.dot(&factor.solve(&along));
        Some(Posterior {
            evidence: -0.5 * (square * precision - explained + determinant + own),
            sd,
            factor,
            along,
        })
    }

    /// The scales with the greatest evidence.
    pub(super) fn best(&self, y: &DVector<f64>, reach: f64) -> Scales {
        self.best_of(y, reach).1
    }

    /// The same with the logarithm of that evidence.
    pub(super) fn best_of(&self, y: &DVector<f64>, reach: f64) -> (f64, Scales) {
        let products = self.products(y);
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
                        let Some(posterior) = self.posterior(s, &products) else {
                            continue;
                        };
                        if posterior.evidence > best.0 {
                            best = (posterior.evidence, s);
                        }
                    }
                }
            }
        }
        best
    }

    /// Mean and covariance of contacts and places.
    pub(super) fn solve(&self, y: &DVector<f64>, s: Scales) -> Option<(DVector<f64>, DMatrix<f64>)> {
        self.solve_first(y, s, 2 * self.n)
    }

    /// The same of contacts, places and the bumps of an unevenness.
    pub(super) fn solve_uneven(&self, y: &DVector<f64>, s: Scales) -> Option<(DVector<f64>, DMatrix<f64>)> {
        self.solve_first(y, s, self.columns.ncols() - 2)
    }

    /// What the logarithms of the values are by contacts, places and bumps.
    pub(super) fn by_uneven(&self, unknowns: &DVector<f64>) -> DVector<f64> {
        self.columns.columns(0, unknowns.len()) * unknowns
    }

    fn solve_first(&self, y: &DVector<f64>, s: Scales, count: usize) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let Posterior { sd, factor, along, .. } = self.posterior(s, &self.products(y))?;
        // A contact is its own part and what all have in common.
        let common = sd.len() - 2;
        let mut parts = DMatrix::zeros(sd.len(), count);
        for k in 0..count {
            parts[(k, k)] = sd[k];
            if k < self.n {
                parts[(common, k)] = sd[common];
            }
        }
        let mean = parts.tr_mul(&factor.solve(&along));
        let covariance = parts.tr_mul(&factor.solve(&parts));
        mean.iter().all(|v| v.is_finite()).then_some((mean, covariance))
    }
}

/// Smooth bumps whose squares add up to 1 on average: what an uneven sheet is made of.
#[derive(Clone, Debug)]
pub(super) struct Bumps {
    centres_mm: Vec<[f64; 2]>,
    /// Standard deviation of a bump, mm.
    width_mm: f64,
    height: f64,
}

impl Bumps {
    /// At this distance from one another, over the sheet's reach.
    pub(super) fn new(imager: &Imager, distance: f64) -> Self {
        let step = distance * imager.reach_mm();
        let count = (1.0 / distance).ceil() as i32;
        let centres_mm = (-count..=count)
            .flat_map(|i| (-count..=count).map(move |k| [f64::from(i) * step, f64::from(k) * step]))
            .collect();
        let mut bumps = Self {
            centres_mm,
            width_mm: 0.75 * step,
            height: 1.0,
        };
        let square = bumps.over_cells(imager).norm_squared() / imager.grid.len() as f64;
        bumps.height = 1.0 / square.sqrt().max(f64::MIN_POSITIVE);
        bumps
    }

    pub(super) fn len(&self) -> usize {
        self.centres_mm.len()
    }

    fn at(&self, bump: usize, place_mm: [f64; 2]) -> f64 {
        let [x, y] = self.centres_mm[bump];
        let d2 = (place_mm[0] - x).powi(2) + (place_mm[1] - y).powi(2);
        self.height * (-0.5 * d2 / self.width_mm.powi(2)).exp()
    }

    /// A row for each cell, a column for each bump.
    fn over_cells(&self, imager: &Imager) -> DMatrix<f64> {
        DMatrix::from_fn(imager.grid.len(), self.len(), |cell, k| {
            self.at(k, imager.grid.centre(cell))
        })
    }

    /// The sum of bumps of some heights.
    pub(super) fn sum(&self, heights: &[f64], place_mm: [f64; 2]) -> f64 {
        (0..self.len()).map(|k| heights[k] * self.at(k, place_mm)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Drive, Sheet};

    /// The evidence, the mean and the covariance are those of the values' covariance written out.
    #[test]
    fn the_posterior_is_that_of_the_covariance_written_out() {
        let imager = Imager::new(&Sheet::paper(), Drive::PAPER, Pattern::adjacent(16).unwrap(), 12.0).unwrap();
        let mut baseline: Vec<f64> = imager.model_v.iter().map(|v| 3.0 * v).collect();
        for (k, v) in baseline.iter_mut().enumerate() {
            *v *= 1.0 + 0.01 * (k as f64).sin();
        }
        baseline[7] = f64::NAN;
        let options = ElectrodeFitOptions::default();
        let linear = Linear::new(&imager, &baseline, &options).unwrap();
        let y = &linear.residual;
        for (error, unevenness) in [(3e-4, 0.1), (1e-2, 0.0), (3e-2, 0.02)] {
            let s = Scales {
                error,
                unevenness,
                place_mm: 0.5,
                contact: 0.1,
            };
            let sd = linear.sd(s);
            let prior = DMatrix::from_diagonal(&sd.component_mul(&sd));
            let own = linear.spread.map(|spread| (s.error * spread).powi(2));
            let c = &linear.columns * &prior * linear.columns.transpose() + DMatrix::from_diagonal(&own);
            let factor: Cholesky<f64, Dyn> = Cholesky::new(c).unwrap();
            let log_det: f64 = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
            let evidence = -0.5 * (y.dot(&factor.solve(y)) + log_det);
            let found = linear.posterior(s, &linear.products(y)).unwrap().evidence;
            // The covariance written out has eleven decades.
            assert!((found - evidence).abs() < 1e-6 * evidence.abs(), "{found} {evidence}");
            let across = &linear.columns * &prior;
            let whole = &prior - across.tr_mul(&factor.solve(&across));
            let mean = across.tr_mul(&factor.solve(y));
            let common = sd.len() - 2;
            let (found, covariance) = linear.solve(y, s).unwrap();
            for l in 0..16 {
                assert!((found[l] - mean[l] - mean[common]).abs() < 1e-5, "{error} contact {l}");
                assert!((found[16 + l] - mean[16 + l]).abs() < 1e-5, "{error} place {l}");
                let contact = whole[(l, l)] + 2.0 * whole[(l, common)] + whole[(common, common)];
                assert!((covariance[(l, l)] - contact).abs() < 1e-5, "{error} contact {l}");
                let both = whole[(16 + l, l)] + whole[(16 + l, common)];
                assert!((covariance[(16 + l, l)] - both).abs() < 1e-5, "{error} {l}");
            }
        }
    }
}
