//! Where places lie on a sheet of which nobody knows how it was turned, mirrored and how large it was.

/// Turns that are tried first.
const STARTS: usize = 16;
/// Repetitions of the weighted fit.
const REPETITIONS: usize = 30;
/// Distances below, mm, weigh alike.
const NEAR_MM: f64 = 1.0;

/// A turn and a change of size, as a complex factor; the mirror comes first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Similarity {
    mirrored: bool,
    factor: [f64; 2],
}

fn times(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

impl Similarity {
    /// The one around the origin that brings places nearest to others: least sum of distances, by weighted squares (Weiszfeld 1937)
    /// from turns all around. None without a place off the origin.
    pub(super) fn between(pairs: &[([f64; 2], [f64; 2])]) -> Option<Self> {
        let (from, to) = (pairs.iter()).fold((0.0, 0.0), |(from, to), (f, t)| {
            (from + f[0].hypot(f[1]), to + t[0].hypot(t[1]))
        });
        let size = to / from;
        let starts = (0..2 * STARTS).map(|k| {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / STARTS as f64).sin_cos();
            Self {
                mirrored: k >= STARTS,
                factor: [size * cos, size * sin],
            }
        });
        let fitted = starts.map(|start| (0..REPETITIONS).fold(start, |s, _| s.better(pairs)));
        let sum = |s: &Self| -> f64 { pairs.iter().map(|(from, to)| s.off(*from, *to)).sum() };
        let finite = fitted.filter(|s| s.factor.iter().all(|v| v.is_finite()));
        finite.min_by(|a, b| sum(a).total_cmp(&sum(b)))
    }

    fn mirror(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [x, if self.mirrored { -y } else { y }]
    }

    fn better(self, pairs: &[([f64; 2], [f64; 2])]) -> Self {
        let (mut sum, mut whole) = ([0.0; 2], 0.0);
        for (from, to) in pairs {
            let weight = 1.0 / self.off(*from, *to).max(NEAR_MM);
            let [x, y] = self.mirror(*from);
            let product = times([x, -y], *to);
            (0..2).for_each(|k| sum[k] += weight * product[k]);
            whole += weight * (x * x + y * y);
        }
        Self {
            factor: sum.map(|v| v / whole),
            ..self
        }
    }

    /// Where a place comes to lie.
    pub(super) fn of(&self, place: [f64; 2]) -> [f64; 2] {
        times(self.factor, self.mirror(place))
    }

    /// By how much lengths grow.
    pub(super) fn size(&self) -> f64 {
        self.factor[0].hypot(self.factor[1])
    }

    fn off(&self, from: [f64; 2], to: [f64; 2]) -> f64 {
        let there = self.of(from);
        (there[0] - to[0]).hypot(there[1] - to[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_a_mirror_and_a_size_are_found_beside_places_that_are_far_off() {
        let planted = Similarity {
            mirrored: true,
            factor: [-0.4, 0.6],
        };
        let pairs: Vec<_> = (0..60)
            .map(|k| {
                let from = [f64::from(k * 37 % 83) - 41.0, f64::from(k * 53 % 79) - 39.0];
                let to = planted.of(from);
                (from, if k % 4 == 0 { [-to[0], to[1] + 20.0] } else { to })
            })
            .collect();
        let found = Similarity::between(&pairs).unwrap();
        assert!(found.off(pairs[1].0, pairs[1].1) < 1.0, "{found:?}");
        assert!((found.size() - planted.size()).abs() < 0.02, "{found:?}");
        assert!(Similarity::between(&[]).is_none());
    }
}
