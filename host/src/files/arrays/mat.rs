//! Variables of MATLAB, level 5 (.mat as MATLAB and Octave save it with -v6 or -v7): numbers, and those inside structs,
//! as EIDORS keeps its measurements. Everything else is passed over.

use super::Array;
use super::bytes::{Number, transposed, unpack};
use flate2::read::ZlibDecoder;

/// Files of version 7.3 are another format.
pub(super) const HDF5: &[u8] = b"\x89HDF";
const HEADER: usize = 128;
const COMPRESSED: usize = 15;
const MATRIX: usize = 14;
const STRUCT: u32 = 2;
const COMPLEX: u32 = 0x0800;
/// Structs inside structs that are followed.
const DEEPEST: usize = 4;

/// A tagged piece of a file.
struct Element<'a> {
    kind: usize,
    data: &'a [u8],
}

/// The pieces of a file, in order.
struct Reader<'a> {
    rest: &'a [u8],
    big_endian: bool,
}

impl<'a> Reader<'a> {
    fn word(&mut self) -> Option<u32> {
        let (first, rest) = self.rest.split_first_chunk::<4>()?;
        self.rest = rest;
        Some(if self.big_endian {
            u32::from_be_bytes(*first)
        } else {
            u32::from_le_bytes(*first)
        })
    }

    /// The next piece; none at the end or where it is cut short.
    fn element(&mut self) -> Option<Element<'a>> {
        let first = self.word()?;
        if first >> 16 != 0 {
            // Up to four bytes stand in the tag itself.
            let (data, rest) = self.rest.split_at_checked(4)?;
            self.rest = rest;
            return Some(Element {
                kind: (first & 0xFFFF) as usize,
                data: data.get(..(first >> 16) as usize)?,
            });
        }
        let size = self.word()? as usize;
        let data = self.rest.get(..size)?;
        let padded = if first as usize == COMPRESSED {
            size
        } else {
            size.next_multiple_of(8)
        };
        self.rest = self.rest.get(padded..).unwrap_or(&[]);
        Some(Element {
            kind: first as usize,
            data,
        })
    }

    fn inside(&self, data: &'a [u8]) -> Self {
        Self {
            rest: data,
            big_endian: self.big_endian,
        }
    }
}

/// Reads all real and complex arrays of two dimensions; those inside a struct are named `struct.field`.
///
/// # Errors
/// What is wrong, and what to do.
pub(super) fn parse(bytes: &[u8]) -> Result<Vec<Array>, String> {
    if bytes.starts_with(HDF5) || bytes.starts_with(b"MATLAB 7.3") {
        return Err("a file of version 7.3; save it in MATLAB with: save('FILE.mat', 'VARIABLE', '-v7')".to_owned());
    }
    let cut = || "the file is cut short; save it again".to_owned();
    let big_endian = match bytes.get(126..HEADER) {
        Some(b"IM") => false,
        Some(b"MI") => true,
        _ => return Err("no file of level 5; save it in MATLAB with: save('FILE.mat', 'VARIABLE', '-v7')".to_owned()),
    };
    let mut reader = Reader {
        rest: &bytes[HEADER..],
        big_endian,
    };
    let mut arrays = Vec::new();
    while !reader.rest.is_empty() {
        let element = reader.element().ok_or_else(cut)?;
        if element.kind == COMPRESSED {
            let unpacked = unpack(ZlibDecoder::new(element.data))?;
            let mut inner = Reader {
                rest: &unpacked,
                big_endian,
            };
            let element = inner.element().ok_or_else(cut)?;
            if element.kind == MATRIX {
                variable(&inner.inside(element.data), None, 0, &mut arrays).ok_or_else(cut)?;
            }
        } else if element.kind == MATRIX {
            variable(&reader.inside(element.data), None, 0, &mut arrays).ok_or_else(cut)?;
        }
    }
    Ok(arrays)
}

/// A variable, or a field of one with its full name; none where it is cut short.
fn variable(at: &Reader<'_>, name: Option<String>, depth: usize, arrays: &mut Vec<Array>) -> Option<()> {
    let mut reader = at.inside(at.rest);
    if reader.rest.is_empty() {
        // An empty field.
        return Some(());
    }
    let flags = reader.element()?;
    let flags = reader.inside(flags.data).word()?;
    let sides = reader.element()?;
    let sides = Number::Signed(4).list(sides.data, sides.data.len() / 4, at.big_endian)?;
    let own = reader.element()?;
    let name = name.unwrap_or_else(|| String::from_utf8_lossy(own.data).into_owned());
    let [rows, columns] = sides[..] else {
        return Some(());
    };
    if rows < 0.0 || columns < 0.0 {
        return None;
    }
    let (rows, columns) = (rows as usize, columns as usize);
    match flags & 0xFF {
        6..=15 => {
            let count = rows.checked_mul(columns)?;
            let mut values = numbers(&mut reader, count)?;
            let complex = flags & COMPLEX != 0;
            if complex {
                let imaginary = numbers(&mut reader, count)?;
                for (v, i) in values.iter_mut().zip(imaginary) {
                    *v = v.hypot(i);
                }
            }
            arrays.push(Array {
                name,
                rows,
                columns,
                values: transposed(&values, rows, columns),
                complex,
                comments: Vec::new(),
            });
        }
        STRUCT if (rows, columns) == (1, 1) && depth < DEEPEST => {
            let length = reader.element()?;
            let length = Number::Signed(4).list(length.data, 1, at.big_endian)?[0];
            if length < 1.0 {
                return None;
            }
            let fields = reader.element()?;
            for field in fields.data.chunks(length as usize) {
                let text = field.split(|byte| *byte == 0).next().unwrap_or_default();
                let full = format!("{name}.{}", String::from_utf8_lossy(text));
                let element = reader.element()?;
                variable(&reader.inside(element.data), Some(full), depth + 1, arrays)?;
            }
        }
        _ => {}
    }
    Some(())
}

/// So many numbers of the next piece.
fn numbers(reader: &mut Reader<'_>, count: usize) -> Option<Vec<f64>> {
    if count == 0 {
        return Some(Vec::new());
    }
    let element = reader.element()?;
    let number = match element.kind {
        1 => Number::Signed(1),
        2 => Number::Unsigned(1),
        3 => Number::Signed(2),
        4 => Number::Unsigned(2),
        5 => Number::Signed(4),
        6 => Number::Unsigned(4),
        7 => Number::Float(4),
        9 => Number::Float(8),
        12 => Number::Signed(8),
        13 => Number::Unsigned(8),
        _ => return None,
    };
    number.list(element.data, count, reader.big_endian)
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::ZlibEncoder;
    use std::io::Write;

    fn element(kind: u32, data: &[u8]) -> Vec<u8> {
        let mut out = kind.to_le_bytes().to_vec();
        out.extend((data.len() as u32).to_le_bytes());
        out.extend(data);
        out.resize(out.len().next_multiple_of(8), 0);
        out
    }

    /// A matrix of the class (6 is double, 2 a struct) with what follows its name.
    fn matrix(class: u32, sides: [i32; 2], name: &str, after: &[u8]) -> Vec<u8> {
        let mut data = element(6, &[class.to_le_bytes(), [0; 4]].concat());
        data.extend(element(5, &sides.map(i32::to_le_bytes).concat()));
        data.extend(element(1, name.as_bytes()));
        data.extend(after);
        element(MATRIX as u32, &data)
    }

    fn file(elements: &[u8]) -> Vec<u8> {
        let mut bytes = b"MATLAB 5.0 MAT-file, a test".to_vec();
        bytes.resize(124, b' ');
        bytes.extend([0, 1]);
        bytes.extend(b"IM");
        bytes.extend(elements);
        bytes
    }

    fn doubles(values: &[f64]) -> Vec<u8> {
        element(9, &values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>())
    }

    fn packed(elements: &[u8]) -> Vec<u8> {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(elements).unwrap();
        let data = encoder.finish().unwrap();
        let mut out = (COMPRESSED as u32).to_le_bytes().to_vec();
        out.extend((data.len() as u32).to_le_bytes());
        out.extend(data);
        out
    }

    #[test]
    fn columns_become_rows_and_small_numbers_doubles() {
        let whole = matrix(6, [2, 3], "vi", &doubles(&[1.0, 4.0, 2.0, 5.0, 3.0, 6.0]));
        let array = parse(&file(&whole)).unwrap().remove(0);
        assert_eq!((array.name.as_str(), array.rows, array.columns), ("vi", 2, 3));
        assert_eq!(array.values, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        // MATLAB stores small whole numbers as bytes, and up to four of them in the tag.
        let small = matrix(6, [1, 3], "vi", &[2, 0, 3, 0, 7, 8, 9, 0]);
        assert_eq!(parse(&file(&small)).unwrap()[0].values, [7.0, 8.0, 9.0]);
    }

    #[test]
    fn packed_variables_and_fields_of_structs() {
        let field = matrix(6, [3, 1], "", &doubles(&[1.0, 2.0, 3.0]));
        let mut inside = element(5, &8_i32.to_le_bytes());
        inside.extend(element(1, b"meas\0\0\0\0type\0\0\0\0"));
        inside.extend(&field);
        inside.extend(matrix(4, [1, 1], "", &element(16, b"x")));
        let plain = matrix(STRUCT, [1, 1], "vh", &inside);
        let arrays = parse(&file(&plain)).unwrap();
        assert_eq!((arrays.len(), arrays[0].name.as_str()), (1, "vh.meas"));
        assert_eq!(parse(&file(&packed(&plain))).unwrap(), arrays);
    }

    #[test]
    fn of_complex_numbers_the_magnitude() {
        let parts = [doubles(&[3.0]), doubles(&[-4.0])].concat();
        let array = parse(&file(&matrix(6 | COMPLEX, [1, 1], "z", &parts)))
            .unwrap()
            .remove(0);
        assert_eq!((array.values, array.complex), (vec![5.0], true));
    }

    #[test]
    fn other_versions_say_how_to_save() {
        for bytes in [b"MATLAB 7.3 MAT-file".as_slice(), HDF5, b"MATLAB 4"] {
            assert!(parse(bytes).unwrap_err().contains("-v7"), "{bytes:?}");
        }
    }

    #[test]
    fn damaged_files_are_errors_or_other_numbers() {
        let mut inside = element(5, &8_i32.to_le_bytes());
        inside.extend(element(1, b"meas\0\0\0\0"));
        inside.extend(matrix(6, [3, 1], "", &doubles(&[1.0, 2.0, 3.0])));
        let whole = file(&matrix(STRUCT, [1, 1], "vh", &inside));
        for length in HEADER + 1..whole.len() {
            assert!(parse(&whole[..length]).is_err(), "{length}");
        }
        for place in HEADER..whole.len() {
            for value in [0, 0x7F, 0xFF] {
                let mut damaged = whole.clone();
                damaged[place] = value;
                // Whatever comes of it, nothing outside is read.
                let _ = parse(&damaged);
            }
        }
    }
}
