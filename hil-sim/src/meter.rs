//! Frames of sheets that stand still, one call a frame: the firmware's scan on simulated electronics, without link and commands.

use crate::board::{BoardError, SimBoard, SimConfig};
use crate::clock::{Clock, TICKS_PER_SAMPLE};
use crate::electronics::Electronics;
use crate::fault::{FaultError, FaultKind};
use crate::front_end::{SimFrontEnd, SimFrontEndError};
use crate::sheet::FixedSheet;
use crate::value_front_end::ValueFrontEnd;
use crate::wiring::Wiring;
use firmware::{Excitation, FrontEnd, Pace, Progress, Scan, ScanError};
use forward::ElectrodeMatrix;
use protocol::{Flags, Frame, Hello, Plan, PlanError, Recipe, Value, Variance, heapless};
use thiserror::Error;

/// How closely the electronics are followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Level {
    /// By values, with samples where only these tell: [`ValueFrontEnd`].
    #[default]
    Values,
    /// Sample by sample: [`SimFrontEnd`].
    Samples,
}

/// Why there is no frame.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MeterError {
    /// There is no such board.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The plan does not suit it.
    #[error("the board cannot carry out the plan: {0}")]
    Plan(PlanError),
    /// A fault that it cannot have.
    #[error(transparent)]
    Fault(#[from] FaultError),
    /// A fault of the line to the board, or of its program, which changes no value.
    #[error("the fault {0:?} is not one of values; leave it out")]
    NoValues(FaultKind),
    /// A sheet of other electrodes than the board is wired for.
    #[error("the sheet has {given} electrodes, the board is wired for {wired}")]
    Electrodes {
        /// Of the sheet.
        given: usize,
        /// Of the board.
        wired: usize,
    },
    /// The front end failed.
    #[error("the simulated front end failed: {0}")]
    FrontEnd(String),
}

/// A board that measures one frame after the other, each of a sheet that stands still.
#[derive(Debug)]
pub struct Meter {
    hello: Hello,
    plan: Plan,
    scan: Box<Scan>,
    front: Front,
    sequence: u32,
}

#[derive(Debug)]
enum Front {
    Values(Box<ValueFrontEnd>),
    Samples(Box<SimFrontEnd<FixedSheet>>),
}

impl Meter {
    /// A board for sheets like this one, with the plan that `choose` makes for it. Its source is on.
    ///
    /// # Errors
    /// [`MeterError`] says what does not fit together.
    pub fn new(
        electronics: Electronics,
        sheet: &ElectrodeMatrix,
        level: Level,
        choose: impl FnOnce(&Hello) -> Result<Plan, PlanError>,
    ) -> Result<Self, MeterError> {
        let config = SimConfig {
            electronics: electronics.clone(),
            ..SimConfig::default()
        };
        let hello = SimBoard::new(config, FixedSheet(sheet.clone()))?.hello();
        let plan = choose(&hello).map_err(MeterError::Plan)?;
        plan.check(&hello).map_err(MeterError::Plan)?;
        let mut scan = Box::new(Scan::new());
        scan.wire(firmware::Wiring {
            electrodes: hello.electrodes,
            adc_bits: electronics.code_bits(),
            in_turn: electronics.in_turn,
            skew_ticks: electronics.skew_ticks,
            ticks_per_sample: TICKS_PER_SAMPLE,
        });
        let failed = |e: SimFrontEndError| MeterError::FrontEnd(e.to_string());
        let front = match level {
            Level::Values => {
                let mut front = ValueFrontEnd::new(electronics, sheet.clone()).map_err(|e| failed(e.into()))?;
                front.switch_on().map_err(failed)?;
                Front::Values(Box::new(front))
            }
            Level::Samples => {
                let front = SimFrontEnd::new(electronics, FixedSheet(sheet.clone()), Clock::new()).map_err(failed)?;
                let mut front = front.self_clocked();
                front.switch_on().map_err(failed)?;
                Front::Samples(Box::new(front))
            }
        };
        Ok(Self {
            hello,
            plan,
            scan,
            front,
            sequence: 0,
        })
    }

    /// What the board says of itself.
    pub fn hello(&self) -> &Hello {
        &self.hello
    }

    /// What it measures.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Windows so far whose samples were made.
    pub fn sampled_windows(&self) -> u64 {
        match &self.front {
            Front::Values(front) => front.sampled_windows(),
            Front::Samples(_) => u64::from(self.sequence) * self.plan.slots.len() as u64,
        }
    }

    /// Whether a fault changes values, so that [`Meter::frame`] takes it.
    pub fn is_of_values(fault: &FaultKind) -> bool {
        !matches!(
            fault,
            FaultKind::BytesLost { .. }
                | FaultKind::BytesFlipped { .. }
                | FaultKind::BytesDoubled { .. }
                | FaultKind::LineBreak
                | FaultKind::BreakToBoard
                | FaultKind::CablePulled
                | FaultKind::BoardReset
                | FaultKind::BoardHangs
                | FaultKind::ConverterOverrun { .. }
        )
    }

    /// The next frame: of a sheet, with what is broken.
    ///
    /// # Errors
    /// A fault that the board cannot have, a sheet of other electrodes.
    pub fn frame(&mut self, sheet: &ElectrodeMatrix, faults: &[FaultKind]) -> Result<Frame, MeterError> {
        let (given, wired) = (sheet.electrodes(), usize::from(self.hello.electrodes));
        if given != wired {
            return Err(MeterError::Electrodes { given, wired });
        }
        for fault in faults {
            crate::Fault::new(0.0, fault.clone()).validate(wired)?;
            if !Self::is_of_values(fault) {
                return Err(MeterError::NoValues(fault.clone()));
            }
        }
        let wiring = Wiring::of(faults.iter());
        let failed = |e: SimFrontEndError| MeterError::FrontEnd(e.to_string());
        let recipe = self.plan.recipe();
        match &mut self.front {
            Front::Values(front) => {
                front.put(sheet, wiring).map_err(failed)?;
                measure(&mut self.scan, recipe, front.as_mut())?;
            }
            Front::Samples(front) => {
                front.put(sheet, wiring).map_err(failed)?;
                measure(&mut self.scan, recipe, front.as_mut())?;
            }
        }
        let sent = self.scan.frame(self.sequence, self.plan.id, self.plan.quadrature);
        self.sequence = self.sequence.wrapping_add(1);
        Ok(Frame {
            sequence: sent.sequence,
            time: sent.time,
            plan: sent.plan,
            clipped: Flags::clone(sent.clipped),
            values: list(sent.values),
            quadrature: list(sent.quadrature),
            noise: list::<Variance, _>(sent.noise),
        })
    }

    /// Standard deviation of a value's noise, V, rms over a frame's values, as the board tells it by the samples' variances; with
    /// what rounding to a [`Value`] adds.
    pub fn noise_v(&self, frame: &Frame) -> f64 {
        let samples = f64::from(self.hello.samples_per_period) * f64::from(self.plan.integrate_periods);
        let rounding = f64::from(Value::PER_CODE).powi(-2) / 12.0;
        let (mut sum, mut values) = (0.0, 0u32);
        for (slot, noise) in self.plan.slots.iter().zip(&frame.noise) {
            let volts = self.hello.volts_per_code(slot.gain).unwrap_or(0.0);
            let count = slot.sense.count_ones();
            sum += f64::from(count) * volts * volts * (2.0 * noise.codes2() / samples + rounding);
            values += count;
        }
        (sum / f64::from(values.max(1))).sqrt()
    }
}

/// Runs a scan to its end.
fn measure<F: FrontEnd<Error = SimFrontEndError>>(
    scan: &mut Scan,
    recipe: Recipe<'_>,
    front: &mut F,
) -> Result<(), MeterError> {
    let failed = |e: ScanError<SimFrontEndError>| match e {
        ScanError::FrontEnd(e) => MeterError::FrontEnd(e.to_string()),
        ScanError::Block(e) => MeterError::FrontEnd(format!("{e:?}")),
    };
    scan.start(recipe, Pace::Ahead, 0, front).map_err(failed)?;
    loop {
        match nb::block!(scan.step(recipe, front)).map_err(failed)? {
            Progress::Complete => break,
            Progress::Working | Progress::Slot => {}
        }
    }
    scan.finish();
    Ok(())
}

/// What crosses the wire as a list.
fn list<T: Clone, const N: usize>(of: &[T]) -> heapless::Vec<T, N> {
    of.iter().take(N).cloned().collect()
}
