//! How long edges may be, from place to place.

use super::MeshSizes;
use super::circles::{CLEAR, followed};
use crate::curve::{Point, distance};
use crate::geometry::Geometry;

/// Longest edge along a curve, over its radius of curvature: a circle has 21 edges or more. Less costs nodes at every hole;
/// more bends the elements beside it too far.
pub(super) const TIGHT: f64 = 0.3;
/// Places on a rim where its radius of curvature is looked at. Fewer may miss a narrow bend; more cost little.
const TIGHT_POINTS: usize = 32;

/// Longest edge in a narrow gap between a circle and what is beside it, over the gap's width: two edges cross it. Less costs
/// nodes; more makes flat triangles.
const ACROSS_A_GAP: f64 = 0.5;

/// Where edges must be short: a point or a circle with the edge length there.
pub(super) struct SizeField<'a> {
    pub(super) sizes: &'a MeshSizes,
    points: Vec<(Point, f64)>,
}

impl SizeField<'_> {
    /// Longest edge at a point, mm.
    pub(super) fn at(&self, p: Point) -> f64 {
        let mut h = self.sizes.largest_mm;
        for (q, size) in &self.points {
            // Most points are too far away to matter: no root for those.
            let (x, y, reach) = (p[0] - q[0], p[1] - q[1], h - size);
            let (d2, g) = (x * x + y * y, self.sizes.growth);
            if g * g * d2 < reach * reach.abs() {
                h = size + g * d2.sqrt();
            }
        }
        for (centre, radius, size) in &self.sizes.circles {
            h = h.min(size + self.sizes.growth * (distance(p, *centre) - radius).abs());
        }
        h
    }
}

impl<'a> SizeField<'a> {
    /// Short at the electrodes' ends and at corners that point into the sheet.
    pub(super) fn new(geometry: &Geometry, sizes: &'a MeshSizes) -> Self {
        let mut points = Vec::new();
        for (k, ring) in geometry.rings.iter().enumerate() {
            let length = ring.length();
            let mut spans: Vec<_> = geometry.spans.iter().filter(|s| s.ring == k && !s.whole).collect();
            spans.sort_by(|a, b| a.start.total_cmp(&b.start));
            for (i, span) in spans.iter().enumerate() {
                let next = spans[(i + 1) % spans.len()];
                let previous = spans[(i + spans.len() - 1) % spans.len()];
                let gap = |from: f64, to: f64| {
                    let g = (to - from).rem_euclid(length);
                    if g > 0.0 { g } else { length }
                };
                let end = span.start + span.length;
                for (at, beside) in [
                    (end, gap(end, next.start)),
                    (span.start, gap(previous.start + previous.length, span.start)),
                ] {
                    let h = (sizes.electrode_fraction * span.length.min(beside))
                        .min(sizes.electrode_most_mm)
                        .min(sizes.largest_mm);
                    points.push((ring.point(at), h));
                }
            }
            // Around a narrow curve (a hole, an electrode inside) the field changes over the curve's own radius.
            for k in 0..TIGHT_POINTS {
                let at = length * k as f64 / TIGHT_POINTS as f64;
                let h = TIGHT * ring.radius_of_curvature(at);
                if h < sizes.largest_mm {
                    points.push((ring.point(at), h));
                }
            }
            // A corner that points into the sheet has a singular field, like an electrode's end; others only need care that
            // no side is longer than its surroundings allow. (Seen from the sheet a hole's corners are turned inside out.)
            for (s, interior) in ring.corners() {
                let seen = if k == 0 {
                    interior
                } else {
                    std::f64::consts::TAU - interior
                };
                if seen > std::f64::consts::PI * 1.05 {
                    points.push((ring.point(s), sizes.electrode_most_mm.min(sizes.largest_mm)));
                }
            }
        }
        for k in 0..sizes.circles.len() {
            if followed(geometry, &sizes.circles, k) {
                gaps(geometry, &sizes.circles, k, &mut points);
            }
        }
        Self { sizes, points }
    }
}

/// Short edges along a circle where a rim or another circle is nearer than its own edges are long.
fn gaps(geometry: &Geometry, circles: &[(Point, f64, f64)], k: usize, points: &mut Vec<(Point, f64)>) {
    let (centre, radius, edge) = circles[k];
    let towards = |p: Point| libm::atan2(p[1] - centre[1], p[0] - centre[0]);
    let on_circle = |angle: f64| {
        let (sin, cos) = libm::sincos(angle);
        [centre[0] + radius * cos, centre[1] + radius * sin]
    };
    let mut walk = |nearest: f64, gap: &dyn Fn(Point) -> f64| {
        for turn in [1.0, -1.0] {
            let mut along = 0.0;
            while along < std::f64::consts::PI {
                let p = on_circle(nearest + turn * along);
                let h = ACROSS_A_GAP * gap(p).max(CLEAR * radius);
                if h >= edge {
                    break;
                }
                points.push((p, h));
                along += h / radius;
            }
        }
    };
    for ring in &geometry.rings {
        let (s, _) = ring.nearest(centre);
        walk(towards(ring.point(s)), &|p| ring.nearest(p).1);
    }
    for (other, (c, r, _)) in circles.iter().enumerate() {
        if other != k {
            // The nearest point of a circle around this one is away from its centre.
            let turned = if *r > radius && distance(centre, *c) < *r {
                std::f64::consts::PI
            } else {
                0.0
            };
            walk(towards(*c) + turned, &|p| (distance(p, *c) - r).abs());
        }
    }
}
