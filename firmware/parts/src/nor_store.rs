//! Any flash memory with a driver for `embedded-storage` as the place for settings.

use embedded_storage::nor_flash::NorFlash;
use firmware::{Sector, Store};

/// The largest unit of reading and writing: 32 bytes, as the STM32H7 has.
const LARGEST: usize = 32;

/// Why a [`NorStore`] did not do what it was asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NorStoreError<E> {
    /// The memory reported an error.
    Flash(E),
    /// It is not in the sector, or not in whole units.
    Place,
}

/// What is wrong with the place of a [`NorStore`].
pub const WRONG_PLACE: &str =
    "the sectors must be whole erasable ones inside the memory, and its units at most 32 bytes";

/// Two sectors of a flash memory, one after the other.
///
/// A memory with error correction may refuse to read what a power cut left half written. Its driver has to give back
/// anything but 0xFF for that instead of an error; a record that is not whole is passed over.
#[derive(Debug)]
pub struct NorStore<F> {
    flash: F,
    start: u32,
    sector_len: u32,
}

impl<F: NorFlash> NorStore<F> {
    /// Two sectors of `sector_len` bytes each, from `start` on.
    ///
    /// # Errors
    /// [`WRONG_PLACE`].
    pub fn new(flash: F, start: u32, sector_len: u32) -> Result<Self, &'static str> {
        let erased = F::ERASE_SIZE as u32;
        let whole = |n: u32| erased > 0 && n.is_multiple_of(erased);
        let inside = sector_len
            .checked_mul(2)
            .and_then(|len| len.checked_add(start))
            .is_some_and(|end| end as usize <= flash.capacity());
        let units = |n: usize| (1..=LARGEST).contains(&n) && LARGEST.is_multiple_of(n);
        if sector_len == 0 || !whole(start) || !whole(sector_len) || !inside {
            return Err(WRONG_PLACE);
        }
        if !units(F::WRITE_SIZE) || !units(F::READ_SIZE) {
            return Err(WRONG_PLACE);
        }
        Ok(Self {
            flash,
            start,
            sector_len,
        })
    }

    /// The address of a stretch of a sector.
    fn place(&self, sector: Sector, offset: u32, len: usize) -> Result<u32, NorStoreError<F::Error>> {
        let end = u32::try_from(len).ok().and_then(|len| offset.checked_add(len));
        if end.is_none_or(|end| end > self.sector_len) {
            return Err(NorStoreError::Place);
        }
        let sector = match sector {
            Sector::A => self.start,
            Sector::B => self.start + self.sector_len,
        };
        Ok(sector + offset)
    }
}

impl<F: NorFlash> Store for NorStore<F> {
    type Error = NorStoreError<F::Error>;

    fn sector_len(&self) -> u32 {
        self.sector_len
    }

    fn write_len(&self) -> u32 {
        F::WRITE_SIZE as u32
    }

    fn read(&mut self, sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), Self::Error> {
        let mut at = self.place(sector, offset, out.len())?;
        let mut rest = out;
        // Through a buffer of whole units: the memory may read nothing smaller.
        while !rest.is_empty() {
            let skipped = at as usize % LARGEST;
            let mut buffer = [0; LARGEST];
            // Sectors are whole units, so that this does not leave them.
            let count = (LARGEST - skipped).min(rest.len());
            let units = (skipped + count).next_multiple_of(F::READ_SIZE);
            let part = buffer.get_mut(..units).ok_or(NorStoreError::Place)?;
            self.flash
                .read(at - skipped as u32, part)
                .map_err(NorStoreError::Flash)?;
            let (head, tail) = rest.split_at_mut(count);
            head.copy_from_slice(part.get(skipped..skipped + count).ok_or(NorStoreError::Place)?);
            rest = tail;
            at += count as u32;
        }
        Ok(())
    }

    fn write(&mut self, sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        let at = self.place(sector, offset, bytes.len())?;
        let whole = |n: usize| n.is_multiple_of(F::WRITE_SIZE);
        if !whole(at as usize) || !whole(bytes.len()) {
            return Err(NorStoreError::Place);
        }
        self.flash.write(at, bytes).map_err(NorStoreError::Flash)
    }

    fn erase(&mut self, sector: Sector) -> Result<(), Self::Error> {
        let from = self.place(sector, 0, self.sector_len as usize)?;
        self.flash
            .erase(from, from + self.sector_len)
            .map_err(NorStoreError::Flash)
    }
}
