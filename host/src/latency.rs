//! `skin bench latency`: how long a contact takes to a line of JSON and to the page, part by part.
//!
//! The board is simulated beforehand, and its frames come at their times ([`ahead`]). From its port on everything is that of `skin run
//! --every-frame`: link, reconstruction, events, JSON through a pipe, the page through a socket. The board's parts are exact, in its own
//! time. The rest is measured by the clock of this machine. A browser draws a message with its next refresh; that is not part of it.

use self::ahead::{Ahead, BITS};
use crate::json_lines::{self, Beside};
use crate::progress::Progress;
use crate::run_session::imager;
use anyhow::{Context, Result, bail};
use hil_sim::{Key, Pace, SceneFile, Shape, SimPort, Touch};
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::pipeline::FrameResult;
use inverse::touches::gestures::{Gesture, GestureOptions, Gestures};
use link::plans::live_plan;
use link::ports::BAUD;
use link::{Port, Session};
use serde::Serialize;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use view::picture::Stats;
use view::surface::Surface;
use view::web::{LiveOptions as PageOptions, LiveView};

mod ahead;

/// Contacts that are measured.
const CONTACTS: usize = 40;
/// From one contact to the next, s: no whole number of frames, so that contacts fall anywhere into one.
const EVERY_S: f64 = 0.437;
/// How long a contact lasts, s, its rise and fall included.
const HELD_S: f64 = 0.2;
/// In which the force rises, s: that of a tap in a scene.
const RISE_S: f64 = 0.015;
const FORCE_N: f64 = 15.0;
/// Places of the contacts, in turn, mm.
const PLACES_MM: [[f64; 2]; 4] = [[30.0, 10.0], [-45.0, 30.0], [0.0, -50.0], [-20.0, -10.0]];

/// A part of the way, over all contacts, ms.
#[derive(Debug, Serialize)]
pub(crate) struct Row {
    pub(crate) part: &'static str,
    /// Whether it is the whole way.
    #[serde(skip)]
    pub(crate) is_whole: bool,
    pub(crate) median_ms: f64,
    pub(crate) p95_ms: f64,
    pub(crate) most_ms: f64,
}

/// What was measured.
pub(crate) struct Measured {
    pub(crate) contacts: usize,
    pub(crate) frames_per_s: f64,
    pub(crate) rows: Vec<Row>,
}

/// A frame that a contact is measured by.
#[derive(Clone)]
struct Shown {
    sequence: u32,
    time_s: f64,
    /// When its last byte was read, it was decoded, it was reconstructed.
    read: Instant,
    decoded: Instant,
    solved: Instant,
}

/// The frames that show a contact first: as a touch, and as an event.
#[derive(Default)]
struct Seen {
    touch: Option<Shown>,
    event: Option<Shown>,
}

/// When a message arrived, by the number of its frame.
type Arrivals = Receiver<(u32, Instant)>;

/// A port that knows when something was read from it last.
struct Clocked(Box<dyn Port>, Arc<Mutex<Instant>>);

impl Read for Clocked {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let read = self.0.read(buffer)?;
        *self.1.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
        Ok(read)
    }
}

impl Write for Clocked {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

/// What the board measured before is for the baseline, s.
const BEGIN_S: f64 = 2.0;

/// When the force of a contact begins, s of the board's time.
fn contact_s(k: usize) -> f64 {
    BEGIN_S + 0.5 + EVERY_S * k as f64
}

/// Fingers that come down at the contacts' times, on rubber that does not creep and is looked at every 2 ms.
fn scene(seed: u64) -> Result<SceneFile> {
    let touch = |k: usize| {
        let [x_mm, y_mm] = PLACES_MM[k % PLACES_MM.len()];
        let key = |after_s: f64, force_n: f64| Key::new(contact_s(k) + after_s, x_mm, y_mm, force_n);
        let keys = vec![
            key(0.0, 0.0),
            key(RISE_S, FORCE_N),
            key(HELD_S - RISE_S, FORCE_N),
            key(HELD_S, 0.0),
        ];
        Touch::new(Shape::Finger, 6.75, keys)
    };
    let text = format!(
        "duration_s = {}\n[material]\nkind = \"elastic\"\n[board]\nlook_s = 0.002\n",
        contact_s(CONTACTS)
    );
    let mut file = SceneFile::parse(&text, None)?;
    file.scene.touches = (0..CONTACTS).map(touch).collect();
    file.config.electronics.seed = seed;
    Ok(file)
}

/// Runs the skin for as long as the contacts take.
///
/// # Errors
/// The simulated skin, its sheet or the page do not start.
pub(crate) fn measure(seed: u64) -> Result<Measured> {
    let scene = scene(seed)?;
    let board = SimPort::new(scene.board()?, Pace::Unpaced).context("the simulated skin does not start")?;
    let port = Ahead::new(board, BEGIN_S, scene.duration_s);
    let begin = port.beginning();
    let last_read = Arc::new(Mutex::new(Instant::now()));
    let session = Session::start(Box::new(Clocked(Box::new(port), Arc::clone(&last_read))), live_plan)?;
    let frame_s = session.frame_s();
    // As `skin run` has it: pictures are made where an output wants them.
    let options = LiveOptions {
        picture_s: f64::INFINITY,
        ..LiveOptions::default()
    };
    let mut live = Live::new(imager(&session, &scene.sheet, &[])?, options);
    let mut gestures = Gestures::new(GestureOptions::default());
    let page = LiveView::start(PageOptions {
        listen: ([127, 0, 0, 1], 0).into(),
        ..PageOptions::default()
    })?;
    let (on_page, (mut to_json, on_json)) = (watch_page(&page)?, watch_json()?);
    let progress = Progress::new("contacts");
    let mut seen: Vec<Seen> = (0..CONTACTS).map(|_| Seen::default()).collect();
    // Least time from a frame's end to the arrival of its last byte: how the two clocks go.
    let mut offsets = Vec::new();
    let began = Instant::now();
    loop {
        let Some(frame) = session.frame(Duration::from_millis(100))? else {
            session.check_silence(Duration::from_secs(10))?;
            continue;
        };
        let decoded = Instant::now();
        let read = *last_read.lock().unwrap_or_else(PoisonError::into_inner);
        let imager = Arc::clone(live.imager());
        let result = match live.frame(frame.time_s, &frame.values_v)? {
            LiveFrame::Baseline { left, .. } => {
                if left == 0 {
                    // No frame is passed over: what a busy machine adds is its own part, and the board's stays exact.
                    begin.begin();
                }
                continue;
            }
            LiveFrame::Picture(result) => result,
        };
        let solved = Instant::now();
        if frame.time_s < BEGIN_S {
            continue;
        }
        offsets.push(read.duration_since(began).as_secs_f64() - frame.time_s);
        let events = gestures.update(frame.time_s, &result.touches).to_vec();
        let beside = Beside {
            cells: false,
            events: &events,
            unix_s: 0.0,
            baseline: None,
            line: None,
            left_out: &[],
            place: None,
        };
        to_json.write_all(&json_lines::picture(
            result,
            &frame,
            session.link().counters(),
            &beside,
        )?)?;
        let contact = events.iter().any(|e| e.event == Gesture::Contact);
        let shown = Shown {
            sequence: frame.sequence,
            time_s: frame.time_s,
            read,
            decoded,
            solved,
        };
        note(&mut seen, &shown, result, contact, frame_s);
        let result = if Surface::is_smoothed(result) {
            live.picture()
        } else {
            Some(result)
        };
        let result = result.context("there is no baseline")?;
        let picture = Surface::of(&imager)?.picture(result, frame.sequence.into(), frame.time_s, Stats::default());
        page.publish(picture)?;
        progress.at(((frame.time_s - BEGIN_S) / EVERY_S) as usize, CONTACTS);
        // Frames end with the simulated time.
        if frame.time_s + 2.0 * frame_s > scene.duration_s {
            break;
        }
    }
    drop(progress);
    let counters = session.link().counters();
    let wire_s = counters.bytes as f64 / counters.frames as f64 * BITS / f64::from(BAUD);
    let least = offsets.iter().copied().fold(f64::INFINITY, f64::min);
    let expected = |shown: &Shown| began + Duration::from_secs_f64((shown.time_s + least).max(0.0));
    // Arrivals end with their writers.
    drop((page, to_json));
    let rows = rows(&seen, frame_s, wire_s, &expected, [&on_json, &on_page])?;
    Ok(Measured {
        contacts: CONTACTS,
        frames_per_s: frame_s.recip(),
        rows,
    })
}

/// Keeps the frames that show a contact first.
fn note(seen: &mut [Seen], shown: &Shown, result: &FrameResult, contact: bool, frame_s: f64) {
    for (k, seen) in seen.iter_mut().enumerate() {
        // A frame that ends after the contact, while it lasts.
        if !(contact_s(k) - frame_s..contact_s(k) + HELD_S).contains(&shown.time_s) {
            continue;
        }
        let [x, y] = PLACES_MM[k % PLACES_MM.len()];
        if result.touches.iter().any(|t| (t.x_mm - x).hypot(t.y_mm - y) < 15.0) {
            seen.touch.get_or_insert_with(|| shown.clone());
        }
        if contact {
            seen.event.get_or_insert_with(|| shown.clone());
        }
    }
}

/// The parts of a contact's way, and its sums.
const PARTS: [(&str, bool); 10] = [
    ("contact to the end of the first frame that shows it", false),
    ("sent at 1 Mbit/s", false),
    ("the frame came late by, in no sum", false),
    ("decoded", false),
    ("reconstructed", false),
    ("JSON line made and read", false),
    ("page's message made and read", false),
    ("contact to JSON line", true),
    ("contact to page", true),
    ("contact to its event in JSON", true),
];

/// Parts and sums of the contacts' ways.
fn rows(
    seen: &[Seen],
    frame_s: f64,
    wire_s: f64,
    expected: &dyn Fn(&Shown) -> Instant,
    arrivals: [&Arrivals; 2],
) -> Result<Vec<Row>> {
    let [on_json, on_page]: [Vec<(u32, Instant)>; 2] = arrivals.map(|a| a.try_iter().collect());
    let arrived = |at: &[(u32, Instant)], shown: &Shown| {
        let found = at.iter().find(|(sequence, _)| *sequence == shown.sequence);
        found.map(|(_, at)| *at)
    };
    let mut parts: [Vec<f64>; PARTS.len()] = Default::default();
    for (k, seen) in seen.iter().enumerate() {
        let (Some(touch), Some(event)) = (&seen.touch, &seen.event) else {
            bail!("contact {k} was not seen: this machine could not keep up with the board");
        };
        let board_s = |shown: &Shown| shown.time_s + frame_s - contact_s(k);
        // That this machine woke late is no part of the way.
        let whole_s = |shown: &Shown, at: Instant| board_s(shown) + wire_s + since(shown.read, at);
        // A page that is slower than the frames is given the newest one only: then the way of this one is not known.
        let (json, page) = (arrived(&on_json, touch), arrived(&on_page, touch));
        let values = [
            Some(board_s(touch)),
            Some(wire_s),
            Some(since(expected(touch), touch.read)),
            Some(since(touch.read, touch.decoded)),
            Some(since(touch.decoded, touch.solved)),
            json.map(|json| since(touch.solved, json)),
            page.map(|page| since(touch.solved, page)),
            json.map(|json| whole_s(touch, json)),
            page.map(|page| whole_s(touch, page)),
            arrived(&on_json, event).map(|told| whole_s(event, told)),
        ];
        for (part, value) in parts.iter_mut().zip(values) {
            part.extend(value);
        }
    }
    let pairs = PARTS.into_iter().zip(parts);
    Ok(pairs
        .filter(|(_, values)| !values.is_empty())
        .map(|((part, is_whole), values)| row(part, is_whole, &values))
        .collect())
}

fn row(part: &'static str, is_whole: bool, values: &[f64]) -> Row {
    let [median_ms, p95_ms, most_ms] = [0.5, 0.95, 1.0].map(|q| 1e3 * studies::quantile(values, q));
    Row {
        part,
        is_whole,
        median_ms,
        p95_ms,
        most_ms,
    }
}

/// Time from one moment to a later one, s; 0 where it is not later.
fn since(from: Instant, to: Instant) -> f64 {
    to.saturating_duration_since(from).as_secs_f64()
}

/// A reader of JSON lines behind a pipe.
fn watch_json() -> Result<(std::io::PipeWriter, Arrivals)> {
    let (reader, writer) = std::io::pipe()?;
    let (tell, arrivals) = channel();
    std::thread::Builder::new().name("json".to_owned()).spawn(move || {
        for line in BufReader::new(reader).lines().map_while(Result::ok) {
            let at = Instant::now();
            let frame = serde_json::from_str::<serde_json::Value>(&line)
                .ok()
                .and_then(|l| l["frame"].as_u64());
            if frame
                .and_then(|f| u32::try_from(f).ok())
                .is_none_or(|frame| tell.send((frame, at)).is_err())
            {
                return;
            }
        }
    })?;
    Ok((writer, arrivals))
}

/// A page that takes every message at once: a WebSocket's client (RFC 6455), as far as the page's messages need one.
fn watch_page(page: &LiveView) -> Result<Arrivals> {
    let url = page.url();
    // Without the token: who watches needs none.
    let after = url.trim_start_matches("http://");
    let address = after.split_once('/').map_or(after, |(address, _)| address);
    let mut stream = TcpStream::connect(address)?;
    stream.set_nodelay(true)?;
    write!(
        stream,
        "GET /live HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    )?;
    let mut reader = BufReader::new(stream.try_clone()?);
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") && reader.read_line(&mut head)? > 0 {}
    if !head.starts_with("HTTP/1.1 101") {
        bail!("the page does not answer: {}", head.lines().next().unwrap_or_default());
    }
    let (tell, arrivals) = channel();
    std::thread::Builder::new().name("page".to_owned()).spawn(move || {
        while let Ok((is_picture, message)) = message(&mut reader) {
            let at = Instant::now();
            let sequence = message
                .get(8..12)
                .and_then(|b| b.try_into().ok())
                .map(u32::from_le_bytes);
            let Some(sequence) = sequence.filter(|_| is_picture) else {
                continue;
            };
            // One byte, masked by zeros: it was taken.
            if tell.send((sequence, at)).is_err() || stream.write_all(&[0x82, 0x81, 0, 0, 0, 0, 1]).is_err() {
                return;
            }
        }
    })?;
    Ok(arrivals)
}

/// A message of the server, which is never in pieces; whether it is a picture.
fn message(reader: &mut impl Read) -> std::io::Result<(bool, Vec<u8>)> {
    let mut head = [0; 2];
    reader.read_exact(&mut head)?;
    let length = match head[1] & 0x7f {
        126 => {
            let mut length = [0; 2];
            reader.read_exact(&mut length)?;
            u64::from(u16::from_be_bytes(length))
        }
        127 => {
            let mut length = [0; 8];
            reader.read_exact(&mut length)?;
            u64::from_be_bytes(length)
        }
        short => u64::from(short),
    };
    let mut message = Vec::new();
    reader.take(length).read_to_end(&mut message)?;
    Ok((head[0] & 0x0f == 2, message))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_watched_at_the_address_that_it_prints() {
        let options = PageOptions {
            listen: ([127, 0, 0, 1], 0).into(),
            ..PageOptions::default()
        };
        let page = LiveView::start(options).unwrap();
        let _arrivals = watch_page(&page).unwrap();
        // The answer came, and the page is counted soon.
        let begin = Instant::now();
        while page.clients() == 0 {
            assert!(begin.elapsed() < Duration::from_secs(30));
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}
