//! Labelled simulated frames for learning: sheets, electronics, touches and faults drawn from distributions.
//!
//! A shard is some sheets, each with its own board, its baseline and its frames. Its numbers depend on the file's text and on the
//! shard's number alone: shards can be made in any order, on any machine, at once. docs/datasets.md describes the file.

mod draw;
mod error;
mod fault;
mod file;
mod physics;

pub use draw::Distribution;
pub use error::DatasetError;
pub use fault::{FaultKindName, Label};
pub use file::{DatasetFile, FaultTable, Physics};

use crate::scene::rng;
use draw::{places, weighted};
use file::electronics;
use forward::{DiscTouch, ElectrodeMatrix, Geometry, Measurement, Pattern, Sheet};
use hil_sim::{Level, Meter};
use link::MeasuredFrame;
use link::plans::PlanChoice;
use physics::Rubber;
use rand::Rng;
use rand::rngs::StdRng;

/// A dataset that can be made, shard by shard.
#[derive(Clone, Debug)]
pub struct Dataset {
    file: DatasetFile,
    sheet: Sheet,
    plan: PlanChoice,
}

/// A measured frame with its truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Which sheet: counted through all shards, from 0.
    pub sheet: u64,
    /// Whether it is of the untouched, whole sheet, before the others.
    pub baseline: bool,
    /// Values, V, as the board's plan orders them; not a number where the converter clipped.
    pub values_v: Vec<f64>,
    /// What presses, in the order drawn.
    pub touches: Vec<DiscTouch>,
    /// What broke since the baseline.
    pub fault: Option<Label>,
    /// Standard deviation of a value's noise, V, rms over the values, as the board tells it by its samples.
    pub noise_v: f64,
    /// Resistance of the sheet over that at its baseline.
    pub resistance: f64,
    /// Whether the elements of a mesh were solved; else the discs were, by multiple scattering.
    pub meshed: bool,
}

/// A sheet with its board, as it was drawn.
#[derive(Clone, Debug)]
pub struct Device {
    /// The sheet.
    pub sheet: Sheet,
    /// The electronics, as JSON.
    pub electronics: serde_json::Value,
}

/// Some sheets with their frames.
#[derive(Clone, Debug)]
pub struct Shard {
    /// What the values are.
    pub measurements: Vec<Measurement>,
    /// The sheets with their boards.
    pub devices: Vec<Device>,
    /// The frames, sheet by sheet, baselines first.
    pub rows: Vec<Row>,
    /// Windows whose values were made sample by sample, since no law told them.
    pub sampled_windows: u64,
}

impl Dataset {
    /// A dataset of this file, on sheets like this one.
    ///
    /// # Errors
    /// [`DatasetError`] names the key and what it may be.
    pub fn new(file: DatasetFile, sheet: Sheet) -> Result<Self, DatasetError> {
        file.check()?;
        let plan = file
            .board
            .plan
            .parse()
            .map_err(|e| DatasetError::Key("board.plan", format!("{e}")))?;
        let made = Self { file, sheet, plan };
        // What cannot be in any shard is to be said before the first one.
        made.electronics(&mut rng(0))?;
        Geometry::new(&made.sheet).map_err(forward::ForwardError::from)?;
        Ok(made)
    }

    /// The file.
    pub fn file(&self) -> &DatasetFile {
        &self.file
    }

    /// Frames of a shard, without those of the baselines.
    pub fn shard_frames(&self) -> u64 {
        self.file.frames_per_sheet * self.file.sheets_per_shard
    }

    /// Most touches of a frame.
    pub fn most_touches(&self) -> usize {
        self.file.touch.count.len().saturating_sub(1)
    }

    /// Makes a shard.
    ///
    /// # Errors
    /// [`DatasetError`]: a sheet or a board that was drawn and cannot be, touches that find no room.
    pub fn shard(&self, number: u64) -> Result<Shard, DatasetError> {
        let mut shard = Shard {
            measurements: Vec::new(),
            devices: Vec::new(),
            rows: Vec::new(),
            sampled_windows: 0,
        };
        for k in 0..self.file.sheets_per_shard {
            self.device(number * self.file.sheets_per_shard + k, &mut shard)?;
        }
        Ok(shard)
    }

    /// Draws a sheet with its board and measures all its frames.
    fn device(&self, number: u64, out: &mut Shard) -> Result<(), DatasetError> {
        // Of each sheet its own numbers, far from those of the next and of other seeds.
        let mut rng = rng(self.file.seed ^ (number + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let sheet = self.drawn_sheet(&mut rng)?;
        let electronics = self.electronics(&mut rng)?;
        let seed = rng.random();
        let mut rubber = Rubber::new(&sheet, self.file.physics, self.file.sheet.variation(seed))?;
        let mut meter = Meter::new(electronics.clone(), rubber.untouched(), self.level(), |hello| {
            self.plan.plan(hello)
        })?;
        let electrodes = sheet.electrodes.len();
        let pairs = meter.plan().recipe().measurements(meter.hello().electrodes);
        let pair = |p: protocol::Pair| [p.plus, p.minus].map(usize::from);
        let pattern = Pattern::from_pairs(electrodes, pairs.map(|(drive, sense)| [pair(drive), pair(sense)]))?;
        out.measurements = pattern.measurements().to_vec();
        self.file.check_values(pattern.len())?;
        let geometry = Geometry::new(&sheet).map_err(forward::ForwardError::from)?;
        for _ in 0..self.file.baseline_frames {
            let untouched = rubber.untouched().clone();
            let row = Row {
                sheet: number,
                baseline: true,
                values_v: Vec::new(),
                touches: Vec::new(),
                fault: None,
                noise_v: 0.0,
                resistance: 1.0,
                meshed: false,
            };
            out.rows.push(measured(&mut meter, &untouched, row)?);
        }
        for _ in 0..self.file.frames_per_sheet {
            let touches = self.touches(&geometry, &mut rng)?;
            let resistance = self.file.drift.resistance.draw(&mut rng);
            if !(resistance.is_finite() && resistance > 0.0) {
                return Err(DatasetError::Drawn("drift.resistance"));
            }
            let fault = fault::draw(&self.file.fault, electrodes, &mut rng)?;
            let (matrix, meshed) = rubber.pressed(&touches)?;
            let matrix = ElectrodeMatrix::from_potentials(matrix.potentials_ohm() * resistance);
            let row = Row {
                sheet: number,
                baseline: false,
                values_v: Vec::new(),
                touches,
                fault,
                noise_v: 0.0,
                resistance,
                meshed,
            };
            out.rows.push(measured(&mut meter, &matrix, row)?);
        }
        out.sampled_windows += meter.sampled_windows();
        out.devices.push(Device {
            sheet,
            electronics: serde_json::to_value(&electronics).map_err(|e| DatasetError::Electronics(e.to_string()))?,
        });
        Ok(())
    }

    fn level(&self) -> Level {
        if self.file.board.samples {
            Level::Samples
        } else {
            Level::Values
        }
    }

    fn electronics(&self, rng: &mut StdRng) -> Result<hil_sim::Electronics, DatasetError> {
        electronics(&self.file.board, self.sheet.electrodes.len(), rng)
    }

    fn drawn_sheet(&self, rng: &mut StdRng) -> Result<Sheet, DatasetError> {
        let mut sheet = self.sheet.clone();
        let table = &self.file.sheet;
        if let Some(ohm) = &table.sheet_resistance_ohm {
            sheet.sheet_resistance_ohm = ohm.draw(rng);
        }
        let geometry = Geometry::new(&sheet).map_err(forward::ForwardError::from)?;
        let centres = geometry.electrode_centres();
        for (electrode, centre) in sheet.electrodes.iter_mut().zip(centres) {
            if let Some(contact_mm) = &table.contact_mm {
                electrode.contact_mm = contact_mm.draw(rng);
            }
            let off_mm = table.electrode_off_mm.draw(rng);
            physics::shift(electrode, centre, &geometry, off_mm);
        }
        Ok(sheet)
    }

    /// Discs that lie on the sheet, apart from its rims and from one another by as much as the file says.
    fn touches(&self, geometry: &Geometry, rng: &mut StdRng) -> Result<Vec<DiscTouch>, DatasetError> {
        let table = &self.file.touch;
        let count = weighted(&table.count, rng);
        let touches = places(geometry, count, table, rng).ok_or(DatasetError::NoRoom { count })?;
        if touches.iter().any(|t| !(t.rise.is_finite() && t.rise > -1.0)) {
            return Err(DatasetError::Drawn("touch.rise"));
        }
        Ok(touches)
    }
}

/// A row with what the board measures.
fn measured(meter: &mut Meter, matrix: &ElectrodeMatrix, mut row: Row) -> Result<Row, DatasetError> {
    let faults: Vec<_> = row.fault.iter().map(|label| label.kind.clone()).collect();
    let frame = meter.frame(matrix, &faults)?;
    row.noise_v = meter.noise_v(&frame);
    row.values_v = MeasuredFrame::of(meter.hello(), meter.plan(), &frame).values_v;
    // Of a channel that clipped there is no number, which is no infinite one.
    if !row.noise_v.is_finite() || row.values_v.iter().any(|v| v.is_infinite()) {
        return Err(DatasetError::Drawn("board"));
    }
    Ok(row)
}
