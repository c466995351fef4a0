//! A press-and-hold: what was pressed and what the sheet showed, over time.

use crate::malformed::FileError;
use std::path::Path;
use thiserror::Error;

/// What is wrong with a recording.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The file cannot be read, or a line is not one of a recording.
    #[error(transparent)]
    File(#[from] FileError),
    /// No force in the table.
    #[error("{0}: there is no column force_n; give the force that was held with --force-n")]
    NoForce(String),
    /// A press or a release that does not show.
    #[error(
        "no press and release can be told from the noise; begin to record before the press, hold it, and go on after the \
         release, or give the force over time in a column force_n"
    )]
    NoEdges,
}

/// One frame of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub time_s: f64,
    /// Force that the gauge showed, N.
    pub force_n: f64,
    /// Integrated relative rise of the resistivity, mm²; 0 where no touch was found.
    pub total_mm2: f64,
    /// Area of the touch, mm², where one was found.
    pub area_mm2: Option<f64>,
    /// Whether it takes part in a fit: not while the force is only guessed, nor where a dent is too small to be found.
    pub used: bool,
}

const COLUMNS: [&str; 4] = ["time_s", "rise_mm2", "force_n", "area_mm2"];

/// Reads a recording: CSV with a header; columns `time_s` (rising) and `rise_mm2` (integrated rise; empty or not finite: not
/// known), and where they are known `force_n` and `area_mm2`. Lines that begin with # are comments. Without forces, a force held is given.
///
/// # Errors
/// [`RecordingError`] with the line and the column.
pub fn read(path: &Path, held_n: Option<f64>) -> Result<Vec<Sample>, RecordingError> {
    let file = path.display().to_string();
    match std::fs::read_to_string(path) {
        Ok(text) => parse(&file, &text, held_n),
        Err(cause) => Err(FileError::Io { file, cause }.into()),
    }
}

/// The same from text; `file` is its name in messages.
///
/// # Errors
/// As for [`read`].
pub fn parse(file: &str, text: &str, held_n: Option<f64>) -> Result<Vec<Sample>, RecordingError> {
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
pub fn text(samples: &[Sample]) -> String {
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

/// Half of the time over which an edge is looked for, s.
const EDGE_S: f64 = 0.25;
/// Least step of an edge over the scatter of the steps.
const LEAST_EDGE: f64 = 10.0;

/// Writes the forces of one press that was held at a force (N) from its rises alone: the press is where they rise fastest, the
/// release where they fall fastest. What is measured during those takes no part in a fit.
///
/// # Errors
/// [`RecordingError::NoEdges`].
pub fn hold(samples: &mut [Sample], force_n: f64) -> Result<(), RecordingError> {
    // Mean rise over a quarter of a second after a time less that before it.
    let step = |k: usize| {
        let t = samples[k].time_s;
        let mean = |low: f64, high: f64| {
            let inside: Vec<f64> = samples
                .iter()
                .filter(|s| s.time_s > low && s.time_s <= high)
                .map(|s| s.total_mm2)
                .collect();
            (!inside.is_empty()).then(|| inside.iter().sum::<f64>() / inside.len() as f64)
        };
        Some(mean(t, t + EDGE_S)? - mean(t - EDGE_S, t)?)
    };
    let steps: Vec<(usize, f64)> = (0..samples.len()).filter_map(|k| Some((k, step(k)?))).collect();
    let best = |list: &mut dyn Iterator<Item = &(usize, f64)>, sign: f64| {
        list.max_by(|a, b| (sign * a.1).total_cmp(&(sign * b.1))).copied()
    };
    let (press, up) = best(&mut steps.iter(), 1.0).ok_or(RecordingError::NoEdges)?;
    let (release, down) = best(&mut steps.iter().filter(|s| s.0 > press), -1.0).ok_or(RecordingError::NoEdges)?;
    let mut sizes: Vec<f64> = steps.iter().map(|s| s.1.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let scatter = sizes[sizes.len() / 2];
    let (on_s, off_s) = (samples[press].time_s, samples[release].time_s);
    if up.min(-down) <= LEAST_EDGE * scatter || off_s - on_s < 4.0 * EDGE_S {
        return Err(RecordingError::NoEdges);
    }
    for s in samples {
        let t = s.time_s;
        s.used = s.used && (t - on_s).abs() > EDGE_S && (t - off_s).abs() > EDGE_S;
        s.force_n = if t > on_s && t <= off_s { force_n } else { 0.0 };
    }
    Ok(())
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

    #[test]
    fn a_hold_is_found_in_its_rises() {
        let rise = |t: f64| match t {
            t if t < 2.0 => 0.0,
            t if t < 12.0 => 100.0 + 3.0 * (t - 2.0),
            t => 30.0 * (-(t - 12.0) / 5.0).exp(),
        };
        let sample = |k: usize| Sample {
            time_s: 0.03 * k as f64,
            force_n: 0.0,
            total_mm2: rise(0.03 * k as f64) + [0.5, -0.5, 0.2][k % 3],
            area_mm2: None,
            used: true,
        };
        let mut samples: Vec<Sample> = (0..800).map(sample).collect();
        hold(&mut samples, 25.0).unwrap();
        for s in samples.iter().filter(|s| s.used) {
            assert_eq!(
                s.force_n,
                if (2.0..12.0).contains(&s.time_s) { 25.0 } else { 0.0 },
                "{s:?}"
            );
        }
        let mut flat: Vec<Sample> = (0..800)
            .map(|k| Sample {
                total_mm2: [0.5, -0.5, 0.2][k % 3],
                ..sample(k)
            })
            .collect();
        assert!(matches!(hold(&mut flat, 25.0), Err(RecordingError::NoEdges)));
    }
}
