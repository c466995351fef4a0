//! Values of a table that stand at the rail of a converter, or are another program's mark of a missing value: the largest or the smallest
//! one, again and again to the last digit. Live frames need no such guess: the board says which values were out of range.

use crate::files::measurements::MeasurementTable;

/// A value is a rail where it stands so many times as often as any other between the smallest and the largest. On an ideal sheet
/// values that symmetry makes equal are as many at every distance.
const TIMES: usize = 4;
/// Fewest different values between these: a converter with fewer steps has many values at each.
const FEWEST: usize = 32;

/// So many rails are told.
const MOST_TOLD: usize = 4;

/// Takes the values at rails out of a table; says how many and at which value, or nothing where there are none.
///
/// Rails are those of the whole table, and of each column by itself: a frame that was clipped may stand beside one that was not.
pub(crate) fn leave_out(table: &mut MeasurementTable) -> Option<String> {
    let finite = |values: &[f64]| values.iter().copied().filter(|v| v.is_finite()).collect::<Vec<f64>>();
    let of_all = rails(table.columns.iter().flat_map(|c| finite(&c.values)).collect());
    let mut told: Vec<(f64, usize)> = of_all.iter().map(|rail| (*rail, 0)).collect();
    for column in &mut table.columns {
        // Of one column the least magnitudes are no rail: they are values far from the source.
        let own = rails(finite(&column.values)).into_iter();
        let own: Vec<f64> = own.filter(|rail| is_largest(*rail, &column.values)).collect();
        for v in (column.values.iter_mut()).filter(|v| of_all.contains(v) || own.contains(v)) {
            match told.iter_mut().find(|(rail, _)| rail == v) {
                Some((_, count)) => *count += 1,
                None => told.push((*v, 1)),
            }
            *v = f64::NAN;
        }
    }
    let mut texts: Vec<String> = (told.iter().take(MOST_TOLD))
        .map(|(rail, count)| format!("{count} values are {rail}"))
        .collect();
    if told.len() > MOST_TOLD {
        let more: usize = told[MOST_TOLD..].iter().map(|(_, count)| count).sum();
        texts.push(format!("{more} more are others"));
    }
    (!texts.is_empty()).then(|| {
        format!(
            "{} to the last digit, as at the rail of a converter or where a number marks what is missing; they are left out",
            texts.join(" and ")
        )
    })
}

/// Whether no value of the same sign is larger in magnitude.
fn is_largest(rail: f64, values: &[f64]) -> bool {
    !values.iter().any(|v| v.abs() > rail.abs() && v * rail > 0.0)
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

    /// A frame that was clipped, beside one that was not and one whose values lie closely at the least.
    #[test]
    fn a_column_has_a_rail_of_its_own() {
        let whole: Vec<f64> = (0..200).map(|k| 1.1 + (f64::from(k) * 0.7).sin()).collect();
        let clipped: Vec<f64> = whole.iter().map(|v| v.min(1.9)).collect();
        let least: Vec<f64> = whole.iter().map(|v| v.max(0.3)).collect();
        // Where the values are from does not matter here.
        let mut table = MeasurementTable::parse(
            "t.csv",
            b"drive_a,drive_b,sense_a,sense_b,whole,clipped,least\n1,2,3,4,1,1,1\n",
            |_, _| (),
        )
        .unwrap();
        for (column, values) in table.columns.iter_mut().zip([&whole, &clipped, &least]) {
            column.values.clone_from(values);
        }
        let count = whole.iter().filter(|v| **v >= 1.9).count();
        let said = leave_out(&mut table).unwrap();
        assert!(
            said.starts_with(&format!("{count} values are 1.9 to the last digit")),
            "{said}"
        );
        let left = table
            .columns
            .iter()
            .map(|c| c.values.iter().filter(|v| v.is_nan()).count());
        assert_eq!(left.collect::<Vec<usize>>(), [0, count, 0]);
    }

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
