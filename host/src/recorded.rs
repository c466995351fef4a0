//! What a recording holds beside the wire, as `skin run` writes it and a replay reads it.

use crate::event::Said;
use crate::files::calibration_file;
use crate::presses;
use crate::presses::file::PressCalibration;
use crate::skin_file::{self, Place};
use ::forward::Sheet;
use ::forward::file::{parse_sheet, sheet_text};
use anyhow::{Context, Result, bail};
use inverse::force::meter::Calibration;
use inverse::live::LiveOptions;
use inverse::pipeline::FrameResult;
use inverse::quality::doubt::Doubt;
use inverse::reference::ToldSheet;
use inverse::reference::baseline::Baseline;
use inverse::reference::diagnosis::Fault;
use inverse::reference::screening::Finding;
use inverse::touches::gestures::{GestureOptions, Gestures, TouchEvent};
use inverse::touches::touch::Touch;
use inverse::touches::tracker::Numbered;
use link::{LinkCounters, MeasuredFrame};
use protocol::Hello;
use recording::{FORMAT, Pose, Reader, Tap, Topic};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;
use view::picture::{BaselineNote, Picture};
use view::png;

/// This program, with its version.
pub(crate) const PROGRAM: &str = concat!("skin ", env!("CARGO_PKG_VERSION"));

/// The board, as it introduced itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct BoardRecord {
    pub(crate) name: String,
    pub(crate) serial: String,
    pub(crate) firmware: String,
    pub(crate) git: String,
    pub(crate) electrodes: usize,
    pub(crate) excitation_hz: f64,
}

impl From<&Hello> for BoardRecord {
    fn from(hello: &Hello) -> Self {
        Self {
            name: hello.board.to_string(),
            serial: hello.serial.to_string(),
            firmware: hello.firmware.to_string(),
            git: hello.git.to_string(),
            electrodes: hello.electrodes.into(),
            excitation_hz: hello.excitation_hz(),
        }
    }
}

/// What is told of a session's calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct CalibrationNote {
    pub(crate) file: String,
    /// Whether it is the one that is stored for the board, and was loaded by itself.
    pub(crate) stored: bool,
    /// Presses that taught it, where that takes the place of the model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) presses: Option<usize>,
    /// Whether forces are in newtons of this skin.
    pub(crate) force: bool,
    /// Whether the rubber's creep is taken out of them.
    pub(crate) creep: bool,
}

/// What was recorded, and how: the first message of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SessionRecord {
    pub(crate) format: u32,
    pub(crate) program: String,
    pub(crate) started_unix_s: f64,
    /// Its name, of several skins.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) skin: Option<String>,
    /// Where the sheet is on the robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) place: Option<Place>,
    pub(crate) source: String,
    pub(crate) board: BoardRecord,
    pub(crate) values: usize,
    /// TOML.
    pub(crate) sheet: String,
    /// From 1.
    pub(crate) wires: Vec<usize>,
    /// TOML.
    pub(crate) calibration: Option<String>,
    /// What presses at known places taught, TOML; none where the sheet's model is used.
    #[serde(default)]
    pub(crate) presses: Option<String>,
    /// How many they were.
    #[serde(default)]
    pub(crate) learned_from: Option<usize>,
    /// What presses told of the sheet, where its model is used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) told: Option<ToldSheet>,
    /// What the calibration was; none without, and in recordings of a program that did not tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) calibrated_by: Option<CalibrationNote>,
    /// None where it is calibrated, and in recordings of a program that gave no such forces.
    #[serde(default)]
    pub(crate) uncalibrated_n_per_mm2: Option<f64>,
    pub(crate) find_electrodes: bool,
    pub(crate) baseline_frames: usize,
    pub(crate) method: String,
    /// None where it was learned.
    #[serde(default)]
    pub(crate) rise: Option<String>,
    pub(crate) reach: f64,
    pub(crate) patience_s: f64,
    pub(crate) machine: String,
}

/// What a session is of, beside the options of its reconstruction.
pub(crate) struct Recorded<'a> {
    pub(crate) hello: &'a Hello,
    pub(crate) source: &'a str,
    pub(crate) values: usize,
    pub(crate) sheet: &'a Sheet,
    pub(crate) wires: &'a [usize],
    /// Where that takes the place of the model.
    pub(crate) presses: Option<&'a PressCalibration>,
}

fn machine() -> String {
    format!("{} {}", std::env::consts::ARCH, std::env::consts::OS)
}

impl SessionRecord {
    /// Of a session that begins.
    ///
    /// # Errors
    /// What the formats cannot hold, which no sheet and no calibration has.
    pub(crate) fn new(of: &Recorded<'_>, options: &LiveOptions, started_unix_s: f64) -> Result<Self> {
        let hello = of.hello;
        let calibration = options.calibration.as_ref().map(|c| calibration_file::text(c, None));
        Ok(Self {
            format: FORMAT,
            program: PROGRAM.to_owned(),
            started_unix_s,
            skin: None,
            place: None,
            source: of.source.to_owned(),
            board: BoardRecord::from(hello),
            values: of.values,
            sheet: sheet_text(of.sheet)?,
            wires: of.wires.to_vec(),
            calibration: calibration.transpose()?,
            presses: of.presses.map(|presses| presses.text.clone()),
            learned_from: of.presses.map(|presses| presses.presses),
            told: None,
            calibrated_by: None,
            uncalibrated_n_per_mm2: options.uncalibrated_n_per_mm2.filter(|_| options.calibration.is_none()),
            find_electrodes: options.find_electrodes,
            baseline_frames: options.baseline_frames,
            method: options.method.name().to_owned(),
            rise: options.polarity.map(|p| p.name().to_owned()),
            reach: options.reach,
            patience_s: options.patience_s,
            machine: machine(),
        })
    }

    /// That of a recording.
    ///
    /// # Errors
    /// It is no recording, or a later program's, or too little is left of it.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let file = path.display();
        let text = first(path)?;
        let value: Value = serde_json::from_slice(&text).with_context(|| format!("{file}: its first message"))?;
        match value["format"].as_u64() {
            Some(format) if format <= u64::from(FORMAT) => {}
            format => bail!(
                "{file}: format {} of recordings, this program knows {FORMAT}; read it with the program that wrote it",
                format.unwrap_or(0)
            ),
        }
        serde_json::from_value(value).with_context(|| format!("{file}: its first message"))
    }

    /// The skin's name; where there is one skin, the board's serial number.
    pub(crate) fn name(&self) -> &str {
        self.skin.as_deref().unwrap_or(&self.board.serial)
    }

    /// The sheet.
    ///
    /// # Errors
    /// It is damaged.
    pub(crate) fn sheet(&self) -> Result<Sheet> {
        Ok(parse_sheet(&self.sheet).context("the sheet of the recording")?.0)
    }

    fn calibration(&self) -> Result<Option<Calibration>> {
        let read = |text: &String| calibration_file::parse("the calibration of the recording", text);
        Ok(self.calibration.as_ref().map(read).transpose()?)
    }

    /// What presses taught, where that takes the place of the model.
    ///
    /// # Errors
    /// It is damaged.
    pub(crate) fn presses(&self) -> Result<Option<PressCalibration>> {
        let read = |text: &String| presses::file::parse("the calibration of the recording".to_owned(), text.clone());
        Ok(self.presses.as_ref().map(read).transpose()?)
    }

    /// What presses told of the sheet.
    ///
    /// # Errors
    /// They are damaged.
    pub(crate) fn told(&self) -> Result<Option<Arc<ToldSheet>>> {
        match &self.told {
            Some(told) if !told.is_sound() => {
                bail!("the calibration of the recording: its numbers do not fit one another")
            }
            told => Ok(told.clone().map(Arc::new)),
        }
    }

    /// Whether its forces are those of a typical rubber.
    pub(crate) fn is_uncalibrated(&self) -> bool {
        self.uncalibrated_n_per_mm2.is_some()
    }

    /// What its touch events are defined by. With a calibration dents are no touches.
    pub(crate) fn gestures(&self) -> GestureOptions {
        let defined = GestureOptions::default();
        GestureOptions {
            dent_part: defined.dent_part.filter(|_| self.calibration.is_none()),
            ..defined
        }
    }

    /// The options of its reconstruction. Pictures are made where they are asked for: no touch depends on them.
    ///
    /// # Errors
    /// They are damaged.
    pub(crate) fn options(&self) -> Result<LiveOptions> {
        Ok(LiveOptions {
            baseline_frames: self.baseline_frames,
            method: self.method.parse()?,
            polarity: self.rise.as_deref().map(str::parse).transpose()?,
            find_electrodes: self.find_electrodes,
            calibration: self.calibration()?,
            uncalibrated_n_per_mm2: self.uncalibrated_n_per_mm2,
            reach: self.reach,
            patience_s: self.patience_s,
            picture_s: f64::INFINITY,
            ..LiveOptions::default()
        })
    }

    /// Why this program may find other touches than the one that recorded; none where it is the same on such a machine.
    pub(crate) fn differs(&self) -> Option<String> {
        let (program, here) = (PROGRAM, machine());
        (self.program != program || self.machine != here).then(|| {
            format!(
                "recorded by {} on {}, this is {program} on {here}: touches may differ in their last digits",
                self.program, self.machine
            )
        })
    }
}

/// The session's message.
fn first(path: &Path) -> Result<Vec<u8>> {
    let file = path.display();
    let names = skin_file::recorded(path)?;
    if names.is_empty() {
        if let (of_file, Some(asked)) = recording::split(path) {
            bail!("{}: it is of one skin; leave #{asked} out", of_file.display());
        }
        let text = Reader::open(path)?.find(Topic::Session)?;
        return text.with_context(|| format!("{file}: the recording ends before its first message"));
    }
    let (of_file, asked) = recording::split(path);
    let asked = match asked {
        Some(asked) if names.contains(&asked) => asked,
        _ => bail!(
            "{}: a recording of several skins, {}; name one, such as {}#{}",
            of_file.display(),
            names.join(", "),
            of_file.display(),
            names[0]
        ),
    };
    let text = Reader::open(path)?.find(Topic::Session)?;
    text.with_context(|| format!("{}: nothing was recorded of {asked}", of_file.display()))
}

/// A baseline to the last bit; not a number is null.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct BaselineRecord {
    values_v: Vec<Option<f64>>,
    noise_v: Option<f64>,
    frames: usize,
    #[serde(default)]
    unlike: usize,
    #[serde(default)]
    moved: f64,
    deviations: Vec<(f64, f64)>,
}

fn number(v: f64) -> Option<f64> {
    v.is_finite().then_some(v)
}

impl From<&Baseline> for BaselineRecord {
    fn from(baseline: &Baseline) -> Self {
        Self {
            values_v: baseline.values_v.iter().map(|v| number(*v)).collect(),
            noise_v: number(baseline.noise_v),
            frames: baseline.frames,
            unlike: baseline.unlike,
            moved: baseline.moved,
            deviations: baseline.deviations.clone(),
        }
    }
}

impl From<BaselineRecord> for Baseline {
    fn from(record: BaselineRecord) -> Self {
        Self {
            values_v: record.values_v.iter().map(|v| v.unwrap_or(f64::NAN)).collect(),
            noise_v: record.noise_v.unwrap_or(f64::NAN),
            frames: record.frames,
            unlike: record.unlike,
            moved: record.moved,
            deviations: record.deviations,
        }
    }
}

/// What is said of a baseline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct NoteRecord {
    taken_unix_s: f64,
    stored: bool,
    earlier: usize,
    warning: Option<String>,
}

impl From<BaselineNote> for NoteRecord {
    fn from(note: BaselineNote) -> Self {
        Self {
            taken_unix_s: note.taken_unix_s,
            stored: note.stored,
            earlier: note.earlier,
            warning: note.warning,
        }
    }
}

impl From<NoteRecord> for BaselineNote {
    fn from(note: NoteRecord) -> Self {
        Self {
            taken_unix_s: note.taken_unix_s,
            stored: note.stored,
            earlier: note.earlier,
            warning: note.warning,
        }
    }
}

/// The touches that are there where a recording begins, with their numbers, and what they are doing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Touching {
    pub(crate) numbered: Numbered,
    pub(crate) gestures: Gestures,
}

/// A step of the live reconstruction beside the pictures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "step", rename_all = "snake_case")]
pub(crate) enum LiveRecord {
    /// A frame went into the baseline.
    Baseline { frame: u32, left: usize },
    /// A new one is taken from now on.
    Tare,
    /// This one is in force. A recording that begins among touches goes on with them.
    Resume {
        baseline: BaselineRecord,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        touching: Option<Box<Touching>>,
    },
    /// What is said of the one in force.
    InForce { note: Option<NoteRecord> },
    /// Something happened on the line.
    Event { said: Said },
    /// Bytes that follow came by a port that was opened again; the recorder writes it.
    Port,
}

/// The touches of a picture.
#[derive(Serialize)]
struct TouchesRecord<'a> {
    frame: u32,
    time_s: f64,
    touches: &'a [&'a Touch],
    events: &'a [TouchEvent],
    changed: bool,
    residual: f64,
    gap: f64,
    solve_us: f64,
    used: usize,
    lost_frames: u64,
    skipped_frames: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    doubt: Option<Doubt>,
    faults: &'a [Fault],
}

#[derive(Serialize)]
struct ElectrodesRecord<'a> {
    frame: Option<u32>,
    /// From 1.
    contacts: Vec<usize>,
    left_out: &'a [Finding],
    values: usize,
    used: usize,
}

/// The touches of a result that press.
pub(crate) fn pressed(result: &FrameResult) -> Vec<&Touch> {
    result.touches.iter().filter(|t| t.is_pressed()).collect()
}

/// Points are recorded every so often, s of the board's time: as often as a viewer draws.
const POINTS_S: f64 = 0.03;
/// A picture is recorded every so often, s of the board's time, where it shows something new.
const PICTURE_S: f64 = 1.0;
/// Width of a recorded picture, pixels.
const PICTURE_PX: u32 = 320;

/// Writes a session's messages.
pub(crate) struct Notes {
    tap: Tap,
    points_s: f64,
    picture_s: f64,
    picture: Option<Arc<Picture>>,
    contacts: Vec<usize>,
    left_out: Vec<Finding>,
    values: usize,
    pose: Pose,
}

/// Whether so much of the board's time has passed, or the board was reset.
fn due(last_s: &mut f64, now_s: f64, every_s: f64) -> bool {
    let is_due = !(0.0..every_s).contains(&(now_s - *last_s));
    if is_due {
        *last_s = now_s;
    }
    is_due
}

impl Notes {
    /// Of a session that was begun with this record.
    pub(crate) fn new(tap: Tap, record: &SessionRecord) -> Self {
        Self {
            tap,
            pose: record.place.as_ref().map(Place::pose).unwrap_or_default(),
            points_s: f64::NEG_INFINITY,
            picture_s: f64::NEG_INFINITY,
            picture: None,
            contacts: Vec::new(),
            left_out: Vec::new(),
            values: record.values,
        }
    }

    fn step(&self, frame_s: Option<f64>, step: &LiveRecord) {
        self.tap.put(Topic::Live, frame_s, step);
    }

    pub(crate) fn baseline_frame(&self, frame: &MeasuredFrame, left: usize) {
        let step = LiveRecord::Baseline {
            frame: frame.sequence,
            left,
        };
        self.step(Some(frame.time_s), &step);
    }

    pub(crate) fn tare(&self) {
        self.step(None, &LiveRecord::Tare);
    }

    pub(crate) fn resume(&self, baseline: &Baseline, touching: Option<Touching>) {
        let (baseline, touching) = (baseline.into(), touching.map(Box::new));
        self.step(None, &LiveRecord::Resume { baseline, touching });
    }

    pub(crate) fn event(&self, said: &Said) {
        let said = said.clone();
        self.step(None, &LiveRecord::Event { said });
    }

    pub(crate) fn in_force(&mut self, note: Option<BaselineNote>, left_out: Vec<Finding>) {
        let note = note.map(NoteRecord::from);
        self.step(None, &LiveRecord::InForce { note });
        self.left_out = left_out;
        self.contacts.clear();
        self.electrodes(
            None,
            self.values - self.left_out.iter().map(|f| f.values).sum::<usize>().min(self.values),
        );
    }

    fn electrodes(&self, frame: Option<&MeasuredFrame>, used: usize) {
        let record = ElectrodesRecord {
            frame: frame.map(|f| f.sequence),
            contacts: self.contacts.iter().map(|l| l + 1).collect(),
            left_out: &self.left_out,
            values: self.values,
            used,
        };
        self.tap.put(Topic::Electrodes, frame.map(|f| f.time_s), &record);
    }

    /// The touches of a picture, and what belongs to them.
    pub(crate) fn picture(
        &mut self,
        result: &FrameResult,
        frame: &MeasuredFrame,
        counters: LinkCounters,
        events: &[TouchEvent],
    ) {
        let touches = pressed(result);
        let record = TouchesRecord {
            frame: frame.sequence,
            time_s: frame.time_s,
            touches: &touches,
            events,
            changed: result.changed,
            residual: result.residual,
            gap: result.gap,
            solve_us: result.solve_us,
            used: result.used,
            lost_frames: counters.lost_frames,
            skipped_frames: counters.skipped_frames,
            doubt: result.doubt,
            faults: &result.faults,
        };
        self.tap.put(Topic::Touches, Some(frame.time_s), &record);
        if due(&mut self.points_s, frame.time_s, POINTS_S) {
            let point = |t: &&Touch| [t.x_mm, t.y_mm, t.rise, t.force_n.unwrap_or(f64::NAN)].map(|v| v as f32);
            let points: Vec<[f32; 4]> = touches.iter().map(point).collect();
            self.tap.points(frame.time_s, &points, &self.pose);
        }
        if result.contacts != self.contacts {
            self.contacts.clone_from(&result.contacts);
            self.electrodes(Some(frame), result.used);
        }
    }

    /// What is shown now.
    pub(crate) fn preview(&mut self, shown: Option<&Arc<Picture>>) {
        let Some(shown) = shown else { return };
        let old = self.picture.as_ref().is_some_and(|p| Arc::ptr_eq(p, shown));
        if old || !due(&mut self.picture_s, shown.time_s, PICTURE_S) {
            return;
        }
        self.picture = Some(Arc::clone(shown));
        let picture = Arc::clone(shown);
        self.tap.picture(shown.time_s, move || {
            let mut bytes = Vec::new();
            let drawn = png::render(&picture, PICTURE_PX).and_then(|canvas| canvas.encode_png(&mut bytes));
            drawn
                .map_err(|e| tracing::error!("a picture for the recording: {e}"))
                .ok()?;
            Some(bytes)
        });
    }
}

#[cfg(test)]
mod tests;
