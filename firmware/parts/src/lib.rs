//! Parts that sensor boards are made of, as `firmware`'s [`Router`](firmware::Router) and [`Store`](firmware::Store), on
//! the traits of `embedded-hal` 1.0 and `embedded-storage`: whatever chip has a HAL with these can use them.
//!
//! | part | over | as |
//! |---|---|---|
//! | 74HC4051, 74HC4067 and others with address lines and an enable | `OutputPin` | [`LineMux`] |
//! | two multiplexers with their outputs joined | | [`Joined`] |
//! | ADG731, 32 inputs | `SpiDevice` | [`Adg731`] |
//! | four multiplexers and an amplifier | `DelayNs` | [`Switches`], a `Router` |
//! | ADG2128, 12 electrodes a chip | `I2c` | [`Crosspoint`], a `Router` |
//! | PGA112, PGA113, PGA116, PGA117 | `SpiDevice` | [`Pga11x`] |
//! | MCP6S21, 22, 26, 28 | `SpiDevice` | [`Mcp6s2x`] |
//! | flash memory | `NorFlash` | [`NorStore`], a `Store` |
//!
//! Nobody has tried them on hardware. Their tests hold them against models of the parts, which were made from the data
//! sheets named at each. docs/port.md shows a board made of them.
#![no_std]
#![forbid(unsafe_code)]

mod adg2128;
mod adg731;
mod amplifier;
mod multiplexer;
mod nor_store;
mod switches;

pub use adg731::Adg731;
pub use adg2128::{Crosspoint, ELECTRODES_A_CHIP, FIRST_ADDRESS};
pub use amplifier::{Amplifier, Fixed, Mcp6s2x, Pga11x, Setting};
pub use multiplexer::{Joined, LineMux, Multiplexer, Mux4051, Mux4067};
pub use nor_store::{NorStore, NorStoreError, WRONG_PLACE};
pub use switches::Switches;
