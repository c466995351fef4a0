//! Recordings that somebody asks for at the page.

use crate::ending::until_it_hangs;
use crate::program::{Started, output, program, said, text};
use recording::{Ended, Reader, Topic, Writer};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read};
use std::net::TcpStream;
use std::path::Path;
use std::process::{ChildStderr, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket};
use view::wire::{Frame, decode};

/// Longer than the slowest machine needs.
const NOT_FOR_EVER: Duration = Duration::from_secs(120);

/// A page of a program that writes into a folder.
struct Page {
    program: Started,
    stderr: BufReader<ChildStderr>,
    socket: WebSocket<TcpStream>,
    /// What came last of pictures, and of a replay's place.
    shown: Option<Frame>,
    place: Value,
}

impl Page {
    /// One that may command.
    fn of(folder: &Path, arguments: &[&str]) -> Self {
        let mut command = program(arguments);
        command.arg("--no-open").stdout(Stdio::null());
        Self::started(folder, command)
    }

    /// The same of a command that writes to somewhere.
    fn started(folder: &Path, mut command: Command) -> Self {
        command.current_dir(folder).args(["--listen", "0"]);
        let mut program = Started::new(command.stderr(Stdio::piped()));
        let mut stderr = BufReader::new(program.0.stderr.take().unwrap());
        let mut line = String::new();
        let url = loop {
            line.clear();
            assert!(stderr.read_line(&mut line).unwrap() > 0, "it ended");
            if let Some(rest) = line.strip_prefix("live picture: http://") {
                break rest.split_whitespace().next().unwrap();
            }
        };
        let (address, token) = url.split_once("/#").unwrap();
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(NOT_FOR_EVER)).unwrap();
        let mut socket = tungstenite::client(format!("ws://{address}/live"), stream).unwrap().0;
        let enter = json!({ "kind": "enter", "key": token });
        socket.send(Message::Text(enter.to_string().into())).unwrap();
        Self {
            program,
            stderr,
            socket,
            shown: None,
            place: Value::Null,
        }
    }

    fn send(&mut self, kind: &str) {
        self.ask(json!({ "kind": kind }));
    }

    fn ask(&mut self, request: Value) {
        self.socket.send(Message::Text(request.to_string().into())).unwrap();
    }

    /// Takes the next message; a text.
    fn take(&mut self) -> Option<Value> {
        match self.socket.read().unwrap() {
            Message::Text(text) => {
                let message: Value = serde_json::from_str(&text).unwrap();
                if message["kind"] == "replay" {
                    self.place = message.clone();
                }
                Some(message)
            }
            Message::Binary(frame) => {
                self.socket.send(Message::Binary(vec![1].into())).unwrap();
                self.shown = Some(decode(&frame).unwrap());
                None
            }
            _ => None,
        }
    }

    /// Takes what comes until what is shown, and where a replay is, are wanted.
    fn shows(&mut self, wanted: impl Fn(&Frame, &Value) -> bool) {
        let end = Instant::now() + 5 * NOT_FOR_EVER;
        while !self.shown.as_ref().is_some_and(|frame| wanted(frame, &self.place)) {
            assert!(Instant::now() < end, "never shown");
            self.take();
        }
    }

    /// Takes what comes until a message is wanted.
    fn until(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        loop {
            if let Some(message) = self.take().filter(|message| wanted(message)) {
                return message;
            }
        }
    }

    fn recording(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        self.until(|message| message["kind"] == "recording" && wanted(message))
    }

    /// Ends it in order; what it said.
    fn end(self) -> String {
        let (code, said) = self.ended();
        assert_eq!(code, Some(0), "{said}");
        said
    }

    /// Tells it to end; its exit code, and what it said.
    fn ended(mut self) -> (Option<i32>, String) {
        let id = self.program.0.id().to_string();
        let killed = Command::new("kill").args(["-TERM", &id]).status();
        assert!(killed.unwrap().success());
        let mut said = String::new();
        self.stderr.read_to_string(&mut said).unwrap();
        (self.program.0.wait().unwrap().code(), said)
    }
}

/// Begun in the middle of a touch, and again: each file is replayed with the touches that were shown, to the last bit.
#[test]
fn what_the_page_records_is_replayed_with_every_touch() {
    let folder = tempfile::tempdir().unwrap();
    let mut page = Page::of(folder.path(), &["run", "--scene", "one-touch"]);
    page.until(|m| m["kind"] == "scene" && m["preparing"] == false && !m["baseline"].is_null());
    page.send("tare");
    page.send("start_recording");
    let refused = page.recording(|m| !m["note"].is_null());
    assert!(refused["note"].as_str().unwrap().contains("baseline"), "{refused}");
    assert_eq!(refused["file"], Value::Null);
    page.until(|m| m["kind"] == "scene" && m["preparing"] == false);
    let mut files = Vec::new();
    for _ in 0..2 {
        page.send("start_recording");
        // The button is answered at once; that the reconstruction is made takes a while.
        page.recording(|m| m["note"].as_str().is_some_and(|note| note.contains("begins")));
        let shown = page.recording(|m| m["file"].is_string() && m["bytes"].as_u64() >= Some(150_000));
        assert!(shown["seconds"].is_u64(), "{shown}");
        page.send("stop_recording");
        let ended = page.recording(|m| m["file"].is_null());
        let file = shown["file"].as_str().unwrap();
        assert_eq!(ended["note"], format!("recorded: {file}"));
        files.push(folder.path().join(file));
    }
    let told = page.end();
    assert_ne!(files[0], files[1]);
    let mut numbered: Vec<u64> = Vec::new();
    for file in &files {
        assert!(
            told.contains(&format!("recording into {}", file.file_name().unwrap().display())),
            "{told}"
        );
        let replay = output(&["replay", file.to_str().unwrap(), "--json", "--speed", "max"]);
        assert!(replay.status.success(), "{}", said(&replay));
        assert!(
            said(&replay).contains("pictures, every one with the recorded touches"),
            "{}",
            said(&replay)
        );
        assert!(!said(&replay).contains("warning"), "{}", said(&replay));
        let lines = String::from_utf8(replay.stdout).unwrap();
        let mut lines = lines.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        let first = lines.find(|line| line["kind"] == "picture").unwrap();
        // Of the touches that were there already: they have their numbers, and come down no more.
        numbered.extend(
            first["touches"]
                .as_array()
                .unwrap()
                .iter()
                .filter_map(|t| t["id"].as_u64()),
        );
    }
    assert!(!numbered.is_empty());
    // What is played is in a file already.
    let mut page = Page::of(folder.path(), &["replay", files[0].to_str().unwrap()]);
    page.until(|m| m["kind"] == "scene" && m["preparing"] == false);
    page.send("start_recording");
    let refused = page.recording(|m| !m["note"].is_null());
    assert!(refused["note"].as_str().unwrap().contains("replay"), "{refused}");
    page.end();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

/// How a recording ends, and how many messages of the board are in it.
fn whole(file: &Path) -> (Option<Ended>, usize) {
    let mut reader = Reader::open(file).unwrap();
    let mut messages = 0;
    while let Some(message) = reader.next().unwrap() {
        messages += usize::from(message.topic == Some(Topic::Board));
    }
    (reader.ended(), messages)
}

/// Nobody reads the output: the program hangs in a write when it is told to end, and the recording is closed all the same.
#[test]
fn what_the_page_records_is_closed_whatever_hangs() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = program(&["run", "--scene", "one-touch", "--json", "--every-frame"]);
    command.stdout(Stdio::piped());
    let mut page = Page::started(folder.path(), command);
    let mut lines = page.program.0.stdout.take().unwrap();
    let enough = Arc::new(AtomicBool::new(false));
    let read = {
        let enough = Arc::clone(&enough);
        std::thread::spawn(move || {
            let mut some = [0; 4096];
            while !enough.load(Ordering::Relaxed) && lines.read(&mut some).unwrap() > 0 {}
            lines
        })
    };
    page.until(|m| m["kind"] == "scene" && m["preparing"] == false && !m["baseline"].is_null());
    page.send("start_recording");
    let shown = page.recording(|m| m["file"].is_string() && m["bytes"].as_u64() >= Some(50_000));
    enough.store(true, Ordering::Relaxed);
    // It is open, and nobody reads it any more.
    let _lines = read.join().unwrap();
    until_it_hangs(page.program.0.id());
    let (code, said) = page.ended();
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("what hangs") && !said.contains("is not closed"), "{said}");
    let (ended, messages) = whole(&folder.path().join(shown["file"].as_str().unwrap()));
    assert!(ended == Some(Ended::Whole) && messages > 20, "{ended:?} {messages}");
}

/// The disk is full while somebody records at the page: the picture goes on, the page is told, and so is who started the program.
#[test]
fn a_recording_of_the_page_that_failed_is_in_the_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -f 200; trap '' XFSZ; exec \"$0\" \"$@\""]);
    command
        .arg(env!("CARGO_BIN_EXE_skin"))
        .args(["run", "--scene", "one-touch", "--no-open"]);
    command.stdout(Stdio::null());
    let mut page = Page::started(folder.path(), command);
    page.until(|m| m["kind"] == "scene" && m["preparing"] == false && !m["baseline"].is_null());
    page.send("start_recording");
    let failed = page.recording(|m| m["file"].is_string() && !m["note"].is_null());
    assert!(failed["note"].as_str().unwrap().contains("File too large"), "{failed}");
    let before = page.shown.as_ref().map_or(0, |frame| frame.sequence);
    page.send("stop_recording");
    page.recording(|m| m["file"].is_null());
    page.shows(|frame, _| frame.sequence > before + 20);
    let (code, said) = page.ended();
    assert!(
        code == Some(1) && said.contains("skin: the recording is not complete"),
        "{said}"
    );
}

/// A picture of a recording: when it was recorded, ns, its frame, and the place of its only touch.
struct Recorded {
    log_ns: u64,
    frame: u64,
    touch: Option<(Value, [f64; 2])>,
}

/// When the first step of a recording was recorded, ns, and its pictures.
fn recorded(file: &Path) -> (u64, Vec<Recorded>) {
    let (mut began_ns, mut pictures) = (None, Vec::new());
    let mut reader = Reader::open(file).unwrap();
    while let Some(message) = reader.next().unwrap() {
        if matches!(message.topic, Some(Topic::Live | Topic::Touches)) {
            began_ns.get_or_insert(message.log_ns);
        }
        if message.topic == Some(Topic::Touches) {
            let record: Value = serde_json::from_slice(message.data).unwrap();
            let place = |t: &Value| (t["id"].clone(), ["x_mm", "y_mm"].map(|key| t[key].as_f64().unwrap()));
            let only = record["touches"].as_array().filter(|touches| touches.len() == 1);
            pictures.push(Recorded {
                log_ns: message.log_ns,
                frame: record["frame"].as_u64().unwrap(),
                touch: only.map(|touches| place(&touches[0])),
            });
        }
    }
    (began_ns.unwrap(), pictures)
}

/// Forth and back over a baseline that was taken in between: what is shown at a place is what was shown there then.
#[test]
fn a_replay_goes_where_the_page_asks() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "duration_s = 2.0\n[material]\nkind = \"elastic\"\n[[touch]]\nshape = \"finger\"\n\
                 press = { at_s = 0.4, for_s = 1.2, x_mm = 30.0, y_mm = 20.0, force_n = 15.0 }\n";
    std::fs::write(folder.path().join("press.toml"), scene).unwrap();
    let mut page = Page::of(
        folder.path(),
        &[
            "run",
            "--scene",
            "press.toml",
            "--every-frame",
            "--record",
            "press.mcap",
        ],
    );
    page.shows(|f, _| f.touches.iter().any(|t| t.id == Some(1)));
    let began_s = page.shown.as_ref().unwrap().time_s;
    page.shows(|f, _| f.time_s > began_s + 3.0 && f.touches.is_empty());
    page.send("tare");
    page.until(|m| m["kind"] == "scene" && m["preparing"] == true);
    page.until(|m| m["kind"] == "scene" && m["preparing"] == false);
    page.shows(|f, _| !f.touches.is_empty());
    let again_s = page.shown.as_ref().unwrap().time_s;
    page.shows(|f, _| f.time_s > again_s + 3.0);
    page.end();

    let file = folder.path().join("press.mcap");
    let (began_ns, pictures) = recorded(&file);
    // A finger that rests: what is shown there does not depend on the frames before.
    let rests: Vec<&Recorded> = pictures
        .windows(21)
        .filter(|w| {
            w[10].touch.is_some()
                && w.iter()
                    .all(|p| p.touch.as_ref().map(|t| &t.0) == w[10].touch.as_ref().map(|t| &t.0))
        })
        .map(|w| &w[10])
        .collect();
    assert!(rests.len() > 40, "{} of {}", rests.len(), pictures.len());
    let mut page = Page::of(folder.path(), &["replay", text(&file)]);
    let told = page.until(|m| m["kind"] == "replay");
    let length_ms = (pictures.last().unwrap().log_ns - began_ns) / 1_000_000;
    assert!(
        told["length_ms"].as_u64().unwrap().abs_diff(length_ms) <= 1000,
        "{told}"
    );
    page.send("pause");
    page.shows(|_, place| place["paused"] == true);
    for at in [rests.len() - 1, 0, rests.len() / 2, 1, rests.len() - 2] {
        let at_ms = (rests[at].log_ns - began_ns) / 1_000_000;
        page.ask(json!({ "kind": "seek", "at_ms": at_ms }));
        // What is shown is the first picture that was recorded from then on, however fast the machine was: pictures that were made late, at
        // once, may be in one millisecond.
        let from = pictures.partition_point(|p| p.log_ns < began_ns + 1_000_000 * at_ms);
        let wanted = &pictures[from];
        page.shows(|f, place| {
            let is_there = f.sequence == wanted.frame && place["paused"] == true;
            is_there && place["at_ms"].as_u64() == Some((wanted.log_ns - began_ns) / 1_000_000)
        });
        let shown = page.shown.as_ref().unwrap();
        let [touch] = &shown.touches[..] else {
            panic!("{} touches", shown.touches.len())
        };
        let (_, [x, y]) = wanted.touch.as_ref().unwrap();
        let off_mm = (touch.x_mm - x).hypot(touch.y_mm - y);
        assert!(off_mm < 1.5, "{off_mm} mm off at {at_ms} ms");
    }
    // It goes on, and stands still at its end for as long as somebody watches.
    page.send("play");
    page.shows(|_, place| place["paused"] == false);
    page.ask(json!({ "kind": "seek", "at_ms": length_ms.saturating_sub(300) }));
    page.shows(|_, place| place["paused"] == true && place["at_ms"].as_u64() >= Some(length_ms.saturating_sub(20)));
    let said = page.end();
    assert!(said.contains("went to another place"), "{said}");
    assert!(!said.contains("warning"), "{said}");
}

/// The same recording by a program that took every frame so much later, and does not know it.
fn taken_later(from: &Path, to: &Path, by_ns: u64) {
    let mut messages = Vec::new();
    let mut reader = Reader::open(from).unwrap();
    while let Some(message) = reader.next().unwrap() {
        let Some(topic) = message.topic else { continue };
        let late = matches!(topic, Topic::Live | Topic::Touches);
        let log_ns = message.log_ns + if late { by_ns } else { 0 };
        messages.push((log_ns, topic, message.data.to_vec()));
    }
    messages.sort_by_key(|(log_ns, ..)| *log_ns);
    let mut writer = Writer::create(to).unwrap();
    for chunk in messages.chunks(50) {
        for (log_ns, topic, data) in chunk {
            writer.message(*topic, *log_ns, *log_ns, data).unwrap();
        }
        writer.flush().unwrap();
    }
    writer.finish().unwrap();
}

/// On a busy machine frames wait, and what a recording says of their times is when they came on average.
#[test]
fn a_replay_finds_frames_that_waited_longer_than_the_recording_says() {
    let folder = tempfile::tempdir().unwrap();
    let (file, late) = (folder.path().join("soon.mcap"), folder.path().join("late.mcap"));
    let run = [
        "run",
        "--scene",
        "one-touch",
        "--json",
        "--every-frame",
        "--frames",
        "400",
        "--record",
    ];
    let run = output(&[&run[..], &[text(&file)]].concat());
    assert!(run.status.success(), "{}", said(&run));
    taken_later(&file, &late, 8_000_000_000);
    let (began_ns, pictures) = recorded(&late);
    let mut page = Page::of(folder.path(), &["replay", text(&late)]);
    page.until(|m| m["kind"] == "replay");
    page.send("pause");
    page.shows(|_, place| place["paused"] == true);
    for at in [350, 50, 200] {
        let at_ms = (pictures[at].log_ns - began_ns) / 1_000_000;
        page.ask(json!({ "kind": "seek", "at_ms": at_ms }));
        let from = pictures.partition_point(|p| p.log_ns < began_ns + 1_000_000 * at_ms);
        let wanted = pictures[from].frame;
        page.shows(|f, place| f.sequence == wanted && place["paused"] == true);
    }
    let said = page.end();
    assert!(!said.contains("warning"), "{said}");
}
