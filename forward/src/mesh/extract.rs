//! From a triangulation to elements, mid-edge nodes and contacts.

use super::refine::Cdt;
use super::rim::Lines;
use super::{ContactEdge, LEAST_ANGLE_DEG, MOST_VERTICES, Mesh, MeshError, Order};
use crate::curve::{Point, cross, distance};
use crate::geometry::Geometry;
use spade::{AngleLimit, RefinementParameters, Triangulation};
use std::collections::HashMap;

/// Improves the angles, then lays out the mesh.
pub(super) fn extract(geometry: &Geometry, lines: &Lines, mut cdt: Cdt, order: Order) -> Result<Mesh, MeshError> {
    let refined = cdt.refine(
        RefinementParameters::<f64>::new()
            .keep_constraint_edges()
            .exclude_outer_faces(true)
            .with_max_additional_vertices(MOST_VERTICES)
            .with_angle_limit(AngleLimit::from_deg(25.0)),
    );
    let mut outside = vec![false; cdt.num_all_faces()];
    for face in &refined.excluded_faces {
        outside[face.index()] = true;
    }
    let mut nodes: Vec<Point> = cdt
        .vertices()
        .map(|v| {
            let p = v.position();
            [p.x, p.y]
        })
        .collect();
    let vertices = nodes.len();
    let triangles: Vec<[usize; 3]> = cdt
        .inner_faces()
        .filter(|f| !outside[f.fix().index()])
        .map(|f| f.vertices().map(|v| v.index()))
        .collect();

    let mut smallest = (180.0_f64, [0.0, 0.0]);
    for t in &triangles {
        let p = t.map(|v| nodes[v]);
        for k in 0..3 {
            let (a, b, c) = (p[k], p[(k + 1) % 3], p[(k + 2) % 3]);
            let dot = (b[0] - a[0]) * (c[0] - a[0]) + (b[1] - a[1]) * (c[1] - a[1]);
            let angle = libm::atan2(cross(a, b, c), dot).to_degrees();
            if angle < smallest.0 {
                smallest = (angle, a);
            }
        }
    }
    if smallest.0 < LEAST_ANGLE_DEG {
        return Err(MeshError::Flat {
            angle_deg: smallest.0,
            x_mm: smallest.1[0],
            y_mm: smallest.1[1],
        });
    }

    // Mid-edge nodes: on the curve where the edge is one of the rim's, half way elsewhere.
    let mut rim_middles: HashMap<[usize; 2], Point> = HashMap::new();
    for rim in lines.rims.iter().chain(&lines.circles) {
        let ring = &rim.curve;
        let n = rim.nodes.len();
        for k in 0..n {
            let ends = [rim.first + k, rim.first + (k + 1) % n];
            let (from, mut to) = (rim.nodes[k].s, rim.nodes[(k + 1) % n].s);
            if to <= from {
                to += ring.length();
            }
            let key = [ends[0].min(ends[1]), ends[0].max(ends[1])];
            rim_middles.insert(key, ring.point(0.5 * (from + to)));
        }
    }
    let mut middle_of: HashMap<[usize; 2], usize> = HashMap::new();
    let mut middles = Vec::new();
    let mut curved = vec![false; triangles.len()];
    if order == Order::Quadratic {
        for (element, t) in triangles.iter().enumerate() {
            let mut m = [0; 3];
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                let key = [a.min(b), a.max(b)];
                let half = [0.5 * (nodes[a][0] + nodes[b][0]), 0.5 * (nodes[a][1] + nodes[b][1])];
                let rim = rim_middles.get(&key);
                if rim.is_some_and(|p| distance(*p, half) > 1e-12 * distance(nodes[a], nodes[b])) {
                    curved[element] = true;
                }
                m[k] = *middle_of.entry(key).or_insert_with(|| {
                    nodes.push(rim.copied().unwrap_or(half));
                    nodes.len() - 1
                });
            }
            middles.push(m);
        }
    }

    let contacts = geometry
        .spans
        .iter()
        .map(|span| {
            let (rim, length) = (&lines.rims[span.ring], geometry.rings[span.ring].length());
            let n = rim.nodes.len();
            (0..n)
                .filter(|k| {
                    let offset = (rim.nodes[*k].s - span.start + 1e-9 * length).rem_euclid(length);
                    span.whole || offset < span.length - 1e-9 * length
                })
                .map(|k| {
                    let ends = [rim.first + k, rim.first + (k + 1) % n];
                    let key = [ends[0].min(ends[1]), ends[0].max(ends[1])];
                    ContactEdge {
                        ends,
                        middle: middle_of.get(&key).copied(),
                    }
                })
                .collect()
        })
        .collect();
    Ok(Mesh {
        order,
        nodes,
        vertices,
        triangles,
        middles,
        curved,
        contacts,
        smallest_angle_deg: smallest.0,
    })
}
