//! Time, watchdog, settings and a word that outlives a reset. Yours: a count of samples, the chip's watchdog, its flash
//! memory, memory that no start clears.

use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering};
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use firmware::{Clock, Scratch, Sector, Store, Watchdog};
use parts::{NorStore, NorStoreError};

/// In memory that no start clears; `cortex-m-rt` has such a section. A backup register does as well.
// SAFETY: the section holds variables that are not given a first value, which any word is good for.
#[unsafe(link_section = ".uninit.scratch")]
static SCRATCH: AtomicU32 = AtomicU32::new(0);

/// Bytes of a sector.
const SECTOR: usize = 1024;

/// A memory in units of eight bytes, erased a sector at a time, which forgets everything when it is switched off. Yours is
/// the one of your chip's HAL: whatever implements `NorFlash`.
#[derive(Debug)]
pub struct Ram([u8; 2 * SECTOR]);

impl Ram {
    /// Erased.
    pub const fn new() -> Self {
        Self([0xFF; 2 * SECTOR])
    }

    fn part(&mut self, offset: u32, len: usize) -> Result<&mut [u8], NorFlashErrorKind> {
        let part = self.0.get_mut(offset as usize..).and_then(|rest| rest.get_mut(..len));
        part.ok_or(NorFlashErrorKind::OutOfBounds)
    }
}

impl Default for Ram {
    fn default() -> Self {
        Self::new()
    }
}

impl ErrorType for Ram {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Ram {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        check_read(self, offset, bytes.len())?;
        bytes.copy_from_slice(self.part(offset, bytes.len())?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.len()
    }
}

impl NorFlash for Ram {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        check_erase(self, from, to)?;
        self.part(from, to as usize - from as usize)?.fill(0xFF);
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        check_write(self, offset, bytes.len())?;
        self.part(offset, bytes.len())?.copy_from_slice(bytes);
        Ok(())
    }
}

/// Clock, watchdog and store.
#[derive(Debug)]
pub struct Chip<'a> {
    time: &'a Cell<u64>,
    store: NorStore<&'a mut Ram>,
}

impl<'a> Chip<'a> {
    /// With this time, in samples since power-up, and this memory.
    ///
    /// # Errors
    /// [`parts::WRONG_PLACE`].
    pub fn new(time: &'a Cell<u64>, memory: &'a mut Ram) -> Result<Self, &'static str> {
        Ok(Self {
            time,
            store: NorStore::new(memory, 0, SECTOR as u32)?,
        })
    }
}

impl Clock for Chip<'_> {
    fn now(&mut self) -> u64 {
        self.time.get()
    }
}

impl Watchdog for Chip<'_> {
    /// The emulated machine's watchdog is not used. Yours is fed here.
    fn feed(&mut self) {}
}

impl Scratch for Chip<'_> {
    fn recall(&mut self) -> u32 {
        SCRATCH.load(Ordering::Relaxed)
    }

    fn keep(&mut self, word: u32) {
        SCRATCH.store(word, Ordering::Relaxed);
    }
}

impl Store for Chip<'_> {
    type Error = NorStoreError<NorFlashErrorKind>;

    fn sector_len(&self) -> u32 {
        self.store.sector_len()
    }

    fn write_len(&self) -> u32 {
        self.store.write_len()
    }

    fn read(&mut self, sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), Self::Error> {
        self.store.read(sector, offset, out)
    }

    fn write(&mut self, sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.store.write(sector, offset, bytes)
    }

    fn erase(&mut self, sector: Sector) -> Result<(), Self::Error> {
        self.store.erase(sector)
    }
}
