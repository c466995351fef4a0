//! The simulated board behind a serial port of the system: a pseudo-terminal, whose other end any program can open.

use crate::any_board::{AnyBoard, locked};
use crate::board::SimBoard;
use crate::ftdi::Ftdi;
use crate::port::Pace;
use crate::real_time::{Pacer, TICK};
use crate::sheet::SheetModel;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::pty::{PtyMaster, grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::termios::{LocalFlags, SetArg, cfmakeraw, tcgetattr, tcsetattr};
use std::collections::VecDeque;
use std::fs;
use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Bytes that the system holds for a reader who is slow; later ones are lost.
const READER_BYTES: usize = 1 << 16;

/// Board time that passes at most between two looks at an unpaced port, s. Longer delays the answers to commands, shorter
/// costs processor time.
const SLICE_S: f64 = 16e-3;

/// What a [`Pty`] is like.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PtyOptions {
    /// Latency timer of the adapter; the driver's own is 16 ms, and 1 ms the least.
    pub latency: Duration,
    /// A symbolic link that always points to the port.
    pub link: Option<PathBuf>,
    /// How time passes. Unpaced time passes as fast as the port is read. It stands still while the reader is behind, while
    /// nobody has the port open and while the board is idle: no byte is ever lost, however slow the machine.
    pub pace: Pace,
}

impl Default for PtyOptions {
    fn default() -> Self {
        Self {
            latency: Duration::from_millis(16),
            link: None,
            pace: Pace::RealTime,
        }
    }
}

/// A board behind a pseudo-terminal, on a thread of its own, in step with the wall clock or with its reader. Its port behaves
/// like an FT232R's: bytes from the board are lost while nobody has the port open, and the port is gone while the cable is
/// pulled. Dropping the value switches the board off.
pub struct Pty {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// Name of the port; `None` while the cable is pulled.
    path: Option<PathBuf>,
    closed: bool,
    /// The thread has ended, and why if it was no wish.
    ended: Option<Option<io::Error>>,
}

impl Pty {
    /// Powers a board up behind a new port.
    ///
    /// # Errors
    /// The system's, when there is no pseudo-terminal, the link's name is taken, or the thread cannot be started.
    pub fn start<S: SheetModel + 'static>(board: SimBoard<S>, options: PtyOptions) -> io::Result<Self> {
        let plug = Plug::new(&options)?;
        let shared = Arc::new(Shared::default());
        locked(&shared.state).path = Some(plug.path.clone());
        let for_thread = Arc::clone(&shared);
        let mut runner = Runner {
            board: Box::new(board),
            plugged: Some(0),
            plug: Some(plug),
            options,
            shared: for_thread,
        };
        let thread = std::thread::Builder::new().name("skin-pty".to_owned()).spawn(move || {
            let outcome = runner.run();
            let shared = Arc::clone(&runner.shared);
            // The link is gone before anybody is told.
            drop(runner);
            locked(&shared.state).ended = Some(outcome.err());
            shared.changed.notify_all();
        })?;
        Ok(Self {
            shared,
            thread: Some(thread),
        })
    }

    /// Name of the port, such as /dev/pts/5; `None` while the cable is pulled. It may be another one afterwards.
    pub fn path(&self) -> Option<PathBuf> {
        locked(&self.shared.state).path.clone()
    }

    /// Waits until the port's name is another than this, at most for a time, and returns the name.
    ///
    /// # Errors
    /// What ended the port, once.
    pub fn wait(&self, path: Option<&Path>, timeout: Duration) -> io::Result<Option<PathBuf>> {
        let state = locked(&self.shared.state);
        let same = |s: &mut State| s.path.as_deref() == path && s.ended.is_none();
        let (mut state, _) = self
            .shared
            .changed
            .wait_timeout_while(state, timeout, same)
            .unwrap_or_else(PoisonError::into_inner);
        match &mut state.ended {
            Some(why) => Err(why.take().unwrap_or_else(|| ErrorKind::BrokenPipe.into())),
            None => Ok(state.path.clone()),
        }
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        locked(&self.shared.state).closed = true;
        self.shared.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic over there was already printed.
            let _ = thread.join();
        }
    }
}

/// A pseudo-terminal and its link.
struct Plug {
    master: PtyMaster,
    path: PathBuf,
    link: Option<PathBuf>,
}

impl Plug {
    fn new(options: &PtyOptions) -> io::Result<Self> {
        use nix::fcntl::OFlag;
        let flags = OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC;
        let master = posix_openpt(flags)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let path = PathBuf::from(ptsname_r(&master)?);
        // Opened and closed once: from then on the system reports whether somebody has it open.
        drop(fs::OpenOptions::new().read(true).write(true).open(&path)?);
        let mut plug = Self {
            master,
            path,
            link: None,
        };
        plug.make_raw()?;
        if let Some(link) = &options.link {
            point(link, &plug.path)?;
            plug.link = Some(link.clone());
        }
        Ok(plug)
    }

    /// No echo and no line editing: a terminal without a reader would answer the board with its own bytes. The system forgets
    /// the settings with the last reader, who may have come back before anybody looked.
    fn make_raw(&self) -> io::Result<()> {
        let mut settings = tcgetattr(&self.master)?;
        if settings.local_flags.intersects(LocalFlags::ICANON | LocalFlags::ECHO) {
            cfmakeraw(&mut settings);
            tcsetattr(&self.master, SetArg::TCSANOW, &settings)?;
        }
        Ok(())
    }

    /// Whether somebody has the port open.
    fn is_open(&self) -> io::Result<bool> {
        let mut list = [PollFd::new(self.master.as_fd(), PollFlags::empty())];
        poll(&mut list, PollTimeout::ZERO)?;
        let seen = list[0].revents().unwrap_or(PollFlags::empty());
        Ok(!seen.contains(PollFlags::POLLHUP))
    }
}

impl Drop for Plug {
    fn drop(&mut self) {
        if let Some(link) = &self.link
            && fs::read_link(link).is_ok_and(|to| to == self.path)
        {
            // Somebody else may have removed it meanwhile.
            let _ = fs::remove_file(link);
        }
    }
}

/// Points a symbolic link at the port, in place of an old one but of nothing else.
fn point(link: &Path, to: &Path) -> io::Result<()> {
    match fs::symlink_metadata(link) {
        Ok(old) if old.file_type().is_symlink() => fs::remove_file(link)?,
        Ok(_) => {
            let text = format!("{}: there is a file of this name; give another --link", link.display());
            return Err(io::Error::new(ErrorKind::AlreadyExists, text));
        }
        Err(_) => {}
    }
    std::os::unix::fs::symlink(to, link)
        .map_err(|e| io::Error::new(e.kind(), format!("{}: the link cannot be made: {e}", link.display())))
}

struct Runner {
    board: Box<dyn AnyBoard>,
    plugged: Option<u32>,
    plug: Option<Plug>,
    options: PtyOptions,
    shared: Arc<Shared>,
}

impl Runner {
    fn run(&mut self) -> io::Result<()> {
        let mut pacer = Pacer::new();
        let mut ftdi = Ftdi::new(self.options.latency.as_secs_f64().max(1e-3));
        let mut for_reader = VecDeque::new();
        let mut was_open = false;
        let mut buffer = [0; 4096];
        // Whether an unpaced board has more to say.
        let mut busy = false;
        loop {
            let wait = if busy { Duration::ZERO } else { TICK };
            let (state, _) = self
                .shared
                .changed
                .wait_timeout_while(locked(&self.shared.state), wait, |s| !s.closed)
                .unwrap_or_else(PoisonError::into_inner);
            if state.closed {
                return Ok(());
            }
            drop(state);
            let mut open = false;
            if let Some(plug) = &mut self.plug {
                plug.make_raw()?;
                // First what was written, then who is there: who has written is seen, and the answer is not thrown away.
                let mut received = Vec::new();
                while let Some(count) = now(plug.master.read(&mut buffer))?.filter(|n| *n > 0) {
                    received.extend_from_slice(&buffer[..count]);
                }
                open = plug.is_open()?;
                if open && !was_open {
                    ftdi.purge();
                    for_reader.clear();
                }
                self.board.receive(&received);
            }
            was_open = open;
            match self.options.pace {
                Pace::RealTime => pacer.run(self.board.as_mut(), |time_s, bytes| {
                    for byte in bytes.drain(..) {
                        ftdi.push(time_s, byte, &mut for_reader);
                    }
                    ftdi.poll(time_s, &mut for_reader);
                }),
                // While the cable is pulled time goes on, or it would never be put back.
                Pace::Unpaced => {
                    busy = (open || self.plug.is_none())
                        && for_reader.is_empty()
                        && self.run_for_reader(&mut ftdi, &mut for_reader);
                }
            }
            if open && let Some(plug) = &mut self.plug {
                while !for_reader.is_empty() {
                    let (front, _) = for_reader.as_slices();
                    match now(plug.master.write(front))? {
                        Some(count) if count > 0 => drop(for_reader.drain(..count)),
                        _ => break,
                    }
                }
                for_reader.truncate(READER_BYTES);
            } else {
                for_reader.clear();
            }
            self.follow_cable()?;
        }
    }

    /// Lets an unpaced board run until there is something to read, but for no longer than a slice; returns whether it would go
    /// on.
    fn run_for_reader(&mut self, ftdi: &mut Ftdi, for_reader: &mut VecDeque<u8>) -> bool {
        let end_s = self.board.now_s() + SLICE_S;
        let mut bytes = VecDeque::new();
        while for_reader.is_empty() && self.board.now_s() < end_s {
            if self.plug.is_some() && ftdi.is_empty() && self.board.is_idle() {
                return false;
            }
            self.board.step(&mut bytes);
            let time_s = self.board.now_s();
            for byte in bytes.drain(..) {
                ftdi.push(time_s, byte, for_reader);
            }
            ftdi.poll(time_s, for_reader);
        }
        true
    }

    fn follow_cable(&mut self) -> io::Result<()> {
        let plugged = self.board.plugged();
        if plugged == self.plugged {
            return Ok(());
        }
        self.plugged = plugged;
        // Whoever finds the port dead must not be told its old name.
        self.tell(None);
        // What was open is dead from here on, even if the cable is back already.
        self.plug = None;
        if plugged.is_some() {
            let plug = Plug::new(&self.options)?;
            self.tell(Some(plug.path.clone()));
            self.plug = Some(plug);
        }
        Ok(())
    }

    fn tell(&self, path: Option<PathBuf>) {
        locked(&self.shared.state).path = path;
        self.shared.changed.notify_all();
    }
}

/// What can be done now; `None` for nothing, also when the last reader has just closed the port.
fn now(result: io::Result<usize>) -> io::Result<Option<usize>> {
    match result {
        Ok(count) => Ok(Some(count)),
        Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(None),
        Err(e) if e.raw_os_error() == Some(nix::errno::Errno::EIO as i32) => Ok(None),
        Err(e) => Err(e),
    }
}
