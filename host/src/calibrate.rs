//! `skin calibrate`: the rubber's parameters from a press-and-hold; maps of a real skin from presses at known places.

use crate::files::calibration_file::{self, RubberKeys};
use crate::files::press_table;
use crate::json;
use crate::played_board::PlayedBoard;
use crate::presses::file::{self, Of};
use crate::presses::store;
use crate::progress::Progress;
use crate::recorded::SessionRecord;
use crate::{baselines, number, presses, scene, sheet};
use ::forward::{Drive, Geometry, Pattern, Sheet};
use ::recording::Speed;
use anyhow::{Context, Result, anyhow, bail};
use clap::{ArgGroup, Args, Subcommand};
use hil_sim::{Pace, SimPort};
use inverse::force::calibration::{self, Fit, StandardErrors};
use inverse::force::press::Recorder;
use inverse::force::recording::{self, Sample};
use inverse::live::LiveOptions;
use inverse::reference::imager::Imager;
use inverse::solvers::Method;
use link::plans::adjacent_plan;
use link::{MeasuredFrame, Session, ports};
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use studies::paper::rig::{Mounted, Press, Rig};
use studies::paper::simulated_rig::SimulatedRig;

/// Arguments of `skin calibrate`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("source").required(true)), args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: Option<What>,
    /// A recorded press-and-hold (CSV with columns time_s, rise_mm2 and, where they are known, force_n and area_mm2).
    #[arg(group = "source", value_name = "TABLE")]
    file: Option<PathBuf>,
    /// Serial port of the board: records now.
    #[arg(long, group = "source", value_name = "PORT")]
    port: Option<String>,
    /// A recording of a press-and-hold, of one force that --force-n says, that begins with nothing on the sheet.
    #[arg(long, group = "source", value_name = "RECORDING")]
    from: Option<PathBuf>,
    /// A press-and-hold of the paper's tip on the simulated skin.
    #[arg(long, group = "source")]
    simulate: bool,
    /// A scene with one touch at a time, a TOML file or a name of the library such as creep; its forces are the gauge's.
    #[arg(long, group = "source", value_name = "FILE", hide_short_help = true)]
    scene: Option<PathBuf>,
    /// The force that is held, N [default: the table's forces; simulated: 25].
    #[arg(long, allow_negative_numbers = true, value_name = "N", value_parser = number::positive("a force in newtons above 0"))]
    force_n: Option<f64>,
    /// How long to record after the baseline, s; a scene has its own length.
    #[arg(long, allow_negative_numbers = true, default_value_t = 45.0, value_name = "S", value_parser = number::positive("a time in seconds above 0"))]
    seconds: f64,
    /// Fit the exponent of the resistivity too; it takes a recording of more than one force.
    #[arg(long, hide_short_help = true)]
    exponent: bool,
    /// The sheet of the board, or of the simulated skin, which is pressed in the middle; a TOML file as for `skin forward` [default: the
    /// paper's disc].
    #[arg(long, value_name = "FILE", conflicts_with_all = ["file", "from", "scene"])]
    sheet: Option<PathBuf>,
    /// Where to write the calibration.
    #[arg(long, default_value = "calibration.toml", value_name = "FILE")]
    out: PathBuf,
    /// Writes the recording to this file, a table to calibrate from again.
    #[arg(long, value_name = "FILE", hide_short_help = true)]
    save: Option<PathBuf>,
    /// Source of the simulated noise.
    #[arg(long, default_value_t = 1, value_name = "N", hide_short_help = true)]
    seed: u64,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Whether it needs nobody to press.
    pub(crate) fn is_alone(&self) -> bool {
        match &self.what {
            Some(What::Presses(presses)) => presses.is_alone(),
            Some(What::Marks(_) | What::Gcode(_)) => true,
            None => self.port.is_none(),
        }
    }
}

/// What else can be calibrated.
#[derive(Debug, Subcommand)]
enum What {
    /// Maps of a real skin, from presses at known places: guided through now, by a robot's list, or of a table.
    Presses(Box<presses::calibrate::Arguments>),
    /// Where to press: a list, and a drawing to print at true scale.
    Marks(presses::marks::Arguments),
    /// G-code by which a 3D printer presses the marks, and the list of when and where.
    Gcode(presses::gcode::Arguments),
}

#[derive(Serialize)]
struct Line {
    delayed_ratio: f64,
    tau_s: f64,
    exponent: f64,
    unit_rise_mpa: f64,
    force_sd_n: f64,
    standard_error: StandardErrors,
    residual_mm2: f64,
    frames: usize,
}

/// Runs the command.
///
/// # Errors
/// A recording that cannot be read or made, or that does not tell the parameters; a file that cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.what {
        Some(What::Presses(of_presses)) => return presses::calibrate::run(of_presses),
        Some(What::Marks(marks)) => return presses::marks::run(marks),
        Some(What::Gcode(gcode)) => return presses::gcode::run(gcode),
        None => {}
    }
    // Before anything is pressed.
    let folder = arguments.port.as_ref().and_then(|_| baselines::state(None, false));
    if let Some(folder) = &folder {
        store::try_folder(folder).with_context(|| {
            format!(
                "{}: the calibration cannot be stored there; set XDG_STATE_HOME to another folder",
                folder.display()
            )
        })?;
    }
    let (samples, of) = match (&arguments.file, &arguments.port, &arguments.scene, &arguments.from) {
        (Some(table), ..) => (press_table::read(table, arguments.force_n)?, Of::default()),
        (_, Some(port), ..) => record(arguments, port)?,
        (.., Some(file), _) => play(arguments, file)?,
        (.., Some(recording)) => replay(arguments, recording)?,
        _ => simulate(arguments)?,
    };
    if let Some(path) = &arguments.save {
        calibration_file::write(path, &press_table::text(&samples))?;
    }
    let fit = calibration::fit(&samples, arguments.exponent)?;
    let rubber = RubberKeys::of(&fit.calibration, Some(fit.errors));
    let with_presses = file::put_rubber(&arguments.out, rubber.clone(), of.clone())?;
    // Of a board, and not of a simulated one.
    let stored = match (&of.serial, folder) {
        (Some(serial), Some(folder)) => Some(store::place(&folder, serial)?),
        _ => None,
    };
    if let Some(path) = &stored {
        file::put_rubber(path, rubber, of)?;
    }
    let mut out = crate::say::stdout();
    if arguments.json {
        out.write_all(&json::line(&line(&fit, samples.len()))?)?;
    } else {
        write!(out, "{}", words(&fit))?;
    }
    eprintln!(
        "{}: written; skin run --calibration {} shows forces",
        arguments.out.display(),
        arguments.out.display()
    );
    if with_presses {
        eprintln!("{}: the presses that were in it are kept", arguments.out.display());
    }
    if let Some(path) = &stored {
        eprintln!(
            "{}: stored; skin run loads it by itself, --calibration none does without",
            path.display()
        );
    }
    Ok(())
}

fn line(fit: &Fit, frames: usize) -> Line {
    let solid = fit.calibration.solid;
    Line {
        delayed_ratio: solid.delayed_ratio,
        tau_s: solid.tau_s,
        exponent: solid.exponent,
        unit_rise_mpa: solid.unit_rise_mpa,
        force_sd_n: fit.calibration.force_sd_n,
        standard_error: fit.errors,
        residual_mm2: fit.residual_mm2,
        frames,
    }
}

fn words(fit: &Fit) -> String {
    let (solid, errors) = (fit.calibration.solid, fit.errors);
    let creep = if solid.delayed_ratio > 0.0 {
        format!(
            "delayed part    {:.1} ± {:.1} % of the instant one\ntime constant   {:.2} ± {:.2} s\n",
            100.0 * solid.delayed_ratio,
            100.0 * errors.delayed_ratio,
            solid.tau_s,
            errors.tau_s
        )
    } else {
        "delayed part    none above the noise\n".to_owned()
    };
    let exponent = if errors.exponent > 0.0 {
        format!("exponent        {:.3} ± {:.3}\n", solid.exponent, errors.exponent)
    } else {
        String::new()
    };
    format!(
        "unit rise       {:.4} ± {:.4} N/mm²\n{creep}{exponent}one frame       ± {:.2} N\n",
        solid.unit_rise_mpa, errors.unit_rise_mpa, fit.calibration.force_sd_n
    )
}

/// When the simulated tip comes down (s), how fast, and for which part of the time it stays.
const DOWN_S: f64 = 1.5;
const RAMP_S: f64 = 0.5;
const HELD: f64 = 0.6;

fn simulate(arguments: &Arguments) -> Result<(Vec<Sample>, Of)> {
    let (sheet, _) = sheet::load(arguments.sheet.as_deref())?;
    let (low, high) = Geometry::new(&sheet)?.bounding_box();
    let at = [0, 1].map(|k| 0.5 * (low[k] + high[k]));
    let force_n = arguments.force_n.unwrap_or(25.0);
    let (lifted, end) = (DOWN_S + HELD * arguments.seconds, DOWN_S + arguments.seconds);
    // With an exponent to tell, half of the force first.
    let first = if arguments.exponent { 0.5 * force_n } else { force_n };
    let half = DOWN_S + 0.5 * HELD * arguments.seconds;
    let path = [
        [DOWN_S, 0.0],
        [DOWN_S + RAMP_S, first],
        [half, first],
        [half + RAMP_S, force_n],
        [lifted, force_n],
        [lifted + RAMP_S, 0.0],
        [end, 0.0],
    ];
    if path.windows(2).any(|w| w[1][0] <= w[0][0]) {
        bail!(
            "--seconds {} is too short to press and hold; give 5 or more",
            arguments.seconds
        );
    }
    let Mounted { port, gauge } = SimulatedRig::on(&sheet)?
        .mount(&[Press::tip(at, &path)], true, arguments.seed)
        .map_err(|e| anyhow!(e))?;
    let session = Session::start(port, adjacent_plan)?;
    let samples = take(&session, || live(&session), &sheet, Some(at), end, gauge, |_| ())?;
    Ok((samples, Of::sheet(&sheet)?))
}

fn play(arguments: &Arguments, file: &Path) -> Result<(Vec<Sample>, Of)> {
    let mut file = scene::load(file)?;
    file.config.electronics.seed = arguments.seed;
    let most = (0..=1000)
        .map(|k| file.scene.truth(1e-3 * f64::from(k) * file.duration_s).len())
        .max();
    if most != Some(1) {
        bail!(
            "the scene \"{}\" has {} touches at a time; calibrate with one that has one",
            file.title,
            most.unwrap_or(0)
        );
    }
    let session = Session::start(Box::new(SimPort::new(file.board()?, Pace::Unpaced)?), adjacent_plan)?;
    let gauge = |t_s: f64| file.scene.truth(t_s).iter().map(|t| t.force_n).sum();
    let samples = take(
        &session,
        || live(&session),
        &file.sheet,
        None,
        file.duration_s,
        gauge,
        |_| (),
    )?;
    Ok((samples, Of::sheet(&file.sheet)?))
}

fn held(arguments: &Arguments) -> Result<f64> {
    let force_n = arguments.force_n;
    force_n.ok_or_else(|| anyhow!("give the force that is held on the sheet with --force-n"))
}

/// The press-and-hold of a recording, as it is recorded of a board.
fn replay(arguments: &Arguments, path: &Path) -> Result<(Vec<Sample>, Of)> {
    let force_n = held(arguments)?;
    let sheet = SessionRecord::read(path)?.sheet()?;
    let board = PlayedBoard::open(path, Speed::Unpaced)?;
    let next = || board.frame();
    let mut samples = take(&board.session, next, &sheet, None, arguments.seconds, |_| 0.0, |_| ())
        .with_context(|| path.display().to_string())?;
    recording::hold(&mut samples, force_n)?;
    Ok((samples, Of::sheet(&sheet)?))
}

/// The next frame of a board.
fn live(session: &Session) -> Result<Option<MeasuredFrame>> {
    loop {
        match session.frame(LOOK)? {
            Some(frame) => return Ok(Some(frame)),
            None => session.check_silence(SILENCE)?,
        }
    }
}

fn record(arguments: &Arguments, path: &str) -> Result<(Vec<Sample>, Of)> {
    let force_n = held(arguments)?;
    let (sheet, _) = sheet::load(arguments.sheet.as_deref())?;
    let port = ports::open(path).map_err(|e| anyhow!(e))?;
    let session = Session::start(port, adjacent_plan).with_context(|| path.to_owned())?;
    crate::ending::stops(session.link())?;
    eprintln!("taking the baseline, do not touch");
    let mut samples = take(
        &session,
        || live(&session),
        &sheet,
        None,
        arguments.seconds,
        |_| 0.0,
        |ready| {
            if ready {
                eprintln!(
                    "press {force_n} N, hold for about {:.0} s, let go; recording for {:.0} s",
                    HELD * arguments.seconds,
                    arguments.seconds
                );
            }
        },
    )?;
    recording::hold(&mut samples, force_n)?;
    let hello = session.hello();
    Ok((samples, Of::sheet(&sheet)?.with_board(&hello.board, &hello.serial)))
}

/// How often the loop looks up while no frame comes.
const LOOK: Duration = Duration::from_millis(100);
/// A board that says nothing for so long is gone. A recording can wait longer than a live picture: for a board that is slow to
/// begin, or a machine that is busy.
const SILENCE: Duration = Duration::from_secs(10);

/// Records the frames that `next` gives until `seconds` after the baseline or to their end, with the force that the gauge shows at a time; `ready` is told when the baseline
/// is there.
fn take(
    session: &Session,
    mut next: impl FnMut() -> Result<Option<MeasuredFrame>>,
    sheet: &Sheet,
    near_mm: Option<[f64; 2]>,
    seconds: f64,
    gauge: impl Fn(f64) -> f64,
    mut ready: impl FnMut(bool),
) -> Result<Vec<Sample>> {
    let imager = Imager::new(
        sheet,
        Drive::PAPER,
        Pattern::from_pairs(session.electrodes(), session.measurements())?,
        Method::Nnls.cell_mm_on(sheet)?,
    )?;
    let periods = f64::from(session.plan().quarters()) / 4.0;
    let frame_s = periods / session.hello().excitation_hz();
    let frames = LiveOptions::default().baseline_frames;
    let mut recorder = Recorder::new(Arc::new(imager), frames, frame_s, near_mm);
    let (mut end_s, mut last_s) = (f64::INFINITY, f64::NEG_INFINITY);
    let progress = Progress::new("press-and-hold");
    loop {
        let Some(frame) = next()? else {
            if !recorder.is_ready() {
                bail!("it ends before its baseline was taken");
            }
            return Ok(recorder.into_samples());
        };
        // In milliseconds, from the end of the baseline on.
        let [done, whole] = [seconds - (end_s - frame.time_s), seconds].map(|s| (1e3 * s).max(0.0) as usize);
        progress.at(done, whole);
        if frame.time_s <= last_s {
            bail!(
                "the board's time went from {last_s:.2} to {:.2} s: it was reset, or its clock stands still; press and hold once more",
                frame.time_s
            );
        }
        last_s = frame.time_s;
        let before = recorder.is_ready();
        recorder.take(frame.time_s, &frame.values_v, gauge(recorder.middle_s(frame.time_s)))?;
        if recorder.is_ready() && !before {
            end_s = frame.time_s + seconds;
            ready(true);
        }
        if frame.time_s > end_s {
            return Ok(recorder.into_samples());
        }
    }
}
