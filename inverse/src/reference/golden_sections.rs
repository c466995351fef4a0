//! The least value of a function of one number.

/// The least value of a function near a start (where, value), by so many golden sections of an interval.
pub(super) fn least(
    of: impl Fn(f64) -> f64,
    start: (f64, f64),
    [mut low, mut high]: [f64; 2],
    sections: usize,
) -> (f64, f64) {
    let part = 0.5 * (5.0_f64.sqrt() - 1.0);
    let mut best = start;
    for _ in 0..sections {
        let [a, b] = [high - part * (high - low), low + part * (high - low)];
        let [of_a, of_b] = [of(a), of(b)];
        for (at, value) in [(a, of_a), (b, of_b)] {
            if value < best.1 {
                best = (at, value);
            }
        }
        if of_a < of_b {
            high = b;
        } else {
            low = a;
        }
    }
    best
}
