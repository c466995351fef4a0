//! `skin bench skins`: the error on held-out presses of real skins, against the number of presses that are known.

use super::similarity::Similarity;
use super::{changes, model, picture, truth};
use crate::files::measurements::MeasurementTable;
use crate::files::replace::replace;
use crate::json;
use crate::progress::Progress;
use crate::thread_load::Stretch;
use anyhow::{Context, Result};
use clap::Args;
use inverse::learned::kernel_ridge::KernelRidge;
use inverse::learned::{Learned, Press, Setting, learn};
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

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
    /// Draws the errors against the number of known presses, an SVG.
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
}

/// What came of one skin with one number of known presses, mean over the draws. With none known it is what the model of a disc finds,
/// where only turn, mirror and size of the sheet are found out, of the same presses.
#[derive(Default, Serialize)]
pub(super) struct Row {
    pub(super) skin: String,
    pub(super) known: usize,
    pub(super) draws: usize,
    pub(super) held_out: usize,
    pub(super) median_mm: f64,
    pub(super) percentile_95_mm: f64,
    /// Part of the change that is explained.
    pub(super) explained: f64,
    /// Part of the true coordinates within two stated standard deviations.
    pub(super) within_two_sd: f64,
    /// Part of the presses in which exactly one touch was found.
    pub(super) exactly_one: f64,
    /// Part of the pairs of presses, sums of two held-out ones, of which both are found. None without pairs.
    pub(super) both_of_two: Option<f64>,
    /// Part of the frames at rest in which nothing is found: just before a press, against just before the one before it. None where
    /// the table holds changes.
    pub(super) none_at_rest: Option<f64>,
    /// The median error that was told beforehand, from the known presses alone.
    pub(super) expected_mm: Option<f64>,
    /// Processor time.
    pub(super) frame_us: f64,
    pub(super) learned_s: f64,
    /// Kernel ridge regression on the same presses.
    pub(super) ridge_median_mm: Option<f64>,
    pub(super) ridge_percentile_95_mm: Option<f64>,
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
    if !arguments.json {
        writeln!(
            crate::say::stdout(),
            "skin      known  median  95th pct   within 2 sd  one touch  both of two  at rest  expected   frame  learning   ridge: median  95th pct"
        )?;
    }
    let mut rows = Vec::new();
    for name in names {
        let skin = Skin::read(&arguments.folder, &name)?;
        let held_out = (skin.presses.len() as f64 * HELD_OUT) as usize;
        let mut print = |row: Row| -> Result<()> {
            if arguments.json {
                crate::say::stdout().write_all(&json::line(&row)?)?;
            } else {
                write!(crate::say::stdout(), "{}", words(&row))?;
            }
            rows.push(row);
            Ok(())
        };
        match skin.by_model(held_out) {
            Ok(row) => print(row)?,
            Err(why) => eprintln!("{name}: the model is not tried: {why:#}"),
        }
        for known in COUNTS.into_iter().filter(|k| k + held_out <= skin.presses.len()) {
            print(skin.measure(known, held_out)?)?;
        }
    }
    if let Some(path) = &arguments.svg {
        let text = picture::svg(&rows);
        replace(path, |file| file.write_all(text.as_bytes()))
            .with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    Ok(())
}

/// A table of presses.
struct Skin {
    name: String,
    list: PathBuf,
    table: MeasurementTable,
    known: Vec<truth::KnownPress>,
    presses: Vec<Press>,
    difference: bool,
}

impl Skin {
    fn read(folder: &Path, name: &str) -> Result<Self> {
        let file = folder.join(format!("{name}.csv"));
        let table = MeasurementTable::read(&file, Progress::new("reading").told())?;
        let list = folder.join(format!("{name}{TRUTH}"));
        let known = truth::read(&list)?;
        let difference = known.iter().all(|k| k.before.is_none());
        Ok(Self {
            name: name.to_owned(),
            presses: changes::presses(&table, &list.display().to_string(), &known, difference)?,
            list,
            table,
            known,
            difference,
        })
    }

    /// What the model alone finds of the last presses, with nothing known but how the sheet is best turned, mirrored and sized.
    fn by_model(&self, held_out: usize) -> Result<Row> {
        let later = &self.known[self.known.len() - held_out..];
        let names: Vec<&str> = later.iter().map(|p| p.frame.as_str()).collect();
        let from = Stretch::begin();
        let found = model::of_frames(
            &self.table,
            (&self.list, self.difference),
            &names,
            (None, None),
            (None, false),
        )?
        .presses;
        let frame_us = from.seconds() * 1e6 / held_out as f64;
        let touches = || (found.iter().zip(later)).filter_map(|(f, p)| Some((f.strongest.as_ref()?, p.place_mm)));
        let pairs: Vec<_> = touches().map(|(t, place)| ([t.x_mm, t.y_mm], place)).collect();
        let similarity = Similarity::between(&pairs);
        let mut errors = vec![f64::INFINITY; held_out - pairs.len()];
        let mut inside = 0;
        for (touch, place) in touches() {
            let Some(similarity) = similarity else {
                errors.push(f64::INFINITY);
                continue;
            };
            let there = similarity.of([touch.x_mm, touch.y_mm]);
            let off = [0, 1].map(|a| there[a] - place[a]);
            errors.push(off[0].hypot(off[1]));
            // Turned, the deviations along both axes mix; their mean square stays.
            let square = [touch.x_sd_mm, touch.y_sd_mm].map(|sd| sd.unwrap_or(0.0).powi(2));
            let sd = similarity.size() * (0.5 * (square[0] + square[1])).sqrt();
            inside += off.iter().filter(|o| o.abs() < 2.0 * sd).count();
        }
        let [median_mm, percentile_95_mm] = quantiles(errors);
        let part = |count: usize| count as f64 / held_out as f64;
        Ok(Row {
            skin: self.name.clone(),
            held_out,
            median_mm,
            percentile_95_mm,
            explained: found.iter().map(|f| f.explained).sum::<f64>() / held_out as f64,
            within_two_sd: 0.5 * part(inside),
            exactly_one: part(found.iter().filter(|f| f.touches == 1).count()),
            frame_us,
            ..Row::default()
        })
    }

    /// Learns from stretches of the first presses and locates the last ones.
    fn measure(&self, known: usize, held_out: usize) -> Result<Row> {
        let presses = &self.presses;
        let later = &presses[presses.len() - held_out..];
        let room = presses.len() - held_out - known;
        let mut starts: Vec<usize> = (0..DRAWS).map(|d| d * room / (DRAWS - 1)).collect();
        starts.dedup();
        let setting = Setting {
            measurements: &self.table.measurements,
            electrodes: self.table.electrodes,
            turn: 1,
            extent: None,
        };
        let mut row = Row {
            skin: self.name.clone(),
            known,
            draws: starts.len(),
            held_out,
            ..Row::default()
        };
        let share = 1.0 / starts.len() as f64;
        for start in starts {
            let taught = &presses[start..start + known];
            let from = Stretch::begin();
            let (learned, found) = learn(taught, &setting, |_, _| {})?;
            row.learned_s += share * from.seconds();
            let from = Stretch::begin();
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
            row.frame_us += share * from.seconds() * 1e6 / held_out as f64;
            let [median, high] = quantiles(errors);
            row.median_mm += share * median;
            row.percentile_95_mm += share * high;
            row.explained += share * found.explained;
            row.within_two_sd += share * inside as f64 / (2 * held_out) as f64;
            row.exactly_one += share * one as f64 / held_out as f64;
            if let Some(both) = both_of_two(&learned, later) {
                *row.both_of_two.get_or_insert(0.0) += share * both;
            }
            if let Some(none) = self.none_at_rest(&learned, held_out) {
                *row.none_at_rest.get_or_insert(0.0) += share * none;
            }
            *row.expected_mm.get_or_insert(0.0) += share * found.error_mm[0];
            let [median, high] = quantiles(ridge_errors(taught, later));
            *row.ridge_median_mm.get_or_insert(0.0) += share * median;
            *row.ridge_percentile_95_mm.get_or_insert(0.0) += share * high;
        }
        Ok(row)
    }

    /// Part of the frames just before the last presses in which nothing is found, against the frame just before the press before.
    fn none_at_rest(&self, learned: &Learned, held_out: usize) -> Option<f64> {
        let names = self.table.names();
        let unpressed = |k: usize| {
            let column = names.get(self.known[k].before.as_ref()?)?;
            Some(&self.table.columns[column].values)
        };
        let mut none = 0;
        for k in self.known.len() - held_out..self.known.len() {
            let (now, then) = (unpressed(k)?, unpressed(k.checked_sub(1)?)?);
            let change: Vec<f64> = now.iter().zip(then).map(|(a, b)| a - b).collect();
            let presence = learned.locate(&change, Some(self.presses[k - 1].place_mm));
            none += usize::from(presence.presses.is_empty());
        }
        Some(f64::from(u32::try_from(none).ok()?) / held_out as f64)
    }
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

/// Where half of the presses are missed there is no median, and without known presses no regression.
fn mm(value: Option<f64>, width: usize) -> String {
    match value.filter(|v| v.is_finite()) {
        Some(value) => format!("{value:width$.1} mm"),
        None => format!("{:>width$}   ", "-"),
    }
}

fn words(row: &Row) -> String {
    let percent = |part: Option<f64>| part.map_or("-".to_owned(), |part| format!("{:.1}", 100.0 * part));
    let mut text = format!(
        "{:9} {:5} {} {} {:11.0} % {:8.1} % {:>10} % {:>6} % {} {:4.0} us {:7.1} s {} {}\n",
        row.skin,
        row.known,
        mm(Some(row.median_mm), 5),
        mm(Some(row.percentile_95_mm), 6),
        100.0 * row.within_two_sd,
        100.0 * row.exactly_one,
        percent(row.both_of_two),
        percent(row.none_at_rest),
        mm(row.expected_mm, 6),
        row.frame_us,
        row.learned_s,
        mm(row.ridge_median_mm, 12),
        mm(row.ridge_percentile_95_mm, 6)
    );
    if row.known == 0 {
        let part = 100.0 * row.explained;
        text += &format!("          not calibrated: touches of the model explain {part:.0} % of the change\n");
    }
    text
}
