//! A front end that measures amplitude and phase itself, as an impedance analyser's chip does: no samples, a result a window.

use super::{ELECTRODES, SOURCE, amplitude};
use core::cell::Cell;
use firmware::{
    Detect, ErrorKind, ErrorType, Excitation, Folded, QUARTER_SAMPLES, Reading, Route, Router, SAMPLES_PER_PERIOD,
    ScanError, Sense, Window,
};
use protocol::{Pair, Variance};
use std::rc::Rc;

/// A promise that the analyser can be told to break.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Broken {
    /// It does not wait for the settling.
    Unsettled,
    /// The result is there at once.
    Hasty,
    /// The result comes twice.
    Twice,
    /// It is of a channel less.
    Short,
    /// In-phase and quadrature are swapped.
    Turned,
    /// The amplitude does not follow the excitation.
    Fixed,
    /// No result ever comes.
    Mute,
}

/// Noise that every result tells.
pub(crate) const NOISE: Variance = Variance::new(40);

/// An analyser whose clock moves a quarter period each time somebody polls in vain.
pub(crate) struct Analyser {
    pub clock: Rc<Cell<u64>>,
    pub on: bool,
    pub permille: u16,
    pub route: Option<Route>,
    /// Added to every pair's amplitude, codes: a touch.
    pub touch: Rc<Cell<f64>>,
    /// Next poll fails with this.
    pub fault: Option<ErrorKind>,
    pub broken: Option<Broken>,
    /// When the window's first sample is taken, and how long it is.
    open: Option<(u64, Window)>,
}

impl Analyser {
    pub(crate) fn new() -> Self {
        Self {
            clock: Rc::default(),
            on: false,
            permille: 1000,
            route: None,
            touch: Rc::default(),
            fault: None,
            broken: None,
            open: None,
        }
    }

    /// Codes that a channel shows.
    fn codes(&self, channel: u8) -> f64 {
        let (true, Some(route)) = (self.on, self.route) else {
            return 0.0;
        };
        let full = match route.sense {
            Sense::Source => SOURCE,
            Sense::One(pair) => amplitude(route.drive, pair) + self.touch.get(),
            Sense::All { step } => {
                let plus = (channel + step) % ELECTRODES;
                amplitude(route.drive, Pair { plus, minus: channel }) + self.touch.get()
            }
        };
        let permille = if self.broken == Some(Broken::Fixed) {
            1000
        } else {
            self.permille
        };
        full * f64::from(permille) / 1000.0
    }

    fn reading(&self, channel: u8) -> Reading {
        let amplitude = (self.codes(channel) * f64::from(1 << 20)).round() as i32;
        let (in_phase, quadrature) = if self.broken == Some(Broken::Turned) {
            (0, amplitude)
        } else {
            (amplitude, 0)
        };
        Reading {
            in_phase,
            quadrature,
            noise: NOISE,
            clipped: false,
        }
    }
}

impl ErrorType for Analyser {
    type Error = ErrorKind;
}

impl Router for Analyser {
    fn select(&mut self, route: &Route) -> Result<(), ErrorKind> {
        self.route = Some(*route);
        Ok(())
    }
}

impl Excitation for Analyser {
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

impl Detect for Analyser {
    const SAMPLED: bool = false;

    fn begin(&mut self, window: Window) -> Result<(), ErrorKind> {
        let settle = match self.broken {
            Some(Broken::Unsettled) => 0,
            _ => u64::from(window.settle_quarters) * QUARTER_SAMPLES as u64,
        };
        self.open = Some((self.clock.get() + settle, window));
        Ok(())
    }

    fn detect(&mut self, seen: &mut Folded) -> nb::Result<u64, ScanError<ErrorKind>> {
        if let Some(kind) = self.fault.take() {
            self.open = None;
            return Err(nb::Error::Other(ScanError::FrontEnd(kind)));
        }
        let ready = |(start, window): &(u64, Window)| {
            let over = start + u64::from(window.periods) * SAMPLES_PER_PERIOD as u64;
            self.clock.get() >= over || self.broken == Some(Broken::Hasty)
        };
        let open = self.open.filter(ready).filter(|_| self.broken != Some(Broken::Mute));
        let Some((start, window)) = open else {
            self.clock.set(self.clock.get() + QUARTER_SAMPLES as u64);
            return Err(nb::Error::WouldBlock);
        };
        if self.broken != Some(Broken::Twice) {
            self.open = None;
        }
        let less = u8::from(self.broken == Some(Broken::Short));
        let readings: Vec<Reading> = (less..window.channels).map(|c| self.reading(c - less)).collect();
        seen.put(&readings, window.periods)
            .map_err(|e| nb::Error::Other(ScanError::Block(e)))?;
        Ok(start)
    }
}
