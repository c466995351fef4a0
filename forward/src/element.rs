//! Shape functions and quadrature of linear and quadratic triangles.

use crate::curve::Point;
use crate::mesh::{Mesh, Order};

/// Most nodes of an element.
pub(crate) const MOST_NODES: usize = 6;

/// Barycentric points and weights (sum 1) of the degree-2 rule.
pub(crate) const DEGREE_2: [([f64; 3], f64); 3] = [
    ([2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0], 1.0 / 3.0),
    ([1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0], 1.0 / 3.0),
    ([1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0], 1.0 / 3.0),
];

const A1: f64 = 0.445_948_490_915_965;
const B1: f64 = 1.0 - 2.0 * A1;
const W1: f64 = 0.223_381_589_678_011;
const A2: f64 = 0.091_576_213_509_771;
const B2: f64 = 1.0 - 2.0 * A2;
const W2: f64 = 1.0 / 3.0 - W1;

/// The six-point degree-4 rule (Dunavant 1985).
pub(crate) const DEGREE_4: [([f64; 3], f64); 6] = [
    ([B1, A1, A1], W1),
    ([A1, B1, A1], W1),
    ([A1, A1, B1], W1),
    ([B2, A2, A2], W2),
    ([A2, B2, A2], W2),
    ([A2, A2, B2], W2),
];

/// Derivatives of the shape functions by the barycentric coordinates' plane (xi = l1, eta = l2), `[node][xi, eta]`.
pub(crate) fn reference_gradients(order: Order, l: [f64; 3]) -> ([[f64; 2]; MOST_NODES], usize) {
    // d l0 = (-1, -1), d l1 = (1, 0), d l2 = (0, 1).
    const D: [[f64; 2]; 3] = [[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]];
    let mut g = [[0.0; 2]; MOST_NODES];
    match order {
        Order::Linear => {
            g[..3].copy_from_slice(&D);
            (g, 3)
        }
        Order::Quadratic => {
            for k in 0..3 {
                let next = (k + 1) % 3;
                for i in 0..2 {
                    g[k][i] = (4.0 * l[k] - 1.0) * D[k][i];
                    g[3 + k][i] = 4.0 * (l[k] * D[next][i] + l[next] * D[k][i]);
                }
            }
            (g, 6)
        }
    }
}

/// Gradients of the shape functions in the sheet's frame (1/mm) at barycentric coordinates `l`, their number, and the
/// determinant of the mapping, mm². The determinant of a straight triangle is twice its area; it is not positive where a
/// curved element is tangled.
pub(crate) fn gradients(mesh: &Mesh, element: usize, l: [f64; 3]) -> ([[f64; 2]; MOST_NODES], usize, f64) {
    let (reference, count) = reference_gradients(mesh.order, l);
    let mut j = [[0.0; 2]; 2];
    if mesh.curved[element] {
        for (node, g) in mesh.element_nodes(element).zip(&reference) {
            let p = mesh.nodes[node];
            for (row, x) in j.iter_mut().zip(p) {
                row[0] += x * g[0];
                row[1] += x * g[1];
            }
        }
    } else {
        let [a, b, c] = mesh.corners(element);
        j = [[b[0] - a[0], c[0] - a[0]], [b[1] - a[1], c[1] - a[1]]];
    }
    let det = j[0][0] * j[1][1] - j[0][1] * j[1][0];
    let mut g = [[0.0; 2]; MOST_NODES];
    for (out, r) in g.iter_mut().zip(&reference[..count]) {
        out[0] = (j[1][1] * r[0] - j[1][0] * r[1]) / det;
        out[1] = (j[0][0] * r[1] - j[0][1] * r[0]) / det;
    }
    (g, count, det)
}

/// Position of barycentric coordinates in a straight triangle.
pub(crate) fn position(corners: [Point; 3], l: [f64; 3]) -> Point {
    let at = |k: usize| l[0] * corners[0][k] + l[1] * corners[1][k] + l[2] * corners[2][k];
    [at(0), at(1)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_integrate_their_degree_exactly() {
        // Mean over the triangle of l0^a l1^b l2^c is 2 a! b! c! / (a + b + c + 2)!.
        let factorial = |n: i32| (1..=n).map(f64::from).product::<f64>();
        let check = |rule: &[([f64; 3], f64)], degree: i32| {
            for a in 0..=degree {
                for b in 0..=degree - a {
                    let c = degree - a - b;
                    let exact = 2.0 * factorial(a) * factorial(b) * factorial(c) / factorial(a + b + c + 2);
                    let got: f64 = rule
                        .iter()
                        .map(|(l, w)| w * l[0].powi(a) * l[1].powi(b) * l[2].powi(c))
                        .sum();
                    assert!((got - exact).abs() < 1e-14, "{a} {b} {c}: {got} {exact}");
                }
            }
        };
        check(&DEGREE_2, 2);
        check(&DEGREE_4, 4);
    }

    #[test]
    fn gradients_of_a_partition_of_unity_sum_to_zero() {
        for order in [Order::Linear, Order::Quadratic] {
            let (g, count) = reference_gradients(order, [0.2, 0.5, 0.3]);
            for i in 0..2 {
                let sum: f64 = g[..count].iter().map(|g| g[i]).sum();
                assert!(sum.abs() < 1e-15);
            }
        }
    }
}
