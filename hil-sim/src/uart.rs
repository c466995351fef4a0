//! The board's serial port: 1 Mbit/s, ten bits a byte, with a transmit buffer that a DMA channel empties.

use crate::clock::{Clock, TICKS_PER_SAMPLE, TIMER_HZ};
use embedded_hal_nb::serial;
use std::collections::VecDeque;

/// Bit rate of the link.
const BAUD: u64 = 1_000_000;
/// Timer ticks that a byte is on the wire: start bit, eight bits, stop bit.
const BYTE_TICKS: u64 = TIMER_HZ as u64 * 10 / BAUD;
/// Bytes that the transmitter takes ahead.
const TRANSMIT_BYTES: u64 = 64;
/// Bytes that the receiver holds; what comes while it is full is lost.
const RECEIVE_BYTES: usize = 512;

/// Both directions of the link, seen from the board through `embedded-hal` and from outside through
/// [`Uart::transmit`] and [`Uart::receive`].
#[derive(Debug)]
pub struct Uart {
    clock: Clock,
    /// Bytes from the board and when each has left, in timer ticks.
    out: VecDeque<(u64, u8)>,
    out_busy_until: u64,
    /// What the board receives, and when each has arrived.
    input: VecDeque<(u64, Result<u8, serial::ErrorKind>)>,
    input_busy_until: u64,
}

impl Uart {
    /// An idle link.
    pub fn new(clock: Clock) -> Self {
        Self {
            clock,
            out: VecDeque::new(),
            out_busy_until: 0,
            input: VecDeque::new(),
            input_busy_until: 0,
        }
    }

    fn now_ticks(&self) -> u64 {
        self.clock.now() * u64::from(TICKS_PER_SAMPLE)
    }

    /// Puts bytes on the wire to the board; they arrive one after the other from now on.
    pub fn transmit(&mut self, bytes: &[u8]) {
        let now = self.now_ticks();
        for byte in bytes {
            self.input_busy_until = self.input_busy_until.max(now) + BYTE_TICKS;
            self.input.push_back((self.input_busy_until, Ok(*byte)));
        }
    }

    /// Holds the wire to the board at 0 from now on: to a receiver a byte of zeros without a stop bit.
    pub fn transmit_break(&mut self) {
        self.transmit(&[0]);
        let error = Err(serial::ErrorKind::FrameFormat);
        self.input.push_back((self.input_busy_until, error));
    }

    /// Takes the bytes from the board that have left it by now, oldest first.
    pub fn receive(&mut self, mut take: impl FnMut(u8)) {
        let now = self.now_ticks();
        let left = self.out.partition_point(|(left, _)| *left <= now);
        for (_, byte) in self.out.drain(..left) {
            take(byte);
        }
    }

    /// Whether no byte is under way in either direction.
    pub fn is_idle(&self) -> bool {
        self.out.is_empty() && self.input.is_empty()
    }
}

impl serial::ErrorType for Uart {
    type Error = serial::ErrorKind;
}

impl serial::Read for Uart {
    fn read(&mut self) -> nb::Result<u8, serial::ErrorKind> {
        let now = self.now_ticks();
        let arrived = self.input.partition_point(|(at, _)| *at <= now);
        if arrived > RECEIVE_BYTES {
            self.input.drain(RECEIVE_BYTES..arrived);
            return Err(nb::Error::Other(serial::ErrorKind::Overrun));
        }
        if arrived == 0 {
            return Err(nb::Error::WouldBlock);
        }
        let first = self.input.pop_front();
        let (_, received) = first.ok_or(nb::Error::WouldBlock)?;
        received.map_err(nb::Error::Other)
    }
}

impl serial::Write for Uart {
    fn write(&mut self, byte: u8) -> nb::Result<(), serial::ErrorKind> {
        let now = self.now_ticks();
        let start = self.out_busy_until.max(now);
        if start - now >= TRANSMIT_BYTES * BYTE_TICKS {
            return Err(nb::Error::WouldBlock);
        }
        self.out_busy_until = start + BYTE_TICKS;
        self.out.push_back((self.out_busy_until, byte));
        Ok(())
    }

    fn flush(&mut self) -> nb::Result<(), serial::ErrorKind> {
        if self.out_busy_until > self.now_ticks() {
            return Err(nb::Error::WouldBlock);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{samples, seconds};
    use serial::{Read, Write};

    #[test]
    fn a_second_carries_a_hundred_thousand_bytes() {
        let clock = Clock::new();
        let mut uart = Uart::new(clock.clone());
        let mut count = 0u32;
        while seconds(clock.now()) < 1.0 {
            while uart.write(0x55).is_ok() {}
            uart.receive(|_| count += 1);
            clock.advance(16);
        }
        assert!((99_970..=100_000).contains(&count), "{count}");
    }

    #[test]
    fn a_command_takes_its_time_to_arrive() {
        let clock = Clock::new();
        let mut uart = Uart::new(clock.clone());
        uart.transmit(&[1, 2, 3]);
        assert_eq!(uart.read(), Err(nb::Error::WouldBlock));
        // 10 us each; the clock counts 17 us.
        clock.advance(samples(21e-6) + 1);
        assert_eq!((uart.read(), uart.read()), (Ok(1), Ok(2)));
        assert_eq!(uart.read(), Ok(3));
        assert!(uart.is_idle());
    }

    #[test]
    fn a_receiver_that_nobody_empties_says_that_it_lost_bytes() {
        let clock = Clock::new();
        let mut uart = Uart::new(clock.clone());
        uart.transmit(&[7; 600]);
        clock.advance(samples(0.1));
        assert_eq!(uart.read(), Err(nb::Error::Other(serial::ErrorKind::Overrun)));
        let mut kept = 0;
        while uart.read().is_ok() {
            kept += 1;
        }
        assert_eq!(kept, 512);
    }
}
