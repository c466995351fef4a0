//! Frames as other programs write them: one frame a line, and an order of the values that the program's name stands for.
//! docs/tables.md says where each order comes from.

use super::arrays::{Array, Kind};
use ::forward::{Measurement, Pair};
use clap::ValueEnum;
use thiserror::Error;

/// In which order a frame's values stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Order {
    /// The 208 values of this board: drive pairs 1-2 to 16-1; for each the sense pairs from 1-2 on, without those that carry current.
    Adjacent16,
    /// pyEIT, parser "std" (its default): as adjacent16, of any number of electrodes.
    Pyeit,
    /// pyEIT, parser "fmmu" or "rotate_meas": the sense pairs begin at the drive pair.
    PyeitFmmu,
    /// EIDORS, "no_rotate_meas" (its default), with or without the values that carry current.
    Eidors,
    /// EIDORS, "rotate_meas": the sense pairs begin at the drive pair.
    EidorsRotated,
    /// A line of OpenEIT: magnitudes, 928 of 32 electrodes with neighbours driven, or 192 of 16 with opposite ones driven.
    Openeit,
}

/// Most electrodes that an order is looked for.
const MOST: usize = ::forward::file::MOST_ELECTRODES;

/// What the values of one frame are.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Layout {
    /// Number of electrodes.
    pub electrodes: usize,
    /// What each value is; none for one that was measured on an electrode that carried current.
    pub values: Vec<Option<Measurement>>,
}

/// What is wrong with frames for an order.
#[derive(Debug, Error)]
pub(crate) enum OrderError {
    /// No variable whose rows or columns have a fitting number of values.
    #[error("{file}: no frames in the order {order}, which has {counts} values; the file has {found}. {hint}")]
    Nothing {
        /// The file.
        file: String,
        /// The order asked for.
        order: &'static str,
        /// Numbers of values that the order has.
        counts: &'static str,
        /// The arrays of the file.
        found: String,
        /// What fits instead.
        hint: String,
    },
    /// A variable that the file does not have.
    #[error("{file}: there is no variable {name}; it has {found}")]
    NoSuchVariable {
        /// The file.
        file: String,
        /// The variable asked for.
        name: String,
        /// The arrays of the file.
        found: String,
    },
    /// A comment that names another sheet than one before it.
    #[error("{0}")]
    Comment(String),
    /// Variables of different numbers of electrodes.
    #[error("{file}: variables of {first} and of {second} electrodes; name those that belong together with --variable")]
    Mixed {
        /// The file.
        file: String,
        /// Electrodes of the first variable.
        first: usize,
        /// Electrodes of another.
        second: usize,
    },
}

impl Order {
    /// As on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Adjacent16 => "adjacent16",
            Self::Pyeit => "pyeit",
            Self::PyeitFmmu => "pyeit-fmmu",
            Self::Eidors => "eidors",
            Self::EidorsRotated => "eidors-rotated",
            Self::Openeit => "openeit",
        }
    }

    /// How many values a frame has, in words.
    pub(super) fn counts(self) -> &'static str {
        match self {
            Self::Adjacent16 => "208",
            Self::Openeit => "N(N-3) or N(N-4)",
            _ => "N(N-3), N(N-4) or N N",
        }
    }

    /// What the values of a frame are that has so many; none where the order has no frame of that length.
    pub(crate) fn layout(self, values: usize) -> Option<Layout> {
        let rotated = matches!(self, Self::PyeitFmmu | Self::EidorsRotated);
        let magnitudes = self == Self::Openeit;
        // No two of these are the same for any numbers of electrodes from 5 on.
        (5..=MOST).take_while(|n| n * (n - 4) <= values).find_map(|n| {
            let (step, whole) = match values {
                _ if values == n * (n - 3) => (1, false),
                _ if self == Self::Adjacent16 => return None,
                _ if values == n * (n - 4) && n % 2 == 0 && n > 5 => (n / 2, false),
                _ if values == n * n && !magnitudes => (1, true),
                _ => return None,
            };
            (self != Self::Adjacent16 || n == 16).then(|| Layout {
                electrodes: n,
                values: list(n, step, rotated, whole, magnitudes),
            })
        })
    }

    /// Whether an array's frames are its rows, and what their values are. Both may fit: then MATLAB's are columns, as EIDORS
    /// has them, and everybody else's rows.
    pub(super) fn fit(self, array: &Array, kind: Kind) -> Option<(bool, Layout)> {
        let rows = self.layout(array.columns).map(|layout| (true, layout));
        let columns = self.layout(array.rows).map(|layout| (false, layout));
        if array.values.is_empty() {
            None
        } else if kind == Kind::Mat {
            columns.or(rows)
        } else {
            rows.or(columns)
        }
    }
}

/// Every drive pair `(m, m + step)`, and for each every neighbouring sense pair from electrode 1 on, or from electrode m on. As in
/// pyEIT and EIDORS a value is positive where a homogeneous disc with neighbours driven makes it so; of magnitudes all are.
fn list(n: usize, step: usize, rotated: bool, whole: bool, magnitudes: bool) -> Vec<Option<Measurement>> {
    let mut out = Vec::new();
    for m in 0..n {
        let drive = Pair::new(m, (m + step) % n);
        for k in 0..n {
            let first = if rotated { (m + k) % n } else { k };
            let sense = Pair::new((first + 1) % n, first);
            if drive.touches(sense) {
                if whole {
                    out.push(None);
                }
                continue;
            }
            // From source to sink the potential falls.
            let falls = (first + n - m) % n < step;
            let sense = if magnitudes && falls { sense.reversed() } else { sense };
            out.push(Some(Measurement { drive, sense }));
        }
    }
    out
}

/// The arrays of a file, for messages.
pub(super) fn described(arrays: &[Array]) -> String {
    if arrays.is_empty() {
        return "no array of numbers".to_owned();
    }
    let one = |a: &Array| {
        let name = if a.name.is_empty() { "numbers" } else { a.name.as_str() };
        format!("{name} ({} x {})", a.rows, a.columns)
    };
    arrays.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// Which orders the arrays of a file may have.
pub(crate) fn hint(arrays: &[Array]) -> String {
    let fits = |order: &&Order| {
        let sides = arrays.iter().flat_map(|a| [a.columns, a.rows]);
        sides.into_iter().any(|values| order.layout(values).is_some())
    };
    let names: Vec<&str> = Order::value_variants().iter().filter(fits).map(|o| o.name()).collect();
    if names.is_empty() {
        "No known order has as many values a frame; write the table with the columns drive_a, drive_b, sense_a, sense_b"
            .to_owned()
    } else {
        format!("Name the program that wrote it: --order {}", names.join(" or --order "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::forward::Pattern;

    fn measurements(order: Order, values: usize) -> Vec<Measurement> {
        order.layout(values).unwrap().values.into_iter().flatten().collect()
    }

    #[test]
    fn the_plain_orders_are_that_of_the_adjacent_pattern() {
        for electrodes in [8, 16, 32] {
            let adjacent = Pattern::adjacent(electrodes).unwrap();
            for order in [Order::Pyeit, Order::Eidors, Order::Openeit] {
                let of_it = measurements(order, electrodes * (electrodes - 3));
                assert_eq!(of_it, adjacent.measurements(), "{order:?}");
            }
            // With the values on driven electrodes, the rest stays in order.
            assert_eq!(
                measurements(Order::Eidors, electrodes * electrodes),
                adjacent.measurements()
            );
        }
        assert_eq!(
            measurements(Order::Adjacent16, 208),
            Pattern::adjacent(16).unwrap().measurements()
        );
        assert_eq!(Order::Adjacent16.layout(928), None);
    }

    #[test]
    fn rotated_orders_begin_behind_the_drive_pair_and_hold_the_same() {
        for values in [208, 256, 192] {
            let rotated = measurements(Order::EidorsRotated, values);
            assert_eq!(rotated, measurements(Order::PyeitFmmu, values));
            let plain = measurements(Order::Eidors, values);
            assert_ne!(rotated, plain);
            let sorted = |mut list: Vec<Measurement>| {
                list.sort_unstable();
                list
            };
            assert_eq!(sorted(rotated), sorted(plain));
        }
        // pyEIT's protocol for drive (2, 3), electrodes from 0: sense 4-5 first, then on to 0-1.
        let rotated = measurements(Order::PyeitFmmu, 208);
        assert_eq!(rotated[2 * 13].sense, Pair::new(5, 4));
        assert_eq!(rotated[2 * 13 + 12].sense, Pair::new(1, 0));
    }

    #[test]
    fn no_number_of_values_has_two_meanings() {
        let mut seen = std::collections::HashMap::new();
        for n in 6..=200_usize {
            for (what, count) in [("adjacent", n * (n - 3)), ("opposite", n * (n - 4)), ("whole", n * n)] {
                if what == "opposite" && n % 2 == 1 {
                    continue;
                }
                assert_eq!(seen.insert(count, (what, n)), None, "{count}");
                assert_eq!(Order::Eidors.layout(count).unwrap().electrodes, n, "{what} {count}");
            }
        }
    }

    #[test]
    fn openeits_magnitudes_are_those_of_a_homogeneous_disc() {
        use ::forward::{Drive, Model, ModelOptions, Sheet, Solver};
        let solver = Solver::new(std::sync::Arc::new(
            Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap(),
        ))
        .unwrap();
        let matrix = solver.electrode_matrix();
        for values in [192, 208] {
            let pattern = Pattern::from_list(16, measurements(Order::Openeit, values)).unwrap();
            let volts = Drive::PAPER.frame_v(matrix, &pattern);
            assert!(volts.iter().all(|v| *v > 0.0), "{values}");
        }
    }
}
