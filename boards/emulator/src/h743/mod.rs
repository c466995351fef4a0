//! An emulated STM32H743 with the board of sixteen channels.
//!
//! `rigless` has its processor, clocks, ports, DMA controllers with their multiplexer, serial ports and flash memory. What it
//! lacks is here: converters that a timer triggers ([`converter`]), the DAC ([`source`]), the [`watchdog`], a flash memory whose
//! power is cut ([`memory`]), and the analogue world ([`world`]). There are no caches, so that a buffer which only a cache
//! would spoil is not found; the program keeps its data cache off. Nor has the flash memory check bits: memory that has them,
//! where a word that was cut off reads as a bus fault, is behind it ([`cells`]).

pub mod cells;
pub mod chip;
pub mod converter;
pub mod memory;
pub mod source;
pub mod watchdog;
pub mod world;
