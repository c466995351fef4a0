//! A day's recording: of a board that says in minutes what a board says in a day.

use crate::program::{Started, program, said, text};
use hil_sim::{Pace, SceneFile, SimPort};
use protocol::{Decoder, Frame, FromBoard, MAX_FROM_BOARD_LEN, Outgoing, encode};
use serde_json::Value;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::Command;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// A day of 115.7 frames a second.
const FRAMES: u32 = 10_000_000;
/// At most so many are sent in a second of this machine.
const RATE: u32 = 2_000;
/// Of the simulated board; then they are sent over and over, with numbers and times that go on.
const SIMULATED: usize = 2_300;

/// Answers as a simulated board does, and sends its frames.
fn simulated(stream: &mut TcpStream) -> io::Result<Vec<Frame>> {
    let scene = SceneFile::demo(forward::Sheet::paper());
    let mut board = SimPort::new(scene.board().unwrap(), Pace::Unpaced)?;
    let mut decoder = Decoder::<MAX_FROM_BOARD_LEN>::new();
    let (mut frames, mut buffer) = (Vec::new(), [0; 4096]);
    stream.set_read_timeout(Some(Duration::from_millis(1)))?;
    for turn in 0_u64.. {
        let idle = match board.read(&mut buffer) {
            Ok(n) => {
                decoder.push(&buffer[..n], |message: Result<FromBoard, _>| {
                    if let Ok(FromBoard::Frame(frame)) = message {
                        frames.push(frame);
                    }
                });
                stream.write_all(&buffer[..n])?;
                false
            }
            Err(e) if e.kind() == ErrorKind::TimedOut => true,
            Err(e) => return Err(e),
        };
        if frames.len() >= SIMULATED {
            break;
        }
        // To look for a command takes milliseconds.
        if idle || turn % 64 == 0 {
            match stream.read(&mut buffer) {
                Ok(n) => board.write_all(&buffer[..n])?,
                Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Err(e) => return Err(e),
            }
        }
    }
    Ok(frames)
}

/// Goes on with these frames until there were all.
fn repeated(stream: &mut TcpStream, mut frames: Vec<Frame>) -> io::Result<()> {
    let mut last = frames.last().unwrap().clone();
    let period = last.time - frames[frames.len() - 2].time;
    // The last of them may have been cut off.
    let mut bytes = vec![0];
    let mut buffer = [0; MAX_FROM_BOARD_LEN];
    let each = RATE / 100;
    let mut of = 0;
    while last.sequence + 1 < FRAMES {
        let began = Instant::now();
        for _ in 0..each.min(FRAMES - 1 - last.sequence) {
            let frame = &mut frames[of];
            (frame.sequence, frame.time) = (last.sequence + 1, last.time + period);
            (last.sequence, last.time) = (frame.sequence, frame.time);
            bytes.extend_from_slice(encode(&Outgoing::Frame((&*frame).into()), &mut buffer).unwrap());
            of = (of + 1) % SIMULATED;
        }
        stream.write_all(&bytes)?;
        bytes.clear();
        std::thread::sleep(Duration::from_millis(10).saturating_sub(began.elapsed()));
    }
    Ok(())
}

/// Memory of a program now and at most so far, MB.
fn memory_mb(id: u32) -> (u64, u64) {
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap_or_default();
    let of = |name: &str| {
        let line = status.lines().find(|l| l.starts_with(name));
        let kb = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<u64>().ok());
        kb.unwrap_or(0) / 1024
    };
    (of("VmRSS"), of("VmHWM"))
}

/// `cargo test -p host --test suite -- --ignored a_day_is_recorded --nocapture`
#[test]
#[ignore = "a measurement of an hour and a half, 7 GB"]
fn a_day_is_recorded_in_bounded_memory() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("day.mcap");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp://{}", listener.local_addr().unwrap());
    let (all_sent, sent) = channel();
    std::thread::spawn(move || {
        let mut stream = listener.accept().unwrap().0;
        let frames = simulated(&mut stream).unwrap();
        repeated(&mut stream, frames).unwrap();
        all_sent.send(()).unwrap();
        // The connection stays until the program ends.
        let _ = io::copy(&mut stream, &mut io::sink());
    });
    let started = Instant::now();
    let mut recorder = Started::new(&mut program(&["record", text(&file), "--port", &address]));
    let id = recorder.0.id();
    let mut curve = Vec::new();
    while let Err(waiting) = sent.recv_timeout(Duration::from_secs(20)) {
        // A board that is kept from the processor for three seconds is given up.
        assert_eq!(waiting, RecvTimeoutError::Timeout, "the board ended");
        assert!(recorder.0.try_wait().unwrap().is_none(), "it ended");
        curve.push(memory_mb(id).0);
        println!(
            "{:5} s: {} MB of memory, a file of {} MB",
            started.elapsed().as_secs(),
            memory_mb(id).0,
            std::fs::metadata(&file).map_or(0, |m| m.len() / 1_000_000)
        );
    }
    let (_, most_mb) = memory_mb(id);
    let interrupted = Command::new("kill").args(["-INT", &id.to_string()]).status();
    assert!(interrupted.unwrap().success());
    let closing = Instant::now();
    assert!(recorder.0.wait().unwrap().success());
    println!(
        "{FRAMES} frames in {} s; {most_mb} MB at most; closed in {:.1} s",
        started.elapsed().as_secs(),
        closing.elapsed().as_secs_f64()
    );
    let started = Instant::now();
    let info = program(&["info", text(&file), "--json"]).output().unwrap();
    assert!(info.status.success(), "{}", said(&info));
    let info: Value = serde_json::from_slice(&info.stdout).unwrap();
    println!("info: {:.0} s; {info}", started.elapsed().as_secs_f64());
    let count = |key: &str| info[key].as_u64().unwrap();
    // The last one has no number, and what is sent while the program ends is not asked for.
    let kept = count("frames") + count("lost_frames");
    assert!((kept as i64 - i64::from(FRAMES)).abs() <= 2, "{kept}");
    assert_eq!((count("lost_messages"), count("lost_bytes")), (0, 0));
    // The index has a line for every chunk; all else stays as it was after the first tenth.
    let after_a_tenth = curve[curve.len() / 10];
    assert!(most_mb < after_a_tenth + 200, "{after_a_tenth} MB, later {most_mb} MB");
}
