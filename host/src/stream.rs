//! Frames with their touches for programs that have this one inside: of a board, of the simulated skin, or of a recording. What
//! `skin run` and `skin replay` do for people is left out: pages, stored baselines, commands.

use crate::baselines::MOVED_SAID;
use crate::event::Event;
use crate::live_run::{HELD, LAG_S, SILENCE};
use crate::played_board::{Frames, PlayedBoard};
use crate::presses::file::PressCalibration;
use crate::presses::live::Chosen;
use crate::presses::locate;
use crate::recorded::SessionRecord;
use crate::run_arguments::{SourceArguments, Start};
use crate::run_session::{check_electrodes, live_options, pattern, scene_of};
use crate::script::{Script, Step};
use crate::source::{self, Source};
use ::forward::{Drive, Sheet};
use anyhow::{Result, anyhow, bail};
use hil_sim::SimPort;
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::pipeline::FrameResult;
use inverse::reference::imager::Imager;
use inverse::solvers::Method;
use inverse::touches::polarity::Polarity;
use link::plans::PlanChoice;
use link::{ConnectionEvent, LinkNotices, MeasuredFrame, Session};
use recording::{Speed, Switch};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Who takes frames one by one sees the picture of each.
const EVERY_FRAME_S: f64 = 0.0;

/// Where frames come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Origin {
    /// A board: at this port (`/dev/ttyUSB0`, `COM3`, `tcp://HOST:PORT`), or the only one on USB.
    Board {
        /// The port.
        port: Option<String>,
        /// Serial number of the board or of its adapter, for one of several.
        serial: Option<String>,
    },
    /// The simulated skin, in real time.
    Simulated {
        /// A scene's file, or a name of the library; none for the demo.
        scene: Option<PathBuf>,
    },
    /// A recording (`FILE`, or `FILE#NAME` for one of several skins), as fast as it is read.
    Recording(PathBuf),
}

/// How frames of a board are reconstructed. A recording says that itself.
#[derive(Clone, Debug, Default)]
pub struct StreamOptions {
    /// The sheet; none for the paper's disc, or the scene's.
    pub sheet: Option<Sheet>,
    /// What a frame measures.
    pub plan: PlanChoice,
    /// Frames of the unpressed sheet that make the baseline; none for those of 0.7 s, at least 24.
    pub baseline_frames: Option<usize>,
    /// Which way touches change the resistance; none where the first ones are to tell.
    pub rise: Option<Polarity>,
    /// Whether the electrodes are where the sheet says, or are looked for in the baseline.
    pub trust_electrodes: bool,
    /// Every frame, however late, instead of the newest.
    pub every_frame: bool,
    /// The electrode that every wire leads to, from 1; empty for each to its own.
    pub wires: Vec<usize>,
    /// A calibration of the rubber or from presses, by its file; `none` for none, and none for the one that is stored for the board.
    pub calibration: Option<PathBuf>,
    /// Folder of stored calibrations; none for the system's, which a simulated skin has none of.
    pub state_dir: Option<PathBuf>,
}

impl StreamOptions {
    fn arguments(&self, origin: &Origin) -> SourceArguments {
        let (port, serial) = match origin {
            Origin::Board { port, serial } => (port.clone(), serial.clone()),
            _ => (None, None),
        };
        let scene = match origin {
            Origin::Simulated { scene } => scene.clone(),
            _ => None,
        };
        SourceArguments {
            skins: None,
            port,
            serial,
            simulate: matches!(origin, Origin::Simulated { .. }),
            scene,
            plan: self.plan,
            watch: false,
            every_frame: self.every_frame,
            sheet: None,
            wires: self.wires.clone(),
            trust_electrodes: self.trust_electrodes,
            rise: self.rise,
            baseline_frames: self.baseline_frames,
            baseline: Start::New,
            state_dir: self.state_dir.clone(),
            calibration: self.calibration.clone(),
        }
    }
}

/// What came of a wait.
#[derive(Debug)]
pub enum Next<'a> {
    /// A frame, and what it says.
    Frame(MeasuredFrame, &'a FrameResult),
    /// None in time, or it went into the baseline.
    Waiting,
    /// The recording is at its end.
    Ended,
}

/// Frames, one after another.
pub struct Stream {
    name: String,
    live: Live,
    way: Way,
    /// What there is to say, oldest first.
    said: VecDeque<String>,
    /// Whether a baseline came into force with the last frame.
    is_new: bool,
}

enum Way {
    Board(Box<Board>),
    Recording(Box<Played>),
}

/// A board that streams.
struct Board {
    session: Session,
    notices: LinkNotices,
    /// The simulated skin, until its scene is shown.
    held: Option<SimPort>,
    every_frame: bool,
}

/// A recording that is played.
struct Played {
    board: PlayedBoard,
    script: Script,
    frames: Frames,
    stop: AtomicBool,
    /// Whether its end was said.
    ended: bool,
}

impl Stream {
    /// Opens a source. Of a board the baseline is taken then: nothing may touch the sheet for a second.
    ///
    /// # Errors
    /// The source, its sheet or a file cannot be used; the error says what to do.
    pub fn open(origin: &Origin, options: &StreamOptions) -> Result<Self> {
        match origin {
            Origin::Recording(path) => Self::play(path),
            _ => Self::connect(origin, options),
        }
    }

    fn connect(origin: &Origin, options: &StreamOptions) -> Result<Self> {
        let arguments = &options.arguments(origin);
        let calibration = Chosen::read(options.calibration.as_deref(), arguments)?;
        let scene = scene_of(arguments)?;
        if scene.is_some() && options.sheet.is_some() {
            bail!("a scene has its own sheet; leave one of them out");
        }
        let given = scene
            .as_ref()
            .map(|s| s.sheet.clone())
            .or_else(|| options.sheet.clone());
        let is_given = given.is_some();
        let sheet = calibration.sheet(given)?.unwrap_or_else(Sheet::paper);
        let switch = Switch::default();
        let Source { session, name, scene } = match origin {
            Origin::Board { .. } => source::board(arguments, &switch)?.map_err(|why| {
                anyhow!("no board found ({why}); name its port, or ask for the simulated skin; skin list shows what there is")
            })?,
            _ => source::simulated(arguments, &sheet, scene.as_ref(), &switch)?,
        };
        if options.every_frame {
            session.link().hold(HELD);
        }
        let (calibration, sheet, said) = calibration.or_stored(arguments, &session, (sheet, is_given))?;
        check_electrodes(&name, &session, &sheet)?;
        if let Some(learned) = &calibration.learned {
            locate::order(learned, &name, pattern(&session, &options.wires)?.measurements())?;
        }
        let how = live_options(arguments, &session, &calibration, EVERY_FRAME_S);
        let live = live(&session, &sheet, &options.wires, how, calibration.learned.as_ref())?;
        let live = live.with_told(calibration.told.clone());
        // While the sheet was modelled frames came: they are the baseline's.
        let board = Board {
            session,
            notices: LinkNotices::default(),
            held: scene,
            every_frame: options.every_frame,
        };
        Ok(Self {
            name,
            live,
            way: Way::Board(Box::new(board)),
            said: said.into(),
            is_new: false,
        })
    }

    fn play(path: &Path) -> Result<Self> {
        let record = SessionRecord::read(path)?;
        let board = PlayedBoard::open(path, Speed::Unpaced)?;
        let sheet = record.sheet()?;
        let learned = record.presses()?;
        let live = live(
            &board.session,
            &sheet,
            &record.wires,
            LiveOptions {
                picture_s: EVERY_FRAME_S,
                ..record.options()?
            },
            learned.as_ref(),
        )?
        .with_told(record.told()?);
        let said = record.differs().map(|differs| format!("{}: {differs}", path.display()));
        let played = Played {
            board,
            script: Script::open(path)?,
            frames: Frames::default(),
            stop: AtomicBool::new(false),
            ended: false,
        };
        Ok(Self {
            name: format!("recording of {}", record.source),
            live,
            way: Way::Recording(Box::new(played)),
            said: said.into_iter().collect(),
            is_new: false,
        })
    }

    /// Where the frames come from, in words.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The model of the sheet: once there is a baseline, with the electrodes where that showed them to be.
    pub fn imager(&self) -> &Arc<Imager> {
        self.live.imager()
    }

    /// The baseline in force, V; none while the first one is taken.
    pub fn baseline_v(&self) -> Option<&[f64]> {
        self.live.baseline().map(|b| b.values_v.as_slice())
    }

    /// The next thing there is to say, each once: what is wrong with the baseline, what happened to the board.
    pub fn said(&mut self) -> Option<String> {
        self.said.pop_front()
    }

    /// Takes a new baseline, from the next frame on: nothing may touch the sheet.
    ///
    /// # Errors
    /// A recording has the baselines that were taken then.
    pub fn tare(&mut self) -> Result<()> {
        let Way::Board(board) = &self.way else {
            bail!("this is a recording: its baselines are those that were taken then");
        };
        board.session.keep_all();
        self.live.tare();
        Ok(())
    }

    /// The next frame with its result; waits no longer than so for one of a board.
    ///
    /// # Errors
    /// The board stopped with an error, or the recording cannot be read.
    pub fn next(&mut self, wait: Duration) -> Result<Next<'_>> {
        if std::mem::take(&mut self.is_new)
            && let Some(inspection) = self.live.inspection()
        {
            self.said.extend(inspection.warnings());
            self.said.extend(inspection.notes());
        }
        let rested = self.live.rested().filter(|_| matches!(self.way, Way::Board(_)));
        if let Some(baseline) = rested {
            self.said.push_back(
                "what lay on the sheet in the baseline has gone, and nothing touches: a new baseline is in force"
                    .to_owned(),
            );
            self.live.resume(baseline)?;
            self.is_new = true;
        }
        let taken = match &mut self.way {
            Way::Board(board) => board.next(wait, &mut self.live, &mut self.said)?,
            Way::Recording(played) => match played.next(&mut self.live, &mut self.said)? {
                Some(frame) => Some(frame),
                None => return Ok(Next::Ended),
            },
        };
        let Some(frame) = taken else { return Ok(Next::Waiting) };
        let left = match self.live.frame(frame.time_s, &frame.values_v)? {
            LiveFrame::Picture(result) => return Ok(Next::Frame(frame, result)),
            LiveFrame::Baseline { left, again } => {
                self.said.extend(again.then(|| MOVED_SAID.to_owned()));
                left
            }
        };
        if let Way::Board(board) = &self.way {
            board.baseline(left);
        }
        self.is_new = left == 0;
        Ok(Next::Waiting)
    }
}

/// What makes touches of a session's frames.
fn live(
    session: &Session,
    sheet: &Sheet,
    wires: &[usize],
    options: LiveOptions,
    learned: Option<&PressCalibration>,
) -> Result<Live> {
    let pattern = pattern(session, wires)?;
    let imager = Imager::new(sheet, Drive::PAPER, pattern, Method::Nnls.cell_mm_on(sheet)?)?;
    let live = Live::new(Arc::new(imager), options);
    Ok(match learned {
        Some(learned) => live.with_learned(learned.taught()),
        None => live,
    })
}

impl Board {
    /// The next frame; none where none came in time, or it was measured before the scene began.
    fn next(&mut self, wait: Duration, live: &mut Live, said: &mut VecDeque<String>) -> Result<Option<MeasuredFrame>> {
        let frame = self.session.frame(wait)?;
        let mut tare = false;
        while let Some(event) = self.session.event() {
            match &event {
                ConnectionEvent::Lost { .. } => live.gap(),
                ConnectionEvent::Restored { firmware, .. } => {
                    // What came before says nothing of what comes now.
                    self.notices = LinkNotices::default();
                    tare |= firmware.is_some();
                }
                ConnectionEvent::OtherBoard { .. } => {}
            }
            said.push_back(event.to_string());
        }
        while let Some(notice) = self.session.notice() {
            said.push_back(notice.to_string());
        }
        if tare {
            said.push_back("its values may differ a little: a new baseline is taken, do not touch".to_owned());
            self.session.keep_all();
            live.tare();
        }
        if !self.session.is_away() {
            let notice = self.notices.take(&self.session.link().counters(), frame.as_ref());
            said.extend(notice.map(|notice| notice.to_string()));
        }
        if frame.is_none() || self.session.is_away() {
            self.session.check_silence(SILENCE)?;
            return Ok(None);
        }
        Ok(frame.filter(|frame| !self.is_before_the_scene(frame, live)))
    }

    /// Whether a frame was measured before the simulated skin's scene began. The frames that are handed out begin with the scene.
    fn is_before_the_scene(&mut self, frame: &MeasuredFrame, live: &Live) -> bool {
        let Some(held) = self.held.as_ref().filter(|_| live.baseline().is_some()) else {
            return false;
        };
        let before = held.scene_began_s().is_none_or(|began_s| frame.time_s < began_s);
        if !before {
            self.held = None;
        }
        before
    }

    /// A frame went into the baseline, and so many more are wanted.
    fn baseline(&self, left: usize) {
        if left > 0 {
            return;
        }
        if !self.every_frame {
            self.session.skip_over(LAG_S);
        }
        if let Some(held) = &self.held {
            held.begin_scene();
        }
    }
}

impl Played {
    /// The next frame that was taken then; none at the end.
    fn next(&mut self, live: &mut Live, said: &mut VecDeque<String>) -> Result<Option<MeasuredFrame>> {
        while let Some(step) = self.script.next()? {
            match step {
                Step::Tare => live.tare(),
                Step::Resume(baseline, touching) => {
                    live.resume(baseline)?;
                    if let Some(touching) = touching {
                        live.go_on(touching.numbered);
                    }
                }
                Step::InForce(_) => {}
                Step::Event(then) => {
                    self.frames.happened(&then.event);
                    if matches!(then.event, Event::BoardAway { .. }) {
                        live.gap();
                    }
                    said.push_back(then.text);
                }
                Step::Frame { frame, .. } => {
                    if let Some(found) = self.frames.find(&self.board, frame, &self.stop)? {
                        return Ok(Some(found));
                    }
                    said.push_back(format!("frame {frame} was taken then, and is missing in the recording"));
                }
            }
        }
        if !std::mem::replace(&mut self.ended, true)
            && let Some(lacks) = self.script.lacks()
        {
            said.push_back(format!(
                "{lacks}; skin recover makes a file of the rest for other programs"
            ));
        }
        Ok(None)
    }
}
