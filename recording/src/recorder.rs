//! The recorder's thread: takes from the queue and writes.

use crate::clock::{BoardClock, ClockFit};
use crate::error::RecordingError;
use crate::sink::Target;
use crate::tap::{Data, Item, Queue, Shared, Skin, Tap};
use crate::topic::{PORT_STEP, Topic};
use crate::wire::Splitter;
use crate::writer::Writer;
use protocol::{Decoder, FromBoard, MAX_FROM_BOARD_LEN};
use serde::Serialize;
use serde_json::json;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::sync::mpsc::RecvTimeoutError;
use std::sync::{Arc, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A chunk is written every so often: after a kill all but so much can be read, and what the machine was late by.
const FLUSH: Duration = Duration::from_millis(500);
/// The clocks are written every so often.
const CLOCK: Duration = Duration::from_secs(1);
/// The disk is made to hold what it was given every so often: a power cut loses no more. More often wears memory cards.
const SETTLE: Duration = Duration::from_secs(5);

/// What was recorded so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Messages written, of all topics.
    pub messages: u64,
    /// Frames of the board among them.
    pub frames: u64,
    /// Bytes in the file.
    pub file_bytes: u64,
    /// Messages that the recorder was too slow for.
    pub lost_messages: u64,
    /// Bytes of the port that it was too slow for.
    pub lost_bytes: u64,
}

/// A recording that goes on. Dropping it closes the file, and removes one that was not begun.
pub struct Recorder {
    tap: Tap,
    file: String,
    thread: Option<JoinHandle<Result<u64, RecordingError>>>,
    /// Before the thread begins.
    waiting: Option<Box<(Writer<File>, Queue)>>,
    told: bool,
}

impl Recorder {
    /// Makes the file. What is tapped from now on waits until [`Recorder::begin`].
    ///
    /// # Errors
    /// There is a file of that name, or the system said something.
    pub fn create(path: &Path) -> Result<Self, RecordingError> {
        let waiting = Self::waiting();
        waiting.into_file(path)
    }

    /// Without a file yet: [`WaitingRecorder::into_file`] makes one, with a name that the board's greeting tells.
    pub fn waiting() -> WaitingRecorder {
        let (tap, queue) = Tap::new();
        WaitingRecorder { tap, queue }
    }

    /// Hands over what there is to record.
    pub fn tap(&self) -> &Tap {
        &self.tap
    }

    /// The file's name.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Begins to write, with what was recorded and how as the first message.
    ///
    /// # Errors
    /// The thread cannot be started.
    pub fn begin(&mut self, session: &impl Serialize) -> Result<(), RecordingError> {
        self.begin_with(Topic::Session, session)
    }

    /// Begins a recording of several skins, with who they are as the first message. Each records by a [named](Tap::named) tap, its
    /// session first.
    ///
    /// # Errors
    /// As [`Recorder::begin`].
    pub fn begin_several(&mut self, skins: &impl Serialize) -> Result<(), RecordingError> {
        self.begin_with(Topic::Skins, skins)
    }

    fn begin_with(&mut self, topic: Topic, first: &impl Serialize) -> Result<(), RecordingError> {
        let Some(waiting) = self.waiting.take() else {
            return Ok(());
        };
        if self.tap.shared.take_fresh().is_none() {
            // The program ends, and the file was removed.
            return Ok(());
        }
        let (writer, queue) = *waiting;
        let file = writer.file().to_owned();
        let first = serde_json::to_vec(first).map_err(|e| RecordingError::io(&file, e.into()))?;
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || record(writer, &queue, topic, &first));
        self.thread = Some(thread.map_err(|e| RecordingError::io(&file, e))?);
        Ok(())
    }

    /// Why nothing is recorded any more; said once.
    pub fn failure(&mut self) -> Option<String> {
        if self.told {
            return None;
        }
        let failed = self.tap.shared.failed.lock().unwrap_or_else(PoisonError::into_inner);
        self.told = failed.is_some();
        failed.clone()
    }

    /// What was recorded so far.
    pub fn counts(&self) -> Counts {
        counts(&self.tap.shared)
    }

    /// Closes the file from elsewhere, while whoever records is busy.
    pub fn closer(&self) -> Closer {
        Closer { tap: self.tap.clone() }
    }

    /// Closes the file.
    ///
    /// # Errors
    /// Not all could be written.
    pub fn finish(mut self) -> Result<Counts, RecordingError> {
        let ended = self.end();
        let counts = self.counts();
        ended.map(|_| counts)
    }

    fn end(&mut self) -> Result<(), RecordingError> {
        if let Some(waiting) = self.waiting.take() {
            drop(waiting);
            return self.tap.shared.remove_fresh();
        }
        let Some(thread) = self.thread.take() else {
            return Ok(());
        };
        self.tap.end();
        match thread.join() {
            Ok(written) => written.map(|_| ()),
            Err(_) => {
                tracing::error!("the thread of the recorder ended badly; skin recover reads what it wrote");
                Ok(())
            }
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        if let Err(e) = self.end() {
            tracing::error!("{e}");
        }
    }
}

/// Closes a recording that somebody else makes.
#[derive(Clone)]
pub struct Closer {
    tap: Tap,
}

impl Closer {
    /// Whether the file is closed.
    pub fn is_closed(&self) -> bool {
        self.tap.shared.closed.load(Ordering::Acquire)
    }

    /// Asks for the end of a recording, after all that waits, and waits for it so long; whether the file is closed. One that was
    /// not begun is removed.
    pub fn close(&self, wait: Duration) -> bool {
        if let Err(e) = self.tap.shared.remove_fresh() {
            tracing::error!("{e}");
        }
        let end = Instant::now() + wait;
        let mut asked = false;
        while !self.is_closed() && Instant::now() < end {
            // The queue may be full, and the disk may not answer.
            asked = asked || self.tap.try_end();
            std::thread::sleep(Duration::from_millis(2));
        }
        self.is_closed()
    }
}

/// A recorder without a file yet.
pub struct WaitingRecorder {
    tap: Tap,
    queue: Queue,
}

impl WaitingRecorder {
    /// Hands over what there is to record.
    pub fn tap(&self) -> &Tap {
        &self.tap
    }

    /// Makes the file.
    ///
    /// # Errors
    /// As [`Recorder::create`].
    pub fn into_file(self, path: &Path) -> Result<Recorder, RecordingError> {
        let (writer, file) = (Writer::create(path)?, path.display().to_string());
        *self.tap.shared.fresh.lock().unwrap_or_else(PoisonError::into_inner) = Some(file.clone());
        Ok(Recorder {
            file,
            waiting: Some(Box::new((writer, self.queue))),
            tap: self.tap,
            thread: None,
            told: false,
        })
    }
}

impl Shared {
    fn take_fresh(&self) -> Option<String> {
        self.fresh.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Removes a file into which nothing was recorded: that is no recording.
    fn remove_fresh(&self) -> Result<(), RecordingError> {
        let Some(file) = self.take_fresh() else {
            return Ok(());
        };
        self.closed.store(true, Ordering::Release);
        std::fs::remove_file(&file).map_err(|e| RecordingError::io(&file, e))
    }
}

fn counts(shared: &Shared) -> Counts {
    let read = |count: &std::sync::atomic::AtomicU64| count.load(Ordering::Relaxed);
    Counts {
        messages: read(&shared.messages),
        frames: read(&shared.frames),
        file_bytes: read(&shared.file_bytes),
        lost_messages: read(&shared.lost_messages),
        lost_bytes: read(&shared.lost_bytes),
    }
}

/// The thread: until the end is asked for, or nobody is left who could. Once the disk is full it only empties the queue.
pub(crate) fn record<T: Target>(
    writer: Writer<T>,
    queue: &Queue,
    topic: Topic,
    first: &[u8],
) -> Result<u64, RecordingError> {
    let shared = Arc::clone(&queue.tap.shared);
    // What came by ports that turned out to be no board's is not recorded.
    let mut early: Vec<(Skin, Item)> = queue.items.try_iter().collect();
    let port = early
        .iter()
        .rposition(|(_, item)| matches!(item, Item::Port { .. }))
        .unwrap_or(0);
    let mut place = 0;
    early.retain(|(_, item)| {
        place += 1;
        place > port || !matches!(item, Item::Bytes { .. } | Item::Port { .. })
    });
    let mut state = State {
        writer,
        shared: &shared,
        boards: BTreeMap::new(),
    };
    let mut outcome = state.first(topic, first);
    let mut early = early.into_iter();
    let start = Instant::now();
    let (mut flush, mut clock, mut settle) = (start, start, start);
    while outcome.is_ok() {
        let wait = (flush + FLUSH).saturating_duration_since(Instant::now());
        let next = early.next().map_or_else(|| queue.items.recv_timeout(wait), Ok);
        match next {
            Ok((_, Item::End)) | Err(RecvTimeoutError::Disconnected) => break,
            Ok((skin, item)) => outcome = state.take(&skin, item),
            Err(RecvTimeoutError::Timeout) => {}
        }
        let now = Instant::now();
        if outcome.is_ok() && now >= clock + CLOCK {
            clock = now;
            outcome = state.clock(now);
        }
        if outcome.is_ok() && now >= flush + FLUSH {
            flush = now;
            outcome = state.flush(now >= settle + SETTLE);
            if now >= settle + SETTLE {
                settle = now;
            }
        }
    }
    let failed = |text: String| *shared.failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(text);
    match outcome.and_then(|()| state.clock(Instant::now())) {
        Ok(()) => {
            let written = state.writer.finish();
            match &written {
                Ok(bytes) => shared.file_bytes.store(*bytes, Ordering::Relaxed),
                Err(why) => failed(format!(
                    "{why}; the recording is closed, without its last part and its index"
                )),
            }
            shared.closed.store(true, Ordering::Release);
            written
        }
        Err(why) => {
            failed(match state.writer.abandon() {
                Ok(()) => format!("{why}; the recording ends here and is closed, without an index"),
                Err(e) => {
                    format!("{why}; the recording ends here, and could not be closed ({e}): skin recover reads it")
                }
            });
            shared.closed.store(true, Ordering::Release);
            // Nobody is to find the queue full.
            while !matches!(queue.items.recv(), Ok((_, Item::End)) | Err(_)) {}
            Err(why)
        }
    }
}

struct State<'a, T: Target> {
    writer: Writer<T>,
    shared: &'a Shared,
    /// By the skin's name.
    boards: BTreeMap<Skin, BoardState>,
}

/// What is known of a board.
#[derive(Default)]
struct BoardState {
    /// Of the host's bytes and of the board's.
    splitters: [Splitter; 2],
    decoder: Decoder<MAX_FROM_BOARD_LEN>,
    /// Samples a second of the board, once it has introduced itself.
    rate: Option<f64>,
    board: BoardClock,
    fit: Option<ClockFit>,
    /// Whether bytes of a port were recorded: another one is the same board's, which came back.
    has_port: bool,
}

impl<T: Target> State<'_, T> {
    fn first(&mut self, topic: Topic, message: &[u8]) -> Result<(), RecordingError> {
        let now = self.shared.clock.unix_ns(Instant::now());
        self.write(&None, topic, [now, now], message)?;
        self.flush(false)
    }

    /// Times: when it arrived or was made, and when what it is of was measured.
    fn write(&mut self, skin: &Skin, topic: Topic, ns: [u64; 2], data: &[u8]) -> Result<(), RecordingError> {
        self.shared.messages.fetch_add(1, Ordering::Relaxed);
        self.writer.message_of(skin.as_deref(), topic, ns[0], ns[1], data)
    }

    fn flush(&mut self, settle: bool) -> Result<(), RecordingError> {
        self.writer.flush()?;
        if settle {
            self.writer.settle()?;
        }
        self.shared.file_bytes.store(self.writer.len(), Ordering::Relaxed);
        Ok(())
    }

    fn take(&mut self, skin: &Skin, item: Item) -> Result<(), RecordingError> {
        match item {
            Item::Port { at } => {
                let board = self.boards.entry(skin.clone()).or_default();
                board.splitters = Default::default();
                if std::mem::replace(&mut board.has_port, true) {
                    let log_ns = self.shared.clock.unix_ns(at);
                    let step = json!({"step": PORT_STEP}).to_string();
                    return self.write(skin, Topic::Live, [log_ns, log_ns], step.as_bytes());
                }
            }
            Item::Bytes {
                at,
                from_board,
                bytes,
                torn,
            } => return self.bytes(skin, at, from_board, &bytes, torn),
            Item::Message {
                at,
                topic,
                frame_s,
                data,
            } => {
                let data = match data {
                    Data::Now(data) => Some(data),
                    Data::Later(make) => make(),
                };
                if let Some(data) = data {
                    let log_ns = self.shared.clock.unix_ns(at);
                    let fit = self.boards.get(skin).and_then(|b| b.fit);
                    self.write(
                        skin,
                        topic,
                        [log_ns, measured_ns(self.shared, fit, frame_s, log_ns)],
                        &data,
                    )?;
                }
            }
            Item::End => {}
        }
        Ok(())
    }

    fn bytes(
        &mut self,
        skin: &Skin,
        at: Instant,
        from_board: bool,
        bytes: &[u8],
        torn: bool,
    ) -> Result<(), RecordingError> {
        let board = self.boards.entry(skin.clone()).or_default();
        let splitter = &mut board.splitters[usize::from(from_board)];
        if torn {
            splitter.tear();
        }
        let mut whole = Vec::new();
        splitter.push(bytes, |message| whole.push(message.to_vec()));
        let log_ns = self.shared.clock.unix_ns(at);
        let topic = if from_board { Topic::Board } else { Topic::Host };
        for message in whole {
            let board = self.boards.entry(skin.clone()).or_default();
            let frame_s = if from_board {
                board.look(self.shared, &message, at)
            } else {
                None
            };
            let publish_ns = measured_ns(self.shared, board.fit, frame_s, log_ns);
            self.write(skin, topic, [log_ns, publish_ns], &message)?;
        }
        Ok(())
    }

    fn clock(&mut self, now: Instant) -> Result<(), RecordingError> {
        let counts = counts(self.shared);
        let wall = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let log_ns = self.shared.clock.unix_ns(now);
        let mut messages = Vec::new();
        for (skin, board) in &mut self.boards {
            board.fit = board.board.fit();
            let message = json!({
                "host_s": self.shared.clock.seconds(now),
                "wall_unix_s": wall.as_secs_f64(),
                "board_s": board.board.newest_s(),
                "offset_s": board.fit.map(|f| f.offset_s),
                "drift_ppm": board.fit.and_then(|f| f.drift_ppm),
                "residual_ms": board.fit.map(|f| 1e3 * f.residual_s),
                "messages": counts.messages,
                "lost_messages": counts.lost_messages,
                "lost_bytes": counts.lost_bytes,
            });
            messages.push((skin.clone(), message.to_string()));
        }
        for (skin, message) in messages {
            self.write(&skin, Topic::Clock, [log_ns, log_ns], message.as_bytes())?;
        }
        Ok(())
    }
}

/// When a frame was measured, by the fit of the clocks; when it arrived where there is none yet. A frame that took less time than
/// the fit takes for the least was still measured before it arrived.
fn measured_ns(shared: &Shared, fit: Option<ClockFit>, frame_s: Option<f64>, log_ns: u64) -> u64 {
    match (frame_s, fit) {
        (Some(frame_s), Some(fit)) => shared.clock.unix_ns_of(fit.host_s(frame_s)).min(log_ns),
        _ => log_ns,
    }
}

impl BoardState {
    /// The board's time of a frame, s.
    fn look(&mut self, shared: &Shared, message: &[u8], at: Instant) -> Option<f64> {
        let mut frame_s = None;
        let rate = &mut self.rate;
        let mut seen = 0;
        self.decoder
            .push(message, |decoded: Result<FromBoard, _>| match decoded {
                Ok(FromBoard::Hello(hello)) => *rate = Some(hello.sample_rate()),
                Ok(FromBoard::Frame(frame)) => {
                    seen += 1;
                    shared.first_frame.see(frame.sequence);
                    frame_s = rate.map(|rate| frame.time as f64 / rate);
                }
                _ => {}
            });
        shared.frames.fetch_add(seen, Ordering::Relaxed);
        if let Some(frame_s) = frame_s {
            self.board.arrived(frame_s, shared.clock.seconds(at));
            if self.fit.is_none() {
                self.fit = self.board.fit();
            }
        }
        frame_s
    }
}

#[cfg(test)]
#[path = "recorder_tests.rs"]
mod tests;
