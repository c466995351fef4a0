//! `skin`: the tactile skin's command line. Data go to stdout, everything else to stderr.
//!
//! [`run`] is the program, for `main.rs` and for the Python package, which has it inside. [`stream`], [`loaded`]
//! and [`taught`] are what that package needs beside it of boards, recordings and calibrations from presses.
#![forbid(unsafe_code)]

/// The standard library's panics where the reader has gone, as after `skin ... 2>&1 | head -1`.
macro_rules! println {
    ($($text:tt)*) => { $crate::say::out(format_args!($($text)*)) };
}
/// As [`println!`].
macro_rules! eprint {
    ($($text:tt)*) => { $crate::say::err(format_args!($($text)*)) };
}
/// As [`println!`].
macro_rules! eprintln {
    () => { $crate::say::err(format_args!("\n")) };
    ($($text:tt)*) => { $crate::say::err(format_args!("{}\n", format_args!($($text)*))) };
}

mod baselines;
mod bench;
mod board;
mod calibrate;
mod capture;
mod check;
mod commands;
mod completions;
mod config;
mod dataset;
mod doctor;
mod drive;
mod ending;
mod event;
mod export;
mod files;
mod flash;
mod forward;
mod hello;
mod help;
mod info;
mod json;
mod json_lines;
mod latency;
mod list;
mod live_output;
mod live_run;
pub mod loaded;
mod method;
#[cfg(test)]
mod mutated;
mod number;
mod page;
mod paper;
mod phantom;
mod plan;
mod played_board;
mod presses;
mod progress;
mod rails;
mod reading;
mod reconstruct;
mod record;
mod recordable;
mod recorded;
mod recorded_board;
mod recorded_frames;
mod recording_file;
mod recover;
mod replay;
mod replay_control;
mod replay_index;
mod replayed;
mod report;
mod rise;
mod ros2;
mod run;
mod run_arguments;
mod run_recording;
mod run_session;
mod say;
mod scene;
mod script;
mod settings;
mod sheet;
mod sim;
mod simulated_skin;
mod skin_file;
mod skins;
mod source;
pub mod stream;
mod table_baseline;
mod table_batch;
mod table_file;
mod table_notices;
mod table_pattern;
mod table_sheet;
pub mod taught;
mod thread_load;
mod usage;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::prelude::*;

/// A tactile skin without a wire in it, by electrical impedance tomography.
#[derive(Debug, Parser)]
#[command(name = "skin", version, args_conflicts_with_subcommands = true, help_template = HELP)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    run: run::Arguments,
    /// Says nothing of how far a work is that takes more than two seconds, in a log ten.
    #[arg(long, global = true, hide_short_help = true)]
    no_progress: bool,
}

/// The help of the program itself: one screen. The options of `skin` alone are those of `skin run`.
const HELP: &str = "\
{about}

    skin                      live picture of the board or of the simulated skin
    skin record touches.mcap  keeps what the board sends, for skin replay
    skin reconstruct frames.csv --baseline 1,2,3

Usage: skin [COMMAND] [OPTIONS]

{subcommands}

skin COMMAND --help is one screen with examples, skin help COMMAND lists every
option; skin help run those of skin alone.
What is the same on every call goes into a file: docs/configuration.md.
Exit codes: 0 all went well, 1 an error (said on stderr), 2 wrong usage,
3 unfit (skin doctor).
";

#[derive(Debug, Subcommand)]
enum Command {
    /// Live pictures of the board, or of the simulated skin; skin alone.
    Run(run::Arguments),
    /// Records a board into a file: what it sends and what is made of it.
    Record(record::Arguments),
    /// Shows a recording as it was shown live.
    Replay(replay::Arguments),
    /// What is in a recording.
    Info(info::Arguments),
    /// Writes a recording for other programs: tables, numpy, MATLAB.
    Export(export::Arguments),
    /// Makes a whole file of a recording that was cut short or damaged.
    Recover(recover::Arguments),
    /// Touches and pictures from a table of measured frames.
    Reconstruct(reconstruct::Arguments),
    /// Whether the electrodes are wired in order, and give a signal.
    Check(check::Arguments),
    /// What a touched sheet gives: the table of measurements, simulated.
    Forward(forward::Arguments),
    /// Labelled simulated frames to learn from, in shards.
    Dataset(dataset::Arguments),
    /// What the reconstruction costs and how good it is, measured here.
    Bench(bench::Arguments),
    /// The source paper's experiments again, simulated, as one report.
    Paper(paper::Arguments),
    /// The rubber's creep and force from a press; a real skin's maps.
    ///
    /// What `run --calibration` takes. `calibrate presses` makes maps of a real skin from presses at known places.
    Calibrate(calibrate::Arguments),
    /// Programs a board over its serial cable.
    Flash(flash::Arguments),
    /// The boards on this computer: ports, serial numbers, names.
    List(list::Arguments),
    /// Who the board is, and its self-test.
    Hello(hello::Arguments),
    /// A simulated board: its frames as a table, bytes, a serial port.
    ///
    /// A scene on its sheet says what touches it.
    Sim(sim::Arguments),
    /// What is wrong with board, wires and computer, and what to do.
    Doctor(doctor::Arguments),
    /// One file with what whoever is to find a fault needs to know.
    Report(report::Arguments),
    /// What a board measures, watches and does at power-up.
    ///
    /// Shows, sets, stores and forgets it.
    Settings(settings::Arguments),
    /// A script that completes commands and options in a shell.
    Completions(completions::Arguments),
}

impl Command {
    /// Its name, where it is a work with an end; none where it shows what happens, waits for somebody, or serves.
    fn work(&self) -> Option<&'static str> {
        match self {
            Self::Run(_) | Self::Record(_) | Self::Replay(_) | Self::Flash(_) | Self::Sim(_) | Self::Completions(_) => {
                None
            }
            Self::Calibrate(arguments) => arguments.is_alone().then_some("calibrate"),
            Self::Info(_) => Some("info"),
            Self::Export(_) => Some("export"),
            Self::Recover(_) => Some("recover"),
            Self::Reconstruct(_) => Some("reconstruct"),
            Self::Check(_) => Some("check"),
            Self::Forward(_) => Some("forward"),
            Self::Dataset(_) => Some("dataset"),
            Self::Bench(_) => Some("bench"),
            Self::Paper(_) => Some("paper"),
            Self::List(_) => Some("list"),
            Self::Hello(_) => Some("hello"),
            Self::Doctor(_) => Some("doctor"),
            Self::Report(_) => Some("report"),
            Self::Settings(_) => Some("settings"),
        }
    }
}

/// Runs the program with a command line, its own name first. The exit code is 0 when all went well, 1 after an error (said on
/// stderr), 2 after wrong usage, 3 where `skin doctor` found something unfit. Help and wrong options end the process.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let matches = help::with_examples(Cli::command()).get_matches_from(arguments);
    let cli = match Cli::from_arg_matches(&matches) {
        Ok(cli) => cli,
        Err(wrong) => wrong.exit(),
    };
    // What the library has to say beside its results; RUST_LOG asks for more.
    let asked = std::env::var("RUST_LOG").ok().and_then(|levels| levels.parse().ok());
    let usual = Targets::new().with_default(LevelFilter::WARN);
    // It warns of every node that comes and goes.
    let usual = usual.with_target("rustdds", LevelFilter::ERROR);
    let levels = asked.unwrap_or(usual);
    let log = tracing_subscriber::fmt::layer()
        .with_writer(|| {
            progress::clear();
            std::io::stderr()
        })
        // A log that cannot be written is no reason to end.
        .log_internal_errors(false)
        .with_ansi(say::is_coloured(&std::io::stderr()));
    // Fails only where there is a subscriber already.
    let _ = tracing_subscriber::registry().with(log).with(levels).try_init();
    if cli.no_progress || std::env::var_os("SKIN_NO_PROGRESS").is_some_and(|v| !v.is_empty()) {
        progress::silence();
    }
    let name = cli.command.as_ref().and_then(Command::work);
    let outcome = progress::telling(name, || match cli.command {
        Some(Command::Reconstruct(arguments)) => reconstruct::run(&arguments),
        Some(Command::Check(arguments)) => check::run(&arguments),
        Some(Command::Forward(arguments)) => forward::run(&arguments),
        Some(Command::Dataset(arguments)) => dataset::run(&arguments),
        Some(Command::Bench(arguments)) => bench::run(&arguments),
        Some(Command::Paper(arguments)) => paper::run(&arguments),
        Some(Command::Calibrate(arguments)) => calibrate::run(&arguments),
        Some(Command::Flash(arguments)) => flash::run(&arguments),
        Some(Command::List(arguments)) => list::run(&arguments),
        Some(Command::Hello(arguments)) => hello::run(&arguments),
        Some(Command::Doctor(arguments)) => doctor::run(&arguments),
        Some(Command::Report(arguments)) => report::run(&arguments),
        Some(Command::Sim(arguments)) => sim::run(&arguments),
        Some(Command::Settings(arguments)) => settings::run(&arguments),
        Some(Command::Run(arguments)) => run::run(&arguments),
        Some(Command::Record(arguments)) => record::run(&arguments),
        Some(Command::Replay(arguments)) => replay::run(&arguments),
        Some(Command::Info(arguments)) => info::run(&arguments),
        Some(Command::Export(arguments)) => export::run(&arguments),
        Some(Command::Recover(arguments)) => recover::run(&arguments),
        Some(Command::Completions(arguments)) => completions::run(&arguments, Cli::command()),
        None => run::run(&cli.run),
    });
    match outcome {
        Ok(()) => 0,
        // Whoever read our output has seen enough (`skin ... | head`).
        Err(error) if broken_pipe(&error) => 0,
        Err(error) => {
            eprintln!("skin: {}", say::harmless(&format!("{error:#}")));
            match () {
                () if error.is::<usage::Usage>() => 2,
                () if error.is::<usage::Unfit>() => 3,
                () => 1,
            }
        }
    }
}

fn broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        let io = cause.downcast_ref::<std::io::Error>().map(std::io::Error::kind);
        let json = cause
            .downcast_ref::<serde_json::Error>()
            .and_then(serde_json::Error::io_error_kind);
        io.or(json) == Some(std::io::ErrorKind::BrokenPipe)
    })
}
