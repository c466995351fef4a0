//! One touch: a shape, and its way over the sheet in time.

/// What touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A flat round tip: the same pressure everywhere inside its radius, none outside.
    Disc,
    /// A finger: the pressure falls smoothly from the centre, to half at the radius.
    Finger,
    /// An elliptic pad: as a finger, half at the radius along its axis and at `aspect` times that across it.
    Pad {
        /// Width over length, greater than 0.
        aspect: f64,
    },
    /// The palm of a hand: three pads within the radius, half the palm's width. Not turned, its fingers point to +y.
    Palm,
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
    /// How far it is turned, degrees counter-clockwise.
    pub angle_deg: f64,
}

impl Key {
    /// Not turned.
    pub fn new(t_s: f64, x_mm: f64, y_mm: f64, force_n: f64) -> Self {
        Self {
            t_s,
            x_mm,
            y_mm,
            force_n,
            angle_deg: 0.0,
        }
    }
}

/// A touch. Between its keys the centre moves and the shape turns at constant speed and the force changes smoothly; before
/// the first and after the last it is not there.
#[derive(Clone, Debug, PartialEq)]
pub struct Touch {
    /// What touches.
    pub shape: Shape,
    /// Radius, mm: of the disc; of a finger where its pressure is half.
    pub radius_mm: f64,
    /// Force (N) at which a soft shape has its radius; it grows with the force's third root, and so does the pressure in
    /// it, as the contact of a ball does (Hertz). `None`: the size does not change. A disc's never does.
    pub full_size_n: Option<f64>,
    /// Keys in the order of time.
    pub keys: Vec<Key>,
}

impl Touch {
    /// A touch whose size does not change.
    pub fn new(shape: Shape, radius_mm: f64, keys: Vec<Key>) -> Self {
        Self {
            shape,
            radius_mm,
            full_size_n: None,
            keys,
        }
    }

    /// A touch at a place whose force goes through (time s, force N).
    pub fn pressed(shape: Shape, radius_mm: f64, x_mm: f64, y_mm: f64, forces: &[(f64, f64)]) -> Self {
        let key = |(t_s, force_n): &(f64, f64)| Key::new(*t_s, x_mm, y_mm, *force_n);
        Self::new(shape, radius_mm, forces.iter().map(key).collect())
    }

    /// A touch that is always there and never moves.
    pub fn still(shape: Shape, radius_mm: f64, x_mm: f64, y_mm: f64, force_n: f64) -> Self {
        Self::pressed(
            shape,
            radius_mm,
            x_mm,
            y_mm,
            &[(0.0, force_n), (f64::INFINITY, force_n)],
        )
    }

    /// The paper's tip, 25 mm across, at a place for ever.
    pub fn tip(x_mm: f64, y_mm: f64, force_n: f64) -> Self {
        Self::still(Shape::Disc, 12.5, x_mm, y_mm, force_n)
    }

    /// A finger 13.5 mm wide on a path of (time s, x mm, y mm). It comes down over `ramp_s` where the path starts, follows the
    /// path, and lifts over `ramp_s` at the end.
    pub fn finger(path: &[(f64, f64, f64)], force_n: f64, ramp_s: f64) -> Self {
        let key = |(t_s, x_mm, y_mm): (f64, f64, f64), force_n| Key::new(t_s, x_mm, y_mm, force_n);
        let mut keys: Vec<Key> = path.iter().map(|p| key(*p, force_n)).collect();
        if let (Some(first), Some(last)) = (path.first(), path.last()) {
            keys.insert(0, key((first.0 - ramp_s, first.1, first.2), 0.0));
            keys.push(key((last.0 + ramp_s, last.1, last.2), 0.0));
        }
        Self::new(Shape::Finger, 6.75, keys)
    }

    /// Centre, force and turn at a time, as a key; `None` while it does not press.
    pub fn at(&self, t_s: f64) -> Option<Key> {
        let after = self.keys.iter().position(|k| k.t_s > t_s)?;
        let key = between(self.keys.get(after.checked_sub(1)?)?, self.keys.get(after)?, t_s);
        (key.force_n > 0.0).then_some(key)
    }

    /// The touch at both ends of a time within which none of its keys lies; `None` while it is not there.
    pub(crate) fn during(&self, from_s: f64, to_s: f64) -> Option<[Key; 2]> {
        let middle = 0.5 * (from_s + to_s);
        let after = self.keys.iter().position(|k| k.t_s > middle)?;
        let (a, b) = (self.keys.get(after.checked_sub(1)?)?, self.keys.get(after)?);
        let ends = [from_s, to_s].map(|t| between(a, b, t));
        (ends[0].force_n > 0.0 || ends[1].force_n > 0.0).then_some(ends)
    }

    /// Radius under a force, mm.
    pub fn radius_under_mm(&self, force_n: f64) -> f64 {
        match self.full_size_n {
            Some(full) if self.shape != Shape::Disc => self.radius_mm * libm::cbrt(force_n / full),
            _ => self.radius_mm,
        }
    }
}

pub(crate) fn between(a: &Key, b: &Key, t_s: f64) -> Key {
    // An endless stretch never gets anywhere.
    let u = if b.t_s.is_finite() {
        ((t_s - a.t_s) / (b.t_s - a.t_s)).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let smooth = u * u * (3.0 - 2.0 * u);
    Key {
        t_s,
        x_mm: a.x_mm + (b.x_mm - a.x_mm) * u,
        y_mm: a.y_mm + (b.y_mm - a.y_mm) * u,
        force_n: a.force_n + (b.force_n - a.force_n) * smooth,
        angle_deg: a.angle_deg + (b.angle_deg - a.angle_deg) * u,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn a_soft_contact_grows_with_the_third_root_of_the_force() {
        let soft = Touch {
            full_size_n: Some(8.0),
            ..Touch::still(Shape::Finger, 6.0, 0.0, 0.0, 1.0)
        };
        assert_eq!(soft.radius_under_mm(8.0), 6.0);
        assert!((soft.radius_under_mm(1.0) - 3.0).abs() < 1e-12);
        let tip = Touch {
            full_size_n: Some(8.0),
            ..Touch::tip(0.0, 0.0, 1.0)
        };
        assert_eq!(tip.radius_under_mm(1.0), 12.5);
    }
}
