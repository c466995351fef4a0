//! How a program ends that is told to: in order, or soon. Whatever hangs, such as a pipe that nobody reads, a port or a disk, Ctrl-C and
//! SIGTERM end it within a second, and tell the board to stop.

use anyhow::{Context, Result};
use link::{Link, Stopper};
use std::process::exit;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A program that ends in order is given so long.
const IN_ORDER: Duration = Duration::from_millis(600);
/// The thread of the link is given so long to tell the board, if it needs it.
const FOR_THE_BOARD: Duration = Duration::from_millis(300);
/// And a last word so long.
const LAST_WORD: Duration = Duration::from_millis(50);

/// What a signal finds.
struct State {
    caught: bool,
    /// Is looked at by what ends in order.
    flag: Option<Arc<AtomicBool>>,
    boards: Vec<Stopper>,
}

static STATE: Mutex<State> = Mutex::new(State {
    caught: false,
    flag: None,
    boards: Vec::new(),
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

fn catch() -> Result<()> {
    if std::mem::replace(&mut state().caught, true) {
        return Ok(());
    }
    ctrlc::set_handler(end).context("Ctrl-C cannot be caught")
}

/// Whether every board was told to stop; all at once.
fn all_stopped(boards: &[Stopper]) -> bool {
    std::thread::scope(|scope| {
        let told: Vec<_> = boards
            .iter()
            .map(|board| scope.spawn(|| board.stop(FOR_THE_BOARD)))
            .collect();
        told.into_iter().all(|told| told.join().unwrap_or(false))
    })
}

/// Runs on a thread of its own, once there is a signal.
fn end() {
    let flag = state().flag.clone();
    if let Some(flag) = &flag {
        flag.store(true, Ordering::Relaxed);
        std::thread::sleep(IN_ORDER);
    }
    let boards = std::mem::take(&mut state().boards);
    let told = all_stopped(&boards);
    if flag.is_none() {
        // As shells say it of a program that Ctrl-C has ended.
        exit(130);
    }
    let board = if told { "" } else { "; the board goes on sending" };
    // Whoever reads stderr may be what hangs.
    std::thread::spawn(move || {
        eprintln!(
            "skin: ended without waiting for what hangs (who reads the output, the disk, the port) or takes long; the output is not complete{board}"
        );
    });
    std::thread::sleep(LAST_WORD);
    exit(1);
}
