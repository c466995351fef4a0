//! Recordings that begin and end while a port is open.

use crate::tap::Tap;
use std::io::{self, Read, Write};
use std::sync::{Arc, Mutex, PoisonError};

/// Between a port and the link: hands over what passes to the tap that is set now, if one is. Clones are the same switch.
#[derive(Clone, Default)]
pub struct Switch {
    tap: Arc<Mutex<Option<Tap>>>,
}

impl Switch {
    /// What passes from now on goes to this tap, or to none.
    pub fn set(&self, tap: Option<Tap>) {
        *self.tap.lock().unwrap_or_else(PoisonError::into_inner) = tap;
    }

    /// A port whose bytes are recorded, both ways, while a tap is set.
    pub fn port<P>(&self, port: P) -> Switched<P> {
        self.with(Tap::opened);
        Switched {
            port,
            switch: self.clone(),
        }
    }

    fn with(&self, tell: impl FnOnce(&Tap)) {
        if let Some(tap) = &*self.tap.lock().unwrap_or_else(PoisonError::into_inner) {
            tell(tap);
        }
    }
}

/// A port whose bytes are recorded while a tap is set.
pub struct Switched<P> {
    port: P,
    switch: Switch,
}

impl<P: Read> Read for Switched<P> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.port.read(buffer)?;
        if count > 0 {
            self.switch.with(|tap| tap.bytes(true, &buffer[..count]));
        }
        Ok(count)
    }
}

impl<P: Write> Write for Switched<P> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.port.write(bytes)?;
        self.switch.with(|tap| tap.bytes(false, &bytes[..count]));
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.port.flush()
    }
}
