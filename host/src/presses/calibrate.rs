//! `skin calibrate presses`: maps of a real skin from presses at known places.

use super::extent::Extent;
use super::file::{ModelKeys, Of, Taught};
use super::guided::{self, Gathered};
use super::{changes, file, model, store, truth};
use crate::baselines;
use crate::files::measurements::MeasurementTable;
use crate::files::replace::try_out;
use crate::json;
use crate::progress::{self, Progress};
use crate::usage::Usage;
use crate::{table_file, table_sheet};
use ::forward::Sheet;
use anyhow::{Context, Result, bail};
use clap::{ArgGroup, Args};
use hil_sim::BOARD_NAME;
use inverse::learned::{
    FEWEST_FOR_MORE, Findings, Gain, Gaps, Grain, Learned, Marks, Press, Setting, Shift, StoredGain, learn_without,
    shifted, turn,
};
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Presses for which the gain of more is told.
const MORE: usize = 30;

/// A fingertip's radius over the reach of a sheet: nearer to the rim nobody is told to press.
const FROM_THE_RIM: f64 = 0.06;
/// Places that are named where presses do not reach; the others are counted.
const MOST_MARKS: usize = 3;

/// What takes the place of a table. What is said of one is refused beside it: clap does not ask for the table where it may not be.
const NO_TABLE: [&str; 5] = ["port", "serial", "simulate", "scene", "from"];

/// Arguments of `skin calibrate presses`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("source").required(true)))]
pub(crate) struct Arguments {
    /// Table of measurements (CSV: drive_a, drive_b, sense_a, sense_b, then a column for every frame).
    #[arg(group = "source", requires = "truth")]
    table: Option<PathBuf>,
    /// Where the presses of the table were: a CSV with the columns frame, before, x_mm, y_mm and perhaps force_n, a line a press in order of time.
    #[arg(long, value_name = "FILE", requires = "table", conflicts_with_all = NO_TABLE)]
    truth: Option<PathBuf>,
    #[command(flatten)]
    guided: guided::Arguments,
    /// The columns hold changes, pressed less unpressed; the column before is empty.
    #[arg(long, requires = "table", conflicts_with_all = NO_TABLE, hide_short_help = true)]
    difference: bool,
    /// The sheet, a TOML file as for `skin forward` [default: the paper's disc].
    ///
    /// It says by what turns it is mapped onto itself, and its model is tried beside what is learned. Any turn from electrode to electrode maps
    /// the paper's disc onto itself.
    #[arg(long, value_name = "FILE")]
    sheet: Option<PathBuf>,
    /// Learns from the list as it is, even where the presses say that it is shifted from a line on.
    #[arg(long, hide_short_help = true)]
    as_listed: bool,
    /// Where to write the calibration. What is there of the rubber's creep is kept.
    #[arg(long, default_value = "skin.cal", value_name = "FILE")]
    out: PathBuf,
    /// Stores it for the board of this serial number, too, for skin run to load by itself; what is taken from a board is stored for that one.
    #[arg(long, value_name = "SERIAL", hide_short_help = true)]
    store: Option<String>,
    /// Folder of the stored calibrations [default: that of the stored baselines, and none for a simulated skin].
    #[arg(long, value_name = "DIR", hide_short_help = true)]
    state_dir: Option<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Whether it needs nobody to press.
    pub(crate) fn is_alone(&self) -> bool {
        self.table.is_some()
    }
}

#[derive(Serialize)]
struct Line<'a> {
    presses: usize,
    /// Frames of presses that nothing explains; they are left out.
    gross: Vec<&'a str>,
    /// Frames of presses in which nothing is found by what the others taught; they are learned from.
    missed: Vec<&'a str>,
    measurements: usize,
    /// Rows of the table without a value or a change, as drive_a, drive_b, sense_a, sense_b.
    dead: Vec<[usize; 4]>,
    /// Rows that presses hardly explain.
    unexplained: Vec<[usize; 4]>,
    /// Rows that hold what the press before did.
    stale: Vec<[usize; 4]>,
    symmetric: bool,
    clockwise: Option<bool>,
    centre_mm: [f64; 2],
    radius_mm: f64,
    /// None where the sheet seems to conduct alike in all directions.
    grain: Option<Grain>,
    memory: f64,
    displaced: f64,
    corrected: bool,
    explained: f64,
    error_median_mm: f64,
    error_95th_percentile_mm: f64,
    uncertainty_factor: f64,
    more_presses: MorePresses,
    expected_mm: Option<f64>,
    /// Newtons over the sheet; none where fewer than five forces are known.
    force: Option<ForceLine>,
    /// Presses with a force.
    forces_known: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    model: Option<ModelLine>,
    #[serde(skip_serializing_if = "Option::is_none")]
    model_not_tried: Option<String>,
    /// None where presses reach all of the sheet.
    unreached: Option<UnreachedLine>,
    /// Where the list was learned from though presses fit it better shifted.
    #[serde(skip_serializing_if = "Option::is_none")]
    shifted: Option<ShiftedLine>,
}

/// Where presses tell little of the sheet.
#[derive(Serialize)]
struct UnreachedLine {
    /// Part of the sheet, 0 to 1.
    part: f64,
    /// Where to press as well, mm.
    also_mm: Vec<[f64; 2]>,
}

impl UnreachedLine {
    fn of(unreached: &Gaps) -> Option<Self> {
        (!unreached.also_mm.is_empty()).then(|| Self {
            part: unreached.part,
            also_mm: unreached.also_mm.clone(),
        })
    }
}

/// From which press on another line has its place.
#[derive(Serialize)]
struct ShiftedLine {
    line: u64,
    frame: String,
    /// 1 where that is the next line, -1 where it is the one before.
    by: isize,
}

impl ShiftedLine {
    fn of(shift: &Shift, known: &[truth::KnownPress]) -> Self {
        let press = &known[shift.from];
        Self {
            line: press.line,
            frame: press.frame.clone(),
            by: shift.by,
        }
    }
}

/// What more presses promise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum MorePresses {
    /// Their error is told.
    WouldHelp,
    /// They are few, so that more surely help; by how much they do not tell.
    TooFewToTell,
    /// All presses are not located better than half of them are.
    NoSign,
}

impl MorePresses {
    fn of(found: &Findings) -> Self {
        match found.expected_mm(MORE) {
            Some(_) => Self::WouldHelp,
            None if found.presses < FEWEST_FOR_MORE => Self::TooFewToTell,
            None => Self::NoSign,
        }
    }
}

/// Newtons over the sheet.
#[derive(Serialize)]
struct ForceLine {
    /// Force of a press of the usual strength, where the place tells nothing.
    usual_n: f64,
    /// Largest over smallest among the places of the presses.
    range: f64,
    /// Standard deviation of the force of one press, over the force: each by what the others tell.
    relative_sd: f64,
}

impl ForceLine {
    const fn of(gain: &StoredGain) -> Self {
        Self {
            usual_n: gain.usual_n,
            range: gain.range,
            relative_sd: gain.relative_sd,
        }
    }
}

/// The sheet's model on the same presses.
#[derive(Serialize)]
struct ModelLine {
    error_median_mm: f64,
    error_95th_percentile_mm: f64,
    /// Whether it is better than what was learned, and used.
    better: bool,
    /// The same errors with nothing told, where the presses told of its sheet.
    #[serde(skip_serializing_if = "Option::is_none")]
    untold_median_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    untold_95th_percentile_mm: Option<f64>,
    /// By how much touches are moved then: root mean square over the sheet.
    #[serde(skip_serializing_if = "Option::is_none")]
    moved_mm: Option<f64>,
}

impl ModelLine {
    fn of(keys: &ModelKeys) -> Self {
        let told = keys.told.as_ref();
        Self {
            untold_median_mm: told.map(|told| told.untold_median_mm),
            untold_95th_percentile_mm: told.map(|told| told.untold_95th_percentile_mm),
            moved_mm: told.map(|told| told.moved_mm),
            error_median_mm: keys.error_median_mm,
            error_95th_percentile_mm: keys.error_95th_percentile_mm,
            better: keys.better,
        }
    }
}

/// What is learned from.
struct Input {
    table: PathBuf,
    truth: PathBuf,
    sheet: Option<Sheet>,
    /// A board whose frames they are.
    gathered: Option<Gathered>,
}

/// Runs the command.
///
/// # Errors
/// A table or a list of presses that makes no sense, too few presses, a board that does not answer, a file that cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    try_store(arguments)?;
    let mut input = input(arguments)?;
    let table = table_file::read(&input.table, None, &[])?;
    let known = truth::read(&input.truth)?;
    let list = input.truth.display().to_string();
    let extent = extent(&input, &table)?;
    if let Some(extent) = extent.as_ref().filter(|_| input.gathered.is_none()) {
        extent.check(&list, known.iter().map(|press| (press.line, press.place_mm)))?;
        if let Some(doubt) = extent.doubt(known.iter().map(|press| press.place_mm)) {
            eprintln!("warning: {list}: {doubt}");
        }
    }
    let presses = changes::presses(&table, &list, &known, arguments.difference)?;
    let setting = Setting {
        measurements: &table.measurements,
        electrodes: electrodes(&input, &table),
        turn: input.sheet.as_ref().map_or(Ok(1), turn)?,
        extent: extent.as_ref().and_then(Extent::of_sheet),
    };
    let cannot = || format!("{}: no calibration can be made", table.file);
    let by_model = by_model(arguments, &input, &table, &known);
    let by_maps = progress::meanwhile("comparing the list with the presses", || shifted(&presses, &setting))
        .with_context(cannot)?;
    let by_places = by_model.as_ref().ok().and_then(|by_model| by_model.shifted(&known));
    let said = match (&by_places, &by_maps) {
        (Some(shift), _) => {
            let [own, read] = shift.left;
            Some(shift_words(
                &list,
                &known,
                shift,
                [format!("{own:.1} mm"), format!("{read:.1} mm off")],
            ))
        }
        (None, Some(shift)) => {
            let [own, read] = shift.left.map(|left| 100.0 * left);
            let read = format!("{read:.1} % of the square of a usual change is left");
            Some(shift_words(&list, &known, shift, [format!("{own:.1} %"), read]))
        }
        (None, None) => None,
    };
    let shift = by_places.or(by_maps);
    if let Some(said) = said {
        if !arguments.as_listed {
            bail!("{said}; --as-listed learns from the list as it is");
        }
        eprintln!("warning: {said}");
    }
    let wrong = match &by_model {
        Ok(by_model) if shift.is_none() => by_model.wrong(&known),
        _ => Vec::new(),
    };
    let progress = Progress::new("learning");
    let learn = |wrong: &[usize]| {
        let learned = learn_without(&presses, &setting, wrong, |done, whole| progress.at(done, whole));
        learned.with_context(|| match wrong.len() {
            0 => cannot(),
            count => format!(
                "{}; the sheet's model puts {count} presses far from their places in {list}",
                cannot()
            ),
        })
    };
    let (mut learned, mut found) = learn(&wrong)?;
    if let Ok(by_model) = &by_model {
        let confirmed = by_model.confirmed(&wrong, &known, &presses, &learned);
        if confirmed != wrong {
            (learned, found) = learn(&confirmed)?;
        }
    }
    drop(progress);
    let unreached = unreached(&input, extent.as_ref(), &setting, &known, &found)?;
    if let Some(doubt) = extent.and_then(|extent| extent.doubt_radius(found.radius_mm)) {
        eprintln!("warning: {list}: {doubt}");
    }
    let model = by_model.and_then(|by_model| model::tried(&by_model, &known, &found.gross, found.error_mm));
    if let Some(said) = unreached_words(&unreached)
        && !model.as_ref().is_ok_and(|model| model.better)
    {
        eprintln!("warning: {list}: {said}");
    }
    let gain = gain(&learned, &presses, &known);
    let mut of = Of::new(input.sheet.as_ref(), &table.measurements)?;
    if let Some(gathered) = &input.gathered {
        of = of.with_board(&gathered.hello.board, &gathered.hello.serial);
    } else if let Some(serial) = &arguments.store {
        of.serial = Some(serial.clone());
    }
    let taught = Taught {
        learned: &learned,
        found: &found,
        model: model.as_ref().ok(),
        gain: gain.as_ref(),
        measurements: &table.measurements,
        electrodes: electrodes(&input, &table),
        difference: arguments.difference,
        of,
    };
    let with_rubber = file::put_presses(&arguments.out, &taught)?;
    let stored = stored(arguments, &input)?;
    if let Some(path) = &stored {
        file::put_presses(path, &taught)?;
    }
    let line = Line {
        model: model.as_ref().ok().map(ModelLine::of),
        model_not_tried: model.as_ref().err().map(|why| format!("{why:#}")),
        force: gain.as_ref().map(|gain| ForceLine::of(gain.stored())),
        forces_known: known.iter().filter(|press| press.force_n.is_some()).count(),
        unreached: UnreachedLine::of(&unreached),
        shifted: shift.map(|shift| ShiftedLine::of(&shift, &known)),
        ..line(&found, &known, &table, &presses)
    };
    let mut out = crate::say::stdout();
    if arguments.json {
        out.write_all(&json::line(&line)?)?;
    } else {
        write!(out, "{}", words(&line))?;
    }
    eprintln!(
        "{0}: written; skin run --calibration {0} and skin reconstruct TABLE --calibration {0} locate touches with it",
        arguments.out.display()
    );
    if with_rubber {
        eprintln!("{}: the rubber's creep that was in it is kept", arguments.out.display());
    }
    if let Some(path) = &stored {
        eprintln!(
            "{}: stored; skin run loads it by itself, --calibration none does without",
            path.display()
        );
    }
    if let Some(gathered) = &mut input.gathered {
        let used = match &line.model {
            Some(model) if model.better => format!(
                "the sheet's model is better, {:.1} mm median error, and used",
                model.error_median_mm
            ),
            _ => format!("{:.1} mm median error", line.error_median_mm),
        };
        gathered.end(&format!(
            "{}: written; {used}; the program has ended",
            arguments.out.display()
        ));
    }
    Ok(())
}

/// A table and a list: those that are given, or what is taken now.
fn input(arguments: &Arguments) -> Result<Input> {
    if !arguments.guided.is_asked() {
        file::holds_presses(&arguments.out)?;
        let missing = || Usage("give a table with --truth, or a board with --port, --serial or --simulate".to_owned());
        return Ok(Input {
            table: arguments.table.clone().ok_or_else(missing)?,
            truth: arguments.truth.clone().ok_or_else(missing)?,
            sheet: arguments.sheet.as_deref().map(sheet_of).transpose()?,
            gathered: None,
        });
    }
    if arguments.sheet.is_some() && (arguments.guided.scene.is_some() || arguments.guided.from.is_some()) {
        return Err(Usage("a scene and a recording have a sheet of their own; leave --sheet out".to_owned()).into());
    }
    let (table, truth) = (
        arguments.out.with_extension("table.csv"),
        arguments.out.with_extension("presses.csv"),
    );
    clear(&arguments.out, [&table, &truth])?;
    let gathered = guided::gather(&arguments.guided, arguments.sheet.as_deref())?;
    gathered.write(&table, &truth)?;
    eprintln!(
        "{0}, {1}: what was taken; skin calibrate presses {0} --truth {1} learns from it again",
        table.display(),
        truth.display()
    );
    Ok(Input {
        sheet: Some(gathered.sheet.clone()),
        table,
        truth,
        gathered: Some(gathered),
    })
}

/// Sees before the first press that what is taken can be written, and that nothing of earlier presses is lost: they cannot be taken again.
fn clear(out: &Path, beside: [&Path; 2]) -> Result<()> {
    let mut there: Vec<String> = (beside.iter().filter(|path| path.exists()))
        .map(|path| path.display().to_string())
        .collect();
    if file::holds_presses(out)? {
        there.push(out.display().to_string());
    }
    if !there.is_empty() {
        bail!(
            "{}: there already, of earlier presses; name another file with --out, or move what is there away",
            there.join(", ")
        );
    }
    for path in beside {
        try_out(path).with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    Ok(())
}

/// How far the sheet extends, where it is known. It is that of the table then.
fn extent(input: &Input, table: &MeasurementTable) -> Result<Option<Extent>> {
    table_sheet::fits_its_header(table)?;
    Ok(match &input.sheet {
        Some(sheet) => {
            table_sheet::fitting(table, sheet)?;
            Some(Extent::of(sheet)?)
        }
        None => table.sheet.as_ref().and_then(Extent::named),
    })
}

/// Those of the sheet; those that the table names where nothing else is known.
fn electrodes(input: &Input, table: &MeasurementTable) -> usize {
    let of = |sheet: &Sheet| sheet.electrodes.len();
    input.sheet.as_ref().map_or(table.electrodes, of)
}

/// Sees before the first press whether the calibration can be stored, where that is known by then.
fn try_store(arguments: &Arguments) -> Result<()> {
    let guided = &arguments.guided;
    // A recording may be of a simulated board, which is stored in a folder that is named only.
    let simulated = arguments.store.is_none() && (guided.simulate || guided.scene.is_some() || guided.from.is_some());
    let stores = arguments.store.is_some() || guided.is_asked();
    let folder = stores.then(|| baselines::state(arguments.state_dir.as_deref(), simulated));
    folder.flatten().map_or(Ok(()), |folder| {
        store::try_folder(&folder).with_context(|| {
            format!(
                "{}: the calibration cannot be stored there; name another folder with --state-dir",
                folder.display()
            )
        })
    })
}

/// Where it is stored for its board; none where it is of no board.
fn stored(arguments: &Arguments, input: &Input) -> Result<Option<PathBuf>> {
    let hello = input.gathered.as_ref().map(|gathered| &gathered.hello);
    let serial = match (&arguments.store, hello) {
        (Some(serial), _) => serial.clone(),
        (None, Some(hello)) => hello.serial.to_string(),
        (None, None) => return Ok(None),
    };
    let simulated = arguments.store.is_none() && hello.is_some_and(|hello| hello.board == BOARD_NAME);
    let Some(folder) = baselines::state(arguments.state_dir.as_deref(), simulated) else {
        if !simulated {
            eprintln!("it is not stored: neither XDG_STATE_HOME nor HOME is set; name a folder with --state-dir");
        }
        return Ok(None);
    };
    let place = store::place(&folder, &serial);
    place
        .map(Some)
        .with_context(|| format!("{}: cannot be made", folder.display()))
}

/// Newtons over the sheet, of the presses whose force is known.
fn gain(learned: &Learned, presses: &[Press], known: &[truth::KnownPress]) -> Option<Gain> {
    let mut before_mm = None;
    let mut list = Vec::new();
    for (press, known) in presses.iter().zip(known) {
        let presence = learned.locate(&press.change, before_mm);
        before_mm = Some(press.place_mm);
        if let (Some(force_n), Some(located)) = (known.force_n, presence.presses.first()) {
            list.push((press.place_mm, located.strength, force_n));
        }
    }
    Gain::learn(&list)
}

/// From which line on a list tells the places of other presses, in words; with what is left as listed, and as read.
fn shift_words(list: &str, known: &[truth::KnownPress], shift: &Shift, [own, read]: [String; 2]) -> String {
    let (line, frame) = (known[shift.from].line, &known[shift.from].frame);
    let (where_is, cause) = if shift.by > 0 {
        (
            "after",
            "is a line too many there, or a press that was not taken? Take it out",
        )
    } else {
        (
            "before",
            "is a line missing there, or a press that was made twice? Put it in, or take the press out",
        )
    };
    format!(
        "{list}:{line}: from about here on, frame {frame}, presses fit the place of the line {where_is} theirs: {read} then, and {own} as \
         listed; {cause}, so that each line has the place of its press"
    )
}

/// Where the presses that were learned from tell little of the sheet. Of one that is not known: of the disc that they tell.
fn unreached(
    input: &Input,
    extent: Option<&Extent>,
    setting: &Setting<'_>,
    known: &[truth::KnownPress],
    found: &Findings,
) -> Result<Gaps> {
    let of_sheet = extent.and_then(Extent::of_sheet);
    if input.sheet.is_none() && extent.is_some_and(|extent| !extent.is_disc()) {
        // A header does not tell where such a sheet is.
        return Ok(Gaps::default());
    }
    let marks = match (&input.sheet, of_sheet) {
        (Some(sheet), Some(of_sheet)) => Marks::new(sheet, FROM_THE_RIM * of_sheet.reach_mm)?,
        (_, of_sheet) => {
            let (middle_mm, reach_mm) = match of_sheet {
                Some(of_sheet) => (of_sheet.middle_mm, of_sheet.reach_mm),
                None => (found.centre_mm, found.radius_mm),
            };
            Marks::on_disc(
                middle_mm,
                (1.0 - FROM_THE_RIM) * reach_mm,
                (setting.electrodes, setting.turn),
            )
        }
    };
    let marks = if found.shared { marks } else { marks.alone() };
    let learned = (0..known.len()).filter(|k| !found.gross.contains(k));
    let places: Vec<[f64; 2]> = learned.map(|k| known[k].place_mm).collect();
    Ok(marks.unreached(&places))
}

/// That in words; none where the presses reach all of the sheet.
fn unreached_words(unreached: &Gaps) -> Option<String> {
    let marks: Vec<String> = (unreached.also_mm.iter().take(MOST_MARKS))
        .map(|[x, y]| format!("{x:.0},{y:.0}"))
        .collect();
    let more = unreached.also_mm.len() - marks.len();
    let more = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    (!marks.is_empty()).then(|| {
        format!(
            "on {} % of the sheet the presses tell less than half of what touches change, and these are located worse there; press also near {} mm{more}",
            percent(unreached.part).max(1),
            marks.join(" and ")
        )
    })
}

/// Where the sheet's model puts the presses, or why it was not tried.
fn by_model(
    arguments: &Arguments,
    input: &Input,
    table: &MeasurementTable,
    known: &[truth::KnownPress],
) -> Result<model::ByModel> {
    if arguments.difference {
        bail!("changes alone do not tell what they are a part of");
    }
    let sheet = (input.sheet.as_ref(), arguments.sheet.as_deref());
    model::located(table, &input.truth, known, sheet)
}

fn sheet_of(path: &Path) -> Result<Sheet> {
    Ok(crate::sheet::load(Some(path))?.0)
}

fn line<'a>(found: &Findings, known: &'a [truth::KnownPress], table: &MeasurementTable, presses: &[Press]) -> Line<'a> {
    let rows = |list: &[usize]| -> Vec<[usize; 4]> {
        let of = |k: &usize| {
            let m = table.measurements[*k];
            [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus].map(|e| e + 1)
        };
        list.iter().map(of).collect()
    };
    let frames = |list: &[usize]| list.iter().map(|k| known[*k].frame.as_str()).collect();
    Line {
        presses: presses.len(),
        gross: frames(&found.gross),
        missed: frames(&found.missed),
        measurements: table.measurements.len(),
        dead: rows(&found.dead),
        unexplained: rows(&found.unexplained),
        stale: rows(&found.stale),
        symmetric: found.shared,
        clockwise: found.shared.then_some(found.clockwise),
        centre_mm: found.centre_mm,
        radius_mm: found.radius_mm,
        grain: found.grain,
        memory: found.memory,
        displaced: found.displaced,
        corrected: found.corrected,
        explained: found.explained,
        error_median_mm: found.error_mm[0],
        error_95th_percentile_mm: found.error_mm[1],
        uncertainty_factor: found.tempering.sqrt(),
        more_presses: MorePresses::of(found),
        expected_mm: found.expected_mm(MORE),
        force: None,
        forces_known: 0,
        model: None,
        model_not_tried: None,
        unreached: None,
        shifted: None,
    }
}

fn percent(part: f64) -> i64 {
    (100.0 * part).round() as i64
}

/// Rows by their drive pairs: a whole drive in one word.
fn by_drive(rows: &[[usize; 4]]) -> String {
    let mut parts: Vec<String> = Vec::new();
    for chunk in rows.chunk_by(|a, b| a[..2] == b[..2]) {
        let senses: Vec<String> = chunk.iter().map(|r| format!("{}-{}", r[2], r[3])).collect();
        parts.push(format!(
            "drive {}-{}: sense {}",
            chunk[0][0],
            chunk[0][1],
            senses.join(", ")
        ));
    }
    parts.join("; ")
}

fn words(line: &Line<'_>) -> String {
    let mut text = format!("presses         {}", line.presses);
    if !line.gross.is_empty() {
        text += &format!(
            ", without {} that nothing explains: {}",
            line.gross.len(),
            line.gross.join(", ")
        );
    }
    if !line.missed.is_empty() {
        text += &format!(
            "\n                {} not found by what the others taught: {}",
            line.missed.len(),
            line.missed.join(", ")
        );
    }
    text += "\nelectrodes      ";
    text += &match line.clockwise {
        Some(clockwise) => format!(
            "numbered {}clockwise around {:.1}, {:.1} mm; turned measurements respond alike",
            if clockwise { "" } else { "counter-" },
            line.centre_mm[0],
            line.centre_mm[1]
        ),
        None => "turned measurements do not respond alike; every one has a map of its own".to_owned(),
    };
    text += &format!("\nmeasurements    {}", line.measurements);
    for (rows, what) in [
        (&line.dead, "without a value or a change, left out"),
        (&line.unexplained, "that presses hardly explain"),
        (&line.stale, "that hold what the press before did, as of an older frame"),
    ] {
        if !rows.is_empty() {
            text += &format!("\n                {} {what}: {}", rows.len(), by_drive(rows));
        }
    }
    text += &format!(
        "\nradius          {:.0} mm, of the sheet that the presses tell",
        line.radius_mm
    );
    text += "\ngrain           ";
    text += &match &line.grain {
        Some(Grain { ratio, along_deg }) => {
            format!(
                "like a sheet that conducts {ratio:.1} times as well along {along_deg:.0} degrees from the x axis as across"
            )
        }
        None => "none: like a sheet that conducts alike in all directions".to_owned(),
    };
    text += "\nmemory          ";
    text += &match (percent(line.memory), percent(line.displaced)) {
        (0, 0) => "the press before does not show".to_owned(),
        (0, part) => {
            format!("in the middle a press is felt displaced by {part} % of the place before, which is taken out")
        }
        (part, _) => format!("{part} % of what the press before did shows, and is taken out"),
    };
    if line.corrected {
        text += "\ncorrection      a regression on the changes takes out what the maps leave";
    }
    text += &format!(
        "\nexplained       {:.0} % of the change, each press by what the others taught",
        100.0 * line.explained
    );
    text += &format!(
        "\nerror           {:.1} mm median, {:.1} mm 95th percentile, likewise",
        line.error_median_mm, line.error_95th_percentile_mm
    );
    text += &format!(
        "\nuncertainty     {:.1} times that of independent noise",
        line.uncertainty_factor
    );
    text += &match line.expected_mm {
        Some(mm) => format!("\nmore presses    {MORE} more: about {mm:.1} mm median expected"),
        None if line.more_presses == MorePresses::TooFewToTell => {
            format!("\nmore presses    advised; fewer than {FEWEST_FOR_MORE} do not tell by how much they would help")
        }
        None => "\nmore presses    nothing says that they would help".to_owned(),
    };
    text += &match &line.force {
        Some(force) => format!(
            "\nforce           {:.1} N is the usual press, {:.2} times from place to place; one press ± {:.0} %",
            force.usual_n,
            force.range,
            100.0 * force.relative_sd
        ),
        None => format!(
            "\nforce           not calibrated: {} presses have a force (force_n); five that are found are needed",
            line.forces_known
        ),
    };
    if let Some(model) = &line.model {
        text += &format!(
            "\nsheet's model   {:.2} mm median, {:.2} mm 95th percentile, {}: {}",
            model.error_median_mm,
            model.error_95th_percentile_mm,
            match model.moved_mm {
                Some(_) => "each press by what the others tell of the sheet",
                None => "with nothing learned",
            },
            if model.better { "better, and used" } else { "not used" }
        );
        if let (Some(median), Some(high), Some(moved)) =
            (model.untold_median_mm, model.untold_95th_percentile_mm, model.moved_mm)
        {
            text += &format!(
                "\n                {median:.2} and {high:.2} mm with nothing told; the presses move touches by {moved:.2} mm"
            );
        }
    }
    if let Some(why) = &line.model_not_tried {
        text += &format!("\nsheet's model   not tried: {why}");
    }
    text + "\n"
}
