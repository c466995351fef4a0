//! A whole board in simulated time: bytes in, bytes out.

use crate::analog::Analog;
use crate::chip::Chip;
use crate::clock::{Clock, PERIOD_SAMPLES, QUARTER_SAMPLES, TICKS_PER_SAMPLE, TIMER_HZ, samples};
use crate::electronics::Electronics;
use crate::electronics_error::ElectronicsError;
use crate::fault::{Fault, FaultError, FaultKind};
use crate::flash::Flash;
use crate::front_end::{SimFrontEnd, SimFrontEndError};
use crate::line::{Direction, Line};
use crate::scene_time::SceneTime;
use crate::sheet::{Shared, SheetModel};
use crate::timeline::Timeline;
use crate::uart::Uart;
use firmware::{Activity, BoardInfo, Controller, MAX_CHANNELS, Memory};
use protocol::{Counters, Hello, MAX_ELECTRODES, Plan, PlanError, ResetCause, Sampling};
use std::ops::Deref;
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

/// What a simulated board says that it is (`Hello::board`).
pub const BOARD_NAME: &str = "skin-sim";

/// Bytes of each sector of the simulated flash memory.
const SECTOR_BYTES: u32 = 2048;

/// What a simulated board is made of, apart from its sheet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SimConfig {
    /// The analogue part, with the seed of all noise.
    pub electronics: Electronics,
    /// What breaks, and when.
    pub faults: Vec<Fault>,
    /// What it measures until it is told otherwise; `None` is the adjacent plan for the sheet's electrodes, or
    /// [`Plan::sparse`] where these are more than 16.
    pub plan: Option<Plan>,
    /// What its flash memory holds; `None`: nothing yet.
    pub flash: Option<Flash>,
    /// Why it starts.
    pub reset: ResetCause,
    /// The word that outlives a reset, as the life before left it.
    pub scratch: u32,
    /// How often the sheet is looked at, in samples; `None`: every 20 ms.
    pub look_samples: Option<u64>,
}

/// Longest time that a reset waits for a frame to be half out, s: that of several frames of the fast plans. A board that is
/// sending nothing resets after this time.
const MID_FRAME_S: f64 = 0.05;

/// The firmware on simulated hardware. Time stands still between calls.
#[derive(Debug)]
pub struct SimBoard<S> {
    /// What a restart needs; its flash memory is in the chip.
    config: SimConfig,
    sheet: Shared<S>,
    faults: Timeline,
    time: SceneTime,
    line: Line,
    machine: Machine<S>,
    /// Resets so far, and until when the reset line is held (s).
    resets: usize,
    held_until_s: Option<f64>,
    /// The last byte from the board: 0 ends a message.
    last_byte: u8,
}

/// What a reset replaces.
#[derive(Debug)]
struct Machine<S> {
    /// Samples that the simulation was old at power-up.
    origin: u64,
    clock: Clock,
    controller: Controller<'static, SimFrontEnd<Shared<S>>, Uart, Chip, Box<Memory>>,
}

impl<S: SheetModel> Machine<S> {
    fn power_up(
        config: &SimConfig,
        (flash, scratch): (Flash, u32),
        sheet: Shared<S>,
        faults: Timeline,
        time: SceneTime,
        origin: u64,
    ) -> Result<Self, BoardError> {
        let clock = Clock::new();
        let electronics = &config.electronics;
        let analog = Analog::new(electronics.clone(), origin)?;
        let mut front = SimFrontEnd::powered_up(analog, sheet, clock.clone(), faults, time)?;
        if let Some(samples) = config.look_samples {
            front = front.looking_every(samples);
        }
        let given = front.electrodes();
        let electrodes = u8::try_from(given)
            .ok()
            .filter(|n| *n <= MAX_ELECTRODES)
            .ok_or(BoardError::Electrodes {
                given,
                most: MAX_ELECTRODES.into(),
            })?;
        // A channel for every electrode, or one behind the multiplexers: also where there are more electrodes than channels.
        let one_channel = electronics.one_channel || given > MAX_CHANNELS;
        let channels = if one_channel { 1 } else { electrodes };
        config.faults.iter().try_for_each(|fault| fault.validate(given))?;
        let mut gains_milli = [0; 4];
        for (place, gain) in gains_milli.iter_mut().zip(&electronics.gains_milli) {
            *place = *gain;
        }
        let microvolt = |v: f64| (v * 1e6).round() as u32;
        let info = BoardInfo {
            name: BOARD_NAME,
            serial: "sim",
            git: "",
            electrodes,
            channels,
            timer_hz: TIMER_HZ,
            ticks_per_sample: TICKS_PER_SAMPLE,
            in_turn: electronics.in_turn,
            skew_ticks: electronics.skew_ticks,
            adc_bits: electronics.code_bits(),
            adc_span_uv: microvolt(electronics.adc_span_v),
            excitation_uv: microvolt(electronics.excitation_v),
            source_gain_milli: electronics.source_gain_milli,
            gains_milli,
            reset: config.reset,
            last_panic: "",
        };
        let plan = match &config.plan {
            Some(plan) => plan.clone(),
            None if given > MAX_CHANNELS => Plan::sparse(electrodes).map_err(BoardError::Plan)?,
            None => Plan {
                sampling: if one_channel {
                    Sampling::Sequential
                } else {
                    Sampling::Simultaneous
                },
                ..Plan::adjacent(electrodes).map_err(BoardError::Plan)?
            },
        };
        let uart = Uart::new(clock.clone());
        let mut chip = Chip::new(clock.clone(), flash);
        chip.scratch = scratch;
        let controller = Controller::new(info, plan, front, uart, chip, Box::default()).map_err(BoardError::Plan)?;
        Ok(Self {
            origin,
            clock,
            controller,
        })
    }
}

impl<S: SheetModel> SimBoard<S> {
    /// A board at power-up, with its introduction on the way out.
    ///
    /// # Errors
    /// [`BoardError`] says what does not fit together.
    pub fn new(mut config: SimConfig, sheet: S) -> Result<Self, BoardError> {
        let flash = config.flash.take().unwrap_or_else(|| Flash::new(SECTOR_BYTES));
        let sheet = Shared::new(sheet);
        let faults = Timeline::new(config.faults.clone());
        let time = SceneTime::default();
        let kept = (flash, config.scratch);
        let machine = Machine::power_up(&config, kept, sheet.clone(), faults.clone(), time.clone(), 0)?;
        Ok(Self {
            line: Line::new(faults.clone(), config.electronics.seed),
            config,
            sheet,
            faults,
            time,
            machine,
            resets: 0,
            held_until_s: None,
            last_byte: 0,
        })
    }

    /// Samples since the simulation began, as the board's timer makes them.
    pub fn now(&self) -> u64 {
        self.machine.origin + self.machine.clock.now()
    }

    /// True time since the simulation began, s.
    pub fn now_s(&self) -> f64 {
        let rate = 1.0 + 1e-6 * self.config.electronics.crystal_ppm;
        crate::clock::seconds(self.now()) / rate
    }

    /// Holds the scene at its beginning: its time is 0, for what is on the sheet and for the faults, until
    /// [`SimBoard::begin_scene`]. The board itself runs. Only at power-up: later it changes nothing.
    pub fn holding_scene(self) -> Self {
        if self.now() == 0 {
            self.time.hold();
        }
        self
    }

    /// Begins a scene that is held; one that has begun goes on.
    pub fn begin_scene(&mut self) {
        self.time.begin(self.now_s());
    }

    /// True time at which the scene began, s since the simulation did; `None` while it is held.
    pub fn scene_began_s(&self) -> Option<f64> {
        self.time.began_s()
    }

    /// The scene's time, s: that of its touches and faults.
    fn scene_s(&self) -> f64 {
        self.time.at(self.now_s())
    }

    /// Who it says it is.
    pub fn hello(&self) -> Hello {
        self.machine.controller.hello()
    }

    /// The sheet, for as long as the board stands still.
    pub fn sheet(&self) -> impl Deref<Target = S> + '_ {
        self.sheet.lock()
    }

    /// How often the cable was put back; `None` while it is pulled.
    pub fn plugged(&self) -> Option<u32> {
        self.faults.plugged(self.scene_s())
    }

    /// Puts bytes on the wire to the board.
    pub fn receive(&mut self, bytes: &[u8]) {
        self.look_at_line();
        if self.held_until_s.is_some() {
            return;
        }
        let uart = self.machine.controller.link_mut();
        for byte in bytes {
            self.line.pass(Direction::ToBoard, *byte, |b| uart.transmit(&[b]));
        }
    }

    /// Whether nothing will happen however long one waits: no scan, and no byte under way.
    pub fn is_idle(&mut self) -> bool {
        let controller = &mut self.machine.controller;
        self.held_until_s.is_none() && controller.is_quiet() && controller.link_mut().is_idle()
    }

    /// What it counted.
    pub fn counters(&self) -> &Counters {
        self.machine.controller.counters()
    }

    /// Samples that its converter made for the windows so far.
    pub fn conversions(&mut self) -> u64 {
        self.machine.controller.front_mut().conversions()
    }

    /// Its flash memory.
    pub fn flash(&mut self) -> &mut Flash {
        &mut self.machine.controller.support_mut().flash
    }

    /// The word that outlives a reset.
    pub fn scratch(&mut self) -> u32 {
        self.machine.controller.support_mut().scratch
    }

    /// Whether its watchdog has bitten, which never happens while it is stepped.
    pub fn bitten(&mut self) -> bool {
        self.machine.controller.support_mut().bitten()
    }

    /// Lets a time pass in which the firmware hangs.
    pub fn hang(&mut self, duration_s: f64) {
        self.machine.clock.advance(samples(duration_s));
    }

    /// Lets one period of the excitation pass, and hands over the bytes that arrive from the board meanwhile.
    ///
    /// # Errors
    /// A board that is reset does not come up again, as it would not at power-up.
    pub fn try_step(&mut self, mut take: impl FnMut(u8)) -> Result<(), BoardError> {
        self.look_at_line();
        if self.line.take_break(Direction::FromBoard) {
            // What a receiver makes of a line that stays low.
            take(0);
        }
        self.reset_if_due()?;
        if let Some(until_s) = self.held_until_s {
            self.machine.origin += PERIOD_SAMPLES;
            if self.now_s() < until_s {
                return Ok(());
            }
            // It comes up now, whatever time it is.
            self.restart()?;
            self.held_until_s = None;
            return Ok(());
        }
        let Machine { clock, controller, .. } = &mut self.machine;
        for _ in 0..PERIOD_SAMPLES / QUARTER_SAMPLES {
            clock.advance(QUARTER_SAMPLES);
            // One block of samples, the commands of a quarter period and their answers are a few polls.
            for _ in 0..16 {
                if controller.poll() == Activity::Idle {
                    break;
                }
            }
        }
        let (line, last) = (&mut self.line, &mut self.last_byte);
        controller.link_mut().receive(|byte| {
            *last = byte;
            line.pass(Direction::FromBoard, byte, &mut take);
        });
        Ok(())
    }

    /// The same, of a board that comes up again after every reset.
    pub fn step(&mut self, take: impl FnMut(u8)) {
        // What could come up once can again: nothing of it has changed but the sheet, which is looked at all the time.
        if let Err(error) = self.try_step(take) {
            debug_assert!(false, "{error}");
        }
    }

    /// Lets a time pass, to the next whole period, and collects the bytes that arrive from the board meanwhile.
    pub fn run(&mut self, duration_s: f64) -> Vec<u8> {
        let end = self.now() + samples(duration_s);
        let mut bytes = Vec::new();
        while self.now() < end {
            self.step(|b| bytes.push(b));
        }
        bytes
    }

    fn look_at_line(&mut self) {
        self.line.look(self.scene_s());
        if self.line.take_break(Direction::ToBoard) && self.held_until_s.is_none() {
            self.machine.controller.link_mut().transmit_break();
        }
    }

    fn reset_if_due(&mut self) -> Result<(), BoardError> {
        let scene_s = self.scene_s();
        let Some(fault) = self.faults.reset(scene_s, self.resets) else {
            return Ok(());
        };
        if self.last_byte == 0 && scene_s < fault.at_s + MID_FRAME_S {
            return Ok(());
        }
        self.held_until_s = fault.for_s.map(|length| self.now_s() + length);
        self.resets += 1;
        self.config.reset = match fault.kind {
            FaultKind::BoardHangs => ResetCause::Watchdog,
            _ => ResetCause::Pin,
        };
        self.restart()
    }

    /// All but the flash memory and the word beside it is new.
    fn restart(&mut self) -> Result<(), BoardError> {
        let chip = self.machine.controller.support_mut();
        let kept = (chip.flash.clone(), chip.scratch);
        let origin = self.now();
        let (sheet, faults, time) = (self.sheet.clone(), self.faults.clone(), self.time.clone());
        self.machine = Machine::power_up(&self.config, kept, sheet, faults, time, origin)?;
        self.last_byte = 0;
        Ok(())
    }
}
