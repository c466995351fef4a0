//! Frames as other programs write them: one frame a line, and an order of the values that the program's name stands for.
//! docs/tables.md says where each order comes from.

use super::arrays::{Array, Kind};
use ::forward::order::{Layout, ValueOrder};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use thiserror::Error;

/// Reads an order's name, and lists the names in the help.
pub(crate) fn parser() -> impl TypedValueParser<Value = ValueOrder> {
    let values = ValueOrder::ALL.map(|order| PossibleValue::new(order.name()).help(order.about()));
    PossibleValuesParser::new(values).try_map(|name| name.parse::<ValueOrder>())
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

/// Whether an array's frames are its rows, and what their values are. Both may fit: then MATLAB's are columns, as EIDORS
/// has them, and everybody else's rows.
pub(super) fn fit(order: ValueOrder, array: &Array, kind: Kind) -> Option<(bool, Layout)> {
    let rows = order.layout(array.columns).map(|layout| (true, layout));
    let columns = order.layout(array.rows).map(|layout| (false, layout));
    if array.values.is_empty() {
        None
    } else if kind == Kind::Mat {
        columns.or(rows)
    } else {
        rows.or(columns)
    }
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
    let fits = |order: &&ValueOrder| {
        let sides = arrays.iter().flat_map(|a| [a.columns, a.rows]);
        sides.into_iter().any(|values| order.layout(values).is_some())
    };
    let names: Vec<&str> = ValueOrder::ALL.iter().filter(fits).map(|o| o.name()).collect();
    // A time or a number before the values of every frame.
    let mut sides = arrays.iter().map(|a| a.columns);
    let one_more = sides.find(|side| {
        let values = side.saturating_sub(1);
        ValueOrder::ALL.iter().any(|order| order.layout(values).is_some())
    });
    if let (Some(side), true) = (one_more, names.is_empty()) {
        format!(
            "{side} is one more than a known order has: leave out the times, or what else stands beside the values. Else write the \
             table with the columns drive_a, drive_b, sense_a, sense_b"
        )
    } else if names.is_empty() {
        "No known order has as many values a frame; write the table with the columns drive_a, drive_b, sense_a, sense_b"
            .to_owned()
    } else {
        format!("Name the program that wrote it: --order {}", names.join(" or --order "))
    }
}
