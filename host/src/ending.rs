//! How a program ends that is told to: in order, or soon. Whatever hangs, such as a pipe that nobody reads, a port or a disk, Ctrl-C and
//! SIGTERM end it within a second, tell the board to stop and close what is recorded.

use anyhow::{Context, Result};
use link::{Link, Stopper};
use recording::{Closer, Recorder};
use std::process::exit;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A program that ends in order is given so long.
const IN_ORDER: Duration = Duration::from_millis(600);
/// The thread of the link is given so long to tell the board, and that of a recorder to close its file, if they need it.
const AT_LAST: Duration = Duration::from_millis(300);
/// And a last word so long.
const LAST_WORD: Duration = Duration::from_millis(50);

/// What a signal finds.
struct State {
    caught: bool,
    /// Is looked at by what ends in order.
    flag: Option<Arc<AtomicBool>>,
    boards: Vec<Stopper>,
    recordings: Vec<Closer>,
}

static STATE: Mutex<State> = Mutex::new(State {
    caught: false,
    flag: None,
    boards: Vec::new(),
    recordings: Vec::new(),
});

fn state() -> MutexGuard<'static, State> {
    STATE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Is set by Ctrl-C, and by what else ends a program. Whoever takes it ends soon after.
///
/// # Errors
/// Signals cannot be caught.
pub(crate) fn flag() -> Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    state().flag = Some(Arc::clone(&flag));
    catch()?;
    Ok(flag)
}

/// This board is stopped when the program is ended by a signal.
///
/// # Errors
/// Signals cannot be caught.
pub(crate) fn stops(link: &Link) -> Result<()> {
    state().boards.push(link.stopper());
    catch()
}

/// This recording is closed when the program is ended by a signal.
pub(crate) fn closes(recorder: &Recorder) {
    let recordings = &mut state().recordings;
    recordings.retain(|closer| !closer.is_closed());
    recordings.push(recorder.closer());
}

fn catch() -> Result<()> {
    if std::mem::replace(&mut state().caught, true) {
        return Ok(());
    }
    ctrlc::set_handler(end).context("Ctrl-C cannot be caught")
}

/// Whether every board was told to stop, and every recording is closed; all at once.
fn all_ended(boards: &[Stopper], recordings: &[Closer]) -> (bool, bool) {
    std::thread::scope(|scope| {
        let told: Vec<_> = (boards.iter())
            .map(|board| scope.spawn(|| board.stop(AT_LAST)))
            .collect();
        let closed: Vec<_> = (recordings.iter())
            .map(|recording| scope.spawn(|| recording.close(AT_LAST)))
            .collect();
        // The others are waited for at the scope's end.
        let [told, closed] = [told, closed].map(|all| all.into_iter().all(|one| one.join().unwrap_or(false)));
        (told, closed)
    })
}

/// Runs on a thread of its own, once there is a signal.
fn end() {
    let flag = state().flag.clone();
    if let Some(flag) = &flag {
        flag.store(true, Ordering::Relaxed);
        std::thread::sleep(IN_ORDER);
    }
    let (boards, recordings) = {
        let mut state = state();
        (std::mem::take(&mut state.boards), std::mem::take(&mut state.recordings))
    };
    let (told, closed) = all_ended(&boards, &recordings);
    if flag.is_none() {
        // As shells say it of a program that Ctrl-C has ended.
        exit(130);
    }
    let board = if told { "" } else { "; the board goes on sending" };
    let recording = if closed {
        ""
    } else {
        "; the recording is not closed: skin recover reads it"
    };
    // Whoever reads stderr may be what hangs.
    std::thread::spawn(move || {
        eprintln!(
            "skin: ended without waiting for what hangs (who reads the output, the disk, the port) or takes long; the output is not complete{board}{recording}"
        );
    });
    std::thread::sleep(LAST_WORD);
    exit(1);
}
