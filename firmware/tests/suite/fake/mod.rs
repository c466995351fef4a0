//! The smallest front end that keeps every promise: a sine of known amplitude for every route, in its own time.
#![allow(dead_code, reason = "each test uses its own part")]

pub(crate) mod analyser;

use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use embedded_hal_nb::serial;
use firmware::{
    Block, Capture, Clock, ErrorKind, ErrorType, Excitation, QUARTER_SAMPLES, Rails, Route, Router, SAMPLES_PER_PERIOD,
    Scratch, Sector, Sense, Store, Watchdog, Window,
};
use protocol::Pair;
use std::collections::VecDeque;
use std::rc::Rc;

pub(crate) const ELECTRODES: u8 = 16;

/// The fake's timer, and how much later each channel is sampled than the one before.
pub(crate) const TICKS_PER_SAMPLE: u32 = 1425;
pub(crate) const SKEW_TICKS: u16 = 60;

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
    /// Half a quarter period is missing from each block.
    Cut,
    /// One block more than asked for.
    Surplus,
    /// Lost samples are not mentioned.
    Silent,
    /// The excitation is the other way round.
    Reversed,
    /// After lost samples the source runs a step ahead.
    Ahead,
    /// No block ever comes.
    Mute,
}

/// Amplitude in codes that the source shows on the fake at full scale; it fits [`SOURCE_GAIN_MILLI`].
pub(crate) const SOURCE: f64 = 1636.1;
pub(crate) const SOURCE_GAIN_MILLI: u32 = 586;

/// A front end whose clock moves a quarter period each time somebody polls in vain.
pub(crate) struct Fake {
    pub now: u64,
    pub on: bool,
    /// Thousandths of the amplitude.
    pub permille: u16,
    /// What the source really does, over what it is told.
    pub source: f64,
    /// How much later than it should the source steps, samples.
    pub source_late: f64,
    /// The clock of the chip, if it is to go with the samples.
    pub clock: Rc<Cell<u64>>,
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
            permille: 1000,
            source: 1.0,
            source_late: 0.0,
            clock: Rc::default(),
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

    fn pass(&mut self, samples: u64) {
        self.now += samples;
        self.clock.set(self.now);
    }

    fn sample(&self, time: u64, channel: u8) -> u16 {
        let mut value = self.offset;
        if let (true, Some(route)) = (self.on, self.route) {
            let signal = match route.sense {
                Sense::Source => SOURCE * self.source,
                Sense::One(pair) => amplitude(route.drive, pair),
                Sense::All { step } => {
                    let plus = (channel + step) % ELECTRODES;
                    amplitude(route.drive, Pair { plus, minus: channel })
                }
            };
            let sign = if self.flaw == Some(Flaw::Reversed) { -1.0 } else { 1.0 };
            let late = f64::from(channel) * f64::from(SKEW_TICKS) / f64::from(TICKS_PER_SAMPLE);
            let angle = core::f64::consts::TAU * (time as f64 + late - self.source_late) / SAMPLES_PER_PERIOD as f64;
            value += sign * signal * f64::from(self.permille) / 1000.0 * angle.sin();
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

    fn set_amplitude(&mut self, permille: u16) -> Result<(), ErrorKind> {
        self.permille = permille;
        Ok(())
    }

    fn switch_off(&mut self) -> Result<(), ErrorKind> {
        self.on = false;
        Ok(())
    }
}

impl Capture for Fake {
    fn begin(&mut self, window: Window) -> Result<(), ErrorKind> {
        let n = QUARTER_SAMPLES as u64;
        let settle = match self.flaw {
            Some(Flaw::Hasty) => 0,
            _ => u64::from(window.settle_quarters),
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
        let quarter = QUARTER_SAMPLES as u64;
        let flaw = |f| self.flaw == Some(f);
        let (mute, silent, cut, skips, repeats) = (
            flaw(Flaw::Mute),
            flaw(Flaw::Silent),
            flaw(Flaw::Cut),
            flaw(Flaw::Skips),
            flaw(Flaw::Repeats),
        );
        let Some((start, periods, channels)) = self.open.filter(|_| !mute) else {
            self.pass(quarter);
            return Err(nb::Error::WouldBlock);
        };
        // Blocks of two periods where there are two left, to be different from other implementors.
        let length = n * u64::from(periods.min(2));
        if self.now < start + length {
            self.pass(quarter);
            return Err(nb::Error::WouldBlock);
        }
        if self.now >= start + length + 4 * n && !silent {
            self.open = None;
            self.source_late -= f64::from(u8::from(flaw(Flaw::Ahead)));
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
            samples.truncate(samples.len() - QUARTER_SAMPLES / 2 * usize::from(channels));
        }
        let result = f(&Block {
            samples: &samples,
            channels,
            sequence: self.sequence,
            time: start,
            rails: Rails::Unknown,
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

/// A chip whose clock stands still unless it is given the front end's, with a store in memory.
#[derive(Clone)]
pub(crate) struct Chip {
    pub clock: Rc<Cell<u64>>,
    pub fed: u32,
    pub store: [Vec<u8>; 2],
    /// Whether the store fails.
    pub broken: bool,
    /// The word that outlives a reset.
    pub scratch: u32,
}

impl Chip {
    pub(crate) fn new() -> Self {
        Self {
            clock: Rc::default(),
            fed: 0,
            store: [vec![0xFF; 2048], vec![0xFF; 2048]],
            broken: false,
            scratch: 0,
        }
    }

    fn part(&mut self, sector: Sector, offset: u32, len: usize) -> Result<&mut [u8], ErrorKind> {
        if self.broken {
            return Err(ErrorKind::Other);
        }
        let start = offset as usize;
        self.store[sector as usize]
            .get_mut(start..start + len)
            .ok_or(ErrorKind::Other)
    }
}

impl Clock for Chip {
    fn now(&mut self) -> u64 {
        self.clock.get()
    }
}

impl Watchdog for Chip {
    fn feed(&mut self) {
        self.fed += 1;
    }
}

impl Scratch for Chip {
    fn recall(&mut self) -> u32 {
        self.scratch
    }

    fn keep(&mut self, word: u32) {
        self.scratch = word;
    }
}

impl Store for Chip {
    type Error = ErrorKind;

    fn sector_len(&self) -> u32 {
        self.store[0].len() as u32
    }

    fn read(&mut self, sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), ErrorKind> {
        let part = self.part(sector, offset, out.len())?;
        out.copy_from_slice(part);
        Ok(())
    }

    fn write(&mut self, sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), ErrorKind> {
        self.part(sector, offset, bytes.len())?.copy_from_slice(bytes);
        Ok(())
    }

    fn erase(&mut self, sector: Sector) -> Result<(), ErrorKind> {
        self.part(sector, 0, 2048)?.fill(0xFF);
        Ok(())
    }
}
