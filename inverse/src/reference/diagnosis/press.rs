//! What a finger on an electrode does to a frame.
//!
//! A press on an electrode is much like a worse contact: both change what flows through it. The prior of touches expects little of the
//! cells before electrodes, since they are most sensitive. A finger rises there as anywhere, and smoothly: the rises of these cells have
//! a Gaussian covariance over their distance. A fault is to explain a frame better than that.

use super::fault::Fault;
use crate::reference::imager::Imager;
use nalgebra::{Cholesky, DMatrix};

/// Standard deviation of a rise, length over which it is smooth (that of a fingertip), and how far a press on an electrode reaches, mm.
const RISE: f64 = 0.3;
const SMOOTH_MM: f64 = 6.0;
const REACH_MM: f64 = 18.0;
/// Added to the variances, as a part of them: neighbouring cells rise nearly together.
const ROUNDING: f64 = 1e-6;

/// A press that may look like a fault.
pub(super) struct Press {
    /// What it changes, V: columns of one standard deviation.
    pub(super) columns: DMatrix<f64>,
    places: usize,
}

impl Press {
    /// On the electrodes of a fault; none where no press looks like it.
    pub(super) fn instead_of(fault: Fault, imager: &Imager) -> Option<Self> {
        let (mut electrodes, places) = match fault {
            Fault::Contacts(electrodes) | Fault::Open(electrodes) => {
                (electrodes.list().to_vec(), electrodes.list().len())
            }
            // A finger that is lifted from both.
            Fault::Short { electrodes, .. } => (electrodes.to_vec(), 2),
            Fault::Gain(pair, _) | Fault::Offset(pair) | Fault::Channel(pair) | Fault::Drive(pair, _) => {
                (pair.to_vec(), 1)
            }
            Fault::Value(_, of) => (of.to_vec(), 1),
            _ => return None,
        };
        electrodes.sort_unstable();
        electrodes.dedup();
        let each: Vec<DMatrix<f64>> = electrodes.iter().map(|l| on(imager, *l)).collect();
        let columns: Vec<_> = each.iter().flat_map(DMatrix::column_iter).collect();
        (!columns.is_empty()).then(|| Self {
            columns: DMatrix::from_columns(&columns),
            places,
        })
    }

    /// At how many places it is.
    pub(super) fn places(&self) -> f64 {
        self.places as f64
    }
}

/// What a press on an electrode changes.
fn on(imager: &Imager, electrode: usize) -> DMatrix<f64> {
    let [x, y] = imager.electrodes_mm[electrode];
    let cells: Vec<(usize, [f64; 2])> = (0..imager.grid.len())
        .map(|cell| (cell, imager.grid.centre(cell)))
        .filter(|(_, at)| (at[0] - x).hypot(at[1] - y) < REACH_MM)
        .collect();
    let sensitivity = imager.sensitivity.select_columns(cells.iter().map(|(cell, _)| cell));
    let covariance = DMatrix::from_fn(cells.len(), cells.len(), |i, k| {
        let [a, b] = [cells[i].1, cells[k].1];
        let apart = (a[0] - b[0]).hypot(a[1] - b[1]) / SMOOTH_MM;
        let rounding = if i == k { ROUNDING } else { 0.0 };
        RISE * RISE * ((-0.5 * apart * apart).exp() + rounding)
    });
    match Cholesky::new(covariance) {
        Some(factor) => sensitivity * factor.l(),
        None => sensitivity * RISE,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::diagnosis::Electrodes;
    use forward::{Drive, Pattern, Sheet};

    /// The columns span a fingertip on the electrode to a twentieth of what it changes, and one on the other side of the sheet not to half.
    #[test]
    fn columns_span_smooth_rises_at_the_electrode() {
        let pattern = Pattern::adjacent(16).unwrap();
        let imager = Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 5.0).unwrap();
        let press = Press::instead_of(Fault::Contacts(Electrodes::of(&[4])), &imager).unwrap();
        assert_eq!(press.places(), 1.0);
        let [x, y] = imager.electrodes_mm[4];
        let bump = |at: [f64; 2]| {
            let sums = (0..imager.grid.len()).map(|cell| {
                let c = imager.grid.centre(cell);
                let apart = (c[0] - at[0]).hypot(c[1] - at[1]) / 7.0;
                RISE * (-0.5 * apart * apart).exp() * imager.sensitivity.column(cell)
            });
            sums.fold(nalgebra::DVector::zeros(imager.pattern.len()), |sum, one| sum + one)
        };
        let left = |change: nalgebra::DVector<f64>| {
            let svd = press.columns.clone().svd(true, false);
            let u = svd.u.unwrap();
            (&change - &u * u.tr_mul(&change)).norm() / change.norm()
        };
        assert!(left(bump([x, y])) < 0.05, "{}", left(bump([x, y])));
        assert!(left(bump([-0.5 * x, -0.5 * y])) > 0.5);
        assert!(Press::instead_of(Fault::Source, &imager).is_none());
    }
}
