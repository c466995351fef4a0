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
/// Largest part of the values that is wild: more are not single ones.
const MOST_WILD: f64 = 0.1;
/// A value that is out.
struct Out {
    value: usize,
    /// A change of values that are out by which no residual of the others changes what it says, and its product with the precision.
    direction: DVector<f64>,
    product: DVector<f64>,
}

/// The values of a frame that are out.
pub(super) struct Outliers<'a> {
    precision: &'a DMatrix<f64>,
    /// Of every value, given the others that are in; 0 of those that are out.
    own: DVector<f64>,
    out: Vec<Out>,
    /// How many of these are missing, and the precisions without them.
    missing: usize,
    without_missing: DVector<f64>,
}

impl<'a> Outliers<'a> {
    /// With those that are missing.
    pub(super) fn new(precision: &'a DMatrix<f64>, missing: &[usize]) -> Self {
        let mut new = Self {
            precision,
            own: precision.diagonal(),
            out: Vec::new(),
            missing: missing.len(),
            without_missing: DVector::zeros(0),
        };
        missing.iter().for_each(|value| new.take_out(*value));
        new.without_missing = new.own.clone();
        new
    }

    fn take_out(&mut self, value: usize) {
        let mut direction = DVector::zeros(self.own.len());
        direction[value] = 1.0;
        let mut product = self.precision.column(value).into_owned();
        for before in &self.out {
            let part = before.product[value] / before.product[before.value];
            direction.axpy(-part, &before.direction, 1.0);
            product.axpy(-part, &before.product, 1.0);
        }
        let pivot = product[value];
        self.own.zip_apply(&product, |own, p| *own -= p * p / pivot);
        self.own[value] = 0.0;
        self.out.push(Out {
            value,
            direction,
            product,
        });
    }

    /// Residuals in which what is missing or wild has the value that the others tell. They have so many variances of the rest.
    pub(super) fn replaced(&mut self, mut left: DVector<f64>, variance: f64) -> DVector<f64> {
        self.out.truncate(self.missing);
        self.own.copy_from(&self.without_missing);
        let mut pull = self.precision * &left;
        for out in &self.out {
            out.apply(&mut left, &mut pull);
        }
        let inside = |own: &DVector<f64>| -> Vec<usize> { (0..own.len()).filter(|c| own[*c] > 0.0).collect() };
        let square = |pull: &DVector<f64>, own: &DVector<f64>, c: usize| pull[c] * pull[c] / own[c];
        let far = FAR * FAR * variance;
        for _ in 0..(MOST_WILD * left.len() as f64) as usize {
            let squares = inside(&self.own).into_iter().map(|c| (c, square(&pull, &self.own, c)));
            let Some((value, _)) = squares.filter(|s| s.1 > far).max_by(|a, b| a.1.total_cmp(&b.1)) else {
                break;
            };
            self.take_out(value);
            if let Some(out) = self.out.last() {
                out.apply(&mut left, &mut pull);
            }
        }
        left
    }
}

impl Out {
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
            let whole = Outliers::new(&precision, &missing).replaced(sample.clone(), 1.0);
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
            let mut outliers = Outliers::new(&precision, &[]);
            assert_eq!(outliers.replaced(sample.clone(), 1.0), sample);
            let mut wild = sample.clone();
            wild[7] += 2.0;
            wild[23] -= 2.0;
            wild[24] -= 2.0;
            let back = outliers.replaced(wild, 1.0);
            let off = (&back - &sample).amax();
            assert!(off < 0.8, "{off}");
            assert_eq!((0..60).filter(|c| back[*c] != sample[*c]).count(), 3);
        }
    }
}
