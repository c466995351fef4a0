//! Recordings that somebody asks for at the page.

use crate::program::{Started, output, program, said};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read};
use std::net::TcpStream;
use std::path::Path;
use std::process::{ChildStderr, Stdio};
use std::time::Duration;
use tungstenite::{Message, WebSocket};

/// Longer than the slowest machine needs.
const NOT_FOR_EVER: Duration = Duration::from_secs(120);

/// A page of a program that writes into a folder.
struct Page {
    program: Started,
    stderr: BufReader<ChildStderr>,
    socket: WebSocket<TcpStream>,
}

impl Page {
    /// One that may command.
    fn of(folder: &Path, arguments: &[&str]) -> Self {
        let mut command = program(arguments);
        command.current_dir(folder).args(["--no-open", "--listen", "0"]);
        let mut program = Started::new(command.stdout(Stdio::null()).stderr(Stdio::piped()));
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
        }
    }

    fn send(&mut self, kind: &str) {
        let text = json!({ "kind": kind }).to_string();
        self.socket.send(Message::Text(text.into())).unwrap();
    }

    /// Takes what comes until a message is wanted.
    fn until(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        loop {
            match self.socket.read().unwrap() {
                Message::Text(text) => {
                    let message = serde_json::from_str(&text).unwrap();
                    if wanted(&message) {
                        return message;
                    }
                }
                Message::Binary(_) => self.socket.send(Message::Binary(vec![1].into())).unwrap(),
                _ => {}
            }
        }
    }

    fn recording(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        self.until(|message| message["kind"] == "recording" && wanted(message))
    }

    /// Ends it in order; what it said.
    fn end(mut self) -> String {
        let id = self.program.0.id().to_string();
        let killed = std::process::Command::new("kill").args(["-TERM", &id]).status();
        assert!(killed.unwrap().success());
        let mut said = String::new();
        self.stderr.read_to_string(&mut said).unwrap();
        assert!(self.program.0.wait().unwrap().success(), "{said}");
        said
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
    }
    // What is played is in a file already.
    let mut page = Page::of(folder.path(), &["replay", files[0].to_str().unwrap()]);
    page.send("start_recording");
    let refused = page.recording(|m| !m["note"].is_null());
    assert!(refused["note"].as_str().unwrap().contains("replay"), "{refused}");
    page.end();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}
