//! What the server refused, said with a count: a flood of it is one warning.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// For so long it is counted what is said at once.
const GATHERED: Duration = Duration::from_secs(5);

/// What is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refused {
    /// A command from a page without the token.
    Command,
    /// A command while earlier ones wait.
    Excess,
    /// A page that sends more than pages do.
    Flood,
    /// A connection while there are as many as there may be.
    Connection,
}

impl Refused {
    const ALL: [Self; 4] = [Self::Command, Self::Excess, Self::Flood, Self::Connection];

    fn text(self) -> &'static str {
        match self {
            Self::Command => {
                "commands from a page without the token were refused; a page that may command has the address that was printed"
            }
            Self::Excess => "commands from the page were dropped, since earlier ones still wait",
            Self::Flood => "pages were closed that sent more messages than a page does",
            Self::Connection => "connections to the page were refused, since 64 are open; close some pages",
        }
    }
}

/// Counts what is refused.
#[derive(Default)]
pub(super) struct Refusals {
    counts: [AtomicU64; Refused::ALL.len()],
    gathering: AtomicBool,
}

impl Refusals {
    /// One more. It is said some seconds later, with all that were refused meanwhile. Only within the server's runtime.
    pub(super) fn count(self: &Arc<Self>, refused: Refused) {
        self.counts[refused as usize].fetch_add(1, Ordering::Relaxed);
        if !self.gathering.swap(true, Ordering::Relaxed) {
            let all = Arc::clone(self);
            tokio::spawn(async move {
                tokio::time::sleep(GATHERED).await;
                all.gathering.store(false, Ordering::Relaxed);
                all.say();
            });
        }
    }

    /// Says what was refused since it was said last.
    pub(super) fn say(&self) {
        for refused in Refused::ALL {
            let count = self.counts[refused as usize].swap(0, Ordering::Relaxed);
            if count > 0 {
                tracing::warn!("{count} {}", refused.text());
            }
        }
    }

    #[cfg(test)]
    pub(super) fn waiting(&self, refused: Refused) -> u64 {
        self.counts[refused as usize].load(Ordering::Relaxed)
    }
}
