//! Nodes along the rims, and along the circles that the mesh follows.

use super::circles::followed;
use super::size::{SizeField, TIGHT};
use super::{MOST_RIM_NODES, MeshError};
use crate::curve::{Curve, Point};
use crate::geometry::Geometry;

/// A node on a ring: its arc length there.
pub(super) struct RimNode {
    pub(super) s: f64,
    pub(super) position: Point,
}

/// The nodes of a closed curve; the first has the index `first`.
pub(super) struct Rim {
    pub(super) first: usize,
    pub(super) nodes: Vec<RimNode>,
    pub(super) curve: Curve,
}

/// What the mesh follows.
pub(super) struct Lines {
    /// The sheet's rims, in the order of the geometry's rings.
    pub(super) rims: Vec<Rim>,
    /// Circles inside the sheet.
    pub(super) circles: Vec<Rim>,
}

/// Nodes along the rims and circles, spaced by the size field.
pub(super) fn lines(geometry: &Geometry, field: &SizeField<'_>) -> Result<Lines, MeshError> {
    let rims = rims(geometry, field)?;
    let mut first = rims.last().map_or(0, |r| r.first + r.nodes.len());
    let mut circles = Vec::new();
    let all = &field.sizes.circles;
    for (k, circle) in all.iter().enumerate() {
        if !followed(geometry, all, k) {
            continue;
        }
        let curve = Curve::circle(circle.0, circle.1);
        let nodes: Vec<RimNode> = graded(&curve, field, 0.0, curve.length())?
            .into_iter()
            .map(|s| RimNode {
                s,
                position: curve.point(s),
            })
            .collect();
        let count = nodes.len();
        circles.push(Rim { first, nodes, curve });
        first += count;
        few_enough(first)?;
    }
    Ok(Lines { rims, circles })
}

fn few_enough(nodes: usize) -> Result<(), MeshError> {
    if nodes > MOST_RIM_NODES {
        return Err(MeshError::TooFine {
            nodes,
            most: MOST_RIM_NODES,
        });
    }
    Ok(())
}

/// Nodes along every ring, spaced by the size field; electrode ends and corners are always nodes.
fn rims(geometry: &Geometry, field: &SizeField<'_>) -> Result<Vec<Rim>, MeshError> {
    let mut first = 0;
    let mut rims = Vec::new();
    for (k, ring) in geometry.rings.iter().enumerate() {
        let length = ring.length();
        let mut fixed: Vec<f64> = ring.corners().map(|(s, _)| s).collect();
        for span in geometry.spans.iter().filter(|s| s.ring == k && !s.whole) {
            fixed.push(span.start);
            fixed.push((span.start + span.length).rem_euclid(length));
        }
        if fixed.is_empty() {
            fixed.push(0.0);
        }
        fixed.sort_by(f64::total_cmp);
        fixed.dedup_by(|a, b| (*a - *b).abs() < 1e-9 * length);
        // The end of the ring is its beginning.
        while fixed.len() > 1 && fixed[fixed.len() - 1] - fixed[0] > (1.0 - 1e-9) * length {
            fixed.pop();
        }
        let mut nodes = Vec::new();
        for (i, from) in fixed.iter().enumerate() {
            let to = fixed.get(i + 1).copied().unwrap_or(fixed[0] + length);
            for s in graded(ring, field, *from, to)? {
                nodes.push(RimNode {
                    s,
                    position: ring.point(s),
                });
            }
            few_enough(first + nodes.len())?;
        }
        let count = nodes.len();
        rims.push(Rim {
            first,
            nodes,
            curve: ring.clone(),
        });
        first += count;
    }
    Ok(rims)
}

/// Arc lengths from `from` (included) to `to` (left out), as far apart as the size field says.
fn graded(ring: &Curve, field: &SizeField<'_>, from: f64, to: f64) -> Result<Vec<f64>, MeshError> {
    // The edge must also be short against the curve's own radius: chords then stay close to it.
    let size = |s: f64| {
        field
            .at(ring.point(s))
            .min(TIGHT * ring.radius_of_curvature(s))
            .max(1e-9 * ring.length())
    };
    let mut table = vec![(from, 0.0)];
    let (mut s, mut count) = (from, 0.0);
    while s < to {
        let step = (0.25 * size(s)).min(to - s);
        count += step / size(s + 0.5 * step);
        s += step;
        if to - s < 1e-12 * ring.length() {
            s = to;
        }
        table.push((s, count));
        if table.len() > 8 * MOST_RIM_NODES {
            return Err(MeshError::TooFine {
                nodes: table.len() / 4,
                most: MOST_RIM_NODES,
            });
        }
    }
    let intervals = count.ceil().max(1.0);
    let mut out = Vec::with_capacity(intervals as usize);
    let mut k = 1;
    for i in 0..intervals as usize {
        let target = count * i as f64 / intervals;
        while k + 1 < table.len() && table[k].1 < target {
            k += 1;
        }
        let ((s0, n0), (s1, n1)) = (table[k - 1], table[k]);
        out.push(s0 + (s1 - s0) * ((target - n0) / (n1 - n0)).clamp(0.0, 1.0));
    }
    Ok(out)
}
