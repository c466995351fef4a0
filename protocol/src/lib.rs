//! The messages between the sensor board and the PC, and their framing. The board sends [`FromBoard`] and the PC sends
//! [`ToBoard`]. A [`Plan`] says what one [`Frame`] measures. This crate is `no_std` and knows no other crate of the project:
//! docs/architecture.md shows its place, docs/protocol.md describes every message.
//!
//! A frame on the wire is `COBS(postcard(message) + CRC-32C) + 0x00`, the CRC in little-endian order over the postcard
//! bytes. [`encode`] makes one; a [`Decoder`] finds them again in any stream of bytes, however it is cut up.
//!
//! ```
//! use protocol::{Decoder, Frame, FromBoard, MAX_FROM_BOARD_LEN, Outgoing, Value, encode};
//!
//! let values = [Value::new(1600), Value::new(-25)].into_iter().collect();
//! let frame = Frame { sequence: 7, values, ..Frame::default() };
//! let mut buffer = [0; MAX_FROM_BOARD_LEN];
//! let bytes = encode(&Outgoing::Frame((&frame).into()), &mut buffer)?;
//!
//! let mut decoder = Decoder::<MAX_FROM_BOARD_LEN>::new();
//! let mut received = Vec::new();
//! for piece in bytes.chunks(3) {
//!     decoder.push(piece, |message| received.push(message));
//! }
//! assert_eq!(received, [Ok(FromBoard::Frame(frame))]);
//! # Ok::<(), protocol::EncodeError>(())
//! ```
//!
//! Rules for changing a message, so that boards and programs of one major version understand each other:
//! - enum variants are identified by their position: only ever append;
//! - a message may grow at its very end; a receiver ignores bytes after the last field it knows;
//! - no `usize`, no float, nothing whose size depends on the machine;
//! - anything else is a new [`Version::major`], and new golden bytes in the tests.
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

#[cfg(test)]
extern crate std;

mod counters;
mod decode;
mod diagnosis;
mod encode;
mod error;
mod frame;
mod hello;
mod message;
mod notice;
mod plan;
mod plan_error;
mod plan_name;
mod status;
mod value;
mod variance;
mod watch;

use postcard_schema::key::hash::fnv1a64::hash_ty_path;

pub use counters::Counters;
pub use decode::{Decoder, DecoderCounters};
pub use diagnosis::{Check, FoldedPeriod, PERIOD_BINS, PeriodRequest, SelfTest};
pub use encode::{EncodeError, encode};
pub use error::{BoardError, FrameError, FrontEndFault, Refusal, WatchNumber};
pub use frame::{Flags, Frame, FrameRef};
pub use heapless;
pub use hello::{Hello, Limits, PanicText, ResetCause, Text, Version, text};
pub use message::{Command, FromBoard, Outgoing, ToBoard};
pub use notice::Notice;
pub use plan::{MAX_ELECTRODES, MAX_SLOTS, MAX_VALUES, Pair, Plan, QUARTERS, Recipe, Sampling, Slot};
pub use plan_error::PlanError;
pub use plan_name::{PlanName, UnknownPlan};
pub use status::{Status, Stored};
pub use value::Value;
pub use variance::Variance;
pub use watch::{Baseline, Heartbeat, MAX_WATCH_SLOTS, MAX_WATCH_VALUES, Watch, Watching};

/// Bytes that hold every framed message from the board, delimiter included.
pub const MAX_FROM_BOARD_LEN: usize = 1160;

/// Bytes that hold every framed command to the board, delimiter included.
pub const MAX_TO_BOARD_LEN: usize = 352;

/// Hash of the shape of all messages of both directions (FNV-1a of names and types). Two sides with the same hash were built
/// from the same messages; with another one, of the same major version, one of them knows messages that the other does not.
pub const SCHEMA: u32 = {
    let both = [
        hash_ty_path::<ToBoard>("to board"),
        hash_ty_path::<FromBoard>("from board"),
    ];
    let [a, b] = both;
    (u64::from_le_bytes(a) ^ u64::from_le_bytes(b).rotate_left(32)) as u32
};

/// The CRC of every frame: CRC-32C (Castagnoli).
const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISCSI);

/// Bytes of the CRC.
const CRC_LEN: usize = 4;
