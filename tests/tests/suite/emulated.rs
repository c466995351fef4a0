//! The firmware as a Cortex-M4F program on QEMU (`boards/qemu-mps2`), with the simulated skin on its front end.
//! These tests need QEMU and the board's programs: `tests/boards.sh` builds them and runs this.

use forward::Sheet;
use hil_sim::{Clock, Electronics, Pace, Rubber, Scene, SimBoard, SimConfig, SimFrontEnd, SimPort, Touch};
use link::{Link, Port, greet, ports};
use protocol::{Frame, FromBoard, Pair, Plan, ToBoard};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// The other end of the board's pipes: calls of the front end's traits, as `qemu-mps2/src/front_end.rs` words them.
fn serve(mut front: SimFrontEnd<Rubber>, clock: &Clock, mut request: File, mut reply: File) {
    use firmware::{Capture, Error, Excitation, Route, Router, Sense, Window};
    let mut call = [0; 8];
    while request.read_exact(&mut call).is_ok() {
        let [op, a, b, c, d, e, f, _] = call;
        let pair = |plus, minus| Pair { plus, minus };
        let mut samples = Vec::new();
        let mut head = vec![0; 16];
        let outcome = match op {
            b'A' => front.set_amplitude(u16::from_le_bytes([a, b])),
            b'E' if a == 1 => front.switch_on(),
            b'E' => front.switch_off(),
            b'R' => front.select(&Route {
                drive: pair(a, b),
                sense: match c {
                    1 => Sense::All { step: d },
                    2 => Sense::Source,
                    _ => Sense::One(pair(d, e)),
                },
                gain: f,
            }),
            b'W' => front.begin(Window {
                channels: a,
                settle_quarters: u16::from_le_bytes([b, c]),
                periods: u16::from_le_bytes([d, e]),
            }),
            b'S' => {
                clock.advance(16 * 100);
                Ok(())
            }
            b'B' => {
                let mut polls = 0;
                loop {
                    let polled = front.poll_block(|block| {
                        head[1] = block.channels;
                        head[2..4].copy_from_slice(&(block.samples.len() as u16).to_le_bytes());
                        head[4..8].copy_from_slice(&block.sequence.to_le_bytes());
                        head[8..16].copy_from_slice(&block.time.to_le_bytes());
                        samples.extend(block.samples.iter().flat_map(|s| s.to_le_bytes()));
                    });
                    polls += 1;
                    match polled {
                        Err(nb::Error::WouldBlock) if polls < 64 => {}
                        Err(nb::Error::Other(e)) => break Err(e),
                        Ok(()) | Err(nb::Error::WouldBlock) => break Ok(()),
                    }
                }
            }
            _ => panic!("unknown request {call:?}"),
        };
        head[0] = match outcome.map_err(|e| e.kind()) {
            Ok(()) => b'+',
            Err(firmware::ErrorKind::Overrun) => b'O',
            Err(firmware::ErrorKind::Route) => b'R',
            Err(_) => b'?',
        };
        head.extend(samples);
        if reply.write_all(&head).is_err() {
            return;
        }
    }
}

/// A running machine, ended when dropped.
struct Machine {
    qemu: Child,
    /// Path of its serial line.
    serial: String,
    directory: tempfile::TempDir,
}

impl Drop for Machine {
    fn drop(&mut self) {
        let _ = self.qemu.kill();
        let _ = self.qemu.wait();
    }
}

fn program(name: &str) -> PathBuf {
    let folder = std::env::var_os("SKIN_QEMU_PROGRAMS").expect("SKIN_QEMU_PROGRAMS: run tests/boards.sh");
    Path::new(&folder).join(name)
}

impl Machine {
    /// Starts a program on a simulated skin whose time begins at `samples`.
    fn start(name: &str, scene: Scene, samples: u64) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let path = |name| directory.path().join(name);
        let (request, reply) = (path("front-end.request"), path("front-end.reply"));
        for pipe in [&request, &reply] {
            assert!(Command::new("mkfifo").arg(pipe).status().unwrap().success());
        }
        let mut qemu = Command::new("qemu-system-arm")
            .args(["-M", "mps2-an386", "-display", "none", "-monitor", "none"])
            .args(["-semihosting-config", "enable=on,target=native"])
            .args(["-chardev", "pty,id=line", "-serial", "chardev:line", "-kernel"])
            .arg(program(name))
            .current_dir(directory.path())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let clock = Clock::new();
        clock.advance(samples);
        // Ends with the machine, whose end of the pipes is then closed.
        std::thread::spawn(move || {
            let rubber = Rubber::new(&Sheet::paper(), scene).unwrap();
            let front = SimFrontEnd::new(Electronics::default(), rubber, clock.clone())
                .unwrap()
                .self_clocked();
            // In the board's order: opening a pipe waits for its other end.
            let request = File::open(request).unwrap();
            let reply = File::options().write(true).open(reply).unwrap();
            serve(front, &clock, request, reply);
        });
        // "char device redirected to /dev/pts/3 (label line)"
        let mut line = String::new();
        BufReader::new(qemu.stdout.as_mut().unwrap())
            .read_line(&mut line)
            .unwrap();
        let serial = line.split_whitespace().find(|w| w.starts_with("/dev/")).expect(&line);
        Self {
            serial: serial.to_owned(),
            qemu,
            directory,
        }
    }
}

/// The first frames that a board sends, by a plan.
fn frames(port: Box<dyn Port>, plan: &Plan, count: usize) -> Vec<Frame> {
    let link = Link::open(port).unwrap();
    greet(&link).unwrap();
    link.ask("a plan", ToBoard::SetPlan(plan.clone()), Duration::from_secs(10), |m| {
        matches!(m, FromBoard::Plan(_)).then_some(())
    })
    .unwrap();
    link.send(ToBoard::Start);
    let mut out = Vec::new();
    while out.len() < count {
        match link
            .receive(Duration::from_secs(60))
            .unwrap()
            .expect("the board went silent")
        {
            FromBoard::Frame(frame) => out.push(frame),
            FromBoard::Error(e) => panic!("{e}"),
            _ => {}
        }
    }
    assert_eq!(link.counters().lost_frames, 0);
    out
}

fn pressed() -> Scene {
    Scene::still(vec![Touch::tip(30.0, -20.0, 25.0)])
}

#[test]
#[ignore = "needs QEMU and the board's programs: run tests/boards.sh"]
fn the_target_measures_what_the_pc_measures_to_the_last_bit() {
    for plan in [Plan::fast(), Plan::paper()] {
        let rubber = Rubber::new(&Sheet::paper(), pressed()).unwrap();
        let board = SimBoard::new(SimConfig::default(), rubber).unwrap();
        let port = SimPort::new(board, Pace::Unpaced).unwrap();
        let here = frames(Box::new(port), &plan, 3);
        // The noise is a function of time, so both must begin at the same: a start at 0 tells how long the start takes.
        let from_zero = {
            let machine = Machine::start("board", pressed(), 0);
            frames(ports::open(&machine.serial).unwrap(), &plan, 1)[0].time
        };
        let start = here[0].time - from_zero;
        let machine = Machine::start("board", pressed(), start);
        let there = frames(ports::open(&machine.serial).unwrap(), &plan, 3);
        for (a, b) in here.iter().zip(&there) {
            assert_eq!(a.values.len(), 208);
            assert_eq!(a, b);
        }
    }
}

#[test]
#[ignore = "needs QEMU and the board's programs: run tests/boards.sh"]
fn the_front_end_keeps_its_duties_on_the_target() {
    let mut machine = Machine::start("laws", Scene::empty(), 0);
    let mut said = String::new();
    machine.qemu.stdout.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(machine.qemu.wait().unwrap().success(), "{said}");
}

#[test]
#[ignore = "needs QEMU, the board's programs and SKIN_PROGRAM: run tests/boards.sh"]
fn the_host_program_shows_the_touches_of_the_emulated_board() {
    let truth = [[35.0, 20.0], [-40.0, -25.0]];
    let down_s = 1.2;
    let scene = || Scene {
        touches: truth
            .iter()
            .map(|p| Touch::finger(&[(down_s, p[0], p[1]), (60.0, p[0], p[1])], 20.0, 0.1))
            .collect(),
        ..Scene::empty()
    };
    let skin = std::env::var_os("SKIN_PROGRAM").expect("SKIN_PROGRAM: run tests/boards.sh");
    let run = || {
        let machine = Machine::start("board", scene(), 0);
        Command::new(&skin)
            .args([
                "run",
                "--json",
                // The emulated board's time has nothing to do with this machine's.
                "--every-frame",
                "--plan",
                "quiet",
                "--baseline-frames",
                "20",
                "--frames",
                "40",
                "--port",
                &machine.serial,
            ])
            .current_dir(machine.directory.path())
            .output()
            .unwrap()
    };
    let mut out = run();
    // On a busy machine the emulated board may be too slow for a greeting, as no board is: then another one is tried.
    for _ in 0..4 {
        if !String::from_utf8_lossy(&out.stderr).contains("did not answer a greeting") {
            break;
        }
        out = run();
    }
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let (mut before, mut after) = (0, 0);
    for line in String::from_utf8(out.stdout).unwrap().lines() {
        let picture: serde_json::Value = serde_json::from_str(line).unwrap();
        if picture["kind"] != "picture" {
            continue;
        }
        assert_eq!(picture["lost_frames"], 0);
        let time_s = picture["time_s"].as_f64().unwrap();
        let touches = picture["touches"].as_array().unwrap();
        if time_s < down_s - 0.2 {
            before += 1;
            assert!(touches.is_empty(), "{line}");
        } else if time_s > down_s + 0.1 {
            after += 1;
            assert_eq!(touches.len(), truth.len(), "{line}");
            for p in truth {
                let at = |t: &serde_json::Value, axis: &str| t[axis].as_f64().unwrap();
                let off = touches
                    .iter()
                    .map(|t| (at(t, "x_mm") - p[0]).hypot(at(t, "y_mm") - p[1]))
                    .fold(f64::INFINITY, f64::min);
                assert!(off < 3.0, "{off:.1} mm off {p:?}: {line}");
            }
        }
    }
    assert!(before > 5 && after > 10, "{before} {after}");
}

#[test]
#[ignore = "needs QEMU and the board's programs: run tests/boards.sh"]
fn the_lock_in_needs_under_a_twentieth_of_the_time() {
    let out = Command::new("qemu-system-arm")
        .args(["-M", "mps2-an386", "-nographic", "-icount", "shift=0"])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(program("count"))
        .output()
        .unwrap();
    assert!(out.status.success());
    let said = String::from_utf8(out.stdout).unwrap();
    println!("{said}");
    let count = |name: &str, channels: &str| -> u32 {
        let line = said.lines().find(|l| l.starts_with(&format!("{name} {channels} ")));
        line.and_then(|l| l.rsplit(' ').next()?.parse().ok()).expect(&said)
    };
    // A twentieth of a period of 16 * 2850 cycles at 168 MHz, at 1.4 cycles an instruction.
    let budget = (0.05 * 16.0 * 2850.0 / 1.4) as u32;
    let one = count("fold", "1") + count("correlate", "1") + 2 * count("values", "1") + count("reset", "1");
    assert!(one <= budget, "one channel: {one} of {budget}");
    // With sixteen channels the block is folded within the budget, the look at every sample for the rails included.
    let sixteen = count("fold", "16") + count("reset", "16");
    assert!(sixteen <= budget, "sixteen channels: {sixteen} of {budget}");
}
