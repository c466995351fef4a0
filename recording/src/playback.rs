//! A board's port that sends what was recorded.

use crate::error::RecordingError;
use crate::reader::{Known, Reader};
use crate::topic::{PORT_STEP, Topic};
use protocol::{
    BoardError, Command, Decoder, FromBoard, Hello, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, Plan, ToBoard, encode,
};
use serde::Deserialize;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufReader, ErrorKind, Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How fast a recording is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Speed {
    /// So many times as fast as it was, above 0.
    Times(f64),
    /// As fast as somebody reads.
    Unpaced,
}

/// When what is played. Recordings that share one keep the times between them.
#[derive(Clone, Debug, Default)]
pub struct Pace(Arc<Mutex<Begun>>);

/// Log time, ns, and present of what is played first.
#[derive(Debug, Default)]
struct Begun {
    log_ns: Option<u64>,
    at: Option<Instant>,
}

impl Pace {
    /// All that was recorded before a log time, ns, is played at once.
    pub fn from(log_ns: u64) -> Self {
        Self(Arc::new(Mutex::new(Begun {
            log_ns: Some(log_ns),
            at: None,
        })))
    }

    /// Log time and present of what is played first; this, where nothing was.
    fn began(&self, log_ns: u64) -> (u64, Instant) {
        let mut begun = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        (
            *begun.log_ns.get_or_insert(log_ns),
            *begun.at.get_or_insert_with(Instant::now),
        )
    }
}

/// Longest that a read waits.
const WAIT: Duration = Duration::from_millis(20);

/// A port with a recorded board behind it; clones are the same. It introduces itself and accepts the recorded plan as the board did; from the start on
/// it sends what the board sent after it was started, and nothing else. Where the recorded port was opened again, this one is gone
/// until it is [opened again](Playback::reopen), too. At the end reads give no byte, which is the end of a port.
#[derive(Clone)]
pub struct Playback {
    played: Arc<Mutex<Played>>,
    hello: Hello,
    plan: Plan,
    ended: Arc<AtomicBool>,
    /// Which of the recorded ports it is.
    port: u32,
}

struct Played {
    reader: Reader<BufReader<File>>,
    hello: Hello,
    plan: Plan,
    speed: Speed,
    pace: Pace,
    /// Whether it plays from a place behind the board's start.
    within: bool,
    commands: Decoder<MAX_TO_BOARD_LEN>,
    out: VecDeque<u8>,
    /// Since the start was asked for.
    playing: Option<Playing>,
    ended: Arc<AtomicBool>,
    /// How often the recorded port was opened again so far.
    ports: u32,
}

#[derive(Default)]
struct Playing {
    decoder: Decoder<MAX_FROM_BOARD_LEN>,
    /// Whether the recorded board was started already.
    started: bool,
    /// What is to be sent next.
    next: Option<Next>,
}

/// What comes next by a recorded port.
enum Next {
    /// A message, with its log time.
    Message(u64, Vec<u8>),
    /// It was opened again at this log time.
    Port(u64),
}

impl Next {
    fn log_ns(&self) -> u64 {
        match self {
            Self::Message(log_ns, _) | Self::Port(log_ns) => *log_ns,
        }
    }
}

/// What a step of the live reconstruction says of the port.
#[derive(Deserialize)]
struct Step {
    step: String,
}

fn decoded(decoder: &mut Decoder<MAX_FROM_BOARD_LEN>, message: &[u8]) -> Option<FromBoard> {
    let mut out = None;
    decoder.push(message, |m| out = m.ok());
    out
}

impl Playback {
    /// Opens a recording.
    ///
    /// # Errors
    /// It cannot be read, or nobody introduced itself in it.
    pub fn open(path: &Path, speed: Speed) -> Result<Self, RecordingError> {
        Self::open_at(path, speed, Pace::default(), None)
    }

    /// Opens a recording to be played at a pace, from a [place](Reader::place) on.
    ///
    /// # Errors
    /// As [`Playback::open`].
    pub fn open_at(
        path: &Path,
        speed: Speed,
        pace: Pace,
        place: Option<(&Known, u64)>,
    ) -> Result<Self, RecordingError> {
        let mut reader = Reader::open(path)?;
        let lacks = |what| RecordingError::Lacks {
            file: path.display().to_string(),
            what,
        };
        let mut decoder = Decoder::new();
        let (mut hello, mut plan) = (None, None);
        while let Some(message) = reader.next()? {
            if message.topic != Some(Topic::Board) {
                continue;
            }
            match decoded(&mut decoder, message.data) {
                Some(FromBoard::Hello(said)) => hello = Some(said),
                Some(FromBoard::Plan(said)) => plan = Some(said),
                Some(FromBoard::Ack(Command::Start)) if plan.is_some() => break,
                // Its start was lost.
                Some(FromBoard::Frame(frame)) if plan.as_ref().is_some_and(|p| p.id == frame.plan) => break,
                _ => {}
            }
        }
        let hello = hello.ok_or_else(|| lacks("introduction of a board"))?;
        let plan = plan.ok_or_else(|| lacks("plan of what was measured"))?;
        let ended = Arc::default();
        let played = Played {
            hello: hello.clone(),
            plan: plan.clone(),
            reader: match place {
                Some((known, place)) => Reader::open_at(path, known, place)?,
                None => Reader::open(path)?,
            },
            speed,
            pace,
            within: place.is_some(),
            commands: Decoder::new(),
            out: VecDeque::new(),
            playing: None,
            ended: Arc::clone(&ended),
            ports: 0,
        };
        Ok(Self {
            played: Arc::new(Mutex::new(played)),
            hello,
            plan,
            ended,
            port: 0,
        })
    }

    /// The port once more, as it was opened again when it was recorded.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`] at the end of the recording.
    pub fn reopen(&self) -> io::Result<Self> {
        if self.ended.load(Ordering::Acquire) {
            return Err(ErrorKind::NotFound.into());
        }
        let port = self.played().ports;
        Ok(Self { port, ..self.clone() })
    }

    fn played(&self) -> MutexGuard<'_, Played> {
        self.played.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Who the board was.
    pub fn hello(&self) -> &Hello {
        &self.hello
    }

    /// What it measured.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Is true once everything was read.
    pub fn ended(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.ended)
    }
}

impl Played {
    fn answer(&mut self, message: &FromBoard) {
        match encode(message, &mut [0; MAX_FROM_BOARD_LEN]) {
            Ok(bytes) => self.out.extend(bytes),
            Err(e) => tracing::error!("an answer of the recorded board: {e}"),
        }
    }

    fn obey(&mut self, command: ToBoard) {
        let answer = match command {
            ToBoard::Hello => FromBoard::Hello(self.hello.clone()),
            ToBoard::SetPlan(_) | ToBoard::GetPlan => FromBoard::Plan(self.plan.clone()),
            ToBoard::SetWatch(watch) => FromBoard::Watch(watch),
            ToBoard::Start => FromBoard::Ack(Command::Start),
            // Answers are in the recording, or nobody asked then.
            _ => return,
        };
        let start = answer == FromBoard::Ack(Command::Start);
        self.answer(&answer);
        if start {
            self.playing = Some(Playing {
                started: self.within,
                ..Playing::default()
            });
        }
    }

    /// What comes next; none at the end.
    fn next(&mut self) -> Result<Option<Next>, RecordingError> {
        let Some(playing) = &mut self.playing else {
            return Ok(None);
        };
        if let Some(next) = playing.next.take() {
            return Ok(Some(next));
        }
        while let Some(message) = self.reader.next()? {
            let again = message.topic == Some(Topic::Live)
                && serde_json::from_slice::<Step>(message.data).is_ok_and(|s| s.step == PORT_STEP);
            if again && playing.started {
                return Ok(Some(Next::Port(message.log_ns)));
            }
            if message.topic != Some(Topic::Board) {
                continue;
            }
            let send = match decoded(&mut playing.decoder, message.data) {
                Some(FromBoard::Ack(Command::Start)) => {
                    playing.started = true;
                    false
                }
                Some(FromBoard::Frame(frame)) => {
                    playing.started |= frame.plan == self.plan.id;
                    playing.started
                }
                // A reset, the plan after it, a sign of life, a stop; or what was damaged on the way, which is counted again.
                Some(FromBoard::Hello(_) | FromBoard::Plan(_) | FromBoard::Heartbeat(_)) | None => playing.started,
                Some(FromBoard::Error(e)) => playing.started && !matches!(e, BoardError::Command(_)),
                Some(_) => false,
            };
            if send {
                return Ok(Some(Next::Message(message.log_ns, message.data.to_vec())));
            }
        }
        Ok(None)
    }
}

impl Played {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.out.is_empty() {
            if self.playing.is_none() {
                // Nothing was asked for: nothing will come.
                std::thread::sleep(Duration::from_millis(1));
                return Err(ErrorKind::TimedOut.into());
            }
            let Some(next) = self.next().map_err(io::Error::other)? else {
                self.ended.store(true, Ordering::Release);
                return Ok(0);
            };
            let playing = self.playing.get_or_insert_default();
            if let Speed::Times(times) = self.speed {
                let log_ns = next.log_ns();
                let (first_ns, began) = self.pace.began(log_ns);
                let after_s = 1e-9 * log_ns.saturating_sub(first_ns) as f64 / times;
                let due = Duration::try_from_secs_f64(after_s).unwrap_or(Duration::MAX);
                let wait = due.saturating_sub(began.elapsed());
                std::thread::sleep(wait.min(WAIT));
                if wait > WAIT {
                    playing.next = Some(next);
                    return Err(ErrorKind::TimedOut.into());
                }
            }
            match next {
                Next::Message(_, message) => self.out.extend(message),
                Next::Port(_) => {
                    self.ports += 1;
                    return Err(ErrorKind::BrokenPipe.into());
                }
            }
        }
        let count = self.out.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(self.out.drain(..count)) {
            *place = byte;
        }
        Ok(count)
    }
}

impl Read for Playback {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut played = self.played();
        match buffer {
            [] => Ok(0),
            _ if played.ports != self.port => Err(ErrorKind::BrokenPipe.into()),
            buffer => played.read(buffer),
        }
    }
}

impl Write for Playback {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut played = self.played();
        let mut commands = Vec::new();
        played
            .commands
            .push(bytes, |command: Result<ToBoard, _>| commands.extend(command));
        // Once it plays, what the board answered is in the recording.
        for command in commands {
            if played.playing.is_none() {
                played.obey(command);
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
