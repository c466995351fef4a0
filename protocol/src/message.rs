//! The two directions of the wire.

use crate::{
    Baseline, BoardError, Counters, FoldedPeriod, Frame, FrameRef, Heartbeat, Hello, Notice, PeriodRequest, Plan,
    SelfTest, Status, Watch,
};
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// A command to the board. Every one is answered: by what it asks for, by [`FromBoard::Ack`], or by
/// [`FromBoard::Error`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
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
    /// Watch like this while nothing touches, or send frames all the time (`None`). Answered by [`FromBoard::Watch`] with
    /// what is now in force. The baseline is learned anew.
    SetWatch(Option<Watch>),
    /// Answered by [`FromBoard::Watch`].
    GetWatch,
    /// Nothing touches now: learn the baseline of the watch anew.
    TakeBaseline,
    /// Answered by [`FromBoard::Baseline`].
    GetBaseline,
    /// Test the board. Answered by [`FromBoard::SelfTest`] after some milliseconds; frames pause meanwhile.
    SelfTest,
    /// Measure one folded period. Answered by [`FromBoard::Period`]; frames pause meanwhile.
    GetPeriod(PeriodRequest),
    /// Set the source's amplitude, in thousandths of [`Hello::excitation_uv`], 1 to 1000. The baseline is learned anew.
    SetExcitation(u16),
    /// Whether to start by itself at power-up.
    SetAutostart(bool),
    /// Keep plan, watch, excitation and autostart in the store, from where they come back at power-up. Not while frames
    /// are being measured.
    SaveSettings,
    /// Forget what is in the store: from the next power-up on the board begins as it was made. Not while frames are being
    /// measured.
    ForgetSettings,
    /// Answered by [`FromBoard::Status`].
    GetStatus,
}

/// Which command an acknowledgement is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command {
    /// [`ToBoard::Start`].
    Start,
    /// [`ToBoard::Stop`].
    Stop,
    /// [`ToBoard::ResetCounters`].
    ResetCounters,
    /// [`ToBoard::TakeBaseline`].
    TakeBaseline,
    /// [`ToBoard::SetExcitation`].
    SetExcitation,
    /// [`ToBoard::SetAutostart`].
    SetAutostart,
    /// [`ToBoard::SaveSettings`].
    SaveSettings,
    /// [`ToBoard::ForgetSettings`].
    ForgetSettings,
}

/// A message from the board.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
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
    /// The watch in force.
    Watch(Option<Watch>),
    /// Nothing touches, or something begins or ceases to.
    Heartbeat(Heartbeat),
    /// What the change test takes for untouched.
    Baseline(Baseline),
    /// How the board is.
    SelfTest(SelfTest),
    /// One folded period.
    Period(FoldedPeriod),
    /// What it is set to and does.
    Status(Status),
    /// What it says unasked, from version 2.1 on.
    Notice(Notice),
}

/// A [`FromBoard`] to send, borrowed from where it is: the same bytes on the wire without a copy in memory. Variants as in
/// [`FromBoard`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[expect(missing_docs, reason = "named as in FromBoard")]
pub enum Outgoing<'a> {
    Hello(&'a Hello),
    Plan(&'a Plan),
    Frame(FrameRef<'a>),
    Counters(&'a Counters),
    Ack(Command),
    Error(&'a BoardError),
    Watch(&'a Option<Watch>),
    Heartbeat(Heartbeat),
    Baseline(&'a Baseline),
    SelfTest(&'a SelfTest),
    Period(&'a FoldedPeriod),
    Status(Status),
    Notice(Notice),
}

impl<'a> From<&'a FromBoard> for Outgoing<'a> {
    fn from(message: &'a FromBoard) -> Self {
        match message {
            FromBoard::Hello(m) => Self::Hello(m),
            FromBoard::Plan(m) => Self::Plan(m),
            FromBoard::Frame(m) => Self::Frame(m.into()),
            FromBoard::Counters(m) => Self::Counters(m),
            FromBoard::Ack(m) => Self::Ack(*m),
            FromBoard::Error(m) => Self::Error(m),
            FromBoard::Watch(m) => Self::Watch(m),
            FromBoard::Heartbeat(m) => Self::Heartbeat(*m),
            FromBoard::Baseline(m) => Self::Baseline(m),
            FromBoard::SelfTest(m) => Self::SelfTest(m),
            FromBoard::Period(m) => Self::Period(m),
            FromBoard::Status(m) => Self::Status(*m),
            FromBoard::Notice(m) => Self::Notice(*m),
        }
    }
}
