//! Programming a board, against a model of the bootloader in its ROM, with everything that can go wrong.

use hil_sim::{BootFaults, BootRom};
use link::flash::bootloader::{BootPort, BootloaderError};
use link::flash::chip::FLASH_START;
use link::flash::image::TAG;
use link::flash::{Bootloader, FlashError, Image, Outcome, flash};
use proptest::prelude::*;
use std::io::{self, Read, Write};
use std::time::Duration;

/// The model's chip, lent: what it holds outlives a connection.
struct Wire<'a>(&'a mut BootRom);

impl Read for Wire<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer)
    }
}

impl Write for Wire<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

impl BootPort for Wire<'_> {
    fn set_boot(&mut self, high: bool) -> io::Result<()> {
        self.0.boot_line(high);
        Ok(())
    }

    fn set_reset(&mut self, held: bool) -> io::Result<()> {
        self.0.reset_line(held);
        Ok(())
    }

    fn wait(&mut self, _: Duration) {}

    fn clear(&mut self) -> io::Result<()> {
        self.0.clear();
        Ok(())
    }
}

/// The two lines joined by a transistor, as drawn in docs/board.md: reset while RTS is asserted and DTR is not. BOOT0 follows
/// DTR at once, the reset some milliseconds after its line.
struct Joined<'a> {
    chip: Wire<'a>,
    rts: bool,
    dtr: bool,
}

impl Joined<'_> {
    fn lines(&mut self, rts: bool, dtr: bool) -> io::Result<()> {
        (self.rts, self.dtr) = (rts, dtr);
        self.chip.set_boot(dtr)?;
        self.chip.set_reset(rts && !dtr)
    }
}

impl Read for Joined<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.chip.read(buffer)
    }
}

impl Write for Joined<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.chip.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.chip.flush()
    }
}

impl BootPort for Joined<'_> {
    fn set_boot(&mut self, high: bool) -> io::Result<()> {
        self.lines(self.rts, high)
    }

    fn set_reset(&mut self, held: bool) -> io::Result<()> {
        self.lines(held, self.dtr)
    }

    fn wait(&mut self, _: Duration) {}

    fn clear(&mut self) -> io::Result<()> {
        self.chip.clear()
    }
}

const F446: u16 = 0x421;

/// A program like the board's: vectors at the start, the rest from 64 KiB on, bytes of no pattern.
fn image(chip: u16, len: usize, seed: u32) -> Image {
    let mut x = seed | 1;
    let mut byte = || {
        x ^= x << 13;
        x ^= x >> 17;
        x ^= x << 5;
        x as u8
    };
    let vectors = (0..452).map(|_| byte()).collect();
    let code = (0..len).map(|_| byte()).collect();
    Image::new(chip, vec![(FLASH_START, vectors), (FLASH_START + 0x1_0000, code)]).unwrap()
}

/// Whether the chip holds the image, and erased memory between its pieces.
fn holds(rom: &BootRom, image: &Image) -> bool {
    image.pieces.iter().all(|(start, data)| {
        let at = (start - FLASH_START) as usize;
        rom.flash[at..at + data.len()] == data[..]
    })
}

fn programmed(rom: &mut BootRom, image: &Image) -> Result<Outcome, FlashError> {
    let mut bootloader = Bootloader::connect(Wire(rom), true)?;
    let outcome = flash(&mut bootloader, image, |_, done, all| assert!(done <= all))?;
    bootloader.start(FLASH_START, true)?;
    Ok(outcome)
}

#[test]
fn a_bare_chip_is_programmed_and_started() {
    let (mut rom, image) = (BootRom::new(F446, 512), image(F446, 40_001, 1));
    let outcome = programmed(&mut rom, &image).unwrap();
    assert!(holds(&rom, &image) && rom.runs_program());
    assert_eq!((outcome.erased, outcome.kept), (0, 0));
    // What is there already is not written again.
    let again = programmed(&mut rom, &image).unwrap();
    assert_eq!((again.written, again.erased), (0, 0));
    assert_eq!(again.kept, outcome.written);
}

#[test]
fn with_the_lines_joined_it_is_programmed_too_and_a_terminal_does_not_hold_it() {
    let image = image(F446, 5_000, 9);
    let mut rom = BootRom::new(F446, 512);
    fn joined(rom: &mut BootRom) -> Joined<'_> {
        let (chip, rts, dtr) = (Wire(rom), false, false);
        Joined { chip, rts, dtr }
    }
    let mut bootloader = Bootloader::connect(joined(&mut rom), true).unwrap();
    flash(&mut bootloader, &image, |_, _, _| {}).unwrap();
    bootloader.start(FLASH_START, true).unwrap();
    assert!(rom.runs_program() && holds(&rom, &image));
    // A terminal: both lines as it opens the port, neither as it closes it, in either order. Whatever it does on the way, the
    // program runs while it is open, and afterwards.
    for close in [[(true, false), (false, false)], [(false, true), (false, false)]] {
        let mut port = joined(&mut rom);
        port.lines(true, true).unwrap();
        assert!(port.chip.0.runs_program());
        for (rts, dtr) in close {
            port.lines(rts, dtr).unwrap();
        }
        assert!(rom.runs_program());
    }
}

#[test]
fn another_program_takes_its_place_and_the_settings_stay() {
    let mut rom = BootRom::new(F446, 512);
    programmed(&mut rom, &image(F446, 50_000, 1)).unwrap();
    // Sectors 2 and 3.
    rom.flash[0x8000..0x1_0000].fill(0x5A);
    let second = image(F446, 30_000, 2);
    let outcome = programmed(&mut rom, &second).unwrap();
    assert!(holds(&rom, &second));
    assert!(rom.flash[0x8000..0x1_0000].iter().all(|b| *b == 0x5A));
    assert_eq!(outcome.erased, 2);
}

#[test]
fn an_image_for_another_chip_is_refused_and_nothing_changes() {
    for (chip, other) in [(F446, 0x413), (0x413, F446), (F446, 0x419), (F446, 0x433)] {
        let mut rom = BootRom::new(other, 1024);
        rom.flash[..1000].fill(0x11);
        let before = rom.flash.clone();
        let refused = programmed(&mut rom, &image(chip, 1000, 1)).unwrap_err();
        assert!(matches!(refused, FlashError::Chip { .. }), "{refused}");
        assert!(refused.to_string().contains("nothing was changed"));
        assert!(rom.flash == before && rom.erased == 0);
    }
    let mut rom = BootRom::new(F446, 512);
    let refused = programmed(&mut rom, &image(F446, 300_000, 1)).unwrap_err();
    assert!(matches!(refused, FlashError::Size { .. }), "{refused}");
}

#[test]
fn a_pulled_cable_at_any_moment_is_gone_on_with() {
    let image = image(F446, 6_000, 3);
    let old = {
        let mut rom = BootRom::new(F446, 256);
        programmed(&mut rom, &self::image(F446, 9_000, 4)).unwrap();
        rom
    };
    // Every moment of the first bytes, then many.
    for pulled in (0..200).chain((200..40_000).step_by(487)) {
        let mut rom = old.clone().with(BootFaults {
            pulled_after: Some(pulled),
            ..BootFaults::default()
        });
        let first = programmed(&mut rom, &image);
        if let Err(e) = &first {
            assert!(
                matches!(e, FlashError::Bootloader(BootloaderError::Port(_))),
                "after {pulled}: {e}"
            );
            assert!(e.to_string().contains("goes on where it stopped"), "{e}");
        }
        let erased = rom.erased;
        let mut rom = rom.with(BootFaults::default());
        let second = programmed(&mut rom, &image).unwrap();
        assert!(holds(&rom, &image), "after {pulled}");
        // What was done before is not done again: no sector is erased twice.
        assert!(
            rom.erased <= old.erased + 2,
            "after {pulled}: {erased} and then {second:?}"
        );
    }
}

#[test]
fn a_noisy_line_costs_time_not_a_wrong_byte() {
    for every in [97, 211, 499, 1009, 5003] {
        let image = image(F446, 5_000, every as u32);
        let mut rom = BootRom::new(F446, 256).with(BootFaults {
            flip_every: Some(every),
            ..BootFaults::default()
        });
        match programmed(&mut rom, &image) {
            Ok(_) => assert!(holds(&rom, &image)),
            // A line so bad that three tries do not get through is an error that says so.
            Err(e) => assert!(every < 500, "{every}: {e}"),
        }
    }
}

#[test]
fn a_worn_out_cell_is_found() {
    let mut rom = BootRom::new(F446, 256).with(BootFaults {
        dead_cell: Some(0x1_0123),
        ..BootFaults::default()
    });
    let error = programmed(&mut rom, &image(F446, 2_000, 5)).unwrap_err();
    assert!(
        matches!(error, FlashError::Verify(at) if at == FLASH_START + 0x1_0123),
        "{error}"
    );
    assert!(!rom.runs_program());
}

#[test]
fn a_protected_chip_is_said_to_be_protected() {
    let mut rom = BootRom::new(F446, 256).with(BootFaults {
        protected: true,
        ..BootFaults::default()
    });
    let error = programmed(&mut rom, &image(F446, 2_000, 6)).unwrap_err();
    assert!(error.to_string().contains("protected"), "{error}");
}

#[test]
fn without_the_two_lines_it_is_done_by_hand() {
    let unwired = BootFaults {
        unwired: true,
        ..BootFaults::default()
    };
    let mut rom = BootRom::new(F446, 256).with(unwired);
    let image = image(F446, 2_000, 7);
    let error = programmed(&mut rom, &image).unwrap_err();
    assert!(error.to_string().contains("--manual"), "{error}");
    rom.press_reset_in_bootloader();
    let mut bootloader = Bootloader::connect(Wire(&mut rom), false).unwrap();
    flash(&mut bootloader, &image, |_, _, _| {}).unwrap();
    bootloader.start(FLASH_START, false).unwrap();
    assert!(holds(&rom, &image) && rom.runs_program());
}

/// An ELF file with these loadable segments (address, bytes) for a machine.
fn elf(machine: u16, segments: &[(u32, &[u8])]) -> Vec<u8> {
    let half = |out: &mut Vec<u8>, v: u16| out.extend(v.to_le_bytes());
    let word = |out: &mut Vec<u8>, v: u32| out.extend(v.to_le_bytes());
    let mut out = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
    half(&mut out, 2);
    half(&mut out, machine);
    for v in [1, 0, 52, 0, 0] {
        word(&mut out, v);
    }
    for v in [52, 32, segments.len() as u16, 40, 0, 0] {
        half(&mut out, v);
    }
    let mut offset = 52 + 32 * segments.len() as u32;
    for (address, data) in segments {
        let len = data.len() as u32;
        for v in [1, offset, *address, *address, len, len, 5, 4] {
            word(&mut out, v);
        }
        offset += len;
    }
    for (_, data) in segments {
        out.extend(*data);
    }
    out
}

#[test]
fn a_program_file_is_read_by_its_segments_and_its_tag() {
    let tagged = [TAG, &b"421"[..]].concat();
    let file = elf(40, &[(FLASH_START + 0x1_0000, &tagged), (FLASH_START, &[7; 64])]);
    let image = Image::read(&file).unwrap();
    assert_eq!(
        (image.chip, image.pieces.len(), image.pieces[0].0),
        (F446, 2, FLASH_START)
    );
    assert!(Image::read(&elf(40, &[(FLASH_START, &[7; 64])])).is_err());
    assert!(Image::read(&elf(62, &[(FLASH_START, &tagged)])).is_err());
    assert!(Image::read(&elf(40, &[(0x2000_0000, &tagged)])).is_err());
}

proptest! {
    #[test]
    fn no_file_makes_the_reader_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        let _ = Image::read(&bytes);
        let mut file = elf(40, &[(FLASH_START, &[1; 80])]);
        for (place, byte) in file.iter_mut().skip(16).zip(&bytes) {
            *place ^= byte & 0x11;
        }
        let _ = Image::read(&file);
    }

    /// What answers nonsense is an error, never a hang or a panic.
    #[test]
    fn any_answers_end_in_an_error(answers in proptest::collection::vec(any::<u8>(), 0..400)) {
        struct Babble(std::collections::VecDeque<u8>);
        impl Read for Babble {
            fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
                let byte = self.0.pop_front().ok_or(io::ErrorKind::TimedOut)?;
                buffer[0] = byte;
                Ok(1)
            }
        }
        impl Write for Babble {
            fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
                Ok(bytes.len())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        impl BootPort for Babble {
            fn set_boot(&mut self, _: bool) -> io::Result<()> {
                Ok(())
            }
            fn set_reset(&mut self, _: bool) -> io::Result<()> {
                Ok(())
            }
            fn wait(&mut self, _: Duration) {}
            fn clear(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        if let Ok(mut bootloader) = Bootloader::connect(Babble(answers.into()), true) {
            let _ = flash(&mut bootloader, &image(F446, 500, 8), |_, _, _| {});
        }
    }
}
