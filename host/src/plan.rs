//! The plans on the command line.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use link::plans::PlanName;

/// Reads a plan's name, and lists the names in the help.
pub(crate) fn parser() -> impl TypedValueParser<Value = PlanName> {
    let values = PlanName::ALL.map(|p| PossibleValue::new(p.name()).help(p.about()));
    PossibleValuesParser::new(values).try_map(|name| name.parse::<PlanName>())
}
