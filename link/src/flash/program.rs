//! From an image to a programmed and verified chip.
//!
//! What the chip holds already is read first and left as it is where it is right. So an interrupted run is gone on with by just
//! repeating it: there is no state to lose.

use super::bootloader::{BootPort, Bootloader, BootloaderError, CHUNK};
use super::chip::{Chip, FLASH_START};
use super::image::Image;
use std::ops::Range;
use thiserror::Error;

/// Erased memory.
const ERASED: u8 = 0xFF;

/// Why a board was not programmed.
#[derive(Debug, Error)]
pub enum FlashError {
    /// The bootloader.
    #[error(transparent)]
    Bootloader(#[from] BootloaderError),
    /// An image for another chip.
    #[error(
        "the program is for the {image}, the board has {board}: nothing was changed; build the program for this chip \
         (see docs/board.md)"
    )]
    Chip {
        /// What the image is for.
        image: String,
        /// What answered.
        board: String,
    },
    /// An image that is too large.
    #[error("the program goes to 0x{end:08x}, the chip's flash memory ends at 0x{most:08x}: nothing was changed")]
    Size {
        /// First address behind the image.
        end: u32,
        /// First address behind the memory.
        most: u32,
    },
    /// The chip does not hold what was written.
    #[error(
        "the memory at 0x{0:08x} does not hold what was written: repeat the command; if that does not help, the chip is worn out"
    )]
    Verify(u32),
}

/// How far it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Compares what the chip holds.
    Compare,
    /// Erases sectors.
    Erase,
    /// Writes.
    Write,
    /// Reads back what was written.
    Verify,
}

/// What was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Bytes that were there already.
    pub kept: usize,
    /// Bytes written.
    pub written: usize,
    /// Sectors erased.
    pub erased: usize,
}

/// A part of the image that one command writes.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Part {
    address: u32,
    data: Vec<u8>,
}

/// Cuts an image into parts that begin at multiples of four, with as many bytes, and lie in one sector each; the gaps that
/// this leaves are erased memory.
fn parts(image: &Image, sector: &Range<u32>) -> Vec<Part> {
    let mut out: Vec<Part> = Vec::new();
    for (start, data) in &image.pieces {
        for (address, byte) in (*start..).zip(data).filter(|(a, _)| sector.contains(a)) {
            let place = address - address % CHUNK as u32;
            if out.last().is_none_or(|p| p.address != place) {
                out.push(Part {
                    address: place,
                    data: vec![ERASED; CHUNK],
                });
            }
            if let Some(part) = out.last_mut() {
                part.data[(address - place) as usize] = *byte;
            }
        }
    }
    out
}

/// Programs a chip. `progress` is told every step with how much of it is done, in bytes or sectors.
///
/// # Errors
/// [`FlashError`] says what to do. Nothing was changed when the image does not suit the chip.
pub fn flash<P: BootPort>(
    bootloader: &mut Bootloader<P>,
    image: &Image,
    mut progress: impl FnMut(Step, usize, usize),
) -> Result<Outcome, FlashError> {
    let board =
        || Chip::of(bootloader.chip).map_or_else(|| format!("chip 0x{:03x}", bootloader.chip), |c| c.name.to_owned());
    let Some(chip) = Chip::of(bootloader.chip).filter(|c| c.id == image.chip) else {
        return Err(FlashError::Chip {
            image: image.chip_name(),
            board: board(),
        });
    };
    let end = image.pieces.last().map_or(0, |(start, data)| start + data.len() as u32);
    let most = FLASH_START + chip.flash;
    if end > most {
        return Err(FlashError::Size { end, most });
    }

    // The first part, with the vectors, comes last: a program that is not whole is never started.
    let mut todo = Vec::new();
    let mut erase = Vec::new();
    let mut outcome = Outcome::default();
    let total = image.len();
    let mut compared = 0;
    for (number, sector) in chip.sectors() {
        let parts = parts(image, &sector);
        let mut missing = Vec::new();
        let mut dirty = false;
        for part in &parts {
            let mut held = vec![0; part.data.len()];
            bootloader.read(part.address, &mut held)?;
            if held != part.data {
                missing.push(part.clone());
                dirty |= held.iter().any(|b| *b != ERASED);
            }
            compared += part.data.len();
            progress(Step::Compare, compared.min(total), total);
        }
        if dirty {
            erase.push(number);
            todo.extend(parts);
        } else {
            outcome.kept += (parts.len() - missing.len()) * CHUNK;
            todo.extend(missing);
        }
    }
    for (k, sector) in erase.iter().enumerate() {
        progress(Step::Erase, k, erase.len());
        bootloader.erase(*sector)?;
        outcome.erased += 1;
    }
    if !erase.is_empty() {
        progress(Step::Erase, erase.len(), erase.len());
    }
    todo.sort_by_key(|part| std::cmp::Reverse(part.address));
    let bytes = todo.len() * CHUNK;
    for part in &todo {
        bootloader.write(part.address, &part.data)?;
        outcome.written += part.data.len();
        progress(Step::Write, outcome.written, bytes);
    }
    let mut verified = 0;
    for part in &todo {
        let mut held = vec![0; part.data.len()];
        bootloader.read(part.address, &mut held)?;
        if let Some(at) = held.iter().zip(&part.data).position(|(a, b)| a != b) {
            return Err(FlashError::Verify(part.address + at as u32));
        }
        verified += part.data.len();
        progress(Step::Verify, verified, bytes);
    }
    Ok(outcome)
}
