//! The light on the board: what somebody without a PC can see of it.

use crate::chip::LIGHT_CYCLE as CYCLE;
use cortex_m::peripheral::DWT;

/// What the light tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// The board waits for commands: a short flash.
    Alive,
    /// It measures or watches: half the time on, twice as often.
    Measuring,
    /// It was to measure, and a part of it failed: nearly always on.
    Fault,
}

/// Whether the light is on now. The main loop alone asks, in every round: a program that hangs shows a light that stands
/// still, until the watchdog restarts it.
pub fn is_on(state: State) -> bool {
    let at = DWT::cycle_count() % CYCLE;
    match state {
        State::Alive => at < CYCLE / 16,
        State::Measuring => at % (CYCLE / 2) < CYCLE / 4,
        State::Fault => at >= CYCLE / 8,
    }
}
