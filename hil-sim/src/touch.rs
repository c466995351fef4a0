//! One touch: a shape, and its way over the sheet in time.

use std::f64::consts::PI;

/// What touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A flat round tip: the same pressure everywhere inside its radius, none outside.
    Disc,
    /// A finger: the pressure falls smoothly from the centre, to half at the radius.
    Finger,
}

/// Where and how hard a touch is at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Time, s.
    pub t_s: f64,
    /// Centre, mm.
    pub x_mm: f64,
    /// Centre, mm.
    pub y_mm: f64,
    /// Force, N, 0 or more.
    pub force_n: f64,
}

/// A touch. Between its keys the centre moves at constant speed and the force changes smoothly; before the first and
/// after the last it is not there.
#[derive(Clone, Debug, PartialEq)]
pub struct Touch {
    /// What touches.
    pub shape: Shape,
    /// Radius, mm: of the disc; of a finger where its pressure is half.
    pub radius_mm: f64,
    /// Keys in the order of time.
    pub keys: Vec<Key>,
}

/// The finger's pressure is `p0 (1 - (r/s)^2)^2` for r < s; it is half at this fraction of s.
const HALF: f64 = 0.541_196_100_146_197;

impl Shape {
    /// Distance from the centre beyond which there is no pressure, mm.
    pub fn reach_mm(self, radius_mm: f64) -> f64 {
        match self {
            Self::Disc => radius_mm,
            Self::Finger => radius_mm / HALF,
        }
    }

    /// Pressure at a distance from the centre, MPa. Its integral over the plane is the force.
    pub fn pressure_mpa(self, radius_mm: f64, force_n: f64, distance_mm: f64) -> f64 {
        let reach = self.reach_mm(radius_mm);
        if distance_mm >= reach {
            return 0.0;
        }
        match self {
            Self::Disc => force_n / (PI * reach * reach),
            Self::Finger => {
                let u = distance_mm / reach;
                3.0 * force_n / (PI * reach * reach) * (1.0 - u * u).powi(2)
            }
        }
    }
}

impl Touch {
    /// A touch that is always there and never moves.
    pub fn still(shape: Shape, radius_mm: f64, x_mm: f64, y_mm: f64, force_n: f64) -> Self {
        let key = |t_s| Key {
            t_s,
            x_mm,
            y_mm,
            force_n,
        };
        Self {
            shape,
            radius_mm,
            keys: vec![key(0.0), key(f64::INFINITY)],
        }
    }

    /// The paper's tip, 25 mm across, at a place for ever.
    pub fn tip(x_mm: f64, y_mm: f64, force_n: f64) -> Self {
        Self::still(Shape::Disc, 12.5, x_mm, y_mm, force_n)
    }

    /// A finger 13.5 mm wide that comes down over `ramp_s` where the path of (time s, x mm, y mm) starts, follows it, and
    /// lifts over `ramp_s` at its end.
    pub fn finger(path: &[(f64, f64, f64)], force_n: f64, ramp_s: f64) -> Self {
        let key = |(t_s, x_mm, y_mm): (f64, f64, f64), force_n| Key {
            t_s,
            x_mm,
            y_mm,
            force_n,
        };
        let mut keys: Vec<Key> = path.iter().map(|p| key(*p, force_n)).collect();
        if let (Some(first), Some(last)) = (path.first(), path.last()) {
            keys.insert(0, key((first.0 - ramp_s, first.1, first.2), 0.0));
            keys.push(key((last.0 + ramp_s, last.1, last.2), 0.0));
        }
        Self {
            shape: Shape::Finger,
            radius_mm: 6.75,
            keys,
        }
    }

    /// Centre and force at a time, as a key; `None` while it does not press.
    pub fn at(&self, t_s: f64) -> Option<Key> {
        let after = self.keys.iter().position(|k| k.t_s > t_s)?;
        let a = self.keys.get(after.checked_sub(1)?)?;
        let b = self.keys.get(after)?;
        // An endless stretch never gets anywhere.
        let u = if b.t_s.is_finite() {
            (t_s - a.t_s) / (b.t_s - a.t_s)
        } else {
            0.0
        };
        let smooth = u * u * (3.0 - 2.0 * u);
        let force_n = a.force_n + (b.force_n - a.force_n) * smooth;
        (force_n > 0.0).then_some(Key {
            t_s,
            x_mm: a.x_mm + (b.x_mm - a.x_mm) * u,
            y_mm: a.y_mm + (b.y_mm - a.y_mm) * u,
            force_n,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pressure_integrates_to_the_force() {
        for shape in [Shape::Disc, Shape::Finger] {
            let (n, reach) = (20_000, shape.reach_mm(7.0));
            let dr = reach / f64::from(n);
            let force: f64 = (0..n)
                .map(|k| (f64::from(k) + 0.5) * dr)
                .map(|r| shape.pressure_mpa(7.0, 12.0, r) * 2.0 * PI * r * dr)
                .sum();
            assert!((force / 12.0 - 1.0).abs() < 1e-6, "{shape:?} {force}");
        }
    }

    #[test]
    fn a_finger_presses_half_at_its_radius() {
        let p = |r| Shape::Finger.pressure_mpa(6.75, 10.0, r);
        assert!((p(6.75) / p(0.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_touch_comes_moves_and_goes() {
        let t = Touch::finger(&[(1.0, 0.0, 0.0), (2.0, 10.0, -20.0)], 8.0, 0.2);
        assert_eq!(t.at(0.79), None);
        assert!((t.at(0.9).unwrap().force_n - 4.0).abs() < 1e-9);
        let half = t.at(1.5).unwrap();
        assert!((half.x_mm - 5.0).abs() < 1e-9 && (half.y_mm + 10.0).abs() < 1e-9);
        assert!((half.force_n - 8.0).abs() < 1e-9);
        assert_eq!(t.at(2.21), None);
        assert_eq!(Touch::tip(1.0, 2.0, 25.0).at(1e9).unwrap().force_n, 25.0);
    }
}
