//! What is drawn.

use super::file::TouchTable;
use forward::{DiscTouch, Geometry};
use rand::Rng;
use rand::rngs::StdRng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

/// Where a number comes from: `0.5`, `{ uniform = [a, b] }`, `{ log_uniform = [a, b] }` or `{ normal = [mean, deviation] }`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "a number, { uniform = [low, high] }, { log_uniform = [low, high] } or { normal = [mean, deviation] }"
)]
pub enum Distribution {
    /// Always this number.
    Fixed(f64),
    /// One of the others.
    Drawn(Drawn),
}

/// A distribution with a width.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Drawn {
    /// Evenly from the first number to the second.
    Uniform([f64; 2]),
    /// Evenly in the logarithm, from the first number to the second; both above 0.
    LogUniform([f64; 2]),
    /// A normal distribution of this mean and standard deviation.
    Normal([f64; 2]),
}

impl Distribution {
    /// Draws a number.
    pub fn draw(&self, rng: &mut StdRng) -> f64 {
        match *self {
            Self::Fixed(value) => value,
            Self::Drawn(Drawn::Uniform([low, high])) => low + (high - low) * rng.random::<f64>(),
            Self::Drawn(Drawn::LogUniform([low, high])) => low * (high / low).powf(rng.random::<f64>()),
            Self::Drawn(Drawn::Normal([mean, deviation])) => mean + deviation * rng.sample::<f64, _>(StandardNormal),
        }
    }

    /// What is wrong with it, if anything: numbers that are none, or ends of which the first is the larger.
    pub(super) fn wrong(&self) -> Option<String> {
        let (numbers, text) = match *self {
            Self::Fixed(value) => ([value, value], None),
            Self::Drawn(Drawn::Uniform(ends)) => {
                let wrong = ends[0] > ends[1];
                (
                    ends,
                    wrong.then_some("the first end is above the second one; exchange them"),
                )
            }
            Self::Drawn(Drawn::LogUniform(ends)) => {
                let wrong = ends[0] > ends[1] || ends[0] <= 0.0;
                (
                    ends,
                    wrong.then_some("give two ends above 0, the smaller one first, to log_uniform"),
                )
            }
            Self::Drawn(Drawn::Normal(of)) => (of, (of[1] < 0.0).then_some("the deviation is below 0; give 0 or more")),
        };
        if !numbers.iter().all(|v| v.is_finite()) {
            return Some("a number is not finite; give a finite one".to_owned());
        }
        text.map(str::to_owned)
    }

    /// The least number that it can give, or minus infinity.
    pub(super) fn least(&self) -> f64 {
        match *self {
            Self::Fixed(value) => value,
            Self::Drawn(Drawn::Uniform([low, _]) | Drawn::LogUniform([low, _])) => low,
            Self::Drawn(Drawn::Normal([mean, 0.0])) => mean,
            Self::Drawn(Drawn::Normal(_)) => f64::NEG_INFINITY,
        }
    }
}

/// A place in a list of weights, each as often as its weight.
pub(super) fn weighted(weights: &[f64], rng: &mut StdRng) -> usize {
    let mut left = rng.random::<f64>() * weights.iter().sum::<f64>();
    for (k, weight) in weights.iter().enumerate() {
        if left < *weight {
            return k;
        }
        left -= weight;
    }
    weights.iter().rposition(|weight| *weight > 0.0).unwrap_or(0)
}

/// Tries to find a place for one disc, and for all of them. Fewer give up sheets that are merely full; more take longer to say so.
const TRIES: usize = 200;

/// So many discs, each evenly over where it has room.
pub(super) fn places(
    geometry: &Geometry,
    count: usize,
    table: &TouchTable,
    rng: &mut StdRng,
) -> Option<Vec<DiscTouch>> {
    let ([left, bottom], [right, top]) = geometry.bounding_box();
    for _ in 0..TRIES {
        let mut out: Vec<DiscTouch> = Vec::with_capacity(count);
        while out.len() < count {
            let (radius_mm, rise) = (table.radius_mm.draw(rng), table.rise.draw(rng));
            let found = (0..TRIES).find_map(|_| {
                let centre_mm = [
                    left + (right - left) * rng.random::<f64>(),
                    bottom + (top - bottom) * rng.random::<f64>(),
                ];
                let clear = |other: &DiscTouch| {
                    let apart = (centre_mm[0] - other.centre_mm[0]).hypot(centre_mm[1] - other.centre_mm[1]);
                    apart > radius_mm + other.radius_mm + table.apart_mm
                };
                let room = geometry.is_clear(centre_mm, radius_mm + table.rim_mm);
                (room && out.iter().all(clear)).then_some(DiscTouch {
                    centre_mm,
                    radius_mm,
                    rise,
                })
            });
            match found {
                Some(touch) => out.push(touch),
                None => break,
            }
        }
        if out.len() == count {
            return Some(out);
        }
    }
    None
}
