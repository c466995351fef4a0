//! What touches and drift do to frames, as few columns.

use crate::linalg::pivoted::Pivoted;
use nalgebra::DMatrix;

/// Variance of a value that may be left over, of that of its own noise.
const LEFT: f64 = 1e-4;
/// The same over the largest variance of the touches: less is rounding.
const ROUNDING: f64 = 1e-13;

/// A covariance `U U'`: columns for what touches do, the most important first, and columns for what drifts.
pub(crate) struct Covariance {
    rises: Pivoted,
    drifts: DMatrix<f64>,
}

impl Covariance {
    /// `rises`: what every cell changes by one standard deviation, V, a column each; many more than a frame tells apart.
    pub(crate) fn new(rises: DMatrix<f64>, drifts: DMatrix<f64>) -> Self {
        Self {
            rises: Pivoted::new(rises),
            drifts,
        }
    }

    /// The columns, with the rises `scale` times as large, as far as they show beside this standard deviation of a value's own noise.
    /// Those of many values take seconds, and few of them show: no more are made.
    pub(crate) fn columns(&mut self, scale: f64, own: f64) -> DMatrix<f64> {
        let least = ROUNDING * self.rises.largest();
        let rises = self.rises.until((LEFT * own * own / (scale * scale)).max(least));
        let count = rises.ncols();
        let mut out = DMatrix::zeros(rises.nrows(), count + self.drifts.ncols());
        out.columns_mut(0, count).copy_from(&(rises * scale));
        out.columns_mut(count, self.drifts.ncols()).copy_from(&self.drifts);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Few columns have the covariance of many, up to what own noise hides, and fewer where that hides more.
    #[test]
    fn few_columns_have_the_covariance_of_many() {
        let n = 24;
        let smooth = |k: usize, c: usize| (-(k as f64 / 4.0 - c as f64 / 10.0).powi(2)).exp();
        let rises = DMatrix::from_fn(n, 60, smooth);
        let drifts = DMatrix::from_element(n, 1, 0.3);
        let whole = |scale: f64| scale * scale * &rises * rises.transpose() + &drifts * drifts.transpose();
        let mut covariance = Covariance::new(rises.clone(), drifts.clone());
        let mut before = usize::MAX;
        for own in [1e-3, 1e-2, 0.1] {
            for scale in [1.0, 5.0] {
                let u = covariance.columns(scale, own);
                let off = (&u * u.transpose() - whole(scale)).amax();
                assert!(off <= LEFT * own * own * 1.001 + 1e-12, "{own} {scale}: {off}");
            }
            let count = covariance.columns(1.0, own).ncols();
            assert!(count < before && count <= n, "{count}");
            before = count;
        }
    }
}
