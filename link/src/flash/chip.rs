//! The chips that the board's program is made for, as their ROM bootloader names them (ST's AN2606) and as their flash memory
//! is divided (RM0090 and RM0390, section 3).

use std::ops::Range;

/// First address of the flash memory.
pub const FLASH_START: u32 = 0x0800_0000;

/// Number of the STM32H743. Its ROM bootloader does not listen on the pins of the Nucleo's own serial port (AN2606: USART3 on
/// PB10 and PB11), so that the debugger alone programs it.
pub const BY_DEBUGGER: u16 = 0x450;

const KIB: u32 = 1024;

/// A chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chip {
    /// Number that its bootloader answers.
    pub id: u16,
    /// Name.
    pub name: &'static str,
    /// Bytes of flash memory that any chip of this number has: the smallest sold.
    pub flash: u32,
}

/// All of them.
pub const CHIPS: [Chip; 3] = [
    Chip {
        id: 0x413,
        name: "STM32F405/407",
        flash: 512 * KIB,
    },
    Chip {
        id: 0x419,
        name: "STM32F427/429",
        flash: 1024 * KIB,
    },
    Chip {
        id: 0x421,
        name: "STM32F446",
        flash: 256 * KIB,
    },
];

impl Chip {
    /// The chip of a number.
    pub fn of(id: u16) -> Option<Self> {
        CHIPS.into_iter().find(|c| c.id == id)
    }

    /// The sector number `n` of the flash memory: four of 16 KiB, one of 64, then of 128. `None` behind the last one.
    pub fn sector(&self, n: u16) -> Option<Range<u32>> {
        let (start, len) = match u32::from(n) {
            n @ 0..4 => (n * 16 * KIB, 16 * KIB),
            4 => (64 * KIB, 64 * KIB),
            n => ((n - 4) * 128 * KIB, 128 * KIB),
        };
        (start + len <= self.flash).then(|| FLASH_START + start..FLASH_START + start + len)
    }

    /// All sectors, with their numbers.
    pub fn sectors(&self) -> impl Iterator<Item = (u16, Range<u32>)> + use<> {
        let this = *self;
        (0..).map_while(move |n| Some((n, this.sector(n)?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sectors_follow_each_other_and_fill_the_memory() {
        for chip in CHIPS {
            let mut next = FLASH_START;
            for (_, sector) in chip.sectors() {
                assert_eq!(sector.start, next);
                next = sector.end;
            }
            assert_eq!(next, FLASH_START + chip.flash, "{}", chip.name);
        }
    }
}
