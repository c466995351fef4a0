//! Recordings of a skin: MCAP files with everything that came over the wire and what was made of it.
//!
//! A [`Tap`] stands between a port and the link and copies every byte into a bounded queue; it never waits. A [`Recorder`] takes
//! them from there on a thread of its own and writes them, with all else that it is given. [`Reader`] reads a file from its
//! beginning, whole or cut short, in bounded memory. [`recover`] makes a whole file of one that was cut short or is damaged, and
//! [`Playback`] is a board's port that sends what was recorded. The file is described in docs/recordings.md.
#![forbid(unsafe_code)]

mod clock;
mod error;
mod playback;
mod reader;
mod recorder;
mod recover;
mod sink;
mod switch;
mod tap;
mod topic;
mod wire;
mod writer;

pub use clock::{BoardClock, ClockFit, HostClock};
pub use error::RecordingError;
pub use playback::{Pace, Playback, Speed};
pub use reader::{Ended, Known, Message, Reader, split};
pub use recorder::{Closer, Counts, Recorder, WaitingRecorder};
pub use recover::{Recovered, recover};
pub use sink::Target;
pub use switch::{Switch, Switched};
pub use tap::{Later, Pose, Tap, Tapped, from_base64};
pub use topic::{FORMAT, PROFILE, Topic};
pub use wire::Splitter;
pub use writer::Writer;
