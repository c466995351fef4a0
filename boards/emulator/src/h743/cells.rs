//! Memory with check bits, which rigless's flash memory has not: two sectors for the settings, behind the chip's own.
//!
//! A word of 32 bytes whose writing was cut off reads as a bus fault, and so does every word of a sector whose erasure was.
//! The program's feature `emulated-check-bits` puts the settings here. All else of it is the program that is flashed.

use crate::world::locked;
use rigless::device::{DeviceContext, ErasedDevice, RegisterFile, RequestChange};
use rigless::soc::{RegisterSpec, Width};
use rigless::time::EventId;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};

/// First address, and bytes of each of the two sectors.
pub const BASE: u64 = 0x0820_0000;
pub const SECTOR_LEN: u64 = 128 * 1024;
/// Bytes that are written at once.
pub const WORD_LEN: u64 = 32;
/// Sectors.
const COUNT: u64 = 2;
/// Bytes of both.
pub const LEN: u64 = COUNT * SECTOR_LEN;

/// What the controller and the cells share.
#[derive(Debug)]
pub(super) struct State {
    bytes: Vec<u8>,
    /// A word that is not whole yet: its bytes and how many they are.
    buffer: [u8; WORD_LEN as usize],
    filled: usize,
    /// Offsets of the words that read as a bus fault.
    broken: BTreeSet<u64>,
    /// Whether the controller writes.
    pub(super) programming: bool,
    /// Steps begun since power came, and how many the power lasts for.
    pub(super) steps: usize,
    pub(super) power: usize,
}

/// The same for both.
pub(super) type Shared = Arc<Mutex<State>>;

impl Default for State {
    fn default() -> Self {
        Self {
            bytes: vec![0xFF; LEN as usize],
            buffer: [0xFF; WORD_LEN as usize],
            filled: 0,
            broken: BTreeSet::new(),
            programming: false,
            steps: 0,
            power: usize::MAX,
        }
    }
}

impl State {
    /// Whether the power is there.
    pub(super) fn powered(&self) -> bool {
        self.steps <= self.power
    }

    /// Begins a step; whether the power lasts for it.
    pub(super) fn step(&mut self) -> bool {
        self.steps += 1;
        self.powered()
    }

    /// From here on these bytes are there, every word whole; false if the address is another memory's.
    pub(super) fn place(&mut self, address: u64, bytes: &[u8]) -> bool {
        let Some(start) = address.checked_sub(BASE).map(|o| o as usize) else {
            return false;
        };
        let Some(there) = self.bytes.get_mut(start..start + bytes.len()) else {
            return false;
        };
        there.copy_from_slice(bytes);
        let placed = start as u64..(start + bytes.len()) as u64;
        self.broken.retain(|word| !placed.contains(word));
        true
    }

    /// What is there, if the addresses are these cells'.
    pub(super) fn read(&self, address: u64, len: usize) -> Option<Vec<u8>> {
        let start = address.checked_sub(BASE)? as usize;
        Some(self.bytes.get(start..start + len)?.to_vec())
    }

    /// Addresses of the words that read as a bus fault.
    pub(super) fn broken(&self) -> BTreeSet<u64> {
        self.broken.iter().map(|offset| BASE + offset).collect()
    }

    /// Erases a sector, or begins to: without power, what of it was written is neither what it was nor erased.
    pub(super) fn erase(&mut self, sector: u64, whole: bool) {
        let words = (sector * SECTOR_LEN..(sector + 1) * SECTOR_LEN).step_by(WORD_LEN as usize);
        for word in words {
            let Some(bytes) = self.bytes.get_mut(word as usize..(word + WORD_LEN) as usize) else {
                return;
            };
            if whole {
                bytes.fill(0xFF);
                self.broken.remove(&word);
            } else if bytes.iter().any(|b| *b != 0xFF) {
                bytes.iter_mut().step_by(2).for_each(|b| *b |= 0x5A);
                self.broken.insert(word);
            }
        }
    }

    fn write(&mut self, offset: u64, width: Width, value: u64) {
        if !self.programming || !self.powered() {
            return;
        }
        for (k, byte) in value.to_le_bytes().iter().take(width.bytes() as usize).enumerate() {
            if let Some(place) = self.buffer.get_mut((offset as usize + k) % WORD_LEN as usize) {
                *place = *byte;
                self.filled += 1;
            }
        }
        if self.filled < WORD_LEN as usize {
            return;
        }
        self.filled = 0;
        let whole = self.step();
        let word = offset / WORD_LEN * WORD_LEN;
        let Some(bytes) = self.bytes.get_mut(word as usize..(word + WORD_LEN) as usize) else {
            return;
        };
        // Writing clears bits; half of them when the power goes. A word that is written over has wrong check bits as well.
        let erased = bytes.iter().all(|b| *b == 0xFF);
        for (k, (there, new)) in bytes.iter_mut().zip(&self.buffer).enumerate() {
            *there &= if whole || k % 2 == 0 { *new } else { 0xFF };
        }
        if !(whole && erased) {
            self.broken.insert(word);
        }
    }
}

/// The cells as a part of the chip.
#[derive(Debug)]
pub(super) struct Cells {
    pub(super) state: Shared,
    /// The registers of its slot, none: rigless compares where the list is.
    pub(super) layout: &'static [RegisterSpec],
}

impl ErasedDevice for Cells {
    fn layout(&self) -> &'static [RegisterSpec] {
        self.layout
    }

    fn read(&mut self, _: usize, _: &mut RegisterFile, _: &mut DeviceContext<'_>) -> Option<u64> {
        None
    }

    fn write(&mut self, _: usize, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_event(&mut self, _: EventId, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_request(&mut self, _: RequestChange, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_clock(&mut self, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn poll(&mut self, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn reset(&mut self) {
        let mut state = locked(&self.state);
        (state.filled, state.programming) = (0, false);
    }

    fn on_access(&mut self, _: u64, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_refused(&mut self, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn read_window(&mut self, offset: u64, width: Width, _: &mut DeviceContext<'_>) -> u64 {
        let bytes = locked(&self.state).read(BASE + offset, width.bytes() as usize);
        let bytes = bytes.unwrap_or_default();
        bytes.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte))
    }

    fn write_window(&mut self, offset: u64, width: Width, value: u64, _: &mut DeviceContext<'_>) {
        locked(&self.state).write(offset, width, value);
    }
}
