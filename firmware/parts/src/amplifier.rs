//! Amplifiers whose gain is set over SPI.

use core::fmt::Debug;
use embedded_hal::spi::SpiDevice;

/// What is between the switches and the converter.
pub trait Amplifier {
    /// The error.
    type Error: Debug;

    /// Sets the gain by its number in the board's table ([`firmware::BoardInfo::gains_milli`]), and looks at the sense
    /// pair. False where there is no such gain.
    ///
    /// # Errors
    /// It could not be set.
    fn set_gain(&mut self, number: u8) -> Result<bool, Self::Error>;

    /// Looks at the source itself ([`firmware::Sense::Source`]). False where it cannot.
    ///
    /// # Errors
    /// It could not be set.
    fn look_at_source(&mut self) -> Result<bool, Self::Error>;
}

/// An amplifier of one gain, number 0, on a board where the converter's own inputs choose between it and the source.
#[derive(Clone, Copy, Debug, Default)]
pub struct Fixed;

impl Amplifier for Fixed {
    type Error = core::convert::Infallible;

    fn set_gain(&mut self, number: u8) -> Result<bool, Self::Error> {
        Ok(number == 0)
    }

    fn look_at_source(&mut self) -> Result<bool, Self::Error> {
        Ok(true)
    }
}

/// What an amplifier with an input selector is set to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    /// The gain's code, 0 to 7: its place in the part's table.
    pub gain: u8,
    /// The input, 0 to 9.
    pub channel: u8,
}

/// A PGA112, PGA113, PGA116 or PGA117 (Texas Instruments SBOS424, section "SPI commands"): SPI mode 0 or 3, 10 MHz.
#[derive(Debug)]
pub struct Pga11x<S, const GAINS: usize> {
    spi: S,
    gains: [Setting; GAINS],
    source: Option<Setting>,
}

impl<S, const GAINS: usize> Pga11x<S, GAINS> {
    /// Gains by their codes: of the PGA112 and the PGA116.
    pub const BINARY: [u16; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
    /// Of the PGA113 and the PGA117.
    pub const SCOPE: [u16; 8] = [1, 2, 5, 10, 20, 50, 100, 200];

    /// With these settings for the board's gains, and one for the source where the part can see it.
    pub fn new(spi: S, gains: [Setting; GAINS], source: Option<Setting>) -> Self {
        Self { spi, gains, source }
    }
}

impl<S: SpiDevice, const GAINS: usize> Pga11x<S, GAINS> {
    fn set(&mut self, setting: Option<Setting>) -> Result<bool, S::Error> {
        /// "Write": gain in the upper half of the second byte, input in its lower half.
        const WRITE: u8 = 0x2A;
        let Some(Setting { gain, channel }) = setting else {
            return Ok(false);
        };
        self.spi.write(&[WRITE, gain << 4 | channel & 15])?;
        Ok(true)
    }
}

impl<S: SpiDevice, const GAINS: usize> Amplifier for Pga11x<S, GAINS> {
    type Error = S::Error;

    fn set_gain(&mut self, number: u8) -> Result<bool, S::Error> {
        self.set(self.gains.get(usize::from(number)).copied())
    }

    fn look_at_source(&mut self) -> Result<bool, S::Error> {
        self.set(self.source)
    }
}

/// An MCP6S21, MCP6S22, MCP6S26 or MCP6S28 (Microchip DS21117, sections 5.1 to 5.3): SPI mode 0 or 3, 10 MHz.
#[derive(Debug)]
pub struct Mcp6s2x<S, const GAINS: usize> {
    spi: S,
    gains: [Setting; GAINS],
    source: Option<Setting>,
}

impl<S, const GAINS: usize> Mcp6s2x<S, GAINS> {
    /// Gains by their codes.
    pub const TABLE: [u16; 8] = [1, 2, 4, 5, 8, 10, 16, 32];

    /// As [`Pga11x::new`].
    pub fn new(spi: S, gains: [Setting; GAINS], source: Option<Setting>) -> Self {
        Self { spi, gains, source }
    }
}

impl<S: SpiDevice, const GAINS: usize> Mcp6s2x<S, GAINS> {
    fn set(&mut self, setting: Option<Setting>) -> Result<bool, S::Error> {
        /// Instruction bytes: "write to register", gain or channel.
        const GAIN: u8 = 0x40;
        const CHANNEL: u8 = 0x41;
        let Some(Setting { gain, channel }) = setting else {
            return Ok(false);
        };
        // The part takes one register each time that it is selected.
        self.spi.write(&[GAIN, gain & 7])?;
        self.spi.write(&[CHANNEL, channel & 7])?;
        Ok(true)
    }
}

impl<S: SpiDevice, const GAINS: usize> Amplifier for Mcp6s2x<S, GAINS> {
    type Error = S::Error;

    fn set_gain(&mut self, number: u8) -> Result<bool, S::Error> {
        self.set(self.gains.get(usize::from(number)).copied())
    }

    fn look_at_source(&mut self) -> Result<bool, S::Error> {
        self.set(self.source)
    }
}
