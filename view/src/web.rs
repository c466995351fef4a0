//! The live page: a small web server for this computer alone.
//!
//! The newest picture wins: publishing replaces what was waiting, and a page is sent a picture only while it has
//! credit, two pictures that it has not acknowledged yet. A slow page skips pictures and never sees old ones; it slows
//! down nobody. A page is told only the cells that changed since what it was sent last ([`Shown`]). A picture is encoded
//! when the first page wants it, once for all pages that saw the same one before.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use tokio::sync::watch;

use crate::picture::{Picture, PictureError};
use crate::shown::Shown;
use crate::web::drawn::Drawn;
use crate::web::keys::Keys;
use crate::web::refused::Refusals;
use crate::{SCALE_FLOOR, wire};

mod app;
mod connections;
mod drawn;
mod guard;
mod guide;
mod keys;
mod recording;
mod refused;
mod replay;
mod server;
mod watcher;

pub use guide::Guide;
pub use recording::Recording;
pub use replay::Replay;

/// Port unless told otherwise. Always the same, so that an open page finds the program again when it is restarted.
pub const DEFAULT_PORT: u16 = 8477;

/// Commands that may wait to be taken; more are dropped.
const WAITING_COMMANDS: usize = 16;

/// How long pages are given to part in friendship when the program stops.
const FAREWELL: Duration = Duration::from_millis(150);

/// How to serve the page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LiveOptions {
    /// Where to listen; an address of this computer alone. Port 0 takes any free one.
    pub listen: SocketAddr,
    /// Least full scale of the colours, relative rise: noise below it stays dark.
    pub floor: f32,
}

impl Default for LiveOptions {
    /// 127.0.0.1 at [`DEFAULT_PORT`], floor [`SCALE_FLOOR`].
    fn default() -> Self {
        Self {
            listen: SocketAddr::from((Ipv4Addr::LOCALHOST, DEFAULT_PORT)),
            floor: SCALE_FLOOR,
        }
    }
}

/// What a user asks for on the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Take the baseline anew: what lies on the sheet now is no touch.
    Tare,
    /// Bring back the baseline that was in force before the last one.
    UndoBaseline,
    /// Record from now on, into a file with a name of its own.
    StartRecording,
    /// Close the recording.
    StopRecording,
    /// Press the last mark of a guided calibration once more.
    RepeatPress,
    /// Leave out the mark that is to be pressed.
    SkipPress,
    /// Show what a recording holds from this time on, ms after its first step.
    Seek {
        /// The time.
        at_ms: u64,
    },
    /// Let a replay stand still.
    Pause,
    /// Let it go on.
    Play,
}

/// A running server. Dropping it closes the pages' connections and ends its thread, within a second.
pub struct LiveView {
    shared: Arc<Shared>,
    commands: Mutex<Receiver<Command>>,
    server: Arc<Server>,
}

/// The thread that serves, for all pages that share it.
struct Server {
    address: SocketAddr,
    stop: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

/// What the publisher and the connections share.
struct Shared {
    /// The skin's, where there are several.
    name: Option<String>,
    started: Instant,
    floor: f32,
    latest: watch::Sender<Option<Published>>,
    recording: watch::Sender<Recording>,
    guide: watch::Sender<Guide>,
    /// None of a board that is there.
    replay: watch::Sender<Option<Replay>>,
    clients: AtomicUsize,
    encoded: AtomicUsize,
    commands: SyncSender<Command>,
    keys: Arc<Keys>,
    refused: Arc<Refusals>,
    drawn: Drawn,
}

/// The picture published last, and its messages once somebody wants them.
struct Published {
    picture: Arc<Picture>,
    shown: Shown,
    scene: u32,
    published_ms: f64,
    /// The frames for pages that saw these pictures last.
    frames: Mutex<Vec<(u64, Bytes)>>,
}

impl Published {
    fn new(picture: Arc<Picture>, scene: u32, published_ms: f64, floor: f32) -> Self {
        let mut shown = Shown::new(&picture.grid, floor);
        shown.take(&picture, 1);
        Self {
            picture,
            shown,
            scene,
            published_ms,
            frames: Mutex::default(),
        }
    }

    /// Replaces the picture by the next of the same scene.
    fn replace(&mut self, picture: Arc<Picture>, published_ms: f64) {
        self.shown.take(&picture, self.shown.number() + 1);
        self.picture = picture;
        self.published_ms = published_ms;
        self.frames.get_mut().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// The frame for a page that saw picture `base` of this scene last.
    fn frame(&self, base: u64, encoded: &AtomicUsize) -> Bytes {
        let mut frames = self.frames.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, frame)) = frames.iter().find(|(b, _)| *b == base) {
            return frame.clone();
        }
        encoded.fetch_add(1, Ordering::Relaxed);
        let frame = Bytes::from(wire::encode(
            &self.picture,
            &self.shown,
            self.scene,
            self.published_ms,
            base,
        ));
        frames.push((base, frame.clone()));
        frame
    }
}

impl Shared {
    fn now_ms(&self) -> f64 {
        self.started.elapsed().as_secs_f64() * 1e3
    }
}

impl LiveView {
    /// Starts to serve, on a thread of its own.
    ///
    /// # Errors
    /// `InvalidInput` if the address can be reached from other computers, `AddrInUse` if the port is taken, and whatever
    /// the system says to a new thread. The message says what to do.
    pub fn start(options: LiveOptions) -> io::Result<Self> {
        let mut pages = Self::start_pages(options, &[None])?;
        pages.pop().ok_or_else(|| io::Error::other("no page"))
    }

    /// Starts to serve the pages of several skins, by name, at one address: a row of names switches between them. One token is for all.
    /// The server ends with the last of them.
    ///
    /// # Errors
    /// As [`LiveView::start`]; `InvalidInput` if a name is none ([`is_name`]) or comes twice.
    pub fn start_named(options: LiveOptions, names: &[&str]) -> io::Result<Vec<Self>> {
        let wrong = names
            .iter()
            .enumerate()
            .find(|(k, name)| !is_name(name) || names[..*k].contains(name));
        if let Some((_, name)) = wrong {
            let text = format!("{name:?}: skins are told apart by names of letters, digits, - and _");
            return Err(io::Error::new(io::ErrorKind::InvalidInput, text));
        }
        let names: Vec<Option<String>> = names.iter().map(|name| Some((*name).to_owned())).collect();
        Self::start_pages(options, &names)
    }

    fn start_pages(options: LiveOptions, names: &[Option<String>]) -> io::Result<Vec<Self>> {
        let listen = options.listen;
        if !listen.ip().is_loopback() {
            let text = format!(
                "the page can command the board and is served to this computer alone, not on {listen}; listen on 127.0.0.1 and, \
                 from elsewhere, use `ssh -L {port}:127.0.0.1:{port}`",
                port = listen.port()
            );
            return Err(io::Error::new(io::ErrorKind::InvalidInput, text));
        }
        let listener = TcpListener::bind(listen).map_err(|e| explained(e, listen))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            // One drawing at a time.
            .max_blocking_threads(1)
            .build()?;
        let keys = Arc::new(Keys::new()?);
        let refused = Arc::default();
        let started = Instant::now();
        let mut receivers = Vec::new();
        let pages: Arc<[Arc<Shared>]> = names
            .iter()
            .map(|name| {
                let (commands, receiver) = sync_channel(WAITING_COMMANDS);
                receivers.push(Mutex::new(receiver));
                Arc::new(Shared {
                    name: name.clone(),
                    started,
                    floor: options.floor,
                    latest: watch::Sender::new(None),
                    recording: watch::Sender::default(),
                    guide: watch::Sender::default(),
                    replay: watch::Sender::new(None),
                    clients: AtomicUsize::new(0),
                    encoded: AtomicUsize::new(0),
                    commands,
                    keys: Arc::clone(&keys),
                    refused: Arc::clone(&refused),
                    drawn: Drawn::default(),
                })
            })
            .collect();
        let (stop, stopped) = watch::channel(false);
        let serve = {
            let pages = Arc::clone(&pages);
            move || {
                if let Err(error) = runtime.block_on(server::serve(listener, pages, stopped)) {
                    tracing::error!("the live page has stopped: {error}");
                }
                runtime.shutdown_timeout(FAREWELL);
            }
        };
        let thread = std::thread::Builder::new().name("live page".into()).spawn(serve)?;
        let server = Arc::new(Server {
            address,
            stop,
            thread: Some(thread),
        });
        let views = pages.iter().zip(receivers).map(|(shared, commands)| Self {
            shared: Arc::clone(shared),
            commands,
            server: Arc::clone(&server),
        });
        Ok(views.collect())
    }

    /// Where the page is, with the token that lets it command: `http://127.0.0.1:8477/#4f1c...`. For the user's eyes.
    pub fn url(&self) -> String {
        format!("http://{}/#{}", self.server.address, self.shared.keys.token())
    }

    /// The same with a ticket in place of the token: only the first page that opens it may command. For what opens a browser, since all
    /// users of a computer see the arguments of its programs.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub fn url_once(&self) -> io::Result<String> {
        Ok(format!(
            "http://{}/#{}",
            self.server.address,
            self.shared.keys.new_ticket()?
        ))
    }

    /// Shows a picture. Never waits for a page; a picture that no page has taken yet is replaced.
    ///
    /// # Errors
    /// [`PictureError`] if the picture's parts do not fit together; the one before stays.
    pub fn publish(&self, picture: impl Into<Arc<Picture>>) -> Result<(), PictureError> {
        let picture = picture.into();
        picture.check()?;
        let published_ms = self.shared.now_ms();
        self.shared.latest.send_modify(|latest| match latest {
            Some(l) if same_scene(&l.picture, &picture) => l.replace(picture, published_ms),
            l => {
                let scene = l.as_ref().map_or(1, |l| l.scene + 1);
                *l = Some(Published::new(picture, scene, published_ms, self.shared.floor));
            }
        });
        Ok(())
    }

    /// Tells the pages what is recorded, where that is news. Never waits.
    pub fn set_recording(&self, recording: Recording) {
        self.shared.recording.send_if_modified(|now| {
            let news = *now != recording;
            *now = recording;
            news
        });
    }

    /// Tells the pages where to press next, where that is news. Never waits.
    pub fn set_guide(&self, guide: Guide) {
        self.shared.guide.send_if_modified(|now| {
            let news = *now != guide;
            *now = guide;
            news
        });
    }

    /// Tells the pages where a replay is, where that is news. Never waits.
    pub fn set_replay(&self, replay: Replay) {
        self.shared.replay.send_if_modified(|now| {
            let news = *now != Some(replay);
            *now = Some(replay);
            news
        });
    }

    /// Pages that are connected now.
    pub fn clients(&self) -> usize {
        self.shared.clients.load(Ordering::Relaxed)
    }

    /// The next command from a page, if one waits. Never blocks.
    pub fn command(&self) -> Option<Command> {
        self.commands
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .try_recv()
            .ok()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop.send_replace(true);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread of the live page ended badly");
        }
    }
}

/// Whether a text can be a skin's name: 1 to 32 letters, digits, - and _ of ASCII.
pub fn is_name(name: &str) -> bool {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b == b'-' || b == b'_';
    (1..=32).contains(&name.len()) && name.bytes().all(plain)
}

/// Whether two pictures differ only in what a frame carries. The shared parts are compared by address first.
fn same_scene(a: &Picture, b: &Picture) -> bool {
    fn same<T: PartialEq>(a: &Arc<T>, b: &Arc<T>) -> bool {
        Arc::ptr_eq(a, b) || a == b
    }
    let sheet = same(&a.outline_mm, &b.outline_mm) && same(&a.electrodes_mm, &b.electrodes_mm);
    let stats =
        a.stats.source == b.stats.source && a.stats.baseline == b.stats.baseline && a.stats.away == b.stats.away;
    let stats = stats && a.stats.preparing == b.stats.preparing;
    let marks = a.stats.faulty == b.stats.faulty && a.stats.uncalibrated == b.stats.uncalibrated;
    sheet && same(&a.grid, &b.grid) && stats && marks
}

/// The system's error with what to do about it.
fn explained(error: io::Error, listen: SocketAddr) -> io::Error {
    let what = match error.kind() {
        io::ErrorKind::AddrInUse => {
            "another program has this port, perhaps another `skin`: end it, or take another port (0 = any free one)"
        }
        io::ErrorKind::PermissionDenied => "ports below 1024 are for the system: take a higher one (0 = any free one)",
        io::ErrorKind::AddrNotAvailable => "this computer does not have that address: use 127.0.0.1",
        _ => "try another port (0 = any free one)",
    };
    io::Error::new(
        error.kind(),
        format!("cannot serve the live page on {listen} ({error}); {what}"),
    )
}

#[cfg(test)]
#[path = "web/tests.rs"]
mod tests;
