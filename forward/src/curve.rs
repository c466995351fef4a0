//! Closed curves by arc length: circles, polygons and smooth curves through points.

/// A point in the sheet's frame: x right, y up, mm.
pub type Point = [f64; 2];

pub(crate) fn distance(a: Point, b: Point) -> f64 {
    let (x, y) = (a[0] - b[0], a[1] - b[1]);
    (x * x + y * y).sqrt()
}

/// Twice the signed area of the triangle, mm²; positive when a, b, c turn left.
pub(crate) fn cross(a: Point, b: Point, c: Point) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[derive(Clone, Debug)]
enum Piece {
    Line(Point, Point),
    Arc {
        centre: Point,
        radius: f64,
    },
    /// A cubic with its arc lengths at equal steps of the parameter.
    Cubic {
        control: [Point; 4],
        lengths: Vec<f64>,
    },
}

/// Steps of the arc-length table of a cubic piece.
const CUBIC_STEPS: usize = 64;

fn cubic_at(p: &[Point; 4], t: f64) -> Point {
    let s = 1.0 - t;
    let w = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
    let sum = |k: usize| (0..4).map(|i| w[i] * p[i][k]).sum();
    [sum(0), sum(1)]
}

fn cubic_speed(p: &[Point; 4], t: f64) -> f64 {
    let s = 1.0 - t;
    let w = [3.0 * s * s, 6.0 * s * t, 3.0 * t * t];
    let sum = |k: usize| (0..3).map(|i| w[i] * (p[i + 1][k] - p[i][k])).sum::<f64>();
    libm::hypot(sum(0), sum(1))
}

/// Arc length between two nearby parameters, by two-point Gauss quadrature.
fn gauss_length(p: &[Point; 4], from: f64, to: f64) -> f64 {
    let middle = 0.5 * (from + to);
    let offset = (to - from) / (2.0 * 3.0_f64.sqrt());
    0.5 * (to - from) * (cubic_speed(p, middle - offset) + cubic_speed(p, middle + offset))
}

impl Piece {
    fn cubic(control: [Point; 4]) -> Self {
        let step = 1.0 / CUBIC_STEPS as f64;
        let mut lengths = vec![0.0];
        let mut total = 0.0;
        for k in 0..CUBIC_STEPS {
            total += gauss_length(&control, k as f64 * step, (k + 1) as f64 * step);
            lengths.push(total);
        }
        Self::Cubic { control, lengths }
    }

    fn length(&self) -> f64 {
        match self {
            Self::Line(a, b) => distance(*a, *b),
            Self::Arc { radius, .. } => std::f64::consts::TAU * radius,
            Self::Cubic { lengths, .. } => lengths[CUBIC_STEPS],
        }
    }

    fn point(&self, s: f64) -> Point {
        match self {
            Self::Line(a, b) => {
                let t = s / distance(*a, *b);
                [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
            }
            Self::Arc { centre, radius } => {
                let angle = s / radius;
                [
                    centre[0] + radius * libm::cos(angle),
                    centre[1] + radius * libm::sin(angle),
                ]
            }
            Self::Cubic { control, lengths } => {
                let k = lengths.partition_point(|l| *l <= s).clamp(1, CUBIC_STEPS);
                let span = lengths[k] - lengths[k - 1];
                let fraction = if span > 0.0 { (s - lengths[k - 1]) / span } else { 0.0 };
                let from = (k - 1) as f64 / CUBIC_STEPS as f64;
                let mut t = from + fraction / CUBIC_STEPS as f64;
                // Two Newton steps on the arc length, from an already good guess.
                for _ in 0..2 {
                    let speed = cubic_speed(control, t);
                    if speed > 0.0 {
                        t += (s - lengths[k - 1] - gauss_length(control, from, t)) / speed;
                    }
                }
                cubic_at(control, t.clamp(0.0, 1.0))
            }
        }
    }

    /// Points along the piece, its end left out, fine enough that the polyline follows the curve.
    fn flatten(&self) -> Vec<Point> {
        match self {
            Self::Line(a, _) => vec![*a],
            Self::Arc { .. } => (0..256).map(|k| self.point(self.length() * k as f64 / 256.0)).collect(),
            Self::Cubic { control, .. } => (0..32).map(|k| cubic_at(control, k as f64 / 32.0)).collect(),
        }
    }
}

/// A closed curve, counter-clockwise, by arc length from its first point.
#[derive(Clone, Debug)]
pub struct Curve {
    pieces: Vec<Piece>,
    /// Arc length at the start of every piece, and the whole length.
    starts: Vec<f64>,
    /// Interior angle at the start of every piece where the curve has a corner there, radian.
    corners: Vec<Option<f64>>,
    polyline: Vec<Point>,
    piece_of_segment: Vec<usize>,
}

impl Curve {
    fn from_pieces(pieces: Vec<Piece>, corners: Vec<Option<f64>>) -> Self {
        let mut starts = vec![0.0];
        let mut polyline = Vec::new();
        let mut piece_of_segment = Vec::new();
        for (k, piece) in pieces.iter().enumerate() {
            starts.push(starts[k] + piece.length());
            let points = piece.flatten();
            piece_of_segment.extend(std::iter::repeat_n(k, points.len()));
            polyline.extend(points);
        }
        Self {
            pieces,
            starts,
            corners,
            polyline,
            piece_of_segment,
        }
    }

    /// A circle; arc length runs from the point at angle 0.
    pub(crate) fn circle(centre: Point, radius: f64) -> Self {
        Self::from_pieces(vec![Piece::Arc { centre, radius }], vec![None])
    }

    /// A polygon; turned counter-clockwise if it is given clockwise (the first vertex stays first).
    pub(crate) fn polygon(vertices: &[Point]) -> Self {
        let v = counter_clockwise(vertices);
        let n = v.len();
        let pieces = (0..n).map(|k| Piece::Line(v[k], v[(k + 1) % n])).collect();
        let corners = (0..n)
            .map(|k| {
                let (before, here, after) = (v[(k + n - 1) % n], v[k], v[(k + 1) % n]);
                let along = (here[0] - before[0]) * (after[0] - here[0]) + (here[1] - before[1]) * (after[1] - here[1]);
                let turn = libm::atan2(cross(before, here, after), along);
                Some(std::f64::consts::PI - turn)
            })
            .collect();
        Self::from_pieces(pieces, corners)
    }

    /// A smooth closed curve through the points (Catmull-Rom with tangents by chord length, so it does not overshoot
    /// where the points are uneven).
    pub(crate) fn smooth(points: &[Point]) -> Self {
        let p = counter_clockwise(points);
        let n = p.len();
        let tangent = |k: usize| {
            let (a, b, c) = (p[(k + n - 1) % n], p[k], p[(k + 1) % n]);
            let (d0, d1) = (distance(a, b), distance(b, c));
            // Derivative by chord length of the parabola through the three points.
            let slope = |i: usize| ((b[i] - a[i]) / d0 * d1 + (c[i] - b[i]) / d1 * d0) / (d0 + d1);
            [slope(0), slope(1)]
        };
        let pieces = (0..n)
            .map(|k| {
                let (a, b) = (p[k], p[(k + 1) % n]);
                let d = distance(a, b) / 3.0;
                let (ta, tb) = (tangent(k), tangent((k + 1) % n));
                Piece::cubic([
                    a,
                    [a[0] + d * ta[0], a[1] + d * ta[1]],
                    [b[0] - d * tb[0], b[1] - d * tb[1]],
                    b,
                ])
            })
            .collect();
        Self::from_pieces(pieces, vec![None; n])
    }

    /// Length all the way round, mm.
    pub fn length(&self) -> f64 {
        self.starts[self.pieces.len()]
    }

    /// The point at an arc length (mm, taken modulo the length).
    pub fn point(&self, s: f64) -> Point {
        let s = s.rem_euclid(self.length());
        let k = (self.starts.partition_point(|start| *start <= s) - 1).min(self.pieces.len() - 1);
        self.pieces[k].point(s - self.starts[k])
    }

    /// Arc length of every corner with its interior angle, radian.
    pub fn corners(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.corners
            .iter()
            .zip(&self.starts)
            .filter_map(|(angle, s)| angle.map(|a| (*s, a)))
    }

    /// Radius of curvature near an arc length, mm; infinite on a straight piece.
    pub(crate) fn radius_of_curvature(&self, s: f64) -> f64 {
        let s = s.rem_euclid(self.length());
        let k = (self.starts.partition_point(|start| *start <= s) - 1).min(self.pieces.len() - 1);
        match &self.pieces[k] {
            Piece::Line(..) => f64::INFINITY,
            Piece::Arc { radius, .. } => *radius,
            Piece::Cubic { .. } => {
                let d = self.pieces[k].length() / CUBIC_STEPS as f64;
                let (a, b, c) = (self.point(s - d), self.point(s), self.point(s + d));
                let area2 = cross(a, b, c).abs();
                distance(a, b) * distance(b, c) * distance(a, c) / (2.0 * area2).max(f64::MIN_POSITIVE)
            }
        }
    }

    /// A polyline that follows the curve: exact for polygons, to 1e-4 of the radius for circles.
    pub fn polyline(&self) -> &[Point] {
        &self.polyline
    }

    /// Which piece (polygon side, stretch between two points) a polyline segment belongs to.
    pub(crate) fn piece_of_segment(&self, segment: usize) -> usize {
        self.piece_of_segment[segment]
    }

    /// The nearest point of the curve: its arc length and its distance, mm.
    pub fn nearest(&self, p: Point) -> (f64, f64) {
        let n = self.polyline.len();
        let mut best = (0.0, f64::INFINITY);
        let mut s = 0.0;
        for k in 0..n {
            let (a, b) = (self.polyline[k], self.polyline[(k + 1) % n]);
            let chord = distance(a, b);
            let t = if chord > 0.0 {
                (((p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1])) / (chord * chord)).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let foot = [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
            if distance(p, foot) < best.1 {
                best = (s + t * chord, distance(p, foot));
            }
            s += chord;
        }
        // The polyline is a little shorter than the curve; then refine on the curve itself.
        let mut at = best.0 * self.length() / s;
        let mut step = 2.0 * self.length() / n as f64;
        let mut here = distance(p, self.point(at));
        while step > 1e-12 * self.length() {
            let (left, right) = (distance(p, self.point(at - step)), distance(p, self.point(at + step)));
            if left < here {
                (at, here) = (at - step, left);
            } else if right < here {
                (at, here) = (at + step, right);
            } else {
                step *= 0.5;
            }
        }
        (at.rem_euclid(self.length()), here)
    }

    /// Whether the point is inside the curve (by the polyline).
    pub fn contains(&self, p: Point) -> bool {
        contains(&self.polyline, p)
    }

    /// Area enclosed, mm², by the polyline.
    pub fn area(&self) -> f64 {
        0.5 * signed_area2(&self.polyline)
    }
}

/// Whether the point lies inside the polygon, by the even-odd rule. The last vertex joins the first; the sense of turn does
/// not matter. A point on a side may count as either; fewer than three vertices contain nothing.
pub fn contains(polygon: &[Point], p: Point) -> bool {
    let n = polygon.len();
    let sides = (0..n).map(|k| (polygon[k], polygon[(k + 1) % n]));
    crossings(sides, p) % 2 == 1
}

/// How many of the segments the ray from the point to the right crosses.
pub(crate) fn crossings(segments: impl Iterator<Item = (Point, Point)>, p: Point) -> usize {
    segments
        .filter(|(a, b)| (a[1] > p[1]) != (b[1] > p[1]) && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
        .count()
}

fn signed_area2(points: &[Point]) -> f64 {
    let n = points.len();
    (0..n)
        .map(|k| {
            let (a, b) = (points[k], points[(k + 1) % n]);
            a[0] * b[1] - a[1] * b[0]
        })
        .sum()
}

/// The same closed sequence turned counter-clockwise, its first point kept.
fn counter_clockwise(points: &[Point]) -> Vec<Point> {
    let mut v = points.to_vec();
    if signed_area2(&v) < 0.0 {
        v.reverse();
        v.rotate_right(1);
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    #[test]
    fn circle_by_arc_length() {
        let c = Curve::circle([1.0, 2.0], 10.0);
        assert!((c.length() - TAU * 10.0).abs() < 1e-12);
        let p = c.point(10.0 * FRAC_PI_2);
        assert!(distance(p, [1.0, 12.0]) < 1e-12);
        let (s, d) = c.nearest([1.0 - 12.0, 2.0]);
        assert!((s - 10.0 * PI).abs() < 1e-6 && (d - 2.0).abs() < 1e-9);
    }

    #[test]
    fn a_clockwise_polygon_is_turned_and_keeps_its_first_vertex() {
        let c = Curve::polygon(&[[0.0, 0.0], [0.0, 1.0], [2.0, 1.0], [2.0, 0.0]]);
        assert!((c.area() - 2.0).abs() < 1e-12);
        assert!(distance(c.point(0.0), [0.0, 0.0]) < 1e-12);
        assert!(distance(c.point(1.0), [1.0, 0.0]) < 1e-12);
        assert!(c.corners().all(|(_, a)| (a - FRAC_PI_2).abs() < 1e-12));
    }

    #[test]
    fn a_smooth_curve_through_points_of_a_circle_is_nearly_that_circle() {
        let points: Vec<Point> = (0..24)
            .map(|k| {
                let a = TAU * f64::from(k) / 24.0;
                [50.0 * a.cos(), 50.0 * a.sin()]
            })
            .collect();
        let c = Curve::smooth(&points);
        assert!((c.length() / (TAU * 50.0) - 1.0).abs() < 1e-4);
        for k in 0..200 {
            let p = c.point(c.length() * f64::from(k) / 200.0);
            assert!((p[0].hypot(p[1]) - 50.0).abs() < 0.02);
        }
        assert!((c.radius_of_curvature(17.0) - 50.0).abs() < 3.0);
    }

    #[test]
    fn points_at_even_arc_lengths_are_evenly_spaced() {
        let c = Curve::smooth(&[[0.0, 0.0], [60.0, 5.0], [70.0, 40.0], [10.0, 30.0]]);
        let n = 4000;
        let step = c.length() / f64::from(n);
        for k in 0..n {
            let d = distance(c.point(step * f64::from(k)), c.point(step * f64::from(k + 1)));
            assert!((d / step - 1.0).abs() < 1e-2, "{k}: {}", d / step);
        }
    }
}
