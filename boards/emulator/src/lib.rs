//! An emulated STM32F427 that runs the board's program instruction by instruction, with the simulated skin on its pins, and
//! an STM32H743 for the board with sixteen channels ([`h743`]).
//!
//! The crate `rigless` emulates the processor, its clocks, ports, DMA controllers, serial ports, flash memory and
//! watchdog. Its authors wrote those models from ST's manuals, independently of this project. This crate adds what
//! `rigless` lacks:
//!
//! - the timer that triggers converter and source: [`timer`], [`converter`], [`source`]
//! - the timer that measures the clock input: [`counter`]
//! - the analogue world behind the pins, with the electronics and the sheet of `hil-sim`: [`world`]
//! - the run of a program from power-up, and what it did: [`run`]
//!
//! More about the whole project is in [docs/architecture.md](../../../docs/architecture.md). The emulated circuit is
//! that of [docs/board.md](../../../docs/board.md). `tests/boards.sh` builds the board's programs and runs the tests of
//! this crate.
//!
//! The analogue world works without a program. It counts address lines that change while a switch is closed:
//!
//! ```
//! use emulator::world::World;
//! use hil_sim::Electronics;
//! use forward::ElectrodeMatrix;
//! use nalgebra::DMatrix;
//!
//! let sheet = ElectrodeMatrix::from_potentials(DMatrix::from_diagonal_element(16, 16, 900.0));
//! let mut world = World::new(Electronics::drawn_board(), sheet);
//! // All enable lines high: nothing is connected, and the converter sees the middle of its range.
//! for enable in 0..8 {
//!     world.pin("GPIOC", enable, true);
//! }
//! assert_eq!(world.sample(0), firmware::FULL_SCALE / 2);
//! // Drive + on electrode 1, drive - on electrode 2: first the address, then the two enable lines.
//! world.pin("GPIOB", 12, true);
//! world.pin("GPIOC", 4, false);
//! world.pin("GPIOC", 6, false);
//! assert_eq!(world.without_break, 0);
//! // Another address under the closed switches.
//! world.pin("GPIOB", 12, false);
//! assert_eq!(world.without_break, 1);
//! ```

pub mod board;
pub mod converter;
pub mod counter;
pub mod h743;
pub mod line;
pub mod run;
pub mod source;
pub mod timer;
mod unused;
pub mod world;
