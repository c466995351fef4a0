//! `skin export --to parquet`: tables of touches and of frames, in a folder laid out as Hive's, which takes many recordings.

use crate::files::parquet::{Cell, Column, Kind, Parquet};
use crate::files::replace::beside;
use crate::reading::Reading;
use crate::recorded::SessionRecord;
use crate::recorded_frames::{Part, RecordedFrames};
use crate::recording_file::day;
use crate::skin_file::{self, Place};
use anyhow::{Context, Result, bail};
use recording::Topic;
use serde_json::Value;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// Of `touches`.
const TOUCHES: &[Column] = &[
    Column::of("time", Kind::Time),
    Column::of("time_s", Kind::Double),
    Column::of("frame", Kind::Long),
    Column::optional("id", Kind::Long),
    Column::of("x_mm", Kind::Double),
    Column::of("y_mm", Kind::Double),
    Column::of("rise", Kind::Double),
    Column::of("area_mm2", Kind::Double),
    Column::of("total_mm2", Kind::Double),
    Column::optional("force_n", Kind::Double),
    Column::of("uncalibrated", Kind::Bool),
    Column::optional("robot_x_mm", Kind::Double),
    Column::optional("robot_y_mm", Kind::Double),
    Column::optional("robot_z_mm", Kind::Double),
];
/// Of `frames`.
const FRAMES: &[Column] = &[
    Column::of("time", Kind::Time),
    Column::of("time_s", Kind::Double),
    Column::of("frame", Kind::Long),
    Column::of("values_v", Kind::Doubles),
];

/// Writes both tables of a recording below a folder, of each of its skins; what was written.
///
/// # Errors
/// The recording cannot be read, it was exported there before, or the files cannot be written.
pub(super) fn export(from: &Path, out: Option<&Path>) -> Result<String> {
    let (of_file, _) = recording::split(from);
    let out = out.map_or_else(|| of_file.with_file_name("parquet"), Path::to_owned);
    let mut said = Vec::new();
    for (_, skin) in skin_file::asked(from)? {
        said.push(of_skin(&skin, &of_file, &out)?);
    }
    Ok(said.join("\n"))
}

fn of_skin(from: &Path, of_file: &Path, out: &Path) -> Result<String> {
    let session = SessionRecord::read(from)?;
    let said = serde_json::to_string(&session)?;
    let place = |table: &str| -> Result<PathBuf> {
        let recording = of_file.file_stem().unwrap_or_default().to_string_lossy();
        let path = out
            .join(table)
            .join(format!("skin={}", encoded(session.name())))
            .join(format!("date={}", day(session.started_unix_s)))
            .join(format!("recording={}", encoded(&recording)))
            .join(format!("{table}.parquet"));
        if path.exists() {
            bail!(
                "{}: the recording was exported there before; remove that, or name another folder with --out",
                path.display()
            );
        }
        Ok(path)
    };
    let (touches_path, frames_path) = (place("touches")?, place("frames")?);
    let (touches, pictures) = touches(from, session.place.as_ref(), &touches_path, &said)?;
    let frames = frames(from, &session, &frames_path, &said)?;
    Ok(format!(
        "{}: {touches} touches of {pictures} pictures\n{}: {frames} frames",
        touches_path.display(),
        frames_path.display()
    ))
}

/// A value in the name of a folder, as Hive writes it: what a path or a name would not hold as %XX.
fn encoded(value: &str) -> String {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"-_.+".contains(&b);
    let one = |b: u8| {
        if plain(b) {
            char::from(b).to_string()
        } else {
            format!("%{b:02X}")
        }
    };
    let mut text: String = value.bytes().map(one).collect();
    // Windows leaves out a dot at the end of a name.
    if text.ends_with('.') {
        text.replace_range(text.len() - 1.., "%2E");
    }
    // Hive's own name of what is not known.
    if text.is_empty() {
        "__HIVE_DEFAULT_PARTITION__".to_owned()
    } else {
        text
    }
}

/// A file that has its name only when it is whole.
pub(crate) struct Table {
    file: Parquet<BufWriter<File>>,
    beside: PathBuf,
    path: PathBuf,
}

impl Table {
    /// Makes the file beside, and its folder.
    ///
    /// # Errors
    /// What the system said.
    pub(crate) fn new(path: &Path, columns: &'static [Column]) -> Result<Self> {
        let beside = beside(path);
        let folder = path.parent().unwrap_or(path);
        let made = std::fs::create_dir_all(folder).and_then(|()| File::create(&beside));
        let made =
            made.with_context(|| format!("{}: cannot be made; name another folder with --out", path.display()))?;
        Ok(Self {
            file: Parquet::new(BufWriter::new(made), columns)?,
            beside,
            path: path.to_owned(),
        })
    }

    /// Fills the file and gives it its name, or removes it.
    ///
    /// # Errors
    /// What `rows` or the system said.
    pub(crate) fn fill<T>(
        mut self,
        said: &[(&str, &str)],
        rows: impl FnOnce(&mut Parquet<BufWriter<File>>) -> Result<T>,
    ) -> Result<T> {
        let filled = rows(&mut self.file).and_then(|what| {
            let file = self.file.finish(said)?.into_inner().map_err(|e| e.into_error())?;
            file.sync_all()?;
            std::fs::rename(&self.beside, &self.path)?;
            Ok(what)
        });
        if filled.is_err() {
            let _ = std::fs::remove_file(&self.beside);
        }
        filled.with_context(|| format!("{}: cannot be written", self.path.display()))
    }
}

fn microseconds(unix_ns: u64) -> Cell<'static> {
    Cell::Long((unix_ns / 1000) as i64)
}

/// Where a recorded touch is in the robot's frame, mm; none where the sheet has no place.
pub(super) fn on_robot(sheet: Option<&Place>, touch: &Value) -> Option<[f64; 3]> {
    let [x, y] = [touch["x_mm"].as_f64()?, touch["y_mm"].as_f64()?];
    sheet.map(|place| place.point_mm([x, y]))
}

fn touches(from: &Path, sheet: Option<&Place>, path: &Path, session: &str) -> Result<(u64, u64)> {
    let mut reader = Reading::open(from)?;
    let (mut touches, mut pictures) = (0, 0);
    let rows = |file: &mut Parquet<BufWriter<File>>| {
        while let Some(message) = reader.next()? {
            if message.topic != Some(Topic::Touches) {
                continue;
            }
            let time = microseconds(message.publish_ns);
            let line: Value = serde_json::from_slice(message.data).context("touches of the recording")?;
            pictures += 1;
            for touch in line["touches"].as_array().into_iter().flatten() {
                let number = |of: &Value| Cell::Double(of.as_f64().unwrap_or(f64::NAN));
                let force = &touch["force_n"];
                let [x, y, z] = on_robot(sheet, touch).map_or([Cell::Missing; 3], |mm| mm.map(Cell::Double));
                file.row(&[
                    time,
                    number(&line["time_s"]),
                    Cell::Long(line["frame"].as_i64().unwrap_or(0)),
                    touch["id"].as_i64().map_or(Cell::Missing, Cell::Long),
                    number(&touch["x_mm"]),
                    number(&touch["y_mm"]),
                    number(&touch["rise"]),
                    number(&touch["area_mm2"]),
                    number(&touch["total_mm2"]),
                    if force.is_null() { Cell::Missing } else { number(force) },
                    Cell::Bool(touch["uncalibrated"].as_bool().unwrap_or(false)),
                    x,
                    y,
                    z,
                ])?;
                touches += 1;
            }
        }
        Ok(())
    };
    Table::new(path, TOUCHES)?.fill(&[("skin.session", session)], rows)?;
    Ok((touches, pictures))
}

fn frames(from: &Path, session: &SessionRecord, path: &Path, said: &str) -> Result<u64> {
    let mut recorded = RecordedFrames::open(from, &Part::default())?;
    let pattern = recorded.pattern(&session.wires)?;
    let measurements: Vec<[usize; 4]> = pattern
        .measurements()
        .iter()
        .map(|m| [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus].map(|e| e + 1))
        .collect();
    let measurements = serde_json::to_string(&measurements)?;
    let said = [
        ("skin.session", said),
        // The current enters at drive_a; the value is U(sense_b) - U(sense_a). Electrodes from 1.
        ("skin.drive_a_drive_b_sense_a_sense_b", &measurements),
    ];
    let mut frames = 0;
    Table::new(path, FRAMES)?.fill(&said, |file| {
        while let Some(frame) = recorded.next()? {
            file.row(&[
                microseconds(frame.unix_ns),
                Cell::Double(frame.measured.time_s),
                Cell::Long(frame.measured.sequence.into()),
                Cell::Doubles(&frame.measured.values_v),
            ])?;
            frames += 1;
        }
        Ok(frames)
    })
}

#[cfg(test)]
mod tests {
    use super::encoded;

    #[test]
    fn names_of_folders_hold_whatever_a_serial_number_is() {
        assert_eq!(encoded("A-1_b"), "A-1_b");
        assert_eq!(encoded("a/../=b"), "a%2F..%2F%3Db");
        assert_eq!(encoded(""), "__HIVE_DEFAULT_PARTITION__");
    }
}
