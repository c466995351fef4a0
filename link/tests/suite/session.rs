//! Link and session against boards that misbehave. The boards are simulated ones without pace, so that a slow machine only
//! takes longer.

use forward::{ElectrodeMatrix, Pattern};
use hil_sim::{FixedSheet, Pace, SimBoard, SimConfig, SimPort};
use link::plans::adjacent_plan;
use link::{Link, LinkError, LinkNotices, MeasuredFrame, Session};
use nalgebra::DMatrix;
use protocol::{Hello, Plan, Sampling, Version};
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Long enough on any machine.
pub(crate) const LONG: Duration = Duration::from_secs(60);

/// A disc with small electrodes on its rim: potentials fall with the logarithm of the distance.
pub(crate) fn board(electrodes: usize) -> SimPort {
    let matrix = DMatrix::from_fn(electrodes, electrodes, |i, j| {
        let half = std::f64::consts::PI * (i as f64 - j as f64) / electrodes as f64;
        let distance_mm = if i == j { 2.5 } else { 195.0 * half.sin().abs() };
        -1000.0 / std::f64::consts::PI * distance_mm.ln()
    });
    let sheet = FixedSheet(ElectrodeMatrix::from_potentials(matrix));
    let board = SimBoard::new(SimConfig::default(), sheet).unwrap();
    SimPort::new(board, Pace::Unpaced).unwrap()
}

/// A simulated board, and another one that takes its place after a number of bytes.
struct Replaced {
    now: SimPort,
    then: Option<SimPort>,
    bytes_left: usize,
}

impl Read for Replaced {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.bytes_left == 0
            && let Some(then) = self.then.take()
        {
            self.now = then;
        }
        let most = match &self.then {
            Some(_) => buffer.len().min(self.bytes_left),
            None => buffer.len(),
        };
        let count = self.now.read(&mut buffer[..most])?;
        self.bytes_left = self.bytes_left.saturating_sub(count);
        Ok(count)
    }
}

impl Write for Replaced {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.now.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Frames until one satisfies, or the board fails.
fn until(session: &Session, mut enough: impl FnMut(&MeasuredFrame) -> bool) -> Result<Vec<MeasuredFrame>, LinkError> {
    let mut out = Vec::new();
    loop {
        if let Some(frame) = session.frame(Duration::from_millis(200))? {
            let last = enough(&frame);
            out.push(frame);
            if last {
                return Ok(out);
            }
        }
    }
}

#[test]
fn a_board_that_is_reset_in_the_middle_of_a_frame_goes_on_by_the_same_plan() {
    let port = Replaced {
        now: board(16),
        then: Some(board(16)),
        bytes_left: 30_100,
    };
    let session = Session::start(Box::new(port), adjacent_plan).unwrap();
    let mut last = None;
    let mut after = 0;
    let frames = until(&session, |f| {
        after += u32::from(after > 0 || last.is_some_and(|l| f.sequence < l));
        last = Some(f.sequence);
        after == 5
    })
    .unwrap();
    let tail = &frames[frames.len() - 5..];
    for pair in tail.windows(2) {
        assert_eq!(pair[1].sequence, pair[0].sequence + 1);
        // 112 periods of 271.4 us: the plan that was asked for, not the board's own.
        assert!((pair[1].time_s - pair[0].time_s - 0.0304).abs() < 1e-4, "{pair:?}");
    }
    assert!(
        frames
            .iter()
            .all(|f| f.values_v.len() == 208 && f.values_v.iter().all(|v| *v > 0.0))
    );
    // Not counted as four thousand million lost frames.
    assert!(session.link().counters().lost_frames < 50);
}

#[test]
fn another_board_in_its_place_is_an_error() {
    let port = Replaced {
        now: board(16),
        then: Some(board(8)),
        bytes_left: 20_000,
    };
    let session = Session::start(Box::new(port), adjacent_plan).unwrap();
    let error = until(&session, |_| false).unwrap_err();
    assert!(error.to_string().contains("another board"), "{error}");
}

#[test]
fn the_plan_follows_the_boards_electrodes() {
    for (electrodes, values) in [(4, 4), (8, 40), (16, 208), (32, 256)] {
        let session = Session::start(Box::new(board(electrodes)), adjacent_plan).unwrap();
        assert_eq!(
            Pattern::from_pairs(session.electrodes(), session.measurements())
                .unwrap()
                .electrodes(),
            electrodes
        );
        let frame = session.frame(LONG).unwrap().unwrap();
        assert_eq!(frame.values_v.len(), values);
    }
    let hello = |electrodes, channels| {
        let session = Session::start(Box::new(board(16)), adjacent_plan).unwrap();
        let mut hello: Hello = session.hello().clone();
        hello.electrodes = electrodes;
        hello.limits.channels = channels;
        hello
    };
    assert_eq!(adjacent_plan(&hello(16, 1)).unwrap().sampling, Sampling::Sequential);
    for electrodes in [0, 3, 33] {
        let error = LinkError::from(adjacent_plan(&hello(electrodes, 32)).unwrap_err());
        assert!(
            error.to_string().starts_with("no scan plan suits this board: it has"),
            "{error}"
        );
    }
}

#[test]
fn a_refusal_is_told_once_in_the_boards_words() {
    let silly = |_: &Hello| {
        Ok(Plan {
            integrate_periods: 0,
            ..Plan::fast()
        })
    };
    let error = Session::start(Box::new(board(16)), silly).err().unwrap();
    assert_eq!(
        error.to_string(),
        "the board refused the plan: it integrates 0 periods; the board can do 1 to 65535"
    );
}

/// A port with a script: what it says, and whether it is gone after that or falls silent.
#[derive(Clone, Default)]
pub(crate) struct Scripted {
    pub(crate) says: Arc<Mutex<VecDeque<u8>>>,
    heard: Arc<Mutex<Vec<u8>>>,
    gone: Arc<AtomicBool>,
}

impl Read for Scripted {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut says = self.says.lock().unwrap();
        if says.is_empty() {
            if self.gone.load(Ordering::Relaxed) {
                return Err(ErrorKind::BrokenPipe.into());
            }
            std::thread::sleep(Duration::from_millis(1));
            return Err(ErrorKind::TimedOut.into());
        }
        says.read(buffer)
    }
}

impl Write for Scripted {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.heard.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

pub(crate) fn framed(message: &protocol::FromBoard) -> Vec<u8> {
    protocol::encode(message, &mut [0; protocol::MAX_FROM_BOARD_LEN])
        .unwrap()
        .to_vec()
}

fn frame(sequence: u32) -> Vec<u8> {
    framed(&protocol::FromBoard::Frame(protocol::Frame {
        sequence,
        ..protocol::Frame::default()
    }))
}

#[test]
fn lost_frames_are_counted_across_the_end_of_the_sequence_and_not_across_a_reset() {
    let port = Scripted::default();
    // Two lost, one lost at the wrap, a reset, three lost.
    for sequence in [u32::MAX - 4, u32::MAX - 1, 0, 1, 0, 4] {
        port.says.lock().unwrap().extend(frame(sequence));
    }
    port.gone.store(true, Ordering::Relaxed);
    let link = Link::open(Box::new(port)).unwrap();
    for _ in 0..6 {
        assert!(link.receive(LONG).unwrap().is_some());
    }
    // The account is complete once the port's end is reported.
    assert!(matches!(link.receive(LONG), Err(LinkError::Lost(_))));
    let counters = link.counters();
    assert_eq!((counters.frames, counters.lost_frames), (6, 2 + 1 + 3));
}

#[test]
fn a_port_that_disappears_is_an_error_and_stays_one() {
    let port = Scripted::default();
    port.gone.store(true, Ordering::Relaxed);
    let link = Link::open(Box::new(port)).unwrap();
    for _ in 0..3 {
        assert!(matches!(link.receive(LONG), Err(LinkError::Lost(_))));
    }
}

#[test]
fn dropping_a_link_that_nobody_listened_to_stops_the_board() {
    let port = Scripted::default();
    // Far more than the link holds for a slow program.
    for sequence in 0..2000 {
        port.says.lock().unwrap().extend(frame(sequence));
    }
    let link = Link::open(Box::new(port.clone())).unwrap();
    assert!(link.receive(LONG).unwrap().is_some());
    drop(link);
    let stop = protocol::encode(&protocol::ToBoard::Stop, &mut [0; protocol::MAX_TO_BOARD_LEN])
        .unwrap()
        .to_vec();
    assert!(port.heard.lock().unwrap().ends_with(&stop));
    // The port is closed: only this clone is left.
    assert_eq!(Arc::strong_count(&port.heard), 1);
}

#[test]
fn a_program_that_is_too_slow_takes_the_newest_frame_and_the_port_is_read_all_the_time() {
    const FRAMES: u32 = 3000;
    let port = Scripted::default();
    for sequence in 0..FRAMES {
        let frame = protocol::Frame {
            sequence,
            time: 100 * u64::from(sequence),
            ..protocol::Frame::default()
        };
        port.says
            .lock()
            .unwrap()
            .extend(framed(&protocol::FromBoard::Frame(frame)));
    }
    let link = Link::open(Box::new(port)).unwrap();
    link.skip_over(1000);
    // The program is busy for as long as all of them take to arrive.
    while link.counters().frames < u64::from(FRAMES) {
        std::thread::sleep(Duration::from_millis(1));
    }
    let Some(protocol::FromBoard::Frame(frame)) = link.receive(LONG).unwrap() else {
        panic!("no frame")
    };
    assert_eq!(frame.sequence, FRAMES - 1);
    let counters = link.counters();
    assert_eq!(
        (counters.skipped_frames, counters.lost_frames),
        (u64::from(FRAMES) - 1, 0)
    );
}

/// A port with bytes that have waited, and others that come a few at a time.
struct Waited {
    waited: VecDeque<u8>,
    later: VecDeque<u8>,
}

impl Read for Waited {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if !self.waited.is_empty() {
            return self.waited.read(buffer);
        }
        if self.later.is_empty() {
            std::thread::sleep(Duration::from_millis(1));
            return Err(ErrorKind::TimedOut.into());
        }
        let most = buffer.len().min(50);
        self.later.read(&mut buffer[..most])
    }
}

impl Write for Waited {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// What a session tells of a port whose bytes were cut off between two frames, taken by a program that comes so late.
fn told_of_a_cut(pause: Duration) -> Vec<String> {
    const BEFORE: u32 = 500;
    let values = protocol::Frame {
        values: std::iter::repeat_n(protocol::Value::new(1000), 208).collect(),
        ..protocol::Frame::default()
    };
    let whole = |sequence| {
        framed(&protocol::FromBoard::Frame(protocol::Frame {
            sequence,
            ..values.clone()
        }))
    };
    let mut waited: Vec<u8> = (0..BEFORE).flat_map(whole).collect();
    waited.extend(&whole(BEFORE)[..100]);
    let later: Vec<u8> = (2000..2050).flat_map(whole).collect();
    let link = Link::open(Box::new(Waited {
        waited: waited.into(),
        later: later.into(),
    }))
    .unwrap();
    // The link keeps fewer frames than come before the cut.
    while !link.was_full() {
        std::thread::sleep(Duration::from_millis(1));
    }
    std::thread::sleep(pause);
    let mut notices = LinkNotices::default();
    let mut said = Vec::new();
    loop {
        let Some(protocol::FromBoard::Frame(frame)) = link.receive(LONG).unwrap() else {
            panic!("no frame")
        };
        let measured = MeasuredFrame {
            sequence: frame.sequence,
            time_s: 0.01 * f64::from(frame.sequence),
            values_v: Vec::new(),
        };
        said.extend(
            notices
                .take(&link.counters(), Some(&measured))
                .map(|notice| notice.to_string()),
        );
        if frame.sequence == 2049 {
            return said;
        }
    }
}

#[test]
fn a_program_that_reads_too_late_is_told_so_and_not_of_its_cable() {
    // More than any read waits.
    let said = told_of_a_cut(Duration::from_millis(300));
    assert_eq!(
        said,
        [
            "1501 of 1502 frames are lost: they were read too late; this computer is too busy, or the program takes frames too slowly"
        ]
    );
}

#[test]
fn silence_and_another_protocol_are_told_apart() {
    let silent = Session::start(Box::new(Scripted::default()), adjacent_plan)
        .err()
        .unwrap();
    assert!(
        matches!(silent, LinkError::Silent { what: "a greeting", .. }),
        "{silent}"
    );

    let session = Session::start(Box::new(board(16)), adjacent_plan).unwrap();
    let mut hello = session.hello().clone();
    hello.version = Version { major: 9, minor: 0 };
    let port = Scripted::default();
    port.says
        .lock()
        .unwrap()
        .extend(framed(&protocol::FromBoard::Hello(hello)));
    let other = Session::start(Box::new(port), adjacent_plan).err().unwrap();
    assert_eq!(other, LinkError::Version { board: 9, ours: 2 });

    // An introduction of version 1, whose fields after the version are others.
    let old = "0102012d03302e3101620137101080fa8628910b0ca0b5c90190aa89010288a401bc0520800210e807ffff0362328a0900";
    let bytes = (0..old.len() / 2).map(|k| u8::from_str_radix(&old[2 * k..2 * k + 2], 16).unwrap());
    let port = Scripted::default();
    port.says.lock().unwrap().extend(bytes);
    let other = Session::start(Box::new(port), adjacent_plan).err().unwrap();
    assert_eq!(other, LinkError::Version { board: 1, ours: 2 });
}
