//! JSON as every command prints it: a value a line, its numbers with the digits that mean something.

use anyhow::Result;
use serde::Serialize;
use serde_json::ser::{CompactFormatter, Formatter};
use std::io::{self, Write};

/// One JSON value and the end of its line.
///
/// # Errors
/// None that a value has whose keys are texts.
pub(crate) fn line(value: &impl Serialize) -> Result<Vec<u8>> {
    let mut text = Vec::new();
    value.serialize(&mut serde_json::Serializer::with_formatter(
        &mut text,
        Digits::default(),
    ))?;
    text.push(b'\n');
    Ok(text)
}

/// Numbers with the digits that mean something: six, more than any measured value has; times to the microsecond.
#[derive(Default)]
struct Digits {
    compact: CompactFormatter,
    in_key: bool,
    /// The value of this key is a time.
    time: bool,
}

impl Formatter for Digits {
    fn begin_object_key<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        self.in_key = true;
        self.compact.begin_object_key(writer, first)
    }

    fn end_object_key<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.in_key = false;
        self.compact.end_object_key(writer)
    }

    fn write_string_fragment<W: ?Sized + Write>(&mut self, writer: &mut W, fragment: &str) -> io::Result<()> {
        if self.in_key {
            self.time = fragment == "time_s" || fragment.ends_with("unix_s");
        }
        self.compact.write_string_fragment(writer, fragment)
    }

    fn write_f64<W: ?Sized + Write>(&mut self, writer: &mut W, value: f64) -> io::Result<()> {
        self.compact
            .write_f64(writer, if self.time { microseconds(value) } else { six(value) })
    }
}

fn microseconds(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

/// The number of six decimal digits that is nearest.
fn six(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn printed(value: &impl Serialize) -> String {
        String::from_utf8(line(value).unwrap()).unwrap()
    }

    #[test]
    fn numbers_have_six_digits_and_times_microseconds() {
        let value = json!({"x_mm": -12.345_678_901, "gap": 1.234_567_89e-12, "time_s": 123_456.789_012_345,
            "started_unix_s": 1_700_000_000.123_456_7, "touches": [{"rise": 0.1 + 0.2, "id": 7, "y_mm": null}]});
        let text = printed(&value);
        for part in [
            "\"x_mm\":-12.3457",
            "\"gap\":1.23457e-12",
            "\"time_s\":123456.789012",
            "\"started_unix_s\":1700000000.123457",
            "\"rise\":0.3,",
            "\"id\":7",
            "\"y_mm\":null",
        ] {
            let text = text.replace('}', ",");
            assert!(text.contains(part), "{part} in {text}");
        }
    }
}
