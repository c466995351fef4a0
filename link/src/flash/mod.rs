//! Programs a board over its serial cable through the bootloader in its chip's ROM: [`image`] (what to write), [`chip`] (where it
//! may go), [`bootloader`] (ST's protocol, application note AN3155), [`program`] (erase, write, verify, go on where it was
//! interrupted), [`serial`] (the port).

pub mod bootloader;
pub mod chip;
pub mod image;
pub mod program;
pub mod serial;

pub use bootloader::{Bootloader, BootloaderError};
pub use chip::Chip;
pub use image::{Image, ImageError};
pub use program::{FlashError, Outcome, Step, flash};
