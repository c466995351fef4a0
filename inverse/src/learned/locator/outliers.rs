//! Values of a frame that the others do not tell: wild ones, and those that are missing.
//!
//! What presses leave over is correlated. So a value is judged by what the others tell of it, not by its own variance. With the
//! precision P of the residuals r, value c is `(P r)_c / P_cc` beside what the others tell, with the variance `1 / P_cc` (Rasmussen and
//! Williams 2006, section 5.4.2). Without some values the precision is the Schur complement of theirs. So values are taken out one
//! after another as the pivots of a Cholesky factorisation, the most improbable one first. One that is out gets the value that the
//! others tell: so it says nothing.

use nalgebra::{DMatrix, DVector};

/// A value this many standard deviations from what the others tell is wild.
const FAR: f64 = 8.0;
/// Largest part of the values that is wild, and how many at most: more are not single ones.
const MOST_WILD: f64 = 0.1;
const MOST_COUNT: usize = 32;

/// A value that is out.
struct Out {
    value: usize,
    /// A change of this value, and of those that were out before, whose product with the precision is 0 at those before; and that product.
    direction: DVector<f64>,
    product: DVector<f64>,
}

/// Values that are missing in frame after frame.
pub(super) struct Missing {
    values: Vec<usize>,
    /// Precision of every value, given the others that are there; 0 of those that are missing.
    own: DVector<f64>,
    out: Vec<Out>,
}

impl Missing {
    pub(super) fn new(precision: &DMatrix<f64>, values: &[usize]) -> Self {
        let (mut own, mut out) = (precision.diagonal(), Vec::new());
        for value in values {
            let more = Out::new(precision, *value, out.iter(), &mut own);
            out.extend(more);
        }
        Self {
            values: values.to_vec(),
            own,
            out,
        }
    }

    pub(super) fn values(&self) -> &[usize] {
        &self.values
    }

    /// Residuals in which what is missing or wild has the value that the others tell, and which are wild. They have so many variances of
    /// the rest, of which this is the precision.
    pub(super) fn replaced(
        &self,
        precision: &DMatrix<f64>,
        mut left: DVector<f64>,
        variance: f64,
    ) -> (DVector<f64>, Vec<usize>) {
        let mut pull = precision * &left;
        self.out.iter().for_each(|out| out.apply(&mut left, &mut pull));
        let far = FAR * FAR * variance;
        let (mut own, mut wild) = (self.own.clone(), Vec::<Out>::new());
        for _ in 0..((MOST_WILD * left.len() as f64) as usize).min(MOST_COUNT) {
            let squares = (0..own.len()).filter(|c| own[*c] > 0.0);
            let squares = squares.map(|c| (c, pull[c] * pull[c] / own[c])).filter(|s| s.1 > far);
            let Some((value, _)) = squares.max_by(|a, b| a.1.total_cmp(&b.1)) else {
                break;
            };
            if let Some(out) = Out::new(precision, value, self.out.iter().chain(&wild), &mut own) {
                out.apply(&mut left, &mut pull);
                wild.push(out);
            }
        }
        (left, wild.iter().map(|out| out.value).collect())
    }
}

impl Out {
    /// One more beside those before. None where these tell it already.
    fn new<'a>(
        precision: &DMatrix<f64>,
        value: usize,
        before: impl Iterator<Item = &'a Self>,
        own: &mut DVector<f64>,
    ) -> Option<Self> {
        let mut direction = DVector::zeros(own.len());
        direction[value] = 1.0;
        let mut product = precision.column(value).into_owned();
        for out in before {
            let part = out.product[value] / out.product[out.value];
            direction.axpy(-part, &out.direction, 1.0);
            product.axpy(-part, &out.product, 1.0);
        }
        let pivot = product[value];
        own[value] = 0.0;
        if pivot.is_nan() || pivot <= 0.0 {
            return None;
        }
        own.zip_apply(&product, |own, p| *own -= p * p / pivot);
        own[value] = 0.0;
        Some(Self {
            value,
            direction,
            product,
        })
    }

    fn apply(&self, left: &mut DVector<f64>, pull: &mut DVector<f64>) {
        let part = pull[self.value] / self.product[self.value];
        left.axpy(-part, &self.direction, 1.0);
        pull.axpy(-part, &self.product, 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Cholesky;
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    /// A covariance of few directions and a little of each value's own, and a sample of it.
    fn rest(values: usize, random: &mut StdRng) -> (DMatrix<f64>, DVector<f64>) {
        let mut normal = || random.sample::<f64, _>(StandardNormal);
        let directions = DMatrix::from_fn(values, 6, |_, _| normal());
        let covariance = &directions * directions.transpose() + DMatrix::identity(values, values) * 0.01;
        let sample =
            &directions * DVector::from_fn(6, |_, _| normal()) + DVector::from_fn(values, |_, _| 0.1 * normal());
        (covariance, sample)
    }

    /// The square of a frame without some values is that by the covariance of the others alone.
    #[test]
    fn what_is_missing_says_nothing() {
        let mut random = StdRng::seed_from_u64(4);
        let (covariance, mut sample) = rest(40, &mut random);
        let precision = covariance.clone().try_inverse().unwrap();
        let missing = [3, 4, 17, 30];
        let others: Vec<usize> = (0..40).filter(|c| !missing.contains(c)).collect();
        let small = covariance.select_rows(&others).select_columns(&others);
        let alone = sample.select_rows(&others);
        let expected = alone.dot(&Cholesky::new(small).unwrap().solve(&alone));
        for wrong in [0.0, 5.0] {
            missing.iter().for_each(|c| sample[*c] = wrong);
            let (whole, wild) = Missing::new(&precision, &missing).replaced(&precision, sample.clone(), 1.0);
            assert_eq!(wild, [0; 0]);
            let square = whole.dot(&(&precision * &whole));
            assert!((square / expected - 1.0).abs() < 1e-6, "{square} {expected}");
            assert!(others.iter().all(|c| whole[*c] == sample[*c]));
        }
    }

    /// Wild values that are smaller than what the residuals themselves are, by what the others tell of them.
    #[test]
    fn wild_values_are_found_by_the_others() {
        let mut random = StdRng::seed_from_u64(5);
        for _ in 0..50 {
            let (covariance, sample) = rest(60, &mut random);
            let precision = covariance.try_inverse().unwrap();
            let none = Missing::new(&precision, &[]);
            assert_eq!(none.replaced(&precision, sample.clone(), 1.0).0, sample);
            let mut wild = sample.clone();
            wild[7] += 2.0;
            wild[23] -= 2.0;
            wild[24] -= 2.0;
            let (back, mut found) = none.replaced(&precision, wild, 1.0);
            let off = (&back - &sample).amax();
            assert!(off < 0.8, "{off}");
            found.sort_unstable();
            assert_eq!(found, [7, 23, 24]);
        }
    }
}
