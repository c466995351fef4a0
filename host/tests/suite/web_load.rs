//! The page's server under load, in the program that measures.

use crate::program::{Started, program};
use serde_json::json;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{ChildStderr, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket};

/// Longer than the slowest machine needs.
const NOT_FOR_EVER: Duration = Duration::from_secs(120);

/// `skin run` on the simulated skin, with its page.
struct Shown {
    program: Started,
    stderr: BufReader<ChildStderr>,
    /// `127.0.0.1:PORT`
    address: String,
    token: String,
}

impl Shown {
    fn new() -> Self {
        let mut command = program(&["run", "--scene", "one-touch", "--no-open", "--listen", "0"]);
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
        let (address, token) = (address.to_owned(), token.to_owned());
        let shown = Self {
            program,
            stderr,
            address,
            token,
        };
        shown.until(&mut shown.page(), |status| status.is_empty());
        shown
    }

    /// Reads pictures of the page until one has such a status line.
    fn until(&self, page: &mut WebSocket<TcpStream>, wanted: impl Fn(&str) -> bool) {
        let start = Instant::now();
        loop {
            assert!(start.elapsed() < NOT_FOR_EVER);
            let Message::Binary(bytes) = page.read().unwrap() else {
                continue;
            };
            page.send(Message::Binary(vec![1].into())).unwrap();
            let length = usize::from(u16::from_le_bytes([bytes[86], bytes[87]]));
            if wanted(&String::from_utf8_lossy(&bytes[bytes.len() - length..])) {
                return;
            }
        }
    }

    /// Head and body of an answer; empty ones where the connection was closed without.
    fn ask(&self, path: &str) -> (String, Vec<u8>) {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(NOT_FOR_EVER)).unwrap();
        let host = &self.address;
        let mut answer = Vec::new();
        let _ = write!(
            stream,
            "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
        );
        let _ = stream.read_to_end(&mut answer);
        let end = answer.windows(4).position(|w| w == b"\r\n\r\n").unwrap_or(answer.len());
        let body = answer.get(end + 4..).unwrap_or_default().to_vec();
        (String::from_utf8_lossy(&answer[..end]).into_owned(), body)
    }

    fn page(&self) -> WebSocket<TcpStream> {
        let stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(NOT_FOR_EVER)).unwrap();
        tungstenite::client(format!("ws://{}/live", self.address), stream)
            .unwrap()
            .0
    }

    /// Pictures a second that a page is sent while somebody does something.
    fn rate(&self, seconds: f64) -> f64 {
        let (mut page, mut frames, start) = (self.page(), 0, Instant::now());
        while start.elapsed().as_secs_f64() < seconds {
            if matches!(page.read().unwrap(), Message::Binary(_)) {
                page.send(Message::Binary(vec![1].into())).unwrap();
                frames += 1;
            }
        }
        f64::from(frames) / start.elapsed().as_secs_f64()
    }

    /// Memory in use, MB.
    fn memory_mb(&self) -> f64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.program.0.id())).unwrap();
        let kb = status.lines().find_map(|l| l.strip_prefix("VmRSS:")).unwrap();
        kb.trim().trim_end_matches(" kB").parse::<f64>().unwrap() / 1e3
    }

    /// Asks for the picture from so many threads at a time, until told to end; the answers.
    fn asked<T>(&self, askers: usize, meanwhile: impl FnOnce() -> T) -> (T, u64) {
        let (end, answered) = (AtomicBool::new(false), AtomicU64::new(0));
        let out = std::thread::scope(|scope| {
            for _ in 0..askers {
                scope.spawn(|| {
                    while !end.load(Ordering::Relaxed) {
                        let (head, _) = self.ask("/picture.png");
                        answered.fetch_add(u64::from(head.starts_with("HTTP/1.1 200")), Ordering::Relaxed);
                    }
                });
            }
            let out = meanwhile();
            end.store(true, Ordering::Relaxed);
            out
        });
        (out, answered.into_inner())
    }

    /// Ends it in order; what it said.
    fn end(mut self) -> String {
        let id = self.program.0.id().to_string();
        assert!(
            std::process::Command::new("kill")
                .args(["-INT", &id])
                .status()
                .unwrap()
                .success()
        );
        let mut said = String::new();
        self.stderr.read_to_string(&mut said).unwrap();
        assert!(self.program.0.wait().unwrap().success(), "{said}");
        said
    }
}

/// A program of this machine that asks for the picture 300 times at once costs little memory and ends nothing.
#[test]
fn three_hundred_at_once_cost_little_memory() {
    let shown = Shown::new();
    let before = shown.memory_mb();
    let gate = std::sync::Barrier::new(300);
    let (answered, most) = (AtomicU64::new(0), AtomicU64::new(0));
    std::thread::scope(|scope| {
        for _ in 0..300 {
            scope.spawn(|| {
                gate.wait();
                let (head, body) = shown.ask("/picture.png");
                assert!(
                    head.starts_with("HTTP/1.1 200") || head.starts_with("HTTP/1.1 503"),
                    "{head}"
                );
                answered.fetch_add(u64::from(body.starts_with(b"\x89PNG")), Ordering::Relaxed);
                most.fetch_max(shown.memory_mb() as u64, Ordering::Relaxed);
            });
        }
    });
    let more = most.into_inner() as f64 - before;
    println!(
        "300 at once: {} answered with the picture, {more:.0} MB more than {before:.0}",
        answered.into_inner()
    );
    assert!(more < 50.0, "{before} MB, then {more} more");
    assert!(shown.rate(1.0) > 0.0, "pictures go on");
    shown.end();
}

/// Commands without the token change nothing, and a flood of them is one warning with their number.
#[test]
fn a_flood_of_commands_is_one_warning() {
    let shown = Shown::new();
    let mut sent = 0;
    for _ in 0..20 {
        let mut page = shown.page();
        for _ in 0..40 {
            page.send(Message::Text(r#"{"kind":"tare"}"#.into())).unwrap();
            sent += 1;
        }
        // Until all are answered.
        let mut refused = 0;
        while refused < 40 {
            if let Message::Text(text) = page.read().unwrap() {
                refused += u32::from(text.contains("rights") && text.contains("null"));
            }
        }
    }
    let said = shown.end();
    let warnings: Vec<&str> = said.lines().filter(|l| l.contains("without the token")).collect();
    let counts = warnings.iter().map(|l| {
        let words = l.split_whitespace().map(str::parse::<u64>);
        words.filter_map(Result::ok).next().unwrap()
    });
    // A machine on which it takes longer than five seconds says it again.
    assert!(counts.sum::<u64>() == sent && warnings.len() < 5, "{said}");
    assert!(!said.contains("a new baseline"), "{said}");
}

/// A page that shows the token may command.
#[test]
fn a_page_with_the_printed_token_takes_a_baseline() {
    let shown = Shown::new();
    let mut page = shown.page();
    for text in [
        json!({ "kind": "enter", "key": shown.token }),
        json!({ "kind": "tare" }),
    ] {
        page.send(Message::Text(text.to_string().into())).unwrap();
    }
    shown.until(&mut page, |status| status.contains("taking the baseline"));
    shown.end();
}

/// The figures of docs/reliability.md.
#[test]
#[ignore = "half a minute"]
fn what_askers_cost_the_live_page() {
    let shown = Shown::new();
    println!("| askers | live page, pictures/s | answers/s | memory, MB |");
    println!("|---|---|---|---|");
    for askers in [0, 6, 12, 60, 300] {
        let ((rate, memory), answers) = shown.asked(askers, || (shown.rate(5.0), shown.memory_mb()));
        println!("| {askers} | {rate:.1} | {:.0} | {memory:.0} |", answers as f64 / 5.0);
    }
    println!("afterwards: {:.0} MB", shown.memory_mb());
    shown.end();
}
