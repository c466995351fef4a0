//! `skin list`: the boards on this computer, and who they are.

use crate::json;
use crate::say::say;
use crate::skin_file::{self, Skin};
use anyhow::{Context, Result};
use clap::Args;
use link::ports::{self, Place};
use link::{Link, greet};
use protocol::Hello;
use serde::Serialize;
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `skin list`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Ports to ask beside those on USB, such as /dev/ttyS1 or tcp://robot:3333.
    #[arg(value_name = "PORT")]
    ports: Vec<String>,
    /// File of several skins, to tell which board is which of them; the ports that it names are asked, too.
    #[arg(long, value_name = "FILE")]
    skins: Option<PathBuf>,
    /// One JSON list on stdout.
    #[arg(long)]
    json: bool,
}

/// A port, and who is behind it.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Listed {
    pub(crate) port: String,
    /// Serial number of the adapter.
    pub(crate) usb_serial: Option<String>,
    /// USB's numbers of vendor and product, in hexadecimal.
    usb: Option<String>,
    /// What the adapter says to be.
    adapter: Option<String>,
    board: Option<Board>,
    /// Why no board is known behind it.
    why: Option<String>,
    /// Its name in the file of skins.
    #[serde(skip_serializing_if = "Option::is_none")]
    skin: Option<String>,
}

/// Who a board says it is.
#[derive(Clone, Debug, Serialize)]
struct Board {
    name: String,
    serial: String,
    firmware: String,
    electrodes: usize,
}

impl Listed {
    /// A board behind an adapter, for tests.
    #[cfg(test)]
    pub(crate) fn board(port: &str, usb_serial: &str, serial: &str) -> Self {
        Self {
            port: port.to_owned(),
            usb_serial: Some(usb_serial.to_owned()),
            usb: None,
            adapter: None,
            board: Some(Board {
                name: "board".to_owned(),
                serial: serial.to_owned(),
                firmware: String::new(),
                electrodes: 16,
            }),
            why: None,
            skin: None,
        }
    }

    /// Whether a board answered.
    pub(crate) fn is_board(&self) -> bool {
        self.board.is_some()
    }

    /// Whether it is meant by a serial number: the adapter's, or the board's own.
    pub(crate) fn has_serial(&self, serial: &str) -> bool {
        self.usb_serial.as_deref() == Some(serial) || self.board.as_ref().is_some_and(|b| b.serial == serial)
    }

    /// Port and serial number, for people.
    pub(crate) fn name(&self) -> String {
        let own = self.board.as_ref().map(|b| b.serial.as_str());
        let serial = own.or(self.usb_serial.as_deref());
        format!("{} ({})", self.port, serial.unwrap_or("without a serial number"))
    }
}

/// Asks who is behind a port. The board goes on as it was.
fn ask(port: &str) -> Result<Hello, String> {
    let open = Place::of(port).open()?;
    let mut link = Link::open(open).map_err(|e| e.to_string())?;
    link.leave_running();
    greet(&link).map_err(|e| e.to_string())
}

fn asked(port: &str) -> (Option<Board>, Option<String>) {
    match ask(port) {
        Ok(hello) => {
            let board = Board {
                name: hello.board.to_string(),
                serial: hello.serial.to_string(),
                firmware: hello.firmware.to_string(),
                electrodes: hello.electrodes.into(),
            };
            (Some(board), None)
        }
        Err(why) => (None, Some(why)),
    }
}

/// The ports on USB, likeliest first. Those that a board may be behind are asked; no other device is sent anything.
///
/// # Errors
/// The ports cannot be listed.
pub(crate) fn usb() -> Result<Vec<Listed>> {
    let found = ports::usb_ports().context("the serial ports cannot be listed")?;
    let listed = found.into_iter().map(|port| {
        let (board, why) = if port.likely {
            asked(&port.path)
        } else {
            (
                None,
                Some("not asked: another device; name the port where it is a board".to_owned()),
            )
        };
        Listed {
            port: port.path,
            usb_serial: port.serial,
            usb: Some(format!("{:04x}:{:04x}", port.vendor, port.product)),
            adapter: port.name,
            board,
            why,
            skin: None,
        }
    });
    Ok(listed.collect())
}

/// Gives the ports the names of their skins; what is to be said of skins whose board is not there.
fn name(listed: &mut [Listed], skins: &[Skin]) -> Vec<String> {
    let mut missing = Vec::new();
    for skin in skins {
        let Some(board) = skin.board() else { continue };
        let found = listed.iter_mut().find(|l| {
            let serials = [l.usb_serial.as_deref(), l.board.as_ref().map(|b| b.serial.as_str())];
            skin.is_behind(&l.port, &serials.into_iter().flatten().collect::<Vec<_>>())
        });
        match found {
            Some(listed) => {
                if listed.board.is_none() {
                    missing.push(format!("{}: no board answers at {}", skin.name, listed.port));
                }
                listed.skin = Some(skin.name.clone());
            }
            None => missing.push(format!("{}: no board with the {board}", skin.name)),
        }
    }
    missing
}

/// Runs the command.
///
/// # Errors
/// The ports cannot be listed.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let skins = arguments
        .skins
        .as_deref()
        .map(skin_file::read)
        .transpose()?
        .unwrap_or_default();
    let mut listed = usb()?;
    for port in arguments
        .ports
        .iter()
        .map(String::as_str)
        .chain(skins.iter().filter_map(Skin::port))
    {
        // One that is on USB, or was given twice, was asked.
        if listed.iter().any(|l| l.port == port) {
            continue;
        }
        let (board, why) = asked(port);
        listed.push(Listed {
            port: port.to_owned(),
            usb_serial: None,
            usb: None,
            adapter: None,
            board,
            why,
            skin: None,
        });
    }
    let missing = name(&mut listed, &skins);
    let mut out = crate::say::stdout();
    if arguments.json {
        out.write_all(&json::line(&listed)?)?;
        missing.iter().for_each(|missing| say!("{missing}"));
        return Ok(());
    }
    let names = listed
        .iter()
        .filter_map(|l| Some(l.skin.as_ref()?.len() + 2))
        .max()
        .unwrap_or(0);
    let dash = || "-".to_owned();
    let width = listed.iter().map(|l| l.port.len()).max().unwrap_or(0).max(12);
    for listed in &listed {
        let adapter = [listed.adapter.clone(), listed.usb.clone()];
        let adapter = adapter.into_iter().flatten().collect::<Vec<_>>().join(" ");
        let (serial, what) = match &listed.board {
            Some(board) => (
                board.serial.clone(),
                format!(
                    "{}, {} electrodes, firmware {}",
                    board.name, board.electrodes, board.firmware
                ),
            ),
            None => (
                listed.usb_serial.clone().unwrap_or_else(dash),
                listed.why.clone().unwrap_or_default(),
            ),
        };
        let adapter = if adapter.is_empty() {
            String::new()
        } else {
            format!("   [{adapter}]")
        };
        let name = listed.skin.as_deref().unwrap_or_default();
        writeln!(out, "{name:names$}{:width$}  {serial:24}  {what}{adapter}", listed.port)?;
    }
    missing.iter().for_each(|missing| say!("{missing}"));
    if !listed.iter().any(Listed::is_board) {
        say!("no board answered; look at its cable and power");
        for hint in ports::hints() {
            say!("hint: {hint}");
        }
    }
    Ok(())
}
