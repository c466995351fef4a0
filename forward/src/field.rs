//! Resistivity of a touched sheet on a mesh: an effective conductivity for every element.

use crate::curve::{Point, distance};
use crate::element::{DEGREE_4, position};
use crate::error::ForwardError;
use crate::mesh::Mesh;
use crate::system::Tensor;

/// A disc in which the resistivity is raised by the same factor everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiscTouch {
    /// Centre, mm.
    pub centre_mm: Point,
    /// Radius, mm.
    pub radius_mm: f64,
    /// Relative rise in resistivity: 0.2 is +20 %. Greater than -1. Where discs overlap the rises add.
    pub rise: f64,
}

impl DiscTouch {
    /// Refuses a disc that cannot be: the touch of this number, from 0.
    pub(crate) fn check(&self, touch: usize) -> Result<(), ForwardError> {
        let finite =
            self.centre_mm.iter().all(|x| x.is_finite()) && self.radius_mm.is_finite() && self.rise.is_finite();
        let can_be = finite && self.radius_mm > 0.0 && self.rise > -1.0;
        can_be.then_some(()).ok_or(ForwardError::Touch { touch })
    }

    /// Relative rise at a point: that of the disc inside, 0 outside.
    pub fn rise_at(&self, p: Point) -> f64 {
        if distance(p, self.centre_mm) < self.radius_mm {
            self.rise
        } else {
            0.0
        }
    }
}

/// Conductivity of the untouched sheet.
pub const UNPRESSED: Tensor = [1.0, 0.0, 1.0];

/// Distance from a disc's edge below which a node is on it, over the radius. Nodes are moved there to a few roundings.
const ON_THE_EDGE: f64 = 1e-9;

/// Divisions of a cut element's sides when its jump is averaged over sub-triangles. More follow the edge better, at a cost
/// with the square.
const CUTS: usize = 16;

/// Conductivity, relative to the unpressed sheet, of every element under disc touches.
///
/// An element that a disc's edge cuts gets the tensor of the equivalent laminate: arithmetic mean of the conductivity
/// along the edge, harmonic mean across it. The voltages then converge with the square of the element size although no
/// element follows the edge.
pub fn conductivity_of_discs(mesh: &Mesh, touches: &[DiscTouch]) -> Vec<Tensor> {
    stepped(mesh, touches, |_, whole| 1.0 / (1.0 + whole), |_, whole| 1.0 + whole)
}

/// Points of an element at which a field on the sheet is known.
pub const POINTS: usize = DEGREE_4.len();

/// Where the points of an element are, mm.
pub fn points(mesh: &Mesh, element: usize) -> [Point; POINTS] {
    DEGREE_4.map(|(l, _)| position(mesh.corners(element), l))
}

/// Conductivity of every element, relative to the unpressed sheet, where the resistivity is a function of some quantity such
/// as a strain. `resistivity` gives its relative value. The quantity is the sum of a smooth field, known at the [`points`] of
/// every element, and of steps over discs: inside a disc its [`DiscTouch::rise`] is added. Elements that a disc's edge cuts
/// are averaged as by [`conductivity_of_discs`].
pub fn conductivity_of_steps(
    mesh: &Mesh,
    steps: &[DiscTouch],
    smooth: &[[f64; POINTS]],
    resistivity: impl Fn(f64) -> f64,
) -> Vec<Tensor> {
    let field = |element: usize| smooth.get(element).unwrap_or(&[0.0; POINTS]);
    stepped(
        mesh,
        steps,
        |element, whole| {
            let values = field(element).iter().zip(&DEGREE_4);
            values.map(|(s, (_, w))| w / resistivity(s + whole)).sum()
        },
        |element, whole| {
            let values = field(element).iter().zip(&DEGREE_4);
            resistivity(whole + values.map(|(s, (_, w))| s * w).sum::<f64>())
        },
    )
}

/// Every element's conductivity: `even(element, sum of the steps around it)` where no disc's edge cuts it, else the
/// laminate's of `resistivity(element, sum of the steps at a point)`.
fn stepped(
    mesh: &Mesh,
    touches: &[DiscTouch],
    even: impl Fn(usize, f64) -> f64,
    resistivity: impl Fn(usize, f64) -> f64,
) -> Vec<Tensor> {
    let mut near = Vec::new();
    (0..mesh.triangles.len())
        .map(|element| {
            let corners = mesh.corners(element);
            let centre = position(corners, [1.0 / 3.0; 3]);
            let reach = corners.iter().map(|c| distance(*c, centre)).fold(0.0, f64::max);
            // Touches that raise the whole element, and those whose edge may cut it. Across an edge the jump is along the
            // radius. An element with an edge of its own along the disc's edge is not cut: it lies on one side.
            let mut whole = 0.0;
            let mut normal = [0.0; 2];
            near.clear();
            for t in touches {
                let r = distance(centre, t.centre_mm);
                let beyond = r - t.radius_mm;
                let inside = if beyond.abs() > reach {
                    Some(beyond < 0.0)
                } else {
                    side(mesh, element, t)
                };
                match inside {
                    Some(true) => whole += t.rise,
                    Some(false) => {}
                    None => {
                        near.push(*t);
                        if r > 0.0 {
                            normal[0] += t.rise * (centre[0] - t.centre_mm[0]) / r;
                            normal[1] += t.rise * (centre[1] - t.centre_mm[1]) / r;
                        }
                    }
                }
            }
            if near.is_empty() {
                let s = even(element, whole);
                [s, 0.0, s]
            } else {
                laminate(corners, normal, |p| {
                    resistivity(element, whole + near.iter().map(|t| t.rise_at(p)).sum::<f64>())
                })
            }
        })
        .collect()
}

/// For an element with an edge along the disc's edge and no vertex across it: whether it is inside the disc.
fn side(mesh: &Mesh, element: usize, touch: &DiscTouch) -> Option<bool> {
    let beyond = |node: usize| (distance(mesh.nodes[node], touch.centre_mm) - touch.radius_mm) / touch.radius_mm;
    let on = |node: usize| beyond(node).abs() < ON_THE_EDGE;
    let corners = mesh.triangles[element];
    let along = (0..3).any(|k| {
        let middle = mesh.middles.get(element).map(|m| m[k]);
        on(corners[k]) && on(corners[(k + 1) % 3]) && middle.is_none_or(on)
    });
    let [a, b, c] = corners.map(beyond);
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    // A triangle with all its corners on the circle is inside.
    match (along, low < -ON_THE_EDGE, high > ON_THE_EDGE) {
        (true, _, false) => Some(true),
        (true, false, true) => Some(false),
        _ => None,
    }
}

/// Conductivity, relative to the unpressed sheet, of every element under a smooth relative rise of the resistivity: the
/// mean over the element. For fields with jumps use [`conductivity_of_discs`].
pub fn conductivity_of(mesh: &Mesh, rise: impl Fn(Point) -> f64) -> Vec<Tensor> {
    (0..mesh.triangles.len())
        .map(|element| {
            let corners = mesh.corners(element);
            let s = DEGREE_4
                .iter()
                .map(|(l, w)| w / (1.0 + rise(position(corners, *l))))
                .sum();
            [s, 0.0, s]
        })
        .collect()
}

/// The tensor of a triangle in which the resistivity varies along `normal` (of any length) only.
fn laminate(corners: [Point; 3], normal: Point, resistivity: impl Fn(Point) -> f64) -> Tensor {
    let n = CUTS as f64;
    let (mut mean, mut inverse, mut count) = (0.0, 0.0, 0.0);
    for i in 0..CUTS {
        for j in 0..CUTS - i {
            // The upright sub-triangle, and the one turned over beside it.
            for (turn, least) in [(1.0 / 3.0, 0), (2.0 / 3.0, 1)] {
                if i + j + least >= CUTS {
                    continue;
                }
                let (a, b) = ((i as f64 + turn) / n, (j as f64 + turn) / n);
                let s = 1.0 / resistivity(position(corners, [1.0 - a - b, a, b]));
                mean += s;
                inverse += 1.0 / s;
                count += 1.0;
            }
        }
    }
    mean /= count;
    let harmonic = count / inverse;
    let length = libm::hypot(normal[0], normal[1]);
    if length <= f64::MIN_POSITIVE {
        return [mean, 0.0, mean];
    }
    let (x, y) = (normal[0] / length, normal[1] / length);
    let step = harmonic - mean;
    [mean + step * x * x, step * x * y, mean + step * y * y]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_triangle_is_a_laminate() {
        // Half-plane x > 0.5 (1 / (1 + 3) of the conductivity) over the unit right triangle: a quarter of its area.
        let t = laminate([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [2.0, 0.0], |p| {
            if p[0] > 0.5 { 4.0 } else { 1.0 }
        });
        let f = 0.25;
        assert!((t[0] - 1.0 / (1.0 - f + f * 4.0)).abs() < 0.02, "{t:?}");
        assert!((t[2] - (1.0 - f + f / 4.0)).abs() < 0.01, "{t:?}");
    }

    #[test]
    fn no_jump_no_tensor() {
        let t = laminate([[0.0, 0.0], [1.0, 0.0], [0.3, 1.0]], [1.0, 1.0], |_| 2.0);
        assert!(t.iter().zip([0.5, 0.0, 0.5]).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
