//! `skin record`: everything that a board sends and what is made of it, into a file, without a page.

use crate::number;
use crate::run::live;
use crate::run_arguments::{ShowArguments, SourceArguments};
use crate::run_session::Outputs;
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;

/// Arguments of `skin record`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The file, a new one [default: a name from date, time (UTC) and the board's serial number, in this folder].
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
    /// End after so long, s of the board's time after the baseline [default: at Ctrl-C].
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = number::positive("a time in seconds above 0"))]
    seconds: Option<f64>,
    #[command(flatten)]
    source: SourceArguments,
}

/// Runs the command.
///
/// # Errors
/// As `skin run`.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let outputs = Outputs {
        show: &ShowArguments::default(),
        page: false,
        record: Some(arguments.file.as_deref()),
        seconds: arguments.seconds,
    };
    live(&arguments.source, &outputs)
}
