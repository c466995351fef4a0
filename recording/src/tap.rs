//! Between a port and the link: a copy of every byte into the recorder's queue, without ever waiting for it.

use crate::clock::HostClock;
use crate::topic::Topic;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use protocol::{Command, EncodeError, FromBoard, Hello, MAX_FROM_BOARD_LEN, Plan, encode};
use serde::Serialize;
use serde_json::json;
use std::io::{self, Read, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Items that may wait for the recorder. A board of 115 frames/s makes up to 1000 a second: 8 s of a disk that does not answer.
const WAITING: usize = 8192;

/// Makes a message on the recorder's thread; none where it cannot.
pub type Later = Box<dyn FnOnce() -> Option<Vec<u8>> + Send>;

pub(crate) enum Data {
    Now(Vec<u8>),
    Later(Later),
}

pub(crate) enum Item {
    /// Bytes that come from now on are another port's.
    Port {
        at: Instant,
    },
    Bytes {
        at: Instant,
        from_board: bool,
        bytes: Vec<u8>,
        /// Bytes before these are missing.
        torn: bool,
    },
    Message {
        at: Instant,
        topic: Topic,
        /// The board's time of the frame that it is of, s.
        frame_s: Option<f64>,
        data: Data,
    },
    End,
}

/// The number of a frame, or one above all numbers.
#[derive(Debug)]
pub(crate) struct FirstFrame(AtomicU64);

impl Default for FirstFrame {
    fn default() -> Self {
        Self(AtomicU64::new(u64::MAX))
    }
}

impl FirstFrame {
    /// Takes note of a frame, if it is the first.
    pub(crate) fn see(&self, sequence: u32) {
        let _ = self
            .0
            .compare_exchange(u64::MAX, sequence.into(), Ordering::AcqRel, Ordering::Relaxed);
    }

    fn get(&self) -> Option<u32> {
        u32::try_from(self.0.load(Ordering::Acquire)).ok()
    }
}

/// What taps and recorder share.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    pub(crate) clock: HostClock,
    pub(crate) lost_messages: AtomicU64,
    pub(crate) lost_bytes: AtomicU64,
    pub(crate) messages: AtomicU64,
    pub(crate) frames: AtomicU64,
    pub(crate) file_bytes: AtomicU64,
    /// The board's number of the first frame; above all numbers before it.
    pub(crate) first_frame: FirstFrame,
    /// Why nothing is recorded any more.
    pub(crate) failed: Mutex<Option<String>>,
    /// Whether the file is closed.
    pub(crate) closed: AtomicBool,
    /// A file that was made, and into which nothing is recorded yet. Whoever takes it begins it or removes it.
    pub(crate) fresh: Mutex<Option<String>>,
}

/// Hands to the recorder what there is to record. Clones are the same tap. It never waits: what finds the queue full is lost, and
/// counted.
#[derive(Clone)]
pub struct Tap {
    queue: SyncSender<(Skin, Item)>,
    pub(crate) shared: Arc<Shared>,
    /// Bytes of the board and of the host were lost since the last that were queued.
    torn: Arc<[AtomicBool; 2]>,
    skin: Skin,
}

/// The name of a skin, of several; none where there is one.
pub(crate) type Skin = Option<Arc<str>>;

/// The recorder's end of the queue.
pub(crate) struct Queue {
    pub(crate) items: Receiver<(Skin, Item)>,
    pub(crate) tap: Tap,
}

/// How serious what is said is, as in `foxglove.Log`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Level {
    Info = 2,
    Warning = 3,
}

/// The bytes of a picture in a message of [`Topic::Picture`]; none where the text is none of base64.
pub fn from_base64(text: &str) -> Option<Vec<u8>> {
    BASE64_STANDARD.decode(text).ok()
}

/// Where a sheet is for viewers.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// The frame that the place is given in.
    pub frame: String,
    /// The sheet's centre, m.
    pub position_m: [f64; 3],
    /// The turn as a quaternion: x, y, z, w.
    pub orientation: [f64; 4],
}

impl Default for Pose {
    /// A frame of the sheet's own.
    fn default() -> Self {
        Self {
            frame: "sheet".to_owned(),
            position_m: [0.0; 3],
            orientation: [0.0, 0.0, 0.0, 1.0],
        }
    }
}

impl Tap {
    pub(crate) fn new() -> (Self, Queue) {
        Self::holding(WAITING)
    }

    /// With a queue of so many items.
    pub(crate) fn holding(items: usize) -> (Self, Queue) {
        let (queue, items) = sync_channel(items);
        let tap = Self {
            queue,
            shared: Arc::default(),
            torn: Arc::default(),
            skin: None,
        };
        (tap.clone(), Queue { items, tap })
    }

    /// A tap into the same recording for one skin of several. Its topics begin with the skin's name.
    pub fn named(&self, skin: &str) -> Self {
        Self {
            torn: Arc::default(),
            skin: Some(skin.into()),
            ..self.clone()
        }
    }

    /// A port whose bytes are recorded, both ways. What came by the ports before is forgotten where the recording has not begun.
    pub fn port<P>(&self, port: P) -> Tapped<P> {
        self.opened();
        Tapped {
            port,
            tap: self.clone(),
        }
    }

    /// Bytes from now on come by another port.
    pub(crate) fn opened(&self) {
        self.give(Item::Port { at: Instant::now() });
    }

    /// Begins a recording of a board that streams already: it is told who the board is and what it measures, in the words of the
    /// board. What comes next may be the rest of a message, which is left out.
    ///
    /// # Errors
    /// The messages do not fit into the wire's format, which those of a board do.
    pub fn introduce(&self, hello: &Hello, plan: &Plan) -> Result<(), EncodeError> {
        self.opened();
        let said = [
            FromBoard::Hello(hello.clone()),
            FromBoard::Plan(plan.clone()),
            FromBoard::Ack(Command::Start),
        ];
        for message in &said {
            self.bytes(true, encode(message, &mut [0; MAX_FROM_BOARD_LEN])?);
        }
        self.torn.iter().for_each(|torn| torn.store(true, Ordering::Relaxed));
        Ok(())
    }

    /// Whether this frame of the board is in the recording, or would be if it came: those before the first are not.
    pub fn has(&self, sequence: u32) -> bool {
        let first = self.shared.first_frame.get();
        first.is_some_and(|first| sequence.wrapping_sub(first) < u32::MAX / 2)
    }

    /// Records a message; `frame_s` is the board's time of the frame that it is of, s.
    pub fn put(&self, topic: Topic, frame_s: Option<f64>, message: &impl Serialize) {
        match serde_json::to_vec(message) {
            Ok(text) => self.message(topic, frame_s, Data::Now(text)),
            Err(e) => tracing::error!("a message for {}: {e}", topic.name()),
        }
    }

    /// Records a text that the program said.
    pub fn said(&self, text: &str) {
        let level = if text.starts_with("warning") {
            Level::Warning
        } else {
            Level::Info
        };
        let message = json!({
            "timestamp": self.timestamp(),
            "level": level as u8,
            "message": text,
            "name": "skin",
            "file": "",
            "line": 0,
        });
        self.put(Topic::Log, None, &message);
    }

    /// Records a picture as a PNG file, which is made on the recorder's thread.
    pub fn picture(&self, frame_s: f64, png: impl FnOnce() -> Option<Vec<u8>> + Send + 'static) {
        let timestamp = self.timestamp();
        let make = move || {
            let message = json!({
                "timestamp": timestamp,
                "frame_id": "sheet",
                "data": BASE64_STANDARD.encode(png()?),
                "format": "png",
            });
            serde_json::to_vec(&message).ok()
        };
        self.message(Topic::Picture, Some(frame_s), Data::Later(Box::new(make)));
    }

    /// Records points for viewers: x and y in mm, rise, force in N, on a sheet with this place.
    pub fn points(&self, frame_s: f64, points: &[[f32; 4]], pose: &Pose) {
        let bytes: Vec<u8> = points
            .iter()
            .flat_map(|[x, y, rise, force]| [1e-3 * x, 1e-3 * y, 0.0, *rise, *force])
            .flat_map(f32::to_le_bytes)
            .collect();
        let fields: Vec<_> = ["x", "y", "z", "rise", "force"]
            .iter()
            .enumerate()
            .map(|(k, name)| json!({"name": name, "offset": 4 * k, "type": 7}))
            .collect();
        let ([px, py, pz], [x, y, z, w]) = (pose.position_m, pose.orientation);
        let message = json!({
            "timestamp": self.timestamp(),
            "frame_id": pose.frame,
            "pose": {"position": {"x": px, "y": py, "z": pz}, "orientation": {"x": x, "y": y, "z": z, "w": w}},
            "point_stride": 20,
            "fields": fields,
            "data": BASE64_STANDARD.encode(bytes),
        });
        self.put(Topic::Points, Some(frame_s), &message);
    }

    /// The clock of the recording.
    pub fn clock(&self) -> HostClock {
        self.shared.clock
    }

    fn timestamp(&self) -> serde_json::Value {
        let ns = self.shared.clock.unix_ns(Instant::now());
        json!({"sec": ns / 1_000_000_000, "nsec": ns % 1_000_000_000})
    }

    fn message(&self, topic: Topic, frame_s: Option<f64>, data: Data) {
        let at = Instant::now();
        let item = Item::Message {
            at,
            topic,
            frame_s,
            data,
        };
        if !self.give(item) {
            self.shared.lost_messages.fetch_add(1, Ordering::Relaxed);
        }
    }

    pub(crate) fn bytes(&self, from_board: bool, bytes: &[u8]) {
        let before = &self.torn[usize::from(from_board)];
        let torn = before.swap(false, Ordering::Relaxed);
        let item = Item::Bytes {
            at: Instant::now(),
            from_board,
            bytes: bytes.to_vec(),
            torn,
        };
        if !self.give(item) {
            before.store(true, Ordering::Relaxed);
            self.shared.lost_bytes.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        }
    }

    /// Whether it was queued. A recorder that has ended takes nothing, and nothing is lost by that.
    fn give(&self, item: Item) -> bool {
        !matches!(
            self.queue.try_send((self.skin.clone(), item)),
            Err(TrySendError::Full(_))
        )
    }

    /// Asks for the end without waiting for a place; whether it has one.
    pub(crate) fn try_end(&self) -> bool {
        self.give(Item::End)
    }

    /// Waits for its place in the queue.
    pub(crate) fn end(&self) {
        // The thread may have ended by itself.
        let _ = self.queue.send((None, Item::End));
    }
}

/// A port whose bytes are recorded.
pub struct Tapped<P> {
    port: P,
    tap: Tap,
}

impl<P: Read> Read for Tapped<P> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.port.read(buffer)?;
        if count > 0 {
            self.tap.bytes(true, &buffer[..count]);
        }
        Ok(count)
    }
}

impl<P: Write> Write for Tapped<P> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.port.write(bytes)?;
        self.tap.bytes(false, &bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.port.flush()
    }
}
