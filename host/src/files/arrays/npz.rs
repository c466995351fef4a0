//! Arrays of numpy in a zip archive (.npz), plain or deflated.

use super::Array;
use super::bytes::{integer, unpack};
use super::npy;
use flate2::read::DeflateDecoder;

/// The end of an archive: its signature, and the longest comment behind its 22 bytes.
const END: &[u8] = b"PK\x05\x06";
const END_LENGTH: usize = 22;
const MOST_COMMENT: usize = 65_535;
const ENTRY: &[u8] = b"PK\x01\x02";
const LOCAL: &[u8] = b"PK\x03\x04";
/// A size that stands elsewhere: the archive is larger than 4 GB.
const ELSEWHERE: usize = 0xFFFF_FFFF;

/// Reads the arrays of an archive, in its order.
///
/// # Errors
/// What is wrong, and what to do.
pub(super) fn parse(bytes: &[u8]) -> Result<Vec<Array>, String> {
    let cut = || "the archive is cut short; save it again with numpy.savez".to_owned();
    let from = bytes.len().saturating_sub(END_LENGTH + MOST_COMMENT);
    let end = bytes[from..]
        .windows(END.len())
        .rposition(|window| window == END)
        .map(|place| place + from)
        .filter(|place| place + END_LENGTH <= bytes.len())
        .ok_or_else(cut)?;
    let count = integer(bytes, end + 10, 2).ok_or_else(cut)?;
    let mut at = integer(bytes, end + 16, 4).ok_or_else(cut)?;
    let mut arrays = Vec::new();
    for _ in 0..count {
        let field = |offset: usize, size| integer(bytes, at.checked_add(offset)?, size);
        let entry = bytes.get(at..).filter(|rest| rest.starts_with(ENTRY)).ok_or_else(cut)?;
        let lengths = [28, 30, 32].map(|offset| field(offset, 2));
        let [Some(name_length), Some(extra), Some(comment)] = lengths else {
            return Err(cut());
        };
        let (Some(method), Some(packed), Some(place)) = (field(10, 2), field(20, 4), field(42, 4)) else {
            return Err(cut());
        };
        let name = String::from_utf8_lossy(entry.get(46..46 + name_length).ok_or_else(cut)?).into_owned();
        at += 46 + name_length + extra + comment;
        let Some(stem) = name.strip_suffix(".npy") else {
            continue;
        };
        if packed == ELSEWHERE || place == ELSEWHERE {
            return Err(format!("{stem} is larger than 4 GB; save fewer frames in a file"));
        }
        let local = bytes
            .get(place..)
            .filter(|rest| rest.starts_with(LOCAL))
            .ok_or_else(cut)?;
        let (Some(names), Some(extras)) = (integer(local, 26, 2), integer(local, 28, 2)) else {
            return Err(cut());
        };
        let start = 30 + names + extras;
        let data = local.get(start..start.saturating_add(packed)).ok_or_else(cut)?;
        let array = match method {
            0 => npy::parse(stem, data),
            8 => npy::parse(stem, &unpack(DeflateDecoder::new(data))?),
            _ => Err("it is compressed in an unknown way; save it with numpy.savez".to_owned()),
        };
        arrays.push(array.map_err(|what| format!("{stem}: {what}"))?);
    }
    Ok(arrays)
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::DeflateEncoder;
    use std::io::Write;

    /// An archive of one array of ones.
    fn archive(packed: bool) -> Vec<u8> {
        let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (4,), }\n";
        let mut array = npy::MAGIC.to_vec();
        array.extend([1, 0]);
        array.extend((header.len() as u16).to_le_bytes());
        array.extend(header.as_bytes());
        array.extend([1.0_f64; 4].iter().flat_map(|v| v.to_le_bytes()));
        let data = if packed {
            let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
            encoder.write_all(&array).unwrap();
            encoder.finish().unwrap()
        } else {
            array
        };
        let method = if packed { 8_u16 } else { 0 };
        let name = b"vi.npy";
        let mut bytes = LOCAL.to_vec();
        bytes.resize(26, 0);
        bytes.extend((name.len() as u16).to_le_bytes());
        bytes.extend(0_u16.to_le_bytes());
        bytes.extend(name);
        bytes.extend(&data);
        let directory = bytes.len();
        let mut entry = ENTRY.to_vec();
        entry.resize(46, 0);
        entry[10..12].copy_from_slice(&method.to_le_bytes());
        entry[20..24].copy_from_slice(&(data.len() as u32).to_le_bytes());
        entry[28..30].copy_from_slice(&(name.len() as u16).to_le_bytes());
        bytes.extend(entry);
        bytes.extend(name);
        let mut end = END.to_vec();
        end.resize(END_LENGTH, 0);
        end[10..12].copy_from_slice(&1_u16.to_le_bytes());
        end[16..20].copy_from_slice(&(directory as u32).to_le_bytes());
        bytes.extend(end);
        bytes
    }

    #[test]
    fn plain_and_deflated_archives_hold_the_same() {
        let plain = parse(&archive(false)).unwrap();
        assert_eq!(
            (plain[0].name.as_str(), plain[0].values.as_slice()),
            ("vi", [1.0; 4].as_slice())
        );
        assert_eq!(parse(&archive(true)).unwrap(), plain);
    }

    #[test]
    fn damaged_archives_are_errors() {
        for whole in [archive(false), archive(true)] {
            for length in 4..whole.len() {
                assert!(parse(&whole[..length]).is_err(), "{length}");
            }
            for place in 0..whole.len() {
                let mut damaged = whole.clone();
                damaged[place] ^= 0xFF;
                // Whatever comes of it, nothing outside is read.
                let _ = parse(&damaged);
            }
        }
    }
}
