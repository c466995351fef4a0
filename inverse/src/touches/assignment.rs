//! Optimal assignment: every row its own column, with the least sum of costs.

/// The column of every row, such that no two rows have the same one and the sum of the costs is least (Kuhn 1955, Munkres 1957), in
/// the form that adds one row after another along a shortest path, O(rows² columns).
///
/// `cost(row, column)` must be finite, and there must be at least as many columns as rows; rows beyond get none of it: `columns`.
pub(crate) fn assign(rows: usize, columns: usize, cost: impl Fn(usize, usize) -> f64) -> Vec<usize> {
    let rows = rows.min(columns);
    // Potentials of rows and columns; column 0 is where a path begins, so both count from 1.
    let (mut of_row, mut of_column) = (vec![0.0; rows + 1], vec![0.0; columns + 1]);
    // The row of every column, 0 for none.
    let mut taken = vec![0; columns + 1];
    for row in 1..=rows {
        taken[0] = row;
        let mut least = vec![f64::INFINITY; columns + 1];
        let mut before = vec![0; columns + 1];
        let mut seen = vec![false; columns + 1];
        let mut at = 0;
        while taken[at] != 0 {
            seen[at] = true;
            let from = taken[at];
            let (mut step, mut next) = (f64::INFINITY, at);
            for column in (1..=columns).filter(|c| !seen[*c]) {
                let reduced = cost(from - 1, column - 1) - of_row[from] - of_column[column];
                if reduced < least[column] {
                    least[column] = reduced;
                    before[column] = at;
                }
                if least[column] < step {
                    step = least[column];
                    next = column;
                }
            }
            if next == at {
                // Only where a cost is not finite.
                break;
            }
            for column in 0..=columns {
                if seen[column] {
                    of_row[taken[column]] += step;
                    of_column[column] -= step;
                } else {
                    least[column] -= step;
                }
            }
            at = next;
        }
        while at != 0 {
            taken[at] = taken[before[at]];
            at = before[at];
        }
    }
    let mut out = vec![columns; rows];
    for (column, row) in taken.iter().enumerate().skip(1).filter(|(_, row)| **row != 0) {
        out[row - 1] = column - 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The least sum, by trying all.
    fn least(costs: &[Vec<f64>], row: usize, free: &mut Vec<bool>) -> f64 {
        if row == costs.len() {
            return 0.0;
        }
        let mut best = f64::INFINITY;
        for column in 0..free.len() {
            if free[column] {
                free[column] = false;
                best = best.min(costs[row][column] + least(costs, row + 1, free));
                free[column] = true;
            }
        }
        best
    }

    proptest! {
        #[test]
        fn no_assignment_costs_less(
            (rows, costs) in (0..5usize, 0..3usize).prop_flat_map(|(rows, more)| {
                (Just(rows), prop::collection::vec(prop::collection::vec(-50.0..50.0f64, rows + more), rows))
            })
        ) {
            let columns = costs.first().map_or(0, Vec::len);
            let found = assign(rows, columns, |row, column| costs[row][column]);
            let mut seen = found.clone();
            seen.sort_unstable();
            seen.dedup();
            prop_assert_eq!(seen.len(), rows);
            let sum: f64 = found.iter().enumerate().map(|(row, column)| costs[row][*column]).sum();
            prop_assert!((sum - least(&costs, 0, &mut vec![true; columns])).abs() < 1e-9);
        }
    }
}
