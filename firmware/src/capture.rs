//! Samples in step with the excitation.

use crate::front_end::ErrorType;
use crate::reference::SAMPLES_PER_PERIOD;

/// What to capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Whole periods to let pass first.
    pub settle_periods: u16,
    /// Whole periods to lend, 1 or more.
    pub periods: u16,
    /// Channels sampled at once, 1 or more.
    pub channels: u8,
}

/// Consecutive samples of whole periods.
#[derive(Clone, Copy, Debug)]
pub struct Block<'a> {
    /// Rows of [`Block::channels`] samples, one row for each instant; right-aligned 12-bit codes. The first row is taken
    /// at phase 0, and the number of rows is a multiple of [`SAMPLES_PER_PERIOD`], not 0.
    pub samples: &'a [u16],
    /// Samples in a row.
    pub channels: u8,
    /// Number of this block among all blocks lent since power-up, wrapping.
    pub sequence: u32,
    /// When the first row was taken, in samples since power-up; a multiple of [`SAMPLES_PER_PERIOD`].
    pub time: u64,
}

impl Block<'_> {
    /// Whole periods in the block; `None` when it breaks the promise to hold whole periods.
    pub fn periods(&self) -> Option<u32> {
        let row = usize::from(self.channels);
        let period = row * SAMPLES_PER_PERIOD;
        if period == 0 || self.samples.is_empty() || !self.samples.len().is_multiple_of(period) {
            return None;
        }
        u32::try_from(self.samples.len() / period).ok()
    }
}

/// Captures samples, without waiting for them.
///
/// The implementor's duties, each tested by [`crate::laws`]:
/// - The window opens at a period boundary. Settling counts from the start of the period in which `begin` is called; a
///   `begin` at a boundary, or up to a sample's time after it, with a settling of n opens the window n periods later.
///   A boundary that can no longer be met (n = 0, called late) is put off to the next one.
/// - The window's periods are lent once each, in order, in one block or several, and then no more.
/// - A lost sample is [`ErrorKind::Overrun`](crate::ErrorKind::Overrun), never silence; it closes the window. Whether
///   samples were overwritten is checked after the closure ran, not before.
pub trait Capture: ErrorType {
    /// Opens a window; one that is still open is abandoned.
    ///
    /// # Errors
    /// The converter cannot be started.
    fn begin(&mut self, window: Window) -> Result<(), Self::Error>;

    /// Lends the next block to `f`, once. With an error the result of `f`, if it ran, is void.
    ///
    /// # Errors
    /// `WouldBlock` while the next block is not complete, or no window is open. `Overrun` when samples were lost.
    fn poll_block<R>(&mut self, f: impl FnOnce(&Block<'_>) -> R) -> nb::Result<R, Self::Error>;
}

impl<T: Capture> Capture for &mut T {
    fn begin(&mut self, window: Window) -> Result<(), Self::Error> {
        T::begin(self, window)
    }

    fn poll_block<R>(&mut self, f: impl FnOnce(&Block<'_>) -> R) -> nb::Result<R, Self::Error> {
        T::poll_block(self, f)
    }
}

/// Makes any capture a blocking one: for bring-up programs, self-tests and benches.
#[derive(Debug)]
pub struct Blocking<C>(pub C);

impl<C: Capture> Blocking<C> {
    /// Waits for all blocks of a window and lends them in order.
    ///
    /// # Errors
    /// As the capture; the blocks lent so far are then void.
    pub fn capture(&mut self, window: Window, mut f: impl FnMut(&Block<'_>)) -> Result<(), C::Error> {
        self.0.begin(window)?;
        let mut periods = 0;
        while periods < u32::from(window.periods) {
            periods += nb::block!(self.0.poll_block(|block| {
                f(block);
                // An empty block must not keep the loop here for ever.
                block.periods().unwrap_or(u32::from(u16::MAX))
            }))?;
        }
        Ok(())
    }
}
