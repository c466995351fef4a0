//! Ports that are no good board: what is wrong is said as what it is.

use crate::session::{LONG, Scripted, board, framed};
use hil_sim::SimPort;
use link::plans::adjacent_plan;
use link::{Link, LinkCounters, LinkError, Session, greet};
use protocol::{FromBoard, Heartbeat, Hello, Watching};
use std::io::{self, ErrorKind, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

const WORKS: u8 = 0;
/// It says that it watches, whatever it is told.
const BEATS: u8 = 1;
/// The same, and it obeys.
const DOZES: u8 = 2;
/// It takes no byte.
const BLOCKED: u8 = 3;
/// Its driver never returns.
const HANGS: u8 = 4;
/// It sends nothing.
const SILENT: u8 = 5;

/// A board that works until it does not.
#[derive(Clone)]
struct Hostile {
    board: SimPort,
    mode: Arc<AtomicU8>,
}

impl Hostile {
    fn new() -> Self {
        let (board, mode) = (board(16), Arc::default());
        Self { board, mode }
    }

    fn session(&self) -> Session {
        Session::start(Box::new(self.clone()), adjacent_plan).unwrap()
    }

    fn mode(&self) -> u8 {
        self.mode.load(Ordering::Relaxed)
    }

    fn turns(&self, mode: u8) {
        self.mode.store(mode, Ordering::Relaxed);
    }
}

fn beat() -> Vec<u8> {
    framed(&FromBoard::Heartbeat(Heartbeat {
        time: 0,
        state: Watching::Asleep,
        level: 0,
        scans: 0,
    }))
}

impl Read for Hostile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if matches!(self.mode(), BEATS | DOZES) {
            std::thread::sleep(Duration::from_millis(5));
            return beat().as_slice().read(buffer);
        }
        if self.mode() == SILENT {
            std::thread::sleep(Duration::from_millis(5));
            return Err(ErrorKind::TimedOut.into());
        }
        while self.mode() == HANGS {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.board.read(buffer)
    }
}

impl Write for Hostile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self.mode() {
            BLOCKED => {
                std::thread::sleep(Duration::from_millis(5));
                Err(ErrorKind::TimedOut.into())
            }
            DOZES => {
                // It is told to measure.
                self.turns(WORKS);
                self.board.write(bytes)
            }
            _ => self.board.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// What ends a session that looks for silence, or none as long as frames come.
fn outcome(session: &Session, frames: usize) -> Result<(), LinkError> {
    let (mut seen, start) = (0, Instant::now());
    while seen < frames {
        assert!(start.elapsed() < LONG, "neither frames nor an error");
        seen += usize::from(session.frame(Duration::from_millis(20))?.is_some());
        session.check_silence(Duration::from_millis(1500))?;
    }
    Ok(())
}

#[test]
fn signs_of_life_without_a_frame_are_said() {
    let port = Hostile::new();
    let session = port.session();
    outcome(&session, 3).unwrap();
    port.turns(BEATS);
    // More than can wait already.
    let why = outcome(&session, usize::MAX).unwrap_err();
    assert!(
        matches!(why, LinkError::Watches { .. }) && why.to_string().contains("no frame"),
        "{why}"
    );
}

#[test]
fn frames_that_wait_are_taken_before_their_board_is_called_silent() {
    let port = Hostile::new();
    let session = port.session();
    session.link().hold(1 << 24);
    let start = Instant::now();
    let until = |is: fn(LinkCounters) -> bool| {
        while !is(session.link().counters()) {
            assert!(start.elapsed() < LONG);
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    until(|counters| counters.frames >= 100);
    port.turns(SILENT);
    until(|counters| counters.frameless > Duration::from_millis(1500));
    for taken in 0..100 {
        session.check_silence(Duration::from_millis(1500)).unwrap();
        assert!(session.frame(Duration::ZERO).unwrap().is_some(), "{taken}");
    }
    let why = outcome(&session, usize::MAX).unwrap_err();
    assert!(matches!(why, LinkError::NoFrames { .. }), "{why}");
}

#[test]
fn a_board_that_watches_without_being_asked_is_told_to_measure() {
    let port = Hostile::new();
    let session = port.session();
    outcome(&session, 3).unwrap();
    port.turns(DOZES);
    let start = Instant::now();
    while port.mode() == DOZES {
        assert!(start.elapsed() < LONG);
        session.frame(Duration::from_millis(20)).unwrap();
    }
    outcome(&session, 1000).unwrap();
}

#[test]
fn a_full_transmit_queue_is_waited_for_and_then_said() {
    let port = Hostile::new();
    let session = port.session();
    outcome(&session, 3).unwrap();
    // For a moment: nothing is lost.
    port.turns(BLOCKED);
    session.link().send(protocol::ToBoard::GetStatus);
    outcome(&session, 3).unwrap();
    port.turns(WORKS);
    outcome(&session, 1000).unwrap();
    // For ever.
    port.turns(BLOCKED);
    session.link().send(protocol::ToBoard::GetStatus);
    let why = outcome(&session, usize::MAX).unwrap_err().to_string();
    assert!(
        why.contains("transmit queue is full") && !why.contains("timed out"),
        "{why}"
    );
}

/// For a program that ends: whatever the thread does that has the link, the board is stopped, and a port that hangs keeps nobody.
#[test]
fn a_board_is_stopped_from_another_thread_unless_its_port_hangs() {
    for hangs in [false, true] {
        let port = Hostile::new();
        let session = port.session();
        outcome(&session, 3).unwrap();
        if hangs {
            port.turns(HANGS);
            // Perhaps it reads still.
            std::thread::sleep(Duration::from_millis(200));
        }
        let stopper = session.link().stopper();
        if hangs {
            assert!(!stopper.stop(Duration::from_millis(200)));
            port.turns(WORKS);
        }
        assert!(stopper.stop(LONG));
        // Nobody took a frame meanwhile.
        drop(session);
        let mut board = port.board.clone();
        let mut bytes = [0; 4096];
        while !matches!(board.read(&mut bytes), Err(e) if e.kind() == ErrorKind::TimedOut) {}
    }
}

#[test]
fn bytes_that_are_no_messages_are_no_silence() {
    for (byte, what) in [
        (0xff, "a line without power"),
        (0x55, "another rate"),
        (1, "another device"),
    ] {
        let port = Scripted::default();
        port.says.lock().unwrap().extend(std::iter::repeat_n(byte, 100_000));
        let link = Link::open(Box::new(port)).unwrap();
        let why = greet(&link).unwrap_err();
        assert!(
            matches!(why, LinkError::Damaged { bytes: 50_000.., .. }),
            "{what}: {why}"
        );
    }
    let link = Link::open(Box::new(Scripted::default())).unwrap();
    assert!(matches!(greet(&link), Err(LinkError::Silent { .. })));
}

#[test]
fn texts_of_a_board_cannot_command_a_terminal() {
    let hostile = "\u{1b}]0;x\u{7}\u{9b}2J\r\n";
    let hello = Hello {
        serial: protocol::text(hostile),
        board: protocol::text(hostile),
        git: protocol::text(hostile),
        firmware: protocol::text(hostile),
        last_panic: protocol::text(hostile),
        ..board_hello()
    };
    let port = Scripted::default();
    port.says.lock().unwrap().extend(framed(&FromBoard::Hello(hello)));
    let hello = greet(&Link::open(Box::new(port)).unwrap()).unwrap();
    for text in [&hello.serial, &hello.board, &hello.git, &hello.firmware] {
        assert_eq!(text.as_str(), "?]0;x??2J??");
    }
    assert_eq!(hello.last_panic.as_str(), "?]0;x??2J??");
}

/// As of a board.
fn board_hello() -> Hello {
    greet(&Link::open(Box::new(board(16))).unwrap()).unwrap()
}
