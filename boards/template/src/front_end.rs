//! Switches, converter and source. Yours: the same switches on your pins; a timer that starts the converter and steps the
//! source with one pulse; DMA round a ring of samples.

use crate::pins::{Pin, Port};
use core::cell::Cell;
use core::convert::Infallible;
use embedded_hal::delay::DelayNs;
use firmware::{
    Block, Capture, ErrorKind, ErrorType, Excitation, FULL_SCALE, HALF, QUARTER_SAMPLES, Rails, Route, Router,
    SAMPLES_PER_PERIOD, SINE, Sense, Window,
};
use parts::{Fixed, Mux4067, Switches};

/// A 74HC4067 connects within 50 ns at 4.5 V and lets go within as many.
const DEAD_NS: u32 = 60;
/// Samples that the ring holds: four periods.
const RING: u64 = 4 * SAMPLES_PER_PERIOD as u64;
/// Codes of the source's amplitude at full scale on `Sense::Source`: 2.25 V * 0.5 of 3.3 V in 4095 codes.
const SOURCE_CODES: i64 = 1396;
/// And of the drive pair's own voltage, the gain being 1 and the switches 0 ohm, halved by the ring's middle.
const DRIVE_CODES: i64 = 1396;
const ELECTRODES: i64 = 16;

/// Waits by counting.
#[derive(Clone, Copy, Debug)]
pub struct Delay;

impl DelayNs for Delay {
    fn delay_ns(&mut self, ns: u32) {
        // 25 MHz: 40 ns a cycle.
        cortex_m::asm::delay(ns / 40 + 1);
    }
}

type Mux<'a> = Mux4067<Pin<'a>, Pin<'a>>;

/// A window that is being captured, in samples since power-up.
#[derive(Clone, Copy, Debug)]
struct Open {
    next: u64,
    end: u64,
}

/// The front end.
#[derive(Debug)]
pub struct FrontEnd<'a> {
    switches: Switches<Mux<'a>, Mux<'a>, Mux<'a>, Mux<'a>, Fixed, Delay>,
    port: &'a Port,
    time: &'a Cell<u64>,
    /// Whether the converter looks at the source itself.
    source: bool,
    on: bool,
    permille: u16,
    open: Option<Open>,
    sequence: u32,
}

/// The first pin of each multiplexer, drive +, drive -, sense +, sense -: four address lines and the enable line.
const PINS: [u8; 4] = [0, 5, 10, 15];

impl<'a> FrontEnd<'a> {
    /// On these pins, with nothing connected; `time` goes on with every poll.
    ///
    /// # Errors
    /// These pins have none.
    pub fn new(port: &'a Port, time: &'a Cell<u64>) -> Result<Self, Infallible> {
        let mux = |first: u8| {
            let address = core::array::from_fn(|k| port.pin(first + k as u8));
            Mux4067::new(address, port.pin(first + 4))
        };
        let [drive_plus, drive_minus, sense_plus, sense_minus] = PINS;
        Ok(Self {
            switches: Switches {
                drive_plus: mux(drive_plus)?,
                drive_minus: mux(drive_minus)?,
                sense_plus: mux(sense_plus)?,
                sense_minus: mux(sense_minus)?,
                amplifier: Fixed,
                delay: Delay,
                dead_ns: DEAD_NS,
            },
            port,
            time,
            source: false,
            on: false,
            permille: 1000,
            open: None,
            sequence: 0,
        })
    }

    /// Lets more time pass than the ring has room for.
    pub fn stall(&mut self) {
        self.time.set(self.time.get() + 3 * RING);
    }

    /// The electrode that a multiplexer connects, by the levels of its pins.
    fn electrode(&self, first: u8) -> Option<i64> {
        let levels = self.port.levels() >> first;
        (levels & 16 == 0).then_some(i64::from(levels & 15))
    }

    /// What the converter sees in phase with the source at full scale, codes: a ring of equal resistors between the
    /// electrodes, the drive's voltage falling evenly along both ways from one end to the other.
    fn amplitude(&self) -> i64 {
        let [drive_plus, drive_minus, sense_plus, sense_minus] = PINS.map(|first| self.electrode(first));
        if self.source {
            return SOURCE_CODES;
        }
        let (Some(from), Some(to), Some(plus), Some(minus)) = (drive_plus, drive_minus, sense_plus, sense_minus) else {
            return 0;
        };
        let way = (to - from).rem_euclid(ELECTRODES);
        // Of the voltage between the drive's ends, in parts of `way * (16 - way)`.
        let potential = |electrode: i64| {
            let along = (electrode - from).rem_euclid(ELECTRODES);
            if along <= way {
                (way - along) * (ELECTRODES - way)
            } else {
                (along - way) * way
            }
        };
        let all = way * (ELECTRODES - way);
        ((potential(plus) - potential(minus)) * DRIVE_CODES)
            .checked_div(all)
            .unwrap_or(0)
    }

    /// The converter's code at a time.
    fn code(&self, amplitude: i64, time: u64) -> u16 {
        let phase = (time % SAMPLES_PER_PERIOD as u64) as usize;
        let sine = SINE.get(phase % HALF).copied().map_or(0, i64::from);
        let sine = if phase < HALF { sine } else { -sine };
        let set = if self.on { i64::from(self.permille) } else { 0 };
        let code = i64::from(FULL_SCALE / 2) + amplitude * set / 1000 * sine / (1 << 30);
        code.clamp(0, FULL_SCALE.into()) as u16
    }
}

impl ErrorType for FrontEnd<'_> {
    type Error = ErrorKind;
}

impl Router for FrontEnd<'_> {
    fn select(&mut self, route: &Route) -> Result<(), ErrorKind> {
        self.source = route.sense == Sense::Source;
        self.switches.select(route)
    }
}

impl Excitation for FrontEnd<'_> {
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
        self.switches.release()
    }
}

impl Capture for FrontEnd<'_> {
    fn begin(&mut self, window: Window) -> Result<(), ErrorKind> {
        let quarter = QUARTER_SAMPLES as u64;
        let next = self.time.get().next_multiple_of(quarter) + u64::from(window.settle_quarters) * quarter;
        self.open = Some(Open {
            next,
            end: next + u64::from(window.periods) * SAMPLES_PER_PERIOD as u64,
        });
        Ok(())
    }

    fn poll_block<R>(&mut self, f: impl FnOnce(&Block<'_>) -> R) -> nb::Result<R, ErrorKind> {
        // Here a poll takes a quarter period. Yours asks the DMA controller how far it is.
        self.time.set(self.time.get() + QUARTER_SAMPLES as u64);
        let now = self.time.get();
        let Some(open) = self.open.filter(|open| open.next < open.end) else {
            return Err(nb::Error::WouldBlock);
        };
        if now > open.next + RING {
            self.open = None;
            return Err(nb::Error::Other(ErrorKind::Overrun));
        }
        let end = open.next + SAMPLES_PER_PERIOD as u64;
        if now < end {
            return Err(nb::Error::WouldBlock);
        }
        let (amplitude, mut samples) = (self.amplitude(), [0; SAMPLES_PER_PERIOD]);
        for (time, sample) in (open.next..).zip(&mut samples) {
            *sample = self.code(amplitude, time);
        }
        let block = Block {
            samples: &samples,
            channels: 1,
            sequence: self.sequence,
            time: open.next,
            rails: Rails::Unknown,
        };
        self.sequence = self.sequence.wrapping_add(1);
        self.open = Some(Open { next: end, ..open });
        Ok(f(&block))
    }
}
