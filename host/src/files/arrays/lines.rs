//! Numbers as lines of text: one frame a line, separated by commas, semicolons, tabs or spaces.

use super::Array;
use crate::files::malformed::{FileError, decimal_comma};

/// Reads lines that all have the same number of numbers. Empty lines and those that begin with # or % are comments. What
/// stands before a colon is passed over, as OpenEIT's `magnitudes :`, and so is one line of names at the top. Between
/// separators `NaN` and nothing are missing values.
///
/// # Errors
/// [`FileError::Malformed`] with line and column.
pub(super) fn parse(file: &str, bytes: &[u8]) -> Result<Array, FileError> {
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    let mut values = Vec::new();
    let (mut rows, mut columns) = (0, 0);
    let mut named = false;
    let mut comments = Vec::new();
    for (number, line) in (1..).zip(bytes.split(|b| *b == b'\n')) {
        let line = std::str::from_utf8(line)
            .map_err(|_| FileError::malformed(file, number, "1", "text in UTF-8", "other bytes"))?
            .trim();
        if line.starts_with('#') {
            comments.push((number, line.to_owned()));
        }
        if line.is_empty() || line.starts_with(['#', '%']) {
            continue;
        }
        let line = line.split_once(':').map_or(line, |(_, after)| after).trim();
        let start = values.len();
        let mut wrong = None;
        for (k, field) in fields(line).enumerate() {
            match field.parse::<f64>() {
                Ok(value) => values.push(value),
                Err(_) if field.is_empty() => values.push(f64::NAN),
                Err(_) => {
                    wrong.get_or_insert((k, field));
                    values.push(f64::NAN);
                }
            }
        }
        let found = values.len() - start;
        if let Some((k, field)) = wrong {
            // Names over the columns, as a spreadsheet or pandas writes them.
            if rows == 0 && !named {
                if line.starts_with("drive_a") {
                    return Err(FileError::Unusable {
                        file: file.to_owned(),
                        what: "its rows say which measurements they are; leave out --order".to_owned(),
                    });
                }
                named = true;
                values.truncate(start);
                continue;
            }
            let place = (k + 1).to_string();
            // Lines of semicolons or spaces, too, are parted at commas where there are any.
            let mut words = line.split([';', ' ', '\t']).map(str::trim);
            let comma = words.find(|word| word.contains(',')).map_or("", decimal_comma);
            return Err(FileError::malformed(
                file,
                number,
                &place,
                "a number, nothing or NaN",
                &format!("'{field}'{comma}"),
            ));
        }
        if rows > 0 && found != columns {
            let expected = format!("{columns} numbers as in the lines above");
            let place = (found.min(columns) + 1).to_string();
            return Err(FileError::malformed(
                file,
                number,
                &place,
                &expected,
                &found.to_string(),
            ));
        }
        columns = found;
        rows += 1;
    }
    if rows == 0 {
        return Err(FileError::malformed(file, 1, "1", "a line of numbers", "nothing"));
    }
    Ok(Array {
        name: String::new(),
        rows,
        columns,
        values,
        complex: false,
        comments,
    })
}

/// The fields of a line; a separator at its end begins no further one.
fn fields(line: &str) -> Box<dyn Iterator<Item = &str> + '_> {
    match [',', ';'].into_iter().find(|separator| line.contains(*separator)) {
        Some(separator) => Box::new(
            line.strip_suffix(separator)
                .unwrap_or(line)
                .split(separator)
                .map(str::trim),
        ),
        None => Box::new(line.split_whitespace()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn however_the_numbers_are_separated() {
        let expected = parse("f", b"1,2.5,-3\n4,5,6\n").unwrap();
        assert_eq!((expected.rows, expected.columns), (2, 3));
        for text in [
            "1;2.5;-3\r\n4;5;6",
            "1\t2.5\t-3\n4 5  6\n",
            "magnitudes : 1,2.5,-3,\n\nmagnitudes : 4,5,6,\n",
            "% made by hand\na,b,c\n1, 2.5, -3\n4,5,6",
        ] {
            assert_eq!(parse("f", text.as_bytes()).unwrap(), expected, "{text:?}");
        }
        assert!(parse("f", b"1,,3\n").unwrap().values[1].is_nan());
    }

    #[test]
    fn what_is_wrong_has_its_place() {
        for (text, words) in [
            ("1,2\n3\n", ["f:2", "2 numbers", "found 1"]),
            ("1,2\n3,x\n", ["f:2", "column 2", "'x'"]),
            ("1, 2\n3, x\n", ["f:2", "column 2", "found 'x'"]),
            ("1;2\n3,5;4,25\n", ["f:2", "column 2", "'5;4'; write a decimal point"]),
            ("a b\n3,5 4,25\n", ["f:2", "column 2", "'5 4'; write a decimal point"]),
            ("a,b\nc,d\n", ["f:2", "column 1", "'c'"]),
            ("# nothing\n", ["f:1", "a line of numbers", "nothing"]),
        ] {
            let message = parse("f", text.as_bytes()).unwrap_err().to_string();
            assert!(words.iter().all(|w| message.contains(w)), "{text:?}: {message}");
        }
    }
}
