//! The ADG731: 32 inputs, set over SPI.

use crate::multiplexer::Multiplexer;
use embedded_hal::spi::SpiDevice;

/// Bit 7 of the word, "EN": high opens all switches. Bit 6, "CS", is low, or the word would be passed over. Bits 4 to 0
/// are the input (Analog Devices, ADG725/ADG731 data sheet: input shift register and truth table).
const OPEN: u8 = 1 << 7;
const INPUTS: u8 = 32;

/// An ADG731. It takes a word of eight bits on falling edges of the clock: SPI mode 1, at most 30 MHz. It has no output to
/// pass words on. Several on one bus need a select line each, which is what a `SpiDevice` has.
#[derive(Debug)]
pub struct Adg731<S> {
    spi: S,
    input: u8,
}

impl<S: SpiDevice> Adg731<S> {
    /// On this bus, with nothing connected.
    ///
    /// # Errors
    /// The bus reported one.
    pub fn new(spi: S) -> Result<Self, S::Error> {
        let mut this = Self { spi, input: 0 };
        this.open()?;
        Ok(this)
    }
}

impl<S: SpiDevice> Multiplexer for Adg731<S> {
    type Error = S::Error;

    fn inputs(&self) -> u8 {
        INPUTS
    }

    fn open(&mut self) -> Result<(), S::Error> {
        self.spi.write(&[OPEN])
    }

    fn address(&mut self, input: u8) -> Result<(), S::Error> {
        // Nothing is sent yet: the word that names an input connects it.
        self.input = input % INPUTS;
        Ok(())
    }

    fn close(&mut self) -> Result<(), S::Error> {
        self.spi.write(&[self.input])
    }
}
