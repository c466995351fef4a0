//! `skin sim`: a scene on the simulated board, for other programs: as fast as it goes, or behind a serial port of this
//! machine as any program talks to the real one.

use crate::{capture, number, scene, sheet};
use anyhow::Result;
use clap::Args;
use hil_sim::{Electronics, Fault, Preset, Rubber, SceneFile, SimBoard};
use std::path::PathBuf;

/// What a port has no use for, nor what is said of one: clap does not ask for `--pty` where that may not be.
const TABLE: [&str; 4] = ["duration_s", "every_s", "bytes", "truth"];

/// Arguments of `skin sim`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The scene: a TOML file (docs/scenes.md), or a name of the library, such as hand or fast-tap [default: one to four
    /// fingers].
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// The sheet under the default scene, a TOML file as for `skin forward`; a scene's file has its own [default: the paper's disc].
    #[arg(long, value_name = "FILE", conflicts_with = "scene")]
    sheet: Option<PathBuf>,
    /// Something that breaks, for ever or for a time (s), such as cable_pulled@5+2, bytes_lost:0.001@5, electrode_open:3@5+10 or
    /// multiplexer_stuck:drive_plus,3@5; repeatable, in addition to the scene's (docs/simulator.md lists them); electrodes count from 1.
    #[arg(long, value_name = "KIND@AT[+FOR]")]
    fault: Vec<Fault>,
    /// The board's electronics, with nothing changed: sixteen_channels, ideal, drawn_board or drawn_sixteen (docs/simulator.md) [default: the
    /// scene's].
    #[arg(long, value_name = "NAME", hide_short_help = true)]
    preset: Option<Preset>,
    /// Seed of all that is random [default: the scene's].
    #[arg(long, value_name = "N", hide_short_help = true)]
    seed: Option<u64>,
    /// Behind a pseudo-terminal, whose name is printed: open it as a serial port (`skin run --port NAME`). Until it is
    /// interrupted.
    #[arg(long, conflicts_with_all = TABLE)]
    pty: bool,
    /// A symbolic link that always points to the port, whatever its name.
    #[arg(long, value_name = "PATH", requires = "pty", conflicts_with_all = TABLE)]
    link: Option<PathBuf>,
    /// Latency timer of the simulated FTDI adapter, ms; 16 is its driver's default.
    #[arg(
        long,
        value_name = "MS",
        default_value_t = 16,
        value_parser = clap::value_parser!(u64).range(1..=255),
        requires = "pty",
        conflicts_with_all = TABLE,
        hide_short_help = true
    )]
    latency_ms: u64,
    /// Behind the port time passes as fast as the port is read, and stands still while nobody reads or the board is idle: for
    /// tests of other programs, on however slow a machine.
    #[arg(long, requires = "pty", conflicts_with_all = TABLE, hide_short_help = true)]
    unpaced: bool,
    /// How long it runs, s [default: as long as the scene].
    #[arg(long, value_name = "S", value_parser = number::positive("a time in seconds above 0"))]
    duration_s: Option<f64>,
    /// Simulated time from one frame of the table to the next, s.
    #[arg(long, value_name = "S", default_value = "0.5", value_parser = number::positive("a time in seconds above 0"))]
    pub(crate) every_s: f64,
    /// Writes what the board sends, byte for byte, to this file, and no table.
    #[arg(long, value_name = "FILE", hide_short_help = true)]
    bytes: Option<PathBuf>,
    /// Writes the touches that there really are at every frame of the table to this file, one JSON object a line.
    #[arg(long, value_name = "FILE", conflicts_with = "bytes")]
    pub(crate) truth: Option<PathBuf>,
}

/// Runs the command; behind a port until it is interrupted.
///
/// # Errors
/// A scene that makes no sense, a fault that cannot be, a file, port or link that cannot be made.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let mut file = match &arguments.scene {
        Some(path) => scene::load(path)?,
        None => SceneFile::demo(sheet::load(arguments.sheet.as_deref())?.0),
    };
    file.config.faults.extend(arguments.fault.iter().cloned());
    if let Some(preset) = arguments.preset {
        let seed = file.config.electronics.seed;
        file.config.electronics = Electronics {
            seed,
            ..preset.electronics()
        };
    }
    if let Some(seed) = arguments.seed {
        file.config.electronics.seed = seed;
        file.scene.variation.seed = seed;
    }
    file.duration_s = arguments.duration_s.unwrap_or(file.duration_s);
    let board = file.board()?;
    match &arguments.bytes {
        _ if arguments.pty => serve(arguments, board),
        Some(path) => capture::bytes(board, file.duration_s, path),
        None => capture::table(&file, board, arguments.every_s, arguments.truth.as_deref()),
    }
}

#[cfg(target_os = "linux")]
fn serve(arguments: &Arguments, board: SimBoard<Rubber>) -> Result<()> {
    use anyhow::Context;
    use hil_sim::{Pace, Pty, PtyOptions};
    use std::io::Write;
    use std::sync::atomic::Ordering;
    use std::time::Duration;

    let stop = crate::ending::flag()?;
    let options = PtyOptions {
        latency: Duration::from_millis(arguments.latency_ms),
        link: arguments.link.clone(),
        pace: if arguments.unpaced {
            Pace::Unpaced
        } else {
            Pace::RealTime
        },
    };
    let port = Pty::start(board, options).context("the port cannot be made")?;
    let mut shown = None;
    while !stop.load(Ordering::Relaxed) {
        let path = port
            .wait(shown.as_deref(), Duration::from_millis(100))
            .context("the port")?;
        if path != shown {
            match &path {
                Some(path) => {
                    let mut out = std::io::stdout().lock();
                    writeln!(out, "{}", path.display())?;
                    out.flush()?;
                }
                None => eprintln!("the cable is pulled"),
            }
            shown = path;
        }
    }
    Ok(())
}

#[cfg(not(target_os = "linux"))]
fn serve(_arguments: &Arguments, _board: SimBoard<Rubber>) -> Result<()> {
    anyhow::bail!("simulated serial ports need Linux; `skin run --simulate` shows the simulated skin here")
}
