//! How far touches are shifted by the electrodes' uncertainty.
//!
//! No frame shows that its electrodes are not where the model has them. A difference to the baseline that touches
//! explain looks the same with all touches a little elsewhere. This part of a touch's uncertainty is therefore computed
//! beforehand. For every direction in which the electrodes are uncertain, the sheet is modelled with them one standard
//! deviation off. The model in use is then fitted, to first order, to the response to a touch in that model.

use crate::linalg::eigen::symmetric_eigen;
use crate::reference::imager::Imager;
use forward::{Model, ModelOptions, Sensitivity, Solver};
use nalgebra::{DMatrix, DVector, Matrix4, Vector4};
use std::sync::Arc;

/// Most directions of the electrodes' uncertainty that count. A fit to the baseline leaves three and little else: all
/// electrodes turned, or spread out along either diameter (docs/results.md, "Misplaced electrodes").
const MOST_DIRECTIONS: usize = 6;
/// A direction with less than this part of the variance is left out. Chosen by hand.
const LEAST_PART: f64 = 1e-3;
/// Standard deviation of the bump that stands for a touch, over the touch's radius. A disc's is a half: its second
/// moment.
const WIDTH: f64 = 0.5;
/// The bump ends at so many of its standard deviations, where it is a hundredth of its height.
const REACH: f64 = 3.0;

/// Variance of x and y (mm²) from the electrodes' uncertainty, cell by cell.
#[derive(Clone, Debug)]
pub struct ElectrodeUncertainty {
    variance: Vec<[f64; 2]>,
}

impl ElectrodeUncertainty {
    /// For touches of about this radius; `None` when the imager's electrodes are taken as certain or a sheet with them
    /// elsewhere cannot be modelled.
    pub fn new(imager: &Imager, radius_mm: f64) -> Option<Self> {
        let covariance = imager.electrode_covariance.as_ref()?;
        let eigen = symmetric_eigen(covariance.clone())?;
        let total = eigen.eigenvalues.sum().max(f64::MIN_POSITIVE);
        let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let cells = imager.grid.len();
        // What no frame uses moves nothing: values that are next to zero on this sheet are larger with any electrode off.
        let used = imager.difference(&imager.model_v, &imager.model_v).ok()?.used;
        let used: Vec<usize> = (0..used.len()).filter(|k| used[*k]).collect();
        let sensitivity = imager.sensitivity.select_rows(&used);
        let slopes: Vec<Option<Slopes>> = (0..cells)
            .map(|cell| Slopes::new(imager, &sensitivity, cell, radius_mm))
            .collect();
        let mut variance = vec![[0.0; 2]; cells];
        for k in order.into_iter().take(MOST_DIRECTIONS) {
            if eigen.eigenvalues[k] < LEAST_PART * total {
                break;
            }
            let off = eigen.eigenvectors.column(k) * eigen.eigenvalues[k].sqrt();
            let responses = responses_with(imager, &off.into_owned())?.select_rows(&used);
            for (cell, (slopes, variance)) in slopes.iter().zip(&mut variance).enumerate() {
                let Some(slopes) = slopes else { continue };
                let shift = slopes.moved(imager, &responses, cell, radius_mm);
                variance[0] += shift[0] * shift[0];
                variance[1] += shift[1] * shift[1];
            }
        }
        Some(Self { variance })
    }

    /// Variance of x and y at a place, mm².
    pub fn variance(&self, imager: &Imager, at: [f64; 2]) -> [f64; 2] {
        let grid = &imager.grid;
        let corner = grid.low_mm();
        let [column, row] = [0, 1].map(|k| (at[k] - corner[k]) / grid.cell_mm());
        let under = (column >= 0.0 && row >= 0.0)
            .then(|| grid.at(column as usize, row as usize))
            .flatten();
        let nearest = || {
            (0..self.variance.len()).min_by(|a, b| {
                let d = |cell: usize| {
                    let [x, y] = grid.centre(cell);
                    (x - at[0]).powi(2) + (y - at[1]).powi(2)
                };
                d(*a).total_cmp(&d(*b))
            })
        };
        under.or_else(nearest).map_or([0.0; 2], |cell| self.variance[cell])
    }
}

/// The normalised sensitivity (volts of the imager's model) of the sheet with its electrodes off by this much.
fn responses_with(imager: &Imager, off: &DVector<f64>) -> Option<DMatrix<f64>> {
    let sheet = imager
        .model
        .geometry()
        .displaced(imager.model.sheet(), off.as_slice())?;
    let solver = Solver::new(Arc::new(Model::new(&sheet, &ModelOptions::default()).ok()?)).ok()?;
    let matrix = solver.electrode_matrix();
    let mut responses = Sensitivity::by_cell(&solver, &imager.grid).matrix_v(imager.drive, matrix, &imager.pattern);
    let volts = imager.drive.frame_v(matrix, &imager.pattern);
    for ((mut row, v), own) in responses.row_iter_mut().zip(volts).zip(&imager.model_v) {
        row *= own / v;
    }
    Some(responses)
}

/// Cells of a bump at a cell: which, their distance over the bump's standard deviation (x, y and as a square), and their weight.
fn cells_of(imager: &Imager, cell: usize, radius_mm: f64) -> impl Iterator<Item = (usize, [f64; 3], f64)> {
    let at = imager.grid.centre(cell);
    let s = WIDTH * radius_mm;
    (0..imager.grid.len()).filter_map(move |other| {
        let [x, y] = imager.grid.centre(other);
        let (dx, dy) = ((x - at[0]) / s, (y - at[1]) / s);
        let d2 = dx * dx + dy * dy;
        (d2 <= REACH * REACH).then(|| (other, [dx, dy, d2], (-0.5 * d2).exp()))
    })
}

/// Response to a bump at a cell.
fn bump(imager: &Imager, responses: &DMatrix<f64>, cell: usize, radius_mm: f64) -> DVector<f64> {
    let mut sum = DVector::zeros(responses.nrows());
    for (other, _, w) in cells_of(imager, cell, radius_mm) {
        sum.axpy(w, &responses.column(other), 1.0);
    }
    sum
}

/// Its derivatives by x, y and width.
fn slopes(imager: &Imager, responses: &DMatrix<f64>, cell: usize, radius_mm: f64) -> [DVector<f64>; 3] {
    let s = WIDTH * radius_mm;
    let mut slopes = std::array::from_fn(|_| DVector::zeros(responses.nrows()));
    for (other, [dx, dy, d2], w) in cells_of(imager, cell, radius_mm) {
        for (slope, d) in slopes.iter_mut().zip([dx, dy, d2 - 2.0]) {
            slope.axpy(w * d / s, &responses.column(other), 1.0);
        }
    }
    slopes
}

/// The model in use, linear about a touch: it says by how much a changed response moves the fitted touch.
pub(crate) struct Slopes {
    /// Derivatives by x, y, width and strength: the last one is the response itself.
    by: [DVector<f64>; 4],
    inverse: Matrix4<f64>,
}

impl Slopes {
    /// About a touch of this radius on a cell; `None` where the model does not tell its place.
    pub(crate) fn new(imager: &Imager, responses: &DMatrix<f64>, cell: usize, radius_mm: f64) -> Option<Self> {
        let [x, y, width] = slopes(imager, responses, cell, radius_mm);
        let by = [x, y, width, bump(imager, responses, cell, radius_mm)];
        let normal = Matrix4::from_fn(|i, j| by[i].dot(&by[j]));
        Some(Self {
            inverse: normal.try_inverse()?,
            by,
        })
    }

    fn fitted(&self, change: &DVector<f64>) -> Vector4<f64> {
        self.inverse * Vector4::from_fn(|i, _| self.by[i].dot(change))
    }

    /// By how much such a touch on a sheet that answers differently is put beside its place, mm.
    pub(crate) fn moved(&self, imager: &Imager, responses: &DMatrix<f64>, cell: usize, radius_mm: f64) -> [f64; 2] {
        let shift = self.fitted(&(bump(imager, responses, cell, radius_mm) - &self.by[3]));
        [shift[0], shift[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Drive, Pattern, Sheet};

    /// Electrodes that may be half a millimetre off put a touch no further off, in any pattern: also in one whose values are partly zero by
    /// symmetry, which are none with an electrode elsewhere.
    #[test]
    fn electrodes_that_are_a_little_off_move_touches_a_little() {
        for (drive_step, sense_step) in [(1, 1), (2, 8)] {
            let all =
                (0..16).flat_map(|d| (0..16).map(move |s| [[d, (d + drive_step) % 16], [s, (s + sense_step) % 16]]));
            let apart = all.filter(|[d, s]| !d.iter().any(|l| s.contains(l)));
            let pattern = Pattern::from_pairs(16, apart).unwrap();
            let mut imager = Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 10.0).unwrap();
            // Contacts a tenth larger or smaller, then places along the rim.
            let variances = DVector::from_fn(32, |k, _| if k < 16 { 0.01 } else { 0.25 });
            imager.electrode_covariance = Some(DMatrix::from_diagonal(&variances));
            let uncertainty = ElectrodeUncertainty::new(&imager, 12.5).unwrap();
            for at in [[0.0, 0.0], [30.0, -20.0], [65.0, 20.0], [-50.0, 40.0]] {
                let sd = uncertainty.variance(&imager, at).map(f64::sqrt);
                assert!(
                    sd.iter().all(|sd| (0.01..0.5).contains(sd)),
                    "{drive_step} {sense_step} {at:?}: {sd:?}"
                );
            }
        }
    }
}
