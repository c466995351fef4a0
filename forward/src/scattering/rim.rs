//! Line sources outside the rims, and their strengths.
//!
//! Inside the sheet a field is `sum over the sources of w_k log |x - s_k|`, which is harmonic. The boundary conditions are those of
//! the complete electrode model: no current through the rim, and `(U_l - u) / z_l` under contact l, whose potential `U_l` lets its
//! current be what is given. They are satisfied as elements satisfy them, in the weak sense; with harmonic functions only integrals
//! along the rims are left:
//!
//! `A_km = rim integral of phi_m dphi_k/dn + sum over l of 1/z_l integral over l of (phi_k - mean phi_k) (phi_m - mean phi_m)`
//!
//! A source inside the sheet has for its right side its own field, turned. As a function of its place that is harmonic, too: a matrix
//! tells it from the sources' fields at the place. The matrix is found from places along a curve inside the rims, and holds
//! everywhere within. What an electrode's current makes is taken from the elements: their potentials near that curve. At the edges of
//! electrodes they are more exact than line sources can be.

use crate::field::DiscTouch;
use crate::geometry::{Geometry, Span};
use crate::scattering::{ORDERS, complex, powers, row};
use crate::solver::Solver;
use nalgebra::{Complex, DMatrix, SymmetricEigen};

/// Line sources along all rims together, where their lengths leave it open. 64 are too few for discs near the rim, 192 are as exact.
const SOURCES: f64 = 96.0;
/// Least along a hole, or round an electrode inside.
const LEAST_SOURCES: f64 = 8.0;
/// Distance of the sources from the rim, in distances from each other. From 1.5 to 3 the results are alike; less makes the field
/// uneven, more the matrix worse conditioned.
const OFFSET: f64 = 2.0;
/// Points of quadrature between two sources, and at least on a contact.
const POINTS: f64 = 12.0;
/// Places inside for every source, from which the image's matrix is found.
const PLACES: usize = 3;
/// Strengths that change the field at the rim by less than this part are rounding.
const LEAST_EIGENVALUE: f64 = 1e-12;
/// Steps for each row after which eigenvectors are given up. Two or three are usual.
const MOST_STEPS: usize = 100;
/// Nodes of the mesh that the potentials of electrodes are taken from: so far from the rims, in distances between sources.
const BAND: [f64; 2] = [1.0, 2.0];

/// The line sources of a sheet.
#[derive(Clone, Debug)]
pub(super) struct Rims {
    sources: Vec<Complex<f64>>,
    image: DMatrix<f64>,
    drives: DMatrix<f64>,
}

/// A point of quadrature on a rim.
struct Point {
    at: Complex<f64>,
    /// Outward, one long.
    normal: Complex<f64>,
    length: f64,
    contact: Option<usize>,
}

impl Point {
    /// Field of a line source, and its slope along the normal.
    fn field(&self, source: Complex<f64>) -> [f64; 2] {
        let from = self.at - source;
        [from.norm().ln(), (self.normal * from.conj()).re / from.norm_sqr()]
    }
}

impl Rims {
    /// Places the sources, and finds their strengths.
    pub(super) fn new(solver: &Solver) -> Option<Self> {
        let sheet = solver.model().sheet();
        let contacts_mm: Vec<f64> = sheet.electrodes.iter().map(|e| e.contact_mm).collect();
        let Layout {
            sources,
            points,
            places,
        } = Layout::new(solver.model().geometry())?;
        let [values, mut slopes] = fields(&points, &sources);
        let shunts = shunts(&points, &values, &contacts_mm);
        for (q, point) in points.iter().enumerate() {
            slopes.row_mut(q).scale_mut(point.length);
        }
        let a = values.tr_mul(&slopes) + values.tr_mul(&shunts);
        // Places are sources, each with its opposite at the first of them: no current is left over. The form is symmetric.
        let [mut of_places, mut slopes_of] = fields(&points, &places).map(less_first);
        for (q, point) in points.iter().enumerate() {
            slopes_of.row_mut(q).scale_mut(point.length);
        }
        let right = -(values.tr_mul(&slopes_of) + shunts.tr_mul(&of_places));
        let strengths = solved(0.5 * (&a + a.transpose()), &right)?;
        of_places = less_first(DMatrix::from_fn(sources.len(), places.len(), |k, j| {
            (places[j] - sources[k]).norm().ln()
        }));
        let image = solved(
            &of_places * of_places.transpose(),
            &(&of_places * strengths.transpose()),
        )?
        .transpose();
        let drives = drives(solver, &sources)?;
        let finite = image.iter().chain(&drives).all(|v| v.is_finite());
        finite.then_some(Self { sources, image, drives })
    }

    /// Strengths of the sources (rows) by which the image of a source inside the sheet is that of what the sources (columns) give
    /// where it is.
    pub(super) fn image(&self) -> &DMatrix<f64> {
        &self.image
    }

    /// Strengths of the sources for 1 A into an electrode (columns) and out of the last one, over the sheet's resistance.
    pub(super) fn drives(&self) -> &DMatrix<f64> {
        &self.drives
    }

    /// What a unit of every source (columns) gives at discs: `a_n R^n` (rows).
    pub(super) fn orders(&self, discs: &[DiscTouch]) -> DMatrix<f64> {
        let mut orders = DMatrix::zeros(2 * ORDERS * discs.len(), self.sources.len());
        for (mut column, source) in orders.column_iter_mut().zip(&self.sources) {
            for (d, disc) in discs.iter().enumerate() {
                let over = powers(Complex::from(disc.radius_mm) / (source - complex(disc.centre_mm)));
                for (n, power) in (1..).zip(over) {
                    // log |z - s| = log |s| - Re sum (z / s)^n / n
                    column[row(d, n, 0)] = -power.re / n as f64;
                    column[row(d, n, 1)] = -power.im / n as f64;
                }
            }
        }
        orders
    }
}

/// Solves a symmetric, semidefinite system; what is rounding is left out. `None` where its eigenvectors are not found.
fn solved(a: DMatrix<f64>, right: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let most = MOST_STEPS * (a.nrows() + 1);
    let eigen = SymmetricEigen::try_new(a, f64::EPSILON, most)?;
    let least = LEAST_EIGENVALUE * eigen.eigenvalues.amax();
    let mut along = eigen.eigenvectors.tr_mul(right);
    for (mut row, value) in along.row_iter_mut().zip(&eigen.eigenvalues) {
        row *= if *value > least { 1.0 / value } else { 0.0 };
    }
    Some(&eigen.eigenvectors * along)
}

fn less_first(m: DMatrix<f64>) -> DMatrix<f64> {
    let first = m.column(0).into_owned();
    DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] - first[i])
}

/// Strengths of the sources whose fields are the potentials that the elements have in a band inside the rims. `None` where there are
/// too few nodes.
fn drives(solver: &Solver, sources: &[Complex<f64>]) -> Option<DMatrix<f64>> {
    let (mesh, geometry) = (solver.mesh(), solver.model().geometry());
    let step = geometry.rings.iter().map(|r| r.length()).sum::<f64>() / SOURCES;
    let off = |p: [f64; 2]| {
        geometry
            .rings
            .iter()
            .map(|r| r.nearest(p).1)
            .fold(f64::INFINITY, f64::min)
    };
    let inside = |n: &usize| (BAND[0]..BAND[1]).contains(&(off(mesh.nodes[*n]) / step));
    let nodes: Vec<usize> = (0..mesh.nodes.len()).filter(inside).collect();
    if nodes.len() < sources.len() {
        return None;
    }
    // A potential is known up to a constant.
    let field = |n: &usize, k: usize| {
        let source = sources.get(k);
        source.map_or(1.0, |s| (complex(mesh.nodes[*n]) - s).norm().ln())
    };
    let fields = DMatrix::from_fn(nodes.len(), sources.len() + 1, |i, k| field(&nodes[i], k));
    let ohm = solver.model().sheet().sheet_resistance_ohm;
    let all = solver.potentials_v();
    let potentials = DMatrix::from_fn(nodes.len(), all.ncols(), |i, l| all[(nodes[i], l)] / ohm);
    let strengths = solved(fields.tr_mul(&fields), &fields.tr_mul(&potentials))?;
    Some(strengths.rows(0, sources.len()).into_owned())
}

/// Values and slopes of the fields of sources (columns) at points (rows).
fn fields(points: &[Point], sources: &[Complex<f64>]) -> [DMatrix<f64>; 2] {
    let mut out = [0, 1].map(|_| DMatrix::zeros(points.len(), sources.len()));
    for (k, source) in sources.iter().enumerate() {
        for (q, point) in points.iter().enumerate() {
            [out[0][(q, k)], out[1][(q, k)]] = point.field(*source);
        }
    }
    out
}

/// The current that each point draws through its contact, which passes none in all.
fn shunts(points: &[Point], values: &DMatrix<f64>, contacts_mm: &[f64]) -> DMatrix<f64> {
    let mut widths = vec![0.0; contacts_mm.len()];
    let mut means = DMatrix::zeros(contacts_mm.len(), values.ncols());
    let touched = || {
        points
            .iter()
            .enumerate()
            .filter_map(|(q, p)| Some((q, p.length, p.contact?)))
    };
    for (q, length, l) in touched() {
        widths[l] += length;
        let mut mean = means.row_mut(l);
        mean += values.row(q) * length;
    }
    for (mut row, width) in means.row_iter_mut().zip(&widths) {
        row /= *width;
    }
    let mut shunts = DMatrix::zeros(points.len(), values.ncols());
    for (q, length, l) in touched() {
        let drawn = (values.row(q) - means.row(l)) * (length / contacts_mm[l]);
        shunts.row_mut(q).copy_from(&drawn);
    }
    shunts
}

/// Where everything is.
struct Layout {
    sources: Vec<Complex<f64>>,
    points: Vec<Point>,
    places: Vec<Complex<f64>>,
}

impl Layout {
    fn new(geometry: &Geometry) -> Option<Self> {
        let total: f64 = geometry.rings.iter().map(|r| r.length()).sum();
        let mut this = Self {
            sources: Vec::new(),
            points: Vec::new(),
            places: Vec::new(),
        };
        for ring in 0..geometry.rings.len() {
            let length = geometry.rings[ring].length();
            let count = (SOURCES * length / total).round().max(LEAST_SOURCES);
            this.add(geometry, ring, length / count)?;
        }
        (this.places.len() >= this.sources.len()).then_some(this)
    }

    /// Adds a ring with sources at this distance from each other.
    fn add(&mut self, geometry: &Geometry, ring: usize, step: f64) -> Option<()> {
        let curve = &geometry.rings[ring];
        let length = curve.length();
        let at = |s: f64| complex(curve.point(s));
        // Holes run as outlines do, with the sheet outside.
        let side = if ring == 0 { 1.0 } else { -1.0 };
        let normal = |s: f64| {
            let along = at(s + 0.01 * step) - at(s - 0.01 * step);
            Complex::new(along.im, -along.re) / along.norm() * side
        };
        let count = (length / step).round() as usize;
        for k in 0..count {
            let s = (k as f64 + 0.5) * step;
            // Not beyond the middle of a hole.
            let room = if ring == 0 {
                f64::INFINITY
            } else {
                0.5 * curve.radius_of_curvature(s)
            };
            let source = at(s) + normal(s) * (OFFSET * step).min(room);
            if geometry.contains([source.re, source.im]) {
                return None;
            }
            self.sources.push(source);
        }
        for k in 0..PLACES * count {
            let s = (k as f64 + 0.5) * step / PLACES as f64;
            let place = at(s) - normal(s) * step;
            if geometry.contains([place.re, place.im]) {
                self.places.push(place);
            }
        }
        let contact_at = |s: f64| {
            let on = |span: &Span| span.ring == ring && (s - span.start).rem_euclid(length) < span.length;
            geometry.spans.iter().position(on)
        };
        let mut ends = vec![0.0, length];
        ends.extend(curve.corners().map(|(s, _)| s));
        for span in geometry.spans.iter().filter(|s| s.ring == ring && !s.whole) {
            ends.extend([span.start, span.start + span.length].map(|s| s.rem_euclid(length)));
        }
        ends.sort_by(f64::total_cmp);
        for stretch in ends.windows(2) {
            let long = stretch[1] - stretch[0];
            let count = (POINTS * (long / step).max(1.0)).ceil();
            for k in 0..count as usize {
                let s = stretch[0] + (k as f64 + 0.5) * long / count;
                self.points.push(Point {
                    at: at(s),
                    normal: normal(s),
                    length: long / count,
                    contact: contact_at(s),
                });
            }
        }
        Some(())
    }
}
