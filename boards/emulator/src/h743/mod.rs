//! An emulated STM32H743 with the board of sixteen channels.
//!
//! `rigless` has its processor, clocks, ports, DMA controllers with their multiplexer, serial ports and flash memory. What it
//! lacks is here: converters that a timer triggers ([`converter`]), the DAC ([`source`]), and the analogue world ([`world`]).
//! The watchdog is registers only: nothing here shows that it bites. There are no caches, so that a buffer which only a cache
//! would spoil is not found either; the program keeps its data cache off.

pub mod chip;
pub mod converter;
pub mod source;
pub mod world;
