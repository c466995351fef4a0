//! The flash memory's controller, before a step of which the power can be cut.
//!
//! A step is a word of 32 bytes that is written, or the erasure of a sector. Counting them makes a cut the same in every run,
//! however long a step takes.

use super::cells::Shared;
use crate::world::locked;
use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::Width;
use rigless::soc::stm32h743::generated::flash::{Register, cr2, sr2};
use rigless::soc::stm32h743::peripherals::flash::Flash;
use rigless::time::EventId;

/// Bytes that are written at once.
const WORD_LEN: u64 = 32;
/// The second bank, and a sector of it.
const BANK: u64 = 0x0810_0000;
const SECTOR_LEN: u64 = 128 * 1024;
/// Marks what this model itself writes.
const OWN: u64 = u64::MAX;

/// The controller.
#[derive(Debug)]
pub struct Memory {
    inner: Flash,
    /// Bytes of a word that is not whole yet.
    filled: u64,
    /// The memory with check bits, and the steps since power came of either.
    cells: Shared,
    /// What the memory holds from the program's first access to the controller on, if that is to be other than before.
    holds: Vec<(u64, Vec<u8>)>,
}

impl Memory {
    /// One without anything in it, which shares its power with these cells.
    pub(super) fn new(cells: Shared) -> Self {
        Self {
            inner: Flash::new(),
            filled: 0,
            cells,
            holds: Vec::new(),
        }
    }

    /// Power comes, and lasts for so many steps. The program finds this in the memory.
    pub fn power_for(&mut self, steps: usize, holds: Vec<(u64, Vec<u8>)>) {
        let mut cells = locked(&self.cells);
        (cells.steps, cells.power) = (0, steps);
        self.holds = holds.into_iter().filter(|(a, bytes)| !cells.place(*a, bytes)).collect();
    }

    /// Steps since power came, with the one that was cut off.
    pub fn steps(&self) -> usize {
        locked(&self.cells).steps
    }

    /// Whether the power is there.
    pub fn powered(&self) -> bool {
        locked(&self.cells).powered()
    }

    /// Begins a step, if the power lasts. Otherwise the program waits for its end until the run ends.
    fn step(&mut self, registers: &mut RegisterFile) -> bool {
        let powered = locked(&self.cells).step();
        if !powered {
            registers.set(Register::Sr2, sr2::QW2.mask());
        }
        powered
    }
}

impl Device for Memory {
    type Register = Register;

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        for (address, bytes) in self.holds.drain(..) {
            for (address, piece) in (address..).step_by(8).zip(bytes.as_chunks().0) {
                context.program(address, Width::W64, u64::from_le_bytes(*piece), OWN);
            }
        }
        if !self.powered() {
            return;
        }
        let control = registers.get(Register::Cr2);
        let erases = register == Register::Cr2 && cr2::SER2.is_set(control) && cr2::START2.is_set(control);
        if !erases || cr2::LOCK2.is_set(control) {
            self.inner.write(register, value, registers, context);
            let control = registers.get(Register::Cr2);
            locked(&self.cells).programming = cr2::PG2.is_set(control) && !cr2::LOCK2.is_set(control);
            return;
        }
        let powered = self.step(registers);
        locked(&self.cells).erase(cr2::SNB2.get(control), powered);
        if powered {
            // Over at once, as by the program that waits for its end: the second or so that it takes has nothing to show.
            let start = BANK + cr2::SNB2.get(control) * SECTOR_LEN;
            for address in (start..start + SECTOR_LEN).step_by(8) {
                context.program(address, Width::W64, u64::MAX, OWN);
            }
            registers.set(Register::Cr2, cr2::START2.set(control, 0));
            self.inner
                .write(register, cr2::START2.set(value, 0), registers, context);
        }
    }

    fn write_region(
        &mut self,
        address: u64,
        width: Width,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> bool {
        if !self.powered() {
            return true;
        }
        self.filled += u64::from(width.bytes());
        if self.filled >= WORD_LEN {
            self.filled = 0;
            if !self.step(registers) {
                return true;
            }
        }
        self.inner.write_region(address, width, value, registers, context)
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.powered() {
            self.inner.on_event(event, registers, context);
        }
    }

    fn on_access(&mut self, token: u64, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if token != OWN {
            self.inner.on_access(token, value, registers, context);
        }
    }

    fn on_refused(&mut self, token: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if token != OWN {
            self.inner.on_refused(token, registers, context);
        }
    }

    fn reset(&mut self) {
        Device::reset(&mut self.inner);
        self.filled = 0;
    }
}
