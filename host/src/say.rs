//! What the program says to people: on stderr, and into the recording where there is one.

use recording::Tap;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::fmt::Arguments;
use std::io::{IsTerminal, Write};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

thread_local! {
    /// The skin, of several, that this thread is for.
    static SKIN: RefCell<Option<Arc<str>>> = const { RefCell::new(None) };
}

/// From now on what this thread says is of this skin.
pub(crate) fn set_skin(name: Option<Arc<str>>) {
    SKIN.with_borrow_mut(|skin| *skin = name);
}

/// The skin, of several, that this thread is for.
pub(crate) fn skin() -> Option<Arc<str>> {
    SKIN.with_borrow(Clone::clone)
}

static RECORDED: OnceLock<Tap> = OnceLock::new();
/// The last lines that were said.
static SAID: Mutex<VecDeque<String>> = Mutex::new(VecDeque::new());
/// So many are kept.
const KEPT: usize = 200;

/// The last lines that this program said, the newest last.
pub(crate) fn last_lines() -> Vec<String> {
    let said = SAID.lock().unwrap_or_else(PoisonError::into_inner);
    said.iter().cloned().collect()
}

/// From now on what is said is recorded too.
pub(crate) fn record_to(tap: &Tap) {
    // There is one recording in a program's life.
    let _ = RECORDED.set(tap.clone());
}

/// Says a line; `say!` formats it.
pub(crate) fn line(text: Arguments<'_>) {
    let text = match skin() {
        Some(skin) => format!("{skin}: {text}"),
        None => text.to_string(),
    };
    // Whoever closed stderr does not want to know.
    let _ = writeln!(std::io::stderr(), "{text}");
    if let Some(tap) = RECORDED.get() {
        tap.said(&text);
    }
    let mut said = SAID.lock().unwrap_or_else(PoisonError::into_inner);
    said.push_back(text);
    if said.len() > KEPT {
        said.pop_front();
    }
}

/// Says a line on stderr, formatted as by `format!`, and records it.
macro_rules! say {
    ($($text:tt)*) => { $crate::say::line(format_args!($($text)*)) };
}
pub(crate) use say;

/// Whether what goes there may have colours: a terminal, unless NO_COLOR is set.
pub(crate) fn is_coloured(to: &impl IsTerminal) -> bool {
    to.is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty())
}

/// Writes to stdout, for `println!`. Whoever closed it has read enough: then the program ends well.
pub(crate) fn out(text: Arguments<'_>) {
    if let Err(e) = writeln!(std::io::stdout(), "{text}") {
        let closed = e.kind() == std::io::ErrorKind::BrokenPipe;
        if !closed {
            let _ = writeln!(std::io::stderr(), "skin: stdout: {e}");
        }
        std::process::exit(i32::from(!closed));
    }
}

/// Writes to stderr, for `eprint!` and `eprintln!`. Whoever closed it does not want to know.
pub(crate) fn err(text: Arguments<'_>) {
    let _ = write!(std::io::stderr(), "{text}");
}
