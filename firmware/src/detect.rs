//! Phase-sensitive detection: from an open window to a phasor for every channel.

use crate::capture::{Capture, Window};
use crate::error::ErrorType;
use crate::fold::Folded;
use crate::scan_error::ScanError;

/// Measures amplitude and phase of every channel over a window. Whoever lends samples ([`Capture`]) is one: the digital lock-in
/// folds and correlates them. A chip that correlates by itself (an impedance analyser, an FPGA, a bench instrument) implements
/// this and gives its results to [`Folded::put`].
///
/// The implementor's duties, each tested by [`crate::laws::detect`] (of a `Capture` by [`crate::laws::check`]):
/// - `in_phase` is what is in phase with the excitation, in the units of [`Reading`](crate::Reading).
/// - A window is measured after its settling, over its periods of the excitation or longer, and its result is put once.
/// - The time returned is when the first sample of the result was taken, or as near as the front end knows, in units of
///   [`Clock::now`](crate::Clock::now). It never goes back.
/// - A result that was lost is [`ErrorKind::Overrun`](crate::ErrorKind::Overrun), never silence; it closes the window.
pub trait Detect: ErrorType {
    /// Whether there are samples behind it. Without, the board sends no folded periods.
    const SAMPLED: bool;

    /// Opens a window; one that is still open is abandoned.
    ///
    /// # Errors
    /// The measurement cannot be started.
    fn begin(&mut self, window: Window) -> Result<(), Self::Error>;

    /// Adds what there is of the window to `seen`, which was made ready for its channels; when its first sample was taken.
    ///
    /// # Errors
    /// `WouldBlock` while there is nothing new, or no window is open. `Overrun` when something was lost.
    fn detect(&mut self, seen: &mut Folded) -> nb::Result<u64, ScanError<Self::Error>>;
}

/// The digital lock-in.
impl<C: Capture> Detect for C {
    const SAMPLED: bool = true;

    fn begin(&mut self, window: Window) -> Result<(), Self::Error> {
        Capture::begin(self, window)
    }

    #[inline]
    fn detect(&mut self, seen: &mut Folded) -> nb::Result<u64, ScanError<Self::Error>> {
        let (result, time) = self
            .poll_block(|block| (seen.add(block), block.time))
            .map_err(|e| e.map(ScanError::FrontEnd))?;
        result.map_err(ScanError::Block)?;
        Ok(time)
    }
}
