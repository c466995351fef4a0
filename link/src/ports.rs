//! Serial ports where a board may be.

use crate::link::Port;
use serialport::{SerialPortInfo, SerialPortType};
use std::time::Duration;

/// Bits a second on the board's serial line.
pub const BAUD: u32 = 1_000_000;
/// How long a read waits for bytes.
const READ_WAIT: Duration = Duration::from_millis(20);

/// USB's numbers of the adapters that a board may have (docs/board.md), likeliest first: vendor and products.
const ADAPTERS: [(u16, &[u16]); 3] = [
    // FTDI: FT232R, FT2232, FT4232, FT232H, FT-X.
    (0x0403, &[0x6001, 0x6010, 0x6011, 0x6014, 0x6015]),
    // ST-LINK/V2-1 and V3 with a serial port, as on a Nucleo.
    (
        0x0483,
        &[0x374b, 0x3752, 0x374e, 0x374f, 0x3753, 0x3754, 0x3755, 0x3757],
    ),
    // Silicon Labs: CP210x.
    (0x10c4, &[0xea60, 0xea63, 0xea70, 0xea71]),
];

/// Serial ports on USB.
#[derive(Clone, Debug, Default)]
pub struct Candidates {
    /// A board may be behind these, likeliest first.
    pub likely: Vec<String>,
    /// These are of other devices, which must not be sent anything unless somebody names them; with USB's numbers.
    pub others: Vec<String>,
}

impl Candidates {
    /// What to say of the ports that are not asked, to be added to a sentence.
    pub fn left_alone(&self) -> String {
        if self.others.is_empty() {
            return String::new();
        }
        format!("; not asked, as they are of other devices: {}", self.others.join(", "))
    }
}

/// The serial ports on USB of this computer.
///
/// # Errors
/// The system's, when it cannot list its ports.
pub fn candidates() -> Result<Candidates, serialport::Error> {
    // Some containers have no such folder, and the listing needs it.
    if cfg!(target_os = "linux") && !std::path::Path::new("/sys/class/tty").exists() {
        return Ok(Candidates::default());
    }
    Ok(sorted(serialport::available_ports()?))
}

fn sorted(ports: Vec<SerialPortInfo>) -> Candidates {
    let mut likely = Vec::new();
    let mut others = Vec::new();
    for port in ports {
        let SerialPortType::UsbPort(usb) = port.port_type else {
            continue;
        };
        match ADAPTERS.iter().position(|(v, p)| *v == usb.vid && p.contains(&usb.pid)) {
            Some(rank) => likely.push((rank, port.port_name)),
            None => others.push(format!("{} ({:04x}:{:04x})", port.port_name, usb.vid, usb.pid)),
        }
    }
    likely.sort_by_key(|(rank, _)| *rank);
    Candidates {
        likely: likely.into_iter().map(|(_, name)| name).collect(),
        others,
    }
}

/// Opens a port for a [`crate::Link`]. Where its DTR and RTS are wired to a board's BOOT0 and reset (see docs/board.md), the
/// board runs its program afterwards: systems assert both lines when they open a port.
///
/// # Errors
/// The system's, with what to do about it.
pub fn open(path: &str) -> Result<Box<dyn Port>, String> {
    match serialport::new(path, BAUD).timeout(READ_WAIT).open() {
        Ok(mut port) => {
            // BOOT0 first, so that the reset that ends with the other finds it low. A port without these lines needs neither.
            let _ = port.write_data_terminal_ready(false);
            let _ = port.write_request_to_send(false);
            Ok(Box::new(SerialPort(port)))
        }
        Err(e) => Err(explained(path, &e)),
    }
}

/// Why a port did not open, and what to do about it.
pub(crate) fn explained(path: &str, error: &serialport::Error) -> String {
    let text = error.to_string();
    let help = match error.kind() {
        serialport::ErrorKind::NoDevice if text.contains("lock") => {
            "another program holds the port: end it, or name another port"
        }
        serialport::ErrorKind::NoDevice | serialport::ErrorKind::Io(std::io::ErrorKind::NotFound) => {
            "there is no such port: look at the cable and at the name"
        }
        serialport::ErrorKind::Io(std::io::ErrorKind::PermissionDenied) => {
            "add yourself to the group that owns the port (`sudo usermod -aG dialout $USER`) and log in again"
        }
        _ => "is it a serial port?",
    };
    format!("{path}: {text}; {help}")
}

/// A serial port as a plain stream of bytes.
struct SerialPort(Box<dyn serialport::SerialPort>);

impl std::io::Read for SerialPort {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.0.read(buffer)
    }
}

impl std::io::Write for SerialPort {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serialport::UsbPortInfo;

    #[test]
    fn only_adapters_that_a_board_may_have_are_greeted() {
        let usb = |name: &str, vid, pid| SerialPortInfo {
            port_name: name.to_owned(),
            port_type: SerialPortType::UsbPort(UsbPortInfo {
                vid,
                pid,
                serial_number: None,
                manufacturer: None,
                product: None,
            }),
        };
        let found = sorted(vec![
            usb("cp2102", 0x10c4, 0xea60),
            usb("arduino", 0x2341, 0x0043),
            usb("nucleo", 0x0483, 0x374b),
            usb("a dfu device of the same maker", 0x0483, 0x5740),
            usb("ft232rl", 0x0403, 0x6001),
            SerialPortInfo {
                port_name: "no usb".to_owned(),
                port_type: SerialPortType::PciPort,
            },
        ]);
        assert_eq!(found.likely, ["ft232rl", "nucleo", "cp2102"]);
        assert_eq!(
            found.others,
            ["arduino (2341:0043)", "a dfu device of the same maker (0483:5740)"]
        );
    }
}
