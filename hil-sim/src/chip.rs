//! What a chip has besides its front end and its serial port: a clock, a watchdog, a store and a word that outlives a reset.

use crate::clock::{Clock, samples};
use crate::flash::{Flash, FlashError};
use firmware::{Scratch, Sector, Store, Watchdog};

/// Time-out of the watchdog, s: longer than erasing a sector takes, as [`firmware::Watchdog`] asks.
const WATCHDOG_S: f64 = 2.0;

/// A simulated chip.
#[derive(Clone, Debug)]
pub struct Chip {
    clock: Clock,
    fed_at: u64,
    /// What keeps the settings; it outlives a reset.
    pub flash: Flash,
    /// The word that outlives a reset.
    pub scratch: u32,
}

impl Chip {
    /// A chip at power-up, with what its flash memory holds.
    pub fn new(clock: Clock, flash: Flash) -> Self {
        let fed_at = clock.now();
        Self {
            clock,
            fed_at,
            flash,
            scratch: 0,
        }
    }

    /// Whether the watchdog was not fed for its time-out: the board is reset.
    pub fn bitten(&self) -> bool {
        self.clock.now() - self.fed_at > samples(WATCHDOG_S)
    }

    /// Samples in the watchdog's time-out.
    pub fn time_out(&self) -> u64 {
        samples(WATCHDOG_S)
    }
}

impl firmware::Clock for Chip {
    fn now(&mut self) -> u64 {
        self.clock.now()
    }
}

impl Watchdog for Chip {
    fn feed(&mut self) {
        self.flash.feed();
        // Once it has bitten, the board is gone: it cannot be fed back to life.
        if !self.bitten() {
            self.fed_at = self.clock.now();
        }
    }
}

impl Scratch for Chip {
    fn recall(&mut self) -> u32 {
        self.scratch
    }

    fn keep(&mut self, word: u32) {
        self.scratch = word;
    }
}

impl Store for Chip {
    type Error = FlashError;

    fn sector_len(&self) -> u32 {
        self.flash.sector_len()
    }

    fn read(&mut self, sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), FlashError> {
        self.flash.read(sector, offset, out)
    }

    fn write(&mut self, sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        self.flash.write(sector, offset, bytes)
    }

    fn erase(&mut self, sector: Sector) -> Result<(), FlashError> {
        self.flash.erase(sector)
    }
}
