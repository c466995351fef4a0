//! A simulated skin: scene, rubber, electronics, converter and serial port below the firmware's own traits, in simulated
//! time. The firmware above is the very library that runs on a board. The crate knows `firmware`, `forward` and `protocol`:
//! docs/architecture.md shows its place, docs/simulator.md lists flaws and faults, docs/scenes.md describes scenes.
//!
//! ```text
//! Scene -> Rubber -> SimFrontEnd -> firmware::Controller -> Uart -> SimBoard -> SimPort -> the host's reads and writes
//! ```
//!
//! ```
//! use forward::Sheet;
//! use hil_sim::{Rubber, Scene, SimBoard, SimConfig};
//! use protocol::{Decoder, FromBoard, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, ToBoard, encode};
//!
//! let rubber = Rubber::new(&Sheet::paper(), Scene::demo())?;
//! let mut board = SimBoard::new(SimConfig::default(), rubber)?;
//! board.receive(encode(&ToBoard::Start, &mut [0; MAX_TO_BOARD_LEN])?);
//!
//! let mut decoder = Decoder::<MAX_FROM_BOARD_LEN>::new();
//! let mut frame = None;
//! while frame.is_none() {
//!     board.step(|byte| {
//!         if let Some(Ok(FromBoard::Frame(f))) = decoder.push_byte(byte) {
//!             frame.get_or_insert(f);
//!         }
//!     });
//! }
//! assert!(frame.is_some_and(|f| f.values.len() == 208 && f.clipped.count() == 0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Nothing below [`SimPort`] knows the wall clock, and all noise is drawn from a seed and the simulated time: the same
//! configuration and the same commands give the same bytes.
#![forbid(unsafe_code)]

mod analog;
mod any_board;
mod board;
mod bootloader;
mod chip;
mod clock;
mod converter;
mod creep;
mod current;
mod demo;
mod electronics;
mod electronics_error;
mod fault;
mod filter;
mod flash;
mod front_end;
#[cfg(target_os = "linux")]
mod ftdi;
mod head_room;
mod interference;
pub mod library;
mod line;
mod material;
mod meter;
mod noise;
mod port;
mod preset;
mod pressure;
#[cfg(target_os = "linux")]
mod pty;
mod real_time;
mod rubber;
mod scene;
mod scene_file;
mod scene_time;
mod sheet;
mod steps;
mod stretch;
mod timeline;
mod touch;
mod uart;
mod value_front_end;
mod variation;
mod wave;
mod wiring;

pub use analog::{Analog, Routing};
pub use board::{BOARD_NAME, BoardError, SimBoard, SimConfig};
pub use bootloader::{BootFaults, BootRom};
pub use chip::Chip;
pub use clock::{Clock, PERIOD_SAMPLES, QUARTER_SAMPLES, TICKS_PER_SAMPLE, TIMER_HZ, samples, seconds};
pub use current::Broken;
pub use electronics::Electronics;
pub use electronics_error::ElectronicsError;
pub use fault::{Fault, FaultError, FaultKind, Multiplexer, Reference};
pub use flash::{Flash, FlashError, Torn};
pub use front_end::{SimFrontEnd, SimFrontEndError};
pub use interference::Line;
pub use material::Material;
pub use meter::{Level, Meter, MeterError};
pub use noise::Noise;
pub use port::{Pace, SimPort};
pub use preset::Preset;
#[cfg(target_os = "linux")]
pub use pty::{Pty, PtyOptions};
pub use rubber::Rubber;
pub use scene::{Probe, Scene, TouchNow};
pub use scene_file::{Located, SceneFile, SceneFileError};
pub use sheet::{FixedSheet, SheetModel};
pub use stretch::{Stretch, StretchField};
pub use touch::{Key, Shape, Touch};
pub use uart::Uart;
pub use value_front_end::ValueFrontEnd;
pub use variation::{Ageing, Variation};
