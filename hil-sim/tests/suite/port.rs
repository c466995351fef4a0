//! The port as a program sees it.

use crate::common::{are_apart, disc, framed, frames, messages};
use hil_sim::{FixedSheet, PERIOD_SAMPLES, Pace, SimBoard, SimConfig, SimPort, seconds};
use protocol::{Command, FromBoard, ToBoard};
use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

fn port(pace: Pace) -> SimPort {
    let board = SimBoard::new(SimConfig::default(), FixedSheet(disc(16))).unwrap();
    SimPort::new(board, pace).unwrap()
}

/// Reads until nothing comes for a time-out, at most `limit` bytes. With the clock use [`read_until`]: there a time-out may
/// only mean that the machine is busy.
fn read(port: &mut SimPort, limit: usize) -> Vec<u8> {
    let mut out = Vec::new();
    let mut buffer = [0; 300];
    while out.len() < limit {
        let result = port.read(&mut buffer);
        if result.as_ref().is_err_and(|e| e.kind() == ErrorKind::TimedOut) {
            break;
        }
        out.extend(&buffer[..result.unwrap()]);
    }
    out
}

/// No test ends by the clock unless something hangs.
const HANGS: Duration = Duration::from_secs(120);

/// Reads until the bytes are enough, however long the machine takes.
fn read_until(port: &mut SimPort, mut enough: impl FnMut(&[u8]) -> bool) -> Vec<u8> {
    let start = Instant::now();
    let mut out = Vec::new();
    let mut buffer = [0; 4096];
    while !enough(&out) {
        assert!(start.elapsed() < HANGS, "the port hangs after {} bytes", out.len());
        match port.read(&mut buffer) {
            Ok(n) => out.extend(&buffer[..n]),
            // On a busy machine the board's time goes on more slowly than the wait.
            Err(e) => assert!(matches!(e.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted), "{e}"),
        }
    }
    out
}

/// The messages in whole frames of a stream.
fn whole(bytes: &[u8]) -> Vec<FromBoard> {
    let end = bytes.iter().rposition(|b| *b == 0).map_or(0, |k| k + 1);
    messages(&bytes[..end])
}

#[test]
fn without_pace_the_same_commands_give_the_same_bytes_however_they_are_read() {
    let run = |piece: usize, wait: bool| {
        let mut port = port(Pace::Unpaced);
        let hello = read(&mut port, usize::MAX);
        port.write_all(&framed(&ToBoard::GetPlan)).unwrap();
        let plan = read(&mut port, usize::MAX);
        if wait {
            // A slow program: idle time does not count.
            std::thread::sleep(Duration::from_millis(20));
            assert!(read(&mut port, usize::MAX).is_empty());
        }
        port.write_all(&framed(&ToBoard::Start)).unwrap();
        let mut stream = Vec::new();
        let mut buffer = vec![0; piece];
        while stream.len() < 50_000 {
            let n = port.read(&mut buffer).unwrap();
            stream.extend(&buffer[..n]);
        }
        stream.truncate(50_000);
        [hello, plan, stream].concat()
    };
    let (a, b) = (run(7, false), run(4096, true));
    assert!(a == b);
    let end = a.iter().rposition(|b| *b == 0).unwrap();
    assert!(frames(messages(&a[..=end])).len() > 100);
}

#[test]
fn without_pace_time_passes_in_reads_only() {
    let mut port = port(Pace::Unpaced);
    port.write_all(&framed(&ToBoard::Start)).unwrap();
    // Four seconds of simulated time, with a pause in which none passes.
    let mut bytes = read(&mut port, 100_000);
    std::thread::sleep(Duration::from_millis(50));
    bytes.extend(read(&mut port, 100_000));
    let list = frames(whole(&bytes));
    let each = list[1].time - list[0].time;
    assert!(list.len() > 400, "{}", list.len());
    assert!(list.windows(2).all(|w| w[1].sequence == w[0].sequence + 1));
    assert_eq!(are_apart(list.iter().map(|f| f.time), each), 3);
}

#[test]
fn an_idle_port_times_out() {
    for pace in [Pace::Unpaced, Pace::RealTime] {
        let mut port = port(pace);
        port.set_timeout(Duration::from_millis(30));
        let hello = whole(&read_until(&mut port, |bytes| !whole(bytes).is_empty()));
        assert!(matches!(&hello[..], [FromBoard::Hello(_)]), "{hello:?}");
        let error = port.read(&mut [0; 10]).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::TimedOut);
        assert_eq!(port.read(&mut []).unwrap(), 0);
    }
}

#[test]
fn with_the_clock_frames_never_come_too_early() {
    let mut port = port(Pace::RealTime);
    let start = Instant::now();
    port.write_all(&framed(&ToBoard::Start)).unwrap();
    let bytes = read_until(&mut port, |bytes| frames(whole(bytes)).len() >= 60);
    let elapsed_s = start.elapsed().as_secs_f64();
    let said = whole(&bytes);
    assert!(said.contains(&FromBoard::Ack(Command::Start)));
    // On a busy machine they come late, and some are left out; but none before its time. The board was powered up a moment
    // before the clock here was read.
    let list = frames(said);
    let span_s = seconds(list[list.len() - 1].time - list[0].time);
    assert!(span_s <= elapsed_s + 0.02, "{span_s} s of frames in {elapsed_s} s");
    assert!(span_s >= 59.0 * 32.0 * seconds(PERIOD_SAMPLES) - 1e-9, "{span_s}");
}

#[test]
fn clones_are_the_same_port_and_can_be_used_from_two_threads() {
    for pace in [Pace::Unpaced, Pace::RealTime] {
        let mut port = port(pace);
        let mut reader = port.clone();
        let thread = std::thread::spawn(move || read_until(&mut reader, |bytes| bytes.len() >= 5000));
        std::thread::sleep(Duration::from_millis(20));
        port.write_all(&framed(&ToBoard::Start)).unwrap();
        port.flush().unwrap();
        assert!(thread.join().unwrap().len() >= 5000);
    }
}

#[test]
fn dropping_it_ends_its_thread_whatever_it_is_doing() {
    for k in 0..20 {
        let mut port = port(Pace::RealTime);
        port.write_all(&framed(&ToBoard::Start)).unwrap();
        std::thread::sleep(Duration::from_millis(k));
        // Returns: a thread that did not end would be waited for.
        drop(port);
    }
}
