//! Pressure below what touches: a few bumps, each an ellipse on the sheet.

use crate::material::Kernel;
use crate::touch::Shape;
use std::f64::consts::PI;

/// The bump's pressure is `p0 (1 - q)^2` for q < 1, q the square of the distance over the half axes' length; it is half at
/// this fraction of the way.
pub(crate) const HALF: f64 = 0.541_196_100_146_197;

/// One elliptic bump of pressure at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bump {
    /// The same pressure everywhere inside, none outside; only for circles. Else it falls smoothly to 0 at the edge.
    pub(crate) flat: bool,
    pub(crate) centre_mm: [f64; 2],
    /// Half axes, mm: where the pressure ends.
    pub(crate) half_axes_mm: [f64; 2],
    /// Cosine and sine of the first axis' direction.
    pub(crate) direction: [f64; 2],
    /// Pressure in the centre, MPa.
    pub(crate) peak_mpa: f64,
}

impl Bump {
    /// Largest half axis, mm.
    pub(crate) fn reach_mm(&self) -> f64 {
        self.half_axes_mm[0].max(self.half_axes_mm[1])
    }

    /// Pressure at a place, MPa.
    pub(crate) fn pressure_mpa(&self, [x, y]: [f64; 2]) -> f64 {
        let (dx, dy) = (x - self.centre_mm[0], y - self.centre_mm[1]);
        let [cos, sin] = self.direction;
        let along = (dx * cos + dy * sin) / self.half_axes_mm[0];
        let across = (dy * cos - dx * sin) / self.half_axes_mm[1];
        let q = along * along + across * across;
        match (q < 1.0, self.flat) {
            (false, _) => 0.0,
            (true, true) => self.peak_mpa,
            (true, false) => self.peak_mpa * (1.0 - q) * (1.0 - q),
        }
    }

    /// What a time in which this bump became `end` adds to the delayed pressure (MPa) at a place. Its centre goes along a
    /// straight line; the pressure in it, or at the place for one that is not flat, does too.
    pub(crate) fn delayed_mpa(&self, end: &Self, kernel: &Kernel, p: [f64; 2]) -> f64 {
        if !self.flat {
            return kernel.added([self.pressure_mpa(p), end.pressure_mpa(p)]);
        }
        let Some((from, to)) = self.covered(end, p) else {
            return 0.0;
        };
        let at = |u: f64| self.peak_mpa + (end.peak_mpa - self.peak_mpa) * u;
        let part = Kernel::of_length(kernel.length * (to - from));
        let since = Kernel::of_length(kernel.length * (1.0 - to));
        since.decay * part.added([at(from), at(to)])
    }

    /// From when to when (0 to 1) a flat bump that goes straight to where `end` is covers a place.
    fn covered(&self, end: &Self, p: [f64; 2]) -> Option<(f64, f64)> {
        let v = [0, 1].map(|k| end.centre_mm[k] - self.centre_mm[k]);
        let w = [0, 1].map(|k| p[k] - self.centre_mm[k]);
        let (a, b) = (v[0] * v[0] + v[1] * v[1], w[0] * v[0] + w[1] * v[1]);
        let c = w[0] * w[0] + w[1] * w[1] - self.half_axes_mm[0] * self.half_axes_mm[0];
        if a == 0.0 {
            return (c < 0.0).then_some((0.0, 1.0));
        }
        let inside = b * b - a * c;
        if inside <= 0.0 {
            return None;
        }
        let root = inside.sqrt();
        let (from, to) = (((b - root) / a).max(0.0), ((b + root) / a).min(1.0));
        (from < to).then_some((from, to))
    }
}

/// A bump of a shape, in units of the shape's radius, in the shape's own frame.
#[derive(Clone, Copy, Debug)]
struct Part {
    flat: bool,
    centre: [f64; 2],
    /// Half axes to where the pressure ends.
    half_axes: [f64; 2],
    tilt_deg: f64,
    /// Of the force.
    share: f64,
}

impl Part {
    const fn soft(centre: [f64; 2], half: [f64; 2], tilt_deg: f64, share: f64) -> Self {
        Self {
            flat: false,
            centre,
            half_axes: [half[0] / HALF, half[1] / HALF],
            tilt_deg,
            share,
        }
    }

    fn bump(&self, radius_mm: f64, force_n: f64, centre_mm: [f64; 2], angle_deg: f64) -> Bump {
        let (sin, cos) = libm::sincos(angle_deg.to_radians());
        let (tilt_sin, tilt_cos) = libm::sincos((angle_deg + self.tilt_deg).to_radians());
        let half_axes_mm = self.half_axes.map(|a| a * radius_mm);
        // The mean of (1 - q)^2 over the ellipse is a third.
        let fullness = if self.flat { 1.0 } else { 1.0 / 3.0 };
        let [x, y] = self.centre.map(|c| c * radius_mm);
        Bump {
            flat: self.flat,
            centre_mm: [centre_mm[0] + x * cos - y * sin, centre_mm[1] + x * sin + y * cos],
            half_axes_mm,
            direction: [tilt_cos, tilt_sin],
            peak_mpa: self.share * force_n / (PI * half_axes_mm[0] * half_axes_mm[1] * fullness),
        }
    }
}

/// A palm with the fingers towards +y, in half widths: the two balls of the hand, and the heads of the metacarpals.
const PALM: [Part; 3] = [
    Part::soft([-0.50, -0.45], [0.30, 0.45], 20.0, 0.35),
    Part::soft([0.50, -0.45], [0.28, 0.50], -10.0, 0.35),
    Part::soft([0.0, 0.60], [0.75, 0.22], 0.0, 0.30),
];

impl Shape {
    /// The bumps of the shape with this radius, force, centre and turn; their pressures' integrals add up to the force.
    pub(crate) fn bumps(
        self,
        radius_mm: f64,
        force_n: f64,
        centre_mm: [f64; 2],
        angle_deg: f64,
    ) -> impl Iterator<Item = Bump> {
        let one = |part| [Some(part), None, None];
        let parts = match self {
            Self::Disc => one(Part {
                flat: true,
                centre: [0.0; 2],
                half_axes: [1.0; 2],
                tilt_deg: 0.0,
                share: 1.0,
            }),
            Self::Finger => one(Part::soft([0.0; 2], [1.0; 2], 0.0, 1.0)),
            Self::Pad { aspect } => one(Part::soft([0.0; 2], [1.0, aspect], 0.0, 1.0)),
            Self::Palm => PALM.map(Some),
        };
        parts
            .into_iter()
            .flatten()
            .map(move |p| p.bump(radius_mm, force_n, centre_mm, angle_deg))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::Material;

    const SHAPES: [Shape; 4] = [Shape::Disc, Shape::Finger, Shape::Pad { aspect: 0.4 }, Shape::Palm];

    #[test]
    fn the_pressure_integrates_to_the_force() {
        for shape in SHAPES {
            let bumps: Vec<Bump> = shape.bumps(7.0, 12.0, [3.0, -2.0], 31.0).collect();
            let h = 0.02;
            let mut force = 0.0;
            for i in -1000..1000 {
                for j in -1000..1000 {
                    let p = [(f64::from(i) + 0.5) * h, (f64::from(j) + 0.5) * h];
                    force += bumps.iter().map(|b| b.pressure_mpa(p)).sum::<f64>() * h * h;
                }
            }
            assert!((force / 12.0 - 1.0).abs() < 1e-3, "{shape:?} {force}");
        }
    }

    #[test]
    fn a_finger_presses_half_at_its_radius() {
        let bump = Shape::Finger.bumps(6.75, 10.0, [0.0; 2], 0.0).next().unwrap();
        let p = |x| bump.pressure_mpa([x, 0.0]);
        assert!((p(6.75) / p(0.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_turned_shape_is_the_shape_seen_turned() {
        for shape in SHAPES {
            let [still, turned] = [0.0, 90.0].map(|a| shape.bumps(20.0, 5.0, [0.0; 2], a).collect::<Vec<_>>());
            for p in [[3.0, 8.0], [-11.0, 2.0], [0.0, 15.0]] {
                let sum = |bumps: &[Bump], p| bumps.iter().map(|b| b.pressure_mpa(p)).sum::<f64>();
                let (a, b) = (sum(&still, p), sum(&turned, [-p[1], p[0]]));
                assert!((a - b).abs() < 1e-12, "{shape:?} {a} {b}");
            }
        }
    }

    /// What an edge that sweeps over a place leaves, against many short steps.
    #[test]
    fn a_sweeping_disc_is_exact() {
        let bump = |x: f64, force| Shape::Disc.bumps(5.0, force, [x, 0.0], 0.0).next().unwrap();
        let (start, end) = (bump(0.0, 10.0), bump(8.0, 16.0));
        let material = Material::viscoelastic();
        for p in [[6.0, 1.0], [0.0, 4.0], [4.0, 0.0], [7.0, -3.0], [0.0, 5.5], [20.0, 0.0]] {
            let whole = start.delayed_mpa(&end, &Kernel::new(&material, 2.0), p);
            let n = 20_000;
            let step = Kernel::new(&material, 2.0 / f64::from(n));
            let mut sum = 0.0;
            for k in 0..n {
                let u = (f64::from(k) + 0.5) / f64::from(n);
                let now = bump(8.0 * u, 10.0 + 6.0 * u).pressure_mpa(p);
                sum = step.after(sum, [now; 2]);
            }
            assert!((whole - sum).abs() < 2e-4 * start.peak_mpa, "{p:?}: {whole} {sum}");
        }
    }
}
