//! The serial link: bytes to messages on a thread of its own, commands the other way, and an account of what was lost.

use crate::error::LinkError;
use crate::inbox::{Inbox, Writer};
use protocol::{
    BoardError, Decoder, DecoderCounters, FromBoard, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, ToBoard, Version, encode,
};
use std::io::{ErrorKind, Read, Write};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What the link needs of a serial port: reads that return within some 100 ms (`TimedOut` when nothing came), and writes.
pub trait Port: Read + Write + Send {}
impl<T: Read + Write + Send + ?Sized> Port for T {}

/// What was lost on the way, since the link was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounters {
    /// What the decoder saw.
    pub decoder: DecoderCounters,
    /// Bytes received.
    pub bytes: u64,
    /// Frames received whole.
    pub frames: u64,
    /// Frames that the sequence numbers say were lost.
    pub lost_frames: u64,
    /// Frames received whole and passed over for newer ones, see [`Link::skip_over`].
    pub skipped_frames: u64,
    /// How long the port was listened to since the last frame or sign of life. A program that was stopped, or that had no
    /// processor, did not listen; a simulated board that is still at work is not silent.
    pub silent: Duration,
}

/// Most that one read of a port counts as listening: reads return within some 100 ms, unless the program was stopped.
const LONGEST_READ: Duration = Duration::from_millis(200);

/// An open link. Dropping it stops the board's stream, unless it was [left running](Link::leave_running), and closes the
/// port.
pub struct Link {
    stop_at_end: bool,
    commands: Option<Sender<ToBoard>>,
    inbox: Arc<Inbox>,
    counters: Arc<Mutex<LinkCounters>>,
    thread: Option<JoinHandle<()>>,
}

impl Link {
    /// Starts to read from a port.
    ///
    /// # Errors
    /// [`LinkError::Lost`] when the thread cannot be started.
    pub fn open(port: Box<dyn Port>) -> Result<Self, LinkError> {
        let (commands, command_queue) = channel();
        let inbox = Arc::new(Inbox::default());
        let counters = Arc::new(Mutex::new(LinkCounters::default()));
        let (messages, shared) = (inbox.writer(), Arc::clone(&counters));
        let thread = std::thread::Builder::new()
            .name("link".to_owned())
            .spawn(move || pump(port, &command_queue, &messages, &shared))
            .map_err(|e| LinkError::Lost(e.to_string()))?;
        Ok(Self {
            stop_at_end: true,
            commands: Some(commands),
            inbox,
            counters,
            thread: Some(thread),
        })
    }

    /// Counts silence from now on: frames are only expected of a board that was started.
    pub(crate) fn expect_frames(&self) {
        self.counters.lock().unwrap_or_else(PoisonError::into_inner).silent = Duration::ZERO;
    }

    /// Sends a command; it leaves before the next read.
    pub fn send(&self, command: ToBoard) {
        if let Some(queue) = &self.commands {
            // A link that has ended says so at the next message.
            let _ = queue.send(command);
        }
    }

    /// Lets the board go on as it is when the link is closed.
    pub fn leave_running(&mut self) {
        self.stop_at_end = false;
    }

    /// The next message, or `None` when none came in time.
    ///
    /// # Errors
    /// [`LinkError::Lost`] once the port is gone.
    pub fn receive(&self, wait: Duration) -> Result<Option<FromBoard>, LinkError> {
        match self.inbox.take(wait) {
            Some(Ok(message)) => Ok(Some(message)),
            Some(Err(error)) => Err(error),
            None => Ok(None),
        }
    }

    /// For pictures that must not lag: where frames wait that are older than the newest by more than so many samples of the
    /// board's time, all but the newest are passed over, and counted. The port is read all the time then.
    ///
    /// Without it every frame is kept until it is taken, and a program that leaves hundreds of them waiting stops the reading: the
    /// port loses bytes, and the sequence numbers tell.
    pub fn skip_over(&self, samples: u64) {
        self.inbox.skip_over(samples);
    }

    /// Ends [`Link::skip_over`]: every frame is kept from now on. What was too old already is passed over still.
    pub fn keep_all(&self) {
        self.inbox.keep_all();
    }

    /// Sends a command and waits for the answer that `accept` takes; anything else that comes meanwhile is dropped.
    ///
    /// # Errors
    /// No answer in time, a refusal, a lost port.
    pub fn ask<T>(
        &self,
        what: &'static str,
        command: ToBoard,
        wait: Duration,
        mut accept: impl FnMut(FromBoard) -> Option<T>,
    ) -> Result<T, LinkError> {
        self.send(command);
        let end = Instant::now() + wait;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            match self.receive(left)? {
                // A command damaged on the way is the line's fault, and perhaps not even this one.
                Some(FromBoard::Error(BoardError::Command(e))) => {
                    tracing::debug!("the board could not read a command: {e}")
                }
                Some(FromBoard::Error(e)) => return Err(LinkError::Refused(e.to_string())),
                Some(message) => {
                    if let Some(answer) = accept(message) {
                        return Ok(answer);
                    }
                }
                None => {
                    return Err(LinkError::Silent {
                        what,
                        ms: wait.as_millis(),
                    });
                }
            }
        }
    }

    /// What was lost so far.
    pub fn counters(&self) -> LinkCounters {
        LinkCounters {
            skipped_frames: self.inbox.skipped(),
            ..*self.counters.lock().unwrap_or_else(PoisonError::into_inner)
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        if self.stop_at_end {
            self.send(ToBoard::Stop);
        }
        self.commands = None;
        // The thread may be waiting for a place in it.
        self.inbox.close();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread of the link ended badly");
        }
    }
}

/// The link's thread: ends when the commands' sender is gone and all commands are sent, or the port is.
fn pump(mut port: Box<dyn Port>, commands: &Receiver<ToBoard>, messages: &Writer, shared: &Mutex<LinkCounters>) {
    let mut decoder = Decoder::<MAX_FROM_BOARD_LEN>::new();
    let mut bytes = [0; 4096];
    let mut last_sequence: Option<u32> = None;
    let mut out = [0; MAX_TO_BOARD_LEN];
    // A lone delimiter ends whatever the board's receiver had half of.
    let mut failure = port.write_all(&[0]).err();
    while failure.is_none() {
        match commands.try_recv() {
            Ok(command) => {
                match encode(&command, &mut out) {
                    Ok(framed) => failure = port.write_all(framed).and_then(|()| port.flush()).err(),
                    Err(e) => tracing::error!("{command:?}: {e}"),
                }
                continue;
            }
            Err(TryRecvError::Disconnected) => return,
            Err(TryRecvError::Empty) => {}
        }
        let begin = Instant::now();
        let read = port.read(&mut bytes);
        if !matches!(&read, Err(e) if e.kind() == ErrorKind::Interrupted) {
            let mut counters = shared.lock().unwrap_or_else(PoisonError::into_inner);
            counters.silent += begin.elapsed().min(LONGEST_READ);
        }
        let count = match read {
            Ok(0) => {
                failure = Some(ErrorKind::UnexpectedEof.into());
                break;
            }
            Ok(count) => count,
            Err(e)
                if matches!(
                    e.kind(),
                    ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
                ) =>
            {
                continue;
            }
            Err(e) => {
                failure = Some(e);
                break;
            }
        };
        let mut lost = 0;
        let mut frames = 0;
        let mut alive = false;
        decoder.push(&bytes[..count], |message: Result<FromBoard, _>| match message {
            Ok(message) => {
                alive |= matches!(message, FromBoard::Frame(_) | FromBoard::Heartbeat(_));
                if let FromBoard::Frame(frame) = &message {
                    frames += 1;
                    if let Some(last) = last_sequence {
                        // A board that was reset starts at 0 again: a huge gap is no loss.
                        let gap = frame.sequence.wrapping_sub(last).wrapping_sub(1);
                        lost += if gap < u32::MAX / 2 { u64::from(gap) } else { 0 };
                    }
                    last_sequence = Some(frame.sequence);
                }
                messages.put(Ok(message));
            }
            Err(e) => tracing::debug!("a damaged message: {e}"),
        });
        if let Some(version) = decoder.foreign.take()
            && version.major != Version::CURRENT.major
        {
            messages.put(Err(LinkError::Version {
                board: version.major,
                ours: Version::CURRENT.major,
            }));
        }
        let mut counters = shared.lock().unwrap_or_else(PoisonError::into_inner);
        counters.decoder = decoder.counters;
        if alive {
            counters.silent = Duration::ZERO;
        }
        counters.bytes += count as u64;
        counters.frames += frames;
        counters.lost_frames += lost;
    }
    if let Some(e) = failure {
        messages.put(Err(LinkError::Lost(e.to_string())));
    }
}
