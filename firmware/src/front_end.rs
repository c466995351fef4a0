//! What every part of a front end has in common: its errors, and the excitation.

use crate::capture::Capture;
use crate::route::Router;
use core::fmt::Debug;

/// An error of a front end, told apart by its kind as far as the scan has to.
pub trait Error: Debug {
    /// Which kind it is.
    fn kind(&self) -> ErrorKind;
}

/// Kinds of front-end errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
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

/// The sine source. It runs from the sampling timer, so that every period has [`crate::SAMPLES_PER_PERIOD`] samples and
/// sample 0 of a period is taken at the sine's rising zero.
pub trait Excitation: ErrorType {
    /// Switches the source on, at phase 0. It then runs without a break. Switching on twice is no error.
    ///
    /// # Errors
    /// The source does not start.
    fn switch_on(&mut self) -> Result<(), Self::Error>;

    /// Sets the amplitude, in thousandths of [`crate::BoardInfo::excitation_uv`], 1 to 1000, now or when it is switched on.
    /// At power-up it is 1000. The source may pause and begin again at phase 0.
    ///
    /// # Errors
    /// The source cannot be set.
    fn set_amplitude(&mut self, permille: u16) -> Result<(), Self::Error>;

    /// Switches the source off; the sheet is then without voltage. Switching off twice is no error.
    ///
    /// # Errors
    /// The source does not stop.
    fn switch_off(&mut self) -> Result<(), Self::Error>;
}

impl<T: Excitation + ?Sized> Excitation for &mut T {
    fn switch_on(&mut self) -> Result<(), Self::Error> {
        T::switch_on(self)
    }

    fn set_amplitude(&mut self, permille: u16) -> Result<(), Self::Error> {
        T::set_amplitude(self, permille)
    }

    fn switch_off(&mut self) -> Result<(), Self::Error> {
        T::switch_off(self)
    }
}

/// All that a scan needs. Implemented by whatever implements its parts.
pub trait FrontEnd: Router + Capture + Excitation {}

impl<T: Router + Capture + Excitation> FrontEnd for T {}
