//! A whole board in simulated time: bytes in, bytes out.

use crate::clock::{Clock, PERIOD_SAMPLES, TICKS_PER_SAMPLE, TIMER_HZ, samples, seconds};
use crate::electronics::Electronics;
use crate::front_end::{SimFrontEnd, SimFrontEndError};
use crate::sheet::SheetModel;
use crate::uart::Uart;
use firmware::{Activity, BoardInfo, Controller, MAX_CHANNELS};
use protocol::{Hello, Plan, PlanError};
use thiserror::Error;

/// Why there is no simulated board.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum BoardError {
    /// The front end does not come up.
    #[error(transparent)]
    FrontEnd(#[from] SimFrontEndError),
    /// The plan that it starts with does not suit it.
    #[error("the board cannot start with this plan: {0}")]
    Plan(PlanError),
    /// More electrodes than the simulated multiplexers and channels have.
    #[error("the sheet has {given} electrodes, the simulated board is wired for at most {most}")]
    Electrodes {
        /// Electrodes of the sheet.
        given: usize,
        /// Electrodes that can be wired.
        most: usize,
    },
}

/// What a simulated board is made of, apart from its sheet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SimConfig {
    /// The analogue part, with the seed of all noise.
    pub electronics: Electronics,
    /// What it measures until it is told otherwise; `None` is the adjacent plan for the sheet's electrodes.
    pub plan: Option<Plan>,
}

/// The firmware on simulated hardware. Time stands still between calls.
#[derive(Debug)]
pub struct SimBoard<S> {
    clock: Clock,
    controller: Controller<SimFrontEnd<S>, Uart>,
}

impl<S: SheetModel> SimBoard<S> {
    /// A board at power-up, with its introduction on the way out.
    ///
    /// # Errors
    /// [`BoardError`] says what does not fit together.
    pub fn new(config: SimConfig, sheet: S) -> Result<Self, BoardError> {
        let clock = Clock::new();
        let SimConfig { electronics, plan } = config;
        let gains = electronics.gains_milli.clone();
        let microvolt = |v: f64| (v * 1e6).round() as u32;
        let (span, excitation) = (microvolt(electronics.adc_span_v), microvolt(electronics.excitation_v));
        let front = SimFrontEnd::new(electronics, sheet, clock.clone())?;
        let given = front.electrodes();
        let electrodes = u8::try_from(given)
            .ok()
            .filter(|n| usize::from(*n) <= MAX_CHANNELS)
            .ok_or(BoardError::Electrodes {
                given,
                most: MAX_CHANNELS,
            })?;
        let info = BoardInfo {
            name: "skin-sim",
            serial: "sim",
            electrodes,
            channels: electrodes,
            timer_hz: TIMER_HZ,
            ticks_per_sample: TICKS_PER_SAMPLE,
            adc_span_uv: span,
            excitation_uv: excitation,
            gains_milli: &gains,
        };
        let plan = match plan {
            Some(plan) => plan,
            None => Plan::adjacent(electrodes).map_err(BoardError::Plan)?,
        };
        let uart = Uart::new(clock.clone());
        let controller = Controller::new(&info, plan, front, uart).map_err(BoardError::Plan)?;
        Ok(Self { clock, controller })
    }

    /// Samples since power-up.
    pub fn now(&self) -> u64 {
        self.clock.now()
    }

    /// Seconds since power-up.
    pub fn now_s(&self) -> f64 {
        seconds(self.now())
    }

    /// Who it says it is.
    pub fn hello(&self) -> &Hello {
        self.controller.hello()
    }

    /// The sheet.
    pub fn sheet(&mut self) -> &S {
        self.controller.front_mut().sheet()
    }

    /// Puts bytes on the wire to the board.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.controller.link_mut().transmit(bytes);
    }

    /// Whether nothing will happen however long one waits: no scan, and no byte under way.
    pub fn is_idle(&mut self) -> bool {
        self.controller.is_quiet() && self.controller.link_mut().is_idle()
    }

    /// Lets one period of the excitation pass, and hands over the bytes that left the board meanwhile.
    pub fn step(&mut self, take: impl FnMut(u8)) {
        self.clock.advance(PERIOD_SAMPLES);
        // One block of samples, the commands of a period and their answers are a few polls.
        for _ in 0..32 {
            if self.controller.poll() == Activity::Idle {
                break;
            }
        }
        self.controller.link_mut().receive(take);
    }

    /// Lets a time pass, to the next whole period, and collects the bytes that left the board meanwhile.
    pub fn run(&mut self, duration_s: f64) -> Vec<u8> {
        let end = self.now() + samples(duration_s);
        let mut bytes = Vec::new();
        while self.now() < end {
            self.step(|b| bytes.push(b));
        }
        bytes
    }
}
