//! What is wrong with a description of electronics, and the check of a number's range.

use thiserror::Error;

/// What is wrong with a description of electronics.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ElectronicsError {
    /// A number that it cannot have.
    #[error("electronics: {field} is {value}; it must be {allowed}")]
    Range {
        /// Which one.
        field: &'static str,
        /// What was given.
        value: f64,
        /// What it may be.
        allowed: &'static str,
    },
    /// A list that is too long or too short.
    #[error("electronics: {field} has {given} entries; {allowed}")]
    Length {
        /// Which one.
        field: &'static str,
        /// How many it has.
        given: usize,
        /// What it may have.
        allowed: &'static str,
    },
}

pub(crate) fn in_range(
    field: &'static str,
    value: f64,
    range: impl std::ops::RangeBounds<f64>,
    allowed: &'static str,
) -> Result<(), ElectronicsError> {
    if value.is_finite() && range.contains(&value) {
        Ok(())
    } else {
        Err(ElectronicsError::Range { field, value, allowed })
    }
}
