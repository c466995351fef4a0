//! Discs in an even sheet by multiple scattering: what they change in the electrode matrix, without a mesh.
//!
//! Around the centre of a disc of radius R and rise c the potential that comes to it is `Re sum a_n z^n`. The disc answers with
//! `Re sum b_n z^-n`, `b_n = s/2 R^2n conj(a_n)` and `s = 2 c / (2 + c)`: the dielectric cylinder of electrostatics, the same factor
//! for every order. What one disc answers comes to the others, and its image in the rims comes to all, itself included. Both are
//! linear in the `b_n`: all discs together are one linear system of `2 ORDERS` unknowns a disc, solved for all electrodes at once.
//! The change of the electrode matrix is `s pi rho_s sum n R^2n Re(a_n conj(a'_n))`, a' being what comes without any disc
//! (Geselowitz 1971, both integrals over the disc done).
//!
//! The image is a harmonic field inside the sheet. It is that of line sources outside, which are spaced evenly along the rims (the
//! method of fundamental solutions). `rim.rs` finds their strengths.
//!
//! Multipoles converge as long as discs are apart from one another and from the rims; docs/forward.md says how well.

mod rim;

use crate::field::DiscTouch;
use crate::geometry::Geometry;
use crate::sensitivity::Sensitivity;
use crate::solver::Solver;
use nalgebra::{Complex, DMatrix};
use rim::Rims;
use std::f64::consts::PI;

/// Orders of multipoles. With 3 discs that nearly reach the rim are several times less exact; 8 gain little and take twice
/// the time.
const ORDERS: usize = 4;

/// A sheet, prepared for discs.
#[derive(Clone, Debug)]
pub struct Scattering {
    geometry: Geometry,
    sheet_resistance_ohm: f64,
    rims: Rims,
}

/// What discs change.
#[derive(Clone, Debug)]
pub struct Scattered {
    /// To the first order in the contrast: one region, all the discs, for a rise of 1.
    pub first_order: Sensitivity,
    /// The whole change of the electrode matrix, ohm, `[i, j]` as in
    /// [`ElectrodeMatrix::potentials_ohm`](crate::ElectrodeMatrix::potentials_ohm).
    pub change_ohm: DMatrix<f64>,
}

/// Row of the real (0) or imaginary (1) part of an order, from 1, of a disc.
fn row(disc: usize, order: usize, part: usize) -> usize {
    2 * (disc * ORDERS + order - 1) + part
}

impl Scattering {
    /// Prepares a sheet, which takes some 20 ms. `None` where there is no room outside for the line sources: a re-entrant rim whose sides
    /// are close to each other, or a small hole that is no circle.
    pub fn new(solver: &Solver) -> Option<Self> {
        let model = solver.model();
        let sheet = model.sheet();
        Some(Self {
            rims: Rims::new(solver)?,
            geometry: model.geometry().clone(),
            sheet_resistance_ohm: sheet.sheet_resistance_ohm,
        })
    }

    /// What discs change. `None` where a disc reaches a rim or another disc, which multipoles cannot describe, or is none.
    pub fn discs(&self, discs: &[DiscTouch]) -> Option<Scattered> {
        if !self.are_apart(discs) {
            return None;
        }
        if discs.is_empty() {
            let electrodes = self.rims.drives().ncols();
            return Some(Scattered {
                first_order: Sensitivity::from_gram(electrodes, 1, vec![0.0; electrodes * electrodes]),
                change_ohm: DMatrix::zeros(electrodes, electrodes),
            });
        }
        let here = self.rims.orders(discs);
        let incident = &here * self.rims.drives();
        // (1 - field s/2 conj) a = incident
        let mut system = self.field(discs, &here);
        for (d, disc) in discs.iter().enumerate() {
            for order in 1..=ORDERS {
                system.column_mut(row(d, order, 0)).scale_mut(-half_contrast(disc));
                system.column_mut(row(d, order, 1)).scale_mut(half_contrast(disc));
            }
        }
        for k in 0..system.nrows() {
            system[(k, k)] += 1.0;
        }
        let coming = system.lu().solve(&incident)?;
        let linear = self.change(discs, &incident, &incident);
        let electrodes = linear.nrows();
        Some(Scattered {
            first_order: Sensitivity::from_gram(electrodes, 1, linear.as_slice().to_vec()),
            change_ohm: self.change(discs, &incident, &coming),
        })
    }

    fn are_apart(&self, discs: &[DiscTouch]) -> bool {
        let distance = |a: &DiscTouch, b: &DiscTouch| {
            libm::hypot(a.centre_mm[0] - b.centre_mm[0], a.centre_mm[1] - b.centre_mm[1])
        };
        discs.iter().enumerate().all(|(k, disc)| {
            let clear = |other: &DiscTouch| distance(disc, other) > disc.radius_mm + other.radius_mm;
            let is_one = disc.radius_mm > 0.0 && disc.rise > -1.0 && disc.rise.is_finite();
            is_one && discs[..k].iter().all(clear) && self.geometry.is_clear(disc.centre_mm, disc.radius_mm)
        })
    }

    /// What comes to every disc (rows) of what the discs answer (columns). Orders are in units of the radii: `a_n R^n` and `b_n R^-n`.
    fn field(&self, discs: &[DiscTouch], here: &DMatrix<f64>) -> DMatrix<f64> {
        let mut answered = here.clone();
        for d in 0..discs.len() {
            for order in 1..=ORDERS {
                answered.row_mut(row(d, order, 0)).scale_mut(-(order as f64));
                answered.row_mut(row(d, order, 1)).scale_mut(order as f64);
            }
        }
        let mut field = here * (self.rims.image() * answered.transpose());
        for (to, at) in discs.iter().enumerate() {
            for (from, source) in discs.iter().enumerate().filter(|(from, _)| *from != to) {
                let apart = complex(at.centre_mm) - complex(source.centre_mm);
                let [near, far] = [at, source].map(|d| powers(Complex::from(d.radius_mm) / apart));
                for (m, far) in (1..).zip(far) {
                    for (n, near) in (1..).zip(near) {
                        // z^-m about another centre: binomial(-m, n) apart^(-m-n) z^n.
                        let sign = if n % 2 == 0 { 1.0 } else { -1.0 };
                        let f = far * near * (sign * binomial(m + n - 1, n));
                        field[(row(to, n, 0), row(from, m, 0))] += f.re;
                        field[(row(to, n, 0), row(from, m, 1))] -= f.im;
                        field[(row(to, n, 1), row(from, m, 0))] += f.im;
                        field[(row(to, n, 1), row(from, m, 1))] += f.re;
                    }
                }
            }
        }
        field
    }

    /// The change of the electrode matrix, ohm, by what comes to the discs without any of them and with all.
    fn change(&self, discs: &[DiscTouch], incident: &DMatrix<f64>, coming: &DMatrix<f64>) -> DMatrix<f64> {
        let mut weighted = coming.clone();
        for (d, disc) in discs.iter().enumerate() {
            for order in 1..=ORDERS {
                let weight = 2.0 * PI * half_contrast(disc) * order as f64 * self.sheet_resistance_ohm;
                weighted.row_mut(row(d, order, 0)).scale_mut(weight);
                weighted.row_mut(row(d, order, 1)).scale_mut(weight);
            }
        }
        incident.tr_mul(&weighted)
    }
}

/// `s / 2`: what a disc answers over what comes, at its edge.
fn half_contrast(disc: &DiscTouch) -> f64 {
    disc.rise / (2.0 + disc.rise)
}

fn complex(p: [f64; 2]) -> Complex<f64> {
    Complex::new(p[0], p[1])
}

/// The first powers.
fn powers(z: Complex<f64>) -> [Complex<f64>; ORDERS] {
    let mut power = Complex::from(1.0);
    std::array::from_fn(|_| {
        power *= z;
        power
    })
}

fn binomial(n: usize, k: usize) -> f64 {
    (1..=k).fold(1.0, |product, i| product * (n - k + i) as f64 / i as f64)
}
