//! Boards that go away while the program runs: cables, bridges, processes that are stopped. Nothing here depends on how fast the
//! machine is, but that everything happens within a minute.

use crate::json_lines::are_by_the_schema;
use crate::program::{Started, output, program, text};
use crate::recordings::same_again;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{ChildStdout, Command, Stdio};

/// A finger that stays while the cable is pulled four times; once the board is reset meanwhile. Number of the touch and baseline are
/// those before, and the replay tells the same.
#[test]
fn a_touch_keeps_its_number_and_the_baseline_stays_while_the_cable_is_pulled() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("held.toml");
    let mut toml = "duration_s = 30.0\n[[touch]]\nshape = \"finger\"\npress = { at_s = 0.3, for_s = 29.0, x_mm = 30.0, y_mm = 20.0, force_n = 15.0 }\n".to_owned();
    for (at_s, for_s) in [(1.0, 0.2), (2.0, 1.1), (4.0, 0.05), (5.0, 0.7)] {
        toml += &format!("[[fault]]\nkind = \"cable_pulled\"\nat_s = {at_s}\nfor_s = {for_s}\n");
    }
    toml += "[[fault]]\nkind = \"board_reset\"\nat_s = 2.5\n";
    std::fs::write(&scene, toml).unwrap();
    let file = "held.mcap";
    let pictures = same_again(folder.path(), file, &["--scene", text(&scene), "--frames", "560"]);
    let ids: Vec<&Value> = pictures
        .iter()
        .flat_map(|p| p["touches"].as_array().unwrap())
        .map(|t| &t["id"])
        .collect();
    // A touch that is not clear has its number from its third frame on; where it only begins to press, its place may still jump and the count
    // begins anew.
    let unnumbered = ids.iter().take_while(|id| id.is_null()).count();
    assert!(ids.len() > 400 && unnumbered <= 6, "{ids:?}");
    assert!(ids[unnumbered..].iter().all(|id| **id == 1), "{ids:?}");
    let replay = output(&["replay", text(&folder.path().join(file)), "--json", "--speed", "max"]);
    let lines = crate::program::lines(&replay);
    are_by_the_schema(&lines);
    let events = |name: &str| lines.iter().filter(|l| l["event"] == name).count();
    assert_eq!(
        (events("board_away"), events("board_back"), events("baseline_in_force")),
        (4, 4, 1)
    );
}

/// A simulated board behind a pseudo-terminal, always by the same name.
#[cfg(target_os = "linux")]
pub(crate) fn simulated(port: &Path) -> Started {
    let mut command = program(&["sim", "--pty", "--link", text(port), "--scene", "one-touch"]);
    let mut board = Started::new(command.stdout(Stdio::piped()).stderr(Stdio::null()));
    // It says its port once that is there.
    let mut line = String::new();
    BufReader::new(board.0.stdout.as_mut().unwrap())
        .read_line(&mut line)
        .unwrap();
    assert!(line.starts_with("/dev/"), "{line}");
    board
}

/// The program that shows a board, line by line.
#[cfg(target_os = "linux")]
struct Shown {
    program: Started,
    lines: BufReader<ChildStdout>,
    seen: Vec<Value>,
}

#[cfg(target_os = "linux")]
impl Shown {
    fn new(port: &str) -> Self {
        // A program that lasts: it is ended by the test.
        let mut command = program(&["run", "--json", "--port", port]);
        let mut program = Started::new(command.stdout(Stdio::piped()).stderr(Stdio::null()));
        let lines = BufReader::new(program.0.stdout.take().unwrap());
        let seen = Vec::new();
        Self { program, lines, seen }
    }

    /// The next line of a kind that is wanted.
    fn until(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        loop {
            let mut line = String::new();
            assert!(
                self.lines.read_line(&mut line).unwrap() > 0,
                "it ended: {:?}",
                self.seen.last()
            );
            let line: Value = serde_json::from_str(&line).unwrap();
            let found = wanted(&line);
            self.seen.push(line.clone());
            if found {
                return line;
            }
        }
    }

    fn event(&mut self, name: &str) -> Value {
        self.until(|line| line["event"] == name)
    }

    fn pictures(&mut self, count: usize) -> Value {
        let mut last = Value::Null;
        for _ in 0..count {
            last = self.until(|line| line["kind"] == "picture");
        }
        last
    }

    fn signal(&self, name: &str) {
        let id = self.program.0.id().to_string();
        assert!(Command::new("kill").args([name, &id]).status().unwrap().success());
    }

    /// Ends it in order.
    fn end(mut self) -> Vec<Value> {
        self.signal("-INT");
        let mut rest = String::new();
        self.lines.read_to_string(&mut rest).unwrap();
        assert!(self.program.0.wait().unwrap().success());
        self.seen
    }
}

/// The board's process dies in mid-stream, and another one comes up by the same name: as if it were unplugged and plugged in.
#[cfg(target_os = "linux")]
#[test]
fn a_board_that_is_unplugged_is_waited_for() {
    on_both(|port, address| {
        let mut board = simulated(port);
        let mut shown = Shown::new(address);
        shown.pictures(30);
        board.kill();
        shown.event("board_away");
        let _board = simulated(port);
        assert!(shown.event("board_back")["away_s"].as_f64().unwrap() > 0.0);
        shown.pictures(30);
        let seen = shown.end();
        are_by_the_schema(&seen);
        let baselines = seen.iter().filter(|l| l["event"] == "baseline_in_force");
        assert_eq!(baselines.count(), 1);
    });
}

/// A bridge on another computer, as ser2net or socat are; its connections can be cut, and end where the board's port does.
#[cfg(target_os = "linux")]
struct Bridge {
    address: String,
    connected: std::sync::Arc<std::sync::Mutex<Option<std::net::TcpStream>>>,
}

#[cfg(target_os = "linux")]
impl Bridge {
    fn to(port: &Path) -> Self {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("tcp://{}", listener.local_addr().unwrap());
        let bridge = Self {
            address,
            connected: Default::default(),
        };
        let (port, connected) = (port.to_owned(), bridge.connected.clone());
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let mut stream = stream.unwrap();
                // Without the port the connection ends at once.
                let Ok(mut serial) = std::fs::OpenOptions::new().read(true).write(true).open(&port) else {
                    continue;
                };
                let (mut back, mut from_board) = (stream.try_clone().unwrap(), serial.try_clone().unwrap());
                *connected.lock().unwrap() = Some(stream.try_clone().unwrap());
                std::thread::spawn(move || {
                    let _ = std::io::copy(&mut from_board, &mut back);
                    let _ = back.shutdown(std::net::Shutdown::Both);
                });
                std::thread::spawn(move || {
                    // The client may close it, too.
                    let _ = std::io::copy(&mut stream, &mut serial);
                });
            }
        });
        bridge
    }

    fn cut(&self) {
        let connected = self.connected.lock().unwrap();
        connected.as_ref().unwrap().shutdown(std::net::Shutdown::Both).unwrap();
    }
}

/// Runs a test on a board's own port and on a bridge to it, beside each other.
#[cfg(target_os = "linux")]
fn on_both(test: impl Fn(&Path, &str) + Sync) {
    std::thread::scope(|scope| {
        for bridged in [false, true] {
            let test = &test;
            scope.spawn(move || {
                let folder = tempfile::tempdir().unwrap();
                let port = folder.path().join("port");
                if bridged {
                    test(&port, &Bridge::to(&port).address);
                } else {
                    test(&port, text(&port));
                }
            });
        }
    });
}

#[cfg(target_os = "linux")]
#[test]
fn a_board_behind_a_bridge_is_shown_and_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("port");
    let _board = simulated(&port);
    let bridge = Bridge::to(&port);
    let list = crate::program::skin(&["list", "--json", text(&port)]);
    let list: Value = serde_json::from_str(&list).unwrap();
    let listed = list
        .as_array()
        .unwrap()
        .iter()
        .find(|l| l["port"] == text(&port))
        .unwrap();
    assert_eq!(
        (&listed["board"]["name"], &listed["board"]["electrodes"]),
        (&"skin-sim".into(), &16.into())
    );
    let mut shown = Shown::new(&bridge.address);
    for _ in 0..3 {
        shown.pictures(20);
        bridge.cut();
        shown.event("board_away");
        shown.event("board_back");
    }
    shown.pictures(20);
    assert_eq!(shown.seen[0]["source"], bridge.address.as_str());
    are_by_the_schema(&shown.end());
}

/// A program that is stopped for so long goes on: no board is blamed, and what was lost meanwhile is counted.
#[cfg(target_os = "linux")]
fn stopped(stop_s: f64, port: &Path, address: &str) {
    let _board = simulated(port);
    let mut shown = Shown::new(address);
    let before = shown.pictures(50);
    shown.signal("-STOP");
    std::thread::sleep(std::time::Duration::from_secs_f64(stop_s));
    shown.signal("-CONT");
    let jump = |line: &Value| line["unix_s"].as_f64().unwrap() - before["unix_s"].as_f64().unwrap() >= stop_s;
    shown.until(|line| line["kind"] == "picture" && jump(line));
    let after = shown.pictures(100);
    let number = |line: &Value, name: &str| line[name].as_u64().unwrap();
    let grown = |name: &str| number(&after, name) - number(&before, name);
    let seen = shown.end();
    let place = |line: &Value| seen.iter().position(|l| l == line).unwrap();
    let between = &seen[place(&before) + 1..=place(&after)];
    let shown = between.iter().filter(|l| l["kind"] == "picture").count() as u64;
    // The link counts ahead of what is shown.
    let counted = shown + grown("lost_frames") + grown("skipped_frames");
    assert!(
        grown("frame") <= counted,
        "{} frames, {counted} counted",
        grown("frame")
    );
    println!(
        "stopped for {stop_s} s: {} frames lost, {} passed over",
        grown("lost_frames"),
        grown("skipped_frames")
    );
    for event in ["board_away", "silence", "board_reset"] {
        assert!(!between.iter().any(|l| l["event"] == event), "{event}");
    }
    are_by_the_schema(&seen);
}

#[cfg(target_os = "linux")]
#[test]
fn a_program_that_was_stopped_blames_no_board() {
    on_both(|port, address| stopped(3.5, port, address));
}

/// The figure of docs/reliability.md.
#[cfg(target_os = "linux")]
#[test]
#[ignore = "half a minute"]
fn a_program_that_was_stopped_for_longer_blames_no_board() {
    for stop_s in [3.5, 5.0, 10.0] {
        on_both(|port, address| stopped(stop_s, port, address));
    }
}
