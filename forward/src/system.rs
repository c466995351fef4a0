//! Assembly of the complete electrode model: what of the matrix never changes, and what follows the conductivity.

use crate::cholesky::{CholeskyError, Symbolic};
use crate::curve::distance;
use crate::element::{DEGREE_2, DEGREE_4, gradients};
use crate::mesh::{ContactEdge, Mesh, Order};
use std::sync::Arc;

/// Conductivity of an element relative to the unpressed sheet: the symmetric tensor `[xx, xy, yy]`.
pub type Tensor = [f64; 3];

/// The matrix of a sheet as a linear function of its elements' conductivities.
///
/// Unknowns: the nodes' potentials, then those of all electrodes but the last, which is ground. Scaled so that the
/// unpressed sheet has conductance 1 per square and contact conductance 1 / `contact_mm` per mm.
#[derive(Debug)]
pub(crate) struct System {
    pub(crate) symbolic: Arc<Symbolic>,
    /// Value slots of every element's lower triangle, `entries` each.
    slots: Arc<[u32]>,
    /// Per element and entry the integrals of d_x d_x, d_x d_y + d_y d_x, d_y d_y.
    pub(crate) stiffness: Arc<[[f64; 3]]>,
    /// Entries of an element's lower triangle.
    pub(crate) entries: usize,
    /// The values that do not depend on the sheet: contacts.
    contacts: Vec<f64>,
    pub(crate) nodes: usize,
    pub(crate) electrodes: usize,
    /// Integral of every node's shape function over the grounded electrode's contact, over its contact length.
    ground: Vec<(usize, f64)>,
}

impl System {
    pub(crate) fn new(mesh: &Mesh, contact_mm: &[f64]) -> Result<Self, CholeskyError> {
        let nodes = mesh.nodes.len();
        let electrodes = contact_mm.len();
        let n = nodes + electrodes - 1;
        let mut pairs = Vec::new();
        for element in 0..mesh.triangles.len() {
            let list: Vec<usize> = mesh.element_nodes(element).collect();
            for (k, a) in list.iter().enumerate() {
                pairs.extend(list[..k].iter().map(|b| [*a, *b]));
            }
        }
        for (l, contact) in mesh.contacts.iter().enumerate().take(electrodes - 1) {
            for edge in contact {
                for node in edge.ends.into_iter().chain(edge.middle) {
                    pairs.push([nodes + l, node]);
                }
            }
        }
        let symbolic = Symbolic::new(n, electrodes - 1, &pairs)?;

        let per_element = match mesh.order {
            Order::Linear => 3,
            Order::Quadratic => 6,
        };
        let entries = per_element * (per_element + 1) / 2;
        let mut slots = Vec::with_capacity(mesh.triangles.len() * entries);
        let mut stiffness = Vec::with_capacity(mesh.triangles.len() * entries);
        for element in 0..mesh.triangles.len() {
            let list: Vec<usize> = mesh.element_nodes(element).collect();
            for i in 0..per_element {
                for j in 0..=i {
                    slots.push(symbolic.slot(list[i], list[j]) as u32);
                }
            }
            element_stiffness(mesh, element, &mut stiffness);
        }

        let mut this = Self {
            symbolic: Arc::new(symbolic),
            slots: slots.into(),
            stiffness: stiffness.into(),
            entries,
            contacts: Vec::new(),
            nodes,
            electrodes,
            ground: Vec::new(),
        };
        this.connect(mesh, contact_mm);
        Ok(this)
    }

    /// The same with other contacts.
    pub(crate) fn with_contacts(&self, mesh: &Mesh, contact_mm: &[f64]) -> Self {
        let mut this = Self {
            symbolic: Arc::clone(&self.symbolic),
            slots: Arc::clone(&self.slots),
            stiffness: Arc::clone(&self.stiffness),
            contacts: Vec::new(),
            ground: Vec::new(),
            ..*self
        };
        this.connect(mesh, contact_mm);
        this
    }

    /// Computes what the contacts give.
    fn connect(&mut self, mesh: &Mesh, contact_mm: &[f64]) {
        let (nodes, electrodes) = (self.nodes, self.electrodes);
        let mut contacts = vec![0.0; self.symbolic.values()];
        let mut ground = Vec::new();
        for (l, (contact, length)) in mesh.contacts.iter().zip(contact_mm).enumerate() {
            for edge in contact {
                contact_terms(mesh, edge, |term| {
                    let (i, j, value) = match term {
                        Term::NodeNode(i, j, v) => (i, j, v),
                        // The last electrode is ground: its row and column are left out.
                        Term::NodeElectrode(i, v) if l + 1 == electrodes => {
                            ground.push((i, v / length));
                            return;
                        }
                        Term::Electrode(_) if l + 1 == electrodes => return,
                        Term::NodeElectrode(i, v) => (i, nodes + l, -v),
                        Term::Electrode(v) => (nodes + l, nodes + l, v),
                    };
                    contacts[self.symbolic.slot(i, j)] += value / length;
                });
            }
        }
        (self.contacts, self.ground) = (contacts, ground);
    }

    /// An element whose stiffness has a diagonal that is not positive: its mapping is folded.
    pub(crate) fn tangled(&self) -> Option<usize> {
        self.stiffness
            .chunks_exact(self.entries)
            .position(|k| (k[0][0] + k[0][2]).is_nan() || k[0][0] + k[0][2] <= 0.0)
    }

    /// The elements' integrals on a mesh whose `changed` elements have another shape.
    pub(crate) fn reshaped(&self, mesh: &Mesh, changed: &[usize]) -> Vec<[f64; 3]> {
        let mut stiffness = self.stiffness.to_vec();
        let mut one = Vec::with_capacity(self.entries);
        for element in changed {
            one.clear();
            element_stiffness(mesh, *element, &mut one);
            stiffness[element * self.entries..(element + 1) * self.entries].copy_from_slice(&one);
        }
        stiffness
    }

    /// Positions in elimination order of the nodes under the grounded electrode, with their conductance to it.
    pub(crate) fn grounded(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.ground
            .iter()
            .map(|(node, share)| (self.symbolic.position(*node), *share))
    }

    /// Current into the grounded electrode by its contact integral, from the nodes' potentials.
    pub(crate) fn ground_current(&self, potential: impl Fn(usize) -> f64) -> f64 {
        self.ground.iter().map(|(node, share)| share * potential(*node)).sum()
    }

    /// The matrix's values for these conductivities and elements' integrals, into `values`.
    pub(crate) fn assemble(&self, conductivity: &[Tensor], stiffness: &[[f64; 3]], values: &mut Vec<f64>) {
        values.clear();
        values.extend_from_slice(&self.contacts);
        let elements = self
            .slots
            .chunks_exact(self.entries)
            .zip(stiffness.chunks_exact(self.entries));
        for (s, (slots, stiffness)) in conductivity.iter().zip(elements) {
            for (slot, k) in slots.iter().zip(stiffness) {
                values[*slot as usize] += s[0] * k[0] + s[1] * k[1] + s[2] * k[2];
            }
        }
    }
}

/// Appends the lower triangle of an element's three stiffness matrices.
fn element_stiffness(mesh: &Mesh, element: usize, out: &mut Vec<[f64; 3]>) {
    let rule: &[([f64; 3], f64)] = match (mesh.order, mesh.curved[element]) {
        (_, true) => &DEGREE_4,
        (Order::Quadratic, false) => &DEGREE_2,
        (Order::Linear, false) => &[([1.0 / 3.0; 3], 1.0)],
    };
    let first = out.len();
    for (l, weight) in rule {
        let (g, count, det) = gradients(mesh, element, *l);
        let w = weight * 0.5 * det;
        let mut k = first;
        for i in 0..count {
            for j in 0..=i {
                let term = [
                    w * g[i][0] * g[j][0],
                    w * (g[i][0] * g[j][1] + g[i][1] * g[j][0]),
                    w * g[i][1] * g[j][1],
                ];
                match out.get_mut(k) {
                    Some(sum) => (0..3).for_each(|c| sum[c] += term[c]),
                    None => out.push(term),
                }
                k += 1;
            }
        }
    }
}

/// One contribution of a contact edge, for a contact of 1 mm.
pub(crate) enum Term {
    /// Integral of the product of two nodes' shape functions, mm.
    NodeNode(usize, usize, f64),
    /// Integral of a node's shape function, mm.
    NodeElectrode(usize, f64),
    /// Length of the edge, mm.
    Electrode(f64),
}

/// Integrals along a contact edge, every unordered pair of nodes once.
pub(crate) fn contact_terms(mesh: &Mesh, edge: &ContactEdge, mut add: impl FnMut(Term)) {
    let [a, b] = edge.ends;
    let Some(m) = edge.middle else {
        let h = distance(mesh.nodes[a], mesh.nodes[b]);
        add(Term::NodeNode(a, a, h / 3.0));
        add(Term::NodeNode(b, b, h / 3.0));
        add(Term::NodeNode(a, b, h / 6.0));
        add(Term::NodeElectrode(a, h / 2.0));
        add(Term::NodeElectrode(b, h / 2.0));
        add(Term::Electrode(h));
        return;
    };
    // Three-point Gauss rule on [-1, 1] along the curved edge: exact for straight ones.
    let x = 0.6_f64.sqrt();
    for (t, w) in [(-x, 5.0 / 9.0), (0.0, 8.0 / 9.0), (x, 5.0 / 9.0)] {
        let shape = [0.5 * t * (t - 1.0), 1.0 - t * t, 0.5 * t * (t + 1.0)];
        let slope = [t - 0.5, -2.0 * t, t + 0.5];
        let ids = [a, m, b];
        let tangent = |k: usize| -> f64 { ids.iter().zip(slope).map(|(id, d)| mesh.nodes[*id][k] * d).sum() };
        let w = w * libm::hypot(tangent(0), tangent(1));
        for i in 0..3 {
            for j in 0..=i {
                add(Term::NodeNode(ids[i], ids[j], w * shape[i] * shape[j]));
            }
            add(Term::NodeElectrode(ids[i], w * shape[i]));
        }
        add(Term::Electrode(w));
    }
}
