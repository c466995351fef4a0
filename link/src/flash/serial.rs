//! A serial port with a bootloader at its other end.

use super::bootloader::{BAUD, BootPort};
use crate::ports::{explained, is_bridge};
use serialport::{ClearBuffer, Parity, SerialPort};
use std::io::{self, Read, Write};
use std::time::Duration;

/// The port, eight bits and even parity.
pub struct SerialBootPort(Box<dyn SerialPort>);

impl SerialBootPort {
    /// Opens a port.
    ///
    /// # Errors
    /// The system's, with what to do about it.
    pub fn open(path: &str) -> Result<Self, String> {
        if is_bridge(path) {
            return Err(format!(
                "{path}: programming needs a line with even parity, and control lines, which a bridge does not have; run skin flash where the board is plugged in"
            ));
        }
        serialport::new(path, BAUD)
            .parity(Parity::Even)
            .timeout(Duration::from_millis(100))
            .open()
            .map(Self)
            .map_err(|e| explained(path, &e))
    }
}

impl Read for SerialBootPort {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer)
    }
}

impl Write for SerialBootPort {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

impl BootPort for SerialBootPort {
    fn set_boot(&mut self, high: bool) -> io::Result<()> {
        Ok(self.0.write_data_terminal_ready(high)?)
    }

    fn set_reset(&mut self, held: bool) -> io::Result<()> {
        Ok(self.0.write_request_to_send(held)?)
    }

    fn wait(&mut self, time: Duration) {
        std::thread::sleep(time);
    }

    fn clear(&mut self) -> io::Result<()> {
        Ok(self.0.clear(ClearBuffer::Input)?)
    }
}
