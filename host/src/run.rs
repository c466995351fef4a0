//! `skin run`, and `skin` alone: live pictures of the board, or of the simulated skin when there is no board.

use crate::baselines::{self, Baselines};
use crate::commands::Commands;
use crate::config::Config;
use crate::files::baseline_file::{Subject, unix_s};
use crate::live_output::Output;
use crate::live_run::Run;
use crate::page::page;
use crate::presses::file::PressCalibration;
use crate::presses::live::Chosen;
use crate::presses::locate;
use crate::recorded::{Notes, Recorded, SessionRecord};
use crate::recording_file::RecordTo;
use crate::run_arguments::{ShowArguments, SourceArguments, Start};
use crate::say::say;
use crate::source::{Source, connect};
use crate::usage::Usage;
use crate::{ending, live_run, progress, scene, sheet};
use ::forward::{Drive, Pattern, Sheet};
use anyhow::{Result, anyhow, bail};
use clap::Args;
use hil_sim::BOARD_NAME;
use inverse::force::TYPICAL_N_PER_MM2;
use inverse::live::{Live, LiveOptions};
use inverse::reference::imager::Imager;
use inverse::touches::gestures::Gestures;
use link::Session;
use protocol::Watch;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;
use view::web::LiveView;

/// Arguments of `skin run`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    source: SourceArguments,
    #[command(flatten)]
    show: ShowArguments,
    /// Records everything into this file, for skin replay, info and export [default: a name from date, time and board].
    #[arg(long, value_name = "FILE", num_args = 0..=1)]
    record: Option<Option<PathBuf>>,
}

/// What a run is to do beside its source.
pub(crate) struct Outputs<'a> {
    pub(crate) show: &'a ShowArguments,
    /// Whether there is a page.
    pub(crate) page: bool,
    /// The file to record into; the inner none for a name of its own.
    pub(crate) record: Option<Option<&'a Path>>,
    /// End after so long, s of the board's time since the first picture.
    pub(crate) seconds: Option<f64>,
}

/// Runs the command.
///
/// # Errors
/// A port that does not open or answer, a board lost on the way, a page that cannot be served, a recording that cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let outputs = Outputs {
        show: &arguments.show,
        page: !arguments.show.json,
        record: arguments.record.as_ref().map(Option::as_deref),
        seconds: None,
    };
    live(&arguments.source, &outputs)
}

/// Frames of a board to pictures.
///
/// # Errors
/// As [`run`].
pub(crate) fn live(arguments: &SourceArguments, outputs: &Outputs<'_>) -> Result<()> {
    if arguments.watch && arguments.baseline == Start::Stored {
        let why = "--watch with --baseline stored: the board learns its watch on a sheet that nothing rests on; leave one of them out";
        return Err(Usage(why.to_owned()).into());
    }
    let stop = ending::flag()?;
    let config = Config::load()?;
    let calibration = arguments.calibration.as_deref().or(config.calibration.as_deref());
    let calibration = Chosen::read(calibration, arguments)?;
    let scene = arguments.scene.as_deref().map(scene::load).transpose()?.map(|mut s| {
        s.scene.loop_s.get_or_insert(s.duration_s);
        s
    });
    let given = match (&scene, arguments.sheet.as_deref().or(config.sheet.as_deref())) {
        (Some(scene), _) => Some(scene.sheet.clone()),
        (None, Some(path)) => Some(sheet::load(Some(path))?.0),
        (None, None) => None,
    };
    let sheet = calibration.sheet(given)?.unwrap_or_else(Sheet::paper);
    let recording = outputs.record.map(RecordTo::new).transpose()?;
    let Source {
        session,
        name: source,
        scene: held,
    } = connect(arguments, &sheet, scene.as_ref(), recording.as_ref().map(RecordTo::tap))?;
    ending::stops(session.link())?;
    if arguments.every_frame {
        session.link().hold(live_run::HELD);
    }
    let (wired, described) = (usize::from(session.hello().electrodes), sheet.electrodes.len());
    if wired != described {
        bail!(
            "{source} has {wired} electrodes, the sheet {described}; describe the sheet that is wired to it with --sheet"
        );
    }
    let mut baselines = baselines(arguments, &session, &sheet)?;
    // Before anything is computed: it may be refused.
    let stored = (arguments.baseline == Start::Stored).then(|| baselines.start_from_stored());
    let stored = stored.transpose()?;
    let learned = calibration.learned.as_ref();
    let pattern = pattern(&session, &arguments.wires)?;
    if let Some(learned) = learned {
        locate::order(learned, &source, pattern.measurements())?;
    }
    let options = LiveOptions {
        baseline_frames: arguments.baseline_frames.unwrap_or_else(|| baseline_frames(&session)),
        polarity: arguments.rise,
        find_electrodes: !arguments.trust_electrodes,
        calibration: calibration.rubber,
        // Of a learned touch only the strength is known.
        uncalibrated_n_per_mm2: (calibration.rubber.is_none() && learned.is_none()).then_some(TYPICAL_N_PER_MM2),
        ..LiveOptions::default()
    };
    let started_unix_s = match &recording {
        Some(recording) => recording.tap().clock().started_unix_s(),
        None => unix_s(SystemTime::now()),
    };
    let recorded = Recorded {
        hello: session.hello(),
        source: &source,
        values: session.plan().value_count(),
        sheet: &sheet,
        wires: &arguments.wires,
        presses: learned,
    };
    let record = SessionRecord::new(&recorded, &options, started_unix_s)?;
    let recorder = recording.map(|r| r.begin(&record)).transpose()?;
    let mut live = Live::new(modelled(&sheet, pattern)?, options);
    if let Some(learned) = learned {
        live = live.with_learned(learned.taught());
    }
    if record.is_uncalibrated() {
        say!("forces are those of a typical rubber, uncalibrated; skin calibrate measures this one");
    }
    let mut run = Run {
        show: outputs.show,
        seconds: outputs.seconds,
        every_frame: arguments.every_frame,
        session: &session,
        live: &mut live,
        gestures: Gestures::new(record.gestures()),
        commands: Commands::new(&outputs.show.on)?,
        output: &mut Output::new(open_page(outputs)?, outputs.show, shown_source(&source, learned)),
        baselines: &mut baselines,
        watch: watch_of(arguments, &session)?,
        held,
        wanted: None,
        notes: recorder.as_ref().map(|r| Notes::new(r.tap().clone(), recorded.values)),
        recorder,
        replayed: None,
    };
    run.output.header(&session, &record, &run.live.imager().grid)?;
    if let Some(baseline) = stored {
        if let Some(notes) = &run.notes {
            notes.resume(&baseline);
        }
        run.live.resume(baseline)?;
    }
    let outcome = run.pump(&stop);
    run.end(outcome)
}

/// The model of a session's sheet.
pub(crate) fn imager(session: &Session, sheet: &Sheet, wires: &[usize]) -> Result<Arc<Imager>> {
    modelled(sheet, pattern(session, wires)?)
}

/// The source as it is shown: of a learned sheet a touch is a part of its usual press.
pub(crate) fn shown_source(source: &str, learned: Option<&PressCalibration>) -> String {
    match learned {
        Some(learned) => format!(
            "{source}, taught by {} presses: 100 % is the usual one",
            learned.presses
        ),
        None => source.to_owned(),
    }
}

/// What a session measures on the sheet.
fn pattern(session: &Session, wires: &[usize]) -> Result<Pattern> {
    let pattern = Pattern::from_pairs(session.electrodes(), session.measurements())?;
    sheet::rewired(pattern, wires)
}

fn modelled(sheet: &Sheet, pattern: Pattern) -> Result<Arc<Imager>> {
    let cell_mm = sheet::cell_mm(sheet)?;
    let modelled = progress::meanwhile("modelling the sheet", false, || {
        Imager::new(sheet, Drive::PAPER, pattern, cell_mm)
    });
    Ok(Arc::new(modelled?))
}

fn open_page(outputs: &Outputs<'_>) -> Result<Option<LiveView>> {
    outputs.page.then(|| page(outputs.show)).transpose()
}

/// The frames of so long make the baseline, if they are more than so many: fast plans have more noise in each.
const BASELINE_S: f64 = 0.7;

fn baseline_frames(session: &Session) -> usize {
    let frames = (BASELINE_S / session.frame_s().max(1e-3)).round() as usize;
    frames.max(LiveOptions::default().baseline_frames)
}

/// What the board watches by, where it is asked to.
fn watch_of(arguments: &SourceArguments, session: &Session) -> Result<Option<Watch>> {
    if !arguments.watch {
        return Ok(None);
    }
    let watch = Watch::for_board(session.hello());
    let none = || anyhow!("there is no watch for this number of electrodes; leave --watch out");
    watch.map(Some).ok_or_else(none)
}

/// The baselines of this board, and where they are stored.
fn baselines(arguments: &SourceArguments, session: &Session, sheet: &Sheet) -> Result<Baselines> {
    let hello = session.hello();
    let folder = baselines::folder(arguments.state_dir.as_deref(), hello);
    if folder.is_none() {
        if arguments.baseline != Start::New {
            let name = if arguments.baseline == Start::Stored {
                "stored"
            } else {
                "replace"
            };
            bail!("--baseline {name}: there is no folder for it, a simulated skin has none; name one with --state-dir");
        }
        if hello.board != BOARD_NAME {
            say!("the baseline is not stored: neither XDG_STATE_HOME nor HOME is set; name a folder with --state-dir");
        }
    }
    let subject = Subject::new(hello, sheet, session.plan());
    Ok(Baselines::new(
        folder.as_deref(),
        subject,
        arguments.baseline == Start::Replace,
    ))
}
