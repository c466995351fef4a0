//! Triangle meshes of a sheet: graded towards the electrodes' edges, deterministic, quality-checked.

mod circles;
mod extract;
mod refine;
mod rim;
mod segments;
mod size;

pub(crate) use circles::followed;

use crate::curve::Point;
use crate::geometry::Geometry;
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
    /// Circles (centre, radius, edge length along them, mm) to resolve, such as the rims of touches. Where a circle keeps
    /// clear of rims and of other circles its points become vertices, and the edges between them follow it.
    pub circles: Vec<(Point, f64, f64)>,
}

/// Why no mesh could be made.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum MeshError {
    /// More nodes than an index or this machine's memory should have to hold.
    #[error(
        "the sheet would need {nodes} mesh nodes or more, and {most} are the most; make it less long for its width, widen the \
         narrowest electrode, gap or bend, or ask for less accuracy"
    )]
    TooFine {
        /// Nodes that the sizes ask for, as far as they were counted.
        nodes: usize,
        /// The limit.
        most: usize,
    },
    /// The triangulator refused the rim's points.
    #[error("the rim could not be triangulated ({reason}); look for outlines or electrodes that nearly touch")]
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

/// Most nodes on the rims: 256 electrodes at an error of 2e-4 have 8,448. The limit names the mistake before time runs out.
const MOST_RIM_NODES: usize = 20_000;
/// Most vertices: 256 electrodes at an error of 2e-4 have 47,808. With 180,000 a sheet took 1.07 GB.
const MOST_VERTICES: usize = 80_000;
/// Smallest angle of a triangle, degrees; a flatter one is refused. Sharp corners of an outline cause them. Less lets flat
/// elements spoil the voltages; more refuses outlines that could be computed.
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

impl Mesh {
    /// Makes the mesh of a checked sheet.
    ///
    /// # Errors
    /// [`MeshError`]: too fine for memory, or a rim that gives triangles too flat.
    pub fn new(geometry: &Geometry, sizes: &MeshSizes, order: Order) -> Result<Self, MeshError> {
        let field = size::SizeField::new(geometry, sizes);
        let lines = rim::lines(geometry, &field)?;
        let cdt = refine::triangulate(&lines, &field)?;
        extract::extract(geometry, &lines, cdt, order)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curve::{cross, distance};
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
        assert!(mesh.smallest_angle_deg > 20.0, "{}", mesh.smallest_angle_deg);
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
        assert!((area(&mesh) - (30_000.0 - 200.0)).abs() < 1e-6, "{}", area(&mesh));
        assert!(mesh.smallest_angle_deg > 20.0, "{}", mesh.smallest_angle_deg);
    }

    #[test]
    fn the_same_sheet_gives_the_same_mesh() {
        let g = Geometry::new(&Sheet::paper()).unwrap();
        let a = Mesh::new(&g, &sizes(), Order::Quadratic).unwrap();
        let b = Mesh::new(&g, &sizes(), Order::Quadratic).unwrap();
        assert_eq!(a.nodes, b.nodes);
        assert_eq!(a.triangles, b.triangles);
    }

    /// A sheet whose mesh would need what no memory has is refused as soon as that shows.
    #[test]
    fn sheets_too_long_or_too_fine_are_refused() {
        let strip = |width_mm, height_mm, electrode_mm| {
            let mut sheet = Sheet::disc(100.0, 8, electrode_mm, 1.0, 1000.0);
            sheet.outline = Outline::Rectangle {
                width_mm,
                height_mm,
                centre_mm: [0.0, 0.0],
            };
            let sizes = crate::Model::sizes(&sheet, &crate::ModelOptions::default()).unwrap();
            Mesh::new(&Geometry::new(&sheet).unwrap(), &sizes, Order::Quadratic)
        };
        assert!(strip(200.0, 4000.0, 10.0).is_ok());
        for (width, height, electrode) in [(200.0, 6e5, 10.0), (200.0, 4e4, 10.0)] {
            let error = strip(width, height, electrode).unwrap_err();
            assert!(matches!(error, MeshError::TooFine { .. }), "{error}");
        }
    }
}
