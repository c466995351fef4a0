//! The sine source.

use crate::error::ErrorType;

/// The sine source. It runs from the sampling timer: every period has [`crate::SAMPLES_PER_PERIOD`] samples, and sample 0 of a
/// period is taken at the sine's rising zero.
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
