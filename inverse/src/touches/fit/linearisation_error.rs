//! What the linear model leaves out, carried from frame to frame.
//!
//! Solving the sheet costs a hundred times what a frame's fit does, and touches move by tenths of a millimetre from one frame to the next.
//! What was left out for the touches of an earlier frame goes with the squares of their strengths, and is off by about twice
//! what they moved in radii; it serves for as long as that does not show.

use crate::touches::fit::nonlinear::Beyond;
use crate::touches::fit::responses::TouchTable;
use crate::touches::fit::{Disc, Discs, MOST_TOUCHES};

/// Relative change of what is left out over that of a disc's strength, over its move in radii, and over the relative change of its
/// radius: the first is 2.0 for any touches, the others scatter (0.6 to 2, now and then 3.6; and 0.3 to 1.8).
const BY_STRENGTH: f64 = 2.0;
const BY_MOVE: f64 = 2.0;
const BY_RADIUS: f64 = 0.8;

/// What is left out for some discs.
#[derive(Clone, Debug)]
pub struct Correction {
    discs: Discs,
    volts: Vec<f64>,
}

impl Correction {
    /// Solves for discs.
    pub fn solve(beyond: &mut Beyond, table: &TouchTable, discs: &[Disc]) -> Option<Self> {
        Some(Self {
            volts: beyond.table_v(table, discs)?,
            discs: discs.iter().copied().take(MOST_TOUCHES).collect(),
        })
    }

    /// V of the model.
    pub fn volts(&self) -> &[f64] {
        &self.volts
    }

    /// How many times as much is left out for these discs, as far as their strengths say.
    pub fn scale(&self, discs: &[Disc]) -> f64 {
        let square = |discs: &[Disc]| discs.iter().map(|d| d.strength * d.strength).sum::<f64>();
        let scale = square(discs) / square(&self.discs);
        if scale.is_finite() { scale } else { 0.0 }
    }

    /// Relative error of `scale` times this for other discs.
    pub fn error(&self, discs: &[Disc], scale: f64) -> f64 {
        let all = self.discs.iter().map(|d| d.strength * d.strength).sum::<f64>().sqrt();
        // One that has come or gone.
        let alone = |strength: f64| BY_STRENGTH * strength / all;
        let apart = |a: &Disc, b: &Disc| (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1]);
        let mut met = [false; MOST_TOUCHES];
        let mut of = |d: &Disc| {
            let near = self
                .discs
                .iter()
                .enumerate()
                .filter(|(k, o)| !met[*k] && apart(o, d) < o.radius);
            let Some((k, old)) = near.min_by(|a, b| apart(a.1, d).total_cmp(&apart(b.1, d))) else {
                return alone(d.strength / scale.sqrt());
            };
            met[k] = true;
            let strength = BY_STRENGTH * (d.strength / (old.strength * scale.sqrt()) - 1.0);
            let moved = BY_MOVE * apart(old, d) / old.radius;
            let radius = BY_RADIUS * (d.believable().radius / old.believable().radius - 1.0);
            strength.hypot(moved).hypot(radius)
        };
        let error = discs.iter().map(&mut of).fold(0.0, f64::max);
        let gone = self
            .discs
            .iter()
            .zip(met)
            .filter(|(_, met)| !met)
            .map(|(d, _)| alone(d.strength));
        let error = gone.fold(error, f64::max);
        if error.is_finite() { error } else { f64::INFINITY }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::imager::Imager;
    use crate::touches::fit::FitOptions;
    use crate::touches::fit::fitter::Fitter;
    use forward::{Drive, Pattern, Sheet};
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};
    use std::f64::consts::{PI, TAU};
    use std::sync::Arc;

    /// Discs of +20 to +150 %, 28 mm from each other.
    fn scene(count: usize, rng: &mut StdRng) -> Vec<Disc> {
        let mut discs: Vec<Disc> = Vec::new();
        while discs.len() < count {
            let (angle, r) = (rng.random_range(0.0..TAU), 80.0 * rng.random_range(0.0..1.0_f64).sqrt());
            let at = [r * angle.cos(), r * angle.sin()];
            if discs.iter().all(|d| (d.at[0] - at[0]).hypot(d.at[1] - at[1]) > 28.0) {
                let (radius, rise) = (rng.random_range(9.0..15.0), rng.random_range(0.2..1.5));
                let strength = 2.0 * rise / (2.0 + rise) * PI * radius * radius;
                discs.push(Disc { at, radius, strength });
            }
        }
        discs
    }

    /// Strengths that grow together scale it by their square; moves, other strengths and radii make the error that is said: at most
    /// four times that in any scene, and within a factor of 1.6 over all.
    #[test]
    fn it_serves_touches_that_changed_a_little_as_well_as_it_says() {
        let pattern = Pattern::adjacent(16).unwrap();
        let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 5.0).unwrap());
        let fitter = Fitter::new(&imager, FitOptions::for_extent(97.5)).unwrap();
        let mut beyond = Beyond::new(&imager.model, imager.drive, &imager.pattern).unwrap();
        let mut solve = |discs: &[Disc]| Correction::solve(&mut beyond, fitter.volts(), discs).unwrap();
        let norm = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        let off = |carried: &Correction, scale: f64, now: &Correction| {
            let difference: Vec<f64> = carried
                .volts()
                .iter()
                .zip(now.volts())
                .map(|(c, n)| scale * c - n)
                .collect();
            norm(&difference) / norm(now.volts())
        };
        let mut rng = StdRng::seed_from_u64(71);
        let (mut said, mut true_ones) = (Vec::new(), Vec::new());
        // A touch alone leaves so little out that the table's own error is as large.
        for count in [2, 3, 4, 2, 3, 4, 2, 3, 4] {
            let discs = scene(count, &mut rng);
            let carried = solve(&discs);
            assert_eq!((carried.scale(&discs), carried.error(&discs, 1.0)), (1.0, 0.0));
            let stronger: Vec<Disc> = discs
                .iter()
                .map(|d| Disc {
                    strength: 1.1 * d.strength,
                    ..*d
                })
                .collect();
            let scale = carried.scale(&stronger);
            assert!((scale - 1.21).abs() < 1e-12 && carried.error(&stronger, scale) < 1e-12);
            let left = off(&carried, scale, &solve(&stronger));
            assert!(left < 0.05, "{count}: {left}");
            for size in [0.02, 0.06] {
                let mut moved = discs.clone();
                for d in &mut moved {
                    let angle = rng.random_range(0.0..TAU);
                    d.at[0] += size * d.radius * angle.cos();
                    d.at[1] += size * d.radius * angle.sin();
                    d.strength *= 1.0 + size * rng.random_range(-1.0..1.0);
                    d.radius *= 1.0 + size * rng.random_range(-1.0..1.0);
                }
                let scale = carried.scale(&moved);
                let (error, truth) = (carried.error(&moved, scale), off(&carried, scale, &solve(&moved)));
                assert!(truth < 4.0 * error, "{count}, {size}: {truth} {error}");
                said.push(error);
                true_ones.push(truth);
            }
            let fewer = &discs[1..];
            assert!(carried.error(fewer, 1.0) > 0.1);
        }
        let ratio = norm(&true_ones) / norm(&said);
        assert!((0.6..1.6).contains(&ratio), "{said:?} {true_ones:?}");
    }
}
