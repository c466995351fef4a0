//! An array of numpy (.npy, versions 1 to 3): a header in Python's notation, then the numbers.

use super::Array;
use super::bytes::{Number, integer, transposed};

pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

/// Reads an array of real or complex numbers with one or two dimensions. One dimension is a row.
///
/// # Errors
/// What is wrong, and what to do.
pub(super) fn parse(name: &str, bytes: &[u8]) -> Result<Array, String> {
    let cut = || "the array is cut short; save it again".to_owned();
    let length = match bytes.get(6) {
        Some(1) => 2,
        Some(2 | 3) => 4,
        _ => return Err("an array of an unknown version; save it with numpy.save".to_owned()),
    };
    let header_length = integer(bytes, 8, length).ok_or_else(cut)?;
    let start = 8 + length;
    let end = start.checked_add(header_length).ok_or_else(cut)?;
    let header = std::str::from_utf8(bytes.get(start..end).ok_or_else(cut)?)
        .map_err(|_| "the array's header is no text; save it again".to_owned())?;
    let data = bytes.get(end..).ok_or_else(cut)?;

    let kind = entry(header, "descr").and_then(|text| text.split(['\'', '"']).nth(1));
    let kind = kind.ok_or("the array's header names no kind of number; save plain numbers")?;
    let (number, parts, big_endian) =
        number(kind).ok_or_else(|| format!("the array holds '{kind}'; save real or complex numbers"))?;
    let by_columns = entry(header, "fortran_order").is_some_and(|text| text.starts_with("True"));
    let shape = entry(header, "shape").and_then(|text| text.strip_prefix('(')?.split_once(')'));
    let sides: Option<Vec<usize>> = shape.and_then(|(list, _)| {
        let sides = list.split(',').map(str::trim).filter(|side| !side.is_empty());
        sides.map(|side| side.parse().ok()).collect()
    });
    let (rows, columns) = match sides.as_deref() {
        Some([count]) => (1, *count),
        Some([rows, columns]) => (*rows, *columns),
        _ => return Err("the array has not one or two dimensions; save frames as rows".to_owned()),
    };
    let count = rows.checked_mul(columns).and_then(|n| n.checked_mul(parts));
    let raw = count
        .and_then(|count| number.list(data, count, big_endian))
        .ok_or_else(cut)?;
    let values = match parts {
        1 => raw,
        _ => raw.chunks_exact(2).map(|z| z[0].hypot(z[1])).collect(),
    };
    Ok(Array {
        name: name.to_owned(),
        rows,
        columns,
        values: if by_columns {
            transposed(&values, rows, columns)
        } else {
            values
        },
        complex: parts == 2,
        comments: Vec::new(),
    })
}

/// What follows a key of the header.
fn entry<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let (_, after) = header.split_once(&format!("'{key}'"))?;
    Some(after.trim_start().strip_prefix(':')?.trim_start())
}

/// Kind of number, numbers that make one, and whether the first byte is the highest.
fn number(kind: &str) -> Option<(Number, usize, bool)> {
    let order = kind.chars().next()?;
    let letter = kind.chars().nth(1)?;
    let size: usize = kind.get(2..)?.parse().ok()?;
    let (number, parts) = match (letter, size) {
        ('f', 4 | 8) => (Number::Float(size), 1),
        ('c', 8 | 16) => (Number::Float(size / 2), 2),
        ('i', 1 | 2 | 4 | 8) => (Number::Signed(size), 1),
        ('u', 1 | 2 | 4 | 8) => (Number::Unsigned(size), 1),
        _ => return None,
    };
    matches!(order, '<' | '>' | '|' | '=').then_some((number, parts, order == '>'))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend([1, 0]);
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    fn header(kind: &str, by_columns: &str, shape: &str) -> String {
        format!("{{'descr': '{kind}', 'fortran_order': {by_columns}, 'shape': {shape}, }}\n")
    }

    #[test]
    fn the_same_numbers_however_they_are_stored() {
        let numbers = [1.5, -2.0, 3.0, 4.0, 5.0, -6.0];
        let little: Vec<u8> = numbers.iter().flat_map(|v: &f64| v.to_le_bytes()).collect();
        let expected = parse("", &file(&header("<f8", "False", "(2, 3)"), &little)).unwrap();
        assert_eq!((expected.rows, expected.columns), (2, 3));
        assert_eq!(expected.values, numbers);
        let big: Vec<u8> = numbers.iter().flat_map(|v: &f64| v.to_be_bytes()).collect();
        assert_eq!(
            parse("", &file(&header(">f8", "False", "(2, 3)"), &big)).unwrap(),
            expected
        );
        let single: Vec<u8> = numbers.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect();
        assert_eq!(
            parse("", &file(&header("<f4", "False", "(2, 3)"), &single)).unwrap(),
            expected
        );
        let columns = [1.5, 4.0, -2.0, 5.0, 3.0, -6.0_f64];
        let fortran: Vec<u8> = columns.iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(
            parse("", &file(&header("<f8", "True", "(2, 3)"), &fortran)).unwrap(),
            expected
        );
        let integers: Vec<u8> = [1_i16, -2, 3].iter().flat_map(|v| v.to_le_bytes()).collect();
        let row = parse("", &file(&header("<i2", "False", "(3,)"), &integers)).unwrap();
        assert_eq!((row.rows, row.columns, row.values), (1, 3, vec![1.0, -2.0, 3.0]));
    }

    #[test]
    fn of_complex_numbers_the_magnitude() {
        let data: Vec<u8> = [3.0, -4.0_f64].iter().flat_map(|v| v.to_le_bytes()).collect();
        let array = parse("", &file(&header("<c16", "False", "(1,)"), &data)).unwrap();
        assert_eq!((array.values, array.complex), (vec![5.0], true));
    }

    #[test]
    fn nothing_is_read_that_is_not_there() {
        let whole = file(&header("<f8", "False", "(2, 3)"), &[0; 48]);
        for length in 6..whole.len() {
            assert!(parse("", &whole[..length]).is_err(), "{length}");
        }
        let huge = header("<f8", "False", "(99999999999, 99999999999)");
        assert!(parse("", &file(&huge, &[0; 8])).unwrap_err().contains("cut short"));
        let objects = parse("", &file(&header("|O", "False", "(2,)"), &[0; 16])).unwrap_err();
        assert!(objects.contains("'|O'"), "{objects}");
        let cube = parse("", &file(&header("<f8", "False", "(1, 1, 1)"), &[0; 8])).unwrap_err();
        assert!(cube.contains("dimensions"), "{cube}");
    }
}
