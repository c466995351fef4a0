//! `skin run`, and `skin` alone: live pictures of the board, or of the simulated skin when there is no board.

use crate::baselines::{Baselines, state_folder};
use crate::files::baseline_file::Subject;
use crate::files::calibration_file;
use crate::live_output::Output;
use crate::recorded::{Notes, Recorded, SessionRecord};
use crate::recording_file::{self, file_name};
use crate::replayed::Replayed;
use crate::say::{self, say};
use crate::usage::Usage;
use crate::{board, plan, scene, sheet, simulated_skin};
use ::forward::{Drive, Pattern, Sheet};
use anyhow::{Context, Result, anyhow, bail};
use clap::builder::RangedU64ValueParser;
use clap::{Args, ValueEnum};
use hil_sim::{BOARD_NAME, SceneFile, SimPort};
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::reference::imager::Imager;
use inverse::touches::polarity::Polarity;
use link::plans::PlanChoice;
use link::{LinkNotices, MeasuredFrame, Port, Session, ports};
use protocol::{Hello, QUARTERS, Watch, Watching};
use recording::{Recorder, Tap, WaitingRecorder};
use std::io::IsTerminal;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use view::web::{Command as PageCommand, DEFAULT_PORT, LiveOptions as PageOptions, LiveView};

/// Which baseline a session starts with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Start {
    /// A new one. It is stored unless it differs from the stored one by more than noise and drift.
    New,
    /// The stored one of this board, sheet and plan, when something rests on the sheet.
    Stored,
    /// A new one, stored in any case: for another sheet, or one that has changed.
    Replace,
}

/// Where frames come from and how they are reconstructed.
#[derive(Debug, Args)]
pub(crate) struct SourceArguments {
    /// Serial port of the board, such as /dev/ttyUSB0 [default: the first on USB that may be one and answers, else the simulated
    /// skin].
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    /// The simulated skin, whether there is a board or not.
    #[arg(long, conflicts_with = "port")]
    simulate: bool,
    /// The simulated skin with this scene, a TOML file (docs/scenes.md) or a name of the library, such as hand or fast-tap;
    /// over and over.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["port", "sheet"])]
    scene: Option<PathBuf>,
    /// What a frame measures.
    #[arg(long, value_name = "PLAN", value_parser = plan::parser(), default_value_t = PlanChoice::Auto)]
    plan: PlanChoice,
    /// Let the board watch: while nothing touches it sends no frames, and a touch brings them with the next drive.
    #[arg(long)]
    watch: bool,
    /// Reconstructs every frame, however late, for boards that do not run in real time [default: the newest, and says how many were
    /// passed over].
    #[arg(long)]
    every_frame: bool,
    /// The sheet, a TOML file as for `skin forward` [default: the paper's disc].
    #[arg(long, value_name = "FILE")]
    sheet: Option<PathBuf>,
    /// The electrode of the sheet that every wire leads to, in the order of the board's numbers, as `skin check` says it.
    #[arg(long, value_delimiter = ',', value_name = "ELECTRODE,...")]
    wires: Vec<usize>,
    /// Take the electrodes to be exactly where they are said to be, instead of finding them in the baseline.
    #[arg(long)]
    trust_electrodes: bool,
    /// Which way touches change the resistance of the sheet [default: learned from the first ones].
    #[arg(long, value_name = "WAY", value_parser = crate::rise::parser())]
    rise: Option<Polarity>,
    /// Frames of the unpressed sheet that make the baseline, at least 2 [default: those of 0.7 s, at least 24].
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(2..))]
    baseline_frames: Option<usize>,
    /// The baseline to start with. The last good one of each board is stored.
    #[arg(long, value_enum, value_name = "WHICH", default_value_t = Start::New)]
    baseline: Start,
    /// Folder of the stored baselines [default: $XDG_STATE_HOME/skin or ~/.local/state/skin, and none for a simulated skin].
    #[arg(long, value_name = "DIR")]
    state_dir: Option<PathBuf>,
    /// Forces in newtons with the creep of the rubber taken out, by what `skin calibrate` wrote.
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
}

/// Where pictures go.
#[derive(Debug, Default, Args)]
pub(crate) struct ShowArguments {
    /// End after so many pictures.
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u64>::new().range(1..))]
    pub(crate) frames: Option<u64>,
    /// No page: one JSON object a picture on stdout.
    #[arg(long)]
    pub(crate) json: bool,
    /// Writes the last picture to this file at the end.
    #[arg(long, value_name = "FILE")]
    pub(crate) png: Option<PathBuf>,
    /// Port of the page on 127.0.0.1 [default: 8477, or a free one when that is taken].
    #[arg(long, value_name = "PORT", conflicts_with = "json")]
    pub(crate) listen: Option<u16>,
    /// Do not open the page in the browser.
    #[arg(long, conflicts_with = "json")]
    pub(crate) no_open: bool,
}

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

/// A frame that is older than others that wait by so much is not shown any more, s of the board's time: more than an adapter holds
/// back and hands over at once (16 ms), less than the eye sees.
const LAG_S: f64 = 0.05;
/// A board that says nothing for so long is gone.
const SILENCE: Duration = Duration::from_secs(3);

/// What frames come from.
struct Source {
    session: Session,
    name: String,
    /// The simulated skin's port: its scene is held.
    scene: Option<SimPort>,
}

/// The board asked for, the first that answers, or the simulated skin.
fn connect(arguments: &SourceArguments, sheet: &Sheet, scene: Option<&SceneFile>, tap: Option<&Tap>) -> Result<Source> {
    let choose = |hello: &Hello| arguments.plan.plan(hello);
    let tapped = |port: Box<dyn Port>| -> Box<dyn Port> {
        match tap {
            Some(tap) => Box::new(tap.port(port)),
            None => port,
        }
    };
    if let Some(scene) = scene {
        // What a scene says itself is only overruled by a plan that is asked for.
        let plan = scene.config.plan.clone().filter(|_| arguments.plan == PlanChoice::Auto);
        let port = simulated_skin::start_held(scene)?;
        let session = Session::start(tapped(Box::new(port.clone())), |hello| {
            plan.map_or_else(|| choose(hello), Ok)
        })?;
        let name = if scene.title.is_empty() { "scene" } else { &scene.title };
        return Ok(Source {
            session,
            name: format!("simulated skin: {name}"),
            scene: Some(port),
        });
    }
    if let Some(path) = &arguments.port {
        let port = ports::open(path).map_err(|e| anyhow!(e))?;
        let session = Session::start(tapped(port), choose).with_context(|| path.clone())?;
        return Ok(Source {
            session,
            name: path.clone(),
            scene: None,
        });
    }
    if !arguments.simulate {
        let started = board::first(|port, path| Ok((Session::start(tapped(port), choose)?, path.to_owned())))?;
        let why = match started {
            Ok((session, name)) => {
                return Ok(Source {
                    session,
                    name,
                    scene: None,
                });
            }
            Err(why) => why,
        };
        say!("no board found ({why}): showing the simulated skin; name a port with --port if there is one");
    }
    let port = simulated_skin::start_held(&SceneFile::demo(sheet.clone()))?;
    Ok(Source {
        session: Session::start(tapped(Box::new(port.clone())), choose)?,
        name: "simulated skin".to_owned(),
        scene: Some(port),
    })
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

/// Is set by Ctrl-C, and by what else ends a program in order.
pub(crate) fn stop_flag() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).context("Ctrl-C cannot be caught")?;
    Ok(stop)
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
    let stop = stop_flag()?;
    let calibration = arguments
        .calibration
        .as_deref()
        .map(calibration_file::read)
        .transpose()?;
    let scene = arguments.scene.as_deref().map(scene::load).transpose()?.map(|mut s| {
        s.scene.loop_s.get_or_insert(s.duration_s);
        s
    });
    let sheet = match &scene {
        Some(scene) => scene.sheet.clone(),
        None => sheet::load(arguments.sheet.as_deref())?.0,
    };
    let recording = outputs.record.map(RecordTo::new).transpose()?;
    let Source {
        session,
        name: source,
        scene: held,
    } = connect(arguments, &sheet, scene.as_ref(), recording.as_ref().map(RecordTo::tap))?;
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
    let options = LiveOptions {
        baseline_frames: arguments.baseline_frames.unwrap_or_else(|| baseline_frames(&session)),
        polarity: arguments.rise,
        find_electrodes: !arguments.trust_electrodes,
        calibration,
        ..LiveOptions::default()
    };
    let recorded = Recorded {
        hello: session.hello(),
        source: &source,
        values: session.plan().value_count(),
        sheet: &sheet,
        wires: &arguments.wires,
    };
    let recorder = recording.map(|r| r.begin(&recorded, &options)).transpose()?;
    let mut live = Live::new(imager(&session, &sheet, &arguments.wires)?, options);
    let mut run = Run {
        show: outputs.show,
        seconds: outputs.seconds,
        every_frame: arguments.every_frame,
        session: &session,
        live: &mut live,
        output: &mut Output::new(open_page(outputs)?, outputs.show.json, source.clone()),
        baselines: &mut baselines,
        watch: watch_of(arguments, &session)?,
        held,
        wanted: None,
        notes: recorder.as_ref().map(|r| Notes::new(r.tap().clone(), recorded.values)),
        recorder,
        replayed: None,
    };
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
    let pattern = Pattern::from_pairs(session.electrodes(), session.measurements())?;
    let pattern = sheet::rewired(pattern, wires)?;
    Ok(Arc::new(Imager::new(
        sheet,
        Drive::PAPER,
        pattern,
        sheet::cell_mm(sheet)?,
    )?))
}

/// A file to record into.
enum RecordTo {
    /// That was asked for: it is made before anything else is done.
    File(Recorder),
    /// Its name is that of the board.
    Named(WaitingRecorder),
}

impl RecordTo {
    fn new(file: Option<&Path>) -> Result<Self> {
        Ok(match file {
            Some(file) => Self::File(Recorder::create(file)?),
            None => Self::Named(Recorder::waiting()),
        })
    }

    fn tap(&self) -> &Tap {
        match self {
            Self::File(recorder) => recorder.tap(),
            Self::Named(waiting) => waiting.tap(),
        }
    }

    fn begin(self, of: &Recorded<'_>, options: &LiveOptions) -> Result<Recorder> {
        let started_unix_s = self.tap().clock().started_unix_s();
        let (mut recorder, file) = match self {
            Self::File(recorder) => (recorder, None),
            Self::Named(waiting) => {
                let file = file_name(started_unix_s, &of.hello.serial);
                (waiting.into_file(Path::new(&file))?, Some(file))
            }
        };
        say::record_to(recorder.tap());
        if let Some(file) = file {
            say!("recording into {file}");
        }
        recorder.begin(&SessionRecord::new(of, options, started_unix_s)?)?;
        Ok(recorder)
    }
}

fn open_page(outputs: &Outputs<'_>) -> Result<Option<LiveView>> {
    outputs.page.then(|| page(outputs.show)).transpose()
}

/// The frames of so long make the baseline, if they are more than so many: fast plans have more noise in each.
const BASELINE_S: f64 = 0.7;

fn baseline_frames(session: &Session) -> usize {
    let frame_s = f64::from(session.plan().quarters()) / f64::from(QUARTERS) / session.hello().excitation_hz().max(1.0);
    let frames = (BASELINE_S / frame_s.max(1e-3)).round() as usize;
    frames.max(LiveOptions::default().baseline_frames)
}

pub(crate) fn page(arguments: &ShowArguments) -> Result<LiveView> {
    let options = |port| PageOptions {
        listen: SocketAddr::from((Ipv4Addr::LOCALHOST, port)),
        ..PageOptions::default()
    };
    let page = match arguments.listen {
        Some(port) => LiveView::start(options(port)),
        None => LiveView::start(options(DEFAULT_PORT)).or_else(|_| LiveView::start(options(0))),
    }
    .context("the page cannot be served")?;
    let url = page.url();
    say!("live picture: {url}   (Ctrl-C ends)");
    let desktop = ["DISPLAY", "WAYLAND_DISPLAY"]
        .iter()
        .any(|v| std::env::var_os(v).is_some());
    if desktop && !arguments.no_open && std::io::stderr().is_terminal() {
        // Only a convenience: whoever has no such program has the URL.
        let _ = std::process::Command::new("xdg-open")
            .arg(&url)
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn();
    }
    Ok(page)
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
    // A simulated board has no serial of its own, and nobody comes back to it.
    let own = hello.board != BOARD_NAME;
    let folder = arguments.state_dir.clone().or_else(|| state_folder().filter(|_| own));
    if folder.is_none() {
        if arguments.baseline != Start::New {
            let name = if arguments.baseline == Start::Stored {
                "stored"
            } else {
                "replace"
            };
            bail!("--baseline {name}: there is no folder for it, a simulated skin has none; name one with --state-dir");
        }
        if own {
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

/// A session that shows its pictures.
pub(crate) struct Run<'a> {
    pub(crate) show: &'a ShowArguments,
    /// End after so long, s of the board's time since the first picture.
    pub(crate) seconds: Option<f64>,
    pub(crate) every_frame: bool,
    pub(crate) session: &'a Session,
    pub(crate) live: &'a mut Live,
    pub(crate) output: &'a mut Output,
    pub(crate) baselines: &'a mut Baselines,
    pub(crate) watch: Option<Watch>,
    /// The simulated skin, until its scene is shown.
    pub(crate) held: Option<SimPort>,
    /// Frames that a baseline still wants; none while no baseline is taken.
    pub(crate) wanted: Option<usize>,
    /// What is recorded of it, and by whom.
    pub(crate) notes: Option<Notes>,
    pub(crate) recorder: Option<Recorder>,
    /// A recording that is played.
    pub(crate) replayed: Option<Replayed>,
}

impl Run<'_> {
    /// Frames to pictures, until somebody ends it.
    fn pump(&mut self, stop: &AtomicBool) -> Result<()> {
        let mut pictures = 0;
        let mut notices = LinkNotices::default();
        let mut last: Option<MeasuredFrame> = None;
        // The board's time since the first picture, s; after a reset it goes on.
        let mut shown_s = 0.0;
        if self.live.baseline().is_some() {
            self.show_newest();
            self.in_force();
        } else {
            self.wanted = Some(usize::MAX);
        }
        while !stop.load(Ordering::Relaxed)
            && self.show.frames.is_none_or(|n| pictures < n)
            && self.seconds.is_none_or(|s| shown_s < s)
        {
            if let Some(recorder) = &mut self.recorder {
                self.output.set_recorded(recorder.counts());
                if let Some(why) = recorder.failure() {
                    say!("warning: {why}; the picture goes on");
                }
            }
            if let Some(command) = self.output.command() {
                self.obey(command)?;
            }
            let frame = self.session.frame(Duration::from_millis(100))?;
            let watched = matches!(self.session.watching(), Watching::Asleep | Watching::Learning);
            if !watched && let Some(notice) = notices.take(&self.session.link().counters(), frame.as_ref()) {
                self.output.say_line(notice);
            }
            let Some(frame) = frame else {
                if let (Watching::Asleep | Watching::Learning, Some(last)) = (self.session.watching(), &last) {
                    let status = Some("nothing touches: the board watches".to_owned());
                    self.output
                        .show_nothing(self.live.imager(), last, self.session.link().counters(), status)?;
                }
                self.session.check_silence(SILENCE)?;
                continue;
            };
            if self.is_before_the_scene(&frame) {
                continue;
            }
            if self.take(&frame)? {
                if self.live.wants_baseline() {
                    say!(
                        "what lay on the sheet in the baseline has gone, and nothing touches: a new baseline is taken; the page can undo it"
                    );
                    self.obey(PageCommand::Tare)?;
                }
                pictures += 1;
                if let Some(last) = &last {
                    shown_s += (frame.time_s - last.time_s).max(0.0);
                }
            }
            last = Some(frame);
        }
        Ok(())
    }

    /// Says what became of it, and closes what is open.
    ///
    /// # Errors
    /// Why it ended, or what cannot be written.
    pub(crate) fn end(mut self, outcome: Result<()>) -> Result<()> {
        let counters = self.session.link().counters();
        tracing::info!("{counters:?}");
        if counters.skipped_frames > 0 {
            say!(
                "{} of {} frames were passed over for newer ones: they came faster than this machine could reconstruct them, or while it prepared the model",
                counters.skipped_frames,
                counters.frames
            );
        }
        self.output.end_status();
        let recorded = self.recorder.take().map_or(Ok(()), recording_file::finish);
        let png = self.show.png.as_deref();
        let written = png.map_or(Ok(()), |path| self.output.write_png(path));
        // Why it ended comes first.
        outcome.and(recorded).and(written)
    }

    /// What somebody at the page asks for.
    fn obey(&mut self, command: PageCommand) -> Result<()> {
        // A baseline is made of frames, all of them; and the board's watch has learned another one.
        match command {
            PageCommand::Tare => {
                self.session.set_watch(None);
                self.session.keep_all();
                self.live.tare();
                if let Some(notes) = &self.notes {
                    notes.tare();
                }
                self.output.set_baseline(self.baselines.note(true));
                self.wanted = Some(usize::MAX);
            }
            PageCommand::UndoBaseline => {
                let taking = self.wanted.is_some();
                if let Some(baseline) = self.baselines.undo(taking) {
                    self.session.set_watch(None);
                    if self.watch.is_some() {
                        say!("the board does not watch until a new baseline is taken");
                    }
                    self.wanted = None;
                    if let Some(notes) = &self.notes {
                        notes.resume(&baseline);
                    }
                    self.live.resume(baseline)?;
                    self.show_newest();
                    self.in_force();
                }
            }
        }
        Ok(())
    }

    /// Whether a frame was measured before the simulated skin's scene began. The pictures begin with the scene.
    fn is_before_the_scene(&mut self, frame: &MeasuredFrame) -> bool {
        let Some(held) = &self.held else { return false };
        if self.wanted.is_some() {
            return false;
        }
        let before = held.scene_began_s().is_none_or(|began_s| frame.time_s < began_s);
        if !before {
            self.held = None;
        }
        before
    }

    /// Puts a frame into the baseline, or shows its picture; whether it was a picture.
    pub(crate) fn take(&mut self, frame: &MeasuredFrame) -> Result<bool> {
        if self.wanted == Some(1) {
            // It is the last one, and none can be passed over any more. What follows here takes a while: frames are not to
            // pile up, and the board learns its own baseline meanwhile.
            self.show_newest();
            if let Some(watch) = &self.watch {
                self.session.set_watch(Some(watch.clone()));
            }
        }
        let mut counters = self.session.link().counters();
        let imager = Arc::clone(self.live.imager());
        match self.live.frame(frame.time_s, &frame.values_v)? {
            LiveFrame::Baseline { left } => {
                self.wanted = Some(left).filter(|left| *left > 0);
                if let Some(notes) = &self.notes {
                    notes.baseline_frame(frame, left);
                }
                if let (0, Some(baseline)) = (left, self.live.baseline()) {
                    if self.replayed.is_none() {
                        self.baselines.taken(baseline.clone());
                    }
                    self.in_force();
                }
                let status = (left > 0).then(|| "taking the baseline, do not touch".to_owned());
                self.output.show_nothing(self.live.imager(), frame, counters, status)?;
                Ok(false)
            }
            LiveFrame::Picture(result) => {
                if let Some(replayed) = &mut self.replayed {
                    replayed.compare(result, &mut counters)?;
                }
                self.output.show_picture(&imager, result, frame, counters)?;
                if let Some(notes) = &mut self.notes {
                    notes.picture(result, frame, counters);
                    notes.preview(self.output.shown());
                }
                Ok(true)
            }
        }
    }

    /// From now on the newest frame counts, unless every frame is asked for.
    fn show_newest(&self) {
        if !self.every_frame {
            self.session.skip_over(LAG_S);
        }
    }

    /// A baseline is in force: it is shown which, and a scene that waits for it begins.
    pub(crate) fn in_force(&mut self) {
        let note = self.baselines.note(false);
        if self.replayed.is_none() {
            self.output.set_baseline(note.clone());
        }
        if let Some(inspection) = self.live.inspection() {
            sheet::say(inspection);
            self.output.left_out(inspection);
            if let Some(notes) = &mut self.notes {
                notes.in_force(note, inspection.left_out().cloned().collect());
            }
        }
        if let Some(held) = &self.held {
            held.begin_scene();
        }
    }
}
