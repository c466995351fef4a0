//! The table of a press-and-hold: CSV in and out.

use crate::files::malformed::FileError;
use inverse::force::recording::{NoEdges, Sample, hold};
use std::path::Path;
use thiserror::Error;

/// What is wrong with a recording.
#[derive(Debug, Error)]
pub(crate) enum RecordingError {
    /// The file cannot be read, or a line is not one of a recording.
    #[error(transparent)]
    File(#[from] FileError),
    /// No force in the table.
    #[error("{0}: there is no column force_n; give the force that was held with --force-n")]
    NoForce(String),
    /// A press or a release that does not show.
    #[error(transparent)]
    NoEdges(#[from] NoEdges),
}

const COLUMNS: [&str; 4] = ["time_s", "rise_mm2", "force_n", "area_mm2"];

/// Reads a recording: CSV with a header; columns `time_s` (rising) and `rise_mm2` (integrated rise; empty or not finite: not
/// known), and where they are known `force_n` and `area_mm2`. Lines that begin with # are comments. Without forces, a force held is given.
///
/// # Errors
/// [`RecordingError`] with the line and the column.
pub(crate) fn read(path: &Path, held_n: Option<f64>) -> Result<Vec<Sample>, RecordingError> {
    let file = path.display().to_string();
    match ::forward::whole::text(path) {
        Ok(text) => parse(&file, &text, held_n),
        Err(cause) => Err(FileError::Io { file, cause }.into()),
    }
}

/// The same from text; `file` is its name in messages.
///
/// # Errors
/// As for [`read`].
pub(crate) fn parse(file: &str, text: &str, held_n: Option<f64>) -> Result<Vec<Sample>, RecordingError> {
    let malformed = |line: u64, column: &str, expected: &str, found: &str| {
        RecordingError::from(FileError::malformed(file, line, column, expected, found))
    };
    // Numbers and plain names: nothing is quoted. Spreadsheets begin a file with a byte order mark.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let numbered = text.lines().enumerate().map(|(k, line)| (k as u64 + 1, line.trim()));
    let mut lines = numbered.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let (header_line, header) = lines.next().unwrap_or((1, ""));
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let at = COLUMNS.map(|name| names.iter().position(|n| *n == name));
    for needed in [0, 1] {
        if at[needed].is_none() {
            return Err(malformed(header_line, COLUMNS[needed], "a column of this name", header));
        }
    }
    if at[2].is_none() && held_n.is_none() {
        return Err(RecordingError::NoForce(file.to_owned()));
    }
    let mut samples: Vec<Sample> = Vec::new();
    for (line, record) in lines {
        let fields: Vec<&str> = record.split(',').map(str::trim).collect();
        let number = |k: usize| -> Result<Option<f64>, RecordingError> {
            let Some(text) = at[k].map(|c| fields.get(c).copied().unwrap_or("")) else {
                return Ok(None);
            };
            match text.parse::<f64>() {
                Ok(v) if v.is_finite() => Ok(Some(v)),
                // Not known.
                Ok(_) if k == 1 || k == 3 => Ok(None),
                _ if text.is_empty() && (k == 1 || k == 3) => Ok(None),
                _ => Err(malformed(line, COLUMNS[k], "a finite number", &format!("'{text}'"))),
            }
        };
        let time_s = number(0)?.unwrap_or_default();
        if samples.last().is_some_and(|before| time_s < before.time_s) {
            return Err(malformed(
                line,
                COLUMNS[0],
                "a time that is not before the last",
                &time_s.to_string(),
            ));
        }
        let total_mm2 = number(1)?;
        samples.push(Sample {
            time_s,
            force_n: number(2)?.unwrap_or_default(),
            total_mm2: total_mm2.unwrap_or_default(),
            area_mm2: number(3)?,
            used: total_mm2.is_some(),
        });
    }
    if let (None, Some(force_n)) = (at[2], held_n) {
        hold(&mut samples, force_n)?;
    }
    Ok(samples)
}

/// The text of a recording.
pub(crate) fn text(samples: &[Sample]) -> String {
    let mut out = "time_s,force_n,rise_mm2,area_mm2\n".to_owned();
    for s in samples {
        let area = s.area_mm2.map_or(String::new(), |a| format!("{a:.2}"));
        let rise = if s.used {
            format!("{:.5}", s.total_mm2)
        } else {
            String::new()
        };
        out.push_str(&format!("{:.6},{:.4},{rise},{area}\n", s.time_s, s.force_n));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_is_read_back_and_its_faults_are_named() {
        let samples = parse(
            "r.csv",
            "# gauge\ntime_s,force_n,rise_mm2,area_mm2\n0,0,0.1,\n0.03,25,97.5,490\n0.06,25,,\n",
            None,
        )
        .unwrap();
        assert_eq!(samples.len(), 3);
        assert!(samples[1].used && !samples[2].used);
        assert_eq!((samples[0].area_mm2, samples[1].area_mm2), (None, Some(490.0)));
        assert_eq!(parse("r.csv", &text(&samples), None).unwrap(), samples);
        // What is not finite is not known, as what is empty.
        let with = "time_s,force_n,rise_mm2,area_mm2\n0,0,inf,\n0.03,25,97.5,NaN\n";
        let without = "time_s,force_n,rise_mm2,area_mm2\n0,0,,\n0.03,25,97.5,\n";
        assert_eq!(
            parse("r.csv", with, None).unwrap(),
            parse("r.csv", without, None).unwrap()
        );
        for (text, words) in [
            ("# a comment\n\ntime_s,force_n\n", ["r.csv:3", "rise_mm2"]),
            ("time_s,rise_mm2\n0,1\n", ["r.csv", "--force-n"]),
            ("time_s,rise_mm2,force_n\n0,1,0\n1,x,0\n", ["r.csv:3", "rise_mm2"]),
            ("time_s,rise_mm2,force_n\n1,1,0\n0,1,0\n", ["r.csv:3", "not before"]),
        ] {
            let message = parse("r.csv", text, None).unwrap_err().to_string();
            assert!(words.iter().all(|w| message.contains(w)), "{message}");
        }
    }
}
