//! What a link needs of a port, and what it counts.

use protocol::DecoderCounters;
use std::io::{Read, Write};
use std::time::Duration;

/// What the link needs of a serial port: reads that return within some 100 ms (`TimedOut` when nothing came), and writes that do so too
/// (`TimedOut` when no byte was taken).
pub trait Port: Read + Write + Send {}
impl<T: Read + Write + Send + ?Sized> Port for T {}

/// What was lost on the way, since the link was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounters {
    /// What the decoder saw.
    pub decoder: DecoderCounters,
    /// Bytes received.
    pub bytes: u64,
    /// Frames received whole.
    pub frames: u64,
    /// Frames that the sequence numbers say were lost.
    pub lost_frames: u64,
    /// Frames received whole and passed over for newer ones, see [`Link::skip_over`](crate::Link::skip_over).
    pub skipped_frames: u64,
    /// How long the port was listened to since the last frame or sign of life. A program that was stopped, or that had no
    /// processor, did not listen; a simulated board that is still at work is not silent.
    pub silent: Duration,
    /// The same since the last frame: signs of life are none.
    pub frameless: Duration,
    /// Bytes received since the last message that could be read: many say that the line carries something else.
    pub bytes_unread: u64,
    /// How the messages arrived, up to the one that was taken last: the link reads ahead of who takes them.
    pub arrival: Arrival,
}

/// How messages arrived, counted since the link was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Arrival {
    /// Messages that arrived damaged though the port was read in time: the line's doing.
    pub damaged: u64,
    /// Messages cut off and gaps that late reads left. Bytes wait for a read in the system's buffer. Once that is full they are lost there:
    /// the doing of a computer that is too busy, or of a program that takes frames too slowly.
    pub late: u64,
}

/// Opens a port again that was lost. It is asked every 0.1 s, and must not take much longer than a second.
pub type Reopen = Box<dyn FnMut() -> Result<Box<dyn Port>, String> + Send>;
