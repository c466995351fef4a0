//! Two named pipes in QEMU's working directory, by semihosting calls.

use cortex_m_semihosting::syscall;

/// A call to the PC failed, or the PC closed its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PipeError;

/// Both directions.
#[derive(Debug)]
pub struct Pipe {
    to: usize,
    from: usize,
}

/// Semihosting's numbers for the modes "rb" and "wb".
const READ: usize = 1;
const WRITE: usize = 5;

fn open(name: &[u8], mode: usize) -> Result<usize, PipeError> {
    // SAFETY: the call reads the name up to its zero, all inside `name`, and nothing after it has returned.
    let handle = unsafe { syscall!(OPEN, name.as_ptr(), mode, name.len() - 1) };
    if handle == usize::MAX {
        Err(PipeError)
    } else {
        Ok(handle)
    }
}

impl Pipe {
    /// Opens `front-end.request` for writing, then `front-end.reply` for reading. Waits until the PC has them open too.
    ///
    /// # Errors
    /// There are no such pipes.
    pub fn open() -> Result<Self, PipeError> {
        let to = open(b"front-end.request\0", WRITE)?;
        let from = open(b"front-end.reply\0", READ)?;
        Ok(Self { to, from })
    }

    /// Sends all bytes.
    ///
    /// # Errors
    /// The PC closed its end.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), PipeError> {
        // SAFETY: the call reads `bytes.len()` bytes from `bytes`, and nothing after it has returned. It returns how many bytes
        // were not written.
        let left = unsafe { syscall!(WRITE, self.to, bytes.as_ptr(), bytes.len()) };
        if left == 0 { Ok(()) } else { Err(PipeError) }
    }

    /// Fills the buffer.
    ///
    /// # Errors
    /// The PC closed its end.
    pub fn read(&mut self, mut buffer: &mut [u8]) -> Result<(), PipeError> {
        while !buffer.is_empty() {
            // SAFETY: the call writes at most `buffer.len()` bytes to the buffer, which is borrowed mutably, and nothing after it has
            // returned. It returns how many it left unread.
            let left = unsafe { syscall!(READ, self.from, buffer.as_mut_ptr(), buffer.len()) };
            let taken = buffer.len().checked_sub(left).filter(|n| *n > 0).ok_or(PipeError)?;
            buffer = buffer.get_mut(taken..).ok_or(PipeError)?;
        }
        Ok(())
    }
}
