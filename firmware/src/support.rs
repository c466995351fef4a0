//! What the firmware needs of a chip besides its front end and its serial port: time, a watchdog, a place for settings, and
//! a word that outlives a reset.

use core::fmt::Debug;

/// Time since power-up. Law: it never goes back, and it goes on at the rate of the samples:
/// [`Block::time`](crate::Block::time) is in its units and from its start.
pub trait Clock {
    /// Samples since power-up.
    fn now(&mut self) -> u64;
}

/// Restarts a board that hangs. Law: it stays quiet while it is fed more often than its time-out, and bites once it is
/// not. The time-out is the board's; it has to be longer than [`Store::erase`] takes.
///
/// The controller feeds it in every poll, and while it looks through the store: a poll comes back at once otherwise, and a
/// scan that does not go on is found by the clock and stopped.
pub trait Watchdog {
    /// Not yet.
    fn feed(&mut self);
}

/// One of the two halves of a [`Store`], which are erased one by one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sector {
    /// The first.
    A,
    /// The second.
    B,
}

/// Two sectors of flash memory or of anything that behaves like it. Laws:
/// - what was erased reads 0xFF; what was written reads as it was written, also after power was cut and came back;
/// - `write` writes unit after unit of [`Store::write_len`] bytes. A cut leaves one unit at most in an unknown state, none
///   after it touched, and never changes anything before;
/// - a cut while erasing leaves that sector in an unknown state and never changes the other one.
///
/// The caller writes whole units, each at most once after it was erased, never across the end, and only while nothing is
/// measured: both calls may take a second.
pub trait Store {
    /// The error.
    type Error: Debug;

    /// Bytes of each sector; 0 where there is no store.
    fn sector_len(&self) -> u32;

    /// Bytes that are written at once, from a multiple of as many on: 1, 2, 4, 8, 16 or 32. A sector has a multiple of it.
    /// Memories with error correction have more than 1.
    fn write_len(&self) -> u32 {
        1
    }

    /// Copies from a sector, beginning at `offset`.
    ///
    /// # Errors
    /// It cannot be read, or ends before that.
    fn read(&mut self, sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), Self::Error>;

    /// Writes into a sector, beginning at `offset`.
    ///
    /// # Errors
    /// It cannot be written, or ends before that.
    fn write(&mut self, sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), Self::Error>;

    /// Makes every byte of a sector 0xFF.
    ///
    /// # Errors
    /// It cannot be erased.
    fn erase(&mut self, sector: Sector) -> Result<(), Self::Error>;
}

/// A word that outlives a reset: memory that no start clears, or a backup register. Law: what was kept is recalled, also
/// after a panic's or the watchdog's reset. After power came it may be anything; the firmware knows its own words.
pub trait Scratch {
    /// What was kept last.
    fn recall(&mut self) -> u32;

    /// Keeps a word in place of the one before.
    fn keep(&mut self, word: u32);
}

/// All four, as the controller takes them. Implemented by whatever implements its parts.
pub trait Support: Clock + Watchdog + Store + Scratch {}

impl<T: Clock + Watchdog + Store + Scratch> Support for T {}

impl<T: Clock + ?Sized> Clock for &mut T {
    fn now(&mut self) -> u64 {
        T::now(self)
    }
}

impl<T: Watchdog + ?Sized> Watchdog for &mut T {
    fn feed(&mut self) {
        T::feed(self);
    }
}

impl<T: Scratch + ?Sized> Scratch for &mut T {
    fn recall(&mut self) -> u32 {
        T::recall(self)
    }

    fn keep(&mut self, word: u32) {
        T::keep(self, word);
    }
}

impl<T: Store + ?Sized> Store for &mut T {
    type Error = T::Error;

    fn sector_len(&self) -> u32 {
        T::sector_len(self)
    }

    fn write_len(&self) -> u32 {
        T::write_len(self)
    }

    fn read(&mut self, sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), Self::Error> {
        T::read(self, sector, offset, out)
    }

    fn write(&mut self, sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        T::write(self, sector, offset, bytes)
    }

    fn erase(&mut self, sector: Sector) -> Result<(), Self::Error> {
        T::erase(self, sector)
    }
}
