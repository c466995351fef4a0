//! The ADG2128: a crosspoint of 12 by 8 switches, set over I2C.

use crate::amplifier::Amplifier;
use embedded_hal::i2c::I2c;
use firmware::{ErrorKind, ErrorType, Route, Router, Sense};

/// The address of a chip with its three address pins low; they add 0 to 7.
pub const FIRST_ADDRESS: u8 = 0x70;
/// Electrodes on the lines X0 to X11 of each chip.
pub const ELECTRODES_A_CHIP: u8 = 12;

/// What is on the lines Y0 to Y3 of every chip: drive +, drive -, sense +, sense -.
const LINES: usize = 4;

/// A router of `CHIPS` ADG2128 with their lines Y0 to Y3 joined: drive +, drive -, sense +, sense -. Electrode n is on
/// line X(n modulo 12) of chip n / 12.
///
/// A change opens all four switches before it closes one; a switch is a message of three bytes, 75 us at 400 kHz. A route
/// takes up to eight, 0.6 ms: plans need three periods to settle and more.
#[derive(Debug)]
pub struct Crosspoint<I, A, const CHIPS: usize> {
    bus: I,
    amplifier: A,
    addresses: [u8; CHIPS],
    /// The electrode on each line; `None` where none is known to be: the lines are cleared before they are used.
    connected: Option<[Option<u8>; LINES]>,
}

impl<I: I2c, A: Amplifier, const CHIPS: usize> Crosspoint<I, A, CHIPS> {
    /// On this bus, the chips at these addresses.
    pub fn new(bus: I, amplifier: A, addresses: [u8; CHIPS]) -> Self {
        Self {
            bus,
            amplifier,
            addresses,
            // The chips do not restart when the processor does.
            connected: None,
        }
    }

    /// Electrodes that it has.
    pub fn electrodes(&self) -> u8 {
        ELECTRODES_A_CHIP.saturating_mul(CHIPS as u8)
    }

    /// Connects nothing: for [`firmware::Excitation::switch_off`].
    ///
    /// # Errors
    /// The bus reported one. What is connected is unknown then, and the next call opens every switch.
    pub fn release(&mut self) -> Result<(), ErrorKind> {
        let known = self.connected.take();
        for line in 0..LINES {
            match known {
                Some(electrodes) => {
                    if let Some(electrode) = electrodes.get(line).copied().flatten() {
                        self.set(electrode, line, false)?;
                    }
                }
                None => {
                    for electrode in 0..self.electrodes() {
                        self.set(electrode, line, false)?;
                    }
                }
            }
        }
        self.connected = Some([None; LINES]);
        Ok(())
    }

    /// One switch (Analog Devices, ADG2128 data sheet, "Writing to the ADG2128" and its table of addresses). First byte:
    /// closed or open, four bits of X, three of Y. The codes of X leave out 6 and 7. Second byte: the switch changes now.
    fn set(&mut self, electrode: u8, line: usize, closed: bool) -> Result<(), ErrorKind> {
        let (chip, x) = (electrode / ELECTRODES_A_CHIP, electrode % ELECTRODES_A_CHIP);
        let address = self.addresses.get(usize::from(chip)).ok_or(ErrorKind::Route)?;
        let x = if x < 6 { x } else { x + 2 };
        let word = u8::from(closed) << 7 | x << 3 | line as u8;
        self.bus.write(*address, &[word, 1]).map_err(|_| ErrorKind::Route)
    }
}

impl<I, A, const CHIPS: usize> ErrorType for Crosspoint<I, A, CHIPS> {
    type Error = ErrorKind;
}

impl<I: I2c, A: Amplifier, const CHIPS: usize> Router for Crosspoint<I, A, CHIPS> {
    fn select(&mut self, route: &Route) -> Result<(), ErrorKind> {
        let drive = [Some(route.drive.plus), Some(route.drive.minus)];
        let sense = match route.sense {
            Sense::One(pair) => [Some(pair.plus), Some(pair.minus)],
            Sense::Source => [None, None],
            Sense::All { .. } => return Err(ErrorKind::Route),
        };
        let wanted = [drive[0], drive[1], sense[0], sense[1]];
        if wanted.into_iter().flatten().any(|e| e >= self.electrodes()) {
            return Err(ErrorKind::Route);
        }
        self.release()?;
        let amplified = if sense[0].is_some() {
            self.amplifier.set_gain(route.gain)
        } else {
            self.amplifier.look_at_source()
        };
        if !amplified.map_err(|_| ErrorKind::Route)? {
            return Err(ErrorKind::Route);
        }
        // Until all are closed, what is connected is not known.
        self.connected = None;
        for (line, electrode) in wanted.into_iter().enumerate() {
            if let Some(electrode) = electrode {
                self.set(electrode, line, true)?;
            }
        }
        self.connected = Some(wanted);
        Ok(())
    }
}
