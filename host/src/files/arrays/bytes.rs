//! Numbers in bytes; every length is checked against what there is.

use std::io::Read;

/// Most bytes that a compressed part may unpack to: ten minutes of frames take 0.2 GB.
const MOST_UNPACKED: u64 = 1 << 30;

/// How a number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Number {
    /// A signed integer of so many bytes.
    Signed(usize),
    /// An unsigned integer of so many bytes.
    Unsigned(usize),
    /// IEEE 754 of 4 or 8 bytes.
    Float(usize),
}

impl Number {
    /// Bytes of one.
    pub(super) fn size(self) -> usize {
        let (Self::Signed(size) | Self::Unsigned(size) | Self::Float(size)) = self;
        size
    }

    /// One number of [`Number::size`] bytes.
    fn decode(self, bytes: &[u8], big_endian: bool) -> f64 {
        let mut bits = 0_u64;
        for k in 0..bytes.len() {
            let place = if big_endian { k } else { bytes.len() - 1 - k };
            bits = bits << 8 | u64::from(bytes[place]);
        }
        let spare = 64 - 8 * bytes.len() as u32;
        match self {
            Self::Float(4) => f64::from(f32::from_bits(bits as u32)),
            Self::Float(_) => f64::from_bits(bits),
            Self::Unsigned(_) => bits as f64,
            Self::Signed(_) => ((bits << spare) as i64 >> spare) as f64,
        }
    }

    /// So many numbers, or none where the bytes do not hold them.
    pub(super) fn list(self, bytes: &[u8], count: usize, big_endian: bool) -> Option<Vec<f64>> {
        let size = self.size();
        let used = bytes.get(..count.checked_mul(size)?)?;
        Some(
            used.chunks_exact(size)
                .map(|one| self.decode(one, big_endian))
                .collect(),
        )
    }
}

/// A little-endian integer of 2 or 4 bytes at a place.
pub(super) fn integer(bytes: &[u8], at: usize, size: usize) -> Option<usize> {
    let part = bytes.get(at..at.checked_add(size)?)?;
    Some(part.iter().rev().fold(0, |all, byte| all << 8 | usize::from(*byte)))
}

/// Everything that a decompressor gives, within bounds.
pub(super) fn unpack(packed: impl Read) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    packed
        .take(MOST_UNPACKED + 1)
        .read_to_end(&mut out)
        .map_err(|cause| format!("a compressed part is damaged ({cause}); save the file again"))?;
    if out.len() as u64 > MOST_UNPACKED {
        return Err("a compressed part unpacks to more than 1 GB; save fewer frames in a file".to_owned());
    }
    Ok(out)
}

/// Row by row from column by column.
pub(super) fn transposed(values: &[f64], rows: usize, columns: usize) -> Vec<f64> {
    (0..rows)
        .flat_map(|r| (0..columns).map(move |c| values[c * rows + r]))
        .collect()
}
