//! The firmware's front-end traits on simulated electronics and a simulated sheet.

use crate::analog::{Analog, Routing};
use crate::clock::{Clock, PERIOD_SAMPLES, QUARTER_SAMPLES, samples};
use crate::electronics::Electronics;
use crate::electronics_error::ElectronicsError;
use crate::noise::{mix, unit};
use crate::scene_time::SceneTime;
use crate::sheet::SheetModel;
use crate::timeline::Timeline;
use crate::wiring::Wiring;
use firmware::{
    Block, Capture, Error, ErrorKind, ErrorType, Excitation, MAX_CHANNELS, Rails, Route, Router, Window, full_scale,
};
use forward::{ElectrodeMatrix, ForwardError};
use thiserror::Error as ThisError;

/// Periods that the front end holds before it loses samples: as many as two halves of a DMA buffer, and two to spare.
const ROOM_PERIODS: u64 = 4;

/// How often the sheet is looked at unless it is told otherwise, s. A finger that moves at 50 mm/s goes 1 mm in this time.
/// Longer makes touches jump, shorter costs a solution each time.
const SHEET_S: f64 = 0.02;

/// What can go wrong in the simulated front end.
#[derive(Clone, Debug, PartialEq, ThisError)]
pub enum SimFrontEndError {
    /// Samples were not fetched in time.
    #[error("samples were overwritten before they were fetched")]
    Overrun,
    /// A gain or electrode that the board has not.
    #[error("the route {0:?} does not exist on this board")]
    Route(Route),
    /// The sheet cannot be simulated.
    #[error(transparent)]
    Sheet(#[from] ForwardError),
    /// Such electronics cannot be.
    #[error(transparent)]
    Electronics(#[from] ElectronicsError),
}

impl Error for SimFrontEndError {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::Overrun => ErrorKind::Overrun,
            Self::Route(_) => ErrorKind::Route,
            Self::Sheet(_) | Self::Electronics(_) => ErrorKind::Other,
        }
    }
}

/// A window that is being captured.
#[derive(Clone, Copy, Debug)]
struct Open {
    /// First sample of the next block.
    next: u64,
    /// Samples of each channel still to lend.
    left: u64,
    channels: usize,
}

/// Front end of a simulated board. Blocks are one period long, from whatever quarter of it a window begins at; where the
/// capture buffer, two periods long, turns over, a block is cut in two.
#[derive(Debug)]
pub struct SimFrontEnd<S> {
    analog: Analog,
    sheet: S,
    faults: Timeline,
    /// That of the sheet and of the faults.
    time: SceneTime,
    /// What is broken, until when that holds, and the sheet as the wires see it.
    wiring: Wiring,
    wiring_until_s: f64,
    seen: ElectrodeMatrix,
    clock: Clock,
    /// Whether a poll without a complete block lets a sample's time pass.
    self_clocked: bool,
    /// What the electrodes see now, and which look at the sheet it is from.
    matrix: ElectrodeMatrix,
    look: u64,
    /// Samples between two looks.
    look_samples: u64,
    excited: bool,
    route: Option<Route>,
    routing: Routing,
    open: Option<Open>,
    sequence: u32,
    block: Vec<u16>,
    conversions: u64,
}

impl<S: SheetModel> SimFrontEnd<S> {
    /// A front end at power-up: no route, excitation off.
    ///
    /// # Errors
    /// The sheet cannot be simulated.
    pub fn new(electronics: Electronics, sheet: S, clock: Clock) -> Result<Self, SimFrontEndError> {
        Self::powered_up(
            Analog::new(electronics, 0)?,
            sheet,
            clock,
            Timeline::default(),
            SceneTime::default(),
        )
    }

    /// A front end at power-up with faults to come.
    pub(crate) fn powered_up(
        analog: Analog,
        mut sheet: S,
        clock: Clock,
        faults: Timeline,
        time: SceneTime,
    ) -> Result<Self, SimFrontEndError> {
        let matrix = sheet.electrode_matrix(time.at(analog.true_s(clock.now())))?.clone();
        Ok(Self {
            analog,
            sheet,
            faults,
            time,
            wiring: Wiring::default(),
            wiring_until_s: f64::NEG_INFINITY,
            seen: matrix.clone(),
            clock,
            self_clocked: false,
            matrix,
            look: 0,
            look_samples: samples(SHEET_S),
            excited: false,
            route: None,
            routing: Routing::default(),
            open: None,
            sequence: 0,
            block: Vec::new(),
            conversions: 0,
        })
    }

    /// Lets a sample's time pass at every poll without a complete block, for callers that wait by polling.
    pub fn self_clocked(mut self) -> Self {
        self.self_clocked = true;
        self
    }

    /// Looks at the sheet every so many samples, 1 or more.
    pub fn looking_every(mut self, samples: u64) -> Self {
        self.look_samples = samples.max(1);
        self
    }

    /// Puts another sheet below that does not change, with what is broken from here on.
    pub(crate) fn put(&mut self, matrix: &ElectrodeMatrix, wiring: Wiring) -> Result<(), SimFrontEndError> {
        self.look_samples = u64::MAX;
        self.look = 0;
        self.matrix.clone_from(matrix);
        self.seen = wiring.seen(matrix);
        self.wiring = wiring;
        self.wiring_until_s = f64::INFINITY;
        self.routing.amplitude_v = self.amplitudes_v()?;
        self.wire();
        Ok(())
    }

    /// Samples converted for the windows so far; a board may rest its converter while there is none.
    pub fn conversions(&self) -> u64 {
        self.conversions
    }

    /// The electrodes that the sheet has.
    pub fn electrodes(&self) -> usize {
        self.matrix.electrodes()
    }

    /// The sheet.
    pub fn sheet(&self) -> &S {
        &self.sheet
    }

    /// Amplitudes of the present route, with the excitation as it is.
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

    /// Looks at the sheet and at what is broken again if the time has come. A touch is slow: its change is no switching, and
    /// what breaks finds the signal where it is.
    fn look(&mut self, time: u64) -> Result<(), SimFrontEndError> {
        let interval = self.look_samples;
        let look = time / interval;
        let mut changed = false;
        if look != self.look {
            self.look = look;
            let matrix = self
                .sheet
                .electrode_matrix(self.time.at(self.analog.true_s(look * interval)))?;
            if *matrix != self.matrix {
                self.matrix = matrix.clone();
                changed = true;
            }
        }
        let time_s = self.time.at(self.analog.true_s(time));
        if time_s >= self.wiring_until_s {
            self.wiring_until_s = self.faults.next_change_s(time_s);
            let wiring = Wiring::of(self.faults.active(time_s));
            changed |= wiring != self.wiring;
            self.wiring = wiring;
        }
        if changed {
            self.seen = self.wiring.seen(&self.matrix);
            self.routing.amplitude_v = self.amplitudes_v()?;
            self.wire();
        }
        Ok(())
    }

    /// What the present route has besides its amplitudes.
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

    /// Connects the route that is now set, with a transient.
    fn switch(&mut self) -> Result<(), SimFrontEndError> {
        let now = self.clock.now();
        self.look(now)?;
        let amplitudes = self.amplitudes_v()?;
        self.routing = self.analog.switched(now, &self.routing, amplitudes);
        self.wire();
        Ok(())
    }

    /// Lets the channels follow a source that is now set otherwise.
    fn drive(&mut self) -> Result<(), SimFrontEndError> {
        let now = self.clock.now();
        self.look(now)?;
        let amplitudes = self.amplitudes_v()?;
        self.routing = self.analog.driven(now, &self.routing, amplitudes);
        self.wire();
        Ok(())
    }

    /// Whether the samples of a block are lost, at the rate that a fault gives.
    fn overrun(&self, time: u64) -> bool {
        let chance = || {
            unit(mix(
                mix(self.analog.electronics().seed ^ 0x0FE4) ^ self.analog.absolute(time)
            ))
        };
        self.wiring.overrun > 0.0 && chance() <= self.wiring.overrun
    }
}

impl<S> ErrorType for SimFrontEnd<S> {
    type Error = SimFrontEndError;
}

impl<S: SheetModel> Router for SimFrontEnd<S> {
    fn select(&mut self, route: &Route) -> Result<(), SimFrontEndError> {
        let electrodes = self.electrodes();
        let known = |p: protocol::Pair| usize::from(p.plus) < electrodes && usize::from(p.minus) < electrodes;
        let sense = match route.sense {
            firmware::Sense::One(pair) => known(pair),
            firmware::Sense::All { .. } => electrodes <= MAX_CHANNELS,
            firmware::Sense::Source => true,
        };
        if !known(route.drive) || !sense {
            return Err(SimFrontEndError::Route(*route));
        }
        self.route = Some(*route);
        self.switch()
    }
}

impl<S: SheetModel> Excitation for SimFrontEnd<S> {
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

impl<S: SheetModel> Capture for SimFrontEnd<S> {
    fn begin(&mut self, window: Window) -> Result<(), SimFrontEndError> {
        let now = self.clock.now();
        let settled = now / QUARTER_SAMPLES + u64::from(window.settle_quarters);
        let first = settled.max(now.div_ceil(QUARTER_SAMPLES)) * QUARTER_SAMPLES;
        self.open = Some(Open {
            next: first,
            left: u64::from(window.periods) * PERIOD_SAMPLES,
            channels: usize::from(window.channels).min(MAX_CHANNELS),
        });
        Ok(())
    }

    fn poll_block<R>(&mut self, f: impl FnOnce(&Block<'_>) -> R) -> nb::Result<R, SimFrontEndError> {
        let now = self.clock.now();
        let length = |o: &Open| {
            let turns_over = 2 * PERIOD_SAMPLES - o.next % (2 * PERIOD_SAMPLES);
            PERIOD_SAMPLES.min(o.left).min(turns_over)
        };
        let ready = self.open.filter(|o| o.left > 0 && now >= o.next + length(o));
        let Some(open) = ready else {
            if self.self_clocked {
                self.clock.advance(1);
            }
            return Err(nb::Error::WouldBlock);
        };
        let length = length(&open);
        if now >= open.next + (1 + ROOM_PERIODS) * PERIOD_SAMPLES {
            self.open = None;
            return Err(nb::Error::Other(SimFrontEndError::Overrun));
        }
        self.look(open.next)?;
        if self.overrun(open.next) {
            self.open = None;
            return Err(nb::Error::Other(SimFrontEndError::Overrun));
        }
        self.block.resize(open.channels * length as usize, 0);
        for (time, row) in (open.next..).zip(self.block.chunks_exact_mut(open.channels.max(1))) {
            self.analog.sample(time, &self.routing, row);
            self.wiring
                .spoil(row, full_scale(self.analog.electronics().code_bits()));
        }
        let result = f(&Block {
            samples: &self.block,
            channels: open.channels as u8,
            sequence: self.sequence,
            time: open.next,
            rails: Rails::Unknown,
        });
        self.sequence = self.sequence.wrapping_add(1);
        self.conversions += self.block.len() as u64;
        self.open = Some(Open {
            next: open.next + length,
            left: open.left - length,
            ..open
        });
        Ok(result)
    }
}
