//! `skin run`, and `skin` alone: live pictures of the board, or of the simulated skin when there is no board.

use crate::files::calibration_file;
use crate::live_output::Output;
use crate::{board, plan, scene, sheet, simulated_skin};
use ::forward::{Drive, Pattern, Sheet};
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use clap::builder::RangedU64ValueParser;
use hil_sim::SceneFile;
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::reference::imager::Imager;
use link::plans::PlanChoice;
use link::{MeasuredFrame, Session, ports};
use protocol::{Hello, QUARTERS, Watch, Watching};
use std::io::IsTerminal;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use view::web::{Command as PageCommand, DEFAULT_PORT, LiveOptions as PageOptions, LiveView};

/// Arguments of `skin run`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
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
    /// End after so many pictures.
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u64>::new().range(1..))]
    frames: Option<u64>,
    /// No page: one JSON object a picture on stdout.
    #[arg(long)]
    json: bool,
    /// Writes the last picture to this file at the end.
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// What a frame measures.
    #[arg(long, value_name = "PLAN", value_parser = plan::parser(), default_value_t = PlanChoice::Auto)]
    plan: PlanChoice,
    /// Let the board watch: while nothing touches it sends no frames, and a touch brings them with the next drive.
    #[arg(long)]
    watch: bool,
    /// Takes every frame, however late, for recordings and boards that do not run in real time [default: the newest, and says how
    /// many were passed over].
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
    /// Frames of the unpressed sheet that make the baseline, at least 2 [default: those of 0.7 s, at least 24].
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(2..))]
    baseline_frames: Option<usize>,
    /// Forces in newtons with the creep of the rubber taken out, by what `skin calibrate` wrote.
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Port of the page on 127.0.0.1 [default: 8477, or a free one when that is taken].
    #[arg(long, value_name = "PORT", conflicts_with = "json")]
    listen: Option<u16>,
    /// Do not open the page in the browser.
    #[arg(long, conflicts_with = "json")]
    no_open: bool,
}

/// A frame that is older than others that wait by so much is not shown any more, s of the board's time: more than an adapter holds
/// back and hands over at once (16 ms), less than the eye sees.
const LAG_S: f64 = 0.05;
/// A board that says nothing for so long is gone.
const SILENCE: Duration = Duration::from_secs(3);

/// The board asked for, the first that answers, or the simulated skin; with its name.
fn connect(arguments: &Arguments, sheet: &Sheet, scene: Option<&SceneFile>) -> Result<(Session, String)> {
    let choose = |hello: &Hello| arguments.plan.plan(hello);
    if let Some(scene) = scene {
        // What a scene says itself is only overruled by a plan that is asked for.
        let plan = scene.config.plan.clone().filter(|_| arguments.plan == PlanChoice::Auto);
        let session = Session::start(simulated_skin::start(scene)?, |hello| {
            plan.map_or_else(|| choose(hello), Ok)
        })?;
        let name = if scene.title.is_empty() { "scene" } else { &scene.title };
        return Ok((session, format!("simulated skin: {name}")));
    }
    if let Some(path) = &arguments.port {
        let port = ports::open(path).map_err(|e| anyhow!(e))?;
        let session = Session::start(port, choose).with_context(|| path.clone())?;
        return Ok((session, path.clone()));
    }
    if !arguments.simulate {
        let started = board::first(|port, path| Ok((Session::start(port, choose)?, path.to_owned())))?;
        let why = match started {
            Ok(found) => return Ok(found),
            Err(why) => why,
        };
        eprintln!("no board found ({why}): showing the simulated skin; name a port with --port if there is one");
    }
    Ok((
        Session::start(simulated_skin::start(&SceneFile::demo(sheet.clone()))?, choose)?,
        "simulated skin".to_owned(),
    ))
}

/// Runs the command.
///
/// # Errors
/// A port that does not open or answer, a board lost on the way, a page that cannot be served.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).context("Ctrl-C cannot be caught")?;

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
    let (session, source) = connect(arguments, &sheet, scene.as_ref())?;
    let (wired, described) = (usize::from(session.hello().electrodes), sheet.electrodes.len());
    if wired != described {
        bail!(
            "{source} has {wired} electrodes, the sheet {described}; describe the sheet that is wired to it with --sheet"
        );
    }
    let pattern = Pattern::from_pairs(session.electrodes(), session.measurements())?;
    let pattern = sheet::rewired(pattern, &arguments.wires)?;
    let imager = Arc::new(Imager::new(&sheet, Drive::PAPER, pattern, sheet::cell_mm(&sheet)?)?);
    let mut live = Live::new(
        imager,
        LiveOptions {
            baseline_frames: arguments.baseline_frames.unwrap_or_else(|| baseline_frames(&session)),
            find_electrodes: !arguments.trust_electrodes,
            calibration,
            ..LiveOptions::default()
        },
    );
    let page = if arguments.json { None } else { Some(page(arguments)?) };
    let mut output = Output::new(page, source);
    if !arguments.every_frame {
        session.skip_over(LAG_S);
    }
    let outcome = pump(arguments, &session, &mut live, &mut output, &stop);
    let counters = session.link().counters();
    tracing::info!("{counters:?}");
    if counters.skipped_frames > 0 {
        eprintln!(
            "{} of {} frames were passed over for newer ones: they came while the baseline was prepared, or faster than this machine could reconstruct them",
            counters.skipped_frames, counters.frames
        );
    }
    let written = arguments.png.as_deref().map_or(Ok(()), |path| output.write_png(path));
    // Why it ended comes first.
    outcome.and(written)
}

/// The frames of so long make the baseline, if they are more than so many: fast plans have more noise in each.
const BASELINE_S: f64 = 0.7;

fn baseline_frames(session: &Session) -> usize {
    let frame_s = f64::from(session.plan().quarters()) / f64::from(QUARTERS) / session.hello().excitation_hz().max(1.0);
    let frames = (BASELINE_S / frame_s.max(1e-3)).round() as usize;
    frames.max(LiveOptions::default().baseline_frames)
}

fn page(arguments: &Arguments) -> Result<LiveView> {
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
    eprintln!("live picture: {url}   (Ctrl-C ends)");
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
fn watch_of(arguments: &Arguments, session: &Session) -> Result<Option<Watch>> {
    if !arguments.watch {
        return Ok(None);
    }
    let watch = Watch::for_board(session.hello());
    let none = || anyhow!("there is no watch for this number of electrodes; leave --watch out");
    watch.map(Some).ok_or_else(none)
}

/// Frames to pictures, until somebody ends it.
fn pump(
    arguments: &Arguments,
    session: &Session,
    live: &mut Live,
    output: &mut Output,
    stop: &AtomicBool,
) -> Result<()> {
    let watch = watch_of(arguments, session)?;
    let mut pictures = 0;
    let mut last: Option<MeasuredFrame> = None;
    // Frames that the baseline still wants.
    let mut wanted = 0;
    while !stop.load(Ordering::Relaxed) && arguments.frames.is_none_or(|n| pictures < n) {
        if let Some(PageCommand::Tare) = output.command() {
            // The baseline is made of frames.
            session.set_watch(None);
            live.tare();
        }
        let Some(frame) = session.frame(Duration::from_millis(100))? else {
            if let (Watching::Asleep | Watching::Learning, Some(last)) = (session.watching(), &last) {
                let status = Some("nothing touches: the board watches".to_owned());
                output.show_nothing(live.imager(), last, session.link().counters(), status)?;
            }
            session.check_silence(SILENCE)?;
            continue;
        };
        if let (1, Some(watch)) = (wanted, &watch) {
            // The last one. What follows here takes a while: the board learns its own baseline meanwhile.
            session.set_watch(Some(watch.clone()));
        }
        let counters = session.link().counters();
        let imager = Arc::clone(live.imager());
        match live.frame(frame.time_s, &frame.values_v)? {
            LiveFrame::Baseline { left } => {
                wanted = left;
                let status = (left > 0).then(|| "taking the baseline, do not touch".to_owned());
                if let (0, Some(inspection)) = (left, live.inspection()) {
                    sheet::say(inspection);
                    output.left_out(inspection);
                }
                output.show_nothing(live.imager(), &frame, counters, status)?;
            }
            LiveFrame::Picture(result) => {
                pictures += 1;
                output.show_picture(&imager, result, &frame, counters)?;
            }
        }
        last = Some(frame);
    }
    Ok(())
}
