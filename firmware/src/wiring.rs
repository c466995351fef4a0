//! What a scan knows of the board.

use crate::codes::LEAST_BITS;

/// How a board's channels and converters are wired, as [`BoardInfo`](crate::BoardInfo) says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wiring {
    /// Electrodes.
    pub electrodes: u8,
    /// Bits of a code.
    pub adc_bits: u8,
    /// Channels that a converter takes in turn.
    pub in_turn: u8,
    /// Timer ticks from one conversion to the next one of the same converter and row.
    pub skew_ticks: u16,
    /// Timer ticks from one row to the next.
    pub ticks_per_sample: u32,
}

impl Wiring {
    /// One converter of 12 bits and one channel.
    pub const fn one_channel(electrodes: u8) -> Self {
        Self {
            electrodes,
            adc_bits: LEAST_BITS,
            in_turn: 1,
            skew_ticks: 0,
            ticks_per_sample: 1,
        }
    }
}
