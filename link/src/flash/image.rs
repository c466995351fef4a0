//! A program as a file: pieces of memory with their addresses, and the chip that it is made for.

use super::chip::{BY_DEBUGGER, Chip, FLASH_START};
use object::read::elf::{FileHeader, ProgramHeader};
use object::{Endianness, elf};
use thiserror::Error;

/// What stands before the chip's number (three hexadecimal digits) in every program for the sensor board.
pub const TAG: &[u8] = b"skin-board-image for chip 0x";

/// Why a file is no program for a board.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ImageError {
    /// Not an ELF file.
    #[error(
        "not a program (ELF) file: give the file that cargo builds for the board, such as target/thumbv7em-none-eabihf/release/skin-board"
    )]
    Format,
    /// An ELF file of another kind of machine.
    #[error("a program for another kind of processor, not for a microcontroller")]
    Machine,
    /// Nothing in it.
    #[error("nothing in it to write")]
    Empty,
    /// Outside of the flash memory.
    #[error("a piece at 0x{0:08x} is outside of the flash memory (0x08000000 and on)")]
    Address(u32),
    /// Two pieces at one place.
    #[error("two pieces overlap at 0x{0:08x}")]
    Overlap(u32),
    /// It does not say what it is.
    #[error("not the sensor board's program: it does not say which chip it is for")]
    Untagged,
    /// For the board with sixteen channels.
    #[error(
        "for the NUCLEO-H743ZI2, whose bootloader does not listen on the board's serial port: program it with its debugger, as by \
         `probe-rs download --chip STM32H743ZITx FILE` (docs/board.md)"
    )]
    ByDebugger,
}

/// A program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Number of the chip that it says it is for.
    pub chip: u16,
    /// Pieces by rising address, not empty and without overlap.
    pub pieces: Vec<(u32, Vec<u8>)>,
}

impl Image {
    /// Reads an ELF file.
    ///
    /// # Errors
    /// [`ImageError`] says what is wrong with it.
    pub fn read(bytes: &[u8]) -> Result<Self, ImageError> {
        let header = elf::FileHeader32::<Endianness>::parse(bytes).map_err(|_| ImageError::Format)?;
        let endian = header.endian().map_err(|_| ImageError::Format)?;
        if header.e_machine(endian) != elf::EM_ARM {
            return Err(ImageError::Machine);
        }
        let mut pieces: Vec<(u32, &[u8])> = Vec::new();
        for segment in header.program_headers(endian, bytes).map_err(|_| ImageError::Format)? {
            if segment.p_type(endian) != elf::PT_LOAD || segment.p_filesz(endian) == 0 {
                continue;
            }
            let data = segment.data(endian, bytes).map_err(|()| ImageError::Format)?;
            pieces.push((segment.p_paddr(endian), data));
        }
        // Before anything is copied: pieces may all be the same part of the file, and more than memory holds.
        pieces.sort_by_key(|(start, _)| *start);
        apart_in_flash(&pieces)?;
        let chip = pieces
            .iter()
            .find_map(|(_, data)| tagged(data))
            .ok_or(ImageError::Untagged)?;
        if chip == BY_DEBUGGER {
            return Err(ImageError::ByDebugger);
        }
        let pieces = pieces.into_iter().map(|(start, data)| (start, data.to_vec())).collect();
        Ok(Self { chip, pieces })
    }

    /// A program of these pieces.
    ///
    /// # Errors
    /// No piece, pieces that overlap or are not in flash memory.
    pub fn new(chip: u16, mut pieces: Vec<(u32, Vec<u8>)>) -> Result<Self, ImageError> {
        pieces.retain(|(_, data)| !data.is_empty());
        pieces.sort_by_key(|(start, _)| *start);
        apart_in_flash(&pieces)?;
        Ok(Self { chip, pieces })
    }

    /// Bytes in all pieces.
    pub fn len(&self) -> usize {
        self.pieces.iter().map(|(_, data)| data.len()).sum()
    }

    /// Never: there is no empty program.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The chip's name, or its number.
    pub fn chip_name(&self) -> String {
        Chip::of(self.chip).map_or_else(|| format!("chip 0x{:03x}", self.chip), |c| c.name.to_owned())
    }
}

/// Checks that pieces, sorted by their addresses, are there, do not overlap and are in flash memory.
fn apart_in_flash(pieces: &[(u32, impl AsRef<[u8]>)]) -> Result<(), ImageError> {
    if pieces.is_empty() {
        return Err(ImageError::Empty);
    }
    let mut free = u64::from(FLASH_START);
    for (start, data) in pieces {
        let end = u64::from(*start) + data.as_ref().len() as u64;
        if *start < FLASH_START || end > 0x1000_0000 {
            return Err(ImageError::Address(*start));
        }
        if u64::from(*start) < free {
            return Err(ImageError::Overlap(*start));
        }
        free = end;
    }
    Ok(())
}

fn tagged(data: &[u8]) -> Option<u16> {
    let at = data.windows(TAG.len()).position(|w| w == TAG)? + TAG.len();
    let digits = std::str::from_utf8(data.get(at..at + 3)?).ok()?;
    u16::from_str_radix(digits, 16).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_no_program_is_refused_with_what_to_do() {
        assert_eq!(Image::read(b""), Err(ImageError::Format));
        assert_eq!(Image::read(b"#!/bin/sh\n"), Err(ImageError::Format));
        // A program of the PC's own is 64-bit.
        assert_eq!(
            Image::read(b"\x7fELF\x02\x01\x01\0\0\0\0\0\0\0\0\0"),
            Err(ImageError::Format)
        );
    }

    /// An ELF file whose segments are all of its last bytes, at these addresses.
    fn elf(addresses: &[u32], len: u32) -> Vec<u8> {
        elf_for(0x421, addresses, len)
    }

    /// The same for a chip.
    fn elf_for(chip: u16, addresses: &[u32], len: u32) -> Vec<u8> {
        let count = addresses.len() as u16;
        let data = 52 + 32 * u32::from(count);
        let mut file = b"\x7fELF\x01\x01\x01".to_vec();
        file.resize(16, 0);
        for (value, size) in [
            (2, 2),
            (u32::from(elf::EM_ARM), 2),
            (1, 4),
            (0, 4),
            (52, 4),
            (0, 4),
            (0, 4),
            (52, 2),
            (32, 2),
        ] {
            file.extend(&u32::to_le_bytes(value)[..size]);
        }
        file.extend(count.to_le_bytes());
        file.extend([0; 6]);
        for address in addresses {
            for word in [1, data, *address, *address, len, len, 5, 4] {
                file.extend(u32::to_le_bytes(word));
            }
        }
        let text = format!("{}{chip:03x}", std::str::from_utf8(TAG).unwrap());
        file.extend(text.as_bytes());
        file.resize((data + len) as usize, 0);
        file
    }

    #[test]
    fn a_program_that_the_line_cannot_carry_is_refused_with_what_can() {
        let refused = Image::read(&elf_for(BY_DEBUGGER, &[FLASH_START], 4096)).unwrap_err();
        assert_eq!(refused, ImageError::ByDebugger);
        assert!(
            refused.to_string().contains("probe-rs download --chip STM32H743"),
            "{refused}"
        );
    }

    #[test]
    fn overlapping_segments_are_refused_before_they_are_copied() {
        let image = Image::read(&elf(&[FLASH_START + 4096, FLASH_START], 4096)).unwrap();
        assert_eq!((image.chip, image.len(), image.pieces[0].0), (0x421, 8192, FLASH_START));
        // 8 GB if they were copied.
        let many = vec![FLASH_START; 8192];
        assert_eq!(Image::read(&elf(&many, 1 << 20)), Err(ImageError::Overlap(FLASH_START)));
    }

    #[test]
    fn pieces_are_sorted_and_must_be_apart_and_in_flash() {
        let image = Image::new(0x421, vec![(FLASH_START + 64, vec![1; 4]), (FLASH_START, vec![2; 64])]).unwrap();
        assert_eq!((image.pieces[0].0, image.len()), (FLASH_START, 68));
        let overlapping = vec![(FLASH_START, vec![0; 5]), (FLASH_START + 4, vec![0; 4])];
        assert_eq!(
            Image::new(0x421, overlapping),
            Err(ImageError::Overlap(FLASH_START + 4))
        );
        assert_eq!(
            Image::new(0x421, vec![(0x2000_0000, vec![0])]),
            Err(ImageError::Address(0x2000_0000))
        );
        assert_eq!(Image::new(0x421, vec![]), Err(ImageError::Empty));
    }
}
