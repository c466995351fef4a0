//! From a message to the bytes of a frame, in one pass.

use crate::{CRC, CRC_LEN};
use core::fmt;
use postcard::ser_flavors::Flavor;
use serde::Serialize;

/// The buffer does not hold the frame; [`crate::MAX_FROM_BOARD_LEN`] and [`crate::MAX_TO_BOARD_LEN`] always do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EncodeError {
    /// Bytes that the buffer has.
    pub buffer: usize,
}

impl fmt::Display for EncodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the framed message does not fit a buffer of {} bytes", self.buffer)
    }
}

impl core::error::Error for EncodeError {}

/// Frames a message into `buffer` and lends the bytes to send, the closing 0x00 included.
///
/// # Errors
/// The buffer is too small; its contents are then void.
pub fn encode<'a, M: Serialize + ?Sized>(message: &M, buffer: &'a mut [u8]) -> Result<&'a [u8], EncodeError> {
    let size = buffer.len();
    let framer = Framer {
        digest: CRC.digest(),
        stuffer: Stuffer {
            out: buffer,
            code_at: 0,
            end: 1,
        },
    };
    postcard::serialize_with_flavor(message, framer).map_err(|_| EncodeError { buffer: size })
}

/// Takes postcard's bytes, sums them and stuffs them.
struct Framer<'a> {
    digest: crc::Digest<'static, u32>,
    stuffer: Stuffer<'a>,
}

impl<'a> Flavor for Framer<'a> {
    type Output = &'a [u8];

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.digest.update(&[byte]);
        self.stuffer.push(byte)
    }

    fn finalize(mut self) -> postcard::Result<&'a [u8]> {
        let sum: [u8; CRC_LEN] = self.digest.finalize().to_le_bytes();
        for byte in sum {
            self.stuffer.push(byte)?;
        }
        self.stuffer.finish()
    }
}

/// COBS: every block starts with a code, the distance to the next zero that was taken out.
struct Stuffer<'a> {
    out: &'a mut [u8],
    /// Where the open block's code belongs.
    code_at: usize,
    /// Where the next byte goes.
    end: usize,
}

impl<'a> Stuffer<'a> {
    fn put(&mut self, at: usize, byte: u8) -> postcard::Result<()> {
        let place = self.out.get_mut(at).ok_or(postcard::Error::SerializeBufferFull)?;
        *place = byte;
        Ok(())
    }

    /// Writes the open block's code and opens the next block.
    fn close(&mut self) -> postcard::Result<()> {
        // A block is closed at 254 bytes, so the code fits.
        self.put(self.code_at, (self.end - self.code_at) as u8)?;
        self.code_at = self.end;
        self.end += 1;
        Ok(())
    }

    fn push(&mut self, byte: u8) -> postcard::Result<()> {
        // A full block is closed only when more follows: its end stands for no zero.
        if self.end - self.code_at == 0xFF {
            self.close()?;
        }
        if byte == 0 {
            return self.close();
        }
        self.put(self.end, byte)?;
        self.end += 1;
        Ok(())
    }

    fn finish(mut self) -> postcard::Result<&'a [u8]> {
        let end = self.end;
        self.close()?;
        self.put(end, 0)?;
        self.out.get(..=end).ok_or(postcard::Error::SerializeBufferFull)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn stuffed(bytes: &[u8]) -> Vec<u8> {
        let mut out = std::vec![0xAA; bytes.len() + bytes.len() / 254 + 2];
        let mut s = Stuffer {
            out: &mut out,
            code_at: 0,
            end: 1,
        };
        for b in bytes {
            s.push(*b).unwrap();
        }
        s.finish().unwrap().to_vec()
    }

    #[test]
    fn stuffing_follows_the_published_examples() {
        // Cheshire and Baker, Consistent Overhead Byte Stuffing, 1999.
        assert_eq!(stuffed(&[0]), [1, 1, 0]);
        assert_eq!(stuffed(&[0, 0]), [1, 1, 1, 0]);
        assert_eq!(stuffed(&[0x11, 0x22, 0, 0x33]), [3, 0x11, 0x22, 2, 0x33, 0]);
        assert_eq!(stuffed(&[0x11, 0, 0, 0]), [2, 0x11, 1, 1, 1, 0]);
        let run: Vec<u8> = (1..=254).collect();
        let full = stuffed(&run);
        assert_eq!((full.len(), full[0], full[255]), (256, 0xFF, 0));
        let longer: Vec<u8> = (1..=255).collect();
        let two = stuffed(&longer);
        assert_eq!((two[0], &two[255..]), (0xFF, &[2, 0xFF, 0][..]));
    }

    #[test]
    fn a_small_buffer_is_an_error_not_a_cut_frame() {
        let mut room = [0; 64];
        let size = encode(&[7u8; 20], &mut room).unwrap().len();
        for n in 0..size {
            assert_eq!(encode(&[7u8; 20], &mut room[..n]), Err(EncodeError { buffer: n }));
        }
        assert!(encode(&[7u8; 20], &mut room[..size]).is_ok());
    }
}
