//! Outputs to the multiplexers. Yours are those of your chip's HAL: whatever implements `OutputPin`.

use core::cell::Cell;
use core::convert::Infallible;
use embedded_hal::digital::{ErrorType, OutputPin};

/// The levels of 32 pins.
#[derive(Debug, Default)]
pub struct Port(Cell<u32>);

impl Port {
    /// All low.
    pub const fn new() -> Self {
        Self(Cell::new(0))
    }

    /// A pin.
    pub fn pin(&self, number: u8) -> Pin<'_> {
        Pin { port: self, number }
    }

    /// The levels, a bit each.
    pub fn levels(&self) -> u32 {
        self.0.get()
    }
}

/// One pin.
#[derive(Debug)]
pub struct Pin<'a> {
    port: &'a Port,
    number: u8,
}

impl ErrorType for Pin<'_> {
    type Error = Infallible;
}

impl OutputPin for Pin<'_> {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.port.0.set(self.port.0.get() & !(1 << self.number));
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.port.0.set(self.port.0.get() | 1 << self.number);
        Ok(())
    }
}
