//! How long edges may be, from place to place.

use super::MeshSizes;
use crate::curve::{Point, distance};
use crate::geometry::Geometry;

/// Edge along a narrow curve over its radius.
pub(super) const TIGHT: f64 = 0.3;
/// Places on a rim where its radius is looked at.
const TIGHT_POINTS: usize = 32;

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
        Self { sizes, points }
    }
}
