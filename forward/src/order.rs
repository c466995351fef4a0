//! Orders of a frame's values that other programs use. docs/tables.md says where each comes from.

use crate::file::MOST_ELECTRODES;
use crate::pattern::{Measurement, Pair};
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// In which order a frame's values stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ValueOrder {
    /// The 208 values of this board.
    Adjacent16,
    /// pyEIT, parser "std".
    Pyeit,
    /// pyEIT, parser "fmmu" or "rotate_meas".
    PyeitFmmu,
    /// EIDORS, "no_rotate_meas".
    Eidors,
    /// EIDORS, "rotate_meas".
    EidorsRotated,
    /// A line of OpenEIT.
    Openeit,
}

/// What the values of one frame are.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// Number of electrodes.
    pub electrodes: usize,
    /// What each value is; none for one that was measured on an electrode that carried current.
    pub values: Vec<Option<Measurement>>,
}

/// A name that no order has.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("there is no order '{given}'; choose adjacent16, pyeit, pyeit-fmmu, eidors, eidors-rotated or openeit")]
pub struct UnknownOrder {
    /// The name given.
    pub given: String,
}

impl ValueOrder {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Adjacent16,
        Self::Pyeit,
        Self::PyeitFmmu,
        Self::Eidors,
        Self::EidorsRotated,
        Self::Openeit,
    ];

    /// Its name, as it is read.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Adjacent16 => "adjacent16",
            Self::Pyeit => "pyeit",
            Self::PyeitFmmu => "pyeit-fmmu",
            Self::Eidors => "eidors",
            Self::EidorsRotated => "eidors-rotated",
            Self::Openeit => "openeit",
        }
    }

    /// What it says, in a line.
    pub const fn about(self) -> &'static str {
        match self {
            Self::Adjacent16 => {
                "The 208 values of this board: drive pairs 1-2 to 16-1; for each the sense pairs from 1-2 on, without those that carry current"
            }
            Self::Pyeit => r#"pyEIT, parser "std" (its default): as adjacent16, of any number of electrodes"#,
            Self::PyeitFmmu => r#"pyEIT, parser "fmmu" or "rotate_meas": the sense pairs begin at the drive pair"#,
            Self::Eidors => r#"EIDORS, "no_rotate_meas" (its default), with or without the values that carry current"#,
            Self::EidorsRotated => r#"EIDORS, "rotate_meas": the sense pairs begin at the drive pair"#,
            Self::Openeit => {
                "A line of OpenEIT: magnitudes, 928 of 32 electrodes with neighbours driven, or 192 of 16 with opposite ones driven"
            }
        }
    }

    /// How many values a frame of N electrodes has, in words.
    pub const fn counts(self) -> &'static str {
        match self {
            Self::Adjacent16 => "208",
            Self::Openeit => "N(N-3) or N(N-4)",
            _ => "N(N-3), N(N-4) or N N",
        }
    }

    /// What the values of a frame are that has so many; none where the order has no frame of that length.
    pub fn layout(self, values: usize) -> Option<Layout> {
        let rotated = matches!(self, Self::PyeitFmmu | Self::EidorsRotated);
        let magnitudes = self == Self::Openeit;
        // No two of these are the same for any numbers of electrodes from 5 on.
        (5..=MOST_ELECTRODES)
            .take_while(|n| n * (n - 4) <= values)
            .find_map(|n| {
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
}

impl fmt::Display for ValueOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for ValueOrder {
    type Err = UnknownOrder;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let found = Self::ALL.into_iter().find(|order| order.name() == name);
        found.ok_or_else(|| UnknownOrder { given: name.to_owned() })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pattern;

    fn measurements(order: ValueOrder, values: usize) -> Vec<Measurement> {
        order.layout(values).unwrap().values.into_iter().flatten().collect()
    }

    #[test]
    fn an_order_is_read_by_its_name() {
        assert!(ValueOrder::ALL.iter().all(|order| order.name().parse() == Ok(*order)));
        let unknown = "pyEIT".parse::<ValueOrder>().unwrap_err().to_string();
        assert!(
            ValueOrder::ALL.iter().all(|order| unknown.contains(order.name())),
            "{unknown}"
        );
    }

    #[test]
    fn the_plain_orders_are_that_of_the_adjacent_pattern() {
        for electrodes in [8, 16, 32] {
            let adjacent = Pattern::adjacent(electrodes).unwrap();
            for order in [ValueOrder::Pyeit, ValueOrder::Eidors, ValueOrder::Openeit] {
                let of_it = measurements(order, electrodes * (electrodes - 3));
                assert_eq!(of_it, adjacent.measurements(), "{order:?}");
            }
            // With the values on driven electrodes, the rest stays in order.
            assert_eq!(
                measurements(ValueOrder::Eidors, electrodes * electrodes),
                adjacent.measurements()
            );
        }
        assert_eq!(
            measurements(ValueOrder::Adjacent16, 208),
            Pattern::adjacent(16).unwrap().measurements()
        );
        assert_eq!(ValueOrder::Adjacent16.layout(928), None);
    }

    #[test]
    fn rotated_orders_begin_behind_the_drive_pair_and_hold_the_same() {
        for values in [208, 256, 192] {
            let rotated = measurements(ValueOrder::EidorsRotated, values);
            assert_eq!(rotated, measurements(ValueOrder::PyeitFmmu, values));
            let plain = measurements(ValueOrder::Eidors, values);
            assert_ne!(rotated, plain);
            let sorted = |mut list: Vec<Measurement>| {
                list.sort_unstable();
                list
            };
            assert_eq!(sorted(rotated), sorted(plain));
        }
        // pyEIT's protocol for drive (2, 3), electrodes from 0: sense 4-5 first, then on to 0-1.
        let rotated = measurements(ValueOrder::PyeitFmmu, 208);
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
                assert_eq!(
                    ValueOrder::Eidors.layout(count).unwrap().electrodes,
                    n,
                    "{what} {count}"
                );
            }
        }
    }

    #[test]
    fn openeits_magnitudes_are_those_of_a_homogeneous_disc() {
        use crate::{Drive, Model, ModelOptions, Sheet, Solver};
        let solver = Solver::new(std::sync::Arc::new(
            Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap(),
        ))
        .unwrap();
        let matrix = solver.electrode_matrix();
        for values in [192, 208] {
            let pattern = Pattern::from_list(16, measurements(ValueOrder::Openeit, values)).unwrap();
            let volts = Drive::PAPER.frame_v(matrix, &pattern);
            assert!(volts.iter().all(|v| *v > 0.0), "{values}");
        }
    }
}
