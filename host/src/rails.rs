//! Values of a table that stand at the rail of a converter, or are another program's mark of a missing value: the largest or the smallest
//! one, again and again to the last digit. Live frames need no such guess: the board says which values were out of range.

use crate::files::measurements::MeasurementTable;

/// A value is a rail where it stands so many times as often as any other between the smallest and the largest. On an ideal sheet
/// values that symmetry makes equal are as many at every distance.
const TIMES: usize = 4;
/// Fewest different values between these: a converter with fewer steps has many values at each.
const FEWEST: usize = 32;

/// Takes the values at rails out of a table; says how many and at which value, or nothing where there are none.
pub(crate) fn leave_out(table: &mut MeasurementTable) -> Option<String> {
    let values = || table.columns.iter().flat_map(|c| c.values.iter().copied());
    let rails = rails(values().filter(|v| v.is_finite()).collect());
    let of = |rail: f64| values().filter(|v| *v == rail).count();
    let told: Vec<String> = rails
        .iter()
        .map(|rail| format!("{} values are {}", of(*rail), rail))
        .collect();
    if told.is_empty() {
        return None;
    }
    for v in table
        .columns
        .iter_mut()
        .flat_map(|c| &mut c.values)
        .filter(|v| rails.contains(v))
    {
        *v = f64::NAN;
    }
    Some(format!(
        "{} to the last digit, as at the rail of a converter or where a number marks what is missing; they are left out",
        told.join(" and ")
    ))
}

/// The smallest and the largest value, where these are rails. What is 0 is no voltage at all.
fn rails(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    let runs: Vec<&[f64]> = values.chunk_by(|a, b| a == b).collect();
    let [least, between @ .., most] = &runs[..] else {
        return Vec::new();
    };
    if between.len() < FEWEST {
        return Vec::new();
    }
    let usual = between
        .iter()
        .filter(|run| run[0] != 0.0)
        .map(|run| run.len())
        .max()
        .unwrap_or(1);
    let ends = [least, most]
        .into_iter()
        .filter(|run| run.len() >= TIMES * usual && run[0] != 0.0);
    ends.map(|run| run[0]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_at_the_end_again_and_again_is_a_rail() {
        let noisy: Vec<f64> = (0..200).map(|k| (f64::from(k) * 0.7).sin()).collect();
        assert!(rails(noisy.clone()).is_empty() && rails(Vec::new()).is_empty() && rails(vec![1.0; 9]).is_empty());
        let clipped = |of: f64| noisy.iter().map(|v| v.clamp(-of, of)).collect::<Vec<f64>>();
        assert_eq!(rails(clipped(0.9)), [-0.9, 0.9]);
        let above: Vec<f64> = noisy.iter().map(|v| v.min(0.9)).collect();
        assert_eq!(rails(above.clone()), [0.9]);
        // As often as others on a coarse scale, of twins by symmetry, or of frames that are copies.
        let coarse: Vec<f64> = noisy.iter().map(|v| (v * 10.0).round()).collect();
        assert!(rails(coarse).is_empty());
        assert!(rails(noisy.repeat(12)).is_empty());
        assert_eq!(rails(above.repeat(12)), [0.9]);
        // Electrodes that were driven are 0, and another program's 9999.
        let mut marked = noisy;
        marked.extend([0.0; 60]);
        assert!(rails(marked.iter().map(|v| v.abs()).collect()).is_empty());
        marked.extend([9999.0; 5]);
        assert_eq!(rails(marked), [9999.0]);
    }
}
