//! What is measured for an examination, without a judgement: of a board, of a recording, or that there is neither.

use super::arguments::Examined;
use crate::board::{Choice, Connected};
use crate::config::Config;
use crate::played_board::PlayedBoard;
use crate::recorded::SessionRecord;
use crate::recorded_board::{ONLY_LIVE, RecordedBoard};
use crate::{hello, run_session, sheet, simulated_skin};
use ::forward::{Pattern, Sheet};
use anyhow::{Context, Result, anyhow};
use inverse::live::LiveOptions;
use inverse::reference::baseline::Baseline;
use inverse::reference::imager::Imager;
use link::plans::live_plan;
use link::{Arrival, Link, LinkCounters, LinkNotice, LinkNotices, MeasuredFrame, Session};
use protocol::{Counters, FromBoard, Hello, Plan, SelfTest, Status, ToBoard};
use recording::{Speed, Tap};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What is known, or why it is not.
pub(crate) type Known<T> = Result<T, String>;

/// Where the facts are from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Origin {
    /// A board behind a port.
    Port,
    /// A simulated board, whose time passes as fast as it is listened to.
    Simulated,
    /// A recording.
    Recording(PathBuf),
}

/// A board that is not there.
#[derive(Clone, Debug)]
pub(crate) struct NoBoard {
    pub(crate) why: String,
    /// Its port was opened.
    pub(crate) opened: bool,
    /// Its firmware does not belong to this program.
    pub(crate) other_version: bool,
}

/// Facts of an examination.
pub(crate) struct Facts {
    pub(crate) origin: Origin,
    /// The port's name, or that of what is in its place.
    pub(crate) source: String,
    pub(crate) hello: Result<Hello, NoBoard>,
    pub(crate) self_test: Known<SelfTest>,
    pub(crate) status: Known<Status>,
    /// The board's own counters before and after the frames.
    pub(crate) counters: Known<[Counters; 2]>,
    pub(crate) sheet: Sheet,
    pub(crate) measured: Known<Measured>,
}

/// Frames, and what became of the line meanwhile.
pub(crate) struct Measured {
    pub(crate) plan: Plan,
    /// What the plan promises, s.
    pub(crate) frame_s: f64,
    pub(crate) frames: Vec<MeasuredFrame>,
    /// Time from the first frame to the last by this computer's clock, s.
    pub(crate) wall_s: f64,
    /// What the link counted since it was opened.
    pub(crate) link: LinkCounters,
    /// What `skin run` would have said of the line.
    pub(crate) notices: Vec<LinkNotice>,
    /// Why it ended before its time.
    pub(crate) ended: Option<String>,
    /// What the values are, with the wires where they lead.
    pub(crate) pattern: Pattern,
    /// The sheet's model; why there is none.
    pub(crate) imager: Known<Arc<Imager>>,
    /// The unpressed sheet.
    pub(crate) baseline: Baseline,
}

impl Measured {
    /// Frames that should have come between the first and the last, how many of them are missing, and the board's time between them,
    /// s. Over a reset nothing is counted.
    pub(crate) fn count(&self) -> (u64, u64, f64) {
        let steps = self.steps();
        let all: u64 = steps.iter().map(|(frames, _)| frames).sum();
        let span_s = steps.iter().map(|(_, s)| s).sum();
        (all, all.saturating_sub(steps.len() as u64), span_s)
    }

    /// Frames a second by the board's time, where none is missing between two: one that is given up takes less time.
    pub(crate) fn made_per_s(&self) -> f64 {
        let (mut count, mut span_s) = (0.0, 0.0);
        for (_, s) in self.steps().iter().filter(|(frames, _)| *frames == 1) {
            count += 1.0;
            span_s += s;
        }
        count / span_s
    }

    /// From every frame to the next that came: by so many numbers and seconds, but over a reset.
    fn steps(&self) -> Vec<(u64, f64)> {
        let step = |pair: &[MeasuredFrame]| {
            let frames = pair[1].sequence.wrapping_sub(pair[0].sequence);
            (u64::from(frames), pair[1].time_s - pair[0].time_s)
        };
        let steps = self.frames.windows(2).map(step);
        steps.filter(|(_, s)| *s > 0.0).collect()
    }

    /// Resets that were seen.
    pub(crate) fn resets(&self) -> usize {
        self.notices.iter().filter(|n| **n == LinkNotice::Reset).count()
    }

    /// Messages that arrived damaged.
    pub(crate) fn damaged(&self) -> u64 {
        let decoder = self.link.decoder;
        u64::from(decoder.crc) + u64::from(decoder.malformed) + u64::from(decoder.overflow)
    }

    /// Whether what is lost or damaged was read too late from a port, and is not the line's doing.
    pub(crate) fn was_late(&self, origin: &Origin) -> bool {
        let Arrival { damaged, late } = self.link.arrival;
        *origin == Origin::Port && damaged == 0 && late > 0
    }
}

/// How often the loop looks up while no frame comes.
const LOOK: Duration = Duration::from_millis(100);
/// A board that says nothing for so long is gone.
const SILENCE: Duration = Duration::from_secs(3);
/// How long a board may take to say what it counted or is set to.
const ANSWER: Duration = Duration::from_secs(1);

/// Is told of a session, its sheet and its source before the first frame is taken.
pub(crate) type Begin<'a> = &'a mut dyn FnMut(&Session, &Sheet, &str);

/// Records what passes while a board is examined.
pub(crate) struct Witness<'a> {
    /// What passes by the port goes here, too.
    pub(crate) tap: &'a Tap,
    pub(crate) begin: Begin<'a>,
}

/// Examines what the command line names.
///
/// # Errors
/// What is asked for makes no sense: a file that cannot be read, several boards. A board that is not there or broken is no error.
pub(crate) fn of(examined: &Examined, witness: Option<Witness<'_>>) -> Result<Facts> {
    if let Some(recording) = &examined.from {
        return of_recording(recording, examined.seconds);
    }
    let config = Config::load()?;
    let file = examined.sheet.clone().or(config.sheet);
    let sheet = sheet::load(file.as_deref())?.0;
    let choice = Choice::new(examined.port.clone(), examined.serial.clone(), examined.simulate, file);
    let bench =
        |sheet: Sheet| simulated_skin::bench(&sheet, examined.preset.unwrap_or_default(), &examined.fault, None);
    let origin = if examined.simulate {
        Origin::Simulated
    } else {
        Origin::Port
    };
    let tap = witness.as_ref().map(|w| w.tap);
    match choice.connect_or(tap, bench) {
        Ok(connected) => {
            let begin = witness.map(|w| w.begin);
            let (wires, seconds) = (&examined.wires, examined.seconds);
            Ok(gather(connected, origin, sheet, wires, seconds, begin))
        }
        Err(why) if why.is::<crate::usage::Usage>() => Err(why),
        Err(why) => {
            let link = why.chain().find_map(|e| e.downcast_ref::<link::LinkError>());
            let other_version = matches!(link, Some(link::LinkError::Version { .. }));
            let opened = link.is_some();
            let why = format!("{why:#}");
            Ok(Facts {
                origin,
                source: examined.port.clone().unwrap_or_else(|| "no port".to_owned()),
                self_test: Err(NOBODY.to_owned()),
                status: Err(NOBODY.to_owned()),
                counters: Err(NOBODY.to_owned()),
                measured: Err(NOBODY.to_owned()),
                hello: Err(NoBoard {
                    why,
                    opened,
                    other_version,
                }),
                sheet,
            })
        }
    }
}

/// Why nothing is known of a board that is not there.
pub(crate) const NOBODY: &str = "no board answered";

/// Asks a board, lets it test itself, and takes frames for so many seconds of its time.
pub(crate) fn gather(
    connected: Connected,
    origin: Origin,
    sheet: Sheet,
    wires: &[usize],
    seconds: f64,
    begin: Option<Begin<'_>>,
) -> Facts {
    let Connected { link, hello, source } = connected;
    // A damaged line may take the answer.
    let self_test = hello::self_test(&link).or_else(|_| hello::self_test(&link));
    let status = link.ask("what it is set to", ToBoard::GetStatus, ANSWER, |m| match m {
        FromBoard::Status(status) => Some(status),
        _ => None,
    });
    let before = counters(&link);
    let (measured, after) = match Session::start_on(link, live_plan) {
        Ok(session) => {
            if let Some(begin) = begin {
                begin(&session, &sheet, &source);
            }
            let next = || loop {
                match session.frame(LOOK)? {
                    Some(frame) => return Ok(Some(frame)),
                    None => session.check_silence(SILENCE)?,
                }
            };
            let measured = measure(&session, &sheet, wires, seconds, None, next);
            (measured.map_err(|e| format!("{e:#}")), counters(session.link()))
        }
        Err(why) => {
            let why = format!("the board does not measure: {why}");
            (Err(why.clone()), Err(why))
        }
    };
    Facts {
        origin,
        source,
        hello: Ok(hello),
        self_test: self_test.map_err(|e| format!("the board gives no result: {e:#}")),
        status: status.map_err(|e| e.to_string()),
        counters: before.and_then(|before| Ok([before, after?])),
        sheet,
        measured,
    }
}

fn counters(link: &Link) -> Known<Counters> {
    let answer = link.ask("what it counted", ToBoard::GetCounters, ANSWER, |m| match m {
        FromBoard::Counters(counters) => Some(counters),
        _ => None,
    });
    answer.map_err(|e| e.to_string())
}

fn of_recording(path: &Path, seconds: f64) -> Result<Facts> {
    let record = SessionRecord::read(path)?;
    let sheet = record.sheet()?;
    let said = RecordedBoard::read(path)?;
    let board = PlayedBoard::open(path, Speed::Unpaced)?;
    let session = &board.session;
    let baseline_frames = Some(record.baseline_frames);
    let measured = measure(session, &sheet, &record.wires, seconds, baseline_frames, || {
        board.frame()
    });
    Ok(Facts {
        source: format!("recording of {}", record.source),
        origin: Origin::Recording(path.to_owned()),
        hello: Ok(session.hello().clone()),
        self_test: said.self_test.ok_or_else(|| ONLY_LIVE.to_owned()),
        status: said.status.ok_or_else(|| ONLY_LIVE.to_owned()),
        counters: Err("a recording has no counters of the board".to_owned()),
        measured: measured.map_err(|e| format!("{e:#}")),
        sheet,
    })
}

/// Takes frames for so many seconds of the board's time, at least as many as a baseline has. The first `baseline_frames` are of the
/// unpressed sheet; none: all.
fn measure(
    session: &Session,
    sheet: &Sheet,
    wires: &[usize],
    seconds: f64,
    baseline_frames: Option<usize>,
    next: impl Fn() -> Result<Option<MeasuredFrame>>,
) -> Result<Measured> {
    let least = LiveOptions::default().baseline_frames;
    let (mut frames, mut notices) = (Vec::<MeasuredFrame>::new(), Vec::new());
    let (mut watched, mut taken_s) = (LinkNotices::default(), 0.0);
    let mut times: Option<[Instant; 2]> = None;
    let mut ended = None;
    while frames.len() < least || taken_s < seconds {
        let frame = match next() {
            Ok(Some(frame)) => frame,
            Ok(None) => break,
            Err(why) => {
                ended = Some(format!("{why:#}"));
                break;
            }
        };
        let now = Instant::now();
        times = Some([times.map_or(now, |[first, _]| first), now]);
        notices.extend(watched.take(&session.link().counters(), Some(&frame)));
        taken_s += frames.last().map_or(0.0, |last| {
            run_session::passed_s(last.time_s, frame.time_s, session.frame_s())
        });
        frames.push(frame);
    }
    if frames.len() < 2 {
        return Err(anyhow!(
            ended.unwrap_or_else(|| "there are fewer than two frames".to_owned())
        ))
        .context("nothing was measured");
    }
    let unpressed = frames.iter().take(baseline_frames.unwrap_or(frames.len()).max(2));
    let unpressed: Vec<&[f64]> = unpressed.map(|f| f.values_v.as_slice()).collect();
    let (wired, described) = (session.electrodes(), sheet.electrodes.len());
    let imager = if wired == described {
        run_session::imager(session, sheet, wires).map_err(|e| format!("{e:#}"))
    } else {
        Err(format!("the board has {wired} electrodes, the sheet {described}"))
    };
    let pattern = Pattern::from_pairs(session.electrodes(), session.measurements())?;
    Ok(Measured {
        pattern: sheet::rewired(pattern, wires)?,
        baseline: Baseline::plain(session.plan().value_count(), &unpressed),
        plan: session.plan().clone(),
        frame_s: session.frame_s(),
        wall_s: times.map_or(0.0, |[first, last]| (last - first).as_secs_f64()),
        link: session.link().counters(),
        frames,
        notices,
        ended,
        imager,
    })
}
