//! What a file of scenes holds.

use super::draw::Distribution;
use super::error::DatasetError;
use super::fault::FaultKindName;
use hil_sim::{Electronics, Preset, Variation};
use rand::Rng;
use rand::rngs::StdRng;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;

/// Most frames of a shard.
const MOST_FRAMES: u64 = 1_000_000;
/// Most values of a shard's frames: they are in memory, with 8 bytes each.
const MOST_VALUES: u64 = 64_000_000;

/// The file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DatasetFile {
    /// Of all that is drawn.
    pub seed: u64,
    /// Frames of a sheet after its baseline.
    pub frames_per_sheet: u64,
    /// Sheets of a shard.
    pub sheets_per_shard: u64,
    /// Frames of the untouched sheet before the others.
    pub baseline_frames: u64,
    /// How touches are solved.
    pub physics: Physics,
    /// The sheets.
    pub sheet: SheetTable,
    /// The boards.
    pub board: BoardTable,
    /// The touches.
    pub touch: TouchTable,
    /// What drifts.
    pub drift: DriftTable,
    /// What may break.
    pub fault: Vec<FaultTable>,
}

impl Default for DatasetFile {
    fn default() -> Self {
        Self {
            seed: 1,
            frames_per_sheet: 1000,
            sheets_per_shard: 1,
            baseline_frames: 24,
            physics: Physics::default(),
            sheet: SheetTable::default(),
            board: BoardTable::default(),
            touch: TouchTable::default(),
            drift: DriftTable::default(),
            fault: Vec::new(),
        }
    }
}

/// How touches are solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Physics {
    /// By multiple scattering between discs; on a mesh where discs reach a rim or each other, and on uneven sheets.
    #[default]
    Discs,
    /// Always on a mesh.
    Mesh,
}

/// The sheets.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SheetTable {
    /// A sheet's file, from the folder of this file; absent: the paper's sheet.
    pub file: Option<String>,
    /// Resistance of a square, ohm; absent: the sheet's own.
    pub sheet_resistance_ohm: Option<Distribution>,
    /// Contact impedance of each electrode, mm; absent: its own.
    pub contact_mm: Option<Distribution>,
    /// How far each electrode on the outer rim is from its place, mm along the rim.
    pub electrode_off_mm: Distribution,
    /// Standard deviation of the resistivity's logarithm over the sheet. Above 0 every frame is solved on a mesh.
    pub resistivity_sd: f64,
    /// Distance of its correlation, mm.
    pub correlation_mm: f64,
}

impl Default for SheetTable {
    fn default() -> Self {
        Self {
            file: None,
            sheet_resistance_ohm: None,
            contact_mm: None,
            electrode_off_mm: Distribution::Fixed(0.0),
            resistivity_sd: 0.0,
            correlation_mm: 40.0,
        }
    }
}

impl SheetTable {
    pub(super) fn variation(&self, seed: u64) -> Variation {
        Variation {
            resistivity_sd: self.resistivity_sd,
            correlation_mm: self.correlation_mm,
            contact_sd: 0.0,
            seed,
        }
    }
}

/// The boards.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BoardTable {
    /// Ready-made electronics.
    pub preset: Preset,
    /// What it measures: `auto`, or a name as of `skin run --plan`.
    pub plan: String,
    /// Whether every value is made sample by sample.
    pub samples: bool,
    /// Numbers of the electronics, by their names in a scene's file; of a list (`gain_error`, `offset_v`) one for each channel.
    pub electronics: BTreeMap<String, Distribution>,
}

impl Default for BoardTable {
    fn default() -> Self {
        Self {
            preset: Preset::default(),
            plan: "auto".to_owned(),
            samples: false,
            electronics: BTreeMap::new(),
        }
    }
}

/// The touches: discs.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TouchTable {
    /// How often there are 0, 1, 2 ... touches.
    pub count: Vec<f64>,
    /// Radius, mm.
    pub radius_mm: Distribution,
    /// Relative rise of the resistivity.
    pub rise: Distribution,
    /// Least distance between the edges of two touches, mm.
    pub apart_mm: f64,
    /// Least distance from an edge to a rim, mm.
    pub rim_mm: f64,
}

impl Default for TouchTable {
    fn default() -> Self {
        Self {
            count: vec![0.0, 1.0],
            radius_mm: Distribution::Fixed(12.5),
            rise: Distribution::Fixed(0.2),
            apart_mm: 0.0,
            rim_mm: 0.0,
        }
    }
}

/// What drifts between the baseline and a frame.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DriftTable {
    /// Resistance of sheet and contacts over that at the baseline.
    pub resistance: Distribution,
}

impl Default for DriftTable {
    fn default() -> Self {
        Self {
            resistance: Distribution::Fixed(1.0),
        }
    }
}

/// What may break.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultTable {
    /// What.
    pub kind: FaultKindName,
    /// In which part of the frames, 0 to 1.
    pub chance: f64,
    /// Resistance, ohm, where the fault has one.
    pub ohm: Option<Distribution>,
    /// Part of the source's amplitude that is left.
    pub part: Option<Distribution>,
}

impl DatasetFile {
    /// What is wrong with it.
    pub(super) fn check(&self) -> Result<(), DatasetError> {
        let wrong = |key, text: &str| Err(DatasetError::Key(key, text.to_owned()));
        for (key, value) in [
            ("frames_per_sheet", self.frames_per_sheet),
            ("sheets_per_shard", self.sheets_per_shard),
            ("baseline_frames", self.baseline_frames),
        ] {
            if value == 0 {
                return wrong(key, "give 1 or more");
            }
        }
        let frames = self.frames_per_sheet.saturating_add(self.baseline_frames);
        if frames.saturating_mul(self.sheets_per_shard) > MOST_FRAMES {
            return wrong(
                "sheets_per_shard",
                "a shard has more than a million frames; give fewer sheets or frames and make more shards",
            );
        }
        let sheet = &self.sheet;
        let touch = &self.touch;
        let positive = [
            ("sheet.sheet_resistance_ohm", sheet.sheet_resistance_ohm.as_ref()),
            ("sheet.contact_mm", sheet.contact_mm.as_ref()),
            ("touch.radius_mm", Some(&touch.radius_mm)),
            ("drift.resistance", Some(&self.drift.resistance)),
        ];
        for (key, of) in positive {
            let Some(of) = of else { continue };
            if let Some(text) = of.wrong() {
                return wrong(key, &text);
            }
            // A normal distribution is refused by what is drawn, if at all.
            if of.least() <= 0.0 && of.least().is_finite() {
                return wrong(key, "give numbers above 0");
            }
        }
        for (key, of) in [
            ("touch.rise", &touch.rise),
            ("sheet.electrode_off_mm", &sheet.electrode_off_mm),
        ] {
            if let Some(text) = of.wrong() {
                return wrong(key, &text);
            }
        }
        if touch.rise.least() <= -1.0 && touch.rise.least().is_finite() {
            return wrong("touch.rise", "give numbers above -1: a rise of -1 leaves no resistance");
        }
        for (key, value) in [
            ("sheet.resistivity_sd", sheet.resistivity_sd),
            ("touch.apart_mm", touch.apart_mm),
            ("touch.rim_mm", touch.rim_mm),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return wrong(key, "give 0 or more");
            }
        }
        if !(sheet.correlation_mm.is_finite() && sheet.correlation_mm > 0.0) {
            return wrong("sheet.correlation_mm", "give a length above 0");
        }
        let weights = &touch.count;
        let sum: f64 = weights.iter().sum();
        if weights.iter().any(|w| w.is_nan() || *w < 0.0) || !(sum.is_finite() && sum > 0.0) || weights.len() > 33 {
            return wrong(
                "touch.count",
                "give how often there are 0, 1, 2 ... touches, such as [1, 3, 1]: up to 32 touches, 0 or more each, and one above 0",
            );
        }
        let chances: f64 = self.fault.iter().map(|f| f.chance).sum();
        if self.fault.iter().any(|f| !(0.0..=1.0).contains(&f.chance)) || chances > 1.0 + 1e-9 {
            return wrong(
                "fault.chance",
                "give parts of the frames, 0 to 1, that are 1 or less together",
            );
        }
        self.fault.iter().try_for_each(FaultTable::check)
    }
}

impl DatasetFile {
    /// Refuses more than memory should have to hold, of frames of so many values.
    pub(super) fn check_values(&self, values: usize) -> Result<(), DatasetError> {
        let frames = (self.frames_per_sheet + self.baseline_frames) * self.sheets_per_shard;
        if frames.saturating_mul(values as u64) > MOST_VALUES {
            let text = format!(
                "a shard has {frames} frames of {values} values, and {MOST_VALUES} values are the most; give fewer sheets or frames and make more shards"
            );
            return Err(DatasetError::Key("sheets_per_shard", text));
        }
        Ok(())
    }
}

/// Electronics with the numbers that the table draws.
pub(super) fn electronics(
    table: &BoardTable,
    electrodes: usize,
    rng: &mut StdRng,
) -> Result<Electronics, DatasetError> {
    let failed = |e: &dyn std::fmt::Display| DatasetError::Electronics(e.to_string());
    let mut all = serde_json::to_value(table.preset.electronics()).map_err(|e| failed(&e))?;
    for (key, of) in &table.electronics {
        if let Some(text) = of.wrong() {
            return Err(failed(&format_args!("{key}: {text}")));
        }
        let Some(place) = all.get_mut(key) else {
            return Err(failed(&format_args!(
                "there is no {key}; docs/scenes.md lists what [electronics] may hold"
            )));
        };
        let number = |v: f64, like: &Value| {
            if like.is_u64() {
                Value::from(v.round().max(0.0) as u64)
            } else {
                Value::from(v)
            }
        };
        *place = match &*place {
            Value::Array(_) if key == "gain_error" || key == "offset_v" => {
                let channels = electrodes.min(16);
                Value::Array((0..channels).map(|_| Value::from(of.draw(rng))).collect())
            }
            Value::Array(_) | Value::Bool(_) | Value::String(_) => {
                return Err(failed(&format_args!("{key} is no number that could be drawn")));
            }
            like => number(of.draw(rng), like),
        };
    }
    let mut made: Electronics = serde_json::from_value(all).map_err(|e| failed(&e))?;
    made.seed = rng.random();
    made.validate().map_err(|e| failed(&e))?;
    Ok(made)
}
