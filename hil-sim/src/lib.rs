//! A simulated skin: scene, rubber, electronics, converter and serial port below the firmware's own traits, in simulated
//! time. The firmware above is the very library that runs on a board.
//!
//! ```text
//! Scene -> Rubber -> SimFrontEnd -> firmware::Controller -> Uart -> SimBoard -> SimPort -> the host's reads and writes
//! ```
//!
//! Nothing below [`SimPort`] knows the wall clock, and all noise is drawn from a seed and the simulated time: the same
//! configuration and the same commands give the same bytes.
#![forbid(unsafe_code)]

mod analog;
mod board;
mod bootloader;
mod chip;
mod clock;
mod converter;
mod creep;
mod demo;
mod electronics;
mod fault;
mod flash;
mod front_end;
mod interference;
pub mod library;
mod line;
mod material;
mod noise;
mod port;
mod pressure;
mod real_time;
mod rubber;
mod scene;
mod scene_file;
mod sheet;
mod steps;
mod stretch;
mod timeline;
mod touch;
mod uart;
mod variation;
mod wave;
mod wiring;

pub use analog::{Analog, Routing};
pub use board::{BoardError, SimBoard, SimConfig};
pub use bootloader::{BootFaults, BootRom};
pub use chip::Chip;
pub use clock::{Clock, PERIOD_SAMPLES, QUARTER_SAMPLES, TICKS_PER_SAMPLE, TIMER_HZ, samples, seconds};
pub use electronics::{Electronics, ElectronicsError};
pub use fault::{Fault, FaultError, FaultKind, Multiplexer};
pub use flash::{Flash, FlashError, Torn};
pub use front_end::{SimFrontEnd, SimFrontEndError};
pub use interference::Line;
pub use material::Material;
pub use noise::Noise;
pub use port::{Pace, SimPort};
pub use rubber::Rubber;
pub use scene::{Probe, Scene, TouchNow};
pub use scene_file::{Located, SceneFile, SceneFileError};
pub use sheet::{FixedSheet, SheetModel};
pub use stretch::{Stretch, StretchField};
pub use touch::{Key, Shape, Touch};
pub use uart::Uart;
pub use variation::{Ageing, Variation};
