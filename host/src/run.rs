//! `skin run`, and `skin` alone: live pictures of the board, or of the simulated skin when there is no board.

use crate::files::calibration_file;
use crate::{board, plan, scene, sheet};
use ::forward::{Drive, Geometry, Pattern, Sheet};
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use clap::builder::RangedU64ValueParser;
use hil_sim::{Pace, SceneFile, SimPort};
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::pipeline::FrameResult;
use inverse::quality::doubt::Doubt;
use inverse::reference::imager::Imager;
use inverse::touches::touch::Touch;
use link::plans::PlanName;
use link::{LinkCounters, Port, Session, ports};
use protocol::{Hello, QUARTERS, Watch, Watching};
use serde::Serialize;
use std::collections::VecDeque;
use std::io::{IsTerminal, Write};
use std::mem::Discriminant;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use view::picture::{Picture, Stats};
use view::png;
use view::surface::Surface;
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
    #[arg(long, value_name = "PLAN", value_parser = plan::parser(), default_value_t = PlanName::Auto)]
    plan: PlanName,
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

#[derive(Serialize)]
struct Line<'a> {
    frame: u32,
    time_s: f64,
    touches: Vec<&'a Touch>,
    residual: f64,
    gap: f64,
    solve_us: f64,
    lost_frames: u64,
    /// Passed over so far for newer ones.
    skipped_frames: u64,
    /// What speaks against the touches.
    #[serde(skip_serializing_if = "Option::is_none")]
    doubt: Option<Doubt>,
}

/// A frame that is older than others that wait by so much is not shown any more, s of the board's time: more than an adapter holds
/// back and hands over at once (16 ms), less than the eye sees.
const LAG_S: f64 = 0.05;
/// A doubt that lasts is said again after so long.
const SAID_AGAIN: Duration = Duration::from_secs(10);
/// A board that says nothing for so long is gone.
pub(crate) const SILENCE: Duration = Duration::from_secs(3);

/// The simulated skin with the paper's sheet.
///
/// # Errors
/// It does not start.
pub(crate) fn simulated_board() -> Result<Box<dyn Port>> {
    simulated(&SceneFile::demo(Sheet::paper()))
}

fn simulated(scene: &SceneFile) -> Result<Box<dyn Port>> {
    let mut port = SimPort::new(scene.board()?, Pace::RealTime).context("the simulated skin does not start")?;
    port.set_timeout(Duration::from_millis(20));
    Ok(Box::new(port))
}

/// The board asked for, the first that answers, or the simulated skin; with its name.
fn connect(arguments: &Arguments, sheet: &Sheet, scene: Option<&SceneFile>) -> Result<(Session, String)> {
    let choose = |hello: &Hello| arguments.plan.plan(hello);
    if let Some(scene) = scene {
        // What a scene says itself is only overruled by a plan that is asked for.
        let plan = scene.config.plan.clone().filter(|_| arguments.plan == PlanName::Auto);
        let session = Session::start(simulated(scene)?, |hello| plan.map_or_else(|| choose(hello), Ok))?;
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
        Session::start(simulated(&SceneFile::demo(sheet.clone()))?, choose)?,
        "simulated skin".to_owned(),
    ))
}

/// Everything that the loop shows with.
struct Output {
    page: Option<LiveView>,
    json: bool,
    last: Option<Arc<Picture>>,
    /// Of the imager that it was asked of.
    surface: Option<(Arc<Imager>, Surface)>,
    source: String,
    times: VecDeque<f64>,
    /// The line on the terminal, and since when.
    said: String,
    said_at: Instant,
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
    let imager = Arc::new(Imager::new(
        &sheet,
        Drive::PAPER,
        Pattern::from_pairs(session.electrodes(), session.measurements())?,
        cell_mm(&sheet)?,
    )?);
    let mut live = Live::new(
        imager,
        LiveOptions {
            baseline_frames: arguments.baseline_frames.unwrap_or_else(|| baseline_frames(&session)),
            calibration,
            ..LiveOptions::default()
        },
    );
    let mut output = Output {
        page: if arguments.json { None } else { Some(page(arguments)?) },
        json: arguments.json,
        last: None,
        surface: None,
        source,
        times: VecDeque::new(),
        said: String::new(),
        said_at: Instant::now(),
    };
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
    let written = match (&arguments.png, &output.last) {
        (None, _) => Ok(()),
        (Some(path), Some(picture)) => {
            png::write_png(picture, path).with_context(|| format!("{}: cannot write the picture", path.display()))
        }
        (Some(path), None) => Err(anyhow!("{}: not written, there was no picture yet", path.display())),
    };
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

/// 39 cells across: 5 mm on the paper's disc.
pub(crate) fn cell_mm(sheet: &Sheet) -> Result<f64> {
    let (low, high) = Geometry::new(sheet)?.bounding_box();
    Ok((high[0] - low[0]).min(high[1] - low[1]) / 39.0)
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

fn pump(
    arguments: &Arguments,
    session: &Session,
    live: &mut Live,
    output: &mut Output,
    stop: &AtomicBool,
) -> Result<()> {
    let mut pictures = 0;
    let mut heard = Instant::now();
    let watch = if arguments.watch {
        let watch = Watch::for_board(session.hello());
        Some(watch.ok_or_else(|| anyhow!("there is no watch for this number of electrodes; leave --watch out"))?)
    } else {
        None
    };
    let mut last: Option<link::MeasuredFrame> = None;
    // The kind of doubt that was said last, and when.
    let mut said: Option<(Discriminant<Doubt>, Instant)> = None;
    // Frames that the baseline still wants.
    let mut wanted = 0;
    while !stop.load(Ordering::Relaxed) && arguments.frames.is_none_or(|n| pictures < n) {
        if let Some(PageCommand::Tare) = output.page.as_ref().and_then(LiveView::command) {
            // The baseline is made of frames.
            session.set_watch(None);
            live.tare();
        }
        let Some(frame) = session.frame(Duration::from_millis(100))? else {
            let (watching, said) = session.watching();
            if matches!(watching, Watching::Asleep | Watching::Learning)
                && let Some(last) = &last
            {
                let counters = session.link().counters();
                let status = Some("nothing touches: the board watches".to_owned());
                output.show(
                    live.imager(),
                    &FrameResult::nothing(live.imager()),
                    last,
                    counters,
                    status,
                )?;
            }
            if heard.elapsed() > SILENCE && said > SILENCE {
                bail!(
                    "the board has sent no frame for {} s; look at its cable and power",
                    SILENCE.as_secs()
                );
            }
            continue;
        };
        heard = Instant::now();
        if watch.is_some() {
            last = Some(frame.clone());
        }
        let counters = session.link().counters();
        let imager = Arc::clone(live.imager());
        if let (1, Some(watch)) = (wanted, &watch) {
            // The last one. What follows here takes a while: the board learns its own baseline meanwhile.
            session.set_watch(Some(watch.clone()));
        }
        match live.frame(frame.time_s, &frame.values_v)? {
            LiveFrame::Baseline { left } => {
                wanted = left;
                let status = (left > 0).then(|| "taking the baseline, do not touch".to_owned());
                if let (0, Some(baseline)) = (left, live.baseline()) {
                    sheet::look_at_baseline(live.imager(), &baseline.values_v);
                }
                output.show(
                    live.imager(),
                    &FrameResult::nothing(live.imager()),
                    &frame,
                    counters,
                    status,
                )?;
            }
            LiveFrame::Picture(result) => {
                pictures += 1;
                if let Some(doubt) = result.doubt {
                    let kind = std::mem::discriminant(&doubt);
                    if said.is_none_or(|(last, at)| last != kind || at.elapsed() > SAID_AGAIN) {
                        eprintln!("warning: frame {}: {doubt}", frame.sequence);
                        said = Some((kind, Instant::now()));
                    }
                }
                output.show(&imager, result, &frame, counters, result.doubt.map(|d| d.to_string()))?;
                if output.json {
                    let mut out = std::io::stdout().lock();
                    let line = Line {
                        frame: frame.sequence,
                        time_s: frame.time_s,
                        touches: result.touches.iter().filter(|t| t.is_pressed()).collect(),
                        residual: result.residual,
                        gap: result.gap,
                        solve_us: result.solve_us,
                        lost_frames: counters.lost_frames,
                        skipped_frames: counters.skipped_frames,
                        doubt: result.doubt,
                    };
                    serde_json::to_writer(&mut out, &line)?;
                    writeln!(out)?;
                } else {
                    output.status(result);
                }
            }
        }
    }
    Ok(())
}

/// A picture that does not change is drawn again after so long.
const REDRAW_S: f64 = 0.25;

impl Output {
    fn show(
        &mut self,
        imager: &Arc<Imager>,
        result: &FrameResult,
        frame: &link::MeasuredFrame,
        counters: LinkCounters,
        status: Option<String>,
    ) -> Result<()> {
        if self.times.back().is_some_and(|last| frame.time_s < *last) {
            // The board was reset, and its clock with it.
            self.times.clear();
        }
        self.times.push_back(frame.time_s);
        while self.times.len() > 2 && frame.time_s - self.times[0] > 1.0 {
            self.times.pop_front();
        }
        let span = frame.time_s - self.times[0];
        let stats = Stats {
            frames_per_s: if span > 0.0 {
                ((self.times.len() - 1) as f64 / span) as f32
            } else {
                0.0
            },
            solve_us: result.changed.then_some(result.solve_us as f32),
            residual: result.changed.then_some(result.residual as f32),
            lost_frames: counters.lost_frames,
            skipped_frames: counters.skipped_frames,
            source: self.source.clone(),
            status,
        };
        // What shows nothing new is drawn only now and then, for the rates beside it.
        let old = !result.anew && stats.status.is_none();
        if old
            && self
                .last
                .as_ref()
                .is_some_and(|p| (0.0..REDRAW_S).contains(&(frame.time_s - p.time_s)))
        {
            return Ok(());
        }
        let surface = match &self.surface {
            Some((of, surface)) if Arc::ptr_eq(of, imager) => surface,
            _ => &self.surface.insert((Arc::clone(imager), Surface::of(imager)?)).1,
        };
        let mut picture = surface.picture(result, frame.sequence.into(), frame.time_s, stats);
        // A dent that somebody left is in the picture, but it is no touch.
        picture.touches.retain(Touch::is_pressed);
        let picture = Arc::new(picture);
        if let Some(page) = &self.page {
            page.publish(Arc::clone(&picture))?;
        }
        self.last = Some(picture);
        Ok(())
    }

    /// A line on the terminal, written anew at most twice a second, when it says something else.
    fn status(&mut self, result: &FrameResult) {
        if !std::io::stderr().is_terminal() || self.said_at.elapsed() < Duration::from_millis(500) {
            return;
        }
        self.said_at = Instant::now();
        let list: Vec<String> = result
            .touches
            .iter()
            .filter(|t| t.is_pressed())
            .map(|t| {
                let force = t.force_n.map_or(String::new(), |f| format!(" {f:.1} N"));
                format!("({:.0}, {:.0}) mm {:+.0} %{force}", t.x_mm, t.y_mm, 100.0 * t.rise)
            })
            .collect();
        let text = if list.is_empty() {
            "no touch".to_owned()
        } else {
            list.join("   ")
        };
        if text != self.said {
            eprint!("\r\x1b[K{text}");
            self.said = text;
        }
    }
}
