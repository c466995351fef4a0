//! `skin export`: a recording for other programs.

mod bag;
pub(crate) mod tables;

use crate::files::arrays::write::{ArrayFile, Mat, Npz, Of};
use crate::files::order;
use crate::files::replace::beside;
use crate::reading::Reading;
use crate::recorded::SessionRecord;
use crate::recorded_frames::{self, Part, RecordedFrames, RecordedTable};
use crate::skin_file;
use crate::usage::Usage;
use ::forward::{Pattern, order::ValueOrder};
use anyhow::{Context, Result, anyhow, bail};
use clap::{Args, ValueEnum};
use recording::Topic;
use serde_json::Value;
use std::fs::File;
use std::io::{BufWriter, Error, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// What to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// A table that says what it is: drive and sense of every row, a column for every frame; for `skin reconstruct`.
    Csv,
    /// One frame a line, its values alone: 208 columns of 16 electrodes.
    FramesCsv,
    /// One touch a line, with its time and number.
    TouchesCsv,
    /// Arrays for numpy, in pyEIT's order and sign.
    Npz,
    /// Variables for MATLAB and Octave, in EIDORS' order and sign.
    Mat,
    /// Tables of touches and of frames for DuckDB, Polars and Spark, in a folder that takes many recordings.
    Parquet,
    /// A bag for ROS 2: frames, touches and pictures.
    Rosbag2,
}

impl Format {
    fn ending(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::FramesCsv => "frames.csv",
            Self::TouchesCsv => "touches.csv",
            Self::Npz => "npz",
            Self::Mat => "mat",
            Self::Parquet => "parquet",
            Self::Rosbag2 => "rosbag2",
        }
    }
}

/// Arguments of `skin export`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The recording.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// What to write.
    #[arg(long, value_enum, value_name = "FORMAT")]
    to: Format,
    /// The new file [default: the recording's name with the format's ending]; of parquet the folder of all recordings [default: parquet,
    /// beside the recording].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Order and sign of a frame's values, of npz, mat and frames-csv (docs/tables.md) [default: npz pyeit, mat eidors, frames-csv as
    /// measured].
    #[arg(long, value_parser = order::parser(), value_name = "ORDER")]
    order: Option<ValueOrder>,
    #[command(flatten)]
    part: Part,
}

/// Runs the command.
///
/// # Errors
/// The recording cannot be read or is too long for the format, or the new file cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let from = &arguments.file;
    let of_frames = matches!(arguments.to, Format::FramesCsv | Format::Npz | Format::Mat);
    if arguments.order.is_some() && !of_frames {
        let why = "--order is for npz, mat and frames-csv: every other row says what it is";
        return Err(Usage(why.to_owned()).into());
    }
    let whole = matches!(arguments.to, Format::TouchesCsv | Format::Parquet | Format::Rosbag2);
    if arguments.part.is_asked() && whole {
        let why = "touches-csv, parquet and rosbag2 take the whole recording; leave --from-s, --to-s and --every out";
        return Err(Usage(why.to_owned()).into());
    }
    let out = arguments.out.as_deref();
    let written = match arguments.to {
        Format::Parquet => tables::export(from, out)?,
        Format::Rosbag2 => bag::export(from, out)?,
        _ => file(arguments)?,
    };
    eprintln!("{written}");
    Ok(())
}

/// Writes what is one file; what was written.
fn file(arguments: &Arguments) -> Result<String> {
    let from = &arguments.file;
    let out = arguments
        .out
        .clone()
        .unwrap_or_else(|| skin_file::beside(from, arguments.to.ending()));
    let beside = beside(&out);
    let mut made = false;
    let mut open = || -> Result<BufWriter<File>> {
        let there = out.try_exists().and_then(|there| match there {
            true => Err(Error::new(ErrorKind::AlreadyExists, "there is a file of this name")),
            false => File::create(&beside),
        });
        let file = there.with_context(|| format!("{}: cannot be made; name a new file with --out", out.display()))?;
        made = true;
        Ok(BufWriter::new(file))
    };
    let written = match arguments.to {
        Format::Csv => table(&recorded_frames::table(from, &arguments.part)?, &mut open, &out),
        Format::FramesCsv => lines(arguments, &mut open),
        Format::TouchesCsv => touches(from, &mut open),
        Format::Npz => arrays(arguments, &mut open, ValueOrder::Pyeit, |file| Ok(Npz::new(file))),
        Format::Mat => arrays(arguments, &mut open, ValueOrder::Eidors, |file| {
            Mat::new(file, "frames recorded by skin")
        }),
        Format::Parquet | Format::Rosbag2 => bail!("these are no single file"),
    };
    // No part passes for the whole: it gets its name at the end.
    let written = written.and_then(|what| {
        let named = File::open(&beside)
            .and_then(|file| file.sync_all())
            .and_then(|()| std::fs::rename(&beside, &out));
        named.with_context(|| format!("{}: cannot be written", out.display()))?;
        Ok(what)
    });
    if written.is_err() && made {
        let _ = std::fs::remove_file(&beside);
    }
    // What reads and what opens files names them; what writes into one does not.
    let what = written.map_err(|error| match error.chain().len() == 1 && error.is::<Error>() {
        true => error.context(format!("{}: cannot be written", out.display())),
        false => error,
    })?;
    Ok(format!("{}: {what}", out.display()))
}

type Open<'a> = &'a mut dyn FnMut() -> Result<BufWriter<File>>;

fn table(recorded: &RecordedTable, open: Open<'_>, path: &Path) -> Result<String> {
    let RecordedTable {
        table,
        session,
        baseline,
        ..
    } = recorded;
    let mut out = open()?;
    let board = &session.board;
    writeln!(out, "# recorded: {} {}, {}", board.name, board.serial, session.program)?;
    if let Some(sheet) = &table.sheet {
        writeln!(out, "# sheet: {sheet}")?;
    }
    writeln!(out, "# rows: {}", table.measurements.len())?;
    writeln!(
        out,
        "# quantity: amplitude, V; the current enters at drive_a, the value is U(sense_b) - U(sense_a); columns are times, s"
    )?;
    write!(out, "drive_a,drive_b,sense_a,sense_b")?;
    for column in &table.columns {
        write!(out, ",{}", column.name)?;
    }
    writeln!(out)?;
    for (k, m) in table.measurements.iter().enumerate() {
        let [da, db, sa, sb] = [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus].map(|e| e + 1);
        write!(out, "{da},{db},{sa},{sb}")?;
        for column in &table.columns {
            let value = column.values[k];
            // As many digits as the number has.
            write!(out, ",{value:e}")?;
        }
        writeln!(out)?;
    }
    out.flush()?;
    let how = baseline.as_ref().map_or(String::new(), |b| {
        format!("; skin reconstruct {} --baseline {b}", path.display())
    });
    Ok(format!(
        "{} values of {} frames{how}",
        table.measurements.len(),
        table.columns.len()
    ))
}

/// For every value that is written: which one of the frame, and its sign.
type Picks = Vec<(usize, f64)>;

/// The values of an order among those of a pattern.
fn picks(order: ValueOrder, pattern: &Pattern) -> Result<Picks> {
    let layout = order
        .layout(pattern.len())
        .filter(|l| l.electrodes == pattern.electrodes());
    let layout = layout.with_context(|| {
        format!(
            "the order {} has no frame of {} values of {} electrodes",
            order.name(),
            pattern.len(),
            pattern.electrodes()
        )
    })?;
    layout
        .values
        .into_iter()
        .flatten()
        .map(|wanted| {
            let found = pattern.measurements().iter().enumerate().find_map(|(k, m)| {
                let sign = |own: ::forward::Pair, other: ::forward::Pair| match own {
                    own if own == other => Some(1.0),
                    own if own == other.reversed() => Some(-1.0),
                    _ => None,
                };
                Some((k, sign(m.drive, wanted.drive)? * sign(m.sense, wanted.sense)?))
            });
            found.ok_or_else(|| {
                anyhow!(
                    "the recorded plan does not measure the values of the order {}",
                    order.name()
                )
            })
        })
        .collect()
}

/// Name of the order that the plan itself has.
const AS_MEASURED: &str = "the board's";

/// The values in the order that was asked for, or in the format's own where the plan has it, or as they were measured.
fn chosen(asked: Option<ValueOrder>, usual: Option<ValueOrder>, pattern: &Pattern) -> Result<(Picks, String)> {
    let as_measured = || (0..pattern.len()).map(|k| (k, 1.0)).collect();
    match (asked, usual) {
        (Some(order), _) => Ok((picks(order, pattern)?, order.name().to_owned())),
        (None, Some(order)) => match picks(order, pattern) {
            Ok(picks) => Ok((picks, order.name().to_owned())),
            Err(why) => {
                eprintln!("{why:#}: the values are written as they were measured; drive and sense say what they are");
                Ok((as_measured(), AS_MEASURED.to_owned()))
            }
        },
        (None, None) => Ok((as_measured(), AS_MEASURED.to_owned())),
    }
}

fn picked(picks: &Picks, values: &[f64]) -> Vec<f64> {
    picks.iter().map(|(k, sign)| sign * values[*k]).collect()
}

fn lines(arguments: &Arguments, open: Open<'_>) -> Result<String> {
    let session = SessionRecord::read(&arguments.file)?;
    let mut frames = RecordedFrames::open(&arguments.file, &arguments.part)?;
    let (picks, order) = chosen(arguments.order, None, &frames.pattern(&session.wires)?)?;
    let mut out = open()?;
    let mut count = 0;
    while let Some(frame) = frames.next()? {
        for (k, value) in picked(&picks, &frame.measured.values_v).into_iter().enumerate() {
            write!(out, "{}{value:e}", if k == 0 { "" } else { "," })?;
        }
        writeln!(out)?;
        count += 1;
    }
    out.flush()?;
    Ok(format!("{count} frames of {} values, V, in {order} order", picks.len()))
}

/// Everything that numpy or MATLAB needs to know of the frames. The file is read twice: the first time it is counted.
fn arrays<F: ArrayFile>(
    arguments: &Arguments,
    open: Open<'_>,
    usual: ValueOrder,
    begin: impl FnOnce(BufWriter<File>) -> std::io::Result<F>,
) -> Result<String> {
    let path = &arguments.file;
    let session = SessionRecord::read(path)?;
    let start = || RecordedFrames::open(path, &arguments.part);
    let mut frames = start()?;
    let pattern = frames.pattern(&session.wires)?;
    let (picks, order) = chosen(arguments.order, Some(usual), &pattern)?;
    // Of a frame that is 208 values of 8 bytes: 3 numbers that are kept.
    let (mut times, mut unix, mut sequences) = (Vec::new(), Vec::new(), Vec::new());
    while let Some(frame) = frames.next()? {
        times.push(frame.measured.time_s);
        unix.push(1e-9 * frame.unix_ns as f64);
        sequences.push(frame.measured.sequence);
    }
    let count = times.len();
    if count == 0 {
        bail!("{}: no frames in the part that is asked for", path.display());
    }
    let of_baseline = baseline(path, frames.baseline())?;
    let (all, unpressed) = match usual {
        ValueOrder::Pyeit => ("v", "v0"),
        _ => ("vi", "vh"),
    };
    let mut out = begin(open()?)?;
    out.begin(all, count, picks.len(), Of::Float)?;
    let mut again = start()?;
    let mut written = 0;
    while let Some(frame) = again.next()? {
        // A recording that goes on is longer now.
        if written < count {
            out.floats(&picked(&picks, &frame.measured.values_v))?;
            written += 1;
        }
    }
    out.end()?;
    if let Some(of_baseline) = &of_baseline {
        // A plain vector for numpy, a column for MATLAB.
        let (frames, values) = match usual {
            ValueOrder::Pyeit => (picks.len(), 1),
            _ => (1, picks.len()),
        };
        out.begin(unpressed, frames, values, Of::Float)?;
        out.floats(&picked(&picks, of_baseline))?;
        out.end()?;
    } else {
        eprintln!("{}: no baseline was taken: {unpressed} is left out", path.display());
    }
    for (name, numbers) in [("time_s", &times), ("unix_s", &unix)] {
        out.begin(name, count, 1, Of::Float)?;
        out.floats(numbers)?;
        out.end()?;
    }
    out.begin("sequence", count, 1, Of::Unsigned)?;
    out.unsigned(&sequences)?;
    out.end()?;
    // ex_mat is pyEIT's only where every drive has as many values, as in its orders.
    let regular = usual == ValueOrder::Pyeit && order != AS_MEASURED;
    indices(&mut out, &pattern, &picks, regular, usual != ValueOrder::Pyeit)?;
    out.finish()?;
    let kept = of_baseline.map_or(String::new(), |_| format!(", the baseline as {unpressed}"));
    Ok(format!(
        "{count} frames of {} values, V, in {order} order as {all}{kept}",
        picks.len()
    ))
}

/// What the values are: pyEIT's ex_mat and meas_mat, or drive and sense of every value; electrodes from 0 or 1.
fn indices(out: &mut impl ArrayFile, pattern: &Pattern, picks: &Picks, pyeit: bool, from_one: bool) -> Result<()> {
    let from = u32::from(from_one);
    let pairs: Vec<([u32; 2], [u32; 2])> = picks
        .iter()
        .map(|(k, sign)| {
            let m = pattern.measurements()[*k];
            let sense = if *sign < 0.0 { m.sense.reversed() } else { m.sense };
            let two = |p: ::forward::Pair| [p.plus as u32 + from, p.minus as u32 + from];
            (two(m.drive), two(sense))
        })
        .collect();
    let mut drives: Vec<[u32; 2]> = pairs.iter().map(|(drive, _)| *drive).collect();
    let (of_drives, of_senses) = if pyeit {
        // A pair of its measurements is [n, m], where the value is that at n less that at m.
        drives.dedup();
        ("ex_mat", "meas_mat")
    } else {
        ("drive", "sense")
    };
    out.begin(of_drives, drives.len(), 2, Of::Unsigned)?;
    out.unsigned(drives.as_flattened())?;
    out.end()?;
    let senses: Vec<[u32; 2]> = pairs.iter().map(|(_, sense)| *sense).collect();
    out.begin(of_senses, senses.len(), 2, Of::Unsigned)?;
    out.unsigned(senses.as_flattened())?;
    out.end()?;
    Ok(())
}

/// The baseline that the frames of these numbers make, those of the first one, V, in the plan's order; none where there are none.
fn baseline(path: &Path, numbers: &[u32]) -> Result<Option<Vec<f64>>> {
    let mut frames = RecordedFrames::open(path, &Part::default())?;
    let mut used: Vec<Vec<f64>> = Vec::new();
    while used.len() < numbers.len()
        && let Some(frame) = frames.next()?
    {
        // In their order: after a reset the numbers come again.
        if frame.measured.sequence == numbers[used.len()] {
            used.push(frame.measured.values_v);
        }
    }
    let Some(first) = used.first() else { return Ok(None) };
    let of: Vec<&[f64]> = used.iter().map(Vec::as_slice).collect();
    let mean = inverse::reference::baseline::Baseline::of_frames(first.len(), &of);
    Ok(Some(mean.values_v))
}

fn touches(path: &Path, open: Open<'_>) -> Result<String> {
    let place = SessionRecord::read(path)?.place;
    let mut out = open()?;
    let keys = [
        "id",
        "x_mm",
        "y_mm",
        "rise",
        "area_mm2",
        "total_mm2",
        "force_n",
        "uncalibrated",
    ];
    let robot = "robot_x_mm,robot_y_mm,robot_z_mm";
    writeln!(out, "unix_s,time_s,frame,{},{robot}", keys.join(","))?;
    let mut reader = Reading::open(path)?;
    let (mut pictures, mut count) = (0, 0);
    while let Some(message) = reader.next()? {
        if message.topic != Some(Topic::Touches) {
            continue;
        }
        let unix_s = 1e-9 * message.publish_ns as f64;
        let line: Value = serde_json::from_slice(message.data).context("touches of the recording")?;
        pictures += 1;
        for touch in line["touches"].as_array().into_iter().flatten() {
            write!(out, "{unix_s:.6},{},{}", line["time_s"], line["frame"])?;
            for key in keys {
                match &touch[key] {
                    Value::Null => write!(out, ",")?,
                    value => write!(out, ",{value}")?,
                }
            }
            match tables::on_robot(place.as_ref(), touch) {
                Some([x, y, z]) => write!(out, ",{x},{y},{z}")?,
                None => write!(out, ",,,")?,
            }
            writeln!(out)?;
            count += 1;
        }
    }
    out.flush()?;
    Ok(format!("{count} touches of {pictures} pictures"))
}
