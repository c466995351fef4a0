//! The errors that the parts of a front end share.

use core::fmt::Debug;

/// An error of a front end, told apart by its kind as far as the scan has to.
pub trait Error: Debug {
    /// Which kind it is.
    fn kind(&self) -> ErrorKind;
}

/// Kinds of front-end errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ErrorKind {
    /// A sample was lost: this frame is void, the next may be good.
    Overrun,
    /// Samples ought to have come and did not.
    Timeout,
    /// The multiplexers could not be set.
    Route,
    /// Anything else.
    Other,
}

impl Error for ErrorKind {
    fn kind(&self) -> ErrorKind {
        *self
    }
}

impl Error for core::convert::Infallible {
    fn kind(&self) -> ErrorKind {
        match *self {}
    }
}

/// The error type that a front end's traits share.
pub trait ErrorType {
    /// The error.
    type Error: Error;
}

impl<T: ErrorType + ?Sized> ErrorType for &mut T {
    type Error = T::Error;
}
