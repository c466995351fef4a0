//! Serial ports where a board may be.

use crate::link::Port;
use serialport::{SerialPortInfo, SerialPortType};
use std::time::Duration;

/// Bits a second on the board's serial line.
pub const BAUD: u32 = 1_000_000;
/// How long a read waits for bytes.
const READ_WAIT: Duration = Duration::from_millis(20);

/// Serial ports on USB, likeliest first (FTDI's chips, which the board has).
///
/// # Errors
/// The system's, when it cannot list its ports.
pub fn candidates() -> Result<Vec<SerialPortInfo>, serialport::Error> {
    // Some containers have no such folder, and the listing needs it.
    if cfg!(target_os = "linux") && !std::path::Path::new("/sys/class/tty").exists() {
        return Ok(Vec::new());
    }
    let mut ports: Vec<SerialPortInfo> = serialport::available_ports()?
        .into_iter()
        .filter(|p| matches!(p.port_type, SerialPortType::UsbPort(_)))
        .collect();
    ports.sort_by_key(|p| match &p.port_type {
        SerialPortType::UsbPort(usb) if usb.vid == 0x0403 => 0,
        _ => 1,
    });
    Ok(ports)
}

/// Opens a port for a [`crate::link::Link`]. Where its DTR and RTS are wired to a board's BOOT0 and reset (see docs/board.md), the
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
