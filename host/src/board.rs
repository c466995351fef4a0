//! Which board a command is for.

use crate::usage::Usage;
use crate::{sheet, simulated_skin};
use ::forward::Sheet;
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use link::{Link, Port, greet, ports};
use protocol::Hello;
use std::path::PathBuf;

/// The board's port, on the command line.
#[derive(Debug, Args)]
pub(crate) struct Choice {
    /// Serial port of the board [default: the first on USB that may be one and answers].
    #[arg(long, value_name = "PORT", global = true)]
    port: Option<String>,
    /// The simulated skin.
    #[arg(long, conflicts_with = "port", global = true)]
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
    /// Greets the board.
    ///
    /// # Errors
    /// There is none, or it does not answer.
    pub(crate) fn connect(&self) -> Result<Connected> {
        self.connect_or(simulated_skin::demo)
    }

    /// Whether it is the simulated skin.
    pub(crate) fn is_simulated(&self) -> bool {
        self.simulate
    }

    /// The same, with this port, of the sheet that is asked for, in the place of the simulated skin's.
    ///
    /// # Errors
    /// As of [`Choice::connect`].
    pub(crate) fn connect_or(&self, simulated: impl FnOnce(Sheet) -> Result<Box<dyn Port>>) -> Result<Connected> {
        let greeted = |port: Box<dyn Port>, source: &str| -> Result<Connected> {
            let link = Link::open(port)?;
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
        if let Some(path) = &self.port {
            return greeted(ports::open(path).map_err(|e| anyhow!(e))?, path).with_context(|| path.clone());
        }
        match first(greeted)? {
            Ok(found) => Ok(found),
            Err(why) => {
                bail!("no board found ({why}); name its port with --port, or ask the simulated skin with --simulate")
            }
        }
    }
}

/// What `start` makes of the first port that a board may be behind and that answers as one; or why there is none. No other device is
/// sent anything.
///
/// # Errors
/// The ports cannot be listed.
pub(crate) fn first<T>(start: impl Fn(Box<dyn Port>, &str) -> Result<T>) -> Result<Result<T, String>> {
    let candidates = ports::candidates().context("the serial ports cannot be listed")?;
    for path in &candidates.likely {
        match ports::open(path)
            .map_err(|e| anyhow!(e))
            .and_then(|port| start(port, path))
        {
            Ok(found) => return Ok(Ok(found)),
            Err(e) => eprintln!("{path}: {e:#}"),
        }
    }
    let why = match candidates.likely.len() {
        0 => "there is no serial port on USB as a board has".to_owned(),
        n => format!("none of {n} serial ports on USB answered as one"),
    };
    Ok(Err(why + &candidates.left_alone()))
}
