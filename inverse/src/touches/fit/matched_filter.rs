//! Touches of a frame that no discs explain, one after another: of each the place where a disc of the expected size takes most of what
//! is left (orthogonal matching pursuit).
//!
//! What the model leaves of such a frame is no noise, but an error of unknown size. With a flat prior over its size and over the
//! strength of the touch, a place where the disc takes the part c² of the frame has the posterior density (1 - c²)^(-n/2) (Student's
//! distribution). n is the number of values whose errors are independent. It says how certain the place is.

use crate::linalg::basis::Basis;
use crate::linalg::vector::{dot, square};
use crate::touches::fit::disc::{Disc, MOST_TOUCHES};
use crate::touches::fit::frame_fit::touch_of;
use crate::touches::fit::responses::ResponseTable;
use crate::touches::polarity::Polarity;
use crate::touches::touch::Touch;
use arrayvec::ArrayVec;
use nalgebra::{DMatrix, DVector};

/// Part of a response that touches found before must leave, as a square: less is one of them.
const LEAST_NEW: f64 = 0.1;
/// Halvings of the nodes' distance in which a place is made finer.
const HALVINGS: usize = 4;

/// A frame in the space of a table, and what lies outside.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Remainder<'a> {
    /// Reduced as the table is.
    pub(crate) reduced: &'a [f64],
    /// Square of its part outside that space, that no touch reaches.
    pub(crate) outside: f64,
}

/// Finds touches, frame after frame.
#[derive(Debug, Default)]
pub(crate) struct MatchedFilter {
    /// What is left of the frame, and its square with what no touch reaches.
    left: Vec<f64>,
    square: f64,
    /// Responses of the touches found, made orthonormal.
    found: Basis,
    /// Squares of the part of every node's response outside of these.
    norms: Vec<f64>,
    /// Room for products with every node's response, and for the logarithms of the densities.
    products: Vec<f64>,
    densities: Vec<f64>,
    /// Room for a response and its derivatives.
    at: [Vec<f64>; 4],
}

impl MatchedFilter {
    /// Logarithm of the evidence for a touch somewhere against none, for a flat prior over the sheet. Chance makes it larger than x in
    /// one of exp(x) frames at most. `independent`: values with errors of their own.
    pub(crate) fn log_evidence(
        &mut self,
        table: &ResponseTable,
        frame: Remainder,
        polarity: Polarity,
        independent: f64,
    ) -> f64 {
        self.begin(table, frame);
        self.weigh(table, polarity, independent)
    }

    /// The strongest touch, and those after it of which noise and errors make one with a probability below `false_touch`.
    /// `independent`: values with errors of their own. Standard deviations hold for that number; there is none of an area. Returns the
    /// part of the frame's square that the touches take.
    pub(crate) fn find(
        &mut self,
        table: &ResponseTable,
        frame: Remainder,
        polarity: Polarity,
        (independent, false_touch): (f64, f64),
        touches: &mut Vec<Touch>,
    ) -> f64 {
        touches.clear();
        self.begin(table, frame);
        let whole = self.square.max(f64::MIN_POSITIVE);
        let mut explained = 0.0;
        let mut discs = ArrayVec::<(Disc, [f64; 3], f64), MOST_TOUCHES>::new();
        let radius = table.radius_mm();
        // A touch of several may explain little before the others are found: the number with most evidence counts.
        let (mut evidence, mut most, mut count) = (0.0, f64::NEG_INFINITY, 0);
        while !discs.is_full() {
            let further = self.weigh(table, polarity, independent);
            if !further.is_finite() {
                break;
            }
            evidence += further + false_touch.ln();
            let Some((at, part)) = self.best(table, radius, polarity) else {
                break;
            };
            let spread = self.spread(table, at);
            self.respond(table, at, radius);
            let before = self.found.columns().len();
            self.found.add(&self.at[0]);
            let Some(new) = self.found.columns().get(before..).filter(|new| !new.is_empty()) else {
                break;
            };
            let along = dot(new, &self.left);
            let strength_sd = ((1.0 - part).max(0.0) / (part * independent)).sqrt();
            self.left.iter_mut().zip(new).for_each(|(v, e)| *v -= along * e);
            self.square -= along * along;
            table.coarse_products(new, &mut self.products);
            for (norm, product) in self.norms.iter_mut().zip(&self.products) {
                *norm -= product * product;
            }
            let disc = Disc {
                at,
                radius,
                strength: 0.0,
            };
            discs.push((disc, [spread[0], spread[1], strength_sd], along));
            if evidence > most {
                (most, count) = (evidence, discs.len());
                explained = 1.0 - self.square / whole;
            }
        }
        discs.truncate(count);
        self.strengths(table, &mut discs);
        touches.extend(
            discs
                .iter()
                .filter(|(disc, ..)| polarity.allows(disc.strength))
                .map(|(disc, [x, y, s], _)| {
                    let place = touch_of(&disc.believable(), 1.0, |i, k| match (i, k) {
                        (0, 0) => Some(*x),
                        (1, 1) => Some(*y),
                        _ => None,
                    });
                    Touch {
                        total_sd_mm2: Some(s * place.total_mm2.abs()),
                        ..place
                    }
                }),
        );
        explained
    }

    fn begin(&mut self, table: &ResponseTable, frame: Remainder) {
        self.left.clear();
        self.left.extend_from_slice(frame.reduced);
        self.left.resize(table.stride(), 0.0);
        self.square = square(&self.left) + frame.outside.max(0.0);
        self.found.clear();
        self.norms.clear();
        self.norms.extend(table.coarse_norms().iter().map(|n| n * n));
    }

    /// Logarithms of the densities of all nodes, 0 where the frame says nothing for a touch, and that of their mean.
    fn weigh(&mut self, table: &ResponseTable, polarity: Polarity, independent: f64) -> f64 {
        table.coarse_products(&self.left, &mut self.products);
        let whole = table.coarse_norms().iter().map(|n| n * n);
        let squares = self.norms.iter().zip(whole).zip(&self.products);
        self.densities.clear();
        self.densities.extend(squares.map(|((left, whole), product)| {
            let part = if polarity.allows(*product) && *left > LEAST_NEW * whole {
                (product * product / (left * self.square)).min(1.0 - f64::EPSILON)
            } else {
                0.0
            };
            -0.5 * independent * (1.0 - part).ln()
        }));
        let largest = self.densities.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = self.densities.iter().map(|d| (d - largest).exp()).sum();
        largest + (sum / self.densities.len() as f64).ln()
    }

    /// The place of the largest density, and the part of the frame that a touch there takes; none where none takes any.
    fn best(&mut self, table: &ResponseTable, radius: f64, polarity: Polarity) -> Option<([f64; 2], f64)> {
        let largest = self.densities.iter().copied().enumerate();
        let (node, _) = largest.filter(|(_, d)| *d > 0.0).max_by(|a, b| a.1.total_cmp(&b.1))?;
        let mut at = *table.coarse().get(node)?;
        let mut most = self.part(table, at, radius, polarity)?;
        let mut step = table.step_mm();
        for _ in 0..HALVINGS {
            let around = [[step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]];
            let places = around.map(|d| [at[0] + d[0], at[1] + d[1]]);
            for place in places {
                if let Some(part) = self.part(table, place, radius, polarity).filter(|part| *part > most) {
                    (at, most) = (place, part);
                }
            }
            step *= 0.5;
        }
        Some((at, most))
    }

    /// Part of what is left that a touch at a place takes; none off the sheet, or where it would be one of those found.
    fn part(&mut self, table: &ResponseTable, at: [f64; 2], radius: f64, polarity: Polarity) -> Option<f64> {
        if !table.holds(at) {
            return None;
        }
        self.respond(table, at, radius);
        let whole = square(&self.at[0]);
        let new = self.found.outside(&mut self.at[0]);
        let along = dot(&self.at[0], &self.left);
        (polarity.allows(along) && new > LEAST_NEW * whole).then(|| (along * along / (new * self.square)).min(1.0))
    }

    fn respond(&mut self, table: &ResponseTable, at: [f64; 2], radius: f64) {
        self.at.iter_mut().for_each(|v| v.resize(table.stride(), 0.0));
        table.at(at, radius, self.at.each_mut().map(Vec::as_mut_slice));
    }

    /// Mean squares of the distance to a place by x and y, over the posterior and within a cell between the nodes.
    fn spread(&self, table: &ResponseTable, at: [f64; 2]) -> [f64; 2] {
        let largest = self.densities.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let cell = 2.0 * table.step_mm();
        let (mut sum, mut squares) = (0.0, [0.0; 2]);
        for (density, node) in self.densities.iter().zip(table.coarse()) {
            let weight = (density - largest).exp();
            sum += weight;
            for (square, (node, at)) in squares.iter_mut().zip(node.iter().zip(at)) {
                *square += weight * (node - at).powi(2);
            }
        }
        squares.map(|square| square / sum + cell * cell / 12.0)
    }

    /// Strengths of the touches together, from the frame's parts along their orthonormal directions.
    fn strengths(&mut self, table: &ResponseTable, discs: &mut [(Disc, [f64; 3], f64)]) {
        let n = discs.len();
        let mut upper = DMatrix::zeros(n, n);
        for (k, (disc, ..)) in discs.iter().enumerate() {
            self.respond(table, disc.at, disc.radius);
            for (j, direction) in self.found.columns().chunks_exact(table.stride()).take(n).enumerate() {
                upper[(j, k)] = dot(direction, &self.at[0]);
            }
        }
        let along = DVector::from_iterator(n, discs.iter().map(|d| d.2));
        if let Some(strengths) = upper.solve_upper_triangular(&along) {
            discs
                .iter_mut()
                .zip(strengths.iter())
                .for_each(|(d, s)| d.0.strength = *s);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Drive, Model, ModelOptions, Pattern, Sheet};
    use rand::{Rng, SeedableRng, rngs::StdRng};
    use rand_distr::StandardNormal;
    use std::f64::consts::PI;
    use std::sync::Arc;

    const INDEPENDENT: f64 = 32.0;
    /// Part of a frame that no touch reaches.
    const ERROR: f64 = 0.1;
    const STRENGTH: f64 = 0.02 * PI * 12.5 * 12.5;

    fn table() -> ResponseTable {
        let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap());
        ResponseTable::new(&model, Drive::PAPER, &Pattern::adjacent(16).unwrap(), 12.5).unwrap()
    }

    fn frame(table: &ResponseTable, places: &[([f64; 2], f64)]) -> Vec<f64> {
        let mut frame = vec![0.0; table.length()];
        for (at, strength) in places {
            let mut values: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
            table.at(*at, 12.5, values.each_mut().map(Vec::as_mut_slice));
            frame.iter_mut().zip(&values[0]).for_each(|(f, v)| *f += strength * v);
        }
        frame
    }

    fn find(table: &ResponseTable, frame: &[f64], outside: f64, polarity: Polarity) -> (Vec<Touch>, f64) {
        let mut touches = Vec::new();
        let remainder = Remainder {
            reduced: frame,
            outside,
        };
        let chance = (INDEPENDENT, 1e-3);
        let explained = MatchedFilter::default().find(table, remainder, polarity, chance, &mut touches);
        (touches, explained)
    }

    /// Discs beside an error that no touch reaches.
    fn seen(table: &ResponseTable, places: &[([f64; 2], f64)]) -> (Vec<Touch>, f64) {
        let frame = frame(table, places);
        find(table, &frame, square(&frame) * ERROR / (1.0 - ERROR), Polarity::Either)
    }

    #[test]
    fn an_exact_disc_is_found_with_its_strength() {
        let table = table();
        let (touches, explained) = seen(&table, &[([31.3, -12.1], STRENGTH)]);
        let [touch] = touches.as_slice() else {
            panic!("{touches:?}")
        };
        let off = (touch.x_mm - 31.3).hypot(touch.y_mm + 12.1);
        assert!(
            (explained / (1.0 - ERROR) - 1.0).abs() < 1e-3 && off < 0.5,
            "{off} mm: {explained}"
        );
        assert!((touch.total_mm2 / STRENGTH - 1.0).abs() < 0.02, "{touch:?} {STRENGTH}");
    }

    /// The first is found before the second is known: both are right within what is said of them.
    #[test]
    fn two_discs_of_either_sign_are_found_within_their_uncertainties() {
        let table = table();
        let places = [([-40.2, 20.6], STRENGTH), ([35.5, 8.3], -0.6 * STRENGTH)];
        let (touches, explained) = seen(&table, &places);
        assert!(
            (explained / (1.0 - ERROR) - 1.0).abs() < 0.02 && touches.len() == 2,
            "{touches:?}"
        );
        for ((at, strength), touch) in places.iter().zip(&touches) {
            let within = |value: f64, truth: f64, sd: Option<f64>| (value - truth).abs() < 2.0 * sd.unwrap();
            assert!(within(touch.x_mm, at[0], touch.x_sd_mm), "{touch:?}");
            assert!(within(touch.y_mm, at[1], touch.y_sd_mm), "{touch:?}");
            assert!(
                within(touch.total_mm2, *strength, touch.total_sd_mm2),
                "{touch:?} {strength}"
            );
        }
    }

    /// What no touch reaches is error as well: it makes the place less certain, and takes its part of the frame.
    #[test]
    fn what_no_touch_reaches_makes_the_place_less_certain() {
        let table = table();
        let frame = frame(&table, &[([31.3, -12.1], STRENGTH)]);
        let all = square(&frame);
        let mut sds = Vec::new();
        for part in [0.1, 0.5, 0.8] {
            let (touches, explained) = find(&table, &frame, all * part / (1.0 - part), Polarity::Up);
            assert!((explained / (1.0 - part) - 1.0).abs() < 0.01, "{explained}");
            sds.push(touches[0].x_sd_mm.unwrap());
        }
        assert!(sds.is_sorted() && sds[2] > 2.0 * sds[0], "{sds:?}");
    }

    #[test]
    fn a_touch_of_a_sign_that_is_not_allowed_is_none() {
        let table = table();
        let frame = frame(&table, &[([31.3, -12.1], -STRENGTH)]);
        let (down, _) = find(&table, &frame, 0.0, Polarity::Down);
        assert!(down[0].rise < 0.0);
        let (up, _) = find(&table, &frame, 0.0, Polarity::Up);
        assert!(up.iter().all(|touch| touch.rise > 0.0), "{up:?}");
    }

    /// Of white noise the evidence is larger than x in one of exp(x) frames at most.
    #[test]
    fn noise_is_rarely_evidence() {
        let table = table();
        let mut rng = StdRng::seed_from_u64(5);
        let mut filter = MatchedFilter::default();
        let mut evidence: Vec<f64> = (0..2_000)
            .map(|_| {
                let noise: Vec<f64> = (0..table.length()).map(|_| rng.sample(StandardNormal)).collect();
                let frame = Remainder {
                    reduced: &noise,
                    outside: 0.0,
                };
                filter.log_evidence(&table, frame, Polarity::Either, noise.len() as f64)
            })
            .collect();
        evidence.sort_by(|a, b| b.total_cmp(a));
        for one_of in [10, 100, 1000] {
            assert!(
                evidence[2_000 / one_of] < (one_of as f64).ln(),
                "{}",
                evidence[2_000 / one_of]
            );
        }
    }
}
