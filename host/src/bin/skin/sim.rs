//! `skin sim`: the simulated board behind a serial port of this machine, for any program that talks to the real one.

use ::forward::Sheet;
use anyhow::Result;
use clap::Args;
use hil_sim::{Electronics, Fault, Rubber, Scene, SimBoard, SimConfig};
use std::path::PathBuf;

/// Arguments of `skin sim`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Behind a pseudo-terminal, whose name is printed: open it as a serial port (`skin run --port NAME`).
    #[arg(long, required = true)]
    pty: bool,
    /// A symbolic link that always points to the port, whatever its name.
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
    /// Latency timer of the simulated FTDI adapter, ms; 16 is its driver's default.
    #[arg(long, value_name = "MS", default_value_t = 16, value_parser = clap::value_parser!(u64).range(1..=255))]
    latency_ms: u64,
    /// Something that breaks, for ever or for a time (s), such as cable_pulled@5+2, bytes_lost:0.001@5, electrode_open:3@5+10 or
    /// multiplexer_stuck:drive_plus,3@5; repeatable (docs/simulator.md lists them).
    #[arg(long, value_name = "KIND@AT[+FOR]")]
    fault: Vec<Fault>,
    /// Seed of all that is random.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// Runs the command, until it is interrupted.
///
/// # Errors
/// A fault that cannot be, a port or a link that cannot be made.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let rubber = Rubber::new(&Sheet::paper(), Scene::demo())?;
    let config = SimConfig {
        electronics: Electronics {
            seed: arguments.seed,
            ..Electronics::default()
        },
        faults: arguments.fault.clone(),
        ..SimConfig::default()
    };
    serve(arguments, SimBoard::new(config, rubber)?)
}

#[cfg(target_os = "linux")]
fn serve(arguments: &Arguments, board: SimBoard<Rubber>) -> Result<()> {
    use anyhow::Context;
    use hil_sim::{Pty, PtyOptions};
    use std::io::Write;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::Duration;

    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).context("Ctrl-C cannot be caught")?;
    let options = PtyOptions {
        latency: Duration::from_millis(arguments.latency_ms),
        link: arguments.link.clone(),
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
