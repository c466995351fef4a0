//! Where a recording's bytes go: whole steps at a time, and a file that stays well closed where the disk is full.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A file, or what stands for one. Writes go to its end.
pub trait Target: Write {
    /// Cuts it to a length.
    ///
    /// # Errors
    /// What the system said.
    fn cut(&mut self, length: u64) -> io::Result<()>;
    /// What was written survives a power cut from now on.
    ///
    /// # Errors
    /// What the system said.
    fn settle(&mut self) -> io::Result<()>;
}

impl Target for File {
    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)?;
        self.seek(SeekFrom::End(0)).map(|_| ())
    }

    fn settle(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

/// Data end, footer without a summary, magic: what closes a file that is to have no index.
fn ending() -> Vec<u8> {
    let mut out = vec![mcap::records::op::DATA_END];
    out.extend(4_u64.to_le_bytes());
    out.extend([0; 4]);
    out.push(mcap::records::op::FOOTER);
    out.extend(20_u64.to_le_bytes());
    out.extend([0; 20]);
    out.extend(mcap::MAGIC);
    out
}

/// Collects bytes until a flush, which writes them at once: then the file is a whole one but for its end. Clones are the same sink,
/// since the library hands its own out at the end only.
#[derive(Debug)]
pub(crate) struct Sink<T>(Arc<Mutex<Inner<T>>>);

#[derive(Debug)]
struct Inner<T> {
    target: T,
    waiting: Vec<u8>,
    /// Bytes of the target after the last flush, and after the one before.
    whole: u64,
    before: u64,
    /// Nothing is written any more.
    closed: bool,
}

impl<T> Clone for Sink<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T: Target> Sink<T> {
    pub(crate) fn new(target: T) -> Self {
        Self(Arc::new(Mutex::new(Inner {
            target,
            waiting: Vec::new(),
            whole: 0,
            before: 0,
            closed: false,
        })))
    }

    fn inner(&self) -> MutexGuard<'_, Inner<T>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes what was flushed survive a power cut.
    pub(crate) fn settle(&self) -> io::Result<()> {
        self.inner().target.settle()
    }

    /// Bytes that are in the file.
    pub(crate) fn len(&self) -> u64 {
        self.inner().whole
    }

    /// Closes the file after its last whole step, or the one before where there is no room for even that. What is written later
    /// is thrown away.
    pub(crate) fn close_short(&self) -> io::Result<()> {
        let inner = &mut *self.inner();
        inner.closed = true;
        inner.waiting.clear();
        let mut outcome = Ok(());
        for length in [inner.whole, inner.before] {
            outcome = inner
                .target
                .cut(length)
                .and_then(|()| inner.target.write_all(&ending()));
            if outcome.is_ok() {
                break;
            }
        }
        outcome
    }
}

impl<T: Target> Write for Sink<T> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut inner = self.inner();
        if !inner.closed {
            inner.waiting.extend_from_slice(bytes);
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let inner = &mut *self.inner();
        if inner.waiting.is_empty() {
            return Ok(());
        }
        inner.target.write_all(&inner.waiting)?;
        inner.before = inner.whole;
        inner.whole += inner.waiting.len() as u64;
        inner.waiting.clear();
        Ok(())
    }
}

/// Only tells where it is: the format is written from its beginning to its end.
impl<T: Target> Seek for Sink<T> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let inner = self.inner();
        match to {
            SeekFrom::Current(0) => Ok(inner.whole + inner.waiting.len() as u64),
            _ => Err(io::ErrorKind::Unsupported.into()),
        }
    }
}

#[cfg(test)]
pub(crate) mod full_disk {
    use super::*;

    /// A disk with so much room.
    #[derive(Clone, Debug, Default)]
    pub(crate) struct Disk {
        pub(crate) bytes: Arc<Mutex<Vec<u8>>>,
        pub(crate) room: usize,
    }

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let mut held = self.bytes.lock().unwrap();
            let fits = bytes.len().min(self.room - held.len().min(self.room));
            if fits == 0 && !bytes.is_empty() {
                return Err(io::ErrorKind::StorageFull.into());
            }
            held.extend_from_slice(&bytes[..fits]);
            Ok(fits)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Target for Disk {
        fn cut(&mut self, length: u64) -> io::Result<()> {
            self.bytes.lock().unwrap().truncate(length as usize);
            Ok(())
        }

        fn settle(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
}
