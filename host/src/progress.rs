//! How far a long table is, on stderr.

use crate::say::is_terminal;
use std::io::Write;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Nothing is said of what takes less.
const PATIENCE: Duration = Duration::from_secs(2);
/// Time between two lines of a log; on a terminal one line is written over every [`PATIENCE`].
const LOG_EVERY: Duration = Duration::from_secs(10);

/// Says how much of a work is done, once the work has taken two seconds.
pub(crate) struct Progress {
    what: &'static str,
    silent: bool,
    terminal: bool,
    started: Instant,
    said: Option<Instant>,
}

impl Progress {
    /// Of a work that begins now; `what` is its name. A silent one never says anything.
    pub(crate) fn new(what: &'static str, silent: bool) -> Self {
        Self {
            what,
            silent,
            terminal: is_terminal(&std::io::stderr()),
            started: Instant::now(),
            said: None,
        }
    }

    /// For a work that says itself how much of the whole is done.
    pub(crate) fn told(mut self) -> impl FnMut(usize, usize) {
        move |done, whole| self.at(done, whole)
    }

    /// So much of the whole is done.
    pub(crate) fn at(&mut self, done: usize, whole: usize) {
        let taken = self.started.elapsed();
        if self.silent || taken < PATIENCE || done == 0 || done >= whole {
            return;
        }
        let pause = if self.terminal { PATIENCE } else { LOG_EVERY };
        if self.said.is_some_and(|said| said.elapsed() < pause) {
            return;
        }
        self.said = Some(Instant::now());
        let part = done as f64 / whole as f64;
        let left_s = taken.as_secs_f64() * (1.0 / part - 1.0);
        // The first hundredth tells nothing of the rest.
        let left = if part < 0.01 {
            String::new()
        } else {
            format!(", about {left_s:.0} s left")
        };
        let line = format!("{}: {:.0} % done{left}", self.what, 100.0 * part);
        // Whoever reads no stderr has lost nothing but this.
        let _ = if self.terminal {
            write!(std::io::stderr(), "\r{line}\x1b[K")
        } else {
            writeln!(std::io::stderr(), "{line}")
        };
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if self.terminal && self.said.is_some() {
            let _ = write!(std::io::stderr(), "\r\x1b[K");
        }
    }
}

/// Does a work that does not say how far it is, and says how long it has taken: on a terminal after two seconds, in a log after ten.
pub(crate) fn meanwhile<T>(what: &str, silent: bool, work: impl FnOnce() -> T) -> T {
    if silent {
        return work();
    }
    let pause = if is_terminal(&std::io::stderr()) {
        PATIENCE
    } else {
        LOG_EVERY
    };
    let (done, wait) = channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let started = Instant::now();
            while wait.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                let taken_s = started.elapsed().as_secs_f64();
                // Whoever reads no stderr has lost nothing but this.
                let _ = writeln!(std::io::stderr(), "{what}: {taken_s:.0} s so far");
            }
        });
        let result = work();
        drop(done);
        result
    })
}
