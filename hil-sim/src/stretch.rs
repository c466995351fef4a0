//! Stretching of the sheet itself, as by the body that it is drawn over.

/// Where a sheet is stretched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StretchField {
    /// All over, evenly.
    Uniform,
    /// Around a place, as over a knuckle: most in the centre, falling smoothly to 0 at the radius, `(1 - (r/R)^2)^2`.
    Bump {
        /// Centre, mm.
        centre_mm: [f64; 2],
        /// Where it ends, mm, greater than 0.
        radius_mm: f64,
    },
}

/// A stretching over time. It is a strain that is imposed: nothing of it is delayed. The electrodes' places, and the way
/// between them, stay as they are.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// Where.
    pub field: StretchField,
    /// Time (s) and strain in the centre (0.01: one per cent longer; negative: shorter), in the order of time. Between them
    /// it changes smoothly; before the first and after the last it stays as it is there.
    pub keys: Vec<(f64, f64)>,
}

impl Stretch {
    /// Strain in the centre at a time: stretching positive.
    pub fn strain(&self, t_s: f64) -> f64 {
        let (Some(first), Some(last)) = (self.keys.first(), self.keys.last()) else {
            return 0.0;
        };
        if t_s <= first.0 {
            return first.1;
        }
        let between = self.keys.windows(2).find(|w| t_s < w[1].0);
        between.map_or(last.1, |w| {
            let u = (t_s - w[0].0) / (w[1].0 - w[0].0);
            w[0].1 + (w[1].1 - w[0].1) * u * u * (3.0 - 2.0 * u)
        })
    }

    /// How much of that there is at a place, 0 to 1.
    pub fn share(&self, [x, y]: [f64; 2]) -> f64 {
        match self.field {
            StretchField::Uniform => 1.0,
            StretchField::Bump { centre_mm, radius_mm } => {
                let (dx, dy) = ((x - centre_mm[0]) / radius_mm, (y - centre_mm[1]) / radius_mm);
                let left = (1.0 - dx * dx - dy * dy).max(0.0);
                left * left
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stretch_comes_and_stays() {
        let stretch = Stretch {
            field: StretchField::Bump {
                centre_mm: [10.0, 0.0],
                radius_mm: 20.0,
            },
            keys: vec![(1.0, 0.0), (2.0, 0.02)],
        };
        assert_eq!(stretch.strain(0.5), 0.0);
        assert!((stretch.strain(1.5) - 0.01).abs() < 1e-12);
        assert_eq!(stretch.strain(9.0), 0.02);
        assert_eq!(stretch.share([10.0, 0.0]), 1.0);
        assert_eq!(stretch.share([31.0, 0.0]), 0.0);
        assert!((stretch.share([20.0, 0.0]) - 0.5625).abs() < 1e-12);
    }
}
