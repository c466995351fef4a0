//! A whole board in simulated time: bytes in, bytes out.

use crate::chip::Chip;
use crate::clock::{Clock, PERIOD_SAMPLES, QUARTER_SAMPLES, TICKS_PER_SAMPLE, TIMER_HZ, samples, seconds};
use crate::electronics::{Electronics, ElectronicsError};
use crate::fault::{Fault, FaultError};
use crate::flash::Flash;
use crate::front_end::{SimFrontEnd, SimFrontEndError};
use crate::sheet::SheetModel;
use crate::uart::Uart;
use firmware::{Activity, BoardInfo, Controller, MAX_CHANNELS, Memory};
use protocol::{Counters, Hello, Plan, PlanError, ResetCause};
use thiserror::Error;

/// Why there is no simulated board.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum BoardError {
    /// The front end does not come up.
    #[error(transparent)]
    FrontEnd(#[from] SimFrontEndError),
    /// Its electronics cannot be.
    #[error(transparent)]
    Electronics(#[from] ElectronicsError),
    /// A fault that it cannot have.
    #[error(transparent)]
    Fault(#[from] FaultError),
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

/// Bytes of each sector of the simulated flash memory.
const SECTOR_BYTES: u32 = 2048;

/// What a simulated board is made of, apart from its sheet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SimConfig {
    /// The analogue part, with the seed of all noise.
    pub electronics: Electronics,
    /// What breaks, and when.
    pub faults: Vec<Fault>,
    /// What it measures until it is told otherwise; `None` is the adjacent plan for the sheet's electrodes.
    pub plan: Option<Plan>,
    /// What its flash memory holds; `None`: nothing yet.
    pub flash: Option<Flash>,
    /// Why it starts.
    pub reset: ResetCause,
    /// How often the sheet is looked at, in samples; `None`: every 20 ms.
    pub look_samples: Option<u64>,
}

/// The firmware on simulated hardware. Time stands still between calls.
#[derive(Debug)]
pub struct SimBoard<S> {
    clock: Clock,
    controller: Controller<'static, SimFrontEnd<S>, Uart, Chip, Box<Memory>>,
}

impl<S: SheetModel> SimBoard<S> {
    /// A board at power-up, with its introduction on the way out.
    ///
    /// # Errors
    /// [`BoardError`] says what does not fit together.
    pub fn new(config: SimConfig, sheet: S) -> Result<Self, BoardError> {
        let clock = Clock::new();
        let SimConfig {
            electronics,
            faults,
            plan,
            flash,
            reset,
            look_samples,
        } = config;
        electronics.validate()?;
        let mut gains_milli = [0; 4];
        for (place, gain) in gains_milli.iter_mut().zip(&electronics.gains_milli) {
            *place = *gain;
        }
        let microvolt = |v: f64| (v * 1e6).round() as u32;
        let (span, excitation) = (microvolt(electronics.adc_span_v), microvolt(electronics.excitation_v));
        let (source_gain_milli, skew_ticks) = (electronics.source_gain_milli, electronics.skew_ticks);
        let mut front = SimFrontEnd::new(electronics, sheet, clock.clone())?;
        if let Some(samples) = look_samples {
            front = front.looking_every(samples);
        }
        let given = front.electrodes();
        faults.iter().try_for_each(|fault| fault.validate(given))?;
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
            git: "",
            electrodes,
            channels: electrodes,
            timer_hz: TIMER_HZ,
            ticks_per_sample: TICKS_PER_SAMPLE,
            skew_ticks,
            adc_span_uv: span,
            excitation_uv: excitation,
            source_gain_milli,
            gains_milli,
            reset,
            last_panic: "",
        };
        let plan = match plan {
            Some(plan) => plan,
            None => Plan::adjacent(electrodes).map_err(BoardError::Plan)?,
        };
        let uart = Uart::new(clock.clone());
        let chip = Chip::new(clock.clone(), flash.unwrap_or_else(|| Flash::new(SECTOR_BYTES)));
        let controller = Controller::new(info, plan, front, uart, chip, Box::default()).map_err(BoardError::Plan)?;
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
    pub fn hello(&self) -> Hello {
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

    /// What it counted.
    pub fn counters(&self) -> &Counters {
        self.controller.counters()
    }

    /// Samples that its converter made for the windows so far.
    pub fn conversions(&mut self) -> u64 {
        self.controller.front_mut().conversions()
    }

    /// Its flash memory.
    pub fn flash(&mut self) -> &mut Flash {
        &mut self.controller.support_mut().flash
    }

    /// Whether its watchdog has bitten, which never happens while it is stepped.
    pub fn bitten(&mut self) -> bool {
        self.controller.support_mut().bitten()
    }

    /// Lets a time pass in which the firmware hangs.
    pub fn hang(&mut self, duration_s: f64) {
        self.clock.advance(samples(duration_s));
    }

    /// Lets one period of the excitation pass, and hands over the bytes that left the board meanwhile.
    pub fn step(&mut self, take: impl FnMut(u8)) {
        for _ in 0..PERIOD_SAMPLES / QUARTER_SAMPLES {
            self.clock.advance(QUARTER_SAMPLES);
            // One block of samples, the commands of a quarter period and their answers are a few polls.
            for _ in 0..16 {
                if self.controller.poll() == Activity::Idle {
                    break;
                }
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
