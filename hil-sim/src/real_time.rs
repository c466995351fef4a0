//! A simulated board on a thread of its own, in step with the wall clock.

use crate::any_board::{AnyBoard, drain, locked};
use std::collections::VecDeque;
use std::io::{self, ErrorKind};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Bytes that the operating system would hold for a reader who does not come; later ones are lost, as on a real port.
const PIPE_BYTES: usize = 1 << 16;

/// How often the thread lets the board catch up, wall time. Longer delays bytes, shorter costs processor time.
pub(crate) const TICK: Duration = Duration::from_millis(1);

/// Simulated time that the board may be behind the wall clock before it gives up catching up, s. More sends longer bursts of
/// old frames after a pause of the machine; less gives up in pauses that a reader would not notice.
const LAG_S: f64 = 0.25;

/// What the port and the board's thread share.
#[derive(Debug, Default)]
pub(crate) struct Pipes {
    state: Mutex<PipeState>,
    /// Signalled when bytes came from the board or it ended.
    readable: Condvar,
    /// Signalled when the thread is to stop.
    stop: Condvar,
}

#[derive(Debug, Default)]
struct PipeState {
    from_board: VecDeque<u8>,
    to_board: Vec<u8>,
    /// The port was closed: the thread is to end.
    closed: bool,
    /// The thread has ended.
    ended: bool,
    /// How often the cable was put back; `None` while it is pulled.
    plugged: Option<u32>,
    /// The board's time, s.
    now_s: f64,
    /// The scene is to begin.
    begin_scene: bool,
    /// When it began, the board's time, s.
    scene_began_s: Option<f64>,
}

impl Pipes {
    /// Time-outs are those of the board's time: where less than half of that went by, because the machine is busy, the error
    /// is [`ErrorKind::Interrupted`] in place of [`ErrorKind::TimedOut`].
    pub(crate) fn read(&self, buffer: &mut [u8], timeout: Duration, plug: u32) -> io::Result<usize> {
        let state = locked(&self.state);
        let begin_s = state.now_s;
        let (mut state, _) = self
            .readable
            .wait_timeout_while(state, timeout, |s| {
                s.from_board.is_empty() && !s.ended && s.plugged == Some(plug)
            })
            .unwrap_or_else(PoisonError::into_inner);
        if state.plugged != Some(plug) {
            return Err(ErrorKind::BrokenPipe.into());
        }
        match drain(&mut state.from_board, buffer) {
            0 if state.ended => Err(ErrorKind::BrokenPipe.into()),
            0 if state.now_s - begin_s < 0.5 * timeout.as_secs_f64() => Err(ErrorKind::Interrupted.into()),
            0 => Err(ErrorKind::TimedOut.into()),
            n => Ok(n),
        }
    }

    pub(crate) fn write(&self, bytes: &[u8], plug: u32) -> io::Result<usize> {
        let mut state = locked(&self.state);
        if state.ended || state.plugged != Some(plug) {
            return Err(ErrorKind::BrokenPipe.into());
        }
        state.to_board.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    pub(crate) fn begin_scene(&self) {
        locked(&self.state).begin_scene = true;
    }

    pub(crate) fn scene_began_s(&self) -> Option<f64> {
        locked(&self.state).scene_began_s
    }

    /// How often the cable was put back; `None` while it is pulled.
    pub(crate) fn plugged(&self) -> Option<u32> {
        locked(&self.state).plugged
    }
}

/// A board on its thread; dropping it ends the thread.
pub(crate) struct Running {
    pub(crate) pipes: Arc<Pipes>,
    thread: Option<JoinHandle<()>>,
}

impl Running {
    pub(crate) fn start(board: Box<dyn AnyBoard>) -> io::Result<Self> {
        let pipes = Arc::new(Pipes::default());
        {
            let mut state = locked(&pipes.state);
            state.plugged = board.plugged();
            state.scene_began_s = board.scene_began_s();
        }
        let shared = Arc::clone(&pipes);
        let thread = std::thread::Builder::new().name("skin-sim".to_owned()).spawn(move || {
            // Also when the board panics: a reader must not wait for it for ever.
            let _ended = Ended(&shared);
            pace(board, &shared);
        })?;
        Ok(Self {
            pipes,
            thread: Some(thread),
        })
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        locked(&self.pipes.state).closed = true;
        self.pipes.stop.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic over there was already printed.
            let _ = thread.join();
        }
    }
}

/// Informs readers that nothing more comes.
struct Ended<'a>(&'a Pipes);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        locked(&self.0.state).ended = true;
        self.0.readable.notify_all();
    }
}

/// Keeps a board in step with the wall clock.
pub(crate) struct Pacer {
    start: Instant,
    bytes: VecDeque<u8>,
}

impl Pacer {
    /// The board's time begins now.
    pub(crate) fn new() -> Self {
        Self {
            start: Instant::now(),
            bytes: VecDeque::new(),
        }
    }

    /// Lets the board catch up with the clock, in slices, so that a slow machine still delivers and listens. `each` gets the
    /// time and the bytes after each step.
    pub(crate) fn run(&mut self, board: &mut dyn AnyBoard, mut each: impl FnMut(f64, &mut VecDeque<u8>)) {
        let target_s = self.start.elapsed().as_secs_f64().min(board.now_s() + LAG_S / 8.0);
        while board.now_s() < target_s {
            board.step(&mut self.bytes);
            each(board.now_s(), &mut self.bytes);
        }
        // A machine that was asleep or is too slow gets late frames, not a burst of old ones.
        let behind_s = self.start.elapsed().as_secs_f64() - board.now_s();
        if behind_s > LAG_S {
            self.start += Duration::from_secs_f64(behind_s);
        }
    }
}

/// Runs a board in step with the wall clock until its port is closed.
fn pace(mut board: Box<dyn AnyBoard>, pipes: &Pipes) {
    let mut pacer = Pacer::new();
    let mut bytes = VecDeque::new();
    loop {
        let mut state = locked(&pipes.state);
        let plugged = board.plugged();
        if plugged != state.plugged {
            state.plugged = plugged;
            state.from_board.clear();
            pipes.readable.notify_all();
        }
        state.now_s = board.now_s();
        if std::mem::take(&mut state.begin_scene) {
            board.begin_scene();
        }
        state.scene_began_s = board.scene_began_s();
        let room = PIPE_BYTES.saturating_sub(state.from_board.len());
        bytes.truncate(room);
        if !bytes.is_empty() {
            state.from_board.append(&mut bytes);
            pipes.readable.notify_all();
        }
        bytes.clear();
        let (mut state, _) = pipes
            .stop
            .wait_timeout_while(state, TICK, |s| !s.closed)
            .unwrap_or_else(PoisonError::into_inner);
        if state.closed {
            return;
        }
        let commands = std::mem::take(&mut state.to_board);
        drop(state);
        board.receive(&commands);
        pacer.run(board.as_mut(), |_, new| bytes.append(new));
    }
}
