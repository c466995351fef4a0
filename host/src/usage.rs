//! Wrong usage: exit code 2.

/// Options that make no sense together.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct Usage(pub(crate) String);

/// A board that is unfit, or none: exit code 3.
#[derive(Debug, thiserror::Error)]
#[error("unfit: {0}; the lines say what to do")]
pub(crate) struct Unfit(pub(crate) String);
