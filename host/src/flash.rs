//! `skin flash`: programs a board over its serial cable.

use crate::progress::Progress;
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use hil_sim::BootRom;
use link::flash::bootloader::BootPort;
use link::flash::chip::FLASH_START;
use link::flash::serial::SerialBootPort;
use link::flash::{Bootloader, Chip, Image, Step, flash};
use link::ports;
use std::io::{self, Read, Write};
use std::path::PathBuf;
use std::time::Duration;

/// Largest file of a program, bytes: with what debuggers need it is a hundred times as large as what is flashed.
const MOST_PROGRAM: u64 = 256 << 20;

/// Arguments of `skin flash`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The program: the ELF file that cargo builds for the board (docs/board.md).
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Serial port of the board [default: the only one on USB].
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    /// DTR and RTS are not wired to BOOT0 and reset: ask for them to be set by hand.
    #[arg(long)]
    manual: bool,
    /// A simulated chip of the image's kind instead of a board.
    #[arg(long, conflicts_with_all = ["port", "manual"])]
    simulate: bool,
}

/// The simulated chip as a port.
struct Simulated(BootRom);

impl Read for Simulated {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer)
    }
}

impl Write for Simulated {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

impl BootPort for Simulated {
    fn set_boot(&mut self, high: bool) -> io::Result<()> {
        self.0.boot_line(high);
        Ok(())
    }

    fn set_reset(&mut self, held: bool) -> io::Result<()> {
        self.0.reset_line(held);
        Ok(())
    }

    fn wait(&mut self, _: Duration) {}

    fn clear(&mut self) -> io::Result<()> {
        self.0.clear();
        Ok(())
    }
}

/// Runs the command.
///
/// # Errors
/// A file that is no program, a board that does not answer or is another one, an interrupted cable.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let file = arguments.file.display();
    let bytes =
        ::forward::whole::bytes(&arguments.file, MOST_PROGRAM).with_context(|| format!("{file}: cannot be read"))?;
    let image = Image::read(&bytes).with_context(|| file.to_string())?;
    eprintln!("{file}: {} bytes for the {}", image.len(), image.chip_name());
    if arguments.simulate {
        let kib = Chip::of(image.chip).map_or(512, |c| c.flash as usize / 1024);
        return program(Simulated(BootRom::new(image.chip, kib)), &image, true, "simulated chip");
    }
    let path = match &arguments.port {
        Some(path) => path.clone(),
        None => only_port()?,
    };
    if arguments.manual {
        eprint!("connect BOOT0 to 3.3 V, press the reset button, then press Enter here ");
        io::stderr().flush()?;
        io::stdin().read_line(&mut String::new())?;
    }
    let port = SerialBootPort::open(&path).map_err(|e| anyhow!(e))?;
    program(port, &image, !arguments.manual, &path)
}

fn only_port() -> Result<String> {
    let all = ports::usb_ports().context("the serial ports cannot be listed")?;
    let likely: Vec<String> = all.iter().filter(|p| p.likely).map(|p| p.path.clone()).collect();
    match &likely[..] {
        [] => bail!(
            "there is no serial port on USB as a board has{}: plug the board in, or name its port with --port",
            ports::left_alone(&all)
        ),
        [one] => Ok(one.clone()),
        several => bail!(
            "there are several serial ports ({}): name the board's with --port",
            several.join(", ")
        ),
    }
}

fn program(port: impl BootPort, image: &Image, reset: bool, source: &str) -> Result<()> {
    let mut bootloader = Bootloader::connect(port, reset).with_context(|| source.to_owned())?;
    let mut told: Option<(Step, Progress)> = None;
    let outcome = flash(&mut bootloader, image, |step, done, all| {
        let word = match step {
            Step::Compare => "comparing",
            Step::Erase => "erasing",
            Step::Write => "writing",
            Step::Verify => "verifying",
        };
        if told.as_ref().is_none_or(|(before, _)| *before != step) {
            told = Some((step, Progress::new(word)));
        }
        if let Some((_, progress)) = &told {
            progress.at(done, all);
        }
    });
    drop(told);
    let outcome = outcome.with_context(|| source.to_owned())?;
    // Without the lines only a hand can start it as it starts at power-up: the bootloader's own jump would leave its clocks set
    // and BOOT0 high.
    let state = if reset {
        bootloader.start(FLASH_START, true).with_context(|| source.to_owned())?;
        "it is running"
    } else {
        "connect BOOT0 to ground and press the reset button to start it"
    };
    println!(
        "{source}: programmed and verified: {} bytes written, {} were there already, {} sectors erased; {state}",
        outcome.written, outcome.kept, outcome.erased
    );
    Ok(())
}
