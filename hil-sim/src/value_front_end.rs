//! The firmware's front-end traits on simulated electronics, at the level of values: no samples, but where only these tell.

use crate::analog::lock_in::LockIn;
use crate::analog::{Analog, Routing};
use crate::clock::{PERIOD_SAMPLES, QUARTER_SAMPLES};
use crate::electronics::Electronics;
use crate::electronics_error::ElectronicsError;
use crate::front_end::SimFrontEndError;
use crate::wiring::Wiring;
use firmware::{
    Block, Detect, ErrorType, Excitation, Folded, MAX_CHANNELS, Rails, Reading, Route, Router, ScanError, Sense,
    Window, full_scale,
};
use forward::ElectrodeMatrix;

/// Front end of a simulated board whose sheet stands still. A window's phasors come at once, by the law that [`crate::SimFrontEnd`]
/// follows sample by sample; tests hold the two against each other. Where there is no such law (a converter that is no straight
/// line, ideal electronics without noise, an end of the range) the window's samples are made and folded.
#[derive(Debug)]
pub struct ValueFrontEnd {
    analog: Analog,
    lock_in: LockIn,
    wiring: Wiring,
    seen: ElectrodeMatrix,
    now: u64,
    excited: bool,
    route: Option<Route>,
    routing: Routing,
    open: Option<Window>,
    samples: Vec<u16>,
    sampled: u64,
}

impl ValueFrontEnd {
    /// A front end at power-up, on this sheet.
    ///
    /// # Errors
    /// As for [`Electronics::validate`].
    pub fn new(electronics: Electronics, sheet: ElectrodeMatrix) -> Result<Self, ElectronicsError> {
        let analog = Analog::new(electronics, 0)?;
        Ok(Self {
            lock_in: LockIn::new(&analog),
            analog,
            wiring: Wiring::default(),
            seen: sheet,
            now: 0,
            excited: false,
            route: None,
            routing: Routing::default(),
            open: None,
            samples: Vec::new(),
            sampled: 0,
        })
    }

    /// Samples since power-up.
    pub fn now(&self) -> u64 {
        self.now
    }

    /// Windows so far whose samples were made, since no law told their values.
    pub fn sampled_windows(&self) -> u64 {
        self.sampled
    }

    /// Puts another sheet below, with what is broken from here on.
    pub(crate) fn put(&mut self, matrix: &ElectrodeMatrix, wiring: Wiring) -> Result<(), SimFrontEndError> {
        self.seen = wiring.seen(matrix);
        self.wiring = wiring;
        self.routing.amplitude_v = self.amplitudes_v()?;
        self.wire();
        Ok(())
    }

    fn amplitudes_v(&self) -> Result<[f64; MAX_CHANNELS], SimFrontEndError> {
        match &self.route {
            Some(route) if self.excited => self
                .analog
                .amplitudes_v(&self.seen, &self.wiring.routed(route), &self.wiring.broken(route))
                .map(|amplitudes| amplitudes.map(|v| v * self.wiring.source_part()))
                .ok_or(SimFrontEndError::Route(*route)),
            _ => Ok([0.0; MAX_CHANNELS]),
        }
    }

    fn wire(&mut self) {
        let Some(route) = &self.route else { return };
        let scale = if self.excited { self.wiring.source_part() } else { 0.0 };
        let broken = self.wiring.broken(route);
        self.analog.route(
            &mut self.routing,
            &self.seen,
            &self.wiring.routed(route),
            &broken,
            scale,
        );
    }

    fn drive(&mut self) -> Result<(), SimFrontEndError> {
        let amplitudes = self.amplitudes_v()?;
        self.routing = self.analog.driven(self.now, &self.routing, amplitudes);
        self.wire();
        Ok(())
    }

    /// Makes the samples of a window and folds them.
    fn fold(&mut self, first: u64, window: Window, seen: &mut Folded) -> Result<(), ScanError<SimFrontEndError>> {
        self.sampled += 1;
        let channels = usize::from(window.channels).clamp(1, MAX_CHANNELS);
        let full_scale = full_scale(self.analog.electronics().code_bits());
        for period in 0..u64::from(window.periods) {
            let time = first + period * PERIOD_SAMPLES;
            self.samples.resize(channels * PERIOD_SAMPLES as usize, 0);
            for (time, row) in (time..).zip(self.samples.chunks_exact_mut(channels)) {
                self.analog.sample(time, &self.routing, row);
                self.wiring.spoil(row, full_scale);
            }
            seen.add(&Block {
                samples: &self.samples,
                channels: window.channels,
                sequence: period as u32,
                time,
                rails: Rails::Unknown,
            })
            .map_err(ScanError::Block)?;
        }
        Ok(())
    }
}

impl ErrorType for ValueFrontEnd {
    type Error = SimFrontEndError;
}

impl Router for ValueFrontEnd {
    fn select(&mut self, route: &Route) -> Result<(), SimFrontEndError> {
        let electrodes = self.seen.electrodes();
        let known = |p: protocol::Pair| usize::from(p.plus) < electrodes && usize::from(p.minus) < electrodes;
        let sense = match route.sense {
            Sense::One(pair) => known(pair),
            Sense::All { .. } => electrodes <= MAX_CHANNELS,
            Sense::Source => true,
        };
        if !known(route.drive) || !sense {
            return Err(SimFrontEndError::Route(*route));
        }
        self.route = Some(*route);
        let amplitudes = self.amplitudes_v()?;
        self.routing = self.analog.switched(self.now, &self.routing, amplitudes);
        self.wire();
        Ok(())
    }
}

impl Excitation for ValueFrontEnd {
    fn switch_on(&mut self) -> Result<(), SimFrontEndError> {
        self.excited = true;
        self.drive()
    }

    fn set_amplitude(&mut self, permille: u16) -> Result<(), SimFrontEndError> {
        self.analog.set_amplitude(permille.min(1000));
        self.drive()
    }

    fn switch_off(&mut self) -> Result<(), SimFrontEndError> {
        self.excited = false;
        self.drive()
    }
}

impl Detect for ValueFrontEnd {
    const SAMPLED: bool = false;

    fn begin(&mut self, window: Window) -> Result<(), SimFrontEndError> {
        self.open = Some(window);
        Ok(())
    }

    fn detect(&mut self, seen: &mut Folded) -> nb::Result<u64, ScanError<SimFrontEndError>> {
        let window = self.open.take().ok_or(nb::Error::WouldBlock)?;
        let settled = self.now / QUARTER_SAMPLES + u64::from(window.settle_quarters);
        let first = settled.max(self.now.div_ceil(QUARTER_SAMPLES)) * QUARTER_SAMPLES;
        let mut readings = [Reading::default(); MAX_CHANNELS];
        let readings = &mut readings[..usize::from(window.channels).clamp(1, MAX_CHANNELS)];
        let told = !self.wiring.spoils()
            && self
                .analog
                .readings(&mut self.lock_in, (first, window.periods), &self.routing, readings);
        if told {
            seen.put(readings, window.periods).map_err(ScanError::Block)?;
        } else {
            self.fold(first, window, seen)?;
        }
        self.now = first + u64::from(window.periods) * PERIOD_SAMPLES;
        Ok(first)
    }
}
