//! How far each measurement follows the model, told by many frames that no discs explain and of whose touches nobody knows anything.
//!
//! A frame has one touch of unknown strength a at an unknown place p: `y_c = g_c a t_c(p) + e_c`. The gains g and the variances of e follow
//! from all frames by expectation and maximisation (Dempster, Laird and Rubin 1977), with the density of a place as in
//! [`matched_filter`](super::matched_filter). A measurement that does not measure what it says, as one of a twin of reversed drives, then
//! weighs little. On a sheet that the model does not describe at all the places drift to where the gains fit best. So it counts only where
//! two halves of the measurements, each by itself, agree better about the places than without.

use crate::touches::fit::responses::ResponseTable;
use crate::touches::polarity::Polarity;
use forward::{Measurement, Pair};
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use std::collections::BTreeSet;

/// Fewest frames that tell it.
pub(crate) const FEWEST: usize = 20;
/// Most frames that need be asked.
pub(crate) const MOST: usize = 400;
/// Rounds of places, then gains and variances. More let gains follow what places have wrong.
const ROUNDS: usize = 3;
/// Standard deviation of the gains beforehand: that of contacts and amplifiers.
const GAIN_SD: f64 = 0.3;
/// Frames that the variance of all measurements weighs as, in that of one.
const WEIGHT: f64 = 8.0;
/// Values beyond this many root mean squares of their measurement are drawn in.
const LARGEST: f64 = 3.0;
/// Least variance over the mean square of the values.
const LEAST: f64 = 1e-3;
/// Frames with which one is compared that have nothing to do with it.
const OTHERS: usize = 8;
/// Standard errors by which the halves have to agree better.
const SURELY: f64 = 2.0;

/// What values are multiplied with, measurement by measurement, so that all errors are alike; and responses beside them.
#[derive(Clone, Debug)]
pub(crate) struct Trust {
    limits: Vec<f64>,
    of_values: Vec<f64>,
    /// Weighted responses at the coarse places of a table, measurements x places.
    responses: DMatrix<f64>,
    /// The squares of their norms.
    norms: Vec<f64>,
    places_mm: Vec<[f64; 2]>,
    /// Variance of a coordinate within the cell of a place, mm².
    cell_mm2: f64,
}

/// Where the touch of a frame is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    pub(crate) place_mm: [f64; 2],
    /// Variances of the coordinates, mm².
    pub(crate) variances_mm2: [f64; 2],
    /// Logarithm of the evidence for a touch somewhere against none.
    pub(crate) evidence: f64,
}

/// Some measurements of all frames, over their root mean squares.
struct Frames {
    values: DMatrix<f64>,
    responses: DMatrix<f64>,
    polarity: Polarity,
    independent: f64,
}

/// Gains and variances of some measurements, over their root mean squares.
#[derive(Clone)]
struct Told {
    gains: Vec<f64>,
    variances: Vec<f64>,
}

/// Densities of all places for every frame, places x frames, and the strengths there.
struct Posterior {
    density: DMatrix<f64>,
    strengths: DMatrix<f64>,
}

impl Told {
    fn nothing(count: usize) -> Self {
        Self {
            gains: vec![1.0; count],
            variances: vec![1.0; count],
        }
    }
}

fn weighted(matrix: &DMatrix<f64>, by: impl Fn(usize) -> f64) -> DMatrix<f64> {
    let mut out = matrix.clone();
    for (c, mut row) in out.row_iter_mut().enumerate() {
        row *= by(c);
    }
    out
}

/// Squares of the norms of columns.
fn squares(columns: &DMatrix<f64>) -> Vec<f64> {
    columns.column_iter().map(|column| column.norm_squared()).collect()
}

/// Logarithms of the densities of places, from the products of a frame with their responses.
fn log_densities(
    products: impl Iterator<Item = (f64, f64)>,
    square: f64,
    (polarity, independent): (Polarity, f64),
) -> impl Iterator<Item = f64> {
    products.map(move |(product, norm)| {
        let part = if polarity.allows(product) && norm > 0.0 && square > 0.0 {
            (product * product / (norm * square)).min(1.0 - f64::EPSILON)
        } else {
            0.0
        };
        -0.5 * independent * (1.0 - part).ln()
    })
}

impl Frames {
    fn select(&self, rows: &[usize]) -> Self {
        Self {
            values: self.values.select_rows(rows),
            responses: self.responses.select_rows(rows),
            polarity: self.polarity,
            independent: self.independent * rows.len() as f64 / self.values.nrows() as f64,
        }
    }

    fn posterior(&self, told: &Told) -> Posterior {
        let sd = |c: usize| told.variances[c].sqrt();
        let values = weighted(&self.values, |c| sd(c).recip());
        let responses = weighted(&self.responses, |c| told.gains[c] / sd(c));
        let norms = squares(&responses);
        let mut strengths = responses.tr_mul(&values);
        let mut density = strengths.clone();
        for (k, mut column) in density.column_iter_mut().enumerate() {
            let square = values.column(k).norm_squared();
            let products = column.iter().copied().zip(norms.iter().copied());
            let logs: Vec<f64> = log_densities(products, square, (self.polarity, self.independent)).collect();
            let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            column.iter_mut().zip(&logs).for_each(|(d, l)| *d = (l - most).exp());
            column /= column.sum();
        }
        for mut column in strengths.column_iter_mut() {
            column.iter_mut().zip(&norms).for_each(|(s, n)| {
                *s = if *n > 0.0 && self.polarity.allows(*s) {
                    *s / n
                } else {
                    0.0
                };
            });
        }
        Posterior { density, strengths }
    }

    /// Gains and variances by what the places are.
    fn told(&self, posterior: &Posterior, last: &Told) -> Told {
        let count = self.values.ncols() as f64;
        let along = posterior.density.component_mul(&posterior.strengths);
        let squares = along.component_mul(&posterior.strengths).column_sum();
        let expected = &self.responses * along;
        let sums: Vec<[f64; 3]> = (0..self.values.nrows())
            .map(|c| {
                let (values, responses) = (self.values.row(c), self.responses.row(c));
                let response = responses.iter().zip(squares.iter()).map(|(r, s)| r * r * s).sum();
                [response, expected.row(c).dot(&values), values.norm_squared()]
            })
            .collect();
        let over = |k: usize| sums.iter().zip(&last.variances).map(|(s, v)| s[k] / v).sum::<f64>();
        let mean = over(1) / over(0);
        let gains: Vec<f64> = (sums.iter().zip(&last.variances))
            .map(|([square, product, _], variance)| {
                let prior = variance / (GAIN_SD * mean).powi(2);
                (product + prior * mean) / (square + prior)
            })
            .collect();
        let left: Vec<f64> = (sums.iter().zip(&gains))
            .map(|([square, product, whole], g)| (whole - 2.0 * g * product + g * g * square).max(0.0))
            .collect();
        let middle = crate::stats::median(left.iter().map(|v| v / count));
        let variances = left
            .iter()
            .map(|v| ((v + WEIGHT * middle) / (count + WEIGHT)).max(LEAST));
        Told {
            variances: variances.collect(),
            gains,
        }
    }

    fn learned(&self) -> (Told, Posterior) {
        let mut told = Told::nothing(self.values.nrows());
        for _ in 0..ROUNDS {
            told = self.told(&self.posterior(&told), &told);
        }
        let posterior = self.posterior(&told);
        (told, posterior)
    }
}

/// Responses to touches at the coarse places of a table, measurements x places.
fn table_responses(table: &ResponseTable) -> DMatrix<f64> {
    let mut responses = DMatrix::zeros(table.length(), table.coarse().len());
    let mut at: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
    for (place, mut column) in table.coarse().iter().zip(responses.column_iter_mut()) {
        table.at(*place, table.radius_mm(), at.each_mut().map(Vec::as_mut_slice));
        column.copy_from_slice(&at[0][..table.length()]);
    }
    responses
}

/// Logarithms of how far apart two lists of places are, frame by frame, over how far those of different frames are.
fn apart(densities: [&Posterior; 2], places_mm: &[[f64; 2]], step_mm: f64) -> Vec<f64> {
    let best = |p: &Posterior| -> Vec<[f64; 2]> { p.density.column_iter().map(|d| places_mm[d.imax()]).collect() };
    let [first, second] = densities.map(best);
    let count = first.len();
    let log = |a: [f64; 2], b: [f64; 2]| ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + step_mm * step_mm).ln();
    (0..count)
        .map(|k| {
            let others = (1..=OTHERS).map(|o| second[(k + o * count / (OTHERS + 1)) % count]);
            log(first[k], second[k]) - others.map(|b| log(first[k], b)).sum::<f64>() / OTHERS as f64
        })
        .collect()
}

/// Whether some numbers are less than others, in the mean, beyond chance.
fn are_less(these: &[f64], others: &[f64]) -> bool {
    let count = these.len() as f64;
    let differences = || these.iter().zip(others).map(|(a, b)| a - b);
    let mean = differences().sum::<f64>() / count;
    let variance = differences().map(|d| (d - mean).powi(2)).sum::<f64>() / (count * (count - 1.0));
    mean < -SURELY * variance.sqrt()
}

/// Two halves of the measurements that have no sense pair in common.
fn halves(measurements: &[Measurement]) -> [Vec<usize>; 2] {
    let ends = |p: Pair| (p.plus.min(p.minus), p.plus.max(p.minus));
    let pairs: BTreeSet<_> = measurements.iter().map(|m| ends(m.sense)).collect();
    let list: Vec<_> = pairs.into_iter().collect();
    let is_even = |k: &usize| {
        let place = list.binary_search(&ends(measurements[*k].sense));
        place.is_ok_and(|p| p % 2 == 0)
    };
    (0..measurements.len()).partition::<Vec<_>, _>(is_even).into()
}

impl Trust {
    /// What frames (changes, V of the model; 0 where a value is missing) tell. None where they are few, or where halves of the
    /// measurements do not agree better by it. `independent`: values with errors of their own.
    pub(crate) fn of_frames(
        table: &ResponseTable,
        measurements: &[Measurement],
        frames: &[&[f64]],
        (polarity, independent): (Polarity, f64),
    ) -> Option<Self> {
        (frames.len() >= FEWEST && table.length() == measurements.len()).then_some(())?;
        let places_mm = table.coarse().to_vec();
        let responses = table_responses(table);
        let rms = |row: &[f64]| (row.iter().map(|v| v * v).sum::<f64>() / row.len() as f64).sqrt();
        let of_responses: Vec<f64> = (responses.row_iter())
            .map(|r| rms(&r.iter().copied().collect::<Vec<_>>()))
            .collect();
        let of_values: Vec<f64> = (0..table.length())
            .map(|c| {
                let values: Vec<f64> = frames.iter().map(|f| f[c]).collect();
                // Of gross values as much as of usual ones.
                (0..5).fold(rms(&values), |size, _| {
                    let limit = LARGEST * size;
                    rms(&values.iter().map(|v| v.clamp(-limit, limit)).collect::<Vec<_>>())
                })
            })
            .collect();
        let over = |v: f64| if v > 0.0 { v.recip() } else { 0.0 };
        let all = Frames {
            values: DMatrix::from_fn(table.length(), frames.len(), |c, k| {
                (frames[k][c] * over(of_values[c])).clamp(-LARGEST, LARGEST)
            }),
            responses: weighted(&responses, |c| over(of_responses[c])),
            polarity,
            independent,
        };
        let parts = halves(measurements).map(|rows| (!rows.is_empty()).then(|| all.select(&rows)));
        let [Some(first), Some(second)] = parts else {
            return None;
        };
        let by = |posteriors: [Posterior; 2]| apart(posteriors.each_ref(), &places_mm, table.step_mm());
        let without = by([&first, &second].map(|f| f.posterior(&Told::nothing(f.values.nrows()))));
        let with = by([&first, &second].map(|f| f.learned().1));
        are_less(&with, &without).then_some(())?;
        let (told, _) = all.learned();
        let factor = |c: usize| told.variances[c].sqrt().recip();
        let of_model = |c: usize| told.gains[c] * factor(c) * over(of_responses[c]);
        let cell_mm = 2.0 * table.step_mm();
        let responses = weighted(&responses, of_model);
        Some(Self {
            norms: squares(&responses),
            limits: of_values.iter().map(|v| LARGEST * v).collect(),
            responses,
            of_values: of_values
                .iter()
                .enumerate()
                .map(|(c, v)| factor(c) * over(*v))
                .collect(),
            places_mm,
            cell_mm2: cell_mm * cell_mm / 12.0,
        })
    }

    /// Values or responses of the model with their errors alike, those far outside drawn in.
    fn alike(&self, values: &[f64]) -> Vec<f64> {
        let values = values.iter().zip(&self.limits).zip(&self.of_values);
        values.map(|((v, limit), by)| v.clamp(-limit, *limit) * by).collect()
    }

    /// Strength of a touch with a response of the model, by least squares.
    pub(crate) fn strength(&self, change: &[f64], response: &[f64]) -> f64 {
        let values = self.alike(change);
        let (product, square) = (response.iter().zip(&self.of_values))
            .map(|(r, by)| r * by)
            .zip(&values)
            .fold((0.0, 0.0), |(p, s), (r, v)| (p + r * v, s + r * r));
        if square > 0.0 { product / square } else { 0.0 }
    }

    /// Where the touch of a frame is, as the mean over all places: that of least square error.
    pub(crate) fn place(&self, change: &[f64], (polarity, independent): (Polarity, f64)) -> Option<Placed> {
        let frame = DVector::from_vec(self.alike(change));
        let products = self.responses.tr_mul(&frame);
        let products = products.iter().copied().zip(self.norms.iter().copied());
        let logs: Vec<f64> = log_densities(products, frame.norm_squared(), (polarity, independent)).collect();
        let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (most > 0.0).then_some(())?;
        let (mut sum, mut mean, mut square) = (0.0, Vector2::zeros(), Matrix2::zeros());
        for (log, place) in logs.iter().zip(&self.places_mm) {
            let (weight, place) = ((log - most).exp(), Vector2::from(*place));
            sum += weight;
            mean += weight * place;
            square += weight * place * place.transpose();
        }
        mean /= sum;
        let covariance = square / sum - mean * mean.transpose();
        Some(Placed {
            place_mm: mean.into(),
            variances_mm2: [0, 1].map(|k| covariance[(k, k)].max(0.0) + self.cell_mm2),
            evidence: most + (sum / logs.len() as f64).ln(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Drive, Model, ModelOptions, Pattern, Sheet};
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;
    use std::f64::consts::TAU;
    use std::sync::Arc;

    const FRAMES: usize = 60;
    const ASKED: (Polarity, f64) = (Polarity::Either, 32.0);

    /// Frames of one disc each and its place, of which each measurement has a gain, and so many in ten of them nothing but an error.
    fn frames(table: &ResponseTable, wrong: usize, rng: &mut StdRng) -> Vec<([f64; 2], Vec<f64>)> {
        let gains: Vec<f64> = (0..table.length())
            .map(|_| (0.3 * rng.sample::<f64, _>(StandardNormal)).exp())
            .collect();
        let mut at: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
        let places: Vec<[f64; 2]> = (0..FRAMES)
            .map(|_| {
                let (angle, radius) = (rng.random_range(0.0..TAU), 80.0 * rng.random_range(0.0_f64..1.0).sqrt());
                [radius * angle.cos(), radius * angle.sin()]
            })
            .collect();
        let frame = |place: [f64; 2]| {
            table.at(place, 12.5, at.each_mut().map(Vec::as_mut_slice));
            let size = (at[0].iter().map(|v| v * v).sum::<f64>() / table.length() as f64).sqrt();
            let values = (gains.iter().zip(&at[0]).enumerate())
                .map(|(c, (gain, response))| {
                    let error = size * rng.sample::<f64, _>(StandardNormal);
                    if c * 7 % 10 < wrong {
                        2.0 * error
                    } else {
                        gain * response + 0.2 * error
                    }
                })
                .collect();
            (place, values)
        };
        places.into_iter().map(frame).collect()
    }

    /// Where half of the measurements follow the model, places are better than with all of them alike; where none does, or frames are
    /// few, nothing is told.
    #[test]
    fn frames_tell_which_measurements_follow_the_model_unless_none_does() {
        let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap());
        let pattern = Pattern::adjacent(16).unwrap();
        let table = ResponseTable::new(&model, Drive::PAPER, &pattern, 12.5).unwrap();
        let of = |frames: &[([f64; 2], Vec<f64>)]| {
            let values: Vec<&[f64]> = frames.iter().map(|(_, values)| values.as_slice()).collect();
            Trust::of_frames(&table, pattern.measurements(), &values, ASKED)
        };
        let off = |trust: &Trust, frames: &[([f64; 2], Vec<f64>)]| {
            crate::stats::median(frames.iter().map(|([x, y], values)| {
                let place = trust.place(values, ASKED).unwrap().place_mm;
                (place[0] - x).hypot(place[1] - y)
            }))
        };
        for seed in 0..4 {
            let mut rng = StdRng::seed_from_u64(seed);
            let half = frames(&table, 5, &mut rng);
            let trust = of(&half).unwrap();
            let alike = Trust {
                of_values: vec![1.0; table.length()],
                limits: vec![f64::INFINITY; table.length()],
                norms: squares(&table_responses(&table)),
                responses: table_responses(&table),
                ..trust.clone()
            };
            let [with, without] = [&trust, &alike].map(|trust| off(trust, &half));
            assert!(with < 0.6 * without, "seed {seed}: {with} mm, {without} mm");
            assert!(of(&half[..FEWEST - 1]).is_none());
            assert!(of(&frames(&table, 10, &mut rng)).is_none(), "seed {seed}");
        }
    }
}
