//! `skin`: the tactile skin's command line. Data go to stdout, everything else to stderr.
#![forbid(unsafe_code)]

mod baselines;
mod bench;
mod board;
mod calibrate;
mod capture;
mod check;
mod drive;
mod export;
mod files;
mod flash;
mod forward;
mod hello;
mod info;
mod live_output;
mod method;
mod number;
mod paper;
mod plan;
mod progress;
mod reconstruct;
mod record;
mod recorded;
mod recorded_frames;
mod recording_file;
mod recover;
mod replay;
mod replayed;
mod rise;
mod run;
mod say;
mod scene;
mod settings;
mod sheet;
mod sim;
mod simulated_skin;
mod table_baseline;
mod table_pattern;
mod table_sheet;
mod usage;

use clap::{Parser, Subcommand};
use std::io::IsTerminal;
use std::process::ExitCode;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::prelude::*;

/// A tactile skin without a wire in it: pictures of pressure by electrical impedance tomography.
///
/// Without a command: shows the board that is plugged in, or the simulated skin when there is none, live in the browser.
///
/// Exit codes: 0 all went well, 1 an error (said on stderr), 2 wrong usage.
#[derive(Debug, Parser)]
#[command(name = "skin", version, args_conflicts_with_subcommands = true)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    run: run::Arguments,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Live pictures of the board, or of the simulated skin (what `skin` alone does).
    Run(run::Arguments),
    /// Records a board into a file: what it sends and what is made of it.
    Record(record::Arguments),
    /// Shows a recording as it was shown live.
    Replay(replay::Arguments),
    /// What is in a recording.
    Info(info::Arguments),
    /// Writes a recording for other programs: tables, numpy, MATLAB.
    Export(export::Arguments),
    /// Makes a well-closed file of a recording that was cut short.
    Recover(recover::Arguments),
    /// Touches and pictures from a table of measured frames.
    Reconstruct(reconstruct::Arguments),
    /// Whether the electrodes are wired in the order that is said, and all of them give a signal.
    Check(check::Arguments),
    /// What a touched sheet gives: the table of measurements, simulated.
    Forward(forward::Arguments),
    /// What the reconstruction costs and how good it is, measured on this machine with simulated frames.
    Bench(bench::Arguments),
    /// The source paper's experiments again, on the simulated skin: one report with every figure and number.
    Paper(paper::Arguments),
    /// The rubber's creep and the force of a touch, from a press-and-hold: for `run --calibration`.
    Calibrate(calibrate::Arguments),
    /// Programs a board over its serial cable.
    Flash(flash::Arguments),
    /// Who the board is, and its self-test.
    Hello(hello::Arguments),
    /// A simulated board with a scene on its sheet: its frames as a table, its bytes, or a serial port to read them from.
    Sim(sim::Arguments),
    /// What a board measures, watches and does at power-up: shows, sets, stores and forgets it.
    Settings(settings::Arguments),
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    // What the library has to say beside its results; RUST_LOG asks for more.
    let asked = std::env::var("RUST_LOG").ok().and_then(|levels| levels.parse().ok());
    let levels = asked.unwrap_or_else(|| Targets::new().with_default(LevelFilter::WARN));
    let log = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal());
    // Fails only where there is a subscriber already.
    let _ = tracing_subscriber::registry().with(log).with(levels).try_init();
    let outcome = match cli.command {
        Some(Command::Reconstruct(arguments)) => reconstruct::run(&arguments),
        Some(Command::Check(arguments)) => check::run(&arguments),
        Some(Command::Forward(arguments)) => forward::run(&arguments),
        Some(Command::Bench(arguments)) => bench::run(&arguments),
        Some(Command::Paper(arguments)) => paper::run(&arguments),
        Some(Command::Calibrate(arguments)) => calibrate::run(&arguments),
        Some(Command::Flash(arguments)) => flash::run(&arguments),
        Some(Command::Hello(arguments)) => hello::run(&arguments),
        Some(Command::Sim(arguments)) => sim::run(&arguments),
        Some(Command::Settings(arguments)) => settings::run(&arguments),
        Some(Command::Run(arguments)) => run::run(&arguments),
        Some(Command::Record(arguments)) => record::run(&arguments),
        Some(Command::Replay(arguments)) => replay::run(&arguments),
        Some(Command::Info(arguments)) => info::run(&arguments),
        Some(Command::Export(arguments)) => export::run(&arguments),
        Some(Command::Recover(arguments)) => recover::run(&arguments),
        None => run::run(&cli.run),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        // Whoever read our output has seen enough (`skin ... | head`).
        Err(error) if broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("skin: {error:#}");
            let usage = error.downcast_ref::<usage::Usage>().is_some();
            ExitCode::from(if usage { 2 } else { 1 })
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
