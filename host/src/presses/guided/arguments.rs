//! What a guided calibration is asked for.

use crate::{number, plan};
use clap::Args;
use clap::builder::RangedU64ValueParser;
use link::plans::PlanChoice;
use std::path::PathBuf;

/// Where presses come from that are taken now.
#[derive(Debug, Args)]
// The group of its name is that of the command's own arguments.
#[group(skip)]
pub(crate) struct Arguments {
    /// Serial port of the board, or tcp://HOST:PORT: guides through the presses now.
    #[arg(long, value_name = "PORT", group = "source")]
    pub(crate) port: Option<String>,
    /// Serial number of the board or of its adapter, as `skin list` shows them.
    #[arg(long, value_name = "SERIAL", group = "source", hide_short_help = true)]
    pub(crate) serial: Option<String>,
    /// The simulated skin, with a simulated presser.
    #[arg(long, group = "source")]
    pub(crate) simulate: bool,
    /// The same on the sheet, the rubber and the board of a scene; with --positions the scene's own touches, where it has any.
    #[arg(long, value_name = "FILE", group = "source", hide_short_help = true)]
    pub(crate) scene: Option<PathBuf>,
    /// A recording of presses at the marks in their order, or of the positions.
    #[arg(long, value_name = "RECORDING", group = "source")]
    pub(crate) from: Option<PathBuf>,
    /// Presses that are wanted.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = RangedU64ValueParser::<usize>::new().range(5..=2000))]
    pub(crate) count: usize,
    /// Radius of what presses, mm: marks are at least that far from the rim.
    #[arg(long, value_name = "MM", default_value_t = 6.0, value_parser = number::positive("a radius in millimetres above 0"))]
    pub(crate) tip_mm: f64,
    /// Marks to press, in this order: a CSV with x_mm and y_mm, as skin calibrate marks --csv writes it [default: chosen].
    #[arg(long, value_name = "FILE", conflicts_with = "positions")]
    pub(crate) marks: Option<PathBuf>,
    /// Where and when a robot pressed or will press: a CSV with t_s, x_mm, y_mm and perhaps force_n, a line a press or many a second.
    #[arg(long, value_name = "FILE")]
    pub(crate) positions: Option<PathBuf>,
    /// What a gauge read: a CSV with t_s and force_n.
    #[arg(long, value_name = "FILE", hide_short_help = true)]
    pub(crate) gauge: Option<PathBuf>,
    /// By how much the board's time is later than that of --positions or --gauge, s [default: found by the times of the presses].
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = number::allowed("a time in seconds", |_| true), hide_short_help = true)]
    pub(crate) shift_s: Option<f64>,
    /// What a frame measures; use the same with skin run.
    #[arg(long, value_name = "PLAN", value_parser = plan::parser(), default_value_t = PlanChoice::Auto, hide_short_help = true)]
    pub(crate) plan: PlanChoice,
    /// Force of the simulated presser, N, which differs by a quarter from press to press.
    #[arg(long, value_name = "N", default_value_t = 12.0, value_parser = number::positive("a force in newtons above 0"), hide_short_help = true)]
    pub(crate) force_n: f64,
    /// Source of the simulated noise.
    #[arg(long, default_value_t = 1, value_name = "N", hide_short_help = true)]
    pub(crate) seed: u64,
    /// Port of the page on 127.0.0.1 [default: 8477, or a free one; without this a simulated skin has no page, and its time passes as fast as
    /// it can].
    #[arg(long, value_name = "PORT", hide_short_help = true)]
    pub(crate) listen: Option<u16>,
    /// Do not open the page in the browser.
    #[arg(long, hide_short_help = true)]
    pub(crate) no_open: bool,
}

impl Arguments {
    /// Whether presses are taken now, and not from a table.
    pub(crate) fn is_asked(&self) -> bool {
        self.port.is_some() || self.serial.is_some() || self.simulate || self.scene.is_some() || self.from.is_some()
    }
}
