//! Measurements that hold what the press before did, as if they were of the frame before.

use super::maps::{Maps, Presses};
use super::rest::Residuals;
use nalgebra::{Matrix2, Vector2};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Chance that any measurement of a sound skin is taken for one.
const FALSE: f64 = 0.01;

/// The numbers of those that follow, by what turned measurements share, the place of the press before more than that of the press: by
/// least squares on both, beyond what chance does; and of which that leaves less than maps of the others leave of them. None where
/// nothing is shared.
pub(super) fn stale(maps: &Maps, presses: &Presses, residuals: &Residuals) -> Vec<usize> {
    let count = maps.orbits.members.len();
    if maps.orbits.count == count {
        return Vec::new();
    }
    (0..count).filter(|c| is_stale(maps, presses, residuals, *c)).collect()
}

fn is_stale(maps: &Maps, presses: &Presses, residuals: &Residuals, measurement: usize) -> bool {
    let seen = presses.places_mm.iter().zip(&presses.before_mm).enumerate();
    let rows: Vec<(Vector2<f64>, f64)> = seen
        .filter_map(|(k, (place, before))| {
            let (before, value) = ((*before)?, presses.changes[(k, measurement)]);
            let felt = maps.felt(*place, Some(before));
            let shared = [felt, before].map(|p| maps.shared_at(measurement, p));
            value.is_finite().then_some((Vector2::from(shared), value))
        })
        .collect();
    let square: Matrix2<f64> = rows.iter().map(|(s, _)| s * s.transpose()).sum();
    let product: Vector2<f64> = rows.iter().map(|(s, v)| s * *v).sum();
    let Some(inverse) = square.try_inverse() else {
        return false;
    };
    let parts = inverse * product;
    let free = rows.len().saturating_sub(2) as f64;
    let left: f64 = rows.iter().map(|(s, v)| (v - s.dot(&parts)).powi(2)).sum();
    let error = (left / free * inverse[(1, 1)]).sqrt();
    let chance = 0.5 * FALSE / maps.orbits.members.len() as f64;
    let Ok(student) = StudentsT::new(0.0, 1.0, free) else {
        return false;
    };
    let surely = parts.y.abs() > student.inverse_cdf(1.0 - chance) * error;
    let by_maps: f64 = residuals
        .values
        .column(measurement)
        .iter()
        .filter(|r| r.is_finite())
        .map(|r| r * r)
        .sum();
    surely && parts.y.abs() > parts.x.abs() && left < by_maps
}
