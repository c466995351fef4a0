//! `skin run`, and `skin` alone: live pictures of the board, or of the simulated skin when there is no board; or of several skins.

use crate::recording_file::RecordTo;
use crate::run_arguments::{ShowArguments, SourceArguments, Start};
use crate::run_session::{Outputs, Within, one};
use crate::usage::Usage;
use crate::{ending, ros2, skins};
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;

/// Arguments of `skin run`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    source: SourceArguments,
    #[command(flatten)]
    show: ShowArguments,
    /// Records everything into this file, for skin replay, info and export [default: a name from date, time and board].
    #[arg(long, value_name = "FILE", num_args = 0..=1)]
    record: Option<Option<PathBuf>>,
}

/// Runs the command.
///
/// # Errors
/// A port that does not open or answer, a board lost on the way, a page that cannot be served, a recording that cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let outputs = Outputs {
        show: &arguments.show,
        page: !arguments.show.json || arguments.show.listen.is_some(),
        record: arguments.record.as_ref().map(Option::as_deref),
        seconds: None,
    };
    live(&arguments.source, &outputs)
}

/// Frames of a board to pictures, or of several.
///
/// # Errors
/// As [`run`].
pub(crate) fn live(arguments: &SourceArguments, outputs: &Outputs<'_>) -> Result<()> {
    if arguments.watch && arguments.baseline == Start::Stored {
        let why = "--watch with --baseline stored: the board learns its watch on a sheet that nothing rests on; leave one of them out";
        return Err(Usage(why.to_owned()).into());
    }
    if let Some(file) = &arguments.skins {
        return skins::live(file, arguments, outputs);
    }
    let stop = ending::flag()?;
    let ros = ros2::start(outputs.show)?;
    let within = Within {
        stop: &stop,
        recording: outputs.record.map(RecordTo::new).transpose()?,
        skin: None,
        page: None,
        ros: ros.as_ref(),
    };
    one(arguments, outputs, within).map(|_| ())
}
