//! An emulated STM32H743 with the board of sixteen channels.
//!
//! `rigless` has its processor, clocks, ports, DMA controllers with their multiplexer, serial ports and flash memory. What it
//! lacks is here: converters that a timer triggers ([`converter`]), the DAC ([`source`]), the [`watchdog`], a flash memory whose
//! power is cut ([`memory`]), and the analogue world ([`world`]). There are no caches, so that a buffer which only a cache
//! would spoil is not found; the program keeps its data cache off. Nor has the flash memory check bits: a word that was cut
//! off reads as what it holds, without a fault.

pub mod chip;
pub mod converter;
pub mod memory;
pub mod source;
pub mod watchdog;
pub mod world;
