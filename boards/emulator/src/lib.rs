//! An STM32F427 that runs the board's program instruction by instruction (crate `rigless`), with the simulated skin of
//! `hil-sim` on its pins.
//!
//! The processor, its clocks, ports, DMA controllers, serial port, flash memory and watchdog are rigless's own, written from
//! the manuals by others. What it has not is here: the timer's trigger of converter and source ([`timer`], [`converter`],
//! [`source`]), and the analogue world behind the pins ([`world`]).
#![forbid(unsafe_code)]

pub mod board;
pub mod converter;
pub mod line;
pub mod run;
pub mod source;
pub mod timer;
pub mod world;
