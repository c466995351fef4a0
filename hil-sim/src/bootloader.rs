//! A model of the bootloader in an STM32F4's ROM, from the board's side of the cable (ST's AN3155 and AN2606). It has the
//! faults of a cable, a chip and a person.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};

const ACK: u8 = 0x79;
const NACK: u8 = 0x1F;
const COMMANDS: [u8; 11] = [0x00, 0x01, 0x02, 0x11, 0x21, 0x31, 0x44, 0x63, 0x73, 0x82, 0x92];
/// First address of the flash memory.
const FLASH: u32 = 0x0800_0000;
const KIB: usize = 1024;

/// What is wrong with the board or its cable.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BootFaults {
    /// The cable is pulled after so many bytes in either direction.
    pub pulled_after: Option<u64>,
    /// Every so many bytes to the chip one bit of one is flipped (and its parity with it).
    pub flip_every: Option<u64>,
    /// The chip is protected against being read and written.
    pub protected: bool,
    /// A cell that does not take what is written: its address in flash memory, from 0.
    pub dead_cell: Option<usize>,
    /// The lines that reset the chip are not wired.
    pub unwired: bool,
}

/// What the bootloader waits for.
#[derive(Clone, Debug, PartialEq, Eq)]
enum State {
    /// The program runs, not the bootloader.
    Program,
    /// The byte that gives the bit rate.
    Sync,
    /// A command and its complement.
    Command,
    /// An address for a command.
    Address(u8),
    /// How many bytes to read from an address.
    Count(u32),
    /// What to write to an address.
    Data(u32),
    /// Which sectors to erase.
    Sectors,
}

/// A chip in or out of its bootloader, as a serial port. Reads fail with `TimedOut` at once when nothing is to come.
#[derive(Clone, Debug)]
pub struct BootRom {
    chip: u16,
    /// Its flash memory.
    pub flash: Vec<u8>,
    /// Sectors erased so far.
    pub erased: usize,
    faults: BootFaults,
    state: State,
    input: Vec<u8>,
    output: VecDeque<u8>,
    carried: u64,
    received: u64,
    boot: bool,
    held: bool,
}

impl BootRom {
    /// A chip of a number with so many KiB of flash memory, erased, running its program (which there is none).
    pub fn new(chip: u16, flash_kib: usize) -> Self {
        Self {
            chip,
            flash: vec![0xFF; flash_kib * KIB],
            erased: 0,
            faults: BootFaults::default(),
            state: State::Program,
            input: Vec::new(),
            output: VecDeque::new(),
            carried: 0,
            received: 0,
            boot: false,
            held: false,
        }
    }

    /// With these faults from now on; the cable is in again.
    pub fn with(mut self, faults: BootFaults) -> Self {
        self.faults = faults;
        self.carried = 0;
        self
    }

    /// A person holds BOOT0 high and presses the reset button.
    pub fn press_reset_in_bootloader(&mut self) {
        self.state = State::Sync;
        self.input.clear();
        self.output.clear();
    }

    /// Whether the program was started.
    pub fn runs_program(&self) -> bool {
        self.state == State::Program
    }

    /// BOOT0.
    pub fn boot_line(&mut self, high: bool) {
        self.boot = high;
    }

    /// The reset line: the chip starts when it is released.
    pub fn reset_line(&mut self, held: bool) {
        if self.faults.unwired {
            return;
        }
        if self.held && !held {
            self.state = if self.boot { State::Sync } else { State::Program };
            self.input.clear();
            self.output.clear();
        }
        self.held = held;
    }

    /// Throws away what was sent and not read.
    pub fn clear(&mut self) {
        self.output.clear();
    }

    /// The sector of an offset into flash memory, and where it begins and ends.
    fn sector(number: usize) -> std::ops::Range<usize> {
        match number {
            0..4 => number * 16 * KIB..(number + 1) * 16 * KIB,
            4 => 64 * KIB..128 * KIB,
            n => (n - 4) * 128 * KIB..(n - 3) * 128 * KIB,
        }
    }

    fn answer(&mut self, ok: bool) {
        self.output.push_back(if ok { ACK } else { NACK });
    }

    fn in_flash(&self, address: u32, len: usize) -> Option<std::ops::Range<usize>> {
        let start = address.checked_sub(FLASH)? as usize;
        (start + len <= self.flash.len()).then(|| start..start + len)
    }

    fn carry(&mut self) -> io::Result<()> {
        self.carried += 1;
        match self.faults.pulled_after {
            Some(after) if self.carried > after => Err(io::Error::new(ErrorKind::BrokenPipe, "the cable was pulled")),
            _ => Ok(()),
        }
    }

    fn take(&mut self, byte: u8) {
        let sum = |bytes: &[u8]| bytes.iter().fold(0, |s, b| s ^ b);
        self.input.push(byte);
        match self.state.clone() {
            State::Program => self.input.clear(),
            State::Sync => {
                self.input.clear();
                if byte == 0x7F {
                    self.answer(true);
                    self.state = State::Command;
                }
            }
            State::Command => {
                if let [command, complement] = self.input[..] {
                    self.input.clear();
                    self.command(command, complement);
                }
            }
            State::Address(command) => {
                if let [a, b, c, d, check] = self.input[..] {
                    self.input.clear();
                    let address = u32::from_be_bytes([a, b, c, d]);
                    let ok = sum(&[a, b, c, d]) == check && self.in_flash(address, 1).is_some();
                    self.answer(ok);
                    self.state = match command {
                        _ if !ok => State::Command,
                        0x11 => State::Count(address),
                        0x31 => State::Data(address),
                        _ => State::Program,
                    };
                }
            }
            State::Count(address) => {
                if let [count, complement] = self.input[..] {
                    self.input.clear();
                    self.state = State::Command;
                    let place = self.in_flash(address, usize::from(count) + 1);
                    match place.filter(|_| count == !complement) {
                        None => self.answer(false),
                        Some(place) => {
                            self.answer(true);
                            let bytes = self.flash[place].to_vec();
                            self.output.extend(bytes);
                        }
                    }
                }
            }
            State::Data(address) => {
                let len = usize::from(self.input[0]) + 1;
                if self.input.len() == len + 2 {
                    let message = std::mem::take(&mut self.input);
                    self.state = State::Command;
                    let place = self.in_flash(address, len);
                    let ok = sum(&message) == 0 && len.is_multiple_of(4) && address.is_multiple_of(4);
                    match place.filter(|_| ok) {
                        None => self.answer(false),
                        Some(place) => {
                            for (at, byte) in place.zip(&message[1..=len]) {
                                // Programming only clears bits.
                                if self.faults.dead_cell != Some(at) {
                                    self.flash[at] &= byte;
                                }
                            }
                            self.answer(true);
                        }
                    }
                }
            }
            State::Sectors => {
                if self.input.len() < 2 {
                    return;
                }
                let count = usize::from(u16::from_be_bytes([self.input[0], self.input[1]])) + 1;
                if count > 0xFFF0 {
                    // A mass erase, which this program never asks for; the model takes its sum and refuses.
                    if self.input.len() == 3 {
                        self.input.clear();
                        self.state = State::Command;
                        self.answer(false);
                    }
                } else if self.input.len() == 2 + 2 * count + 1 {
                    let message = std::mem::take(&mut self.input);
                    self.state = State::Command;
                    let ok = sum(&message) == 0;
                    for pair in message[2..2 + 2 * count].chunks_exact(2).filter(|_| ok) {
                        let sector = Self::sector(usize::from(u16::from_be_bytes([pair[0], pair[1]])));
                        if sector.end <= self.flash.len() {
                            self.flash[sector].fill(0xFF);
                            self.erased += 1;
                        }
                    }
                    self.answer(ok);
                }
            }
        }
    }

    fn command(&mut self, command: u8, complement: u8) {
        let known = command == !complement && COMMANDS.contains(&command);
        let barred = self.faults.protected && matches!(command, 0x11 | 0x21 | 0x31 | 0x44);
        self.answer(known && !barred);
        if !known || barred {
            return;
        }
        match command {
            0x00 => {
                self.output.push_back(COMMANDS.len() as u8);
                self.output.push_back(0x31);
                self.output.extend(COMMANDS);
                self.answer(true);
            }
            0x02 => {
                self.output.push_back(1);
                self.output.extend(self.chip.to_be_bytes());
                self.answer(true);
            }
            0x11 | 0x21 | 0x31 => self.state = State::Address(command),
            0x44 => self.state = State::Sectors,
            _ => {}
        }
    }
}

impl Read for BootRom {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let Some(place) = buffer.first_mut() else {
            return Ok(0);
        };
        let Some(byte) = self.output.pop_front() else {
            // A byte lost on the way leaves the chip waiting for the rest of a message; it never times out by itself.
            return Err(ErrorKind::TimedOut.into());
        };
        self.carry()?;
        *place = byte;
        Ok(1)
    }
}

impl Write for BootRom {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        for byte in bytes {
            self.carry()?;
            self.received += 1;
            let flipped = self.faults.flip_every.is_some_and(|n| self.received.is_multiple_of(n));
            self.take(if flipped { byte ^ 0x10 } else { *byte });
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
