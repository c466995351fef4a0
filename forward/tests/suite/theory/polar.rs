//! A second discretisation that shares nothing with the first: finite volumes on a polar grid with the complete electrode
//! model. Away from the rim the grid is the same at every angle, so a Fourier transform over the angle and a radial
//! recursion give the rim's answer to a current; the contacts then are a small dense system.

use forward::ElectrodeMatrix;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// Electrodes; each covers a quarter of its pitch.
pub const COUNT: usize = 16;
/// The disc's radius.
pub const RADIUS_MM: f64 = 97.5;

/// Potential of the outermost cells, by distance in cells, for a unit current into one of them and out of all evenly.
/// `rings` cells along the radius, `around` in the angle; conductance per square 1, inside `inner_rings` it is `inside`.
fn rim_response(rings: usize, around: usize, inner_rings: usize, inside: f64) -> Vec<f64> {
    let dr = RADIUS_MM / rings as f64;
    let dt = TAU / around as f64;
    let sigma = |k: usize| if k < inner_rings { inside } else { 1.0 };
    // Conductance of the face between rings k and k + 1, two half cells in series.
    let radial = |k: usize| {
        let r = (k + 1) as f64 * dr;
        r * dt / dr * 2.0 * sigma(k) * sigma(k + 1) / (sigma(k) + sigma(k + 1))
    };
    let response: Vec<f64> = (1..around)
        .map(|mode| {
            let tangential = |k: usize| {
                let r = (k as f64 + 0.5) * dr;
                sigma(k) * dr / (r * dt) * 2.0 * (1.0 - (mode as f64 * dt).cos())
            };
            // Input conductance seen from the outside, ring by ring.
            let mut seen = tangential(0);
            for k in 1..rings {
                let g = radial(k - 1);
                seen = tangential(k) + g * seen / (g + seen);
            }
            1.0 / seen
        })
        .collect();
    (0..around)
        .map(|j| {
            let sum: f64 = (1..around)
                .map(|mode| response[mode - 1] * ((mode * j % around) as f64 * dt).cos())
                .sum();
            sum / around as f64
        })
        .collect()
}

/// The electrodes' matrix (ohm) of a sheet of 1 kilohm per square on a grid of `per_pitch` cells for each electrode and gap;
/// within `inner` of the radius the conductance is `inside` times that of the rest.
pub fn polar(per_pitch: usize, contact_mm: f64, inner: f64, inside: f64) -> ElectrodeMatrix {
    let around = COUNT * per_pitch;
    // Square cells at the rim; the inclusion's edge on a face.
    let rings = (((around as f64 / TAU) / 10.0).round() as usize) * 10;
    let g = rim_response(rings, around, (inner * rings as f64).round() as usize, inside);
    let wide = per_pitch / 4;
    let cells: Vec<usize> = (0..COUNT)
        .flat_map(|l| (0..wide).map(move |c| (l * per_pitch + c + around - wide / 2) % around))
        .collect();
    // From the outermost cell's centre to the metal: half a cell of sheet, then the contact.
    let face = RADIUS_MM * TAU / around as f64;
    let half = 0.5 * RADIUS_MM / rings as f64 * RADIUS_MM / (RADIUS_MM - 0.25 * RADIUS_MM / rings as f64);
    let series = (half + contact_mm) / face;
    let n = cells.len();
    // Unknown: the currents into the cells, the electrodes' potentials, and a constant that makes the currents' sum zero.
    let size = n + COUNT + 1;
    let mut a = DMatrix::zeros(size, size);
    for i in 0..n {
        for j in 0..n {
            a[(i, j)] = g[(cells[i] + around - cells[j]) % around];
        }
        a[(i, i)] += series;
        a[(i, n + i / wide)] = -1.0;
        a[(n + i / wide, i)] = 1.0;
        a[(i, size - 1)] = 1.0;
    }
    // Potentials are relative to the last electrode.
    a[(size - 1, n + COUNT - 1)] = 1.0;
    let lu = a.lu();
    let mut r = DMatrix::zeros(COUNT, COUNT);
    for l in 0..COUNT - 1 {
        let mut b = DVector::zeros(size);
        b[n + l] = 1.0;
        b[n + COUNT - 1] = -1.0;
        let x = lu.solve(&b).unwrap();
        for k in 0..COUNT {
            r[(k, l)] = 1000.0 * x[n + k];
        }
    }
    ElectrodeMatrix::from_potentials(r)
}
