//! Products and norms of plain slices.
//!
//! Functions differ in the order of summation alone, and therefore in the last digits. A caller that changes from one
//! to another changes its figures.

use crate::linalg::kernels::LANES;

/// Scalar product, summed from the first entry to the last. The shorter slice decides the length.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Squared Euclidean norm, summed from the first entry to the last.
pub(crate) fn square(v: &[f64]) -> f64 {
    dot(v, v)
}

/// Euclidean norm, summed from the first entry to the last.
pub(crate) fn norm(v: &[f64]) -> f64 {
    square(v).sqrt()
}

/// Scalar product of slices whose length is a multiple of [`LANES`]. The sums of the lanes are added from the first to
/// the last.
#[inline(always)]
pub(crate) fn dot_of_lanes(a: &[f64], b: &[f64]) -> f64 {
    lanes(a, b).iter().sum()
}

/// As [`dot_of_lanes`], with the sums of the lanes added by halves. This order waits for the fewest sums.
#[inline(always)]
pub(crate) fn dot_by_halves(a: &[f64], b: &[f64]) -> f64 {
    let sums = lanes(a, b);
    let fours: [f64; 4] = std::array::from_fn(|k| sums[k] + sums[k + 4]);
    (fours[0] + fours[2]) + (fours[1] + fours[3])
}

/// A sum for every lane, so that the compiler can use the vector unit.
#[inline(always)]
fn lanes(a: &[f64], b: &[f64]) -> [f64; LANES] {
    let mut sums = [0.0; LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        for k in 0..LANES {
            sums[k] += a[k] * b[k];
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whole numbers are summed without rounding, in whatever order.
    #[test]
    fn all_orders_give_the_same_product() {
        let a: Vec<f64> = (0..24).map(f64::from).collect();
        let b: Vec<f64> = (0..24).map(|k| f64::from(7 - k)).collect();
        let expected = f64::from((0..24).map(|k| k * (7 - k)).sum::<i32>());
        assert_eq!(dot(&a, &b), expected);
        assert_eq!(dot_of_lanes(&a, &b), expected);
        assert_eq!(dot_by_halves(&a, &b), expected);
        assert_eq!(square(&[3.0, 4.0]), 25.0);
        assert_eq!(norm(&[3.0, 4.0]), 5.0);
    }
}
