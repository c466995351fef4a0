//! The methods on the command line.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use inverse::solvers::Method;

/// Reads a method's name, and lists the names in the help.
pub(crate) fn parser() -> impl TypedValueParser<Value = Method> {
    let values = Method::ALL.map(|m| PossibleValue::new(m.name()).help(m.about()));
    PossibleValuesParser::new(values).try_map(|name| name.parse::<Method>())
}
