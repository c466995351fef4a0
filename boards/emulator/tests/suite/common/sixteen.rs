//! What the tests of the board with sixteen channels share.

use super::sheet;
use emulator::h743::world::World;
use firmware::{Sector, Store, Watchdog};
use hil_sim::Electronics;

/// The converters are calibrated one after the other before the board says who it is.
pub(crate) const AWAKE_NS: u64 = 60_000_000;
/// The board as the simulator knows it.
pub(crate) fn electronics() -> Electronics {
    Electronics::drawn_sixteen()
}

pub(crate) fn world() -> World {
    World::new(electronics(), sheet())
}

/// The settings' two sectors, as far as they are used.
pub(crate) const SECTORS: [u64; 2] = [0x0810_0000, 0x0812_0000];
pub(crate) const SECTOR_LEN: usize = 16 * 1024;
/// What the memory writes at once.
pub(crate) const WORD_LEN: usize = 32;

/// Both sectors in process, written in whole words, each once after it was erased; and what they held after each step.
#[derive(Clone)]
pub(crate) struct Words {
    pub(crate) sectors: [Vec<u8>; 2],
    pub(crate) steps: Vec<[Vec<u8>; 2]>,
}

impl Words {
    pub(crate) fn holding(sectors: [Vec<u8>; 2]) -> Self {
        Self {
            sectors,
            steps: Vec::new(),
        }
    }

    pub(crate) fn erased() -> Self {
        Self::holding([0, 1].map(|_| vec![0xFF; SECTOR_LEN]))
    }

    /// What a run read back.
    pub(crate) fn read_back(memory: &[Vec<u8>]) -> Self {
        Self::holding([memory[0].clone(), memory[1].clone()])
    }

    /// Where each sector is, and what it holds.
    pub(crate) fn placed(&self) -> Vec<(u64, Vec<u8>)> {
        SECTORS.into_iter().zip(self.sectors.clone()).collect()
    }
}

impl Watchdog for Words {
    fn feed(&mut self) {}
}

impl Store for Words {
    type Error = ();

    fn sector_len(&self) -> u32 {
        SECTOR_LEN as u32
    }

    fn write_len(&self) -> u32 {
        WORD_LEN as u32
    }

    fn read(&mut self, sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), ()> {
        let part = self.sectors[sector as usize].get(offset as usize..).ok_or(())?;
        out.copy_from_slice(part.get(..out.len()).ok_or(())?);
        Ok(())
    }

    fn write(&mut self, sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), ()> {
        // A word at a time, as the library gives them.
        assert_eq!((offset as usize % WORD_LEN, bytes.len()), (0, WORD_LEN));
        let place = &mut self.sectors[sector as usize][offset as usize..][..WORD_LEN];
        assert!(place.iter().all(|b| *b == 0xFF), "a word is written twice");
        place.copy_from_slice(bytes);
        self.steps.push(self.sectors.clone());
        Ok(())
    }

    fn erase(&mut self, sector: Sector) -> Result<(), ()> {
        self.sectors[sector as usize].fill(0xFF);
        self.steps.push(self.sectors.clone());
        Ok(())
    }
}
