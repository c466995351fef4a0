//! The board behind a pseudo-terminal, as a program sees it that opens files.
#![cfg(target_os = "linux")]

use crate::common::{disc, framed};
use hil_sim::{FixedSheet, Pace, Pty, PtyOptions, SimBoard, SimConfig};
use protocol::{Command, Decoder, FromBoard, MAX_FROM_BOARD_LEN, ToBoard};
use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::Path;
use std::time::{Duration, Instant};

/// No test ends by the clock unless something hangs.
const HANGS: Duration = Duration::from_secs(120);

fn pty(faults: &[&str], options: PtyOptions) -> Pty {
    let config = SimConfig {
        faults: faults.iter().map(|text| text.parse().unwrap()).collect(),
        ..SimConfig::default()
    };
    Pty::start(SimBoard::new(config, FixedSheet(disc(16))).unwrap(), options).unwrap()
}

fn open(path: &Path) -> File {
    File::options().read(true).write(true).open(path).unwrap()
}

/// What a port says, until it is enough; the first message may be cut.
fn listen(port: &mut File, mut enough: impl FnMut(&[FromBoard]) -> bool) -> Vec<FromBoard> {
    let (start, mut buffer) = (Instant::now(), [0; 4096]);
    let mut out = Vec::new();
    let mut decoder = Decoder::<MAX_FROM_BOARD_LEN>::new();
    while !enough(&out) {
        let others = || {
            out.iter()
                .filter(|m| !matches!(m, FromBoard::Frame(_)))
                .collect::<Vec<_>>()
        };
        assert!(start.elapsed() < HANGS, "{} frames and {:?}", frames(&out), others());
        let n = port.read(&mut buffer).unwrap();
        decoder.push(&buffer[..n], |m| out.extend(m));
    }
    out
}

/// Asks until there is an answer, as every program does: one that comes beside more frames than the system holds for a
/// reader is lost with them.
fn ask(port: &mut File, command: &ToBoard, answer: impl Fn(&FromBoard) -> bool) {
    let mut answered = false;
    while !answered {
        // A lone delimiter first: the board may have half of something.
        port.write_all(&[0]).unwrap();
        port.write_all(&framed(command)).unwrap();
        listen(port, |said| {
            answered = said.iter().any(&answer);
            answered || said.len() > 200
        });
    }
}

fn frames(said: &[FromBoard]) -> usize {
    said.iter().filter(|m| matches!(m, FromBoard::Frame(_))).count()
}

#[test]
fn a_port_can_be_opened_again_and_again_and_says_nothing_old() {
    let pty = pty(&[], PtyOptions::default());
    let path = pty.path().unwrap();
    let mut last = 0;
    for round in 0..4 {
        let mut port = open(&path);
        ask(&mut port, &ToBoard::Hello, |m| matches!(m, FromBoard::Hello(_)));
        ask(&mut port, &ToBoard::Start, |m| *m == FromBoard::Ack(Command::Start));
        let said = listen(&mut port, |said| frames(said) >= 5);
        let list = crate::common::frames(said);
        // Closed in mid-frame, while the board goes on: what it says meanwhile is lost, as on a port nobody has open.
        assert!(round == 0 || list[0].sequence > last, "{round}");
        last = list[list.len() - 1].sequence;
        drop(port);
        std::thread::sleep(Duration::from_millis(60));
    }
}

#[test]
fn frames_come_in_the_boards_own_time() {
    let pty = pty(&[], PtyOptions::default());
    let mut port = open(&pty.path().unwrap());
    port.write_all(&framed(&ToBoard::Start)).unwrap();
    let start = Instant::now();
    let said = listen(&mut port, |said| frames(said) >= 60);
    let list = crate::common::frames(said);
    let span_s = hil_sim::seconds(list[list.len() - 1].time - list[0].time);
    // Never faster than the board measures, however fast the reader is; the adapter holds at most a transfer back.
    assert!(span_s <= start.elapsed().as_secs_f64() + 0.05, "{span_s}");
}

/// However slow the reader, an unpaced board waits for it: nothing is lost, and time passes as far as is read.
#[test]
fn an_unpaced_board_waits_for_its_reader() {
    let options = PtyOptions {
        pace: Pace::Unpaced,
        ..PtyOptions::default()
    };
    let pty = pty(&["cable_pulled@3+0.5"], options);
    let mut port = open(&pty.path().unwrap());
    ask(&mut port, &ToBoard::Start, |m| *m == FromBoard::Ack(Command::Start));
    let mut slept = false;
    let said = listen(&mut port, |said| {
        if !slept && frames(said) > 0 {
            // Far more than the system holds for a reader would pass in this time, if the board did not wait.
            std::thread::sleep(Duration::from_millis(2500));
            slept = true;
        }
        frames(said) >= 200
    });
    let sequences: Vec<u32> = crate::common::frames(said).iter().map(|f| f.sequence).collect();
    assert!(sequences.windows(2).all(|w| w[1] == w[0] + 1), "{sequences:?}");
    // The board's own time goes on while its cable is pulled.
    let mut buffer = [0; 4096];
    let start = Instant::now();
    while matches!(port.read(&mut buffer), Ok(1..)) {
        assert!(start.elapsed() < HANGS);
    }
    let back = pty.wait(None, HANGS).unwrap().or_else(|| pty.path()).unwrap();
    let mut port = open(&back);
    listen(&mut port, |said| frames(said) >= 3);
}

/// The system's pseudo-terminals have no way to tell of a break. A break of the time line is the way to give one.
#[test]
fn a_break_through_the_port_does_nothing_and_one_of_the_time_line_is_counted() {
    for (fault, errors) in [(&[][..], 0), (&["break_to_board@0.2+0.01"], 1)] {
        let pty = pty(fault, PtyOptions::default());
        let mut port = open(&pty.path().unwrap());
        nix::sys::termios::tcsendbreak(&port, 0).unwrap();
        ask(&mut port, &ToBoard::Start, |m| *m == FromBoard::Ack(Command::Start));
        listen(&mut port, |said| frames(said) >= 40);
        port.write_all(&framed(&ToBoard::GetCounters)).unwrap();
        let mut counted = None;
        listen(&mut port, |said| {
            counted = said.iter().find_map(|m| match m {
                FromBoard::Counters(c) => Some(c.receive_errors),
                _ => None,
            });
            counted.is_some()
        });
        assert_eq!(counted, Some(errors));
    }
}

#[test]
fn nothing_is_echoed_to_the_board_while_nobody_sets_the_port_up() {
    let pty = pty(&[], PtyOptions::default());
    let mut port = open(&pty.path().unwrap());
    ask(&mut port, &ToBoard::Start, |m| *m == FromBoard::Ack(Command::Start));
    listen(&mut port, |said| frames(said) >= 20);
    port.write_all(&framed(&ToBoard::GetCounters)).unwrap();
    let said = listen(&mut port, |said| {
        said.iter().any(|m| matches!(m, FromBoard::Counters(_)))
    });
    let counters = said.iter().find_map(|m| match m {
        FromBoard::Counters(c) => Some(c),
        _ => None,
    });
    // An echoed frame would be a command that cannot be read.
    assert_eq!(counters.unwrap().refused, 0);
}

#[test]
fn a_link_follows_the_port_and_goes_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("skin");
    let options = PtyOptions {
        link: Some(link.clone()),
        ..PtyOptions::default()
    };
    // An old link that leads nowhere is replaced.
    std::os::unix::fs::symlink("/dev/pts/none", &link).unwrap();
    let pty = pty(&["cable_pulled@0.4+0.3"], options.clone());
    let path = pty.path().unwrap();
    assert_eq!(fs::read_link(&link).unwrap(), path);
    let mut port = open(&link);
    port.write_all(&framed(&ToBoard::Start)).unwrap();
    // The cable is pulled: the end of the file, or an error; the link is gone; and then it is all back.
    let (start, mut buffer) = (Instant::now(), [0; 4096]);
    while let Ok(n) = port.read(&mut buffer)
        && n > 0
    {
        assert!(start.elapsed() < HANGS);
    }
    let back = loop {
        assert!(start.elapsed() < HANGS);
        match pty.wait(None, Duration::from_millis(50)).unwrap() {
            Some(path) => break path,
            None => assert!(File::open(&link).is_err() || pty.path().is_some()),
        }
    };
    assert_eq!(fs::read_link(&link).unwrap(), back);
    assert!(!matches!(port.read(&mut buffer), Ok(1..)), "what was open stays dead");
    let mut port = open(&link);
    listen(&mut port, |said| frames(said) >= 3);
    drop(pty);
    assert!(fs::symlink_metadata(&link).is_err());

    fs::write(&link, "not ours").unwrap();
    let board = SimBoard::new(SimConfig::default(), FixedSheet(disc(16))).unwrap();
    let error = Pty::start(board, options).err().unwrap();
    assert!(error.to_string().contains("there is a file of this name"), "{error}");
    assert_eq!(fs::read_to_string(&link).unwrap(), "not ours");
}
