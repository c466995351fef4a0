//! How far the program is, on stderr: one thread tells it of whatever takes more than two seconds, whichever command it is.

use crate::say;
use std::io::Write;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// So often, on a terminal, where one line is written over; of what takes less nothing is said.
const ON_TERMINAL: Duration = Duration::from_secs(2);
/// The same of a log.
const IN_LOG: Duration = Duration::from_secs(10);
/// It is looked so often whether something is to be told.
const LOOK: Duration = Duration::from_millis(200);

/// What is being done.
struct Work {
    number: u64,
    what: String,
    /// The skin, of several, that it is done for.
    skin: Option<Arc<str>>,
    since: Instant,
    /// How much of it is done, 0 to 1, where that is known.
    part: Option<f64>,
}

/// All that is being done, the newest last.
struct Works {
    list: Vec<Work>,
    begun: u64,
    is_silent: bool,
}

static WORKS: Mutex<Works> = Mutex::new(Works {
    list: Vec::new(),
    begun: 0,
    is_silent: false,
});

/// Whether a line of it is on the terminal. Whoever writes one holds this, and no work waits for it.
static SHOWN: Mutex<bool> = Mutex::new(false);

fn works() -> MutexGuard<'static, Works> {
    WORKS.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Works {
    fn begin(&mut self, what: &str) -> u64 {
        self.begun += 1;
        self.list.push(Work {
            number: self.begun,
            what: what.to_owned(),
            skin: say::skin(),
            since: Instant::now(),
            part: None,
        });
        self.begun
    }

    /// The newest of those that have taken so long, in words; none where nothing is to be told.
    fn line(&self, now: Instant, least: Duration) -> Option<String> {
        if self.is_silent {
            return None;
        }
        let taken = |work: &Work| now.saturating_duration_since(work.since);
        let work = self.list.iter().rev().find(|work| taken(work) >= least)?;
        let taken_s = taken(work).as_secs_f64();
        let skin = work.skin.as_ref().map_or(String::new(), |skin| format!("{skin}: "));
        let far = match work.part {
            // The first hundredth tells nothing of the rest.
            Some(part) if part >= 0.01 => format!(
                "{:.0} % done, about {:.0} s left",
                100.0 * part,
                taken_s * (1.0 / part - 1.0)
            ),
            _ => format!("{taken_s:.0} s so far"),
        };
        Some(format!("{skin}{}: {far}", work.what))
    }
}

/// Whoever does not read stderr has lost nothing but this.
fn write(text: &str) {
    let _ = std::io::stderr().write_all(text.as_bytes());
}

/// A work that is told of as long as this is there.
pub(crate) struct Progress(u64);

impl Progress {
    /// Of a work that begins now; `what` is its name.
    pub(crate) fn new(what: &str) -> Self {
        Self(works().begin(what))
    }

    /// For a work that says itself how much of the whole is done.
    pub(crate) fn told(self) -> impl FnMut(usize, usize) {
        move |done, whole| self.at(done, whole)
    }

    /// So much of the whole is done.
    pub(crate) fn at(&self, done: usize, whole: usize) {
        self.change(|work| work.part = (done < whole).then(|| done as f64 / whole as f64));
    }

    /// It has come to another part, which has this name.
    pub(crate) fn call(&self, what: &str) {
        self.change(|work| work.what = what.to_owned());
    }

    fn change(&self, change: impl FnOnce(&mut Work)) {
        if let Some(work) = works().list.iter_mut().find(|work| work.number == self.0) {
            change(work);
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        works().list.retain(|work| work.number != self.0);
        clear();
    }
}

/// Does a work that does not say how far it is.
pub(crate) fn meanwhile<T>(what: &str, work: impl FnOnce() -> T) -> T {
    let _told = Progress::new(what);
    work()
}

/// From now on nothing is told.
pub(crate) fn silence() {
    works().is_silent = true;
}

/// Takes the line off the terminal: something else is to be written there.
pub(crate) fn clear() {
    let mut shown = SHOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if std::mem::take(&mut *shown) {
        write("\r\x1b[K");
    }
}

/// Whether it has a line on the terminal, or is about to.
pub(crate) fn is_shown() -> bool {
    SHOWN.try_lock().map_or(true, |shown| *shown)
}

/// Runs a command and tells how far it is; `name` where the command as a whole is a work.
pub(crate) fn telling<T>(name: Option<&str>, command: impl FnOnce() -> T) -> T {
    let terminal = say::is_terminal(&std::io::stderr());
    let every = if terminal { ON_TERMINAL } else { IN_LOG };
    let whole = name.map(Progress::new);
    let (done, wait) = channel::<()>();
    let tell = move || {
        let mut told = Instant::now();
        while wait.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
            if told.elapsed() < every {
                continue;
            }
            let Some(line) = works().line(Instant::now(), every) else {
                continue;
            };
            told = Instant::now();
            let mut shown = SHOWN.lock().unwrap_or_else(PoisonError::into_inner);
            if terminal {
                write(&format!("\r\x1b[K{}", say::cut_to_terminal(&line)));
                *shown = true;
            } else {
                write(&format!("{line}\n"));
            }
        }
    };
    let result = std::thread::scope(|scope| {
        // Where there can be no such thread, the command goes on in silence.
        let _ = std::thread::Builder::new()
            .name("progress".to_owned())
            .spawn_scoped(scope, tell);
        let result = command();
        drop((whole, done));
        result
    });
    // What it told last may have come after the work's end.
    clear();
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_work_that_takes_long_is_told() {
        let mut works = Works {
            list: Vec::new(),
            begun: 0,
            is_silent: false,
        };
        let begun = Instant::now();
        let least = ON_TERMINAL;
        let at = |works: &Works, s: f64| works.line(begun + Duration::from_secs_f64(s), least);
        assert_eq!(at(&works, 60.0), None);
        for (what, since_s) in [("export", 0.0), ("reading", 10.0)] {
            works.begin(what);
            works.list.last_mut().unwrap().since = begun + Duration::from_secs_f64(since_s);
        }
        assert_eq!(at(&works, 1.9), None);
        assert_eq!(at(&works, 11.0).unwrap(), "export: 11 s so far");
        assert_eq!(at(&works, 14.0).unwrap(), "reading: 4 s so far");
        works.list[1].part = Some(0.001);
        assert_eq!(at(&works, 14.0).unwrap(), "reading: 4 s so far");
        works.list[1].part = Some(0.25);
        works.list[1].skin = Some("palm".into());
        assert_eq!(at(&works, 14.0).unwrap(), "palm: reading: 25 % done, about 12 s left");
        works.is_silent = true;
        assert_eq!(at(&works, 14.0), None);
    }
}
