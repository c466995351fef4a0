//! The simulated board as a serial port that a program can read and write.

use crate::any_board::{AnyBoard, drain, locked};
use crate::board::SimBoard;
use crate::clock::samples;
use crate::real_time::{Running, TICK};
use crate::sheet::SheetModel;
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// How a simulated board's time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// With the wall clock, on a thread of its own: bytes leave at 1 Mbit/s.
    RealTime,
    /// As fast as somebody reads, without a thread. Time passes in reads only, and stands still while the board is idle: the
    /// same commands give the same bytes however slow the reader is.
    Unpaced,
}

/// A serial port with a simulated board behind it. Reads wait for the first byte until the time-out, then fail with
/// [`ErrorKind::TimedOut`]; writes never wait. Clones are the same port. The board is switched off with the last one.
/// Once the cable was pulled, reads and writes fail with [`ErrorKind::BrokenPipe`], until it is opened anew.
#[derive(Clone)]
pub struct SimPort {
    engine: Engine,
    timeout: Duration,
    /// How often the cable had been put back when it was opened.
    plug: u32,
}

#[derive(Clone)]
enum Engine {
    RealTime(Arc<Running>),
    Unpaced(Arc<Mutex<Lazy>>),
}

impl SimPort {
    /// Powers a board up behind a port. The time-out is 100 ms: wall time, or simulated time without pace.
    ///
    /// # Errors
    /// The thread cannot be started.
    pub fn new<S: SheetModel + 'static>(board: SimBoard<S>, pace: Pace) -> io::Result<Self> {
        let board: Box<dyn AnyBoard> = Box::new(board);
        let engine = match pace {
            Pace::RealTime => Engine::RealTime(Arc::new(Running::start(board)?)),
            Pace::Unpaced => Engine::Unpaced(Arc::new(Mutex::new(Lazy {
                plugged: board.plugged(),
                board,
                out: VecDeque::new(),
            }))),
        };
        Ok(Self {
            engine,
            timeout: Duration::from_millis(100),
            plug: 0,
        })
    }

    /// Opens the port anew, as a program does that has found it dead.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`] while the cable is pulled.
    pub fn reopen(&self) -> io::Result<Self> {
        let plugged = match &self.engine {
            Engine::RealTime(running) => running.pipes.plugged(),
            Engine::Unpaced(lazy) => locked(lazy).reopen(),
        };
        Ok(Self {
            plug: plugged.ok_or(ErrorKind::NotFound)?,
            ..self.clone()
        })
    }

    /// Begins the scene of a board that [holds](SimBoard::holding_scene) it: now, or with a real-time board's next tick.
    pub fn begin_scene(&self) {
        match &self.engine {
            Engine::RealTime(running) => running.pipes.begin_scene(),
            Engine::Unpaced(lazy) => locked(lazy).board.begin_scene(),
        }
    }

    /// True time at which the scene began, s since power-up; `None` while it is held.
    pub fn scene_began_s(&self) -> Option<f64> {
        match &self.engine {
            Engine::RealTime(running) => running.pipes.scene_began_s(),
            Engine::Unpaced(lazy) => locked(lazy).board.scene_began_s(),
        }
    }

    /// How long a read waits for its first byte.
    pub fn set_timeout(&mut self, timeout: Duration) {
        self.timeout = timeout;
    }
}

impl Read for SimPort {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        match &self.engine {
            Engine::RealTime(running) => running.pipes.read(buffer, self.timeout, self.plug),
            Engine::Unpaced(lazy) => locked(lazy).read(buffer, self.timeout, self.plug),
        }
    }
}

impl Write for SimPort {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &self.engine {
            Engine::RealTime(running) => running.pipes.write(bytes, self.plug),
            Engine::Unpaced(lazy) => {
                let mut lazy = locked(lazy);
                lazy.look(self.plug)?;
                lazy.board.receive(bytes);
                Ok(bytes.len())
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A board that runs when it is read.
struct Lazy {
    board: Box<dyn AnyBoard>,
    out: VecDeque<u8>,
    /// How often the cable was put back when somebody last looked; `None` while it was pulled.
    plugged: Option<u32>,
}

impl Lazy {
    /// Fails where the cable was pulled; what was under way is lost.
    fn look(&mut self, plug: u32) -> io::Result<()> {
        let plugged = self.board.plugged();
        if plugged != self.plugged {
            self.plugged = plugged;
            self.out.clear();
        }
        if plugged == Some(plug) {
            Ok(())
        } else {
            Err(ErrorKind::BrokenPipe.into())
        }
    }

    /// Looks whether the cable is back, which takes a moment.
    fn reopen(&mut self) -> Option<u32> {
        if self.board.plugged().is_none() {
            self.board.step(&mut self.out);
            self.out.clear();
        }
        self.board.plugged()
    }

    fn read(&mut self, buffer: &mut [u8], timeout: Duration, plug: u32) -> io::Result<usize> {
        self.look(plug)?;
        let end = self.board.now() + samples(timeout.as_secs_f64());
        while self.out.is_empty() {
            if self.board.is_idle() {
                // Waiting would not help; do not let a reader's loop spin either.
                std::thread::sleep(TICK.min(timeout));
                return Err(ErrorKind::TimedOut.into());
            }
            if self.board.now() >= end {
                return Err(ErrorKind::TimedOut.into());
            }
            self.board.step(&mut self.out);
            self.look(plug)?;
        }
        Ok(drain(&mut self.out, buffer))
    }
}
