//! Delaunay refinement by size.

use super::rim::Lines;
use super::segments::Segments;
use super::size::SizeField;
use super::{MOST_VERTICES, MeshError};
use crate::curve::Point;
use spade::handles::{FixedFaceHandle, InnerTag};
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};
use std::collections::BinaryHeap;

pub(super) type Cdt = ConstrainedDelaunayTriangulation<Point2<f64>>;

fn circumcircle(p: [Point; 3]) -> (Point, f64) {
    let [a, b, c] = p;
    let (bx, by) = (b[0] - a[0], b[1] - a[1]);
    let (cx, cy) = (c[0] - a[0], c[1] - a[1]);
    let d = 2.0 * (bx * cy - by * cx);
    let (b2, c2) = (bx * bx + by * by, cx * cx + cy * cy);
    let x = (cy * b2 - by * c2) / d;
    let y = (bx * c2 - cx * b2) / d;
    ([a[0] + x, a[1] + y], libm::hypot(x, y))
}

/// A triangle waiting to be split, by how much too large it is. The corners tell whether it is still there.
#[derive(PartialEq)]
struct Candidate {
    excess: f64,
    face: FixedFaceHandle<InnerTag>,
    corners: [usize; 3],
    centre: Point,
}

impl Eq for Candidate {}
impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.excess
            .total_cmp(&other.excess)
            .then_with(|| other.corners.cmp(&self.corners))
    }
}

/// A triangulation of the hull of the rims, its triangles on the sheet no larger than the size field says.
pub(super) fn triangulate(lines: &Lines, field: &SizeField<'_>) -> Result<Cdt, MeshError> {
    let refuse = |e: String| MeshError::Rim { reason: e };
    let mut vertices = Vec::new();
    let mut edges = Vec::new();
    for rim in &lines.rims {
        let n = rim.nodes.len();
        if n < 3 {
            return Err(refuse("a ring with fewer than three nodes".to_owned()));
        }
        for (k, node) in rim.nodes.iter().enumerate() {
            vertices.push(Point2::new(node.position[0], node.position[1]));
            edges.push([rim.first + k, rim.first + (k + 1) % n]);
        }
    }
    // The circles come without constraints: nothing is put between their vertices, so their edges are Delaunay anyway.
    for node in lines.circles.iter().flat_map(|c| &c.nodes) {
        vertices.push(Point2::new(node.position[0], node.position[1]));
    }
    let count = vertices.len();
    let mut crossed = None;
    let mut cdt = Cdt::try_bulk_load_cdt(vertices, edges, |edge| crossed = crossed.or(Some(edge)))
        .map_err(|e| refuse(e.to_string()))?;
    if let Some(edge) = crossed {
        return Err(refuse(format!(
            "the edge from node {} to {} crosses another",
            edge[0], edge[1]
        )));
    }
    if cdt.num_vertices() != count {
        return Err(refuse("two rim nodes coincide".to_owned()));
    }
    let segments = Segments::new(lines, field.sizes.largest_mm);

    // Delaunay refinement by size: split the triangle that is most too large at its circumcentre.
    let mut queue = BinaryHeap::new();
    let candidate = |cdt: &Cdt, face: FixedFaceHandle<InnerTag>| -> Option<Candidate> {
        let handles = cdt.face(face).vertices();
        let corners = handles.map(|v| v.index());
        let p = handles.map(|v| {
            let q = v.position();
            [q.x, q.y]
        });
        let (centre, radius) = circumcircle(p);
        if !radius.is_finite() {
            return None;
        }
        // An equilateral triangle of edge h has a circumradius of h / sqrt 3.
        let excess = radius * 3.0_f64.sqrt() / field.at(centre);
        (excess > 1.15).then_some(Candidate {
            excess,
            face,
            corners,
            centre,
        })
    };
    let faces: Vec<_> = cdt.inner_faces().map(|f| f.fix()).collect();
    for face in faces {
        queue.extend(candidate(&cdt, face));
    }
    while let Some(next) = queue.pop() {
        if next.face.index() > cdt.num_inner_faces()
            || cdt.face(next.face).vertices().map(|v| v.index()) != next.corners
        {
            continue;
        }
        if segments.encroached(next.centre) || !segments.on_sheet(next.centre) {
            continue;
        }
        let hint = cdt.face(next.face).vertices()[0].fix();
        let point = Point2::new(next.centre[0], next.centre[1]);
        let inserted = cdt.insert_with_hint(point, hint).map_err(|e| refuse(e.to_string()))?;
        let around: Vec<_> = cdt
            .vertex(inserted)
            .out_edges()
            .filter_map(|e| e.face().as_inner().map(|f| f.fix()))
            .collect();
        for face in around {
            queue.extend(candidate(&cdt, face));
        }
        if cdt.num_vertices() > MOST_VERTICES {
            return Err(MeshError::TooFine {
                nodes: cdt.num_vertices(),
                most: MOST_VERTICES,
            });
        }
    }
    Ok(cdt)
}
