//! Serial ports where a board may be, and how one is opened, now and after it was gone: by its name, or as `tcp://HOST:PORT` behind
//! a bridge.

use crate::port::{Port, Reopen};
pub use crate::usb::{UsbPort, left_alone, usb_ports};
#[cfg(unix)]
use rustix::event::{PollFd, PollFlags, Timespec, poll};
#[cfg(unix)]
use rustix::fs::OFlags;
#[cfg(unix)]
use std::fs::File;
use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
#[cfg(unix)]
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::Duration;

/// Bits a second on the board's serial line.
pub const BAUD: u32 = 1_000_000;
/// How long a read waits for bytes.
const READ_WAIT: Duration = Duration::from_millis(20);
/// How long a bridge may take to accept a connection, or to take a command.
const BRIDGE_WAIT: Duration = Duration::from_secs(1);
/// What the name of a port behind a bridge begins with.
const TCP: &str = "tcp://";

/// Where a board is: a serial port, or a bridge to one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    path: String,
    /// The adapter, where it can be told from others by a serial number.
    usb: Option<UsbPort>,
}

impl Place {
    /// That of a port's name: `/dev/ttyUSB0`, a link to it, `COM3`, or `tcp://HOST:PORT`.
    pub fn of(path: &str) -> Self {
        let ports = usb_ports().unwrap_or_default();
        let usb = ports.into_iter().find(|p| p.serial.is_some() && is_of(&p.path, path));
        let path = path.to_owned();
        Self { path, usb }
    }

    /// Its name.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Opens it.
    ///
    /// # Errors
    /// As [`open`].
    pub fn open(&self) -> Result<Box<dyn Port>, String> {
        let Some(usb) = &self.usb else {
            return open(&self.path);
        };
        open(&moved(usb, &usb_ports().map_err(|e| e.to_string())?)?)
    }

    /// Opens it again whenever it is asked: by the adapter's serial number whatever the port is called now, else by the port's name.
    pub fn reopen(&self) -> Reopen {
        let place = self.clone();
        Box::new(move || place.open())
    }
}

/// Whether a name is that of a port: on Windows in any case (`com10`), elsewhere also by links.
fn is_of(port: &str, name: &str) -> bool {
    if cfg!(windows) {
        // To look where it leads to would open the port there.
        return name.trim_start_matches(r"\\.\").eq_ignore_ascii_case(port);
    }
    std::fs::canonicalize(name).is_ok_and(|target| target == Path::new(port)) || name == port
}

/// What the port of an adapter is called now. An adapter with several ports has one serial number: then the name counts too.
fn moved(usb: &UsbPort, ports: &[UsbPort]) -> Result<String, String> {
    let same = |p: &&UsbPort| (p.vendor, p.product, &p.serial) == (usb.vendor, usb.product, &usb.serial);
    let found: Vec<&UsbPort> = ports.iter().filter(same).collect();
    let named = found.iter().find(|p| p.path == usb.path);
    let port = named.or(found.first()).map(|p| p.path.clone());
    port.ok_or_else(|| {
        let serial = usb.serial.as_deref().unwrap_or_default();
        format!("the adapter {serial} is not there")
    })
}

/// Opens a port for a [`crate::Link`]. Where its DTR and RTS are wired to a board's BOOT0 and reset (see docs/board.md), the
/// board runs its program afterwards: systems assert both lines when they open a port. A bridge has no such lines.
///
/// # Errors
/// The system's, with what to do about it.
pub fn open(path: &str) -> Result<Box<dyn Port>, String> {
    if let Some(address) = path.strip_prefix(TCP) {
        let bridge = bridge(address).map_err(|e| {
            format!(
                "{path}: {e}; look at the address (tcp://HOST:PORT), and whether the bridge runs there (ser2net, socat)"
            )
        })?;
        return Ok(Box::new(bridge));
    }
    // First, because afterwards the port is held.
    #[cfg(unix)]
    let reader = Reader::open(path);
    let mut port = serialport::new(path, BAUD)
        .timeout(READ_WAIT)
        .open()
        .map_err(|e| explained(path, &e))?;
    // BOOT0 first, so that the reset that ends with the other finds it low. A port without these lines needs neither.
    let _ = port.write_data_terminal_ready(false);
    let _ = port.write_request_to_send(false);
    Ok(Box::new(SerialPort {
        #[cfg(unix)]
        reader: reader.map_err(|e| explained(path, &e.into()))?,
        port,
    }))
}

/// Whether a port's name is that of a bridge.
pub(crate) fn is_bridge(path: &str) -> bool {
    path.starts_with(TCP)
}

fn bridge(address: &str) -> io::Result<TcpStream> {
    let mut refused = io::Error::new(io::ErrorKind::NotFound, "no such host");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, BRIDGE_WAIT) {
            Ok(stream) => {
                // Commands are short, and are to leave at once.
                stream.set_nodelay(true)?;
                stream.set_read_timeout(Some(READ_WAIT))?;
                stream.set_write_timeout(Some(BRIDGE_WAIT))?;
                return Ok(stream);
            }
            Err(e) => refused = e,
        }
    }
    Err(refused)
}

/// What helps where a port that a board is on is not found, or is held by another program; one line each.
pub fn hints() -> &'static [&'static str] {
    if cfg!(target_os = "linux") {
        &[
            "ModemManager opens every new port for some seconds: contrib/70-skin.rules keeps it away",
            "brltty takes CP210x and some FTDI adapters for braille displays and removes their port: `sudo apt remove brltty`, or mask its udev rule",
        ]
    } else {
        &[]
    }
}

/// Why a port did not open, and what to do about it.
pub(crate) fn explained(path: &str, error: &serialport::Error) -> String {
    let text = error.to_string();
    let help = match error.kind() {
        // A lock of another program, or of the system for one.
        serialport::ErrorKind::NoDevice if text.contains("lock") || text.contains("busy") => {
            if cfg!(target_os = "linux") {
                "another program holds the port: end it, or name another port; ModemManager does so for some seconds after a board is plugged in (contrib/70-skin.rules keeps it away)"
            } else {
                "another program holds the port: end it, or name another port"
            }
        }
        // Windows says both the same way.
        serialport::ErrorKind::NoDevice if cfg!(windows) => {
            "there is no such port, or another program holds it: look at the cable and at the name; skin list shows what there is"
        }
        serialport::ErrorKind::NoDevice | serialport::ErrorKind::Io(io::ErrorKind::NotFound) => {
            "there is no such port: look at the cable and at the name; skin list shows what there is"
        }
        serialport::ErrorKind::Io(io::ErrorKind::PermissionDenied) if cfg!(target_os = "linux") => {
            "add yourself to the group that owns the port (`sudo usermod -aG dialout $USER`) and log in again, or install contrib/70-skin.rules"
        }
        serialport::ErrorKind::Io(io::ErrorKind::PermissionDenied) => {
            "the system refuses it to you: look at the port's rights"
        }
        _ => "is it a serial port?",
    };
    format!("{path}: {text}; {help}")
}

/// A serial port as a plain stream of bytes.
struct SerialPort {
    #[cfg(unix)]
    reader: Reader,
    port: Box<dyn serialport::SerialPort>,
}

/// What a port is read by: a descriptor of its own, whose reads never block. Those of `serialport` wait for a byte, without end, once
/// the system has said that there is one. Where another program took it, or the terminal's mode was changed, none may come.
#[cfg(unix)]
struct Reader(File);

#[cfg(unix)]
impl Reader {
    fn open(path: &str) -> io::Result<Self> {
        let flags = OFlags::NOCTTY | OFlags::NONBLOCK;
        let flags = flags.bits().cast_signed();
        File::options().read(true).custom_flags(flags).open(path).map(Self)
    }
}

#[cfg(unix)]
impl Read for Reader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let wait = Timespec::try_from(READ_WAIT).map_err(io::Error::other)?;
        let mut list = [PollFd::new(&self.0, PollFlags::IN)];
        poll(&mut list, Some(&wait))?;
        let seen = list[0].revents();
        if seen.is_empty() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        let gone = seen.intersects(PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL);
        match self.0.read(buffer)? {
            // Other programs set terminals so that a read finds nothing instead of failing.
            0 if !gone => Err(io::ErrorKind::TimedOut.into()),
            count => Ok(count),
        }
    }
}

impl Read for SerialPort {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        #[cfg(unix)]
        return self.reader.read(buffer);
        #[cfg(not(unix))]
        self.port.read(buffer)
    }
}

impl Write for SerialPort {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.port.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.port.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn port(path: &str, product: u16, serial: &str) -> UsbPort {
        UsbPort {
            path: path.to_owned(),
            vendor: 0x0403,
            product,
            serial: Some(serial.to_owned()),
            name: None,
            likely: true,
        }
    }

    #[test]
    fn an_adapter_is_found_by_its_serial_number_whatever_its_port_is_called() {
        let mine = port("/dev/ttyUSB0", 0x6010, "A7");
        let other = port("/dev/ttyUSB0", 0x6010, "B8");
        let again = port("/dev/ttyUSB3", 0x6010, "A7");
        let second = port("/dev/ttyUSB4", 0x6010, "A7");
        assert_eq!(moved(&mine, &[other.clone(), again.clone()]).unwrap(), "/dev/ttyUSB3");
        assert_eq!(moved(&second, &[again, second.clone()]).unwrap(), "/dev/ttyUSB4");
        assert!(moved(&mine, &[other, port("/dev/ttyUSB0", 0x6001, "A7")]).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn a_port_is_known_by_a_link_too() {
        let folder = tempfile::tempdir().unwrap();
        let (port, link) = (folder.path().join("ttyUSB0"), folder.path().join("palm"));
        std::fs::write(&port, "").unwrap();
        std::os::unix::fs::symlink(&port, &link).unwrap();
        let port = std::fs::canonicalize(port).unwrap();
        let is_of = |name: &Path| is_of(port.to_str().unwrap(), name.to_str().unwrap());
        assert!(is_of(&link) && is_of(&port));
        assert!(!is_of(&folder.path().join("ttyUSB1")) && !is_of(folder.path()));
    }

    /// Two who read one port are told both that there is a byte. Who comes second must not wait for the next, which here never comes.
    #[cfg(unix)]
    #[test]
    fn a_read_ends_though_another_program_took_the_bytes() {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        use rustix::termios::{OptionalActions, SpecialCodeIndex, tcgetattr, tcsetattr};
        use std::io::ErrorKind;
        use std::sync::{Arc, atomic::AtomicU32, atomic::Ordering::Relaxed};
        use std::time::Instant;

        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let path = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
        let mut other = Reader::open(&path).unwrap();
        let mut port = open(&path).unwrap();
        let is_open = |read: io::Result<usize>| match read {
            Ok(count) => count > 0,
            Err(e) => matches!(
                e.kind(),
                ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
            ),
        };
        std::thread::spawn(move || while is_open(other.read(&mut [0; 64])) {});
        let reads = Arc::new(AtomicU32::new(0));
        let counted = Arc::clone(&reads);
        std::thread::spawn(move || {
            while is_open(port.read(&mut [0; 64])) {
                counted.fetch_add(1, Relaxed);
            }
        });
        // Some programs set terminals so that a read without a byte gives none, at once: no end of the port either.
        for round in 0..200 {
            if round == 100 {
                let mut settings = tcgetattr(&master).unwrap();
                settings.special_codes[SpecialCodeIndex::VMIN] = 0;
                tcsetattr(&master, OptionalActions::Now, &settings).unwrap();
            }
            rustix::io::write(&master, b"f").unwrap();
            let (before, since) = (reads.load(Relaxed), Instant::now());
            while reads.load(Relaxed) < before + 2 {
                assert!(since.elapsed() < Duration::from_secs(60), "read {before} does not end");
                std::thread::sleep(Duration::from_millis(1));
            }
        }
    }

    #[test]
    fn a_port_that_another_program_holds_is_said_to_be_held() {
        for text in [
            "Device or resource busy",
            "Unable to acquire exclusive lock on serial port",
        ] {
            let error = serialport::Error::new(serialport::ErrorKind::NoDevice, text);
            let said = explained("/dev/ttyUSB0", &error);
            assert!(said.contains("another program holds the port"), "{said}");
        }
    }

    #[test]
    fn a_bridge_that_is_not_there_is_said_with_what_to_do() {
        for path in ["tcp://127.0.0.1:1", "tcp://127.0.0.1", "tcp://"] {
            let error = open(path).err().unwrap();
            assert!(error.starts_with(path) && error.contains("tcp://HOST:PORT"), "{error}");
        }
    }
}
