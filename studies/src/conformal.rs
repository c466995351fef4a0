//! Electrode displacements that no baseline of a disc shows.
//!
//! A conformal map of the disc onto itself displaces the point electrodes on its rim without changing their voltages.
//! Small maps move the rim by `a + b cos + c sin` of the angle, and the touches with it.

use crate::error::StudyError;
use forward::{Place, Sheet};
use nalgebra::{DMatrix, DVector};

/// A small conformal map of a disc onto itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConformalMap {
    radius_mm: f64,
    /// Turn, rad, and move of the centre, mm.
    turn: f64,
    centre_mm: [f64; 2],
}

impl ConformalMap {
    /// The least-squares fit to moves along the rim (mm, counter-clockwise) at these angles (rad), and the residual
    /// of the moves, mm.
    ///
    /// # Errors
    /// [`StudyError::Numbers`] when a number is not finite, or moves and angles differ in number.
    pub fn nearest(radius_mm: f64, moves_mm: &[f64], angles: &[f64]) -> Result<(Self, Vec<f64>), StudyError> {
        if moves_mm.len() != angles.len() || moves_mm.iter().chain(angles).any(|v| !v.is_finite()) {
            return Err(StudyError::Numbers);
        }
        let design = DMatrix::from_fn(angles.len(), 3, |l, k| [1.0, angles[l].cos(), angles[l].sin()][k]);
        let moves = DVector::from_column_slice(moves_mm);
        let found = design
            .clone()
            .svd(true, true)
            .solve(&moves, 1e-12)
            .map_err(|_| StudyError::Numbers)?;
        let left = moves - design * &found;
        let map = Self {
            radius_mm,
            turn: found[0] / radius_mm,
            // On the rim z -> z + b - conj(b) z² / R² moves along it by 2 (b_y cos - b_x sin).
            centre_mm: [-0.5 * found[2], 0.5 * found[1]],
        };
        Ok((map, left.iter().copied().collect()))
    }

    /// The displacement of a point of the disc, mm.
    pub fn move_mm(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let ([bx, by], square) = (self.centre_mm, self.radius_mm.powi(2));
        let (re, im) = ((x * x - y * y) / square, 2.0 * x * y / square);
        [
            -self.turn * y + bx - (bx * re + by * im),
            self.turn * x + by - (bx * im - by * re),
        ]
    }
}

/// Angles of a sheet's electrodes, rad; not a number for an electrode that is not placed by its angle.
pub fn angles(sheet: &Sheet) -> Vec<f64> {
    let angle = |place: &Place| match place {
        Place::Angle { angle_deg, .. } => angle_deg.to_radians(),
        _ => f64::NAN,
    };
    sheet.electrodes.iter().map(|e| angle(&e.place)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rim_moves_along_itself_as_the_electrodes_do() {
        let angles: Vec<f64> = (0..16)
            .map(|k| 0.1 + std::f64::consts::TAU * f64::from(k) / 16.0)
            .collect();
        let wave = |a: f64| 0.3 - 0.2 * a.cos() + 0.5 * a.sin();
        let moves: Vec<f64> = angles.iter().map(|a| wave(*a) + 0.1 * (3.0 * a).cos()).collect();
        let (map, left) = ConformalMap::nearest(97.5, &moves, &angles).unwrap();
        for (angle, left) in angles.iter().zip(&left) {
            assert!((left - 0.1 * (3.0 * angle).cos()).abs() < 1e-12);
            let (sin, cos) = angle.sin_cos();
            let [x, y] = map.move_mm([97.5 * cos, 97.5 * sin]);
            let (along, outward) = (y * cos - x * sin, x * cos + y * sin);
            assert!(
                (along - wave(*angle)).abs() < 1e-12 && outward.abs() < 1e-12,
                "{along} {outward}"
            );
        }
        // Conformal: the Cauchy-Riemann equations hold inside.
        let h = 1e-3;
        let d = |p: [f64; 2], q: [f64; 2]| [0, 1].map(|k| (map.move_mm(q)[k] - map.move_mm(p)[k]) / (2.0 * h));
        let (dx, dy) = (
            d([20.0 - h, 30.0], [20.0 + h, 30.0]),
            d([20.0, 30.0 - h], [20.0, 30.0 + h]),
        );
        assert!((dx[0] - dy[1]).abs() < 1e-9 && (dx[1] + dy[0]).abs() < 1e-9);
    }
}
