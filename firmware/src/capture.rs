//! Samples in step with the excitation.

use crate::error::ErrorType;
use crate::reference::SAMPLES_PER_PERIOD;
use protocol::QUARTERS;

/// What to capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Window {
    /// Quarter periods to let pass first.
    pub settle_quarters: u16,
    /// Whole periods to lend, 1 or more.
    pub periods: u16,
    /// Channels sampled at once, 1 or more.
    pub channels: u8,
}

impl Window {
    /// Quarter periods from its opening to its end.
    pub fn quarters(&self) -> u32 {
        u32::from(self.settle_quarters) + QUARTERS * u32::from(self.periods)
    }
}

/// Samples in a quarter period: windows begin and blocks end at multiples of these.
pub const QUARTER_SAMPLES: usize = SAMPLES_PER_PERIOD / QUARTERS as usize;

/// What a board knows of a block's samples and the converter's rails.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Rails {
    /// Nothing: they have to be looked at.
    #[default]
    Unknown,
    /// The converter itself vouches that no code of the block is 0 or [`crate::FULL_SCALE`]. An analog watchdog on all
    /// channels, read after the block was complete, can do so. Halves the cost of folding the block.
    Clear,
}

/// Consecutive samples of whole quarter periods.
#[derive(Clone, Copy, Debug)]
pub struct Block<'a> {
    /// Rows of [`Block::channels`] samples, one row for each instant; right-aligned 12-bit codes. The number of rows is a
    /// multiple of [`QUARTER_SAMPLES`], not 0.
    pub samples: &'a [u16],
    /// Samples in a row.
    pub channels: u8,
    /// Number of this block among all blocks lent since power-up, wrapping.
    pub sequence: u32,
    /// When the first row was taken, in samples since power-up; a multiple of [`QUARTER_SAMPLES`]. Its remainder by
    /// [`SAMPLES_PER_PERIOD`] is the phase of the excitation at that instant.
    pub time: u64,
    /// Whether the converter has already looked for rails.
    pub rails: Rails,
}

impl Block<'_> {
    /// Whole quarter periods in the block; `None` when it breaks the promise to hold such.
    pub fn quarters(&self) -> Option<u32> {
        let quarter = usize::from(self.channels) * QUARTER_SAMPLES;
        let whole = quarter > 0 && !self.samples.is_empty() && self.samples.len().is_multiple_of(quarter);
        if !whole || !self.time.is_multiple_of(QUARTER_SAMPLES as u64) {
            return None;
        }
        u32::try_from(self.samples.len() / quarter).ok()
    }
}

/// Captures samples, without waiting for them.
///
/// The implementor's duties, each tested by [`crate::laws`]:
/// - The window opens at a boundary of quarter periods. Settling counts from the start of the quarter in which `begin` is
///   called; a `begin` at a boundary, or up to a sample's time after it, with a settling of n opens the window n quarters
///   later. A boundary that can no longer be met (n = 0, called late) is put off to the next one.
/// - The window's periods are lent once each, in order, in one block or several of whole quarters, and then no more. (So a
///   circular buffer of whole quarters may be lent in two pieces where it turns over.)
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
        let mut quarters = 0;
        while quarters < QUARTERS * u32::from(window.periods) {
            quarters += nb::block!(self.0.poll_block(|block| {
                f(block);
                // A block of nothing must not keep the loop here for ever.
                block.quarters().unwrap_or(QUARTERS * u32::from(u16::MAX))
            }))?;
        }
        Ok(())
    }
}
