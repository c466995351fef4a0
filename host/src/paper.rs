//! `skin paper`: the source paper's experiments again, on the simulated skin, as one report.

use anyhow::Result;
use clap::Args;
use std::path::PathBuf;
use studies::paper::simulated_rig::SimulatedRig;
use studies::paper::{self, Options};

/// Arguments of `skin paper`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder for report.html and report.json; made if need be.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A tenth of the frames and shorter presses: for a look.
    #[arg(long)]
    quick: bool,
    /// Source of all noise.
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
}

/// Runs the command.
///
/// # Errors
/// A sheet that cannot be modelled, a file that cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    // Minutes of work are not to end at a folder that cannot be made.
    std::fs::create_dir_all(&arguments.out).map_err(|cause| paper::PaperError::Write {
        file: arguments.out.display().to_string(),
        cause,
    })?;
    let options = Options {
        quick: arguments.quick,
        seed: arguments.seed,
    };
    let report = paper::run(&SimulatedRig::new()?, options, &|what| eprintln!("{what} ..."))?;
    for file in report.write(&arguments.out)? {
        println!("{}", file.display());
    }
    Ok(())
}
