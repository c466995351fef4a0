//! Where a replay is and where it is to go, for all skins of a recording together.

use recording::Pace;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A replay at its end, or one that stands still, waits so long for a page: one that is loaded again, or shows another skin.
const NOBODY: Duration = Duration::from_secs(3);

/// What was asked for last.
#[derive(Clone)]
pub(crate) struct Asked {
    /// Counts what was asked for.
    pub(crate) number: u64,
    /// Log time, ns; none for the beginning.
    pub(crate) to_ns: Option<u64>,
    pub(crate) paused: bool,
    pub(crate) pace: Pace,
}

struct State {
    asked: Asked,
    watched: Option<Instant>,
}

/// What pages ask of a replay.
pub(crate) struct Control(Mutex<State>);

impl Default for Control {
    /// Plays from the beginning.
    fn default() -> Self {
        let asked = Asked {
            number: 0,
            to_ns: None,
            paused: false,
            pace: Pace::default(),
        };
        Self(Mutex::new(State { asked, watched: None }))
    }
}

impl Control {
    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Goes to a log time, ns, and stands still there or goes on.
    pub(crate) fn go(&self, to_ns: u64, paused: bool) {
        let mut state = self.state();
        state.asked = Asked {
            number: state.asked.number + 1,
            to_ns: Some(to_ns),
            paused,
            pace: Pace::from(to_ns),
        };
    }

    pub(crate) fn asked(&self) -> Asked {
        self.state().asked.clone()
    }

    /// Whether something else was asked for since.
    pub(crate) fn is_over(&self, number: u64) -> bool {
        self.state().asked.number != number
    }

    /// A page is there.
    pub(crate) fn watched(&self) {
        self.state().watched = Some(Instant::now());
    }

    /// Whether a page is there, or was just now.
    pub(crate) fn is_watched(&self) -> bool {
        self.state().watched.is_some_and(|at| at.elapsed() < NOBODY)
    }
}
