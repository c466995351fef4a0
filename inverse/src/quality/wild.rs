//! Wild values of a frame whose pattern has no reciprocal pairs.
//!
//! Reciprocity cannot tell them there (see [`faults`](crate::quality::faults)). But touches reach a part of the directions of a frame
//! only: there are twins, pairs that are driven both ways, and directions in which touches are far below the noise. What lies outside
//! of the directions that touches and drift reach is noise, unless a value is wild. The values are tested as pairs are by
//! reciprocity: the worst are taken out one after another, up to the last that stands out of the rest (the generalised test of
//! extreme deviates; Rosner, Technometrics 25, 1983), each with what the others leave free of it (Cook and Weisberg 1982).

use crate::quality::faults::{APART, MOST_WILD, limit};
use crate::quality::reciprocity::LEAST_FREEDOM;
use nalgebra::DMatrix;

/// A value of which less than this part (of its variance) lies outside of what touches reach is not tested: the others tell nothing of
/// it, and what is left is rounding and the error of the linear model.
const LEAST_FREE: f64 = 0.01;

/// The projection onto the directions that neither touches nor drift reach, for one set of values. Immutable.
#[derive(Clone, Debug)]
pub(crate) struct Unreached {
    /// `values x values`; 0 for those that take no part.
    projection: DMatrix<f64>,
    freedom: usize,
}

impl Unreached {
    /// What is outside of the span of orthonormal vectors, which are 0 where a value takes no part.
    pub(crate) fn outside<'a>(used: &[bool], reached: impl Iterator<Item = &'a [f64]>) -> Self {
        let of_used = |k: usize| if used[k] { 1.0 } else { 0.0 };
        let mut freedom = used.iter().filter(|used| **used).count();
        let mut projection = DMatrix::from_fn(used.len(), used.len(), |i, k| if i == k { of_used(k) } else { 0.0 });
        for vector in reached {
            let vector = nalgebra::DVectorView::from_slice(vector, vector.len());
            projection.ger(-1.0, &vector, &vector, 1.0);
            freedom = freedom.saturating_sub(1);
        }
        Self { projection, freedom }
    }

    /// Values of a frame (over their noise, all alike) that have nothing to do with the others, by this probability of a false alarm
    /// in a frame. A quarter of them at most.
    pub(crate) fn wild(&self, values: &[f64], false_alarm: f64) -> Vec<usize> {
        let count = values.len();
        let mut projection = self.projection.clone();
        let mut left = &projection * nalgebra::DVectorView::from_slice(values, count);
        let free: Vec<usize> = (0..count).filter(|k| projection[(*k, *k)] > LEAST_FREE).collect();
        // What a value alone makes of the square, and the square.
        let of = |left: &[f64], projection: &DMatrix<f64>, k: usize| {
            let share = projection[(k, k)];
            if share > LEAST_FREE {
                left[k] * left[k] / share
            } else {
                0.0
            }
        };
        let (mut square, mut freedom) = (left.norm_squared(), self.freedom);
        let (mut taken, mut wild) = (Vec::new(), 0);
        while taken.len() < free.len() / MOST_WILD && freedom > LEAST_FREEDOM {
            let squares = free.iter().map(|k| (*k, of(left.as_slice(), &projection, *k)));
            let Some((worst, gone)) = squares.max_by(|a, b| a.1.total_cmp(&b.1)) else {
                break;
            };
            let column = projection.column(worst).into_owned();
            let share = column[worst];
            if share <= LEAST_FREE || gone <= 0.0 {
                break;
            }
            left.axpy(-left[worst] / share, &column, 1.0);
            projection.ger(-1.0 / share, &column, &column, 1.0);
            taken.push(worst);
            (square, freedom) = ((square - gone).max(0.0), freedom - 1);
            let next = free.iter().map(|k| of(left.as_slice(), &projection, *k));
            let next = next.fold(0.0, f64::max);
            let beyond_chance = gone * freedom as f64 > square * limit(1, freedom, free.len(), false_alarm);
            if beyond_chance && gone > APART * APART * next {
                wild = taken.len();
            }
        }
        taken.truncate(wild);
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    const VALUES: usize = 120;
    const REACHED: usize = 70;

    /// Random orthonormal directions that touches reach, one value that takes no part, and what is outside.
    fn sheet(rng: &mut StdRng) -> (DMatrix<f64>, Unreached) {
        let mut random = DMatrix::from_fn(VALUES, REACHED, |_, _| rng.sample::<f64, _>(StandardNormal));
        random.row_mut(7).fill(0.0);
        let reached = random.qr().q();
        let used: Vec<bool> = (0..VALUES).map(|k| k != 7).collect();
        let unreached = Unreached::outside(&used, reached.as_slice().chunks(VALUES));
        (reached, unreached)
    }

    /// Values beside any change that touches make, of noise 1.
    fn frame(reached: &DMatrix<f64>, rng: &mut StdRng) -> Vec<f64> {
        let strength = 10f64.powf(rng.random_range(-1.0..4.0));
        let sizes = nalgebra::DVector::from_fn(REACHED, |_, _| strength * rng.sample::<f64, _>(StandardNormal));
        let mut values: Vec<f64> = (reached * sizes).iter().copied().collect();
        for (k, value) in values.iter_mut().enumerate() {
            *value += if k == 7 {
                0.0
            } else {
                rng.sample::<f64, _>(StandardNormal)
            };
        }
        values
    }

    /// However strong touches are, exactly the wild values are found, and none where there are none.
    #[test]
    fn wild_values_are_found_beside_any_touches() {
        let mut rng = StdRng::seed_from_u64(5);
        let (reached, unreached) = sheet(&mut rng);
        for k in 0..200 {
            let mut values = frame(&reached, &mut rng);
            let mut wild: Vec<usize> = rand::seq::index::sample(&mut rng, VALUES, k % 6).into_vec();
            wild.retain(|k| *k != 7);
            for place in &wild {
                let sign = if rng.random() { 1.0 } else { -1.0 };
                values[*place] += sign * rng.random_range(60.0..1e5);
            }
            let mut found = unreached.wild(&values, 1e-6);
            found.sort_unstable();
            wild.sort_unstable();
            // A value may hide behind those that are a thousand times as wild.
            assert!(found.iter().all(|k| wild.contains(k)), "{wild:?} {found:?}");
            if wild.len() <= 1 {
                assert_eq!(found, wild);
            }
        }
    }

    /// In a thousand frames of noise no value is wild, at one false alarm in a million.
    #[test]
    fn noise_is_not_wild() {
        let mut rng = StdRng::seed_from_u64(6);
        let (reached, unreached) = sheet(&mut rng);
        for _ in 0..1000 {
            assert_eq!(unreached.wild(&frame(&reached, &mut rng), 1e-6), [0usize; 0]);
        }
    }

    /// What all values share with touches alone says nothing: no value is tested.
    #[test]
    fn a_frame_that_touches_reach_whole_tells_nothing() {
        let identity = DMatrix::<f64>::identity(20, 20);
        let unreached = Unreached::outside(&[true; 20], identity.as_slice().chunks(20));
        assert_eq!(unreached.wild(&[1e3; 20], 1e-6), [0usize; 0]);
    }
}
