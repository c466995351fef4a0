//! Figures of merit of a picture of one small target, as the GREIT consensus defines them (A. Adler et al., "GREIT: a
//! unified approach to 2D linear EIT reconstruction of lung images", Physiol. Meas. 30, 2009), in EIDORS' form.
//!
//! All are taken from the pixels at and above one quarter of the greatest value, the quarter set.

use forward::CellGrid;

/// Part of the greatest value at which a pixel belongs to the target.
const QUARTER: f64 = 0.25;

/// Square pixels of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    /// Centres, mm.
    pub centres_mm: Vec<[f64; 2]>,
    /// Area of one, mm².
    pub area_mm2: f64,
}

impl Pixels {
    /// Pixels of `side_mm` whose centres are inside a disc around the origin.
    ///
    /// Grid lines run through the origin. None for a size that is not positive.
    pub fn of_disc(radius_mm: f64, side_mm: f64) -> Self {
        let half = (radius_mm / side_mm).ceil();
        let half = if side_mm > 0.0 && half.is_finite() {
            half as i64
        } else {
            0
        };
        let centre = |k: i64| (k as f64 + 0.5) * side_mm;
        let all = (-half..half).flat_map(|row| (-half..half).map(move |column| [centre(column), centre(row)]));
        Self {
            centres_mm: all.filter(|p| p[0].hypot(p[1]) < radius_mm).collect(),
            area_mm2: side_mm * side_mm,
        }
    }

    /// The cells of a grid.
    pub fn of_cells(grid: &CellGrid) -> Self {
        Self {
            centres_mm: (0..grid.len()).map(|k| grid.centre(k)).collect(),
            area_mm2: grid.cell_mm().powi(2),
        }
    }
}

/// The figures of one picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Value integrated over the picture, mm². The amplitude response AR is this value, divided by that of a target in
    /// the middle or by the true value.
    pub amplitude_mm2: f64,
    /// Position error PE, mm: how much nearer to the middle the quarter set's centre is than the target. Negative
    /// outwards.
    pub position_mm: f64,
    /// Distance of the quarter set's centre from the target, mm.
    pub distance_mm: f64,
    /// Resolution RES: square root of the part of the picture that the quarter set covers. The radius of a disc over
    /// the sheet's.
    pub resolution: f64,
    /// Shape deformation SD: part of the quarter set outside the circle of its area around its centre, 0 to 1.
    pub deformation: f64,
    /// Ringing RNG: the negative values outside the quarter set over the values in it.
    pub ringing: f64,
}

impl Figures {
    /// The figures of a picture of a target at a place, with one value for each pixel. Values that are not finite
    /// count as 0.
    ///
    /// `None` where no value is positive, or the number of values is not that of the pixels.
    pub fn of(pixels: &Pixels, values: &[f64], target_mm: [f64; 2]) -> Option<Self> {
        if values.len() != pixels.centres_mm.len() {
            return None;
        }
        let each = || {
            let finite = |v: &f64| if v.is_finite() { *v } else { 0.0 };
            pixels.centres_mm.iter().zip(values).map(move |(p, v)| (*p, finite(v)))
        };
        let highest = each().fold(0.0, |m: f64, (_, v)| m.max(v));
        if highest <= 0.0 {
            return None;
        }
        let inside = |v: f64| v >= QUARTER * highest;
        let (mut count, mut sum, mut within, mut opposite) = (0.0, [0.0; 2], 0.0, 0.0);
        for (p, v) in each() {
            if inside(v) {
                count += 1.0;
                within += v;
                sum = [sum[0] + p[0], sum[1] + p[1]];
            } else {
                opposite -= v.min(0.0);
            }
        }
        let centre = sum.map(|s| s / count);
        let square = count * pixels.area_mm2 / std::f64::consts::PI;
        let outside = each()
            .filter(|(p, v)| inside(*v) && (p[0] - centre[0]).powi(2) + (p[1] - centre[1]).powi(2) > square)
            .count();
        Some(Self {
            amplitude_mm2: pixels.area_mm2 * each().map(|(_, v)| v).sum::<f64>(),
            position_mm: target_mm[0].hypot(target_mm[1]) - centre[0].hypot(centre[1]),
            distance_mm: (target_mm[0] - centre[0]).hypot(target_mm[1] - centre[1]),
            resolution: (count / values.len() as f64).sqrt(),
            deformation: outside as f64 / count,
            ringing: opposite / within,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIM_MM: f64 = 97.5;

    fn picture(value: impl Fn([f64; 2]) -> f64) -> (Pixels, Vec<f64>) {
        let pixels = Pixels::of_disc(RIM_MM, 0.5);
        let values = pixels.centres_mm.iter().map(|p| value(*p)).collect();
        (pixels, values)
    }

    fn distance(p: [f64; 2], q: [f64; 2]) -> f64 {
        (p[0] - q[0]).hypot(p[1] - q[1])
    }

    #[test]
    fn a_perfect_disc_has_no_error_no_deformation_and_no_ringing() {
        for (at, radius, rise) in [
            ([0.0, 0.0], 12.5, 0.2),
            ([50.0, -30.0], 20.0, 3.0),
            ([-70.0, 0.0], 12.5, 1e-3),
        ] {
            let (pixels, values) = picture(|p| if distance(p, at) < radius { rise } else { 0.0 });
            let f = Figures::of(&pixels, &values, at).unwrap();
            assert!(f.position_mm.abs() < 0.02 && f.distance_mm < 0.02, "{f:?}");
            assert!((f.resolution - radius / RIM_MM).abs() < 1e-3, "{f:?}");
            assert!((f.amplitude_mm2 / (rise * std::f64::consts::PI * radius * radius) - 1.0).abs() < 0.01);
            // The pixels along the edge: half a pixel of its length at most.
            assert!(f.deformation < 0.01, "{f:?}");
            assert_eq!(f.ringing, 0.0);
        }
    }

    /// Of a cone the quarter set has three quarters of its radius; of a Gaussian, sqrt(2 ln 4) standard deviations.
    #[test]
    fn the_quarter_set_ends_at_a_quarter_of_the_height() {
        let (pixels, values) = picture(|p| (1.0 - p[0].hypot(p[1]) / 40.0).max(0.0));
        let cone = Figures::of(&pixels, &values, [0.0, 0.0]).unwrap();
        assert!((cone.resolution - 30.0 / RIM_MM).abs() < 2e-3, "{cone:?}");
        assert!((cone.amplitude_mm2 / (std::f64::consts::PI * 1600.0 / 3.0) - 1.0).abs() < 1e-3);
        let (pixels, values) = picture(|p| (-0.5 * (p[0].hypot(p[1]) / 10.0).powi(2)).exp());
        let bump = Figures::of(&pixels, &values, [0.0, 0.0]).unwrap();
        assert!(
            (bump.resolution - 10.0 * (2.0 * 4.0_f64.ln()).sqrt() / RIM_MM).abs() < 2e-3,
            "{bump:?}"
        );
    }

    /// A square of side a sticks out of the circle of its area by 4 (theta/pi - tan(theta)/pi), cos(theta) =
    /// sqrt(pi)/2.
    #[test]
    fn a_square_is_deformed_as_geometry_says() {
        let (pixels, values) = picture(|p| f64::from((p[0] - 20.0).abs() < 15.0 && p[1].abs() < 15.0));
        let f = Figures::of(&pixels, &values, [20.0, 0.0]).unwrap();
        let theta = (0.5 * std::f64::consts::PI.sqrt()).acos();
        let cap = (theta - theta.sin() * theta.cos()) / std::f64::consts::PI;
        // Four caps of the circle lie outside the square, and as much of the square outside the circle.
        assert!((f.deformation - 4.0 * cap).abs() < 0.01, "{f:?} {}", 4.0 * cap);
        assert!(f.distance_mm < 1e-9);
    }

    #[test]
    fn position_error_is_positive_towards_the_middle_and_ringing_is_what_falls() {
        let (pixels, values) = picture(|p| match distance(p, [40.0, 0.0]) {
            d if d < 10.0 => 1.0,
            d if d < 20.0 => -0.1,
            _ => 0.0,
        });
        let f = Figures::of(&pixels, &values, [43.0, 0.0]).unwrap();
        assert!(
            (f.position_mm - 3.0).abs() < 0.02 && (f.distance_mm - 3.0).abs() < 0.02,
            "{f:?}"
        );
        // A ring of three times the disc's area at a tenth of its height.
        assert!((f.ringing - 0.3).abs() < 0.005, "{f:?}");
        let f = Figures::of(&pixels, &values, [36.0, 0.0]).unwrap();
        assert!((f.position_mm + 4.0).abs() < 0.02, "{f:?}");
    }

    #[test]
    fn a_picture_of_nothing_has_no_figures() {
        let (pixels, mut values) = picture(|_| -1.0);
        assert_eq!(Figures::of(&pixels, &values, [0.0; 2]), None);
        assert_eq!(Figures::of(&pixels, &[1.0], [0.0; 2]), None);
        values[7] = f64::NAN;
        assert_eq!(Figures::of(&pixels, &values, [0.0; 2]), None);
        assert!(Pixels::of_disc(10.0, 0.0).centres_mm.is_empty());
        assert!(Pixels::of_disc(10.0, f64::NAN).centres_mm.is_empty());
    }
}
