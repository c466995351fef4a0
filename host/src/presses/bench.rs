//! `skin bench skins`: the error on held-out presses of real skins, against the number of presses that are known.

use super::{changes, truth};
use crate::files::measurements::MeasurementTable;
use crate::progress::Progress;
use anyhow::{Context, Result};
use clap::Args;
use inverse::learned::kernel_ridge::KernelRidge;
use inverse::learned::{Learned, Press, Setting, learn};
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Numbers of presses that are known.
const COUNTS: [usize; 8] = [5, 10, 20, 50, 100, 200, 500, 1000];
/// Draws for every number.
const DRAWS: usize = 3;
/// Part of the presses, the last ones, that nothing is learned from.
const HELD_OUT: f64 = 1.0 / 3.0;
/// Two presses at once are apart by this, mm, or more, and found within so many.
const APART_MM: f64 = 30.0;
const NEAR_MM: f64 = 10.0;
/// What ends the name of a list of places.
const TRUTH: &str = "_truth.csv";

/// Arguments of `skin bench skins`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder with tables NAME.csv and beside each NAME_truth.csv with its presses, as for `skin calibrate presses`. Every skin is
    /// taken for one that turns by one electrode may map onto itself; whether they do is found out.
    folder: PathBuf,
    /// One JSON object a line.
    #[arg(long)]
    json: bool,
}

/// What came of one skin with one number of known presses, mean over the draws.
#[derive(Default, Serialize)]
struct Row {
    skin: String,
    known: usize,
    draws: usize,
    held_out: usize,
    median_mm: f64,
    percentile_95_mm: f64,
    /// Part of the true coordinates within two stated standard deviations.
    within_two_sd: f64,
    /// Part of the presses in which exactly one touch was found.
    exactly_one: f64,
    /// Part of the pairs of presses, sums of two held-out ones, of which both are found. None without pairs.
    both_of_two: Option<f64>,
    /// The median error that was told beforehand, from the known presses alone.
    expected_mm: f64,
    frame_us: f64,
    learned_s: f64,
    /// Kernel ridge regression on the same presses.
    ridge_median_mm: f64,
    ridge_percentile_95_mm: f64,
}

/// Runs the command.
///
/// # Errors
/// A folder or a table that cannot be read.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let folder = arguments.folder.display();
    let mut names: Vec<String> = std::fs::read_dir(&arguments.folder)
        .with_context(|| format!("{folder}: cannot be read; name a folder of tables"))?
        .filter_map(|entry| Some(entry.ok()?.file_name().to_str()?.strip_suffix(TRUTH)?.to_owned()))
        .collect();
    names.sort();
    if names.is_empty() {
        eprintln!("skipped: {folder} has no table NAME.csv with a list NAME{TRUTH} beside it");
    }
    let mut out = std::io::stdout().lock();
    if !arguments.json {
        writeln!(
            out,
            "skin      known  median  95th pct   within 2 sd  one touch  both of two  expected   frame   ridge: median  95th pct"
        )?;
    }
    for name in names {
        let (table, presses) = read(&arguments.folder, &name)?;
        let held_out = (presses.len() as f64 * HELD_OUT) as usize;
        for known in COUNTS.into_iter().filter(|k| k + held_out <= presses.len()) {
            let row = measure(&name, &table, &presses, known, held_out)?;
            if arguments.json {
                serde_json::to_writer(&mut out, &row)?;
                writeln!(out)?;
            } else {
                write!(out, "{}", words(&row))?;
            }
        }
    }
    Ok(())
}

fn read(folder: &Path, name: &str) -> Result<(MeasurementTable, Vec<Press>)> {
    let table = MeasurementTable::read(
        &folder.join(format!("{name}.csv")),
        &mut Progress::new("reading", false),
    )?;
    let list = folder.join(format!("{name}{TRUTH}"));
    let known = truth::read(&list)?;
    let difference = known.iter().all(|k| k.before.is_none());
    let presses = changes::presses(&table, &list.display().to_string(), &known, difference)?;
    Ok((table, presses))
}

/// Learns from stretches of the first presses and locates the last ones.
fn measure(name: &str, table: &MeasurementTable, presses: &[Press], known: usize, held_out: usize) -> Result<Row> {
    let later = &presses[presses.len() - held_out..];
    let room = presses.len() - held_out - known;
    let mut starts: Vec<usize> = (0..DRAWS).map(|d| d * room / (DRAWS - 1)).collect();
    starts.dedup();
    let setting = Setting {
        measurements: &table.measurements,
        electrodes: table.electrodes,
        turn: 1,
    };
    let mut row = Row {
        skin: name.to_owned(),
        known,
        draws: starts.len(),
        held_out,
        ..Row::default()
    };
    let share = 1.0 / starts.len() as f64;
    for start in starts {
        let taught = &presses[start..start + known];
        let from = Instant::now();
        let (learned, found) = learn(taught, &setting, |_, _| {})?;
        row.learned_s += share * from.elapsed().as_secs_f64();
        let from = Instant::now();
        let (mut before, mut inside, mut one) = (None, 0, 0);
        let mut errors = Vec::new();
        for press in later {
            let presence = learned.locate(&press.change, before);
            one += usize::from(presence.presses.len() == 1);
            let Some(located) = presence.presses.first() else {
                errors.push(f64::INFINITY);
                continue;
            };
            before = Some(located.place_mm);
            let off = [0, 1].map(|a| located.place_mm[a] - press.place_mm[a]);
            inside += (0..2)
                .filter(|a| off[*a].abs() < 2.0 * located.covariance_mm2[*a][*a].sqrt())
                .count();
            errors.push(off[0].hypot(off[1]));
        }
        row.frame_us += share * from.elapsed().as_secs_f64() * 1e6 / held_out as f64;
        let [median, high] = quantiles(errors);
        row.median_mm += share * median;
        row.percentile_95_mm += share * high;
        row.within_two_sd += share * inside as f64 / (2 * held_out) as f64;
        row.exactly_one += share * one as f64 / held_out as f64;
        if let Some(both) = both_of_two(&learned, later) {
            *row.both_of_two.get_or_insert(0.0) += share * both;
        }
        row.expected_mm += share * found.error_mm[0];
        let [median, high] = quantiles(ridge_errors(taught, later));
        row.ridge_median_mm += share * median;
        row.ridge_percentile_95_mm += share * high;
    }
    Ok(row)
}

/// Part of the sums of two presses of which exactly two are found, near both.
fn both_of_two(learned: &Learned, presses: &[Press]) -> Option<f64> {
    let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let others = presses.iter().cycle().skip(presses.len() / 2);
    let pairs: Vec<(&Press, &Press)> = presses
        .iter()
        .zip(others)
        .filter(|(a, b)| distance(a.place_mm, b.place_mm) >= APART_MM)
        .collect();
    let found = |(a, b): &&(&Press, &Press)| {
        let change: Vec<f64> = a.change.iter().zip(&b.change).map(|(a, b)| a + b).collect();
        let found = learned.locate(&change, None).presses;
        let near = |p: &Press| found.iter().any(|f| distance(f.place_mm, p.place_mm) < NEAR_MM);
        found.len() == 2 && near(a) && near(b)
    };
    (!pairs.is_empty()).then(|| pairs.iter().filter(found).count() as f64 / pairs.len() as f64)
}

fn ridge_errors(taught: &[Press], later: &[Press]) -> Vec<f64> {
    let values: Vec<&[f64]> = taught.iter().map(|p| p.change.as_slice()).collect();
    let places: Vec<[f64; 2]> = taught.iter().map(|p| p.place_mm).collect();
    let Some((ridge, _)) = KernelRidge::learn(&values, &places) else {
        return vec![f64::NAN; later.len()];
    };
    later
        .iter()
        .map(|press| {
            let place = ridge.predict(&press.change);
            (place[0] - press.place_mm[0]).hypot(place[1] - press.place_mm[1])
        })
        .collect()
}

/// Median and 95th percentile.
fn quantiles(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    [values.len() / 2, values.len() * 95 / 100].map(|k| values[k])
}

/// Where half of the presses are missed there is no median.
fn mm(value: f64, width: usize) -> String {
    if value.is_finite() {
        format!("{value:width$.1} mm")
    } else {
        format!("{:>width$}   ", "-")
    }
}

fn words(row: &Row) -> String {
    format!(
        "{:9} {:5} {} {} {:11.0} % {:8.1} % {:>10} % {:6.1} mm {:4.0} us {:12.1} mm {:6.1} mm\n",
        row.skin,
        row.known,
        mm(row.median_mm, 5),
        mm(row.percentile_95_mm, 6),
        100.0 * row.within_two_sd,
        100.0 * row.exactly_one,
        row.both_of_two
            .map_or("-".to_owned(), |part| format!("{:.1}", 100.0 * part)),
        row.expected_mm,
        row.frame_us,
        row.ridge_median_mm,
        row.ridge_percentile_95_mm
    )
}
