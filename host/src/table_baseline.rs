//! What the frames of a table are compared with: frames of the unpressed sheet, for each the frame before it, or the
//! model where the columns hold changes.

use crate::files::before::{self, Before};
use crate::files::measurements::{Column, MeasurementTable, Names, TableError};
use crate::number;
use crate::presses::locate::Comparison;
use crate::progress;
use anyhow::{Result, anyhow, bail};
use clap::Args;
use inverse::batch::{Batch, OwnFrame, Recovery};
use inverse::reference::baseline::Baseline;
use inverse::reference::imager::Imager;
use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

/// The baseline, on the command line.
#[derive(Clone, Debug, Args)]
pub(crate) struct BaselineArguments {
    /// Frames of the unpressed sheet, or a range of them such as 1-8; several are averaged, and eight or more tell the noise.
    #[arg(long, required_unless_present_any = ["before", "difference", "from"], value_delimiter = ',', value_name = "COLUMN,...")]
    baseline: Vec<String>,
    /// Each frame's own baseline: a CSV with the columns frame and before, which name a frame and the one of the unpressed sheet
    /// just before it. Frames that have none are compared with --baseline.
    #[arg(long, value_name = "FILE", hide_short_help = true)]
    before: Option<PathBuf>,
    /// The columns hold changes alone, pressed less unpressed; the unpressed values are taken from the model.
    #[arg(long, conflicts_with_all = ["baseline", "before"])]
    difference: bool,
    /// What 1 in a table of changes is, V of the model (with a current: at 1 mA and 1000 ohm per square) [default: 1].
    #[arg(long, value_name = "V", requires = "difference", conflicts_with_all = ["baseline", "before"], value_parser = number::positive("a voltage above 0"), hide_short_help = true)]
    unit_v: Option<f64>,
}

/// A frame to reconstruct.
pub(crate) struct Frame<'a> {
    /// Column of the table.
    pub place: usize,
    /// Its values, in the unit of the reference.
    pub values: Cow<'a, [f64]>,
    /// What was measured, and just before it, where it has a baseline of its own.
    pub own: Option<OwnFrame<'a>>,
    /// What it is compared with, in words.
    pub baseline: String,
}

/// A table made ready.
pub(crate) struct Prepared<'a> {
    /// Frames of the unpressed sheet, for the reference.
    pub unpressed: Vec<Cow<'a, [f64]>>,
    /// In words.
    pub name: String,
    /// The frames to reconstruct, in the order of the columns.
    pub frames: Vec<Frame<'a>>,
    /// Whether no dents of presses are in the unpressed frames: they are none of those before a press.
    pub undented: bool,
    /// Whether the unpressed frames are measured: they tell where the electrodes are.
    pub measured: bool,
    /// Whether the scatter of the unpressed frames is their noise.
    pub tells_noise: bool,
    /// Whether anything may have drifted between a frame and what it is compared with.
    pub drifts: bool,
    /// What of the table is neither a frame nor a baseline, in words.
    pub left_out: Option<String>,
    /// What was assumed, and said on stderr.
    pub notes: Vec<String>,
}

/// Names that are listed in full.
const MOST_LISTED: usize = 8;
/// Changes of more than this part of the model's voltages are hardly in volts.
const LARGEST_CHANGE: f64 = 1.0;
/// A finger of +20 % changes the voltages by 0.002 (in the middle) to 0.016 (at the rim) of them, root mean squares.
const USUAL_CHANGE: f64 = 0.01;
/// Voltages of a sheet, with touches and misplaced electrodes, have at least this correlation with the model's. So have changes of the whole
/// sheet alike, but these are smaller than this part of the voltages.
const OF_VOLTAGES: f64 = 0.98;
const LEAST_VOLTAGE: f64 = 0.5;
/// Ratios of pressed to unpressed voltages are nearer to 1 than this in the median; changes have both signs, or die away from the touch.
const MOST_OFF_ONE: f64 = 0.2;
/// A source of which less is left is broken: a column with a gain so small over another is of another unit.
const LEAST_GAIN: f64 = 0.2;

impl BaselineArguments {
    /// For each frame the one that a list of presses names before it.
    pub(crate) fn of_presses(list: &Path, difference: bool) -> Self {
        Self {
            baseline: Vec::new(),
            before: (!difference).then(|| list.to_owned()),
            difference,
            unit_v: None,
        }
    }

    /// Whether the command line names nothing.
    pub(crate) fn says_nothing(&self) -> bool {
        self.baseline.is_empty() && self.before.is_none() && !self.difference
    }

    /// Whether it says what 1 in a table of changes is.
    pub(crate) const fn has_unit(&self) -> bool {
        self.unit_v.is_some()
    }

    /// The same for a calibration from presses, which needs no model.
    pub(crate) fn comparison(&self) -> Comparison<'_> {
        Comparison {
            baseline: &self.baseline,
            before: self.before.as_deref(),
            difference: self.difference,
        }
    }

    /// These, with columns of the unpressed sheet where the command line names nothing.
    pub(crate) fn or(&self, columns: Option<&str>) -> Self {
        let mut own = self.clone();
        if self.says_nothing() {
            own.baseline.extend(columns.map(str::to_owned));
        }
        own
    }

    /// What the frames are compared with. What is assumed is said on stderr.
    ///
    /// # Errors
    /// A frame that the table does not have, a baseline without values, no frame left to reconstruct.
    pub(crate) fn prepare<'a>(&self, table: &'a MeasurementTable, imager: &Imager) -> Result<Prepared<'a>> {
        if self.difference {
            return self.changes(table, imager);
        }
        let names = table.names();
        let mut common = Vec::new();
        for name in &self.baseline {
            common.extend(names.range(name.trim())?);
        }
        agree(table, &common)?;
        let prepared = match &self.before {
            Some(path) => own(table, &names, &common, path)?,
            None => plain(table, common),
        };
        if prepared.frames.is_empty() {
            bail!(
                "{}: every frame is a baseline; leave one to be reconstructed",
                table.file
            );
        }
        if !prepared
            .unpressed
            .iter()
            .flat_map(|f| f.iter())
            .any(|v| v.is_finite() && *v != 0.0)
        {
            bail!(
                "{}: the baseline {} holds no value; name a frame of the unpressed sheet",
                table.file,
                prepared.name
            );
        }
        Ok(prepared)
    }

    /// Columns of changes: the model's voltages are the baseline, and a frame is these with its change.
    ///
    /// # Errors
    /// Columns that are voltages, or ratios of them.
    fn changes<'a>(&self, table: &'a MeasurementTable, imager: &Imager) -> Result<Prepared<'a>> {
        let model = &imager.model_v;
        let said_v = self.unit_v.unwrap_or(1.0);
        let sizes = parts(table, model).map(|part| part * said_v);
        let are_voltages =
            |(c, size): (&Column, f64)| imager.correlation(&c.values).abs() > OF_VOLTAGES && size > LEAST_VOLTAGE;
        if table.columns.iter().zip(sizes).all(are_voltages) {
            bail!(
                "{}: its columns are in proportion to the voltages of the sheet and as large, not changes of them; leave out --difference, \
                 and name a frame of the unpressed sheet with --baseline. If they are changes all the same, say their unit with --unit-v",
                table.file
            );
        }
        let are_ratios = |c: &Column| number::median(c.values.iter().map(|v| (v - 1.0).abs())) < MOST_OFF_ONE;
        if table.columns.iter().all(are_ratios) {
            bail!(
                "{}: its columns are near 1 throughout, as ratios of pressed to unpressed voltages, which are no changes. Name a frame of \
                 the unpressed sheet with --baseline; or, where only ratios are left, subtract 1 and multiply each by its unpressed voltage \
                 (skin forward --csv gives the model's)",
                table.file
            );
        }
        let mut notes = Vec::new();
        let unit_v = self.unit_v.unwrap_or_else(|| assumed_unit_v(table, model, &mut notes));
        let frame = |(place, column): (usize, &Column)| Frame {
            place,
            values: model
                .iter()
                .zip(&column.values)
                .map(|(m, d)| m + unit_v * d)
                .collect::<Vec<_>>()
                .into(),
            own: None,
            baseline: "the model".to_owned(),
        };
        let part = parts(table, model).fold(0.0, f64::max) * unit_v;
        let told = format!(
            "the columns are changes in units of {unit_v:.3e} V: up to {:.2} % of the model's voltages, with which the unpressed \
             sheet is assumed to agree",
            100.0 * part
        );
        eprintln!("{told}");
        notes.push(told);
        if part > LARGEST_CHANGE {
            let larger = "changes larger than the voltages themselves; say what 1 in the table is with --unit-v";
            eprintln!("warning: {}: {larger}", table.file);
            notes.push(larger.to_owned());
        }
        Ok(Prepared {
            left_out: None,
            notes,
            unpressed: vec![model.clone().into()],
            name: "the model".to_owned(),
            frames: table.columns.iter().enumerate().map(frame).collect(),
            undented: true,
            measured: false,
            tells_noise: false,
            drifts: false,
        })
    }
}

impl Prepared<'_> {
    /// Takes dents of earlier presses off frames that have each their own baseline: rubber recovers while the frame is pressed. Gives the
    /// what has recovered, and says it on stderr; none where nothing is to be seen.
    ///
    /// # Errors
    /// A frame of another length.
    pub(crate) fn recover(&mut self, batch: &Batch) -> Result<Option<Recovery>> {
        let own: Vec<OwnFrame<'_>> = self.frames.iter().filter_map(|frame| frame.own).collect();
        if own.is_empty() {
            return Ok(None);
        }
        let unpressed: Vec<&[f64]> = self.unpressed.iter().map(AsRef::as_ref).collect();
        let rest = Baseline::of_frames(own[0].values.len(), &unpressed).values_v;
        let recovered = progress::meanwhile("comparing frames with those before", || {
            batch.recovered(&rest, self.undented, &own)
        })?;
        let Some(recovered) = recovered else {
            return Ok(None);
        };
        for frame in &mut self.frames {
            if let Some(own) = frame.own {
                frame.values = own.compared(&rest, Some(&recovered)).into();
            }
        }
        let depth = match recovered.dented > 0.0 {
            true => format!(
                " (as deep as {:.0} % of a press, in the mean)",
                100.0 * recovered.dented
            ),
            false => String::new(),
        };
        eprintln!(
            "creep: {:.0} % of the dents in the frames before{depth} have gone in the frames themselves. That is taken off \
             (docs/tables.md, Baselines)",
            100.0 * recovered.part
        );
        Ok(Some(recovered))
    }
}

/// Root mean squares of the frames' changes, as parts of the model's, where 1 in the table is 1 V.
fn parts(table: &MeasurementTable, model: &[f64]) -> impl Iterator<Item = f64> {
    let whole = number::root_mean_square(model).max(f64::MIN_POSITIVE);
    let columns = table.columns.iter();
    columns.map(move |c| number::root_mean_square(&c.values) / whole)
}

/// What 1 in a table of changes is where nobody says it, V: 1, unless the changes were larger than the voltages then.
fn assumed_unit_v(table: &MeasurementTable, model: &[f64], notes: &mut Vec<String>) -> f64 {
    let usual = number::median(parts(table, model).filter(|part| *part > 0.0));
    if !(usual.is_finite() && parts(table, model).any(|part| part > LARGEST_CHANGE)) {
        return 1.0;
    }
    let told = format!(
        "in volts the changes were larger than the voltages themselves; taken to be {} % of them in the median, so that places hold, but \
         rises and forces only to a common factor. Say what 1 in the table is with --unit-v",
        100.0 * USUAL_CHANGE
    );
    eprintln!("warning: {}: {told}", table.file);
    notes.push(told);
    USUAL_CHANGE / usual
}

/// Refuses columns of a baseline that are of another sign than the others, or of another unit: no source loses so much.
///
/// Where most of three or more agree, the others are left out of the mean, and that is said ([`Baseline::of_frames`]).
fn agree(table: &MeasurementTable, common: &[usize]) -> Result<()> {
    let Some(first) = common.first().map(|k| &table.columns[*k]) else {
        return Ok(());
    };
    let gain = |c: &Column| number::median(c.values.iter().zip(&first.values).map(|(v, of)| v / of));
    let gains: Vec<(&str, f64)> = (common.iter().map(|k| &table.columns[*k]))
        .map(|c| (c.name.as_str(), gain(c)))
        .filter(|(_, gain)| gain.is_finite())
        .collect();
    let usual = number::median(gains.iter().map(|(_, gain)| *gain));
    let agrees = |gain: f64| (LEAST_GAIN..=1.0 / LEAST_GAIN).contains(&(gain / usual));
    let count = gains.iter().filter(|(_, gain)| agrees(*gain)).count();
    if count == gains.len() || (count > 2 && 2 * count > gains.len()) {
        return Ok(());
    }
    let factors: Vec<String> = (gains.iter().skip(1))
        .map(|(name, gain)| format!("{name} is {} times {}", factor_words(*gain), first.name))
        .collect();
    let told: Vec<&str> = factors.iter().map(String::as_str).collect();
    bail!(
        "{}: the columns of the baseline do not agree (in the median {}): they are of another sign or unit, or of another measurement; \
         name columns that are alike",
        table.file,
        shortened(&told)
    )
}

/// A factor of which the size counts.
fn factor_words(gain: f64) -> String {
    if (0.01..1e4).contains(&gain.abs()) {
        format!("{gain:.3}")
    } else {
        format!("{gain:.2e}")
    }
}

/// The mean of some frames for all others.
fn plain(table: &MeasurementTable, common: Vec<usize>) -> Prepared<'_> {
    let name = listed(table, &common);
    let taken: HashSet<usize> = common.iter().copied().collect();
    let frame = |place: usize| Frame {
        place,
        values: table.columns[place].values.as_slice().into(),
        own: None,
        baseline: name.clone(),
    };
    Prepared {
        left_out: None,
        notes: Vec::new(),
        frames: (0..table.columns.len())
            .filter(|k| !taken.contains(k))
            .map(frame)
            .collect(),
        unpressed: common
            .iter()
            .map(|k| table.columns[*k].values.as_slice().into())
            .collect(),
        name,
        undented: true,
        measured: true,
        tells_noise: true,
        drifts: true,
    }
}

/// For each frame the one that a file names.
fn own<'a>(table: &'a MeasurementTable, names: &Names<'_>, common: &[usize], path: &Path) -> Result<Prepared<'a>> {
    let file = path.display();
    let find = |entry: &Before, name: &str| {
        names.get(name).ok_or_else(|| {
            let unknown: TableError = names.unknown(name);
            anyhow!("{file}:{}: {unknown}", entry.line)
        })
    };
    let list = before::read(path)?;
    let mut own = HashMap::new();
    let mut without = Vec::new();
    let mut listed_frames = HashSet::new();
    for entry in &list {
        let frame = find(entry, &entry.frame)?;
        listed_frames.insert(frame);
        match &entry.before {
            Some(name) => _ = own.insert(frame, find(entry, name)?),
            None if common.is_empty() => bail!(
                "{file}:{}: column before: frame {} has no frame before it; name one, or give --baseline for such frames, or \
                 --difference where the columns hold changes",
                entry.line,
                entry.frame
            ),
            None => without.push(entry.frame.as_str()),
        }
    }
    if !without.is_empty() {
        eprintln!(
            "{} frames have no frame before them in {file} and are compared with the baseline {}: {}",
            without.len(),
            listed(table, common),
            shortened(&without)
        );
    }
    // All frames of an unpressed sheet once, for the reference.
    let mut unpressed: Vec<usize> = if common.is_empty() {
        own.values().copied().collect()
    } else {
        common.to_vec()
    };
    unpressed.sort_unstable();
    unpressed.dedup();
    let columns: Vec<&[f64]> = unpressed.iter().map(|k| table.columns[*k].values.as_slice()).collect();
    let reference = Baseline::of_frames(table.measurements.len(), &columns).values_v;
    let befores: HashSet<usize> = own.values().copied().chain(common.iter().copied()).collect();
    let mut frames = Vec::new();
    let mut unnamed = Vec::new();
    for (place, column) in table.columns.iter().enumerate() {
        if let Some(before) = own.get(&place) {
            let before = &table.columns[*before];
            let own = OwnFrame {
                before: &before.values,
                values: &column.values,
            };
            frames.push(Frame {
                place,
                values: own.compared(&reference, None).into(),
                own: Some(own),
                baseline: before.name.clone(),
            });
        } else if listed_frames.contains(&place) || (!common.is_empty() && !befores.contains(&place)) {
            frames.push(Frame {
                place,
                values: column.values.as_slice().into(),
                own: None,
                baseline: listed(table, common),
            });
        } else if !befores.contains(&place) {
            unnamed.push(column.name.as_str());
        }
    }
    let left_out = format!(
        "{} frames are not in {file} and are left out; name them there, or give --baseline for them: {}",
        unnamed.len(),
        shortened(&unnamed)
    );
    Ok(Prepared {
        notes: Vec::new(),
        left_out: (!unnamed.is_empty()).then_some(left_out),
        unpressed: columns.into_iter().map(Cow::from).collect(),
        name: format!("of each frame its own, by {file}"),
        frames,
        undented: !common.is_empty(),
        measured: true,
        // They were taken at different times: their scatter is drift.
        tells_noise: false,
        drifts: !common.is_empty(),
    })
}

/// Frames by their names, all or the first few.
fn listed(table: &MeasurementTable, places: &[usize]) -> String {
    let names: Vec<&str> = places.iter().map(|k| table.columns[*k].name.as_str()).collect();
    shortened(&names)
}

fn shortened(names: &[&str]) -> String {
    match names.split_at_checked(MOST_LISTED) {
        Some((first, rest)) if !rest.is_empty() => format!("{} and {} more", first.join(","), rest.len()),
        _ => names.join(","),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_are_shortened() {
        let names = ["a"; 10];
        assert_eq!(shortened(&names[..8]), "a,a,a,a,a,a,a,a");
        assert_eq!(shortened(&names), "a,a,a,a,a,a,a,a and 2 more");
    }
}
