//! What changes frames beside touches: fitted with them, and as well known as the frame says.
//!
//! Touches are searched for and fitted in the part of a frame that lies outside the nuisance directions, as if nothing were
//! known of their sizes. That costs accuracy where nothing drifted. Here the sizes get priors: zero, with standard deviations
//! of several widths. Every width is as probable before the frame as every other; the frame itself weighs them (model
//! averaging; Hoeting et al., Statistical Science 14, 1999). All is linear about the fitted touches, and Gaussian:
//!
//! With the directions `Q` (orthonormal), the touches' derivatives `J` and covariance `C` of the fit outside `Q`, and
//! `H = Q' J`, the sizes along `Q` are `f = Q' (data - touches)` with covariance `S = sigma² I + H C H'`, and covariance
//! `-C H'` with the touches' parameters. A prior covariance `P` gives `M = S + P`, the touches' shift `C H' M⁻¹ f`, their
//! covariance `C - C H' M⁻¹ H C`, and the probability of `f`, normal with covariance `M`.

use crate::linalg::dense::{backward, cholesky, forward};
use crate::linalg::kernels::{LANES, padded};
use crate::linalg::vector::dot;
use crate::reference::drift::{CHANGED, ContactChange, Drift, DriftShapes, Drifting, OFFSET};
use crate::touches::fit::disc::{Disc, MOST_TOUCHES};
use crate::touches::fit::frame_fit::{Fitted, significance, touch_of};
use crate::touches::fit::levenberg_marquardt::PARAMETERS;
use crate::touches::fit::responses::ResponseTable;
use nalgebra::DMatrix;

/// Widths below this probability are left out: their part is rounding.
const LEAST_PROBABILITY: f64 = 1e-4;
/// Widths in which nothing else drifts: those of nothing, and of what all values have in common.
const COMMON_WIDTHS: usize = 2;

/// What is known to have changed at the rim.
#[derive(Debug, Default)]
pub(crate) struct KnownCauses {
    /// Electrodes whose contact changed.
    pub(crate) contacts: Vec<usize>,
    /// Leaks, each with the column of its shape.
    pub(crate) leaks: Vec<([usize; 2], usize)>,
    /// The shapes of all of these, weighted, one after the other.
    pub(crate) shapes: Vec<f64>,
}

/// The nuisance directions of frames of which the same values take part. Immutable.
#[derive(Debug)]
pub(crate) struct Nuisances {
    /// Directions times weights, one after the other: products with a frame in V are sizes in V.
    directions: Vec<f64>,
    /// Sizes of the responses to touches.
    table: ResponseTable,
    /// Sizes by kinds of drift: what a unit of each does, V.
    kinds: DMatrix<f64>,
    /// By what part gain and resistance scale the voltages, for a unit of each. What contacts do is not common.
    gain: [f64; 2],
    /// Standard deviations of the kinds, width by width.
    widths: Vec<Vec<f64>>,
    /// Prior covariance of the sizes for each of them (V²), padded.
    priors: Vec<Vec<f64>>,
    /// What drifts, and how many kinds beside gain and resistance.
    what: Drifting,
    own: usize,
    /// Leaks that are known, and the kind that each is.
    leaks: Vec<([usize; 2], usize)>,
    /// Mean squares of the waves of an unevenness over the sheet, where it is what drifts.
    wave_squares: Vec<f64>,
    /// Mean square of the sizes of an unevenness whose mean square is 1, V²; else 0.
    unit_square: f64,
}

/// Room for the sizes of one frame. Nothing is allocated once it is as large as it gets.
#[derive(Debug, Default)]
pub(crate) struct NuisanceScratch {
    sizes: Vec<f64>,
    response: [Vec<f64>; PARAMETERS],
    jacobian: Vec<f64>,
    /// `H C`, and its columns solved for.
    product: Vec<f64>,
    solved: Vec<f64>,
    /// Factors of `M`, width by width, one over their diagonals, and `M⁻¹ f`.
    factors: Vec<f64>,
    inverses: Vec<f64>,
    weights: Vec<f64>,
    log_evidence: Vec<f64>,
    probabilities: Vec<f64>,
    shift: Vec<f64>,
    reduced: Vec<f64>,
    kind: Vec<f64>,
    waves: Vec<f64>,
}

impl Nuisances {
    /// `orthonormal`: the weighted directions. `what` drifts beside what is `known`.
    pub(crate) fn new(
        drift: &DriftShapes,
        (what, known): (Drifting, &KnownCauses),
        orthonormal: &[f64],
        weights: &[f64],
        (volts, at_once): (&ResponseTable, bool),
    ) -> Self {
        let values = weights.len();
        let mut directions = orthonormal.to_vec();
        for direction in directions.chunks_exact_mut(values) {
            direction.iter_mut().zip(weights).for_each(|(d, w)| *d *= w);
        }
        let rank = directions.len() / values;
        let rows = DMatrix::from_row_slice(rank, values, &directions);
        let drifting = &rows * drift.columns(what, |k| weights[k]);
        let kinds_of_drift = drifting.ncols();
        let orthonormal = DMatrix::from_row_slice(rank, values, orthonormal);
        let shapes = &orthonormal * DMatrix::from_column_slice(values, known.shapes.len() / values, &known.shapes);
        let all = kinds_of_drift + shapes.ncols();
        let mut kinds = drifting.resize_horizontally(all, 0.0);
        kinds.columns_mut(kinds_of_drift, shapes.ncols()).copy_from(&shapes);
        let frame = kinds.column(0).into_owned();
        let gain = [0, 1].map(|k| kinds.column(k).dot(&frame) / frame.norm_squared());
        let wave_squares = drift.wave_squares(what).to_vec();
        let waves = kinds.columns(2, wave_squares.len());
        let unit_square = waves.rows_range(2.min(rank)..).norm_squared();
        let of_shapes = |mut sd: Vec<f64>| {
            sd.resize(all, CHANGED);
            sd
        };
        let widths: Vec<Vec<f64>> = drift.widths(what, &known.contacts).map(of_shapes).collect();
        let padded_rank = padded(rank, LANES);
        let prior = |sd: &Vec<f64>| {
            let mut prior = vec![0.0; padded_rank * padded_rank];
            for j in 0..rank {
                for i in 0..rank {
                    let sum = sd
                        .iter()
                        .enumerate()
                        .map(|(k, sd)| sd * sd * kinds[(i, k)] * kinds[(j, k)]);
                    prior[j * padded_rank + i] = sum.sum();
                }
            }
            prior
        };
        Self {
            priors: widths.iter().map(prior).collect(),
            table: volts.reduced(&rows, at_once),
            directions,
            kinds,
            gain,
            widths,
            wave_squares,
            unit_square,
            what,
            leaks: (known.leaks.iter())
                .map(|(pair, column)| (*pair, kinds_of_drift + column))
                .collect(),
            own: kinds_of_drift - 2,
        }
    }

    /// How many contacts drift.
    fn contacts(&self) -> usize {
        if self.what == Drifting::Contacts { self.own } else { 0 }
    }

    /// Error of the linear model of what drifted, of which these are the sizes along the directions (V): norm over a frame, V. A field
    /// of the relative size u has one of the part u, to second order. Contacts are less than linear, and channels are linear.
    pub(crate) fn linearisation_error(&self, sizes: &[f64]) -> f64 {
        // The first directions are those of gain and resistance.
        let along = sizes.iter().skip(2).map(|v| v * v).sum::<f64>();
        if self.unit_square > 0.0 {
            along / self.unit_square.sqrt()
        } else {
            0.0
        }
    }

    /// Appends the sizes along the directions of a frame, V.
    pub(crate) fn along(&self, volts: &[f64], out: &mut Vec<f64>) {
        out.extend(self.directions.chunks_exact(volts.len().max(1)).map(|q| dot(q, volts)));
    }

    /// Makes the touches of a fit, and what drifted, those of all widths of the priors weighed by the frame. `sizes`: of the
    /// data less the error of the linear model, V.
    pub(crate) fn refine(&self, sizes: &[f64], fitted: &mut Fitted, scratch: &mut NuisanceScratch, drift: &mut Drift) {
        let count = PARAMETERS * fitted.all.len();
        let determined = fitted.covariance.len() == count * count;
        self.linearise(sizes, fitted, determined, scratch);
        let (sigma, variance) = (fitted.sigma, fitted.variance);
        if !self.weigh(sigma, variance, count, scratch) {
            return;
        }
        if determined {
            self.shift(count, scratch);
            let touches = fitted.touches.iter_mut().zip(&mut fitted.significances);
            for ((touch, strength), place) in touches.zip(&fitted.places) {
                let first = PARAMETERS * place;
                let by = &scratch.shift[first..first + PARAMETERS];
                let disc = &fitted.all[*place];
                let moved = Disc {
                    at: [disc.at[0] + by[0], disc.at[1] + by[1]],
                    radius: disc.radius + by[2],
                    strength: disc.strength + by[3] * sigma,
                };
                // A shift beyond what is linear is none.
                if !self.table.holds(moved.at)
                    || !(0.5 * disc.radius..2.0 * disc.radius).contains(&moved.radius)
                    || moved.strength * disc.strength <= 0.0
                {
                    continue;
                }
                let of = |i: usize, j: usize| {
                    let k = (first + j) * count + first + i;
                    let block = &scratch.reduced[PARAMETERS * PARAMETERS * place..];
                    Some(fitted.covariance[k] - block[PARAMETERS * j + i])
                };
                *strength = significance(&moved, sigma, of(3, 3));
                *touch = touch_of(&moved, sigma, of);
            }
        }
        self.drifted(sigma, scratch, drift);
    }

    /// The touches' derivatives along the directions, and what touches leave of the sizes, over the noise.
    fn linearise(&self, sizes: &[f64], fitted: &Fitted, determined: bool, scratch: &mut NuisanceScratch) {
        let (rank, stride) = (sizes.len(), self.table.stride());
        let count = PARAMETERS * fitted.all.len();
        let sigma = fitted.sigma;
        scratch.sizes.clear();
        scratch.sizes.extend(sizes.iter().map(|v| v / sigma));
        scratch.jacobian.clear();
        for r in &mut scratch.response {
            r.resize(stride, 0.0);
        }
        for d in &fitted.all {
            let [value, x, y, radius] = &mut scratch.response;
            self.table
                .at(d.at, d.radius, [&mut *value, &mut *x, &mut *y, &mut *radius]);
            let strength = d.strength / sigma;
            let parts = [(&*x, strength), (&*y, strength), (&*radius, strength), (&*value, 1.0)];
            for (part, by) in parts {
                scratch.jacobian.extend(part[..rank].iter().map(|v| v * by));
            }
            scratch
                .sizes
                .iter_mut()
                .zip(&*value)
                .for_each(|(s, v)| *s -= strength * v);
        }
        scratch.product.clear();
        scratch.product.resize(rank * count, 0.0);
        if !determined {
            return;
        }
        let columns = scratch.product.chunks_exact_mut(rank.max(1));
        for (out, covariance) in columns.zip(fitted.covariance.chunks_exact(count.max(1))) {
            for (h, c) in scratch.jacobian.chunks_exact(rank).zip(covariance) {
                out.iter_mut().zip(h).for_each(|(o, h)| *o += c * h);
            }
        }
    }

    /// Factorises `M` for every width, and weighs the widths; false when no width can be.
    fn weigh(&self, sigma: f64, variance: f64, count: usize, scratch: &mut NuisanceScratch) -> bool {
        let rank = scratch.sizes.len();
        let rows = padded(rank, LANES);
        let arch = self.table.arch();
        for room in [&mut scratch.factors, &mut scratch.inverses, &mut scratch.weights] {
            room.clear();
        }
        scratch.factors.resize(rows * rows * self.priors.len(), 0.0);
        scratch.inverses.resize(rows * self.priors.len(), 0.0);
        scratch.weights.resize(rows * self.priors.len(), 0.0);
        scratch.log_evidence.clear();
        let parts = scratch.factors.chunks_exact_mut(rows * rows);
        let others = scratch
            .inverses
            .chunks_exact_mut(rows)
            .zip(scratch.weights.chunks_exact_mut(rows));
        for ((prior, m), (inverse, weights)) in self.priors.iter().zip(parts).zip(others) {
            for (j, column) in m.chunks_exact_mut(rows).enumerate() {
                if j >= rank {
                    column[j] = 1.0;
                    continue;
                }
                let from = &prior[j * rows..(j + 1) * rows];
                column.iter_mut().zip(from).for_each(|(m, p)| *m = p / (sigma * sigma));
                column[j] += variance;
            }
            for k in 0..count {
                let (h, product) = (
                    &scratch.jacobian[k * rank..][..rank],
                    &scratch.product[k * rank..][..rank],
                );
                for (j, column) in m.chunks_exact_mut(rows).take(rank).enumerate() {
                    column.iter_mut().zip(product).for_each(|(m, u)| *m += u * h[j]);
                }
            }
            let whole = cholesky(arch, m, inverse);
            weights[..rank].copy_from_slice(&scratch.sizes);
            forward(arch, m, inverse, weights);
            let log_root: f64 = inverse[..rank].iter().map(|v| v.ln()).sum();
            let log = log_root - 0.5 * weights.iter().map(|w| w * w).sum::<f64>();
            backward(arch, m, inverse, weights);
            scratch.log_evidence.push(if whole && log.is_finite() {
                log
            } else {
                f64::NEG_INFINITY
            });
        }
        let largest = scratch.log_evidence.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if largest == f64::NEG_INFINITY {
            return false;
        }
        let probability = &mut scratch.probabilities;
        probability.clear();
        probability.extend(scratch.log_evidence.iter().map(|log| (log - largest).exp()));
        probability
            .iter_mut()
            .filter(|p| **p < LEAST_PROBABILITY)
            .for_each(|p| *p = 0.0);
        let sum: f64 = probability.iter().sum();
        probability.iter_mut().for_each(|p| *p /= sum);
        true
    }

    /// The mean shift of all parameters, and by how much every disc's covariance is reduced.
    fn shift(&self, count: usize, scratch: &mut NuisanceScratch) {
        let rank = scratch.sizes.len();
        let rows = padded(rank, LANES);
        let arch = self.table.arch();
        scratch.shift.clear();
        scratch.shift.resize(count, 0.0);
        scratch.reduced.clear();
        scratch.reduced.resize(count * PARAMETERS, 0.0);
        let mut own = [0.0; PARAMETERS * MOST_TOUCHES];
        for (l, p) in scratch.probabilities.iter().enumerate().filter(|(_, p)| **p > 0.0) {
            let (m, inverse) = (
                &scratch.factors[l * rows * rows..][..rows * rows],
                &scratch.inverses[l * rows..][..rows],
            );
            let weights = &scratch.weights[l * rows..][..rank];
            scratch.solved.clear();
            scratch.solved.resize(rows * count, 0.0);
            let solved = scratch.solved.chunks_exact_mut(rows);
            for ((k, solved), product) in solved.enumerate().zip(scratch.product.chunks_exact(rank.max(1))) {
                own[k] = dot(product, weights);
                scratch.shift[k] += p * own[k];
                solved[..rank].copy_from_slice(product);
                forward(arch, m, inverse, solved);
            }
            // The mean of the covariances, plus that of the shifts.
            for (place, block) in scratch.reduced.chunks_exact_mut(PARAMETERS * PARAMETERS).enumerate() {
                for (k, out) in block.iter_mut().enumerate() {
                    let (i, j) = (PARAMETERS * place + k % PARAMETERS, PARAMETERS * place + k / PARAMETERS);
                    let column = |c: usize| &scratch.solved[c * rows..][..rows];
                    *out += p * (dot(column(i), column(j)) - own[i] * own[j]);
                }
            }
        }
        for (place, block) in scratch.reduced.chunks_exact_mut(PARAMETERS * PARAMETERS).enumerate() {
            for (k, out) in block.iter_mut().enumerate() {
                let (i, j) = (PARAMETERS * place + k % PARAMETERS, PARAMETERS * place + k / PARAMETERS);
                *out += scratch.shift[i] * scratch.shift[j];
            }
        }
    }

    /// What drifted: the mean over the widths, and the contact that changed for itself.
    fn drifted(&self, sigma: f64, scratch: &mut NuisanceScratch, drift: &mut Drift) {
        let rank = scratch.sizes.len();
        let rows = padded(rank, LANES);
        drift.contacts.clear();
        drift.contacts.resize(self.contacts(), 0.0);
        (drift.gain, drift.offset) = (1.0, 0.0);
        drift.leaks.clear();
        drift.leaks.extend(self.leaks.iter().map(|(pair, _)| (*pair, 0.0)));
        scratch.waves.clear();
        scratch.waves.resize(self.wave_squares.len(), 0.0);
        for (l, p) in scratch.probabilities.iter().enumerate().filter(|(_, p)| **p > 0.0) {
            let weights = &scratch.weights[l * rows..][..rank];
            let of = |kind: usize| {
                let along = dot(self.kinds.column(kind).as_slice(), weights);
                self.widths[l][kind].powi(2) * along / sigma
            };
            drift.gain += p * self.gain.iter().enumerate().map(|(k, g)| g * of(k)).sum::<f64>();
            for (c, out) in drift.contacts.iter_mut().enumerate() {
                *out += p * of(2 + c);
            }
            for (w, out) in scratch.waves.iter_mut().enumerate() {
                *out += p * of(2 + w);
            }
            for ((_, size), (_, kind)) in drift.leaks.iter_mut().zip(&self.leaks) {
                *size += p * of(*kind);
            }
            if self.what == Drifting::Channels {
                drift.offset += p * OFFSET * of(1 + self.own);
            }
        }
        let squares = scratch.waves.iter().zip(&self.wave_squares);
        drift.uneven = squares.map(|(size, square)| size * size * square).sum::<f64>().sqrt();
        let of_own: f64 = scratch.probabilities.iter().skip(COMMON_WIDTHS).sum();
        drift.by_own = of_own > 0.5;
        drift.contact = self.contact(sigma, scratch);
        (drift.evidence, drift.cost) = self.cost(drift.contact, scratch);
    }

    /// How much more probable the best width is than nothing but gain and resistance, as a logarithm. And what else drifts adds to the
    /// cost of the touches: chi-square that they would leave with none, less twice that logarithm, or that of the best contact of all.
    fn cost(&self, contact: Option<ContactChange>, scratch: &mut NuisanceScratch) -> (f64, f64) {
        let (rank, count) = (scratch.sizes.len(), self.own);
        let rows = padded(rank, LANES);
        let common = COMMON_WIDTHS - 1;
        let of = |l: usize| scratch.log_evidence.get(l).copied().unwrap_or(f64::NEG_INFINITY);
        if count == 0 || of(common) == f64::NEG_INFINITY {
            return (0.0, 0.0);
        }
        let any = (COMMON_WIDTHS..scratch.log_evidence.len()).map(of);
        let widest = any.fold(f64::NEG_INFINITY, f64::max);
        let largest = scratch.log_evidence.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // Any of so many contacts may be the one.
        let alone = contact.map_or(f64::NEG_INFINITY, |c| largest + c.evidence - (count as f64).ln());
        let (m, inverse) = (
            &scratch.factors[common * rows * rows..][..rows * rows],
            &scratch.inverses[common * rows..][..rows],
        );
        scratch.kind.clear();
        scratch.kind.extend_from_slice(&scratch.sizes);
        scratch.kind.resize(rows, 0.0);
        forward(self.table.arch(), m, inverse, &mut scratch.kind);
        let cost = dot(&scratch.kind, &scratch.kind) - 2.0 * (widest.max(alone) - of(common));
        (widest - of(common), cost)
    }

    /// The contact that explains the sizes best with every width for the others; none where the frame is not more probable
    /// with it. A prior variance `s²` of one more kind adds `s² k k'` to `M`: by the matrix determinant lemma the logarithm of
    /// the probability changes by `(s² (k' M⁻¹ f)² / (1 + s² q) - ln(1 + s² q)) / 2` with `q = k' M⁻¹ k`.
    fn contact(&self, sigma: f64, scratch: &mut NuisanceScratch) -> Option<ContactChange> {
        // What no contact explains better than nothing does needs no search.
        if scratch.probabilities.first().is_some_and(|nothing| *nothing > 0.5) {
            return None;
        }
        let rank = scratch.sizes.len();
        let rows = padded(rank, LANES);
        let largest = scratch.log_evidence.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let variance = CHANGED * CHANGED;
        let mut best: Option<ContactChange> = None;
        for (l, log) in scratch
            .log_evidence
            .iter()
            .enumerate()
            .filter(|(_, log)| log.is_finite())
        {
            let (m, inverse) = (
                &scratch.factors[l * rows * rows..][..rows * rows],
                &scratch.inverses[l * rows..][..rows],
            );
            let weights = &scratch.weights[l * rows..][..rank];
            for electrode in 0..self.contacts() {
                scratch.kind.clear();
                let kind = self.kinds.column(2 + electrode);
                scratch.kind.extend(kind.iter().map(|v| v / sigma));
                scratch.kind.resize(rows, 0.0);
                let along = dot(&scratch.kind[..rank], weights);
                forward(self.table.arch(), m, inverse, &mut scratch.kind);
                let spread = 1.0 + variance * dot(&scratch.kind, &scratch.kind);
                let more = 0.5 * (variance * along * along / spread - spread.ln());
                let evidence = log + more - largest;
                if evidence > best.map_or(0.0, |b| b.evidence) {
                    best = Some(ContactChange {
                        electrode,
                        change: variance * along / spread,
                        evidence,
                    });
                }
            }
        }
        best
    }
}
