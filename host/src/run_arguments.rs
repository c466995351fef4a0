//! What `skin run`, `skin record` and `skin replay` are asked for: where frames come from, and where pictures go.

use crate::plan;
use clap::builder::RangedU64ValueParser;
use clap::{Args, ValueEnum};
use inverse::touches::polarity::Polarity;
use link::plans::PlanChoice;
use std::path::PathBuf;

/// Which baseline a session starts with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Start {
    /// A new one. It is stored unless it differs from the stored one by more than noise and drift.
    New,
    /// The stored one of this board, sheet and plan, when something rests on the sheet.
    Stored,
    /// A new one, stored in any case: for another sheet, or one that has changed.
    Replace,
}

/// Where frames come from and how they are reconstructed.
#[derive(Clone, Debug, Args)]
pub(crate) struct SourceArguments {
    /// Several skins at once, by a file that names them.
    ///
    /// TOML with board, sheet, calibration and place on the robot of each (docs/skins.md).
    #[arg(long, value_name = "FILE", conflicts_with_all = ["port", "serial", "simulate", "scene", "sheet", "wires", "calibration"])]
    pub(crate) skins: Option<PathBuf>,
    /// Serial port of the board, or tcp://HOST:PORT of a bridge to it.
    ///
    /// Such as /dev/ttyUSB0 [default: the only board on USB that answers, else the simulated skin].
    #[arg(long, value_name = "PORT")]
    pub(crate) port: Option<String>,
    /// Serial number of the board or of its adapter, as `skin list` shows them: for one of several boards.
    #[arg(long, value_name = "SERIAL", conflicts_with_all = ["port", "simulate", "scene"], hide_short_help = true)]
    pub(crate) serial: Option<String>,
    /// The simulated skin, whether there is a board or not.
    #[arg(long, conflicts_with = "port")]
    pub(crate) simulate: bool,
    /// The simulated skin with a scene: a file, or a name such as hand.
    ///
    /// A TOML file (docs/scenes.md) or a name of the library, such as hand or fast-tap; over and over.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["port", "sheet"])]
    pub(crate) scene: Option<PathBuf>,
    /// What a frame measures.
    #[arg(long, value_name = "PLAN", value_parser = plan::parser(), default_value_t = PlanChoice::Auto, hide_short_help = true)]
    pub(crate) plan: PlanChoice,
    /// Let the board watch: while nothing touches it sends no frames, and a touch brings them with the next drive.
    #[arg(long, hide_short_help = true)]
    pub(crate) watch: bool,
    /// Reconstructs every frame, however late, for boards that do not run in real time; up to 64 MB of them wait [default: the newest,
    /// and says how many were passed over].
    #[arg(long, hide_short_help = true)]
    pub(crate) every_frame: bool,
    /// The sheet, a TOML file as for `skin forward` [default: the paper's disc].
    #[arg(long, value_name = "FILE")]
    pub(crate) sheet: Option<PathBuf>,
    /// The electrode of the sheet that every wire leads to, in the order of the board's numbers, as `skin check` says it.
    #[arg(long, value_delimiter = ',', value_name = "ELECTRODE,...", hide_short_help = true)]
    pub(crate) wires: Vec<usize>,
    /// Take the electrodes to be exactly where they are said to be, instead of finding them in the baseline.
    #[arg(long, hide_short_help = true)]
    pub(crate) trust_electrodes: bool,
    /// Which way touches change the resistance of the sheet [default: learned from the first ones].
    #[arg(long, value_name = "WAY", value_parser = crate::rise::parser(), hide_short_help = true)]
    pub(crate) rise: Option<Polarity>,
    /// Frames of the unpressed sheet that make the baseline, at least 2 [default: those of 0.7 s, at least 24].
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(2..), hide_short_help = true)]
    pub(crate) baseline_frames: Option<usize>,
    /// The baseline to start with. The last good one of each board is stored.
    #[arg(long, value_enum, value_name = "WHICH", default_value_t = Start::New, hide_short_help = true)]
    pub(crate) baseline: Start,
    /// Folder of the stored baselines and calibrations [default: $XDG_STATE_HOME/skin or ~/.local/state/skin, and none for a simulated skin].
    #[arg(long, value_name = "DIR", hide_short_help = true)]
    pub(crate) state_dir: Option<PathBuf>,
    /// What `skin calibrate` wrote, or none [default: the stored one].
    ///
    /// Forces in newtons with the creep of the rubber taken out; or, by `skin calibrate presses`, the touches of a sheet that no model
    /// describes. The default is the one that is stored for the board.
    #[arg(long, value_name = "FILE")]
    pub(crate) calibration: Option<PathBuf>,
}

/// Where pictures go.
#[derive(Debug, Default, Args)]
pub(crate) struct ShowArguments {
    /// End after so many pictures.
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<u64>::new().range(1..), hide_short_help = true)]
    pub(crate) frames: Option<u64>,
    /// One JSON object a line on stdout, and no page.
    ///
    /// A header, pictures and events (docs/live.schema.json). With --listen there is a page, too.
    #[arg(long)]
    pub(crate) json: bool,
    /// With --json: the rise of every cell of the picture, too, in the order of the header's list.
    #[arg(long, requires = "json", conflicts_with = "no_open", hide_short_help = true)]
    pub(crate) cells: bool,
    /// Publishes on ROS 2, without ROS on this computer.
    ///
    /// Touches, points, pictures and how the skin is; below a namespace such as /robot1 where one is given (docs/ros2.md).
    #[arg(long, value_name = "NAMESPACE", num_args = 0..=1)]
    pub(crate) ros2: Option<Option<String>>,
    /// Runs a command of the shell at every contact, lift, tap, double_tap, stroke, hold, slip or palm.
    ///
    /// What the touch did is in the environment (SKIN_X_MM, ...: docs/events.md). Can be given several times.
    #[arg(long, num_args = 2, value_names = ["EVENT", "CMD"])]
    pub(crate) on: Vec<String>,
    /// Writes the last picture to this file at the end.
    #[arg(long, value_name = "FILE", hide_short_help = true)]
    pub(crate) png: Option<PathBuf>,
    /// Port of the page on 127.0.0.1 [default: 8477, or a free one when that is taken]; with --json there is a page only with this.
    #[arg(long, value_name = "PORT", hide_short_help = true)]
    pub(crate) listen: Option<u16>,
    /// Do not open the page in the browser.
    #[arg(long, conflicts_with = "json", hide_short_help = true)]
    pub(crate) no_open: bool,
}
