//! The sheet as a baseline and presses at known places tell it.
//!
//! Contacts, places of the electrodes and a smooth unevenness are unknown. A baseline tells some of that ([`UnevenSheet`]), and
//! nothing of a conformal map of the sheet onto itself. What is left moves touches, to first order linearly: a press at a known place
//! that the model finds beside it tells of the same unknowns. So the presses are one more linear Gaussian measurement of them
//! (Tarantola 2005, section 3.2). The model then answers as the sheet does that they tell, and what is still uncertain of it is in the
//! uncertainty of touches. Where the model explains baseline and presses, nothing changes.

use crate::linalg::eigen::symmetric_eigen;
use crate::reference::ToldSheet;
use crate::reference::electrode_fit::UnevenSheet;
use crate::reference::imager::Imager;
use crate::reference::inspection::Inspection;
use crate::stats::median;
use crate::touches::fit::electrode_uncertainty::Slopes;
use crate::touches::fit::prior::FitOptions;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Most directions in which the sheet is taken as uncertain after its baseline.
const MOST_DIRECTIONS: usize = 40;
/// What moves a touch by 1 mm, about: 1 in the logarithm of a contact, mm of a place, 1 in the logarithm of the resistivity. It only
/// orders the directions.
const UNITS: [f64; 3] = [2.0, 1.0, 0.2];
/// Directions that move touches by less, mm, are left out.
const LEAST_MM: f64 = 0.01;
/// Cells from one node of the table to the next.
const EVERY: usize = 2;
/// How often the unknowns are found anew, about those that were found.
const ROUNDS: usize = 2;
/// Degrees of freedom of the distribution of what presses leave: a single one that is far off tells less.
const FREEDOM: f64 = 8.0;
/// How often presses are weighed by that.
const WEIGHED: usize = 4;
/// Fewest presses.
const FEWEST: usize = 5;

/// A press at a known place, as the model alone located it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPress {
    /// Where it was, mm.
    pub place_mm: [f64; 2],
    /// Where the model puts it, mm.
    pub found_mm: [f64; 2],
    /// Standard deviations of that by the frame's noise alone, with the electrodes trusted ([`ToldSheet::trusted`]), mm.
    pub sd_mm: [f64; 2],
}

/// What presses told of the model's places.
#[derive(Clone, Debug, PartialEq)]
pub struct Told {
    /// The sheet as they told it.
    pub sheet: ToldSheet,
    /// Distances of the presses from where the model puts them with what the others told, mm, in their order.
    pub errors_mm: Vec<f64>,
    /// Whether they are used: that is not farther than without, by more than one standard error.
    pub stands: bool,
    /// Root mean square of how far the model alone puts touches beside their places, at those of the presses, mm.
    pub moved_mm: f64,
}

/// From what the model made of a baseline, and presses. `None` where no electrodes were found in the baseline, of fewer than five
/// presses, and where the model cannot be solved.
pub fn told(inspection: &Inspection, presses: &[SeenPress]) -> Option<Told> {
    let fit = inspection.electrodes.as_ref().filter(|_| presses.len() >= FEWEST)?;
    let imager = &fit.imager;
    let sheet = UnevenSheet::of(fit, &inspection.baseline.values_v)?;
    let lattice = Lattice::new(imager);
    let directions = directions(&sheet)?;
    let count = directions.ncols();
    let mut about = sheet.mean.clone();
    let mut off = lattice.moved(imager, &sheet, &about)?;
    let slopes = (0..count)
        .map(|k| {
            let there = lattice.moved(imager, &sheet, &(&about + directions.column(k)))?;
            Some(
                there
                    .iter()
                    .zip(&off)
                    .map(|(a, b)| [a[0] - b[0], a[1] - b[1]])
                    .collect(),
            )
        })
        .collect::<Option<Vec<Vec<[f64; 2]>>>>()?;
    let at = |table: &[[f64; 2]], place: [f64; 2], axis: usize| -> f64 {
        let nodes = lattice.nodes.around(place);
        nodes.iter().map(|(k, w)| w * table[*k][axis]).sum()
    };
    // A row for each coordinate of each press.
    let rows: Vec<(usize, usize)> = (0..presses.len()).flat_map(|k| [(k, 0), (k, 1)]).collect();
    let by = DMatrix::from_fn(rows.len(), count, |r, d| {
        let (k, axis) = rows[r];
        at(&slopes[d], presses[k].place_mm, axis)
    });
    let mut along = DVector::zeros(count);
    let mut known = None;
    for _ in 0..ROUNDS {
        // What the unknowns would have to do if all were linear about the baseline's.
        let left = DVector::from_iterator(
            rows.len(),
            rows.iter().map(|(k, axis)| {
                let press = &presses[*k];
                press.found_mm[*axis] - press.place_mm[*axis] - at(&off, press.place_mm, *axis)
            }),
        );
        let told = Posterior::new(&by, &(left + &by * &along), presses)?;
        along.clone_from(&told.mean);
        about = &sheet.mean + &directions * &along;
        off = lattice.moved(imager, &sheet, &about)?;
        known = Some(told);
    }
    let told = known?;
    let root = told.root()?;
    let sd = (0..off.len()).map(|node| {
        [0, 1].map(|axis| {
            let slope = DVector::from_iterator(count, slopes.iter().map(|s| s[node][axis]));
            told.growth * root.tr_mul(&slope).norm()
        })
    });
    let sheet = ToldSheet {
        bumps: sheet.distance,
        unknowns: about.iter().copied().map(rounded).collect(),
        sd_mm: sd.map(|sd| sd.map(rounded)).collect(),
        ..lattice.nodes
    };
    let errors_mm = told.errors_mm(&by);
    let alone: Vec<f64> = presses.iter().map(alone_mm).collect();
    let sds: Vec<f64> = presses.iter().map(|p| p.sd_mm[0].hypot(p.sd_mm[1])).collect();
    let floor = median(sds.iter().copied());
    // Unless presses speak against them by more than they happen to say: one standard error of the mean gain. Where they tell little,
    // little moves.
    let loss = |e: &f64| (e * e + floor * floor).ln();
    let gains: Vec<f64> = alone.iter().zip(&errors_mm).map(|(a, e)| loss(a) - loss(e)).collect();
    let count = gains.len() as f64;
    let gain = gains.iter().sum::<f64>() / count;
    let square: f64 = gains.iter().map(|g| (g - gain).powi(2)).sum();
    let error = (square / (count * (count - 1.0))).sqrt();
    let moved: f64 = presses
        .iter()
        .map(|p| {
            [0, 1]
                .map(|axis| at(&off, p.place_mm, axis).powi(2))
                .iter()
                .sum::<f64>()
        })
        .sum();
    let moved_mm = (moved / presses.len() as f64).sqrt();
    (sheet.is_sound() && moved_mm.is_finite()).then_some(Told {
        stands: gain > -error,
        sheet,
        errors_mm,
        moved_mm,
    })
}

/// Whether a sheet's model locates presses better than what was learned from them, so that it is used: by its median and by its 95th
/// percentile, mm, of presses that told it nothing.
pub fn model_is_better(model_mm: [f64; 2], learned_mm: [f64; 2]) -> bool {
    model_mm[0] < learned_mm[0] && model_mm[1] < learned_mm[1]
}

fn alone_mm(press: &SeenPress) -> f64 {
    (press.found_mm[0] - press.place_mm[0]).hypot(press.found_mm[1] - press.place_mm[1])
}

/// To a millionth.
fn rounded(v: f64) -> f64 {
    (1e6 * v).round() / 1e6
}

/// Columns by which the unknowns deviate after a baseline, those first that move touches most.
fn directions(sheet: &UnevenSheet) -> Option<DMatrix<f64>> {
    let n = sheet.electrodes;
    let unit = |k: usize| UNITS[(k / n).min(2)];
    let size = sheet.mean.len();
    let scaled = DMatrix::from_fn(size, size, |i, j| sheet.covariance[(i, j)] / (unit(i) * unit(j)));
    let eigen = symmetric_eigen(scaled)?;
    let mut order: Vec<usize> = (0..size)
        .filter(|k| eigen.eigenvalues[*k] > LEAST_MM * LEAST_MM)
        .collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    order.truncate(MOST_DIRECTIONS);
    Some(DMatrix::from_fn(size, order.len(), |i, k| {
        unit(i) * eigen.eigenvectors[(i, order[k])] * eigen.eigenvalues[order[k]].sqrt()
    }))
}

/// The nodes of a table, with what the model makes of a touch there.
struct Lattice {
    nodes: ToldSheet,
    /// Of every node the cell that stands for it.
    slopes: Vec<Option<(usize, Slopes)>>,
    radius_mm: f64,
}

impl Lattice {
    fn new(imager: &Imager) -> Self {
        let grid = &imager.grid;
        let radius_mm = FitOptions::for_extent(imager.reach_mm()).radius_mm;
        let (columns, rows) = grid.shape();
        let [columns, rows] = [columns, rows].map(|n| n.div_ceil(EVERY) + 1);
        let step_mm = EVERY as f64 * grid.cell_mm();
        // Nodes are the centres of cells.
        let first_mm = grid.low_mm().map(|low| low + 0.5 * grid.cell_mm());
        let slopes: Vec<Option<(usize, Slopes)>> = (0..columns * rows)
            .map(|k| {
                let node = [0, 1].map(|axis| first_mm[axis] + step_mm * [k % columns, k / columns][axis] as f64);
                let cell = nearest(imager, node)?;
                let slopes = Slopes::new(imager, &imager.sensitivity, cell, radius_mm)?;
                Some((cell, slopes))
            })
            .collect();
        Self {
            nodes: ToldSheet {
                first_mm,
                step_mm,
                columns,
                sd_mm: vec![[0.0; 2]; columns * rows],
                ..ToldSheet::trusted()
            },
            slopes,
            radius_mm,
        }
    }

    /// By how much touches on a sheet with these unknowns are put beside their places, at every node.
    fn moved(&self, imager: &Imager, sheet: &UnevenSheet, unknowns: &DVector<f64>) -> Option<Vec<[f64; 2]>> {
        let responses = sheet.responses(imager, unknowns, &imager.grid)?;
        let at = |node: &Option<(usize, Slopes)>| match node {
            Some((cell, slopes)) => slopes.moved(imager, &responses, *cell, self.radius_mm),
            None => [0.0; 2],
        };
        Some(self.slopes.iter().map(at).collect())
    }
}

fn nearest(imager: &Imager, place_mm: [f64; 2]) -> Option<usize> {
    let d2 = |cell: usize| {
        let [x, y] = imager.grid.centre(cell);
        (x - place_mm[0]).powi(2) + (y - place_mm[1]).powi(2)
    };
    (0..imager.grid.len()).min_by(|a, b| d2(*a).total_cmp(&d2(*b)))
}

/// The unknowns along their directions, of which each has variance 1 before the presses.
struct Posterior {
    mean: DVector<f64>,
    factor: Cholesky<f64, nalgebra::Dyn>,
    /// What the unknowns are to explain, and its variances.
    left: DVector<f64>,
    variances: Vec<f64>,
    /// By how much deviations are larger than the frames' noise says.
    growth: f64,
}

impl Posterior {
    fn new(by: &DMatrix<f64>, left: &DVector<f64>, presses: &[SeenPress]) -> Option<Self> {
        let own: Vec<f64> = presses.iter().flat_map(|p| p.sd_mm.map(|sd| sd * sd)).collect();
        let mut told = Self::weighed(by, left, own.clone())?;
        for _ in 0..WEIGHED {
            let off = left - by * &told.mean;
            let weighed = own.iter().enumerate().map(|(r, v)| {
                let both = [r & !1, r | 1].map(|r| off[r] * off[r] / own[r]).iter().sum::<f64>();
                v * (FREEDOM + both) / (FREEDOM + 2.0)
            });
            told = Self::weighed(by, left, weighed.collect())?;
        }
        // What presses leave that told nothing of it, over what is expected.
        let squares: Vec<f64> = told.others(by).map(|(off, variance)| off * off / variance).collect();
        let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
        told.growth = mean.max(1.0).sqrt();
        told.growth.is_finite().then_some(told)
    }

    fn weighed(by: &DMatrix<f64>, left: &DVector<f64>, variances: Vec<f64>) -> Option<Self> {
        let over = DMatrix::from_fn(by.nrows(), by.ncols(), |r, d| by[(r, d)] / variances[r]);
        let factor = Cholesky::new(DMatrix::identity(by.ncols(), by.ncols()) + over.tr_mul(by))?;
        Some(Self {
            mean: factor.solve(&over.tr_mul(left)),
            factor,
            left: left.clone(),
            variances,
            growth: 1.0,
        })
    }

    /// A root of the covariance.
    fn root(&self) -> Option<DMatrix<f64>> {
        self.factor.inverse().cholesky().map(|c| c.unpack())
    }

    /// Of every coordinate what it is beside what the other presses told, and the variance of that.
    fn others(&self, by: &DMatrix<f64>) -> impl Iterator<Item = (f64, f64)> {
        let covariance = self.factor.inverse();
        (0..by.nrows() / 2).flat_map(move |k| {
            // Leaving out a press: by the inverse of what its own two rows leave.
            let rows = by.rows(2 * k, 2);
            let spread = rows * &covariance * rows.transpose();
            let own = nalgebra::Matrix2::new(self.variances[2 * k], 0.0, 0.0, self.variances[2 * k + 1]);
            let spread = nalgebra::Matrix2::from_fn(|i, j| spread[(i, j)]);
            let off = nalgebra::Vector2::from_fn(|i, _| self.left[2 * k + i]) - {
                let told = rows * &self.mean;
                nalgebra::Vector2::from_fn(|i, _| told[i])
            };
            let inverse = (own - spread).try_inverse().unwrap_or_default();
            let off = own * inverse * off;
            let whole = own * inverse * own;
            [(off[0], whole[(0, 0)]), (off[1], whole[(1, 1)])]
        })
    }

    fn errors_mm(&self, by: &DMatrix<f64>) -> Vec<f64> {
        let offs: Vec<f64> = self.others(by).map(|(off, _)| off).collect();
        offs.chunks_exact(2).map(|o| o[0].hypot(o[1])).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};

    /// Presses that tell of five unknowns, and what they are to explain.
    fn presses(count: usize) -> (DMatrix<f64>, DVector<f64>, Vec<SeenPress>) {
        let mut random = StdRng::seed_from_u64(5);
        let by = DMatrix::from_fn(2 * count, 5, |_, _| random.random_range(-1.0..1.0));
        let left = DVector::from_fn(2 * count, |_, _| random.random_range(-0.3..0.3));
        let press = |_| SeenPress {
            place_mm: [0.0; 2],
            found_mm: [0.0; 2],
            sd_mm: [random.random_range(0.05..0.3), random.random_range(0.05..0.3)],
        };
        (by, left, (0..count).map(press).collect())
    }

    #[test]
    fn what_a_press_is_beside_is_what_the_others_tell() {
        let (by, left, seen) = presses(9);
        let variances: Vec<f64> = seen.iter().flat_map(|p| p.sd_mm.map(|sd| sd * sd)).collect();
        let all = Posterior::weighed(&by, &left, variances.clone()).unwrap();
        let found: Vec<(f64, f64)> = all.others(&by).collect();
        for k in 0..9 {
            let rows: Vec<usize> = (0..18).filter(|r| r / 2 != k).collect();
            let others = Posterior::weighed(
                &by.select_rows(&rows),
                &left.select_rows(&rows),
                rows.iter().map(|r| variances[*r]).collect(),
            )
            .unwrap();
            for r in [2 * k, 2 * k + 1] {
                let row = by.row(r);
                let off = left[r] - (row * &others.mean)[0];
                let variance = variances[r] + (row * others.factor.inverse() * row.transpose())[0];
                assert!((found[r].0 - off).abs() < 1e-9, "{r}: {} {off}", found[r].0);
                assert!((found[r].1 - variance).abs() < 1e-9, "{r}: {} {variance}", found[r].1);
            }
        }
    }

    #[test]
    fn one_gross_press_hardly_tells() {
        let (by, _, seen) = presses(20);
        let truth = DVector::from_column_slice(&[0.5, -0.3, 0.2, 0.0, 0.1]);
        let mut left = &by * &truth;
        let without = Posterior::new(&by, &left, &seen).unwrap().mean;
        left[6] += 30.0;
        let with = Posterior::new(&by, &left, &seen).unwrap().mean;
        let least_squares = Posterior::weighed(&by, &left, vec![0.04; 40]).unwrap().mean;
        assert!((&without - &truth).norm() < 0.1, "{without}");
        assert!(
            (&with - &without).norm() < 0.2 * (&least_squares - &without).norm(),
            "{with} {least_squares}"
        );
    }

    #[test]
    fn a_model_is_better_by_both_errors_only() {
        assert!(model_is_better([0.1, 0.3], [1.5, 3.5]));
        assert!(!model_is_better([0.1, 4.0], [1.5, 3.5]));
        assert!(!model_is_better([1.6, 3.0], [1.5, 3.5]));
    }
}
