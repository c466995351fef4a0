//! The response of measurements to what is not exactly known of electrodes: their contact and their place on the rim.
//!
//! The complete electrode model is the minimum of a quadratic form whose part at electrode l is
//! `(1/z) integral over E_l of (u - U_l)^2`. A change dA of that form changes transfer impedances by
//! `dZ[m,n] = -dA(u_m, u_n)`, so that with `w_m = U_l - u_m`
//!
//! - a relative rise of the contact impedance z gives `+ (1/z) integral over E_l of w_m w_n`,
//! - a move along the rim by 1 mm gives `(1/z) (w_m w_n at the end left behind - w_m w_n at the leading end)`.

use crate::geometry::{Electrode, Geometry, Place, Sheet};
use crate::mesh::{ContactEdge, Mesh};
use crate::sensitivity::Sensitivity;
use crate::solver::Solver;

/// Gauss points and weights on 0..1, exact to degree 5.
const GAUSS: [(f64, f64); 3] = [
    (0.112_701_665_379_258_31, 5.0 / 18.0),
    (0.5, 8.0 / 18.0),
    (0.887_298_334_620_741_7, 5.0 / 18.0),
];

impl Sensitivity {
    /// Regions 0 to n - 1: the contacts of the n electrodes, per unit of relative rise of their impedance. Regions n to
    /// 2 n - 1: the electrodes' places, per mm along the rim (in the sense in which the outline runs, counter-clockwise;
    /// 0 for electrodes inside the sheet).
    pub fn by_electrode(solver: &Solver) -> Self {
        let mesh = solver.mesh();
        let model = solver.model();
        let n = model.electrodes();
        let potentials = solver.potentials_v();
        let matrix = solver.electrode_matrix().potentials_ohm();
        let mut gram = vec![0.0; 2 * n * n * n];
        let mut w = vec![0.0; n];
        for (l, electrode) in model.sheet().electrodes.iter().enumerate() {
            let conductance = 1.0 / (electrode.contact_mm * model.sheet().sheet_resistance_ohm);
            let mut add = |region: usize, nodes: &[(usize, f64)], weight: f64| {
                for (j, w) in w.iter_mut().enumerate() {
                    let u: f64 = nodes.iter().map(|(node, share)| share * potentials[(*node, j)]).sum();
                    *w = matrix[(l, j)] - u;
                }
                for (row, a) in gram[region * n * n..(region + 1) * n * n].chunks_exact_mut(n).zip(&w) {
                    for (g, b) in row.iter_mut().zip(&w) {
                        *g += weight * conductance * a * b;
                    }
                }
            };
            for edge in &mesh.contacts[l] {
                for (t, weight) in GAUSS {
                    let (nodes, speed) = point(mesh, edge, t);
                    add(l, &nodes, weight * speed);
                }
            }
            let starts = |node: usize| mesh.contacts[l].iter().any(|e| e.ends[0] == node);
            let stops = |node: usize| mesh.contacts[l].iter().any(|e| e.ends[1] == node);
            for edge in &mesh.contacts[l] {
                let [from, to] = edge.ends;
                if !stops(from) {
                    add(n + l, &[(from, 1.0)], 1.0);
                }
                if !starts(to) {
                    add(n + l, &[(to, 1.0)], -1.0);
                }
            }
        }
        Self::from_gram(n, 2 * n, gram)
    }
}

/// Shares of the nodes at a place on a contact edge (t from 0 to 1), and the edge's length for a unit of t there, mm.
fn point(mesh: &Mesh, edge: &ContactEdge, t: f64) -> ([(usize, f64); 3], f64) {
    let [a, b] = edge.ends;
    let (nodes, slope) = match edge.middle {
        Some(m) => (
            [
                (a, (1.0 - t) * (1.0 - 2.0 * t)),
                (m, 4.0 * t * (1.0 - t)),
                (b, t * (2.0 * t - 1.0)),
            ],
            [4.0 * t - 3.0, 4.0 - 8.0 * t, 4.0 * t - 1.0],
        ),
        None => ([(a, 1.0 - t), (a, 0.0), (b, t)], [-1.0, 0.0, 1.0]),
    };
    let along = |axis: usize| -> f64 {
        nodes
            .iter()
            .zip(slope)
            .map(|((node, _), s)| s * mesh.nodes[*node][axis])
            .sum()
    };
    (nodes, libm::hypot(along(0), along(1)))
}

impl Geometry {
    /// The sheet with every electrode off by what `off` says: first the logarithms of the factors of the n contact
    /// impedances, then the n moves along the rim, mm, as the regions of [`Sensitivity::by_electrode`]. `None` when `off`
    /// does not have 2 n numbers.
    pub fn displaced(&self, sheet: &Sheet, off: &[f64]) -> Option<Sheet> {
        let n = sheet.electrodes.len();
        if off.len() != 2 * n {
            return None;
        }
        let electrodes = (0..n)
            .map(|l| {
                Some(Electrode {
                    place: self.moved(sheet, l, off[n + l])?,
                    contact_mm: sheet.electrodes[l].contact_mm * libm::exp(off[l]),
                })
            })
            .collect::<Option<Vec<_>>>()?;
        Some(Sheet {
            electrodes,
            ..sheet.clone()
        })
    }

    /// An electrode moved along its rim by so many mm (in the sense in which the outline runs); one inside the sheet stays
    /// where it is.
    pub fn moved(&self, sheet: &Sheet, electrode: usize, along_mm: f64) -> Option<Place> {
        let place = sheet.electrodes.get(electrode)?.place;
        let span = self.spans.get(electrode)?;
        if span.whole {
            return Some(place);
        }
        Some(Place::Point {
            point_mm: self.rings[span.ring].point(span.start + 0.5 * span.length + along_mm),
            width_mm: span.length,
        })
    }
}
