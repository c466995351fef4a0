//! The smallest front end that keeps every promise: a sine of known amplitude for every route, in its own time.
#![allow(dead_code, reason = "each test uses its own part")]

use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use embedded_hal_nb::serial;
use firmware::{Block, Capture, ErrorKind, ErrorType, Excitation, Route, Router, SAMPLES_PER_PERIOD, Sense, Window};
use protocol::Pair;
use std::collections::VecDeque;
use std::rc::Rc;

pub(crate) const ELECTRODES: u8 = 16;

/// Amplitude in codes that the fake shows for a drive and a sense pair; different for all of them.
pub(crate) fn amplitude(drive: Pair, sense: Pair) -> f64 {
    800.0 + 50.0 * f64::from(drive.plus) - 7.0 * f64::from(sense.minus)
}

/// A promise that the fake can be told to break.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Flaw {
    /// Blocks begin a sample late.
    Late,
    /// A block is left out.
    Skips,
    /// Two blocks have one number.
    Repeats,
    /// Settling is not waited for.
    Hasty,
    /// Half a period is missing from each block.
    Cut,
    /// One block more than asked for.
    Surplus,
    /// Lost samples are not mentioned.
    Silent,
    /// The excitation is the other way round.
    Reversed,
    /// No block ever comes.
    Mute,
}

/// A front end whose clock moves one period each time somebody polls in vain.
pub(crate) struct Fake {
    pub now: u64,
    pub on: bool,
    pub route: Option<Route>,
    pub log: Vec<Route>,
    /// Next poll, or select, fails with this.
    pub fault: Option<ErrorKind>,
    /// Added to every sample.
    pub offset: f64,
    pub flaw: Option<Flaw>,
    open: Option<(u64, u16, u8)>,
    sequence: u32,
    samples: Vec<u16>,
}

impl Fake {
    pub(crate) fn new() -> Self {
        Self {
            now: 0,
            on: false,
            route: None,
            log: Vec::new(),
            fault: None,
            offset: 2047.5,
            flaw: None,
            open: None,
            sequence: 0,
            samples: Vec::new(),
        }
    }

    fn sample(&self, time: u64, channel: u8) -> u16 {
        let mut value = self.offset;
        if let (true, Some(route)) = (self.on, self.route) {
            let sense = match route.sense {
                Sense::One(pair) => pair,
                Sense::All { step } => Pair {
                    plus: (channel + step) % ELECTRODES,
                    minus: channel,
                },
            };
            let sign = if self.flaw == Some(Flaw::Reversed) { -1.0 } else { 1.0 };
            let angle = core::f64::consts::TAU * time as f64 / SAMPLES_PER_PERIOD as f64;
            value += sign * amplitude(route.drive, sense) * angle.sin();
        }
        value.round().clamp(0.0, 4095.0) as u16
    }
}

impl ErrorType for Fake {
    type Error = ErrorKind;
}

impl Router for Fake {
    fn select(&mut self, route: &Route) -> Result<(), ErrorKind> {
        if self.fault == Some(ErrorKind::Route) {
            self.fault = None;
            return Err(ErrorKind::Route);
        }
        self.route = Some(*route);
        self.log.push(*route);
        Ok(())
    }
}

impl Excitation for Fake {
    fn switch_on(&mut self) -> Result<(), ErrorKind> {
        self.on = true;
        Ok(())
    }

    fn switch_off(&mut self) -> Result<(), ErrorKind> {
        self.on = false;
        Ok(())
    }
}

impl Capture for Fake {
    fn begin(&mut self, window: Window) -> Result<(), ErrorKind> {
        let n = SAMPLES_PER_PERIOD as u64;
        let settle = match self.flaw {
            Some(Flaw::Hasty) => 0,
            _ => u64::from(window.settle_periods),
        };
        let late = u64::from(self.flaw == Some(Flaw::Late));
        let surplus = u16::from(self.flaw == Some(Flaw::Surplus));
        let start = self.now.next_multiple_of(n) + settle * n + late;
        self.open = Some((start, window.periods + surplus, window.channels));
        Ok(())
    }

    fn poll_block<R>(&mut self, f: impl FnOnce(&Block<'_>) -> R) -> nb::Result<R, ErrorKind> {
        if let Some(kind) = self.fault.take() {
            self.open = None;
            return Err(nb::Error::Other(kind));
        }
        let n = SAMPLES_PER_PERIOD as u64;
        let flaw = |f| self.flaw == Some(f);
        let (mute, silent, cut, skips, repeats) = (
            flaw(Flaw::Mute),
            flaw(Flaw::Silent),
            flaw(Flaw::Cut),
            flaw(Flaw::Skips),
            flaw(Flaw::Repeats),
        );
        let Some((start, periods, channels)) = self.open.filter(|_| !mute) else {
            self.now += n;
            return Err(nb::Error::WouldBlock);
        };
        // Blocks of two periods where there are two left, to be different from other implementors.
        let length = n * u64::from(periods.min(2));
        if self.now < start + length {
            self.now += n;
            return Err(nb::Error::WouldBlock);
        }
        if self.now >= start + length + 4 * n && !silent {
            self.open = None;
            return Err(nb::Error::Other(ErrorKind::Overrun));
        }
        let mut samples = std::mem::take(&mut self.samples);
        samples.clear();
        for time in start..start + length {
            samples.extend((0..channels).map(|c| self.sample(time, c)));
        }
        let left = periods - periods.min(2);
        let gap = if skips { n } else { 0 };
        self.open = (left > 0).then_some((start + length + gap, left, channels));
        if cut {
            samples.truncate(samples.len() - SAMPLES_PER_PERIOD / 2 * usize::from(channels));
        }
        let result = f(&Block {
            samples: &samples,
            channels,
            sequence: self.sequence,
            time: start,
        });
        self.sequence += u32::from(!repeats);
        self.samples = samples;
        Ok(result)
    }
}

/// Both ends of a serial port in memory.
#[derive(Clone, Default)]
pub(crate) struct Wire {
    pub to_board: Rc<RefCell<VecDeque<u8>>>,
    pub from_board: Rc<RefCell<Vec<u8>>>,
    /// Bytes that the transmitter still takes; refill it to let the link go on.
    pub room: Rc<Cell<usize>>,
}

impl serial::ErrorType for Wire {
    type Error = Infallible;
}

impl serial::Read for Wire {
    fn read(&mut self) -> nb::Result<u8, Infallible> {
        self.to_board.borrow_mut().pop_front().ok_or(nb::Error::WouldBlock)
    }
}

impl serial::Write for Wire {
    fn write(&mut self, byte: u8) -> nb::Result<(), Infallible> {
        let room = self.room.get();
        if room == 0 {
            return Err(nb::Error::WouldBlock);
        }
        self.room.set(room - 1);
        self.from_board.borrow_mut().push(byte);
        Ok(())
    }

    fn flush(&mut self) -> nb::Result<(), Infallible> {
        Ok(())
    }
}
