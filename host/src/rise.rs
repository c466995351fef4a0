//! Which way touches change the resistance, on the command line.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use inverse::touches::polarity::Polarity;

/// Reads a polarity's name, and lists the names in the help.
pub(crate) fn parser() -> impl TypedValueParser<Value = Polarity> {
    let values = Polarity::ALL.map(|p| PossibleValue::new(p.name()).help(p.about()));
    PossibleValuesParser::new(values).try_map(|name| name.parse::<Polarity>())
}
