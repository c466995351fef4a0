//! What the emulated machine has of a chip's support: a clock that counts polls, and a word that no start clears. It has no
//! watchdog and keeps no settings.

use core::convert::Infallible;
use core::sync::atomic::{AtomicU32, Ordering};
use firmware::{Clock, Scratch, Sector, Store, Watchdog};

/// In memory that no start clears.
// SAFETY: the section holds variables that are not given a first value, which any word is good for.
#[unsafe(link_section = ".uninit.scratch")]
static SCRATCH: AtomicU32 = AtomicU32::new(0);

/// Clock, watchdog and store.
#[derive(Debug, Default)]
pub struct Chip {
    polls: u64,
}

impl Clock for Chip {
    /// Simulated time is the PC's and passes with the blocks. Here it only has to go on, slower than a block a poll.
    fn now(&mut self) -> u64 {
        self.polls += 1;
        self.polls
    }
}

impl Watchdog for Chip {
    fn feed(&mut self) {}
}

impl Scratch for Chip {
    fn recall(&mut self) -> u32 {
        SCRATCH.load(Ordering::Relaxed)
    }

    fn keep(&mut self, word: u32) {
        SCRATCH.store(word, Ordering::Relaxed);
    }
}

impl Store for Chip {
    type Error = Infallible;

    fn sector_len(&self) -> u32 {
        0
    }

    fn read(&mut self, _: Sector, _: u32, _: &mut [u8]) -> Result<(), Infallible> {
        Ok(())
    }

    fn write(&mut self, _: Sector, _: u32, _: &[u8]) -> Result<(), Infallible> {
        Ok(())
    }

    fn erase(&mut self, _: Sector) -> Result<(), Infallible> {
        Ok(())
    }
}
