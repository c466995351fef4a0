//! Router, capture and excitation by remote call. Requests have eight bytes, replies sixteen and then the samples; numbers are
//! little-endian. `tests/tests/emulated.rs` has the other end.

use crate::pipe::{Pipe, PipeError};
use firmware::{
    Block, Capture, ErrorKind, ErrorType, Excitation, MAX_CHANNELS, Rails, Route, Router, SAMPLES_PER_PERIOD, Sense,
    Window,
};

/// Samples of the largest block: one period of all channels.
const SAMPLES: usize = MAX_CHANNELS * SAMPLES_PER_PERIOD;

/// A front end on the PC.
#[derive(Debug)]
pub struct RemoteFrontEnd {
    pipe: Pipe,
    block: [u16; SAMPLES],
}

impl RemoteFrontEnd {
    /// Opens the pipes.
    ///
    /// # Errors
    /// There are none.
    pub fn open() -> Result<Self, PipeError> {
        Ok(Self {
            pipe: Pipe::open()?,
            block: [0; SAMPLES],
        })
    }

    /// Lets more time pass than the front end has room for blocks.
    ///
    /// # Errors
    /// The PC closed its end.
    pub fn stall(&mut self) -> Result<(), ErrorKind> {
        self.call([b'S', 0, 0, 0, 0, 0, 0, 0]).map(drop)
    }

    /// A call and the head of its reply. The reply's first byte says how it went.
    fn call(&mut self, request: [u8; 8]) -> Result<[u8; 16], ErrorKind> {
        let mut reply = [0; 16];
        self.pipe
            .write(&request)
            .and_then(|()| self.pipe.read(&mut reply))
            .map_err(|PipeError| ErrorKind::Other)?;
        match reply[0] {
            b'+' => Ok(reply),
            b'O' => Err(ErrorKind::Overrun),
            b'R' => Err(ErrorKind::Route),
            _ => Err(ErrorKind::Other),
        }
    }
}

impl ErrorType for RemoteFrontEnd {
    type Error = ErrorKind;
}

impl Router for RemoteFrontEnd {
    fn select(&mut self, route: &Route) -> Result<(), ErrorKind> {
        let (all, a, b) = match route.sense {
            Sense::One(pair) => (0, pair.plus, pair.minus),
            Sense::All { step } => (1, step, 0),
            Sense::Source => (2, 0, 0),
        };
        let request = [b'R', route.drive.plus, route.drive.minus, all, a, b, route.gain, 0];
        self.call(request).map(drop)
    }
}

impl Excitation for RemoteFrontEnd {
    fn switch_on(&mut self) -> Result<(), ErrorKind> {
        self.call([b'E', 1, 0, 0, 0, 0, 0, 0]).map(drop)
    }

    fn set_amplitude(&mut self, permille: u16) -> Result<(), ErrorKind> {
        let [p0, p1] = permille.to_le_bytes();
        self.call([b'A', p0, p1, 0, 0, 0, 0, 0]).map(drop)
    }

    fn switch_off(&mut self) -> Result<(), ErrorKind> {
        self.call([b'E', 0, 0, 0, 0, 0, 0, 0]).map(drop)
    }
}

impl Capture for RemoteFrontEnd {
    fn begin(&mut self, window: Window) -> Result<(), ErrorKind> {
        let [s0, s1] = window.settle_quarters.to_le_bytes();
        let [p0, p1] = window.periods.to_le_bytes();
        self.call([b'W', window.channels, s0, s1, p0, p1, 0, 0]).map(drop)
    }

    fn poll_block<R>(&mut self, f: impl FnOnce(&Block<'_>) -> R) -> nb::Result<R, ErrorKind> {
        let head = self.call([b'B', 0, 0, 0, 0, 0, 0, 0]).map_err(nb::Error::Other)?;
        let [_, channels, n0, n1, s0, s1, s2, s3, time @ ..] = head;
        let count = usize::from(u16::from_le_bytes([n0, n1]));
        if count == 0 {
            return Err(nb::Error::WouldBlock);
        }
        let samples = self.block.get_mut(..count).ok_or(nb::Error::Other(ErrorKind::Other))?;
        for row in samples.chunks_mut(64) {
            let mut bytes = [0; 128];
            let bytes = bytes.get_mut(..2 * row.len()).unwrap_or_default();
            self.pipe
                .read(bytes)
                .map_err(|PipeError| nb::Error::Other(ErrorKind::Other))?;
            for (sample, pair) in row.iter_mut().zip(bytes.as_chunks().0) {
                *sample = u16::from_le_bytes(*pair);
            }
        }
        Ok(f(&Block {
            samples,
            channels,
            sequence: u32::from_le_bytes([s0, s1, s2, s3]),
            time: u64::from_le_bytes(time),
            rails: Rails::Unknown,
        }))
    }
}
