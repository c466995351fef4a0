//! Triangle meshes of a sheet: graded towards the electrodes' edges, deterministic, quality-checked.

use crate::curve::{Curve, Point, cross, distance, inside_polygon};
use crate::geometry::Geometry;
use spade::{
    AngleLimit, ConstrainedDelaunayTriangulation, Point2, RefinementParameters, Triangulation,
    handles::FixedFaceHandle, handles::InnerTag,
};
use std::collections::{BinaryHeap, HashMap};
use thiserror::Error;

/// Degree of the elements' polynomials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Three nodes a triangle, straight edges.
    Linear,
    /// Six nodes a triangle; edges on a curved rim are curved too.
    Quadratic,
}

/// How fine a mesh is, in terms of lengths. The model chooses these from the accuracy wanted.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshSizes {
    /// Largest edge, mm.
    pub largest_mm: f64,
    /// Edge at an electrode's end, as a fraction of the electrode's width or of the gap beside it, whichever is less.
    pub electrode_fraction: f64,
    /// Edge at an electrode's end is at most this, mm, however wide the electrode.
    pub electrode_most_mm: f64,
    /// How much longer edges may be for every mm away from where they must be short.
    pub growth: f64,
    /// Circles (centre, radius, edge length along them, mm) to resolve, such as the rims of touches.
    pub circles: Vec<(Point, f64, f64)>,
}

/// Why no mesh could be made.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum MeshError {
    /// More nodes than an index or this machine's memory should have to hold.
    #[error(
        "the sheet would need about {nodes} mesh nodes on its rims, more than {most}; widen the narrowest electrode or gap, \
         or ask for less accuracy"
    )]
    TooFine {
        /// Nodes on the rims that the sizes ask for.
        nodes: usize,
        /// The limit.
        most: usize,
    },
    /// The triangulator refused the rim's points.
    #[error(
        "the rim could not be triangulated ({reason}); look for outlines or electrodes that nearly touch"
    )]
    Rim {
        /// What it said.
        reason: String,
    },
    /// A triangle too flat to compute with.
    #[error(
        "the smallest angle of the mesh is {angle_deg:.2} degrees at ({x_mm:.3}, {y_mm:.3}) mm; \
         look for a sharp corner or a narrow gap of the outline there"
    )]
    Flat {
        /// Smallest angle, degrees.
        angle_deg: f64,
        /// A vertex of the triangle.
        x_mm: f64,
        /// A vertex of the triangle.
        y_mm: f64,
    },
}

/// Most nodes on the rims.
const MOST_RIM_NODES: usize = 200_000;
/// Triangles flatter than this (degrees) are refused.
const LEAST_ANGLE_DEG: f64 = 1.0;

/// A stretch of an electrode's contact: two vertices and, for quadratic elements, the node between.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ContactEdge {
    /// The two ends.
    pub ends: [usize; 2],
    /// The node half way, on the curve.
    pub middle: Option<usize>,
}

/// A triangle mesh of a sheet, immutable.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Linear or quadratic.
    pub order: Order,
    /// Positions, mm: the vertices, then the mid-edge nodes.
    pub nodes: Vec<Point>,
    /// How many of the nodes are vertices.
    pub vertices: usize,
    /// Vertices of every triangle, counter-clockwise.
    pub triangles: Vec<[usize; 3]>,
    /// Mid-edge nodes of every triangle: on edges 0-1, 1-2, 2-0. Empty for linear elements.
    pub middles: Vec<[usize; 3]>,
    /// Whether an edge of the triangle is curved.
    pub curved: Vec<bool>,
    /// The contact of every electrode.
    pub contacts: Vec<Vec<ContactEdge>>,
    /// Smallest angle of any triangle, degrees.
    pub smallest_angle_deg: f64,
}

/// Where edges must be short: a point or a circle with the edge length there.
struct SizeField<'a> {
    sizes: &'a MeshSizes,
    points: Vec<(Point, f64)>,
}

impl SizeField<'_> {
    fn at(&self, p: Point) -> f64 {
        let mut h = self.sizes.largest_mm;
        for (q, size) in &self.points {
            h = h.min(size + self.sizes.growth * distance(p, *q));
        }
        for (centre, radius, size) in &self.sizes.circles {
            h = h.min(size + self.sizes.growth * (distance(p, *centre) - radius).abs());
        }
        h
    }
}

/// A node on a ring: its arc length there.
struct RimNode {
    s: f64,
    position: Point,
}

struct Rim {
    first: usize,
    nodes: Vec<RimNode>,
}

type Cdt = ConstrainedDelaunayTriangulation<Point2<f64>>;

impl Mesh {
    /// Makes the mesh of a checked sheet.
    ///
    /// # Errors
    /// [`MeshError`]: too fine for memory, or a rim that gives triangles too flat.
    pub fn new(geometry: &Geometry, sizes: &MeshSizes, order: Order) -> Result<Self, MeshError> {
        let field = size_field(geometry, sizes);
        let rims = rims(geometry, &field)?;
        let cdt = triangulate(&rims, &field)?;
        extract(geometry, &rims, cdt, order)
    }

    /// Nodes of a triangle: three vertices, then the mid-edge nodes of a quadratic element.
    pub fn element_nodes(&self, element: usize) -> impl Iterator<Item = usize> + '_ {
        let middles = self.middles.get(element).into_iter().flatten();
        self.triangles[element].iter().chain(middles).copied()
    }

    /// Corner positions of a triangle, mm.
    pub fn corners(&self, element: usize) -> [Point; 3] {
        self.triangles[element].map(|v| self.nodes[v])
    }
}

fn size_field<'a>(geometry: &Geometry, sizes: &'a MeshSizes) -> SizeField<'a> {
    let mut points = Vec::new();
    for (k, ring) in geometry.rings.iter().enumerate() {
        let length = ring.length();
        let mut spans: Vec<_> = geometry
            .spans
            .iter()
            .filter(|s| s.ring == k && !s.whole)
            .collect();
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
                (
                    span.start,
                    gap(previous.start + previous.length, span.start),
                ),
            ] {
                let h = (sizes.electrode_fraction * span.length.min(beside))
                    .min(sizes.electrode_most_mm)
                    .min(sizes.largest_mm);
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
    SizeField { sizes, points }
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
        let mut nodes = Vec::new();
        for (i, from) in fixed.iter().enumerate() {
            let to = fixed.get(i + 1).copied().unwrap_or(fixed[0] + length);
            for s in graded(ring, field, *from, to)? {
                nodes.push(RimNode {
                    s,
                    position: ring.point(s),
                });
            }
        }
        let count = nodes.len();
        rims.push(Rim { first, nodes });
        first += count;
        if first > MOST_RIM_NODES {
            return Err(MeshError::TooFine {
                nodes: first,
                most: MOST_RIM_NODES,
            });
        }
    }
    Ok(rims)
}

/// Arc lengths from `from` (included) to `to` (left out), as far apart as the size field says.
fn graded(ring: &Curve, field: &SizeField<'_>, from: f64, to: f64) -> Result<Vec<f64>, MeshError> {
    // The edge must also be short against the curve's own radius: chords then stay close to it.
    let size = |s: f64| {
        field
            .at(ring.point(s))
            .min(0.5 * ring.radius_of_curvature(s))
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

fn circumcircle(p: [Point; 3]) -> (Point, f64) {
    let [a, b, c] = p;
    let (bx, by) = (b[0] - a[0], b[1] - a[1]);
    let (cx, cy) = (c[0] - a[0], c[1] - a[1]);
    let d = 2.0 * (bx * cy - by * cx);
    let (b2, c2) = (bx * bx + by * by, cx * cx + cy * cy);
    let x = (cy * b2 - by * c2) / d;
    let y = (bx * c2 - cx * b2) / d;
    ([a[0] + x, a[1] + y], x.hypot(y))
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

/// Boundary segments in square buckets, so that "is this point on the sheet, and not too near its rim" is cheap.
struct Segments {
    polygons: Vec<Vec<Point>>,
    low: Point,
    bucket_mm: f64,
    columns: usize,
    rows: usize,
    buckets: Vec<Vec<(Point, Point)>>,
}

impl Segments {
    fn new(rims: &[Rim], bucket_mm: f64) -> Self {
        let polygons: Vec<Vec<Point>> = rims
            .iter()
            .map(|r| r.nodes.iter().map(|n| n.position).collect())
            .collect();
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for p in polygons.iter().flatten() {
            for k in 0..2 {
                low[k] = low[k].min(p[k]);
                high[k] = high[k].max(p[k]);
            }
        }
        // No more than a thousand buckets a side, however large the sheet.
        let bucket_mm = bucket_mm.max((high[0] - low[0]).max(high[1] - low[1]) / 1000.0);
        let columns = ((high[0] - low[0]) / bucket_mm) as usize + 1;
        let rows = ((high[1] - low[1]) / bucket_mm) as usize + 1;
        let mut this = Self {
            polygons,
            low,
            bucket_mm,
            columns,
            rows,
            buckets: vec![Vec::new(); columns * rows],
        };
        for polygon in this.polygons.clone() {
            for (k, a) in polygon.iter().enumerate() {
                let b = polygon[(k + 1) % polygon.len()];
                // The circle over the segment is what a new point must keep out of.
                let middle = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
                let r = 0.5 * distance(*a, b);
                let (c0, r0) = this.bucket([middle[0] - r, middle[1] - r]);
                let (c1, r1) = this.bucket([middle[0] + r, middle[1] + r]);
                for row in r0..=r1 {
                    for column in c0..=c1 {
                        this.buckets[row * this.columns + column].push((*a, b));
                    }
                }
            }
        }
        this
    }

    fn bucket(&self, p: Point) -> (usize, usize) {
        let cell = |x: f64, low: f64, n: usize| {
            (((x - low) / self.bucket_mm).max(0.0) as usize).min(n - 1)
        };
        (
            cell(p[0], self.low[0], self.columns),
            cell(p[1], self.low[1], self.rows),
        )
    }

    fn encroached(&self, p: Point) -> bool {
        let (column, row) = self.bucket(p);
        self.buckets[row * self.columns + column]
            .iter()
            .any(|(a, b)| (p[0] - a[0]) * (p[0] - b[0]) + (p[1] - a[1]) * (p[1] - b[1]) < 0.0)
    }

    fn on_sheet(&self, p: Point) -> bool {
        inside_polygon(&self.polygons[0], p)
            && !self.polygons[1..].iter().any(|q| inside_polygon(q, p))
    }
}

fn triangulate(rims: &[Rim], field: &SizeField<'_>) -> Result<Cdt, MeshError> {
    let refuse = |e: String| MeshError::Rim { reason: e };
    let mut vertices = Vec::new();
    let mut edges = Vec::new();
    for rim in rims {
        let n = rim.nodes.len();
        if n < 3 {
            return Err(refuse("a ring with fewer than three nodes".to_owned()));
        }
        for (k, node) in rim.nodes.iter().enumerate() {
            vertices.push(Point2::new(node.position[0], node.position[1]));
            edges.push([rim.first + k, rim.first + (k + 1) % n]);
        }
    }
    let count = vertices.len();
    let mut cdt = Cdt::bulk_load_cdt(vertices, edges).map_err(|e| refuse(e.to_string()))?;
    if cdt.num_vertices() != count {
        return Err(refuse("two rim nodes coincide".to_owned()));
    }
    let segments = Segments::new(rims, field.sizes.largest_mm);

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
    let most = 40 * count + 200_000;
    while let Some(next) = queue.pop() {
        if next.face.index() >= cdt.num_inner_faces() + 1
            || cdt.face(next.face).vertices().map(|v| v.index()) != next.corners
        {
            continue;
        }
        if segments.encroached(next.centre) || !segments.on_sheet(next.centre) {
            continue;
        }
        let hint = cdt.face(next.face).vertices()[0].fix();
        let point = Point2::new(next.centre[0], next.centre[1]);
        let inserted = cdt
            .insert_with_hint(point, hint)
            .map_err(|e| refuse(e.to_string()))?;
        let around: Vec<_> = cdt
            .vertex(inserted)
            .out_edges()
            .filter_map(|e| e.face().as_inner().map(|f| f.fix()))
            .collect();
        for face in around {
            queue.extend(candidate(&cdt, face));
        }
        if cdt.num_vertices() > most {
            return Err(MeshError::TooFine {
                nodes: cdt.num_vertices(),
                most,
            });
        }
    }
    Ok(cdt)
}

fn extract(
    geometry: &Geometry,
    rims: &[Rim],
    mut cdt: Cdt,
    order: Order,
) -> Result<Mesh, MeshError> {
    let refined = cdt.refine(
        RefinementParameters::<f64>::new()
            .keep_constraint_edges()
            .exclude_outer_faces(true)
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
            let angle = cross(a, b, c).atan2(dot).to_degrees();
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
    for (rim, ring) in rims.iter().zip(&geometry.rings) {
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
                let half = [
                    0.5 * (nodes[a][0] + nodes[b][0]),
                    0.5 * (nodes[a][1] + nodes[b][1]),
                ];
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
            let (rim, length) = (&rims[span.ring], geometry.rings[span.ring].length());
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Electrode, Outline, Place, Sheet};

    fn sizes() -> MeshSizes {
        MeshSizes {
            largest_mm: 10.0,
            electrode_fraction: 0.1,
            electrode_most_mm: 1.0,
            growth: 0.4,
            circles: Vec::new(),
        }
    }

    fn area(mesh: &Mesh) -> f64 {
        (0..mesh.triangles.len())
            .map(|e| {
                let [a, b, c] = mesh.corners(e);
                0.5 * cross(a, b, c)
            })
            .sum()
    }

    #[test]
    fn covers_the_sheet_once_and_keeps_its_angles() {
        let g = Geometry::new(&Sheet::paper()).unwrap();
        let mesh = Mesh::new(&g, &sizes(), Order::Quadratic).unwrap();
        let disc = std::f64::consts::PI * 97.5 * 97.5;
        assert!((area(&mesh) / disc - 1.0).abs() < 2e-3);
        assert!(
            mesh.smallest_angle_deg > 20.0,
            "{}",
            mesh.smallest_angle_deg
        );
        for contact in &mesh.contacts {
            let length: f64 = contact
                .iter()
                .map(|e| distance(mesh.nodes[e.ends[0]], mesh.nodes[e.ends[1]]))
                .sum();
            assert!((length - 10.0).abs() < 0.02, "{length}");
        }
    }

    #[test]
    fn holes_and_reentrant_corners() {
        let mut sheet = Sheet::paper();
        sheet.outline = Outline::Polygon {
            points_mm: vec![
                [0.0, 0.0],
                [200.0, 0.0],
                [200.0, 100.0],
                [100.0, 100.0],
                [100.0, 200.0],
                [0.0, 200.0],
            ],
        };
        sheet.holes = vec![Outline::Rectangle {
            width_mm: 20.0,
            height_mm: 10.0,
            centre_mm: [50.0, 50.0],
        }];
        // One electrode goes round the corner at arc length 300.
        sheet.electrodes = (0..8)
            .map(|k| Electrode {
                place: Place::Arc {
                    arc_mm: 2.0 + 100.0 * f64::from(k),
                    width_mm: 10.0,
                },
                contact_mm: 1.0,
            })
            .collect();
        let g = Geometry::new(&sheet).unwrap();
        let mesh = Mesh::new(&g, &sizes(), Order::Linear).unwrap();
        assert!(
            (area(&mesh) - (30_000.0 - 200.0)).abs() < 1e-6,
            "{}",
            area(&mesh)
        );
        assert!(
            mesh.smallest_angle_deg > 20.0,
            "{}",
            mesh.smallest_angle_deg
        );
    }

    #[test]
    fn the_same_sheet_gives_the_same_mesh() {
        let g = Geometry::new(&Sheet::paper()).unwrap();
        let a = Mesh::new(&g, &sizes(), Order::Quadratic).unwrap();
        let b = Mesh::new(&g, &sizes(), Order::Quadratic).unwrap();
        assert_eq!(a.nodes, b.nodes);
        assert_eq!(a.triangles, b.triangles);
    }
}
