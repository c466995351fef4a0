//! Flash memory of two sectors, whose power can be cut at any byte.

use firmware::{Sector, Store, Watchdog};
use thiserror::Error;

/// Why the memory did not do what it was told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum FlashError {
    /// Power is off, since the cut that was asked for.
    #[error("power was cut")]
    Cut,
    /// Beyond the end of a sector.
    #[error("byte {0} is beyond the end of the sector")]
    Range(u32),
    /// Written twice without erasing between: flash memory cannot set bits.
    #[error("byte {0} was written before")]
    Written(u32),
}

/// What a cut leaves of the byte that is being written, and of a sector that is being erased.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Torn {
    /// The byte as it was; of the sector the part behind is as it was.
    Before,
    /// Some of the byte's bits are written; the sector holds what looks like a wild mixture.
    Mixed,
    /// The byte is written; the sector is erased.
    After,
}

/// Two sectors of flash memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Flash {
    /// Content and, for each byte, whether it was written since it was erased.
    sectors: [Vec<(u8, bool)>; 2],
    /// Bytes that can still be written or erased before power is cut; `None`: it stays.
    left: Option<u64>,
    torn: Torn,
    /// Bits of a byte that stay 1 whatever is written.
    pub stuck: Option<(Sector, u32, u8)>,
    /// Power was cut.
    dead: bool,
    /// Bytes written or erased so far.
    worked: u64,
    /// Bytes read since its watchdog was fed, the most of them ever, and all.
    unfed: u64,
    longest_unfed: u64,
    read: u64,
}

impl Flash {
    /// Erased, with sectors of this many bytes.
    pub fn new(sector_len: u32) -> Self {
        let sector = vec![(0xFF, false); sector_len as usize];
        Self {
            sectors: [sector.clone(), sector],
            left: None,
            torn: Torn::Before,
            stuck: None,
            dead: false,
            worked: 0,
            unfed: 0,
            longest_unfed: 0,
            read: 0,
        }
    }

    /// Cuts power while the byte after so many more is being written or erased.
    pub fn cut_after(&mut self, bytes: u64, torn: Torn) {
        self.left = Some(bytes);
        self.torn = torn;
    }

    /// Power is back.
    pub fn power_on(&mut self) {
        self.left = None;
        self.dead = false;
    }

    /// Bytes written or erased so far.
    pub fn worked(&self) -> u64 {
        self.worked
    }

    /// Bytes read so far, and the most of them between two feeds of the watchdog.
    pub fn read_unfed(&self) -> (u64, u64) {
        (self.read, self.longest_unfed)
    }

    /// Whether there is power for another byte.
    fn power(&mut self) -> bool {
        self.worked += 1;
        match &mut self.left {
            None => {}
            Some(0) => self.dead = true,
            Some(left) => *left -= 1,
        }
        !self.dead
    }

    /// The sector, if there is power and it has these bytes.
    fn part(&mut self, sector: Sector, offset: u32, len: usize) -> Result<&mut [(u8, bool)], FlashError> {
        if self.dead {
            return Err(FlashError::Cut);
        }
        let start = offset as usize;
        self.sectors[sector as usize]
            .get_mut(start..start.saturating_add(len))
            .ok_or(FlashError::Range(offset))
    }
}

/// A memory by itself has no watchdog: this one counts what is read between two feeds.
impl Watchdog for Flash {
    fn feed(&mut self) {
        self.unfed = 0;
    }
}

impl Store for Flash {
    type Error = FlashError;

    fn sector_len(&self) -> u32 {
        self.sectors[0].len() as u32
    }

    fn read(&mut self, sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), FlashError> {
        self.read += out.len() as u64;
        self.unfed += out.len() as u64;
        self.longest_unfed = self.longest_unfed.max(self.unfed);
        let part = self.part(sector, offset, out.len())?;
        for (place, (byte, _)) in out.iter_mut().zip(part) {
            *place = *byte;
        }
        Ok(())
    }

    fn write(&mut self, sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let part = self.part(sector, offset, bytes.len())?;
        if let Some(k) = part.iter().position(|(_, written)| *written) {
            return Err(FlashError::Written(offset + k as u32));
        }
        for (at, byte) in (offset..).zip(bytes) {
            let powered = self.power();
            let torn = self.torn;
            let stuck = self.stuck.filter(|(s, offset, _)| (*s, *offset) == (sector, at));
            let byte = byte | stuck.map_or(0, |(.., bits)| bits);
            let place = &mut self.sectors[sector as usize][at as usize];
            *place = match (powered, torn) {
                (true, _) | (false, Torn::After) => (byte, true),
                (false, Torn::Before) => (0xFF, false),
                // Half of the bits that were to become 0 did so.
                (false, Torn::Mixed) => (byte | 0xAA, true),
            };
            if !powered {
                return Err(FlashError::Cut);
            }
        }
        Ok(())
    }

    fn erase(&mut self, sector: Sector) -> Result<(), FlashError> {
        let len = self.sector_len() as usize;
        self.part(sector, 0, 0)?;
        for at in 0..len {
            let powered = self.power();
            let torn = self.torn;
            let cells = &mut self.sectors[sector as usize];
            if powered {
                cells[at] = (0xFF, false);
                continue;
            }
            for (k, cell) in cells.iter_mut().enumerate().skip(at) {
                match torn {
                    Torn::Before => {}
                    Torn::Mixed => cell.0 |= (k as u8).wrapping_mul(73),
                    Torn::After => *cell = (0xFF, false),
                }
            }
            return Err(FlashError::Cut);
        }
        Ok(())
    }
}
