//! `skin replay`: a recording through the very code that showed it live, frame by frame as it was taken then.

use crate::baselines::Baselines;
use crate::commands::Commands;
use crate::ending;
use crate::event::Event;
use crate::live_output::Output;
use crate::live_run::Run;
use crate::page::page;
use crate::recorded::SessionRecord;
use crate::replayed::Replayed;
use crate::run_arguments::ShowArguments;
use crate::run_session::{imager, shown_source};
use crate::say::{self, say};
use crate::script::{Script, Step};
use anyhow::{Context, Result};
use clap::Args;
use inverse::live::Live;
use inverse::touches::gestures::Gestures;
use link::{Link, MeasuredFrame, Port, Session};
use recording::{Playback, Speed};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use view::web::{Command, Recording};

/// Arguments of `skin replay`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The recording.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// How many times as fast as it was, or max for as fast as this machine can.
    #[arg(long, value_name = "X", default_value = "1", allow_negative_numbers = true, value_parser = speed)]
    speed: Speed,
    #[command(flatten)]
    show: ShowArguments,
}

fn speed(text: &str) -> Result<Speed, String> {
    match text.parse::<f64>() {
        _ if text == "max" => Ok(Speed::Unpaced),
        Ok(times) if times.is_finite() && times > 0.0 => Ok(Speed::Times(times)),
        _ => Err("give a number above 0, such as 0.5, or max".to_owned()),
    }
}

/// A recording as a board: its frames, as fast as they are taken.
pub(crate) struct PlayedBoard {
    pub(crate) session: Session,
    /// Is true once the recording was read to its end.
    pub(crate) ended: Arc<AtomicBool>,
}

impl PlayedBoard {
    /// Opens a recording.
    ///
    /// # Errors
    /// It cannot be read, or no board introduced itself in it.
    pub(crate) fn open(path: &Path, speed: Speed) -> Result<Self> {
        let playback = Playback::open(path, speed)?;
        let (plan, ended) = (playback.plan().clone(), playback.ended());
        // Where the board went away and came back, so does the recorded one.
        let again = playback.clone();
        let reopen = move || {
            let again = again.reopen().map_err(|e| e.to_string())?;
            Ok(Box::new(again) as Box<dyn Port>)
        };
        let link = Link::reopening(Box::new(playback), Box::new(reopen))?;
        let session = Session::start_on(link, |_| Ok(plan)).with_context(|| path.display().to_string())?;
        Ok(Self { session, ended })
    }

    /// The next frame; none at the end.
    ///
    /// # Errors
    /// The board stopped with an error then.
    pub(crate) fn frame(&self) -> Result<Option<MeasuredFrame>> {
        // The file may be read to its end while what came before still waits, and a port that is lost is told at once: only
        // waits in vain tell that nothing is left.
        let mut in_vain = 0;
        loop {
            let ended = self.ended.load(Ordering::Acquire);
            let begin = Instant::now();
            match self.session.frame(WAIT) {
                Ok(Some(frame)) => return Ok(Some(frame)),
                Ok(None) if ended && self.session.is_away() && begin.elapsed() >= WAIT => in_vain += 1,
                Ok(None) => in_vain = 0,
                Err(why) => return Err(why.into()),
            }
            if in_vain == 2 {
                return Ok(None);
            }
        }
    }
}

/// A frame of a recording is waited for so long at a time.
const WAIT: Duration = Duration::from_millis(100);

/// Frames that are looked through for one that was taken: as many as can wait between the port and the picture, twice.
const AHEAD: usize = 512;

/// Runs the command.
///
/// # Errors
/// A file that cannot be read, a page that cannot be served.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.file;
    let stop = ending::flag()?;
    let record = SessionRecord::read(path)?;
    // Lines are of the skin, as they were then.
    say::set_skin(record.skin.as_deref().map(Arc::from));
    if let Some(differs) = record.differs() {
        say!("warning: {}: {differs}", path.display());
    }
    let board = PlayedBoard::open(path, arguments.speed)?;
    let session = &board.session;
    let mut script = Script::open(path)?;
    let mut live = Live::new(imager(session, &record.sheet()?, &record.wires)?, record.options()?);
    let learned = record.presses()?;
    if let Some(learned) = &learned {
        live = live.with_learned(learned.taught());
    }
    let page = (!arguments.show.json || arguments.show.listen.is_some())
        .then(|| page(&arguments.show))
        .transpose()?;
    let source = shown_source(&format!("recording of {}", record.source), learned.as_ref());
    let mut run = Run {
        show: &arguments.show,
        seconds: None,
        every_frame: true,
        session,
        live: &mut live,
        gestures: Gestures::new(record.gestures()),
        commands: Commands::new(&arguments.show.on)?,
        output: &mut Output::new(page, &arguments.show, source),
        baselines: &mut Baselines::default(),
        watch: None,
        held: None,
        wanted: None,
        notes: None,
        recorder: None,
        recordable: None,
        replayed: Some(Replayed::default()),
    };
    run.output.header(session, &record, &run.live.imager().grid)?;
    let outcome = play(&mut run, &mut script, &board, &stop);
    if let (Ok(ended), Some(replayed)) = (&outcome, &run.replayed) {
        replayed.say(&path.display().to_string(), *ended);
        if *ended && !script.is_whole() {
            say!(
                "warning: {}: the file was cut short; skin recover closes it for other programs",
                path.display()
            );
        }
    }
    run.end(outcome.map(|_| ()))
}

/// Takes the steps of a recording; whether all.
fn play(run: &mut Run<'_>, script: &mut Script, board: &PlayedBoard, stop: &AtomicBool) -> Result<bool> {
    let mut pictures = 0;
    let mut frames = Frames::default();
    while !stop.load(Ordering::Relaxed) && run.show.frames.is_none_or(|n| pictures < n) {
        match run.output.command() {
            Some(Command::Tare | Command::UndoBaseline) => {
                say!("this is a recording: its baselines are those that were taken then");
            }
            Some(Command::StartRecording | Command::StopRecording) => run.output.set_recording(Recording {
                note: Some("a replay is not recorded: what it shows is in its file already".to_owned()),
                ..Recording::default()
            }),
            None => {}
        }
        let Some(step) = script.next()? else { return Ok(true) };
        run.output.set_now(script.unix_s());
        match step {
            Step::Tare => run.begin_baseline()?,
            Step::Resume(baseline) => {
                run.live.resume(baseline)?;
                run.in_force()?;
            }
            Step::InForce(note) => run.in_force_as(note)?,
            Step::Event(said) => {
                frames.happened(&said.event);
                run.happened(&said)?;
            }
            Step::Frame { frame, picture } => {
                let found = frames.find(board, frame, stop)?;
                let Some(replayed) = &mut run.replayed else {
                    return Ok(false);
                };
                let Some(found) = found else {
                    replayed.missing += u64::from(!stop.load(Ordering::Relaxed));
                    continue;
                };
                replayed.expected = picture;
                if run.take(&found)? {
                    pictures += 1;
                }
            }
        }
    }
    Ok(false)
}

/// The frames of a recording, as they are asked for.
#[derive(Default)]
pub(crate) struct Frames {
    /// Newer than the one asked for last, as far as their numbers tell; each with how often the board had come back before it.
    waiting: VecDeque<(u32, MeasuredFrame)>,
    /// How often the board has come back so far.
    connection: u32,
    ended: bool,
}

impl Frames {
    /// Something happened on the line then.
    pub(crate) fn happened(&mut self, event: &Event) {
        self.connection += u32::from(matches!(event, Event::BoardBack { .. }));
    }

    /// The next frame of a number. Those before it were passed over when it was recorded; none where it is not in the file.
    ///
    /// # Errors
    /// The board stopped with an error then.
    pub(crate) fn find(
        &mut self,
        board: &PlayedBoard,
        sequence: u32,
        stop: &AtomicBool,
    ) -> Result<Option<MeasuredFrame>> {
        let mut looked = 0;
        loop {
            while looked < self.waiting.len() {
                let (connection, frame) = &self.waiting[looked];
                if *connection > self.connection {
                    return Ok(None);
                }
                if *connection == self.connection && frame.sequence == sequence {
                    self.waiting.drain(..looked);
                    return Ok(self.waiting.pop_front().map(|(_, frame)| frame));
                }
                // After a reset the numbers begin anew: what seems newer may come before it.
                if *connection < self.connection || sequence.wrapping_sub(frame.sequence) < u32::MAX / 2 {
                    self.waiting.remove(looked);
                } else {
                    looked += 1;
                }
            }
            if self.ended || looked >= AHEAD || stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            match board.frame()? {
                Some(frame) => self.waiting.push_back((board.session.restored(), frame)),
                None => self.ended = true,
            }
        }
    }
}
