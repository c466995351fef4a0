//! A session with a board, or with the simulated skin: from options to live pictures.

use crate::baselines::{self, Baselines};
use crate::commands::Commands;
use crate::config::Config;
use crate::files::baseline_file::{Subject, unix_s};
use crate::live_output::Output;
use crate::live_run::Run;
use crate::page::page;
use crate::presses::live::Chosen;
use crate::presses::locate;
use crate::recordable::Recordable;
use crate::recorded::{Notes, Recorded, SessionRecord};
use crate::recording_file::RecordTo;
use crate::ros2::{Described, Ros2};
use crate::run_arguments::{ShowArguments, SourceArguments, Start};
use crate::say::say;
use crate::skin_file::Skin;
use crate::source::{Source, connect};
use crate::{ending, live_run, progress, scene, sheet};
use ::forward::{Drive, Pattern, Sheet};
use anyhow::{Result, anyhow, bail};
use hil_sim::{BOARD_NAME, SceneFile};
use inverse::force::TYPICAL_N_PER_MM2;
use inverse::live::{Live, LiveOptions};
use inverse::reference::imager::Imager;
use inverse::solvers::Method;
use inverse::touches::gestures::Gestures;
use link::{LinkCounters, Session};
use protocol::Watch;
use recording::Switch;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Instant, SystemTime};
use view::web::LiveView;

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

/// What a session is a part of.
pub(crate) struct Within<'a> {
    pub(crate) stop: &'a AtomicBool,
    pub(crate) recording: Option<RecordTo>,
    /// The skin, of several.
    pub(crate) skin: Option<&'a Skin>,
    /// Its page, which is served already.
    pub(crate) page: Option<LiveView>,
    /// Where its node is.
    pub(crate) ros: Option<&'a Ros2>,
}

/// What became of a session.
pub(crate) struct Ran {
    pub(crate) counters: LinkCounters,
    /// How long its frames took by the board's clock, and by this computer's, s.
    pub(crate) board_s: f64,
    pub(crate) host_s: f64,
}

/// Boards are looked for one after the other: who looks asks every port.
static LOOKING: Mutex<()> = Mutex::new(());

/// Frames of one board to pictures.
///
/// # Errors
/// The board, its sheet or a file cannot be used; the error says what to do.
pub(crate) fn one(arguments: &SourceArguments, outputs: &Outputs<'_>, within: Within<'_>) -> Result<Ran> {
    let Within {
        stop,
        recording,
        skin,
        page,
        ros,
    } = within;
    let config = Config::load()?;
    let calibration = arguments.calibration.as_deref().or(config.calibration.as_deref());
    let calibration = Chosen::read(calibration, arguments)?;
    let scene = scene_of(arguments)?;
    let given = match (&scene, arguments.sheet.as_deref().or(config.sheet.as_deref())) {
        (Some(scene), _) => Some(scene.sheet.clone()),
        (None, Some(path)) => Some(sheet::load(Some(path))?.0),
        (None, None) => None,
    };
    let is_given = given.is_some();
    let sheet = calibration.sheet(given)?.unwrap_or_else(Sheet::paper);
    let tap = recording.as_ref().map(|recording| recording.tap().clone());
    let switch = Switch::default();
    switch.set(tap.clone());
    let looking = LOOKING.lock().unwrap_or_else(PoisonError::into_inner);
    let Source {
        session,
        name: source,
        scene: held,
    } = connect(arguments, &sheet, scene.as_ref(), &switch)?;
    drop(looking);
    let connected = Instant::now();
    ending::stops(session.link())?;
    let (calibration, sheet, said) = calibration.or_stored(arguments, &session, (sheet, is_given))?;
    said.iter().for_each(|text| say!("{text}"));
    if arguments.every_frame {
        session.link().hold(live_run::HELD);
    }
    check_electrodes(&source, &session, &sheet)?;
    let mut baselines = baselines(arguments, &session, &sheet)?;
    // Before anything is computed: it may be refused.
    let stored = (arguments.baseline == Start::Stored).then(|| baselines.start_from_stored());
    let stored = stored.transpose()?;
    let learned = calibration.learned.as_ref();
    let pattern = pattern(&session, &arguments.wires)?;
    if let Some(learned) = learned {
        locate::order(learned, &source, pattern.measurements())?;
    }
    // Pictures are made where an output wants them.
    let options = live_options(arguments, &session, &calibration, f64::INFINITY);
    let started_unix_s = match &tap {
        Some(tap) => tap.clock().started_unix_s(),
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
    let mut record = SessionRecord::new(&recorded, &options, started_unix_s)?;
    record.calibrated_by = calibration.note.clone();
    record.told = calibration.told.as_deref().cloned();
    if let Some(skin) = skin {
        record.skin = Some(skin.name.clone());
        record.place = skin.place.clone();
    }
    let recorder = recording.map(|r| r.begin(&record)).transpose()?.flatten();
    // Others find it while the sheet is modelled.
    let node = ros.map(|ros| {
        ros.node(&Described {
            skin: record.skin.as_deref(),
            place: record.place.as_ref(),
            serial: &record.board.serial,
            live: true,
        })
    });
    let node = node.transpose()?;
    let nominal = modelled(&sheet, pattern)?;
    let live = Live::new(nominal, options).with_told(calibration.told.clone());
    let mut live = match learned {
        Some(learned) => live.with_learned(learned.taught()),
        None => live,
    };
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
        commands: Commands::new(&outputs.show.on, record.place.as_ref())?,
        output: &mut Output::new(
            page.map_or_else(|| open_page(outputs, skin), |page| Ok(Some(page)))?,
            outputs.show,
            shown_source(&source, &record),
        ),
        baselines: &mut baselines,
        watch: watch_of(arguments, &session)?,
        held,
        wanted: None,
        renews: true,
        notes: tap.map(|tap| Notes::new(tap, &record)),
        recorder,
        not_recorded: Ok(()),
        recordable: Some(Recordable::new(switch, record.clone())),
        replayed: None,
    };
    if let Some(node) = node {
        run.output.set_node(node);
    }
    run.output.header(&session, &record, &run.live.imager().grid)?;
    if let Some(baseline) = stored {
        if let Some(notes) = &run.notes {
            notes.resume(&baseline, None);
        }
        run.live.resume(baseline)?;
    }
    let outcome = run.pump(stop);
    let ran = Ran {
        counters: session.link().counters(),
        board_s: session.link().counters().frames as f64 * session.frame_s(),
        host_s: connected.elapsed().as_secs_f64(),
    };
    run.end(outcome)?;
    Ok(ran)
}

/// The scene that is asked for, over and over.
///
/// # Errors
/// It cannot be read.
pub(crate) fn scene_of(arguments: &SourceArguments) -> Result<Option<SceneFile>> {
    let mut scene = arguments.scene.as_deref().map(scene::load).transpose()?;
    if let Some(scene) = &mut scene {
        scene.scene.loop_s.get_or_insert(scene.duration_s);
    }
    Ok(scene)
}

/// Refuses a sheet that cannot be the one that is wired to a board.
///
/// # Errors
/// Its electrodes are fewer or more.
pub(crate) fn check_electrodes(source: &str, session: &Session, sheet: &Sheet) -> Result<()> {
    let (wired, described) = (usize::from(session.hello().electrodes), sheet.electrodes.len());
    if wired != described {
        bail!(
            "{source} has {wired} electrodes, the sheet {described}; describe the sheet that is wired to it with --sheet"
        );
    }
    Ok(())
}

/// How a session's frames are reconstructed, with a picture so often at least, s.
pub(crate) fn live_options(
    arguments: &SourceArguments,
    session: &Session,
    calibration: &Chosen,
    picture_s: f64,
) -> LiveOptions {
    let usual = LiveOptions::default();
    // Of a learned touch only the strength is known.
    let uncalibrated = calibration.rubber.is_none() && calibration.learned.is_none();
    LiveOptions {
        picture_s,
        baseline_frames: arguments.baseline_frames.unwrap_or_else(|| baseline_frames(session)),
        polarity: arguments.rise,
        find_electrodes: !arguments.trust_electrodes,
        calibration: calibration.rubber,
        uncalibrated_n_per_mm2: uncalibrated.then_some(TYPICAL_N_PER_MM2),
        ..usual
    }
}

/// Time from one frame to the next, s, by their own times. Where these go back, as after a reset, or stand still, it is that of a frame.
pub(crate) fn passed_s(last_s: f64, now_s: f64, frame_s: f64) -> f64 {
    let passed = now_s - last_s;
    if passed > 0.0 { passed } else { frame_s }
}

/// The model of a session's sheet.
pub(crate) fn imager(session: &Session, sheet: &Sheet, wires: &[usize]) -> Result<Arc<Imager>> {
    modelled(sheet, pattern(session, wires)?)
}

/// The source as it is shown: of a learned sheet a touch is a part of its usual press.
pub(crate) fn shown_source(source: &str, record: &SessionRecord) -> String {
    let note = record.calibrated_by.as_ref();
    let stored = if note.is_some_and(|note| note.stored) {
        ", by its stored calibration"
    } else {
        ""
    };
    match (record.learned_from, note) {
        (Some(presses), _) => format!("{source}{stored}, taught by {presses} presses: 100 % is the usual one"),
        (None, Some(note)) if note.force => format!("{source}{stored}, calibrated for force"),
        _ => format!("{source}{stored}"),
    }
}

/// What a session measures on the sheet.
///
/// # Errors
/// A list of wires that names not every electrode once.
pub(crate) fn pattern(session: &Session, wires: &[usize]) -> Result<Pattern> {
    let pattern = Pattern::from_pairs(session.electrodes(), session.measurements())?;
    sheet::rewired(pattern, wires)
}

fn modelled(sheet: &Sheet, pattern: Pattern) -> Result<Arc<Imager>> {
    let cell_mm = Method::Nnls.cell_mm_on(sheet)?;
    let modelled = progress::meanwhile("modelling the sheet", || {
        Imager::new(sheet, Drive::PAPER, pattern, cell_mm)
    });
    Ok(Arc::new(modelled?))
}

/// The page of the only skin.
fn open_page(outputs: &Outputs<'_>, skin: Option<&Skin>) -> Result<Option<LiveView>> {
    (outputs.page && skin.is_none()).then(|| page(outputs.show)).transpose()
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever a board's clock does, time passes: nothing that waits for it waits for ever.
    #[test]
    fn time_passes_with_every_frame() {
        assert_eq!(passed_s(2.0, 2.5, 0.1), 0.5);
        for stands_or_begins_anew in [2.0, 1.0, 0.0, f64::NAN] {
            assert_eq!(passed_s(2.0, stands_or_begins_anew, 0.1), 0.1);
        }
    }
}
