//! From any stream of bytes to messages.

use crate::error::FrameError;
use crate::hello::Version;
use crate::{CRC, CRC_LEN};
use serde::de::DeserializeOwned;

/// What a decoder has seen. Each counter stays at `u32::MAX` once it is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecoderCounters {
    /// Messages delivered.
    pub messages: u32,
    /// Frames whose CRC did not match.
    pub crc: u32,
    /// Frames too long for the buffer.
    pub overflow: u32,
    /// Frames that were not COBS, too short, or of an unknown message.
    pub malformed: u32,
}

/// Finds framed messages in a stream of bytes. `N` bounds the unstuffed message and its CRC;
/// [`crate::MAX_FROM_BOARD_LEN`] and [`crate::MAX_TO_BOARD_LEN`] are always enough.
///
/// What it delivers depends on the bytes alone, never on how they were cut into pieces: the state moves byte by byte,
/// and after an overflow everything up to the next zero is skipped.
#[derive(Clone, Debug)]
pub struct Decoder<const N: usize> {
    body: [u8; N],
    len: usize,
    /// Bytes left of the open COBS block.
    left: u8,
    block: Block,
    /// What was counted so far.
    pub counters: DecoderCounters,
    /// The version that an introduction announced which was undamaged and could not be read; whoever deals with it takes it.
    pub foreign: Option<Version>,
}

/// What stands before the next COBS code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Block {
    /// Nothing: a frame starts here.
    First,
    /// A block that stands for a zero after it.
    Zero,
    /// A full block: no zero after it.
    Full,
    /// The frame is too long; wait for its end.
    Skip,
}

impl<const N: usize> Default for Decoder<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Decoder<N> {
    /// An empty decoder. It takes the stream's first byte for the start of a frame; in the middle of a frame that frame
    /// is lost, and the next one is whole.
    pub const fn new() -> Self {
        Self {
            body: [0; N],
            len: 0,
            left: 0,
            block: Block::First,
            counters: DecoderCounters {
                messages: 0,
                crc: 0,
                overflow: 0,
                malformed: 0,
            },
            foreign: None,
        }
    }

    /// Takes the next bytes of the stream and calls `deliver` for every frame that ends in them. Zeros with nothing
    /// between them are no frame.
    pub fn push<M: DeserializeOwned>(&mut self, bytes: &[u8], mut deliver: impl FnMut(Result<M, FrameError>)) {
        for byte in bytes {
            if let Some(result) = self.push_byte(*byte) {
                deliver(result);
            }
        }
    }

    /// Takes one byte; the result of the frame that it ends, if it ends one.
    pub fn push_byte<M: DeserializeOwned>(&mut self, byte: u8) -> Option<Result<M, FrameError>> {
        if byte == 0 {
            return self.end();
        }
        if self.left > 0 {
            self.left -= 1;
            self.store(byte);
            return None;
        }
        match self.block {
            Block::Skip => return None,
            Block::Zero => self.store(0),
            Block::First | Block::Full => {}
        }
        if self.block != Block::Skip {
            self.left = byte - 1;
            self.block = if byte == 0xFF { Block::Full } else { Block::Zero };
        }
        None
    }

    fn store(&mut self, byte: u8) {
        if let Some(place) = self.body.get_mut(self.len) {
            *place = byte;
            self.len += 1;
        } else {
            self.block = Block::Skip;
            self.left = 0;
        }
    }

    /// The delimiter came: judges the frame and makes ready for the next.
    fn end<M: DeserializeOwned>(&mut self) -> Option<Result<M, FrameError>> {
        let (block, left, len) = (self.block, self.left, self.len);
        self.block = Block::First;
        self.left = 0;
        self.len = 0;
        let result = match block {
            Block::First => return None,
            Block::Skip => Err(FrameError::Overflow),
            _ if left > 0 => Err(FrameError::Cobs),
            _ => read(self.body.get(..len).unwrap_or_default()),
        };
        // Both enums begin with an introduction, and an introduction with its version: that much every version keeps.
        if let (Err(FrameError::Unknown), Some([0, major, minor, ..])) = (&result, self.body.get(..len))
            && len > CRC_LEN + 2
        {
            self.foreign = Some(Version {
                major: *major,
                minor: *minor,
            });
        }
        let c = &mut self.counters;
        let counter = match &result {
            Ok(_) => &mut c.messages,
            Err(FrameError::Overflow) => &mut c.overflow,
            Err(FrameError::Crc) => &mut c.crc,
            Err(_) => &mut c.malformed,
        };
        *counter = counter.saturating_add(1);
        Some(result)
    }
}

/// Checks the CRC at the end and reads the message before it.
fn read<M: DeserializeOwned>(bytes: &[u8]) -> Result<M, FrameError> {
    let (message, sum) = bytes.split_last_chunk::<CRC_LEN>().ok_or(FrameError::Short)?;
    if message.is_empty() {
        return Err(FrameError::Short);
    }
    if CRC.checksum(message) != u32::from_le_bytes(*sum) {
        return Err(FrameError::Crc);
    }
    // A later minor version may have appended to the message: bytes left over are no error.
    postcard::take_from_bytes(message)
        .map(|(m, _)| m)
        .map_err(|_| FrameError::Unknown)
}
