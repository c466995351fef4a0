//! A cable that is pulled at random moments, with all that may happen meanwhile.

use crate::session::{LONG, Scripted, board, framed};
use hil_sim::SimPort;
use link::plans::adjacent_plan;
use link::{ConnectionEvent, Link, LinkError, MeasuredFrame, Port, Session};
use protocol::{Counters, FromBoard, Hello};
use std::collections::HashSet;
use std::io::{self, ErrorKind, Read, Write};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// What the cable and what is behind it are up to.
struct World {
    board: SimPort,
    /// How often the board had its power cut.
    epoch: u32,
    /// Number of the port that is open.
    open: u32,
    /// Bytes until the cable is pulled; none: it stays.
    left: Option<usize>,
    /// Bytes of noise before and after the pull.
    noise: usize,
    /// How often the port is not there yet when it is looked for.
    absent: u32,
    power_cut: bool,
    /// Another board's introduction comes first.
    other: Option<Hello>,
    back: Instant,
    random: u64,
}

impl World {
    /// A number below `n` (xorshift).
    fn random(&mut self, n: u64) -> u64 {
        for shift in [(13, true), (7, false), (17, true)] {
            let (by, left) = shift;
            self.random ^= if left { self.random << by } else { self.random >> by };
        }
        self.random % n
    }
}

#[derive(Clone)]
struct Cable {
    world: Arc<Mutex<World>>,
    number: u32,
}

impl Cable {
    fn world(&self) -> io::Result<MutexGuard<'_, World>> {
        let world = self.world.lock().unwrap();
        if world.open == self.number {
            Ok(world)
        } else {
            Err(ErrorKind::BrokenPipe.into())
        }
    }

    fn reopen(&self) -> Result<Box<dyn Port>, String> {
        let mut world = self.world.lock().unwrap();
        if world.absent > 0 {
            world.absent -= 1;
            return Err("not there".to_owned());
        }
        if let Some(hello) = world.other.take() {
            let port = Scripted::default();
            port.says.lock().unwrap().extend(framed(&FromBoard::Hello(hello)));
            return Ok(Box::new(port));
        }
        if world.power_cut {
            world.power_cut = false;
            world.epoch += 1;
            world.board = board(16);
        }
        world.open += 1;
        world.back = Instant::now();
        Ok(Box::new(Self {
            world: Arc::clone(&self.world),
            number: world.open,
        }))
    }
}

impl Read for Cable {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut world = self.world()?;
        if world.noise > 0 {
            let count = world.noise.min(buffer.len());
            world.noise -= count;
            for byte in &mut buffer[..count] {
                *byte = world.random(256) as u8;
            }
            return Ok(count);
        }
        if world.left == Some(0) {
            world.left = None;
            world.open += 1;
            world.noise = if world.random(3) == 0 { 3000 } else { 0 };
            return Err(ErrorKind::BrokenPipe.into());
        }
        let most = world.left.unwrap_or(buffer.len()).min(buffer.len());
        let count = world.board.read(&mut buffer[..most])?;
        world.left = world.left.map(|left| left - count);
        Ok(count)
    }
}

impl Write for Cable {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.world()?.board.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn cable() -> Cable {
    let world = World {
        board: board(16),
        epoch: 0,
        open: 0,
        left: None,
        noise: 0,
        absent: 0,
        power_cut: false,
        other: None,
        back: Instant::now(),
        random: 0x9e37_79b9_7f4a_7c15,
    };
    Cable {
        world: Arc::new(Mutex::new(world)),
        number: 0,
    }
}

fn session(cable: &Cable) -> Session {
    let again = cable.clone();
    let link = Link::reopening(Box::new(cable.clone()), Box::new(move || again.reopen())).unwrap();
    Session::start_on(link, adjacent_plan).unwrap()
}

/// The next frame, and the events before it.
fn next(session: &Session) -> (MeasuredFrame, Vec<ConnectionEvent>) {
    let mut events = Vec::new();
    let end = Instant::now() + LONG;
    while Instant::now() < end {
        let frame = session.frame(Duration::from_millis(100)).unwrap();
        events.extend(std::iter::from_fn(|| session.event()));
        if let Some(frame) = frame {
            return (frame, events);
        }
    }
    panic!("no frame, {events:?}")
}

/// Pulls the cable so often, each time within two frames. After every pull: the connection is told lost once and restored once, frames
/// of the plan flow again, none comes twice, and another board's are nobody's. Longest from the port's return to the board's, s.
fn pulled(times: u32) -> f64 {
    let cable = cable();
    let session = session(&cable);
    let mut seen: HashSet<(u32, u32)> = HashSet::new();
    let mut take = |frame: &MeasuredFrame| {
        let epoch = cable.world.lock().unwrap().epoch;
        assert!(seen.insert((epoch, frame.sequence)), "frame {} twice", frame.sequence);
        assert!(frame.values_v.len() == 208 && frame.values_v.iter().all(|v| *v > 0.0));
    };
    let mut worst_s: f64 = 0.0;
    for k in 0..times {
        let other = {
            let mut world = cable.world.lock().unwrap();
            world.left = Some(world.random(1000) as usize);
            world.absent = world.random(3) as u32;
            world.power_cut = world.random(2) == 0;
            let other = world.random(5) == 0;
            world.other = other.then(|| Hello {
                serial: "another".try_into().unwrap(),
                ..session.hello().clone()
            });
            other
        };
        let mut events = Vec::new();
        let mut after = 0;
        while after < 3 {
            let (frame, told) = next(&session);
            if told.iter().any(|e| matches!(e, ConnectionEvent::Restored { .. })) {
                worst_s = worst_s.max(cable.world.lock().unwrap().back.elapsed().as_secs_f64());
            }
            events.extend(told);
            // Frames that waited when the power was cut are of the time before.
            if session.restored() > k {
                take(&frame);
                after += 1;
            }
        }
        let lost = events.iter().filter(|e| matches!(e, ConnectionEvent::Lost { .. }));
        let restored = events
            .iter()
            .filter(|e| matches!(e, ConnectionEvent::Restored { firmware: None, .. }));
        let others = events
            .iter()
            .filter(|e| matches!(e, ConnectionEvent::OtherBoard { .. }));
        let counts = (lost.count(), restored.count(), others.count());
        assert_eq!(counts, (1, 1, usize::from(other)), "{k}: {events:?}");
        assert_eq!(session.restored(), k + 1);
    }
    worst_s
}

#[test]
fn after_every_pull_frames_flow_again_and_none_comes_twice() {
    pulled(25);
}

/// The figure of docs/reliability.md.
#[test]
#[ignore = "minutes"]
fn pulled_1000_times() {
    println!("longest from the port's return to the board's: {:.2} s", pulled(1000));
}

#[test]
fn a_port_that_brings_nothing_or_noise_is_opened_again() {
    for noise in [0, usize::MAX] {
        let cable = cable();
        let session = session(&cable);
        next(&session);
        let before = {
            let mut world = cable.world.lock().unwrap();
            world.noise = noise;
            world.open
        };
        if noise == 0 {
            // A line that is open and silent.
            cable.world.lock().unwrap().board.write_all(&stop()).unwrap();
        }
        let mut told = Vec::new();
        let end = Instant::now() + LONG;
        while told.is_empty() && Instant::now() < end {
            // More than the time from frame to frame, in listening time.
            session.check_silence(Duration::from_millis(300)).unwrap();
            session.frame(Duration::from_millis(20)).unwrap();
            told.extend(session.event());
        }
        let Some(ConnectionEvent::Lost { why }) = told.first() else {
            panic!("{told:?}")
        };
        assert_eq!(why.contains("bytes came"), noise > 0, "{why}");
        cable.world.lock().unwrap().noise = 0;
        let (_, events) = next(&session);
        assert!(matches!(events[..], [ConnectionEvent::Restored { .. }]), "{events:?}");
        assert!(cable.world.lock().unwrap().open > before);
    }
}

fn stop() -> Vec<u8> {
    let stop = protocol::ToBoard::Stop;
    protocol::encode(&stop, &mut [0; protocol::MAX_TO_BOARD_LEN])
        .unwrap()
        .to_vec()
}

/// What a session had is what the board has again after a power cut, and not what it has at power-up.
#[test]
fn plan_and_amplitude_are_those_before() {
    let cable = cable();
    let mut link = Link::open(Box::new(cable.clone())).unwrap();
    let change = link::settings::Change {
        excitation_permille: Some(500),
        ..Default::default()
    };
    link::settings::change(&link, &change).unwrap();
    link.leave_running();
    drop(link);
    let session = session(&cable);
    let mean = |f: &MeasuredFrame| f.values_v.iter().sum::<f64>() / 208.0;
    let before = mean(&next(&session).0);
    for _ in 0..3 {
        let mut world = cable.world.lock().unwrap();
        (world.left, world.power_cut) = (Some(700), true);
        drop(world);
        while session.restored() == 0 {
            next(&session);
        }
        let after = mean(&next(&session).0);
        assert!((after / before - 1.0).abs() < 0.02, "{before} V, then {after} V");
    }
}

#[test]
fn other_firmware_is_told_and_a_board_that_measures_in_another_way_ends_it() {
    let firmware = |session: &Session| Hello {
        firmware: "9.9".try_into().unwrap(),
        ..session.hello().clone()
    };
    let changed = |session: &Session| Hello {
        electrodes: 8,
        ..session.hello().clone()
    };
    for (is_other_firmware, hello) in [(true, firmware as fn(&Session) -> Hello), (false, changed)] {
        let cable = cable();
        let session = session(&cable);
        next(&session);
        let said = [
            FromBoard::Hello(hello(&session)),
            FromBoard::Plan(session.plan().clone()),
            FromBoard::Counters(Counters::default()),
        ];
        let mut says = Vec::new();
        said.iter().for_each(|m| says.extend(framed(m)));
        let port = Scripted::default();
        port.says.lock().unwrap().extend(says);
        let link = Link::reopening(
            Box::new(cable.clone()),
            Box::new(move || Ok(Box::new(port.clone()) as Box<dyn Port>)),
        );
        drop(session);
        let session = Session::start_on(link.unwrap(), adjacent_plan).unwrap();
        cable.world.lock().unwrap().left = Some(500);
        let end = Instant::now() + LONG;
        let mut events = Vec::new();
        let outcome = loop {
            let frame = session.frame(Duration::from_millis(50));
            events.extend(std::iter::from_fn(|| session.event()));
            if frame.is_err() || events.len() == 2 || Instant::now() > end {
                break frame;
            }
        };
        if is_other_firmware {
            let Some(ConnectionEvent::Restored { firmware, .. }) = events.last() else {
                panic!("{events:?}")
            };
            assert_eq!(firmware.as_deref(), Some("9.9"));
        } else {
            assert_eq!(outcome.err(), Some(LinkError::Changed));
        }
    }
}
