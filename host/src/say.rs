//! What the program says to people: on stderr, and into the recording where there is one.

use crate::progress;
use recording::Tap;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::fmt::Arguments;
use std::io::{IsTerminal, StdoutLock, Write};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

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

/// Recordings, with the skin that each is of; none for all.
static RECORDED: Mutex<Vec<(Option<Arc<str>>, Tap)>> = Mutex::new(Vec::new());
/// The last lines that were said.
static SAID: Mutex<VecDeque<String>> = Mutex::new(VecDeque::new());
/// So many are kept.
const KEPT: usize = 200;

/// The last lines that this program said, the newest last.
pub(crate) fn last_lines() -> Vec<String> {
    let said = SAID.lock().unwrap_or_else(PoisonError::into_inner);
    said.iter().cloned().collect()
}

/// From now on what is said is recorded too: of the skin that this thread is for, or of all.
pub(crate) fn record_to(tap: &Tap) {
    recorded().push((skin(), tap.clone()));
}

/// From now on what is said of the skin that this thread is for, or of all, is recorded no more.
pub(crate) fn record_no_more() {
    let skin = skin();
    recorded().retain(|(of, _)| *of != skin);
}

fn recorded() -> MutexGuard<'static, Vec<(Option<Arc<str>>, Tap)>> {
    RECORDED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Says a line; `say!` formats it.
pub(crate) fn line(text: Arguments<'_>) {
    let skin = skin();
    let text = match &skin {
        Some(skin) => format!("{skin}: {text}"),
        None => text.to_string(),
    };
    err(format_args!("{text}\n"));
    for (_, tap) in recorded().iter().filter(|(of, _)| of.is_none() || *of == skin) {
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

/// Most letters of a line of an error; a file may have lines of megabytes.
const MOST_OF_A_LINE: usize = 2000;

/// An error as a terminal may show it: files and their names have control characters at times, and lines without end.
pub(crate) fn harmless(text: &str) -> String {
    let printable = |c: char| if c.is_control() && c != '\t' { '?' } else { c };
    let line = |line: &str| {
        let mut letters = line.chars();
        let mut text: String = letters.by_ref().take(MOST_OF_A_LINE).map(printable).collect();
        if letters.next().is_some() {
            text += " ...";
        }
        text
    };
    text.split('\n').map(line).collect::<Vec<_>>().join("\n")
}

/// Whether this is a terminal that obeys escape sequences.
pub(crate) fn is_terminal(to: &impl IsTerminal) -> bool {
    // Those of Windows do once they are asked to.
    static OBEYS: LazyLock<bool> = LazyLock::new(|| anstyle_query::windows::enable_ansi_colors() != Some(false));
    to.is_terminal() && *OBEYS
}

/// Whether what goes there may have colours: a terminal, unless NO_COLOR is set.
pub(crate) fn is_coloured(to: &impl IsTerminal) -> bool {
    is_terminal(to) && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty())
}

/// A text as long as the terminal is wide: a line that wraps could not be written over.
pub(crate) fn cut_to_terminal(text: &str) -> String {
    let size = terminal_size::terminal_size_of(std::io::stderr());
    let columns = size.map(|(terminal_size::Width(columns), _)| columns.into());
    cut(
        text,
        columns.map_or(usize::MAX, |columns: usize| columns.saturating_sub(1)),
    )
}

/// A text of so many characters at most, which ends with an ellipsis where it was longer.
fn cut(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    let kept: String = text.chars().take(most.saturating_sub(1)).collect();
    if most == 0 { kept } else { kept + "\u{2026}" }
}

/// Stdout, for a result: the line that tells how far it is makes room.
pub(crate) fn stdout() -> StdoutLock<'static> {
    progress::clear();
    std::io::stdout().lock()
}

/// Writes to stdout, for `println!`. Whoever closed it has read enough: then the program ends well.
pub(crate) fn out(text: Arguments<'_>) {
    if let Err(e) = writeln!(stdout(), "{text}") {
        let closed = e.kind() == std::io::ErrorKind::BrokenPipe;
        if !closed {
            let _ = writeln!(std::io::stderr(), "skin: stdout: {e}");
        }
        std::process::exit(i32::from(!closed));
    }
}

/// Writes to stderr, for `eprint!` and `eprintln!`. Whoever closed it does not want to know.
pub(crate) fn err(text: Arguments<'_>) {
    progress::clear();
    let _ = write!(std::io::stderr(), "{text}");
}

#[cfg(test)]
mod tests {
    #[test]
    fn an_error_is_harmless_to_a_terminal() {
        let long = "ä".repeat(5000);
        let shown = super::harmless(&format!("a: \u{1b}[2J\0é\n\tb\n{long}"));
        let lines: Vec<&str> = shown.split('\n').collect();
        assert_eq!(lines[..2], ["a: ?[2J?é", "\tb"]);
        assert_eq!(lines[2].chars().count(), 2004);
    }

    #[test]
    fn a_cut_text_is_never_longer_and_begins_as_the_whole() {
        let text = "(12, \u{2212}40) mm +20 %  \u{2248} 12 N";
        let length = text.chars().count();
        assert_eq!(super::cut(text, length), text);
        for most in 0..length {
            let cut = super::cut(text, most);
            assert_eq!(cut.chars().count(), most);
            let begin = cut.strip_suffix('\u{2026}').unwrap_or(&cut);
            assert!(text.starts_with(begin) && (cut.ends_with('\u{2026}') || most == 0));
        }
    }
}
