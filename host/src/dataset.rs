//! `skin dataset`: labelled simulated frames, shard by shard. What is in them is computed by `studies::dataset`.

use crate::export::tables::Table;
use crate::files::arrays::write::{ArrayFile, Npz, Of};
use crate::files::parquet::{Cell, Column, Kind};
use crate::files::replace::{beside, replace};
use crate::progress::Progress;
use crate::sheet;
use ::forward::file::sheet_text;
use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Instant;
use studies::dataset::{Dataset, DatasetFile, Row, Shard};

/// Arguments of `skin dataset`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Distributions of sheets, boards, touches and faults, a TOML file (docs/datasets.md).
    #[arg(long, value_name = "FILE")]
    scenes: PathBuf,
    /// How many frames; brought to whole shards.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    count: u64,
    /// Folder for the shards; made if need be. Those that are there are left as they are.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Only part K of OF of the shards, K from 1: for so many jobs at once.
    #[arg(long, value_name = "K/OF", default_value = "1/1")]
    shard: Part,
    /// What a shard's file is.
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t = Format::Parquet)]
    format: Format,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// A table, one frame a row, for Polars, DuckDB, Spark, pandas.
    Parquet,
    /// Arrays for numpy.
    Npz,
}

impl Format {
    fn ending(self) -> &'static str {
        match self {
            Self::Parquet => "parquet",
            Self::Npz => "npz",
        }
    }
}

/// A part of all shards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Part {
    number: u64,
    of: u64,
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').map(|(k, of)| (k.parse(), of.parse()));
        match numbers {
            Some((Ok(number), Ok(of))) if (1..=of).contains(&number) => Ok(Self { number, of }),
            _ => Err("give two whole numbers such as 3/8: the third of eight parts".to_owned()),
        }
    }
}

/// Of a shard's table.
const COLUMNS: &[Column] = &[
    Column::of("sheet", Kind::Long),
    Column::of("baseline", Kind::Bool),
    Column::of("values_v", Kind::Doubles),
    Column::of("x_mm", Kind::Doubles),
    Column::of("y_mm", Kind::Doubles),
    Column::of("radius_mm", Kind::Doubles),
    Column::of("rise", Kind::Doubles),
    Column::of("fault", Kind::Long),
    Column::optional("fault_electrode", Kind::Long),
    Column::optional("fault_size", Kind::Double),
    Column::of("noise_v", Kind::Double),
    Column::of("resistance", Kind::Double),
    Column::of("meshed", Kind::Bool),
];

/// Runs the command.
///
/// # Errors
/// A file of scenes that makes no sense, a folder of other scenes, files that cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.scenes;
    let text = ::forward::whole::text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let file: DatasetFile = toml::from_str(&text).with_context(|| format!("{}", path.display()))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let of_sheet = file.sheet.file.as_ref().map(|name| folder.join(name));
    let (sheet, _) = sheet::load(of_sheet.as_deref())?;
    let of_shards = sheet_text(&sheet)?;
    let dataset = Dataset::new(file, sheet).with_context(|| format!("{}", path.display()))?;
    std::fs::create_dir_all(&arguments.out).with_context(|| {
        format!(
            "{}: cannot be made; name another folder with --out",
            arguments.out.display()
        )
    })?;
    keep(&arguments.out, "scenes.toml", &text)?;
    keep(&arguments.out, "sheet.toml", &of_shards)?;

    let frames = dataset.shard_frames();
    let shards = arguments.count.div_ceil(frames);
    if shards * frames != arguments.count {
        eprintln!("notice: {} frames are made: whole shards of {frames}", shards * frames);
    }
    let mut missing = Vec::new();
    for number in (0..shards).filter(|n| n % arguments.shard.of + 1 == arguments.shard.number) {
        let name = format!("shard-{number:05}.{}", arguments.format.ending());
        let path = arguments.out.join(name);
        if path.exists() {
            eprintln!("{}: is there, and is left as it is", path.display());
        } else {
            missing.push((number, path));
        }
    }
    let progress = Progress::new("shards");
    for (k, (number, path)) in missing.iter().enumerate() {
        progress.at(k, missing.len());
        let began = Instant::now();
        let shard = dataset.shard(*number).with_context(|| format!("shard {number}"))?;
        match arguments.format {
            Format::Parquet => table(path, &shard, &text)?,
            Format::Npz => arrays(path, &shard, dataset.most_touches())?,
        }
        say(path, &shard, began.elapsed().as_secs_f64());
        println!("{}", path.display());
    }
    Ok(())
}

/// Says what a shard is and how long it took.
fn say(path: &Path, shard: &Shard, took_s: f64) {
    let frames = shard.rows.iter().filter(|row| !row.baseline).count();
    let meshed = shard.rows.iter().filter(|row| row.meshed).count();
    let sampled = match shard.sampled_windows {
        0 => String::new(),
        windows => format!(", {windows} windows sample by sample"),
    };
    eprintln!(
        "{}: {frames} frames of {} sheets, {meshed} solved on a mesh{sampled}, {took_s:.2} s",
        path.display(),
        shard.devices.len()
    );
}

/// Keeps a text beside the shards, or holds it against the one that is there.
fn keep(folder: &Path, name: &str, text: &str) -> Result<()> {
    let path = folder.join(name);
    match ::forward::whole::text(&path) {
        Ok(there) if there == text => Ok(()),
        Ok(_) => bail!(
            "{}: the folder has shards of another {name}; name another folder with --out",
            path.display()
        ),
        Err(_) => replace(&path, |file| file.write_all(text.as_bytes()))
            .with_context(|| format!("{}: cannot be written; name another folder with --out", path.display())),
    }
}

/// What the values are: electrodes from 1, as in the files of `skin export`.
fn measurements(shard: &Shard) -> Vec<[u32; 4]> {
    let pairs = shard.measurements.iter();
    pairs
        .map(|m| [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus].map(|e| e as u32 + 1))
        .collect()
}

fn table(path: &Path, shard: &Shard, scenes: &str) -> Result<()> {
    let of_values = serde_json::to_string(&measurements(shard))?;
    let mut devices = Vec::new();
    for device in &shard.devices {
        devices.push(serde_json::json!({"sheet": sheet_text(&device.sheet)?, "electronics": device.electronics}));
    }
    let devices = serde_json::to_string(&devices)?;
    let said = [
        ("skin.scenes", scenes),
        ("skin.devices", &devices),
        // The current enters at drive_a; the value is U(sense_b) - U(sense_a). Electrodes from 1.
        ("skin.drive_a_drive_b_sense_a_sense_b", &of_values),
    ];
    Table::new(path, COLUMNS)?.fill(&said, |file| {
        for row in &shard.rows {
            let list = |of: fn(&::forward::DiscTouch) -> f64| row.touches.iter().map(of).collect::<Vec<f64>>();
            let (x, y) = (list(|t| t.centre_mm[0]), list(|t| t.centre_mm[1]));
            let (radius, rise) = (list(|t| t.radius_mm), list(|t| t.rise));
            let electrode = row.fault.as_ref().and_then(|f| f.electrode);
            let size = row.fault.as_ref().and_then(|f| f.size);
            file.row(&[
                Cell::Long(row.sheet.cast_signed()),
                Cell::Bool(row.baseline),
                Cell::Doubles(&row.values_v),
                Cell::Doubles(&x),
                Cell::Doubles(&y),
                Cell::Doubles(&radius),
                Cell::Doubles(&rise),
                Cell::Long(fault(row).into()),
                electrode.map_or(Cell::Missing, |e| Cell::Long(i64::from(e) + 1)),
                size.map_or(Cell::Missing, Cell::Double),
                Cell::Double(row.noise_v),
                Cell::Double(row.resistance),
                Cell::Bool(row.meshed),
            ])?;
        }
        Ok(())
    })
}

/// Number of the fault in the file, from 1; 0 for none.
fn fault(row: &Row) -> u32 {
    row.fault.as_ref().map_or(0, |f| f.of as u32 + 1)
}

fn arrays(path: &Path, shard: &Shard, most: usize) -> Result<()> {
    let beside = beside(path);
    let write = || -> io::Result<()> {
        let mut file = Npz::new(BufWriter::new(File::create(&beside)?));
        fill(&mut file, shard, most)?;
        File::open(&beside)?.sync_all()?;
        std::fs::rename(&beside, path)
    };
    let written = write();
    if written.is_err() {
        // Perhaps it was never made.
        let _ = std::fs::remove_file(&beside);
    }
    written.with_context(|| format!("{}: cannot be written", path.display()))
}

fn fill(file: &mut impl ArrayFile, shard: &Shard, most: usize) -> io::Result<()> {
    let (baseline, frames): (Vec<&Row>, Vec<&Row>) = shard.rows.iter().partition(|row| row.baseline);
    let values = shard.measurements.len();
    for (name, rows) in [("values_v", &frames), ("baseline_v", &baseline)] {
        file.begin(name, rows.len(), values, Of::Float)?;
        rows.iter().try_for_each(|row| file.floats(&row.values_v))?;
        file.end()?;
    }
    let mut whole = |name: &str, rows: &[&Row], of: &dyn Fn(&Row) -> u32| {
        file.begin(name, rows.len(), 1, Of::Unsigned)?;
        rows.iter().try_for_each(|row| file.unsigned(&[of(row)]))?;
        file.end()
    };
    whole("baseline_sheet", &baseline, &|row| row.sheet as u32)?;
    whole("sheet", &frames, &|row| row.sheet as u32)?;
    whole("touches", &frames, &|row| row.touches.len() as u32)?;
    whole("fault", &frames, &fault)?;
    whole("fault_electrode", &frames, &|row| {
        let electrode = row.fault.as_ref().and_then(|f| f.electrode);
        electrode.map_or(0, |e| u32::from(e) + 1)
    })?;
    whole("meshed", &frames, &|row| row.meshed.into())?;
    let mut number = |name: &str, wide: usize, of: &dyn Fn(&Row, usize) -> f64| {
        file.begin(name, frames.len(), wide, Of::Float)?;
        for row in &frames {
            (0..wide).try_for_each(|k| file.floats(&[of(row, k)]))?;
        }
        file.end()
    };
    let size = |row: &Row| row.fault.as_ref().and_then(|f| f.size).unwrap_or(f64::NAN);
    number("fault_size", 1, &|row, _| size(row))?;
    number("noise_v", 1, &|row, _| row.noise_v)?;
    number("resistance", 1, &|row, _| row.resistance)?;
    let touch = |row: &Row, k: usize, of: fn(&::forward::DiscTouch) -> f64| row.touches.get(k).map_or(f64::NAN, of);
    number("x_mm", most, &|row, k| touch(row, k, |t| t.centre_mm[0]))?;
    number("y_mm", most, &|row, k| touch(row, k, |t| t.centre_mm[1]))?;
    number("radius_mm", most, &|row, k| touch(row, k, |t| t.radius_mm))?;
    number("rise", most, &|row, k| touch(row, k, |t| t.rise))?;
    file.begin("measurements", values, 4, Of::Unsigned)?;
    measurements(shard).iter().try_for_each(|m| file.unsigned(m))?;
    file.end()?;
    file.finish()
}

#[cfg(test)]
mod tests {
    use super::Part;

    #[test]
    fn parts_count_from_one() {
        assert_eq!("3/8".parse(), Ok(Part { number: 3, of: 8 }));
        for wrong in ["0/8", "9/8", "3", "a/b", "3/0", "-1/2"] {
            assert!(wrong.parse::<Part>().is_err(), "{wrong}");
        }
    }
}
