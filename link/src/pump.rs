//! The link's thread: bytes of a port to messages, commands to bytes, and a port that is lost opened again.

use crate::error::LinkError;
use crate::inbox::Writer;
use crate::port::{Arrival, LinkCounters, Port, Reopen};
use crate::printable::printable;
use protocol::{Decoder, FromBoard, Hello, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, ToBoard, Version, encode};
use std::io::{self, ErrorKind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What the thread is told.
pub(crate) enum Order {
    /// Send this.
    Send(Box<ToBoard>),
    /// Close the port, for this reason, and open it again.
    Reopen(String),
    /// Close the port, for ever.
    Close,
}

/// Most that one turn of the thread counts as listening: reads return within some 100 ms, unless the program was stopped.
const LONGEST_READ: Duration = Duration::from_millis(200);
/// Bytes of a read at most, which take 40 ms at 1 Mbit/s. A read returns with the first byte: where it fills this so long after the read
/// before, they had waited.
const MOST_READ: usize = 4096;
const FULL_READ: Duration = Duration::from_millis(30);
/// A port that is gone is looked for so often.
const LOOK: Duration = Duration::from_millis(100);

/// A port that takes no byte of a command for so long is closed.
const STUCK: Duration = Duration::from_secs(2);

/// Whether there is nothing wrong but that it was to be waited for.
fn is_wait(e: &io::Error) -> bool {
    matches!(
        e.kind(),
        ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
    )
}

/// A message whose texts a terminal, a file's name or a page can show: whoever is behind the port may send anything.
fn harmless(mut message: FromBoard) -> FromBoard {
    if let FromBoard::Hello(hello) = &mut message {
        let Hello {
            serial,
            board,
            git,
            firmware,
            last_panic,
            ..
        } = hello;
        for text in [serial, board, git, firmware] {
            *text = protocol::text(&printable(text));
        }
        *last_panic = protocol::text(&printable(last_panic));
    }
    message
}

/// Why a port is served no more.
enum End {
    /// Nobody is there who could send a command.
    Closed,
    /// It is gone, or is to be opened again.
    Lost(String),
}

pub(crate) struct Pump {
    pub(crate) orders: Receiver<Order>,
    pub(crate) messages: Writer,
    pub(crate) shared: Arc<Mutex<LinkCounters>>,
    /// None where the first port is the only one.
    pub(crate) reopen: Option<Reopen>,
}

impl Pump {
    /// Ends when it is told to close, or the orders' senders are gone, and all is sent; or with the port, where it cannot be opened again.
    pub(crate) fn run(mut self, port: Box<dyn Port>) {
        let mut port = Some(port);
        let mut again = false;
        while let Some(open) = port.take() {
            let End::Lost(why) = Served::new(open, &self).run(again) else {
                return;
            };
            again = true;
            let arrival = self.counters().arrival;
            self.messages.put(Err(LinkError::Lost(why)), arrival);
            port = self.reopened();
        }
    }

    fn counters(&self) -> MutexGuard<'_, LinkCounters> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The port once it is back; none where nobody waits for it.
    fn reopened(&mut self) -> Option<Box<dyn Port>> {
        let reopen = self.reopen.as_mut()?;
        loop {
            let next = Instant::now() + LOOK;
            // What was to be sent to the board that has gone is not meant for the one that comes.
            loop {
                match self.orders.recv_timeout(next.saturating_duration_since(Instant::now())) {
                    Ok(Order::Close) | Err(RecvTimeoutError::Disconnected) => return None,
                    Ok(_) => {}
                    Err(RecvTimeoutError::Timeout) => break,
                }
            }
            match reopen() {
                Ok(port) => {
                    let mut counters = self.counters();
                    (counters.silent, counters.frameless) = (Duration::ZERO, Duration::ZERO);
                    counters.bytes_unread = 0;
                    drop(counters);
                    return Some(port);
                }
                Err(why) => tracing::debug!("not back yet: {why}"),
            }
        }
    }
}

/// A port while it is open.
struct Served<'a> {
    port: Box<dyn Port>,
    pump: &'a Pump,
    decoder: Decoder<MAX_FROM_BOARD_LEN>,
    last_sequence: Option<u32>,
    arrival: Arrival,
    /// Whether the read before came too late.
    was_late: bool,
    /// Whether a part of the message that comes was read too late.
    is_cut: bool,
    /// Until when the port was listened to.
    listened: Instant,
    /// What is to be sent still, and how long it was listened while the port took none of it.
    unsent: Vec<u8>,
    stuck: Duration,
}

impl<'a> Served<'a> {
    fn new(port: Box<dyn Port>, pump: &'a Pump) -> Self {
        let mut decoder = Decoder::new();
        let counters = *pump.counters();
        decoder.counters = counters.decoder;
        Self {
            port,
            pump,
            decoder,
            last_sequence: None,
            arrival: counters.arrival,
            was_late: false,
            is_cut: false,
            listened: Instant::now(),
            unsent: Vec::new(),
            stuck: Duration::ZERO,
        }
    }

    /// Until it is gone; `again` where it was before.
    fn run(mut self, again: bool) -> End {
        let outcome = self.serve(again);
        outcome.unwrap_or_else(|e| End::Lost(e.to_string()))
    }

    fn send(&mut self, command: &ToBoard) -> io::Result<()> {
        match encode(command, &mut [0; MAX_TO_BOARD_LEN]) {
            Ok(framed) => self.unsent.extend_from_slice(framed),
            Err(e) => tracing::error!("{command:?}: {e}"),
        }
        self.write()
    }

    /// Sends what the port takes. A transmit queue that is full is no lost port, unless it stays so.
    fn write(&mut self) -> io::Result<()> {
        while !self.unsent.is_empty() {
            match self.port.write(&self.unsent) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => {
                    self.unsent.drain(..count);
                    self.stuck = Duration::ZERO;
                }
                Err(e) if is_wait(&e) => {
                    if self.stuck > STUCK {
                        let (s, bytes) = (STUCK.as_secs(), self.unsent.len());
                        return Err(io::Error::other(format!(
                            "the port has taken none of {bytes} bytes of commands for {s} s: its transmit queue is full; is it the right device?"
                        )));
                    }
                    return Ok(());
                }
                Err(e) => return Err(e),
            }
        }
        self.stuck = Duration::ZERO;
        Ok(())
    }

    fn serve(&mut self, again: bool) -> io::Result<End> {
        let mut bytes = [0; MOST_READ];
        // A lone delimiter ends whatever the board's receiver had half of.
        self.unsent.push(0);
        self.write()?;
        if again {
            // Perhaps it is another board's now.
            self.send(&ToBoard::Hello)?;
        }
        loop {
            match self.pump.orders.try_recv() {
                Ok(Order::Send(command)) => {
                    self.send(&command)?;
                    continue;
                }
                Ok(Order::Reopen(why)) => return Ok(End::Lost(why)),
                Ok(Order::Close) | Err(TryRecvError::Disconnected) => return Ok(End::Closed),
                Err(TryRecvError::Empty) => {}
            }
            self.write()?;
            let read = self.port.read(&mut bytes);
            let since = self.listened.elapsed();
            let is_full = matches!(read, Ok(MOST_READ));
            let is_late = since > LONGEST_READ || is_full && (since > FULL_READ || self.was_late);
            let listened = since.min(LONGEST_READ);
            self.listened = Instant::now();
            if !matches!(&read, Err(e) if e.kind() == ErrorKind::Interrupted) {
                let mut counters = self.pump.counters();
                counters.silent += listened;
                counters.frameless += listened;
                self.stuck += listened;
            }
            match read {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(count) => self.take(&bytes[..count], is_late),
                Err(e) if is_wait(&e) => {}
                Err(e) => return Err(e),
            }
        }
    }

    /// Takes bytes that were read, in time or late.
    fn take(&mut self, bytes: &[u8], is_late: bool) {
        let (mut lost, mut frames, mut alive, mut read) = (0, 0, false, false);
        let (messages, last_sequence, arrival) = (&self.pump.messages, &mut self.last_sequence, &mut self.arrival);
        // What a late read leaves comes with the next; and what is cut off in a buffer that was full may end many reads later.
        let is_rest = std::mem::replace(&mut self.was_late, is_late) || is_late;
        self.is_cut |= is_rest;
        let is_cut = &mut self.is_cut;
        self.decoder.push(bytes, |message: Result<FromBoard, _>| match message {
            Ok(message) => {
                read = true;
                alive |= matches!(message, FromBoard::Frame(_) | FromBoard::Heartbeat(_));
                if let FromBoard::Frame(frame) = &message {
                    frames += 1;
                    if let Some(last) = last_sequence.replace(frame.sequence) {
                        // A board that was reset starts at 0 again: a huge gap is no loss.
                        let gap = frame.sequence.wrapping_sub(last).wrapping_sub(1);
                        lost += if gap < u32::MAX / 2 { u64::from(gap) } else { 0 };
                        arrival.late += u64::from(gap > 0 && *is_cut);
                    }
                }
                *is_cut = is_rest;
                messages.put(Ok(harmless(message)), *arrival);
            }
            Err(e) => {
                match std::mem::replace(is_cut, is_rest) {
                    true => arrival.late += 1,
                    false => arrival.damaged += 1,
                }
                tracing::debug!("a damaged message: {e}");
            }
        });
        if let Some(version) = self.decoder.foreign.take()
            && version.major != Version::CURRENT.major
        {
            let (board, ours) = (version.major, Version::CURRENT.major);
            messages.put(Err(LinkError::Version { board, ours }), *arrival);
        }
        let mut counters = self.pump.counters();
        counters.decoder = self.decoder.counters;
        counters.arrival = self.arrival;
        counters.bytes += bytes.len() as u64;
        counters.frames += frames;
        counters.lost_frames += lost;
        if alive {
            counters.silent = Duration::ZERO;
        }
        if frames > 0 {
            counters.frameless = Duration::ZERO;
        }
        counters.bytes_unread = if read {
            0
        } else {
            counters.bytes_unread + bytes.len() as u64
        };
    }
}
