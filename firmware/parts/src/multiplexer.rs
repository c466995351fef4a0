//! Multiplexers with address lines.

use core::fmt::Debug;
use embedded_hal::digital::OutputPin;

/// A switch between one of several inputs and a common wire, set in three steps so that a caller can let time pass
/// between them: open, address, closed. Duties: at most one input is ever connected, and none between `open` and `close`.
pub trait Multiplexer {
    /// The error.
    type Error: Debug;

    /// Inputs, numbered from 0.
    fn inputs(&self) -> u8;

    /// Connects nothing.
    ///
    /// # Errors
    /// It could not be set; what is connected is unknown.
    fn open(&mut self) -> Result<(), Self::Error>;

    /// Chooses an input below [`inputs`](Multiplexer::inputs), to be connected by `close`. It is open.
    ///
    /// # Errors
    /// As [`open`](Multiplexer::open).
    fn address(&mut self, input: u8) -> Result<(), Self::Error>;

    /// Connects the input that was chosen.
    ///
    /// # Errors
    /// As [`open`](Multiplexer::open).
    fn close(&mut self) -> Result<(), Self::Error>;
}

/// A multiplexer with `LINES` address lines, the lowest first, and an enable line: low connects.
///
/// Truth tables: Nexperia 74HC4051 table 3, 74HC4067 table 3; of the same kind are ADG706, ADG1606 and MUX36S16, whose
/// enable is high: give them an inverted pin.
#[derive(Debug)]
pub struct LineMux<A, E, const LINES: usize> {
    address: [A; LINES],
    enable: E,
}

/// Eight inputs.
pub type Mux4051<A, E> = LineMux<A, E, 3>;
/// Sixteen inputs.
pub type Mux4067<A, E> = LineMux<A, E, 4>;

impl<P, E, const LINES: usize> LineMux<P, E, LINES>
where
    P: OutputPin,
    E: OutputPin<Error = P::Error>,
{
    /// On these pins, with nothing connected.
    ///
    /// # Errors
    /// The enable pin cannot be set.
    pub fn new(address: [P; LINES], enable: E) -> Result<Self, P::Error> {
        let mut this = Self { address, enable };
        this.open()?;
        Ok(this)
    }
}

impl<P, E, const LINES: usize> Multiplexer for LineMux<P, E, LINES>
where
    P: OutputPin,
    E: OutputPin<Error = P::Error>,
{
    type Error = P::Error;

    fn inputs(&self) -> u8 {
        1 << LINES
    }

    fn open(&mut self) -> Result<(), P::Error> {
        self.enable.set_high()
    }

    fn address(&mut self, input: u8) -> Result<(), P::Error> {
        for (k, pin) in self.address.iter_mut().enumerate() {
            pin.set_state((input >> k & 1 == 1).into())?;
        }
        Ok(())
    }

    fn close(&mut self) -> Result<(), P::Error> {
        self.enable.set_low()
    }
}

/// Two multiplexers with their common wires joined: the first one's inputs, then the second one's. They may share their
/// address lines only where both are given the same ones.
#[derive(Debug)]
pub struct Joined<A, B> {
    first: A,
    second: B,
    in_second: bool,
}

impl<A, B> Joined<A, B>
where
    A: Multiplexer,
    B: Multiplexer<Error = A::Error>,
{
    /// Of these two, which are open.
    pub fn new(first: A, second: B) -> Self {
        Self {
            first,
            second,
            in_second: false,
        }
    }
}

impl<A, B> Multiplexer for Joined<A, B>
where
    A: Multiplexer,
    B: Multiplexer<Error = A::Error>,
{
    type Error = A::Error;

    fn inputs(&self) -> u8 {
        self.first.inputs().saturating_add(self.second.inputs())
    }

    fn open(&mut self) -> Result<(), A::Error> {
        // Both, whatever happens to one.
        let first = self.first.open();
        self.second.open().and(first)
    }

    fn address(&mut self, input: u8) -> Result<(), A::Error> {
        match input.checked_sub(self.first.inputs()) {
            None => {
                self.in_second = false;
                self.first.address(input)
            }
            Some(input) => {
                self.in_second = true;
                self.second.address(input)
            }
        }
    }

    fn close(&mut self) -> Result<(), A::Error> {
        if self.in_second {
            self.second.close()
        } else {
            self.first.close()
        }
    }
}
