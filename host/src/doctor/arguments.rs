//! What is examined, on the command line.

use crate::number;
use clap::{ArgGroup, Args};
use hil_sim::{Fault, Preset};
use std::path::PathBuf;

/// A board, a recording or the simulated skin, and how it is examined.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("source")))]
pub(crate) struct Examined {
    /// Serial port of the board, or tcp://HOST:PORT of a bridge to it [default: the only board on USB].
    #[arg(long, group = "source", value_name = "PORT")]
    pub(crate) port: Option<String>,
    /// Serial number of the board or of its adapter, as `skin list` shows them.
    #[arg(long, group = "source", value_name = "SERIAL")]
    pub(crate) serial: Option<String>,
    /// A recording that begins with nothing on the sheet, in the place of a board.
    #[arg(long, group = "source", value_name = "RECORDING")]
    pub(crate) from: Option<PathBuf>,
    /// A simulated board with nothing on its sheet.
    #[arg(long, group = "source")]
    pub(crate) simulate: bool,
    /// How long frames are taken, s of the board's time.
    #[arg(long, value_name = "S", default_value = "3", value_parser = number::allowed("a time in seconds, above 0 and at most 60", |s| s > 0.0 && s <= 60.0))]
    pub(crate) seconds: f64,
    /// The sheet, a TOML file as for `skin forward` [default: the paper's disc].
    #[arg(long, value_name = "FILE", conflicts_with = "from")]
    pub(crate) sheet: Option<PathBuf>,
    /// The electrode of the sheet that every wire leads to, in the order of the board's numbers, as `skin check` says it.
    #[arg(long, value_delimiter = ',', value_name = "ELECTRODE,...", conflicts_with = "from")]
    pub(crate) wires: Vec<usize>,
    /// Folder of the stored baselines [default: $XDG_STATE_HOME/skin or ~/.local/state/skin, and none for a simulated board].
    #[arg(long, value_name = "DIR")]
    pub(crate) state_dir: Option<PathBuf>,
    /// The electronics of the simulated board: sixteen_channels, ideal, drawn_board or drawn_sixteen (docs/simulator.md).
    #[arg(long, value_name = "NAME", requires = "simulate", conflicts_with_all = ["port", "serial", "from"])]
    pub(crate) preset: Option<Preset>,
    /// Something that breaks on the simulated board, as for `skin sim`, such as electrode_open:3@0; repeatable.
    #[arg(long, value_name = "KIND@AT[+FOR]", requires = "simulate", conflicts_with_all = ["port", "serial", "from"])]
    pub(crate) fault: Vec<Fault>,
}
