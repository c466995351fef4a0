//! What can go wrong in a scan.

use crate::fold::FoldError;

/// Why a frame cannot be finished.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ScanError<E> {
    /// The front end reported an error.
    FrontEnd(E),
    /// The front end lent a block that breaks its promises.
    Block(FoldError),
}
