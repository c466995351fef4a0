//! The serial protocol of the bootloader in an STM32's ROM (ST's AN3155): commands with their complement, addresses and data
//! with an exclusive-or sum, every step acknowledged.

use std::io::{self, ErrorKind, Read, Write};
use std::time::Duration;
use thiserror::Error;

const ACK: u8 = 0x79;
const NACK: u8 = 0x1F;
/// Tells the bootloader the bit rate.
const SYNC: u8 = 0x7F;

const GET: u8 = 0x00;
const GET_ID: u8 = 0x02;
const READ: u8 = 0x11;
const GO: u8 = 0x21;
const WRITE: u8 = 0x31;
const EXTENDED_ERASE: u8 = 0x44;

/// Most bytes that a read or write carries.
pub const CHUNK: usize = 256;

/// Bits a second: the most that AN2606 promises for these chips. Eight bits and even parity.
pub const BAUD: u32 = 115_200;

/// What the bootloader's line needs: reads that fail with `TimedOut` when nothing came for some 100 ms, and the two lines that
/// reset the chip into its bootloader.
pub trait BootPort: Read + Write {
    /// Drives BOOT0 (through DTR): high chooses the bootloader at the next reset.
    ///
    /// # Errors
    /// The port's.
    fn set_boot(&mut self, high: bool) -> io::Result<()>;

    /// Drives the reset (through RTS). Where a transistor joins the two lines it is only held while BOOT0 is chosen low, and
    /// ends as it is chosen high: a program that asserts both lines as it opens the port does not hold the board.
    ///
    /// # Errors
    /// The port's.
    fn set_reset(&mut self, held: bool) -> io::Result<()>;

    /// Lets a time pass.
    fn wait(&mut self, time: Duration);

    /// Throws away what was received and not read.
    ///
    /// # Errors
    /// The port's.
    fn clear(&mut self) -> io::Result<()>;
}

/// What went wrong between the PC and the bootloader.
#[derive(Debug, Error)]
pub enum BootloaderError {
    /// The port.
    #[error(
        "the connection is lost ({0}); plug the cable in again and repeat the command: it goes on where it stopped"
    )]
    Port(#[from] io::Error),
    /// No bootloader there.
    #[error(
        "no bootloader answers: hold BOOT0 at 3.3 V, press reset, and try again with --manual; and look at the port's name, and \
         that transmit and receive are not swapped"
    )]
    NoAnswer,
    /// It stopped answering.
    #[error("the bootloader stopped answering while it should {0}; repeat the command: it goes on where it stopped")]
    Silent(&'static str),
    /// It refused.
    #[error(
        "the bootloader refuses to {0}; the chip may be protected (remove the read-out protection with ST's programmer)"
    )]
    Refused(&'static str),
    /// It answered something else.
    #[error("an answer of 0x{answer:02x} where the bootloader should {what}: noise on the line, or another device")]
    Nonsense {
        /// What it should do.
        what: &'static str,
        /// The answer.
        answer: u8,
    },
    /// A bootloader that cannot erase sectors.
    #[error("this bootloader (version 0x{0:02x}) has no extended erase: no STM32F4")]
    Version(u8),
}

/// A bootloader that was heard.
#[derive(Debug)]
pub struct Bootloader<P> {
    port: P,
    /// Version of the bootloader, two digits.
    pub version: u8,
    /// Number of the chip.
    pub chip: u16,
}

/// Exclusive-or of all bytes.
fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, b| sum ^ b)
}

impl<P: BootPort> Bootloader<P> {
    /// Finds the bootloader; with `reset` it resets the chip into it first.
    ///
    /// # Errors
    /// Nobody answers, or another device does.
    pub fn connect(mut port: P, reset: bool) -> Result<Self, BootloaderError> {
        const TRIES: u32 = 5;
        for _ in 0..TRIES {
            if reset {
                // In this order for both wirings of docs/board.md: with DTR alone the reset of the one ends, with RTS that of
                // the other; BOOT0 is high at both.
                port.set_boot(false)?;
                port.set_reset(true)?;
                port.wait(Duration::from_millis(20));
                port.set_boot(true)?;
                port.wait(Duration::from_millis(1));
                port.set_reset(false)?;
                port.wait(Duration::from_millis(50));
            }
            port.clear()?;
            port.write_all(&[SYNC])?;
            port.flush()?;
            match answer(&mut port) {
                // One that was synchronised before takes the byte for half a command: the next one makes it whole, and wrong.
                Ok(Some(ACK | NACK)) => return Self::introduce(port),
                Ok(_) => {}
                Err(e) => return Err(e.into()),
            }
        }
        Err(BootloaderError::NoAnswer)
    }

    fn introduce(port: P) -> Result<Self, BootloaderError> {
        let mut this = Self {
            port,
            version: 0,
            chip: 0,
        };
        this.retried(|b| {
            b.command(GET, "say what it can do")?;
            let count = b.byte("say what it can do")?;
            b.version = b.byte("say what it can do")?;
            let mut commands = vec![0; count.into()];
            b.bytes(&mut commands, "say what it can do")?;
            b.acknowledged("say what it can do")?;
            if !commands.contains(&EXTENDED_ERASE) {
                return Err(BootloaderError::Version(b.version));
            }
            Ok(())
        })?;
        this.retried(|b| {
            b.command(GET_ID, "name the chip")?;
            let count = b.byte("name the chip")?;
            let mut id = vec![0; usize::from(count) + 1];
            b.bytes(&mut id, "name the chip")?;
            b.acknowledged("name the chip")?;
            b.chip = id.iter().fold(0, |id, b| id << 8 | u16::from(*b));
            Ok(())
        })?;
        Ok(this)
    }

    /// Tries a command up to three times: a byte damaged on the way is answered by NACK, or not at all.
    fn retried<T>(&mut self, mut f: impl FnMut(&mut Self) -> Result<T, BootloaderError>) -> Result<T, BootloaderError> {
        let mut last = Err(BootloaderError::NoAnswer);
        for _ in 0..3 {
            last = f(self);
            match &last {
                Err(BootloaderError::Silent(_) | BootloaderError::Refused(_) | BootloaderError::Nonsense { .. }) => {
                    self.resynchronise()?;
                }
                _ => return last,
            }
        }
        last
    }

    /// Ends whatever message the bootloader has half of: fills it up with bytes that make no sense, which it refuses, and then
    /// pairs of them, which are no command.
    fn resynchronise(&mut self) -> Result<(), BootloaderError> {
        self.port.wait(Duration::from_millis(20));
        for _ in 0..150 {
            self.port.write_all(&[0xFF; 64])?;
            self.port.flush()?;
            if answer(&mut self.port)?.is_some() {
                break;
            }
        }
        self.port.wait(Duration::from_millis(20));
        self.port.clear()?;
        // One byte may be left over as half of a command.
        for _ in 0..2 {
            self.port.write_all(&[0xFF])?;
            self.port.flush()?;
            if answer(&mut self.port)?.is_some() {
                break;
            }
        }
        self.port.clear()?;
        Ok(())
    }

    /// Reads memory.
    ///
    /// # Errors
    /// Refused (read-out protection), or the connection.
    pub fn read(&mut self, address: u32, out: &mut [u8]) -> Result<(), BootloaderError> {
        let mut at = address;
        for part in out.chunks_mut(CHUNK) {
            self.retried(|b| {
                const WHAT: &str = "read memory";
                b.command(READ, WHAT)?;
                b.address(at, WHAT)?;
                let count = (part.len() - 1) as u8;
                b.port.write_all(&[count, !count])?;
                b.acknowledged(WHAT)?;
                b.bytes(part, WHAT)
            })?;
            at += part.len() as u32;
        }
        Ok(())
    }

    /// Writes up to [`CHUNK`] bytes, a multiple of four, to erased memory.
    ///
    /// # Errors
    /// Refused (write protection), or the connection.
    pub fn write(&mut self, address: u32, data: &[u8]) -> Result<(), BootloaderError> {
        const WHAT: &str = "write memory";
        self.retried(|b| {
            b.command(WRITE, WHAT)?;
            b.address(address, WHAT)?;
            let mut message = vec![(data.len().clamp(1, CHUNK) - 1) as u8];
            message.extend_from_slice(data);
            message.push(sum(&message));
            b.port.write_all(&message)?;
            b.port.flush()?;
            b.acknowledged(WHAT)
        })
    }

    /// Erases one sector, which takes up to four seconds.
    ///
    /// # Errors
    /// Refused (write protection), or the connection.
    pub fn erase(&mut self, sector: u16) -> Result<(), BootloaderError> {
        const WHAT: &str = "erase a sector";
        self.retried(|b| {
            b.command(EXTENDED_ERASE, WHAT)?;
            let [high, low] = sector.to_be_bytes();
            let mut message = vec![0, 0, high, low];
            message.push(sum(&message));
            b.port.write_all(&message)?;
            b.port.flush()?;
            for _ in 0..60 {
                match answer(&mut b.port)? {
                    None => {}
                    Some(byte) => return judged(byte, WHAT),
                }
            }
            Err(BootloaderError::Silent(WHAT))
        })
    }

    /// Starts the program in flash memory: by a reset where the lines are wired, else by the bootloader.
    ///
    /// # Errors
    /// Refused, or the connection.
    pub fn start(&mut self, address: u32, reset: bool) -> Result<(), BootloaderError> {
        if reset {
            self.port.set_boot(false)?;
            self.port.set_reset(true)?;
            self.port.wait(Duration::from_millis(20));
            self.port.set_reset(false)?;
            return Ok(());
        }
        const WHAT: &str = "start the program";
        self.command(GO, WHAT)?;
        self.address(address, WHAT)
    }

    /// The port back.
    pub fn into_port(self) -> P {
        self.port
    }

    fn command(&mut self, command: u8, what: &'static str) -> Result<(), BootloaderError> {
        self.port.write_all(&[command, !command])?;
        self.port.flush()?;
        self.acknowledged(what)
    }

    fn address(&mut self, address: u32, what: &'static str) -> Result<(), BootloaderError> {
        let bytes = address.to_be_bytes();
        self.port.write_all(&bytes)?;
        self.port.write_all(&[sum(&bytes)])?;
        self.port.flush()?;
        self.acknowledged(what)
    }

    fn acknowledged(&mut self, what: &'static str) -> Result<(), BootloaderError> {
        judged(self.byte(what)?, what)
    }

    fn byte(&mut self, what: &'static str) -> Result<u8, BootloaderError> {
        let mut byte = [0];
        self.bytes(&mut byte, what)?;
        Ok(byte[0])
    }

    fn bytes(&mut self, out: &mut [u8], what: &'static str) -> Result<(), BootloaderError> {
        match self.port.read_exact(out) {
            Ok(()) => Ok(()),
            Err(e) if e.kind() == ErrorKind::TimedOut => Err(BootloaderError::Silent(what)),
            Err(e) => Err(e.into()),
        }
    }
}

fn judged(answer: u8, what: &'static str) -> Result<(), BootloaderError> {
    match answer {
        ACK => Ok(()),
        NACK => Err(BootloaderError::Refused(what)),
        answer => Err(BootloaderError::Nonsense { what, answer }),
    }
}

/// One byte, or `None` when none came in time.
fn answer(port: &mut impl Read) -> io::Result<Option<u8>> {
    let mut byte = [0];
    match port.read_exact(&mut byte) {
        Ok(()) => Ok(Some(byte[0])),
        Err(e) if e.kind() == ErrorKind::TimedOut => Ok(None),
        Err(e) => Err(e),
    }
}
