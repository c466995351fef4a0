//! Programs that are told to end, and consumers that are slow or stuck.

use crate::program::{Started, program, text};
use crate::reconnect::simulated;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

/// Longer than the slowest machine needs.
const NOT_FOR_EVER: Duration = Duration::from_secs(60);

/// A board behind a port of the system, and the program that shows it.
struct Shown {
    program: Started,
    lines: BufReader<ChildStdout>,
    port: PathBuf,
    _board: Started,
    folder: tempfile::TempDir,
}

impl Shown {
    /// With these arguments beside the port; it has printed so many pictures.
    fn new(arguments: &[&str], pictures: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let port = folder.path().join("port");
        let board = simulated(&port);
        let mut command = program(&["run", "--json", "--port", text(&port)]);
        let command = command.args(arguments).current_dir(folder.path());
        let mut program = Started::new(command.stdout(Stdio::piped()).stderr(Stdio::piped()));
        let lines = BufReader::new(program.0.stdout.take().unwrap());
        let mut shown = Self {
            program,
            lines,
            port,
            _board: board,
            folder,
        };
        for _ in 0..pictures {
            shown.picture();
        }
        shown
    }

    fn picture(&mut self) -> Value {
        loop {
            let mut line = String::new();
            assert!(self.lines.read_line(&mut line).unwrap() > 0, "it ended");
            let line: Value = serde_json::from_str(&line).unwrap();
            if line["kind"] == "picture" {
                return line;
            }
        }
    }

    fn signal(&self, name: &str) {
        let id = self.program.0.id().to_string();
        assert!(Command::new("kill").args([name, &id]).status().unwrap().success());
    }

    /// Waits for the end: the exit code, what was said, and how long it took.
    fn ended(&mut self) -> (i32, String, f64) {
        let start = Instant::now();
        let status = loop {
            if let Some(status) = self.program.0.try_wait().unwrap() {
                break status;
            }
            assert!(start.elapsed() < NOT_FOR_EVER, "it goes on");
            std::thread::sleep(Duration::from_millis(2));
        };
        let mut said = String::new();
        self.program.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        (status.code().unwrap(), said, start.elapsed().as_secs_f64())
    }

    /// Whether the board still sends frames, after what was on its way already.
    fn board_sends(&self) -> bool {
        let mut port = std::fs::File::open(&self.port).unwrap();
        let (sender, bytes) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            let mut some = [0; 4096];
            // The port may never send anything.
            while port.read(&mut some).is_ok() && sender.send(()).is_ok() {}
        });
        std::thread::sleep(Duration::from_millis(500));
        bytes.try_iter().for_each(drop);
        bytes.recv_timeout(Duration::from_secs(1)).is_ok()
    }
}

/// Waits until a pipe that nobody reads is full: the program hangs in a write.
pub(crate) fn until_it_hangs(id: u32) {
    let start = Instant::now();
    let hangs = || std::fs::read_to_string(format!("/proc/{id}/wchan")).unwrap();
    while !hangs().contains("pipe_write") && start.elapsed() < Duration::from_secs(10) {
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_program_whose_output_nobody_reads_ends_and_stops_the_board() {
    // On a machine that is very busy the board may not be told in time; that is said.
    let told = ["-INT", "-TERM", "-INT", "-TERM"].map(|name| {
        let mut shown = Shown::new(&["--every-frame"], 5);
        until_it_hangs(shown.program.0.id());
        shown.signal(name);
        let (code, said, seconds) = shown.ended();
        println!("{name}: ended after {seconds:.2} s");
        assert_eq!(code, 1, "{said}");
        assert!(said.contains("what hangs"), "{said}");
        let told = !said.contains("goes on sending");
        assert!(!(told && shown.board_sends()), "{said}");
        told
    });
    assert!(told.contains(&true));
}

#[test]
fn a_file_that_cannot_be_written_for_ever_keeps_nobody() {
    let mut shown = Shown::new(&["--png", "stuck"], 0);
    // A pipe without a reader: it hangs when it is opened.
    let stuck = shown.folder.path().join("stuck");
    assert!(Command::new("mkfifo").arg(&stuck).status().unwrap().success());
    shown.picture();
    let mut lines = std::mem::replace(&mut shown.lines, BufReader::new(nothing()));
    let read = std::thread::spawn(move || std::io::copy(&mut lines, &mut std::io::sink()));
    shown.signal("-INT");
    let (code, said, seconds) = shown.ended();
    println!("ended after {seconds:.2} s");
    assert_eq!(code, 1, "{said}");
    read.join().unwrap().unwrap();
}

/// The output of a program that has none.
fn nothing() -> ChildStdout {
    let mut nothing = Command::new("true").stdout(Stdio::piped()).spawn().unwrap();
    nothing.wait().unwrap();
    nothing.stdout.take().unwrap()
}

#[test]
fn a_program_that_is_read_ends_well_and_stops_the_board() {
    for name in ["-INT", "-TERM"] {
        let mut shown = Shown::new(&[], 5);
        let mut lines = std::mem::replace(&mut shown.lines, BufReader::new(nothing()));
        let read = std::thread::spawn(move || std::io::copy(&mut lines, &mut std::io::sink()));
        shown.signal(name);
        let (code, said, seconds) = shown.ended();
        println!("{name}: ended after {seconds:.2} s");
        assert_eq!(code, 0, "{said}");
        read.join().unwrap().unwrap();
        assert!(!shown.board_sends());
    }
}

#[test]
fn a_closed_output_ends_it_quietly_and_stops_the_board() {
    let mut shown = Shown::new(&[], 5);
    shown.lines = BufReader::new(nothing());
    let (code, said, _) = shown.ended();
    assert!(
        code == 0 && !said.contains("skin:") && !said.contains("warning"),
        "{said}"
    );
    assert!(!shown.board_sends());
}

/// A port that is there and says nothing: a program that is ended while it greets leaves no file without anything in it.
#[test]
fn a_recording_of_which_nothing_came_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("new.mcap");
    let silent = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = format!("tcp://{}", silent.local_addr().unwrap());
    for (arguments, name) in [(["run", "--record"].as_slice(), "-INT"), (&["record"], "-TERM")] {
        let mut command = program(arguments);
        let command = command.args([text(&file), "--port", &port]);
        let mut program = Started::new(command.stdout(Stdio::piped()).stderr(Stdio::piped()));
        let (mut greeted, _) = silent.accept().unwrap();
        assert!(greeted.read(&mut [0]).unwrap() == 1 && file.exists());
        let id = program.0.id().to_string();
        assert!(Command::new("kill").args([name, &id]).status().unwrap().success());
        assert_eq!(program.0.wait().unwrap().code(), Some(1));
        assert!(!file.exists());
    }
}

/// A command that has nothing to end in order: it ends at once, and the board stops.
#[test]
fn a_calibration_that_is_broken_off_stops_the_board() {
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("port");
    let board = simulated(&port);
    let mut command = program(&["calibrate", "--port", text(&port), "--force-n", "5"]);
    let mut program = Started::new(command.stdout(Stdio::piped()).stderr(Stdio::piped()));
    let mut said = BufReader::new(program.0.stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains("taking the baseline") {
        line.clear();
        assert!(said.read_line(&mut line).unwrap() > 0, "it ended");
    }
    program.0.stderr = Some(said.into_inner());
    let lines = BufReader::new(nothing());
    let mut shown = Shown {
        program,
        lines,
        port,
        _board: board,
        folder,
    };
    shown.signal("-INT");
    let (code, said, _) = shown.ended();
    assert_eq!(code, 130, "{said}");
    assert!(!shown.board_sends());
}

/// Pictures after a pause of the reader, with every frame asked for; how many came during it at least.
fn paused(pause: Duration) -> u64 {
    let mut shown = Shown::new(&["--every-frame"], 20);
    let before = shown.picture();
    std::thread::sleep(pause);
    let number = |line: &Value, name: &str| line[name].as_u64().unwrap();
    let mut last = before.clone();
    // All that came meanwhile, and what comes while that is read.
    let frames = (pause.as_secs_f64() * 115.0) as u64 + 100;
    while number(&last, "frame") < number(&before, "frame") + frames {
        let next = shown.picture();
        assert_eq!(number(&next, "frame"), number(&last, "frame") + 1);
        last = next;
    }
    for name in ["lost_frames", "skipped_frames"] {
        assert_eq!(number(&last, name), number(&before, name), "{name}");
    }
    frames
}

/// The pipe holds some hundred lines, and the usual queue 256 frames: this is more.
#[test]
fn with_every_frame_a_slow_reader_loses_none() {
    paused(Duration::from_secs(8));
}

/// The figure of docs/reliability.md.
#[test]
#[ignore = "a minute"]
fn with_every_frame_a_slow_reader_loses_none_in_a_minute() {
    println!("{} frames, none lost", paused(Duration::from_secs(60)));
}

/// A file that is replaced: a full disk is a device that says so.
#[test]
fn a_full_disk_leaves_no_torn_file() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = folder.path().join("bytes");
    let run = |out: &Path| {
        let mut command = program(&[
            "sim",
            "--scene",
            "one-touch",
            "--duration-s",
            "0.2",
            "--bytes",
            text(out),
        ]);
        command.output().unwrap()
    };
    assert!(run(&bytes).status.success());
    let whole = std::fs::read(&bytes).unwrap();
    let full = run(Path::new("/dev/full"));
    assert_eq!(full.status.code(), Some(1));
    // A limit on the size of files is met in the middle of it; the old one stays.
    let limited = Command::new("sh")
        .args(["-c", "ulimit -f 1; trap '' XFSZ; exec \"$0\" \"$@\""])
        .arg(env!("CARGO_BIN_EXE_skin"))
        .args([
            "sim",
            "--scene",
            "one-touch",
            "--duration-s",
            "0.4",
            "--bytes",
            text(&bytes),
        ])
        .output()
        .unwrap();
    assert_eq!(
        limited.status.code(),
        Some(1),
        "{}",
        String::from_utf8_lossy(&limited.stderr)
    );
    assert_eq!(std::fs::read(&bytes).unwrap(), whole);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// What makes a new file names it where the disk is full, and leaves no part of it.
#[test]
fn a_full_disk_leaves_no_new_file() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("new");
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/short.mcap");
    for command in [
        &["recover"][..],
        &["export", "--to", "csv"],
        &["export", "--to", "npz"],
        &["export", "--to", "mat"],
        &["export", "--to", "rosbag2"],
    ] {
        let limited = Command::new("sh")
            .args(["-c", "ulimit -f 1; trap '' XFSZ; exec \"$0\" \"$@\""])
            .arg(env!("CARGO_BIN_EXE_skin"))
            .args(command)
            .args([text(&recording), "--out", text(&out)])
            .output()
            .unwrap();
        let said = String::from_utf8(limited.stderr).unwrap();
        assert!(
            limited.status.code() == Some(1) && said.contains(text(&out)),
            "{command:?}: {said}"
        );
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "{command:?}");
    }
}
