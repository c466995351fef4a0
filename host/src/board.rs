//! Which board a command is for.

use crate::config::Config;
use crate::ending;
use crate::list::{self, Listed};
use crate::say::say;
use crate::usage::Usage;
use crate::{sheet, simulated_skin};
use ::forward::Sheet;
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use link::ports::{self, Place};
use link::{Link, Port, greet};
use protocol::Hello;
use recording::Tap;
use std::path::PathBuf;

/// The board's port, on the command line.
#[derive(Debug, Args)]
pub(crate) struct Choice {
    /// Serial port of the board, or tcp://HOST:PORT of a bridge to it [default: the only board on USB].
    #[arg(long, value_name = "PORT", global = true)]
    port: Option<String>,
    /// Serial number of the board or of its adapter, as `skin list` shows them.
    #[arg(long, value_name = "SERIAL", conflicts_with = "port", global = true)]
    serial: Option<String>,
    /// The simulated skin.
    #[arg(long, conflicts_with_all = ["port", "serial"], global = true)]
    simulate: bool,
    /// The sheet of the simulated skin, a TOML file as for `skin forward`; a board says itself how many electrodes it has [default:
    /// the paper's disc].
    #[arg(long, value_name = "FILE", global = true)]
    sheet: Option<PathBuf>,
}

/// A board that has introduced itself.
pub(crate) struct Connected {
    pub(crate) link: Link,
    pub(crate) hello: Hello,
    /// Its port's name.
    pub(crate) source: String,
}

impl Choice {
    /// Of a command with options of its own; `sheet` is that of the simulated skin.
    pub(crate) fn new(port: Option<String>, serial: Option<String>, simulate: bool, sheet: Option<PathBuf>) -> Self {
        Self {
            port,
            serial,
            simulate,
            sheet: sheet.filter(|_| simulate),
        }
    }

    /// Greets the board.
    ///
    /// # Errors
    /// There is none, or it does not answer.
    pub(crate) fn connect(&self) -> Result<Connected> {
        self.connect_or(None, simulated_skin::demo)
    }

    /// Whether it is the simulated skin.
    pub(crate) fn is_simulated(&self) -> bool {
        self.simulate
    }

    /// The same, with this port, of the sheet that is asked for, in the place of the simulated skin's; what passes is recorded by a tap.
    ///
    /// # Errors
    /// As of [`Choice::connect`].
    pub(crate) fn connect_or(
        &self,
        tap: Option<&Tap>,
        simulated: impl FnOnce(Sheet) -> Result<Box<dyn Port>>,
    ) -> Result<Connected> {
        let greeted = |port: Box<dyn Port>, source: &str| -> Result<Connected> {
            let link = Link::open(match tap {
                Some(tap) => Box::new(tap.port(port)),
                None => port,
            })?;
            ending::stops(&link)?;
            let hello = greet(&link)?;
            Ok(Connected {
                link,
                hello,
                source: source.to_owned(),
            })
        };
        if self.sheet.is_some() && !self.simulate {
            let why = "--sheet is for the simulated skin (--simulate): a board says itself what is wired to it";
            return Err(Usage(why.to_owned()).into());
        }
        if self.simulate {
            let (sheet, _) = sheet::load(self.sheet.as_deref())?;
            return greeted(simulated(sheet)?, "simulated skin");
        }
        let open = |place: &Place| {
            let port = place.open().map_err(|e| anyhow!(e))?;
            greeted(port, place.path()).with_context(|| place.path().to_owned())
        };
        if let Some(path) = &self.port {
            return open(&Place::of(path));
        }
        match only(self.serial.as_deref(), open)? {
            Ok(found) => Ok(found),
            Err(why) => {
                bail!("no board found ({why}); name its port with --port, or ask the simulated skin with --simulate")
            }
        }
    }
}

/// What `start` makes of the only board, or of the one with this serial number; or why there is none. No device that is not asked for
/// is sent anything.
///
/// # Errors
/// There are several boards, or the ports cannot be listed.
pub(crate) fn only<T>(serial: Option<&str>, start: impl Fn(&Place) -> Result<T>) -> Result<Result<T, String>> {
    let config = Config::load()?;
    if let (None, Some(path)) = (serial, &config.port) {
        say!("{path}: the port of the configuration");
        // Who names a port means it: what is wrong with it is an error.
        return start(&Place::of(path)).map(Ok);
    }
    let serial = serial.or(config.serial.as_deref());
    let ports = ports::usb_ports().context("the serial ports cannot be listed")?;
    let likely: Vec<&str> = ports.iter().filter(|p| p.likely).map(|p| p.path.as_str()).collect();
    let path = match (&likely[..], serial) {
        ([], None) => {
            let why = "there is no serial port on USB as a board has".to_owned();
            return Ok(Err(why + &ports::left_alone(&ports)));
        }
        ([one], None) => (*one).to_owned(),
        _ => match chosen(&list::usb()?, serial)? {
            Ok(path) => path,
            Err(why) => return Ok(Err(why + &ports::left_alone(&ports))),
        },
    };
    Ok(start(&Place::of(&path)).map_err(|e| {
        say!("{e:#}");
        "the serial port on USB did not answer as one".to_owned() + &ports::left_alone(&ports)
    }))
}

/// The port of the board that is meant.
fn chosen(listed: &[Listed], serial: Option<&str>) -> Result<Result<String, String>> {
    let meant: Vec<&Listed> = match serial {
        Some(serial) => listed.iter().filter(|l| l.has_serial(serial)).collect(),
        None => listed.iter().filter(|l| l.is_board()).collect(),
    };
    match (&meant[..], serial) {
        ([one], _) => Ok(Ok(one.port.clone())),
        ([], Some(serial)) => Ok(Err(format!("there is no board of serial number {serial}"))),
        ([], None) => Ok(Err(format!(
            "none of {} serial ports on USB answered as one",
            listed.len()
        ))),
        (several, _) => {
            let names: Vec<String> = several.iter().map(|l| l.name()).collect();
            let why = format!(
                "there are several boards: {}; name one with --serial SERIAL or --port PORT",
                names.join(", ")
            );
            Err(Usage(why).into())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_of_several_boards_has_to_be_named() {
        let boards = [
            Listed::board("/dev/ttyUSB0", "FT1", "A"),
            Listed::board("/dev/ttyUSB1", "FT2", "B"),
        ];
        let path = |serial| chosen(&boards, serial).unwrap();
        assert_eq!(path(Some("B")), Ok("/dev/ttyUSB1".to_owned()));
        assert_eq!(path(Some("FT1")), Ok("/dev/ttyUSB0".to_owned()));
        assert!(path(Some("C")).unwrap_err().contains("serial number C"));
        assert_eq!(chosen(&boards[..1], None).unwrap(), Ok("/dev/ttyUSB0".to_owned()));
        let several = chosen(&boards, None).unwrap_err().to_string();
        assert!(
            several.contains("/dev/ttyUSB0 (A)") && several.contains("--serial"),
            "{several}"
        );
        assert!(chosen(&[], None).unwrap().is_err());
    }
}
