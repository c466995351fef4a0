//! Where the presses of a frame are, by Bayes' rule on a grid over the sheet.

mod beside;
mod evidence;
mod lattice;
mod outliers;

use self::beside::Beside;
pub(super) use self::evidence::Evidence;
use self::lattice::{FAR, Lattice, Placed, Scored};
use self::outliers::Missing;
use super::maps::Maps;
use super::rest::{Rest, variance};
use crate::linalg::aligned::Aligned;
use crate::linalg::eigen::symmetric_eigen;
use crate::linalg::kernels::{LANES, dots_of, padded};
use crate::quality::doubt::Doubt;
use nalgebra::{Cholesky, DMatrix, DVector, Matrix2};
use pulp::Arch;
use std::sync::{Arc, Mutex, PoisonError};

/// Directions of the whitened maps that are kept.
const DIRECTIONS: usize = 48;
/// Directions more from which they are found.
const MORE_DIRECTIONS: usize = 16;
/// Iterations that find them.
const SUBSPACE_ITERATIONS: usize = 3;
/// How often a frame is fitted with its wild values replaced.
const REPETITIONS: usize = 2;
/// The same where values are missing, which take the place of what was fitted: as many are needed until nothing changes.
const REPETITIONS_WITH_MISSING: usize = 20;
/// Mean square of residuals from which two presses at once are looked for. Presses that were learned from leave 1.
const SUSPECT: f64 = 2.0;
/// Variance of a frame with presses that nobody knows yet, over that with one of the usual strength: one may be twice as strong, or four
/// may be there.
const ANY: f64 = 4.0;
/// Sweeps over the presses of a frame in which each is placed anew with the others as they are.
const SWEEPS: usize = 2;
/// Most presses of a frame.
const MOST: usize = 4;
/// Strengths below this part of the usual one are none: what a press leaves behind is as large.
const LEAST_STRENGTH: f64 = 0.1;

/// The same over the strongest of several: what the maps leave of a strong press is as large.
const LEAST_PART: f64 = 0.2;

/// One press that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Located {
    /// Place, mm.
    pub place_mm: [f64; 2],
    /// Covariance of the place, mm².
    pub covariance_mm2: [[f64; 2]; 2],
    /// Strength over that of the presses that were learned from.
    pub strength: f64,
    /// Standard deviation of the strength.
    pub strength_sd: f64,
    /// Node of the grid where it is most probable.
    node: usize,
}

/// The presses of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Presence {
    /// Strongest first.
    pub presses: Vec<Located>,
    /// Part of the change that they explain, 0 to 1.
    pub explained: f64,
    /// Mean square of what they leave over, in variances; near 1 where they explain the frame.
    pub misfit: f64,
    /// By how much the logarithm of the evidence rises with every press more that was tried, the last of which was not
    /// accepted.
    pub gains: Vec<f64>,
    /// Measurements whose values the others do not tell, by their numbers: these took no part.
    pub wild: Vec<usize>,
}

/// A frame whose residuals are this many times as large as in presses that were learned from, in variances, is doubted.
const DOUBTED: f64 = 6.0;

impl Presence {
    /// What speaks against it: a change that is not like that of the presses that were learned from.
    pub fn doubt(&self) -> Option<Doubt> {
        (self.misfit > DOUBTED).then(|| Doubt::UnlikePresses {
            times: self.misfit.sqrt(),
        })
    }
}

/// The maps on a grid, whitened by the covariance of what they leave over.
pub(super) struct Locator {
    maps: Maps,
    lattice: Lattice,
    /// Products of the maps at nodes that are far apart from one another.
    crossings: DMatrix<f64>,
    /// Measurements x nodes.
    table: DMatrix<f64>,
    /// Variance of the maps at every node, over the noise's.
    uncertainty: Vec<f64>,
    /// Part of the rest that is proportional to a press.
    proportional: f64,
    whitener: Cholesky<f64, nalgebra::Dyn>,
    /// Inverse of the covariance of the rest, and of that of whole frames with a press of the usual strength anywhere.
    precision: DMatrix<f64>,
    precision_anywhere: DMatrix<f64>,
    /// What both say without the values that were missing last: most often they are missing in the next frame, too.
    without: Mutex<Arc<[Missing; 2]>>,
    /// Directions x measurements of the whitened frame.
    directions: DMatrix<f64>,
    /// For every node its whitened map along the directions, one after another.
    reduced: Aligned,
    squares: Vec<f64>,
    deviations: Vec<f64>,
    /// Whether one node of every group is enough where that tells a posterior.
    hurried: bool,
    arch: Arch,
}

/// The directions in which columns are largest, as rows: by subspace iteration from some of the columns (Golub and Van Loan
/// 2013, section 8.2.4). `None` where a number is not finite.
fn leading(columns: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let square = columns * columns.transpose();
    let count = (DIRECTIONS + MORE_DIRECTIONS).min(columns.nrows()).min(columns.ncols());
    let some: Vec<usize> = (0..count).map(|k| k * columns.ncols() / count).collect();
    let mut basis = columns.select_columns(&some).qr().q();
    for _ in 0..SUBSPACE_ITERATIONS {
        basis = (&square * basis).qr().q();
    }
    let eigen = symmetric_eigen(basis.transpose() * &square * &basis)?;
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    order.truncate(DIRECTIONS);
    Some((basis * eigen.eigenvectors.select_columns(&order)).transpose())
}

/// A frame along the directions.
struct Reduced {
    along: DVector<f64>,
    /// Square of what lies outside of them.
    outside: f64,
}

impl Locator {
    /// Tabulates the maps, with so many steps from the middle to the reach of the presses. `None` where the covariance is not
    /// positive definite, or the numbers are beyond what can be computed with.
    pub(super) fn new(maps: Maps, rest: &Rest, steps: f64) -> Option<Self> {
        let covariance = &rest.covariance;
        let frame = maps.frame;
        let lattice = Lattice::new(frame.centre_mm, frame.reach_mm, steps);
        let nodes_mm = &lattice.nodes_mm;
        let table = maps.at(nodes_mm);
        let whitener = Cholesky::new(covariance.clone())?;
        let mut inverse = DMatrix::identity(table.nrows(), table.nrows());
        whitener.l_dirty().solve_lower_triangular_mut(&mut inverse);
        let whitened = &inverse * &table;
        let directions = leading(&whitened)?;
        let small = &directions * &whitened;
        let stride = padded(small.nrows(), LANES);
        let mut reduced = Aligned::zeros(stride * nodes_mm.len());
        for (column, out) in small.column_iter().zip(reduced.chunks_exact_mut(stride)) {
            out[..column.len()].copy_from_slice(column.as_slice());
        }
        let small_of = |nodes: &[usize]| small.select_columns(nodes);
        let uncertainty: Vec<f64> = nodes_mm.iter().map(|p| maps.uncertainty(*p)).collect();
        let usual = uncertainty.iter().map(|u| variance(rest.proportional, &[(1.0, *u)]));
        let usual = usual.sum::<f64>() / uncertainty.len() as f64;
        let anywhere = covariance * usual + &table * table.transpose() / table.ncols() as f64;
        let (precision, precision_anywhere) = (inverse.tr_mul(&inverse), Cholesky::new(anywhere)?.inverse());
        Some(Self {
            proportional: rest.proportional,
            squares: small.column_iter().map(|c| c.norm_squared()).collect(),
            deviations: covariance.diagonal().iter().map(|v| v.sqrt()).collect(),
            directions,
            reduced,
            without: Mutex::new(Arc::new([
                Missing::new(&precision, &[]),
                Missing::new(&precision_anywhere, &[]),
            ])),
            precision,
            precision_anywhere,
            hurried: false,
            crossings: small_of(&lattice.spread).tr_mul(&small_of(&lattice.spread)),
            lattice,
            table,
            whitener,
            maps,
            uncertainty,
            arch: Arch::new(),
        })
    }

    /// The same for frames that follow one another: of a wide posterior one node in four is tried. What is learned from has time.
    pub(super) fn hurried(self) -> Self {
        Self { hurried: true, ..self }
    }

    /// The maps that it was made of.
    pub(super) fn maps(&self) -> &Maps {
        &self.maps
    }

    fn stride(&self) -> usize {
        padded(self.directions.nrows(), LANES)
    }

    fn map(&self, node: usize) -> &[f64] {
        &self.reduced[node * self.stride()..][..self.directions.nrows()]
    }

    fn reduce(&self, change: &DVector<f64>) -> Reduced {
        let mut white = change.clone();
        self.whitener.l_dirty().solve_lower_triangular_mut(&mut white);
        let along = &self.directions * &white;
        let outside = (white.norm_squared() - along.norm_squared()).max(0.0);
        Reduced { along, outside }
    }

    /// Where a press is beside others at their nodes, all strengths integrated out. None where no node has a score that is a number.
    ///
    /// One node of every group is tried first. Then the others of groups that are not out of question, unless there is hurry and the
    /// posterior is wide.
    fn placed(&self, frame: &Reduced, others: &[usize], evidence: Evidence) -> Option<Placed> {
        let beside = Beside::new(self, frame, others, evidence)?;
        let fits = beside.fits(self, &self.lattice.firsts);
        let squares = beside.squares(self, &self.lattice.firsts, &fits);
        let best = (0..fits.len()).min_by(|a, b| squares[*a].total_cmp(&squares[*b]))?;
        let least = beside.score(self, self.lattice.firsts[best], &fits[best], evidence) - FAR;
        // No variance is less than that of the others alone, and no press has fewer freedoms than none.
        let far = evidence.square_of(least, beside.variance.ln(), self.channels());
        let mut scored = Vec::new();
        let mut list = Vec::new();
        for (place, (k, group)) in self.lattice.firsts.iter().zip(&self.lattice.others).enumerate() {
            if squares[place] < far {
                let score = beside.score(self, *k, &fits[place], evidence);
                if score > least {
                    scored.push(Scored {
                        node: *k,
                        score,
                        nodes: 1 + group.len(),
                    });
                    list.extend_from_slice(group);
                }
            }
        }
        if let Some(placed) = self.lattice.wide(&scored).filter(|_| self.hurried) {
            return Some(placed);
        }
        scored.iter_mut().for_each(|first| first.nodes = 1);
        scored.extend(list.iter().zip(beside.fits(self, &list)).map(|(k, fit)| Scored {
            node: *k,
            score: beside.score(self, *k, &fit, evidence),
            nodes: 1,
        }));
        self.lattice.posterior(&scored)
    }

    /// Of one node of every group the one where a press beside others leaves least.
    fn least_left(&self, frame: &Reduced, others: &[usize], evidence: Evidence) -> Option<usize> {
        let beside = Beside::new(self, frame, others, evidence)?;
        let fits = beside.fits(self, &self.lattice.firsts);
        let squares = beside.squares(self, &self.lattice.firsts, &fits);
        let best = (0..fits.len()).min_by(|a, b| squares[*a].total_cmp(&squares[*b]))?;
        squares[best].is_finite().then_some(self.lattice.firsts[best])
    }

    fn channels(&self) -> f64 {
        self.deviations.len() as f64
    }

    /// The two places, of a few spread over the sheet, at which two presses explain a frame best.
    fn best_pair(&self, frame: &Reduced, evidence: Evidence) -> Option<[usize; 2]> {
        let beside = Beside::new(self, frame, &[], evidence)?;
        let prior = beside.prior;
        let along: Vec<f64> = self.products(&self.lattice.spread, &beside.frame);
        let mut best = (f64::NEG_INFINITY, None);
        for (i, a) in self.lattice.spread.iter().enumerate() {
            for (j, b) in self.lattice.spread.iter().enumerate().skip(i + 1) {
                let [first, second] = [along[i] + prior, along[j] + prior];
                let [one, other, both] = [
                    self.squares[*a] + prior,
                    self.squares[*b] + prior,
                    self.crossings[(i, j)],
                ];
                let gain = (other * first * first + one * second * second - 2.0 * both * first * second)
                    / (one * other - both * both);
                if gain > best.0 {
                    best = (gain, Some([*a, *b]));
                }
            }
        }
        best.1
    }

    /// Products of the maps at some nodes with a padded vector along the directions.
    fn products(&self, nodes: &[usize], vector: &Aligned) -> Vec<f64> {
        let mut out = Vec::new();
        dots_of(self.arch, &self.reduced, nodes, vector, &mut out);
        out
    }

    fn padded(&self, vector: &[f64]) -> Aligned {
        let mut out = Aligned::zeros(self.stride());
        out[..vector.len()].copy_from_slice(vector);
        out
    }

    /// Strengths of presses at nodes, all at once, with their variances over the tempering, and by how much the logarithm of the
    /// evidence falls because they are free.
    fn strengths(&self, frame: &DVector<f64>, nodes: &[usize], (variance, prior): (f64, f64)) -> Option<Strengths> {
        let n = nodes.len();
        let map = |k: usize| DVector::from_column_slice(self.map(nodes[k]));
        let normal = DMatrix::from_fn(n, n, |i, j| {
            map(i).dot(&map(j)) / variance + if i == j { prior } else { 0.0 }
        });
        let right = DVector::from_fn(n, |i, _| map(i).dot(frame) / variance + prior);
        let factor = Cholesky::new(normal)?;
        let root = factor.l_dirty().diagonal();
        Some(Strengths {
            means: factor.solve(&right),
            variances: factor.inverse().diagonal(),
            free: root.iter().map(|d| (d * d / prior).ln()).sum::<f64>() * 0.5,
        })
    }

    /// What the others say where some values are missing: of the rest, and of whole frames.
    fn without(&self, missing: &[usize]) -> Arc<[Missing; 2]> {
        let mut last = self.without.lock().unwrap_or_else(PoisonError::into_inner);
        if last[0].values() != missing {
            *last = Arc::new([&self.precision, &self.precision_anywhere].map(|p| Missing::new(p, missing)));
        }
        Arc::clone(&last)
    }

    /// The presses of a frame: its changes against the sheet just before, and the place of the press before.
    pub(super) fn locate(&self, change: &[f64], before_mm: Option<[f64; 2]>, evidence: Evidence) -> Presence {
        let mut values = DVector::from_column_slice(change) - self.maps.memory_of(before_mm);
        let missing: Vec<usize> = (0..values.len()).filter(|c| !values[*c].is_finite()).collect();
        missing.iter().for_each(|c| values[*c] = 0.0);
        let most = if missing.is_empty() {
            REPETITIONS
        } else {
            REPETITIONS_WITH_MISSING
        };
        // A value that takes the place of a missing one agrees with the others: all tell no more than the part that is there.
        let there = 1.0 - missing.len() as f64 / values.len() as f64;
        let evidence = Evidence {
            tempering: evidence.tempering / there.max(f64::MIN_POSITIVE),
            ..evidence
        };
        let without = self.without(&missing);
        let [alone, anywhere] = without.as_ref();
        let (mut told, mut wild) = anywhere.replaced(&self.precision_anywhere, values.clone(), ANY);
        let mut found = Presence::default();
        for _ in 0..most {
            found = self.fit(&told, evidence);
            found.wild = wild;
            let mut mean = DVector::zeros(values.len());
            for press in &found.presses {
                mean.axpy(press.strength, &self.table.column(press.node), 1.0);
            }
            let presses: Vec<_> = (found.presses.iter().map(|p| (p.strength, self.uncertainty[p.node]))).collect();
            let variance = variance(self.proportional, &presses).max(1.0);
            let (left, of_next) = alone.replaced(&self.precision, &values - &mean, variance);
            let next = left + mean;
            let changed = next.iter().zip(&told).zip(&self.deviations);
            let changed = changed.filter(|((a, b), sd)| (*a - *b).abs() > 1e-3 * *sd).count();
            (told, wild) = (next, of_next);
            if changed == 0 {
                break;
            }
        }
        found.misfit /= there.max(f64::MIN_POSITIVE);
        for press in &mut found.presses {
            let covariance = Matrix2::from(press.covariance_mm2);
            let (place, covariance) = self.maps.pressed(press.place_mm, covariance, before_mm);
            (press.place_mm, press.covariance_mm2) = (place, covariance.into());
        }
        found
    }

    fn fit(&self, change: &DVector<f64>, evidence: Evidence) -> Presence {
        let frame = self.reduce(change);
        let square = frame.along.norm_squared() + frame.outside;
        let mut presence = Presence {
            misfit: square / change.len() as f64,
            ..Presence::default()
        };
        let at_rest = variance(self.proportional, &[]);
        let mut last = evidence.of(square / at_rest, at_rest.ln(), change.len() as f64);
        let only_one = !evidence.thorough && evidence.more.is_infinite();
        let most = if only_one { 1 } else { MOST };
        while presence.presses.len() < most {
            let Some(more) = self.with_one_more(&frame, (&presence.presses, presence.misfit), last, evidence) else {
                break;
            };
            let gain = more.score - last;
            presence.gains.push(gain);
            let least = if presence.presses.is_empty() {
                evidence.first
            } else {
                evidence.more
            };
            if gain <= least {
                break;
            }
            last = more.score;
            presence.presses = more.presses;
            presence.misfit = more.misfit;
        }
        presence.explained = 1.0 - (presence.misfit * change.len() as f64 / square.max(f64::MIN_POSITIVE)).min(1.0);
        presence.presses.sort_by(|a, b| b.strength.total_cmp(&a.strength));
        presence
    }

    /// One press more, and all of them placed anew. None where little is left and that explains no more than `last`.
    fn with_one_more(
        &self,
        frame: &Reduced,
        (presses, misfit): (&[Located], f64),
        last: f64,
        evidence: Evidence,
    ) -> Option<Settled> {
        if presses.is_empty() {
            let there = self.placed(frame, &[], evidence)?;
            return self.settled(frame, &[there.node], vec![there], evidence);
        }
        let mut nodes: Vec<usize> = presses.iter().map(|p| p.node).collect();
        nodes.push(self.least_left(frame, &nodes, evidence)?);
        // Two presses that one between them explains half are found as two at once.
        let pair = (presses.len() == 1 && misfit >= SUSPECT).then(|| self.best_pair(frame, evidence));
        let promising = |nodes: &Vec<usize>| {
            let weighed = || self.weigh(frame, nodes, evidence);
            evidence.thorough || weighed().is_some_and(|w| w.score > last && !w.is_weak())
        };
        [Some(nodes), pair.flatten().map(Vec::from)]
            .into_iter()
            .flatten()
            .filter(promising)
            .filter_map(|nodes| self.settle(frame, nodes, evidence))
            .max_by(|a, b| a.score.total_cmp(&b.score))
    }

    /// Whether any two are so near that maps cannot tell them from one between them.
    fn are_near(&self, nodes: &[usize]) -> bool {
        let least = self.maps.near_mm();
        let place = |k: usize| self.lattice.nodes_mm[nodes[k]];
        let near = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]) < least;
        (0..nodes.len()).any(|i| (0..i).any(|j| near(place(i), place(j))))
    }

    /// Places presses by turns, each beside the others, from some nodes.
    fn settle(&self, frame: &Reduced, mut nodes: Vec<usize>, evidence: Evidence) -> Option<Settled> {
        let mut placed = Vec::new();
        for _ in 0..SWEEPS {
            let before = nodes.clone();
            placed.clear();
            for k in 0..nodes.len() {
                let mut others = nodes.clone();
                others.remove(k);
                let there = self.placed(frame, &others, evidence)?;
                nodes[k] = there.node;
                placed.push(there);
            }
            if nodes == before {
                break;
            }
        }
        self.settled(frame, &nodes, placed, evidence)
    }

    /// Presses at nodes with their strengths, as the posterior has placed them. None where one of them is none, or two are one.
    fn settled(&self, frame: &Reduced, nodes: &[usize], placed: Vec<Placed>, evidence: Evidence) -> Option<Settled> {
        let weighed = self.weigh(frame, nodes, evidence)?;
        if weighed.is_weak() || self.are_near(nodes) {
            return None;
        }
        let strengths = &weighed.strengths;
        let presses = (nodes.iter().zip(placed))
            .zip(strengths.means.iter().zip(&strengths.variances))
            .map(|((node, placed), (strength, variance))| {
                let c = placed.covariance;
                Located {
                    place_mm: placed.mean_mm.into(),
                    covariance_mm2: [[c[(0, 0)], c[(0, 1)]], [c[(1, 0)], c[(1, 1)]]],
                    strength: *strength,
                    strength_sd: (variance * evidence.tempering).sqrt(),
                    node: *node,
                }
            })
            .collect();
        Some(Settled {
            presses,
            score: weighed.score,
            misfit: weighed.misfit,
        })
    }

    /// The evidence for presses at some nodes. None where their strengths cannot be told.
    fn weigh(&self, frame: &Reduced, nodes: &[usize], evidence: Evidence) -> Option<Weighed> {
        let of = |strengths: &[f64]| -> Vec<(f64, f64)> {
            (strengths.iter().zip(nodes))
                .map(|(a, n)| (*a, self.uncertainty[*n]))
                .collect()
        };
        // The rest grows with the presses, whose strengths depend on it a little.
        let prior = evidence.prior();
        let first = variance(self.proportional, &of(&vec![1.0; nodes.len()]));
        let usual = self.strengths(&frame.along, nodes, (first, prior))?;
        let grown = variance(self.proportional, &of(usual.means.as_slice()));
        let strengths = self.strengths(&frame.along, nodes, (grown, prior))?;
        let mut left = frame.along.clone();
        for (n, a) in nodes.iter().zip(&strengths.means) {
            left.axpy(-a, &DVector::from_column_slice(self.map(*n)), 1.0);
        }
        let variance = variance(self.proportional, &of(strengths.means.as_slice()));
        let channels = self.channels();
        let square = left.norm_squared() + frame.outside;
        let unusual: f64 = strengths.means.iter().map(|a| prior * (a - 1.0).powi(2)).sum();
        Some(Weighed {
            score: evidence.of(square / variance + unusual, variance.ln(), channels) - strengths.free,
            misfit: square / variance / channels,
            strengths,
        })
    }
}

/// Presses at nodes: their strengths, the logarithm of their evidence, and the mean square of what they leave, in variances.
struct Weighed {
    strengths: Strengths,
    score: f64,
    misfit: f64,
}

impl Weighed {
    /// Whether one of them is none.
    fn is_weak(&self) -> bool {
        let least = LEAST_STRENGTH.max(LEAST_PART * self.strengths.means.max());
        self.strengths.means.iter().any(|a| *a < least)
    }
}

struct Strengths {
    means: DVector<f64>,
    variances: DVector<f64>,
    free: f64,
}

/// Presses of a frame with the logarithm of their evidence.
struct Settled {
    presses: Vec<Located>,
    score: f64,
    misfit: f64,
}
