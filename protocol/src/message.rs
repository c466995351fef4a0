//! The two directions of the wire.

use crate::{BoardError, Counters, Frame, Hello, Plan};
use serde::{Deserialize, Serialize};

/// A command to the board. Every one is answered: by what it asks for, by [`FromBoard::Ack`], or by
/// [`FromBoard::Error`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[expect(clippy::large_enum_variant, reason = "there is no heap to box it on")]
pub enum ToBoard {
    /// Who are you? Answered by [`FromBoard::Hello`].
    Hello,
    /// Switch the excitation on and send frames until told to stop. Starting twice is no error.
    Start,
    /// Stop sending frames and switch the excitation off. Stopping twice is no error.
    Stop,
    /// Measure by this plan from the next frame on. Answered by [`FromBoard::Plan`] with the plan now in force.
    SetPlan(Plan),
    /// Answered by [`FromBoard::Plan`].
    GetPlan,
    /// Answered by [`FromBoard::Counters`].
    GetCounters,
    /// Sets all counters to 0.
    ResetCounters,
}

/// Which command an acknowledgement is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Command {
    /// [`ToBoard::Start`].
    Start,
    /// [`ToBoard::Stop`].
    Stop,
    /// [`ToBoard::ResetCounters`].
    ResetCounters,
}

/// A message from the board.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[expect(clippy::large_enum_variant, reason = "there is no heap to box it on")]
pub enum FromBoard {
    /// Who it is; also sent once when the board starts.
    Hello(Hello),
    /// The plan in force.
    Plan(Plan),
    /// Measured values.
    Frame(Frame),
    /// What it counted.
    Counters(Counters),
    /// A command was carried out.
    Ack(Command),
    /// A command was not carried out, or the scan stopped.
    Error(BoardError),
}
