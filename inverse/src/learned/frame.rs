//! Where a sheet is and how its electrodes go round; where presses are felt on one that the press before displaced.

use super::sensitivities::Sensitivities;
use nalgebra::{Complex, Matrix2, Vector2};
use serde::Serialize;
use std::f64::consts::TAU;

/// Iterations that find where a press is felt; each squares what is left.
const INVERTED: usize = 4;
/// Largest part by which a sheet is displaced: what is felt at one place is pressed at one place.
pub(super) const MOST_DISPLACED: f64 = 0.5;
/// Largest stretch: a sheet that conducts sixteen times as well along as across.
pub(super) const MOST_STRETCHED: f64 = 0.6;

/// Where the presses are, and how the electrodes go round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    /// Around what the sheet is turned.
    pub(super) centre_mm: [f64; 2],
    /// Distance of the farthest press from it.
    pub(super) reach_mm: f64,
    /// Radius of the sheet.
    pub(super) radius_mm: f64,
    /// Electrodes on the rim.
    pub(super) electrodes: usize,
    /// Whether their numbers go round clockwise.
    pub(super) clockwise: bool,
    /// Q of [`Sensitivities`]: how a sheet is stretched to one that conducts as well in all directions; 0 where it does.
    pub(super) stretch: Complex<f64>,
}

/// How much better a sheet conducts along its grain than across, as presses tell it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Grain {
    /// Conductivity along it over that across.
    pub ratio: f64,
    /// Its direction, degrees counter-clockwise from the x axis, 0 to 180.
    pub along_deg: f64,
}

impl Frame {
    /// None where the sheet conducts alike in all directions.
    pub(super) fn grain(&self) -> Option<Grain> {
        let (size, argument) = self.stretch.to_polar();
        (size > 0.0).then(|| Grain {
            ratio: ((1.0 + size) / (1.0 - size)).powi(2),
            along_deg: (0.5 * argument.to_degrees() + 90.0).rem_euclid(180.0),
        })
    }

    pub(super) fn basis(&self) -> Sensitivities {
        Sensitivities::new(self.centre_mm, self.radius_mm, self.stretch)
    }

    /// The angle by which a measurement is turned by so many electrodes, counter-clockwise.
    pub(super) fn angle(&self, turned: usize) -> f64 {
        let angle = TAU * turned as f64 / self.electrodes as f64;
        if self.clockwise { -angle } else { angle }
    }

    /// How far a place of the sheet gives way, over the middle: as a plate that is clamped at its rim bends (Timoshenko and
    /// Woinowsky-Krieger 1959, article 16); and how that changes with the place, per mm.
    pub(super) fn loose(&self, place_mm: [f64; 2]) -> (f64, Vector2<f64>) {
        let over = Vector2::from([0, 1].map(|k| (place_mm[k] - self.centre_mm[k]) / self.radius_mm));
        let held = (1.0 - over.norm_squared()).max(0.0);
        (held * held, over * (-4.0 * held / self.radius_mm))
    }

    /// Where a press is that is felt at some place, and how that changes with it: the press before has displaced the sheet by a part of
    /// its own way from the middle.
    pub(super) fn pressed(
        &self,
        felt_mm: [f64; 2],
        before_mm: Option<[f64; 2]>,
        part: f64,
    ) -> ([f64; 2], Matrix2<f64>) {
        let Some(before) = before_mm else {
            return (felt_mm, Matrix2::identity());
        };
        let way = Vector2::from([0, 1].map(|k| part * (before[k] - self.centre_mm[k])));
        let (loose, slope) = self.loose(felt_mm);
        let place = Vector2::from(felt_mm) - way * loose;
        (place.into(), Matrix2::identity() - way * slope.transpose())
    }

    /// Variance of a coordinate of a press that is felt there, mm², where nobody knows the press before: it may have been anywhere within
    /// the reach, of whose disc a coordinate's variance is a quarter of the square.
    pub(super) fn unknown_mm2(&self, felt_mm: [f64; 2], part: f64) -> f64 {
        (part * self.loose(felt_mm).0 * self.reach_mm).powi(2) / 4.0
    }

    /// Where a press is felt: the inverse of [`Frame::pressed`], by Newton's method.
    pub(super) fn felt(&self, place_mm: [f64; 2], before_mm: Option<[f64; 2]>, part: f64) -> [f64; 2] {
        let mut felt = Vector2::from(place_mm);
        for _ in 0..INVERTED {
            let (place, slope) = self.pressed(felt.into(), before_mm, part);
            let off = Vector2::from(place_mm) - Vector2::from(place);
            felt += slope.try_inverse().unwrap_or_default() * off;
        }
        felt.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_axes_of_the_stretched_sheet_tell_its_grain() {
        let grain = |stretch| {
            let frame = Frame {
                centre_mm: [0.0; 2],
                reach_mm: 40.0,
                radius_mm: 50.0,
                electrodes: 16,
                clockwise: false,
                stretch,
            };
            frame.grain()
        };
        assert_eq!(grain(Complex::ZERO), None);
        // Lengths are over the roots of the conductivities: 1 along x, and 1 / 3 along y, where it conducts nine times as well.
        let along_y = grain(Complex::new(0.5, 0.0)).unwrap();
        assert!((along_y.ratio - 9.0).abs() < 1e-12 && (along_y.along_deg - 90.0).abs() < 1e-12);
        let along_x = grain(Complex::new(-0.5, 0.0)).unwrap();
        assert!(along_x.along_deg.min(180.0 - along_x.along_deg) < 1e-9, "{along_x:?}");
        let askew = grain(Complex::from_polar(0.2, 0.5)).unwrap();
        assert!(
            (askew.along_deg - 90.0 - 0.25_f64.to_degrees()).abs() < 1e-9,
            "{askew:?}"
        );
    }

    #[test]
    fn where_a_press_is_felt_tells_where_it_is_and_how_that_changes() {
        let frame = Frame {
            centre_mm: [3.0, -2.0],
            reach_mm: 40.0,
            radius_mm: 50.0,
            electrodes: 16,
            clockwise: false,
            stretch: Complex::ZERO,
        };
        let before = Some([30.0, -20.0]);
        for part in [-MOST_DISPLACED, -0.1, 0.0, 0.2, MOST_DISPLACED] {
            for place in [[3.0, -2.0], [20.0, 5.0], [-18.0, -22.0], [3.0, 37.0], [90.0, 0.0]] {
                let felt = frame.felt(place, before, part);
                let (back, slope) = frame.pressed(felt, before, part);
                assert!(
                    (Vector2::from(back) - Vector2::from(place)).norm() < 1e-6,
                    "{part} {place:?}"
                );
                for axis in 0..2 {
                    let mut beside = felt;
                    beside[axis] += 1e-4;
                    let moved = Vector2::from(frame.pressed(beside, before, part).0) - Vector2::from(back);
                    assert!((moved / 1e-4 - slope.column(axis)).norm() < 1e-3, "{part} {place:?}");
                }
            }
        }
        assert_eq!(frame.felt([7.0, 8.0], None, 0.3), [7.0, 8.0]);
    }
}
