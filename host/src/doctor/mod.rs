//! `skin doctor`: what is wrong with a board, its wires or this computer, and what to do. docs/doctor.md says what each line means.

mod arguments;
mod board;
mod computer;
mod electrodes;
mod facts;
mod line;
#[cfg(test)]
mod tests;
mod values;
mod wire;

pub(crate) use arguments::Examined;
pub(crate) use facts::{Facts, Origin, Witness};

use crate::files::baseline_file::unix_s;
use crate::json;
use crate::recorded::{BoardRecord, PROGRAM};
use crate::say::{is_coloured, say};
use crate::usage::Unfit;
use anyhow::Result;
use clap::Args;
use line::{Light, Line};
use serde::Serialize;
use std::io::Write;
use std::path::Path;
use std::time::SystemTime;

/// Arguments of `skin doctor`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    examined: Examined,
    /// One JSON object on stdout (docs/doctor.schema.json).
    #[arg(long)]
    json: bool,
}

/// Version of the JSON, which grows when a reader of the version before would misunderstand it.
const SCHEMA: u32 = 1;

/// What is looked at, in the order of the lines.
#[cfg(test)]
const NAMES: [&str; 19] = [
    "port",
    "board",
    "firmware",
    "uptime",
    "self_test",
    "source",
    "frames",
    "line",
    "rate",
    "latency_timer",
    "sheet",
    "wiring",
    "contact",
    "reciprocity",
    "noise",
    "saturation",
    "baseline",
    "processor",
    "disk",
];

/// What an examination found.
#[derive(Debug, Serialize)]
pub(crate) struct Examination {
    kind: &'static str,
    schema: u32,
    program: &'static str,
    source: String,
    unix_s: f64,
    board: Option<BoardRecord>,
    /// Whether no line is bad.
    fit: bool,
    lines: Vec<Line>,
}

impl Examination {
    /// Judges by facts; baselines are stored in this folder, or in the usual one.
    pub(crate) fn of(facts: &Facts, state: Option<&Path>) -> Self {
        let mut lines = board::lines(facts);
        lines.extend(wire::lines(facts));
        let electrodes = electrodes::lines(facts);
        let named: Vec<usize> = electrodes.iter().flat_map(|l| l.electrodes.iter().copied()).collect();
        lines.extend(electrodes);
        lines.extend(values::lines(facts, &named));
        lines.extend(computer::lines(facts, state));
        Self {
            kind: "doctor",
            schema: SCHEMA,
            program: PROGRAM,
            source: facts.source.clone(),
            unix_s: unix_s(SystemTime::now()),
            board: facts.hello.as_ref().ok().map(BoardRecord::from),
            fit: lines.iter().all(|l| l.light != Light::Bad),
            lines,
        }
    }

    /// The names of the lines with a light.
    fn named(&self, light: Light) -> Vec<&'static str> {
        self.lines.iter().filter(|l| l.light == light).map(|l| l.name).collect()
    }

    /// For people.
    pub(crate) fn words(&self, coloured: bool) -> String {
        let mut words: String = self.lines.iter().map(|l| l.words(coloured)).collect();
        let list = |light| self.named(light).join(", ").replace('_', " ");
        words += &match (self.fit, list(Light::Look).as_str()) {
            (false, _) => format!("unfit: {}\n", list(Light::Bad)),
            (true, "") => "fit\n".to_owned(),
            (true, look) => format!("fit; look at: {look}\n"),
        };
        words
    }
}

/// Measures what the command line names, before a witness.
///
/// # Errors
/// A file that cannot be read, several boards. A board that is not there is no error, but what is found.
pub(crate) fn measure(examined: &Examined, witness: Option<Witness<'_>>) -> Result<Facts> {
    match &examined.from {
        Some(path) => say!("the first {:.1} s of {}", examined.seconds, path.display()),
        None if examined.simulate => say!("measuring a simulated board for {:.1} s", examined.seconds),
        None => say!("measuring for {:.1} s, do not touch the sheet", examined.seconds),
    }
    facts::of(examined, witness)
}

/// Runs the command.
///
/// # Errors
/// As of [`measure`]; the board is unfit.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let facts = measure(&arguments.examined, None)?;
    let examination = Examination::of(&facts, arguments.examined.state_dir.as_deref());
    let mut out = crate::say::stdout();
    if arguments.json {
        out.write_all(&json::line(&examination)?)?;
    } else {
        let coloured = is_coloured(&out);
        write!(out, "{}", examination.words(coloured))?;
    }
    if examination.fit {
        return Ok(());
    }
    Err(Unfit(examination.named(Light::Bad).join(", ").replace('_', " ")).into())
}
