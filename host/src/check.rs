//! `skin check`: whether the electrodes are wired in the order that is said, and all of them give a signal.

use crate::drive::DriveKind;
use crate::ending;
use crate::files::order;
use crate::json;
use crate::played_board::PlayedBoard;
use crate::recorded::SessionRecord;
use crate::run_session::passed_s;
use crate::table_sheet::Geometry;
use crate::{board, number, sheet, simulated_skin, table_file, table_notices};
use ::forward::order::ValueOrder;
use ::forward::{DiscTouch, Drive, Pattern, Sheet};
use anyhow::{Context, Result, anyhow, bail};
use clap::{ArgGroup, Args};
use inverse::live::LiveOptions;
use inverse::reference::baseline::Baseline;
use inverse::reference::imager::Imager;
use inverse::reference::inspection::{Inspection, InspectionOptions, inspect};
use inverse::reference::screening::Finding;
use inverse::reference::wiring::{self, Wiring, WiringCheck, WiringOptions, order_text};
use inverse::solvers::Method;
use link::plans::adjacent_plan;
use link::{MeasuredFrame, Session, ports};
use recording::Speed;
use serde::Serialize;
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// What takes the place of a table. What is said of one is refused beside it: clap does not ask for the table where it may not be.
const NO_TABLE: [&str; 4] = ["port", "serial", "simulate", "from"];

/// Arguments of `skin check`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("source")))]
pub(crate) struct Arguments {
    /// Table of measurements, or with --order one frame a line, as for `skin reconstruct` [default: a board's frames].
    #[arg(group = "source", value_name = "TABLE")]
    file: Option<PathBuf>,
    /// Serial port of the board, or tcp://HOST:PORT of a bridge to it [default: the only board on USB].
    #[arg(long, group = "source", value_name = "PORT")]
    port: Option<String>,
    /// Serial number of the board or of its adapter, as `skin list` shows them.
    #[arg(long, group = "source", value_name = "SERIAL")]
    serial: Option<String>,
    /// The simulated skin.
    #[arg(long, group = "source")]
    simulate: bool,
    /// A recording that begins with nothing on the sheet; with --touch the finger is down from 4 s later on.
    #[arg(long, group = "source", value_name = "RECORDING")]
    from: Option<PathBuf>,
    /// Frames of the unpressed sheet in the table; several are averaged [default: the first].
    #[arg(long, value_delimiter = ',', value_name = "COLUMN,...", requires = "file", conflicts_with_all = NO_TABLE)]
    baseline: Vec<String>,
    /// The file has one frame a line, in the order of this program (docs/tables.md).
    #[arg(long, value_parser = order::parser(), value_name = "ORDER", requires = "file", conflicts_with_all = NO_TABLE)]
    order: Option<ValueOrder>,
    /// Variables of a .npz or .mat file that hold frames; a field of a struct is STRUCT.FIELD [default: all that fit the order].
    #[arg(long, value_delimiter = ',', value_name = "NAME[,NAME...]", requires = "order", conflicts_with_all = NO_TABLE, hide_short_help = true)]
    variable: Vec<String>,
    /// How the sheet of the table was driven.
    #[arg(long, value_enum, default_value_t = DriveKind::Voltage, requires = "file", conflicts_with_all = NO_TABLE, hide_short_help = true)]
    drive: DriveKind,
    #[command(flatten)]
    geometry: Geometry,
    /// Where a finger presses, mm: tells turns and mirrors of an even disc apart. A board's frames are taken when it says so.
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true, value_parser = place, conflicts_with = "simulate")]
    touch: Option<[f64; 2]>,
    /// The frame of the table in which the finger presses.
    #[arg(long, value_name = "COLUMN", requires = "touch", requires = "file", conflicts_with_all = NO_TABLE)]
    frame: Option<String>,
    /// Radius of that finger, mm [default: 12.5 mm on a 195 mm disc, in proportion].
    #[arg(long, value_name = "MM", value_parser = number::positive("a length in mm above 0"), requires = "touch", conflicts_with = "simulate", hide_short_help = true)]
    radius_mm: Option<f64>,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

fn place(text: &str) -> Result<[f64; 2], String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|v| v.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y] if x.is_finite() && y.is_finite() && text.split(',').count() == 2 => Ok([x, y]),
        _ => Err("give two numbers in mm, as in 30,-20".to_owned()),
    }
}

/// What is checked.
struct Measured {
    imager: Arc<Imager>,
    baseline: Baseline,
    /// A frame under the finger.
    touched: Option<Vec<f64>>,
    drive: Drive,
}

#[derive(Serialize)]
struct OrderLine {
    /// For every wire the electrode that it leads to, from 1.
    order: Vec<usize>,
    /// Mean deviation of the logarithms of the magnitudes from the model, each at most ln 2.
    misfit: f64,
    /// Correlation of these logarithms with the model's.
    correlation: f64,
}

#[derive(Serialize)]
struct TouchLine {
    order: Vec<usize>,
    /// Correlation of the frame's change with that of the touch, in this order and in the next best one.
    correlation: f64,
    next: f64,
}

#[derive(Serialize)]
struct Line {
    values: usize,
    electrodes: usize,
    /// Relative deviation from reciprocity, median; null where no value has its reciprocal.
    reciprocity: Option<f64>,
    /// The same of values that are measured both ways round.
    twins: Option<f64>,
    given: OrderLine,
    best: OrderLine,
    /// Whether another order than the given one fits clearly better.
    wrong: bool,
    /// Orders that fit as well as the best, the best first.
    equal: Vec<Vec<usize>>,
    /// What the touch tells, where there is one.
    touch: Option<TouchLine>,
    /// What is not as the model has it once the wires are in the best order.
    findings: Vec<Finding>,
    /// Whether the baseline is that of the sheet at all.
    conclusive: bool,
    /// Deviation from the model after the electrodes were found, and the one expected.
    misfit: f64,
    expected: f64,
}

/// A frame and a touch agree from this correlation on.
const LEAST_AGREEMENT: f64 = 0.7;
/// What the next best order does not explain of a touch, over what the best one does not (squares), from which the touch tells
/// them apart. The nearest mirror moves a touch by no more than a third of the distance of two electrodes.
const CLEAR: f64 = 3.0;

/// Runs the command.
///
/// # Errors
/// A table or a board that cannot be read, a sheet that makes no sense.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let measured = match &arguments.file {
        Some(_) => of_table(arguments)?,
        None => of_board(arguments)?,
    };
    let Measured {
        imager,
        baseline,
        touched,
        drive,
    } = measured;
    let values = &baseline.values_v;
    if !values.iter().any(|v| v.is_finite() && *v != 0.0) {
        bail!("the baseline holds no value; give frames of the unpressed sheet");
    }
    let mut check = wiring::check(&imager, values, false, &WiringOptions::default())?;
    let touch = match (arguments.touch, &touched) {
        (Some(at), Some(frame)) => tell(arguments, &imager, &mut check, values, frame, at)?,
        _ => None,
    };
    let reciprocity = wiring::reciprocity(&imager.pattern, drive, values);
    let twins = wiring::twins(&imager.pattern, values);
    let right = as_wired(&imager, &check.best)?;
    let inspection = inspect(&right, baseline, true, &InspectionOptions::default());
    let line = Line {
        values: imager.pattern.len(),
        electrodes: imager.pattern.electrodes(),
        reciprocity,
        twins,
        given: order_line(&check.given),
        best: order_line(&check.best),
        wrong: check.is_wrong(),
        equal: check.equal.iter().map(|order| from_one(order)).collect(),
        touch,
        findings: inspection.findings.clone(),
        conclusive: inspection.conclusive,
        misfit: inspection.misfit,
        expected: inspection.expected,
    };
    let mut out = crate::say::stdout();
    if arguments.json {
        out.write_all(&json::line(&line)?)?;
    } else {
        write!(out, "{}", words(arguments, &line, &check, &inspection))?;
    }
    Ok(())
}

/// The model with the wires as they are: what is still wrong then is not their order.
///
/// # Errors
/// The sheet's model has no solution, which a sheet that was modelled before has.
pub(crate) fn as_wired(imager: &Imager, wiring: &Wiring) -> Result<Arc<Imager>> {
    let pattern = wiring::rewire(&imager.pattern, &wiring.order)?;
    Ok(Arc::new(Imager::new(
        imager.model.sheet(),
        imager.drive,
        pattern,
        imager.grid.cell_mm(),
    )?))
}

fn from_one(order: &[usize]) -> Vec<usize> {
    order.iter().map(|l| l + 1).collect()
}

fn order_line(wiring: &Wiring) -> OrderLine {
    OrderLine {
        order: from_one(&wiring.order),
        misfit: wiring.misfit,
        correlation: wiring.correlation,
    }
}

/// Chooses the order that a touch at a known place fits best among those that fit the baseline. None, said on stderr, where none
/// does clearly.
fn tell(
    arguments: &Arguments,
    imager: &Imager,
    check: &mut WiringCheck,
    baseline: &[f64],
    frame: &[f64],
    at: [f64; 2],
) -> Result<Option<TouchLine>> {
    let touch = DiscTouch {
        centre_mm: at,
        radius_mm: arguments.radius_mm.unwrap_or_else(|| FINGER * imager.reach_mm()),
        rise: 0.2,
    };
    let agreement = wiring::by_touch(imager, &check.equal, baseline, frame, touch)?;
    let mut ranked: Vec<usize> = (0..agreement.len()).collect();
    ranked.sort_by(|a, b| agreement[*b].total_cmp(&agreement[*a]));
    let Some(first) = ranked.first().copied() else {
        return Ok(None);
    };
    let next = ranked.get(1).map_or(-1.0, |k| agreement[*k]);
    if agreement[first] < LEAST_AGREEMENT {
        eprintln!(
            "warning: in no order does the frame agree with a touch at ({}, {}) mm (correlation {:.2}); look at the place and \
             press harder",
            at[0], at[1], agreement[first]
        );
        return Ok(None);
    }
    let unexplained = |correlation: f64| 1.0 - correlation.max(0.0).powi(2);
    if unexplained(next) < CLEAR * unexplained(agreement[first]) {
        eprintln!(
            "warning: the touch at ({}, {}) mm fits more than one order; press far from the middle, and beside the lines from there to the electrodes and between them",
            at[0], at[1]
        );
        return Ok(None);
    }
    let order = check.equal[first].clone();
    check.best.order.clone_from(&order);
    check.equal = vec![order.clone()];
    Ok(Some(TouchLine {
        order: from_one(&order),
        correlation: agreement[first],
        next,
    }))
}

/// Radius of a finger over the sheet's reach: 12.5 mm on the paper's disc.
const FINGER: f64 = 12.5 / 97.5;

fn words(arguments: &Arguments, line: &Line, check: &WiringCheck, inspection: &Inspection) -> String {
    let percent = |part: Option<f64>| part.map_or("not measured".to_owned(), |p| format!("{:.2} %", 100.0 * p));
    let fit = |order: &OrderLine| {
        format!(
            "off the model by {:.1} %, correlation of the logarithms {:.3}",
            100.0 * order.misfit,
            order.correlation
        )
    };
    let mut text = format!(
        "{} values of {} electrodes\nreciprocity    off by {} (median)\n",
        line.values,
        line.electrodes,
        percent(line.reciprocity)
    );
    if line.twins.is_some() {
        text += &format!("both ways      off by {} (median)\n", percent(line.twins));
    }
    text += &format!("given order    {}\n", fit(&line.given));
    if line.wrong {
        if line.best.misfit < line.given.misfit {
            text += &format!("better order   {}\n", fit(&line.best));
        }
        text += &format!("wired          --wires {}\n", order_text(&check.best.order));
    } else if line.conclusive {
        text += "wired          as said, as far as the baseline tells\n";
    } else {
        text += "wired          not known: the baseline is not that of the sheet as described\n";
    }
    match &line.touch {
        Some(touch) => {
            text += &format!(
                "touch          agrees with this order by a correlation of {:.2}, with the next one by {:.2}\n",
                touch.correlation, touch.next
            );
        }
        None if line.equal.len() > 1 && line.conclusive => {
            let how = if arguments.file.is_some() {
                " --frame COLUMN"
            } else {
                ""
            };
            text += &format!(
                "turns, mirrors {} orders fit as well; only a touch at a known place tells them apart: --touch X,Y{how}\n",
                line.equal.len()
            );
        }
        None => {}
    }
    if inspection.warnings().is_empty() {
        text += "electrodes     all give a signal\n";
    }
    for warning in inspection.warnings() {
        text += &format!("found          {warning}\n");
    }
    for note in inspection.notes() {
        text += &format!("left out       {note}\n");
    }
    text
}

fn of_table(arguments: &Arguments) -> Result<Measured> {
    let path = arguments.file.as_deref().unwrap_or_else(|| std::path::Path::new(""));
    let table = table_file::read(path, arguments.order, &arguments.variable)?;
    table_notices::of_drive(&table, arguments.drive);
    table_notices::of_rounding(&table);
    let drive = arguments.drive.drive();
    let chosen = arguments.geometry.choose(&table, Method::Nnls)?;
    let names = table.names();
    let mut columns = Vec::new();
    for name in &arguments.baseline {
        columns.extend(names.range(name.trim())?);
    }
    if columns.is_empty() {
        eprintln!(
            "the baseline is the first frame, {}; --baseline names others",
            table.columns[0].name
        );
        columns.push(0);
    }
    let frames: Vec<&[f64]> = columns.iter().map(|k| table.columns[*k].values.as_slice()).collect();
    let touched = match (&arguments.frame, arguments.touch) {
        (Some(name), _) => {
            let place = names.get(name.trim()).ok_or_else(|| names.unknown(name))?;
            Some(table.columns[place].values.clone())
        }
        (None, Some(_)) => bail!("--touch needs the frame in which it is: name its column with --frame"),
        (None, None) => None,
    };
    Ok(Measured {
        baseline: Baseline::of_frames(chosen.pattern.len(), &frames),
        imager: Arc::new(Imager::new(&chosen.sheet, drive, chosen.pattern, chosen.cell_mm)?),
        touched,
        drive,
    })
}

/// Where frames come from.
enum Source {
    Board(Session),
    Recording(PlayedBoard),
}

/// A board that measures until the end.
fn started(port: Box<dyn link::Port>) -> Result<Session> {
    let session = Session::start(port, adjacent_plan)?;
    ending::stops(session.link())?;
    Ok(session)
}

impl Source {
    fn of(arguments: &Arguments) -> Result<Self> {
        if let Some(path) = &arguments.from {
            return Ok(Self::Recording(PlayedBoard::open(path, Speed::Unpaced)?));
        }
        if arguments.simulate {
            let (sheet, _) = sheet::load(arguments.geometry.file())?;
            return Ok(Self::Board(Session::start(
                simulated_skin::demo(sheet)?,
                adjacent_plan,
            )?));
        }
        if let Some(path) = &arguments.port {
            let port = ports::open(path).map_err(|e| anyhow!(e))?;
            return Ok(Self::Board(started(port)?));
        }
        match board::only(arguments.serial.as_deref(), |place| {
            let port = place.open().map_err(|e| anyhow!(e))?;
            started(port).with_context(|| place.path().to_owned())
        })? {
            Ok(session) => Ok(Self::Board(session)),
            Err(why) => bail!(
                "no board found ({why}); name its port with --port, a table of frames, a recording with --from, or ask the simulated \
                 skin with --simulate"
            ),
        }
    }

    fn session(&self) -> &Session {
        match self {
            Self::Board(session) => session,
            Self::Recording(board) => &board.session,
        }
    }

    fn frame(&self) -> Result<MeasuredFrame> {
        match self {
            Self::Recording(board) => board
                .frame()?
                .context("the recording is too short; the check takes frames of a quarter of a second, and 4 s later again with --touch"),
            Self::Board(session) => loop {
                match session.frame(LOOK)? {
                    Some(frame) => return Ok(frame),
                    None => session.check_silence(SILENCE)?,
                }
            },
        }
    }

    /// Frames of the sheet as it is, and when the last of them was measured, s.
    fn take(&self) -> Result<(Vec<Vec<f64>>, f64)> {
        let mut frames = Vec::new();
        let mut last_s = 0.0;
        while frames.len() < LiveOptions::default().baseline_frames {
            let frame = self.frame()?;
            last_s = frame.time_s;
            frames.push(frame.values_v);
        }
        Ok((frames, last_s))
    }
}

fn of_board(arguments: &Arguments) -> Result<Measured> {
    let source = Source::of(arguments)?;
    let session = source.session();
    let sheet: Sheet = match (&arguments.from, arguments.geometry.file()) {
        (Some(recording), None) => SessionRecord::read(recording)?.sheet()?,
        (_, file) => sheet::load(file)?.0,
    };
    let (wired, described) = (session.electrodes(), sheet.electrodes.len());
    if wired != described {
        bail!("the board has {wired} electrodes, the sheet {described}; describe the sheet with --sheet");
    }
    let pattern = Pattern::from_pairs(session.electrodes(), session.measurements())?;
    let drive = Drive::PAPER;
    let live = arguments.from.is_none();
    if live {
        eprintln!("taking the baseline, do not touch");
    }
    let (unpressed, taken_s) = source.take()?;
    let touched = match arguments.touch {
        Some([x, y]) => {
            if live {
                eprintln!("press at ({x}, {y}) mm and hold for {:.0} s", 2.0 * PRESS_S);
            }
            let (mut last_s, mut waited_s) = (taken_s, 0.0);
            while waited_s < PRESS_S {
                let time_s = source.frame()?.time_s;
                waited_s += passed_s(last_s, time_s, session.frame_s());
                last_s = time_s;
            }
            Some(mean(pattern.len(), &source.take()?.0).values_v)
        }
        None => None,
    };
    Ok(Measured {
        baseline: mean(pattern.len(), &unpressed),
        imager: Arc::new(Imager::new(&sheet, drive, pattern, Method::Nnls.cell_mm_on(&sheet)?)?),
        touched,
        drive,
    })
}

/// How long somebody has to come down with a finger, s of the board's time.
const PRESS_S: f64 = 4.0;
/// How often the loop looks up while no frame comes.
const LOOK: Duration = Duration::from_millis(100);
/// A board that says nothing for so long is gone.
const SILENCE: Duration = Duration::from_secs(3);

fn mean(values: usize, frames: &[Vec<f64>]) -> Baseline {
    let frames: Vec<&[f64]> = frames.iter().map(Vec::as_slice).collect();
    Baseline::of_frames(values, &frames)
}
