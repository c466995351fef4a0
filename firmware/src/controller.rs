//! The board's one loop: commands in, frames out.

use crate::board_info::BoardInfo;
use crate::front_end::{Error, ErrorKind, FrontEnd};
use crate::outbox::Outbox;
use crate::scan::{Progress, Scan, ScanError};
use embedded_hal_nb::serial::{Read, Write};
use protocol::{
    BoardError, Command, Counters, Decoder, FromBoard, FrontEndFault, Hello, MAX_TO_BOARD_LEN, Plan, PlanError, ToBoard,
};

/// Messages that can wait for the link: 50 ms of frames at full speed.
const QUEUE: usize = 6;

/// Most bytes of commands taken in one poll, so that a flood of them cannot starve the scan.
const BYTES_A_POLL: usize = 64;

/// Whether a poll found anything to do. A board may sleep until the next interrupt when it did not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// Nothing to do until a block is complete, a byte arrives or the transmitter has room.
    Idle,
    /// Something was done; poll again.
    Busy,
}

/// The whole firmware above the chip: a front end, a serial port, and what is between them.
#[derive(Debug)]
pub struct Controller<F, L> {
    hello: Hello,
    front: F,
    link: L,
    decoder: Decoder<MAX_TO_BOARD_LEN>,
    outbox: Outbox<QUEUE>,
    scan: Scan,
    counters: Counters,
    sequence: u32,
    running: bool,
}

impl<F: FrontEnd, L: Read<u8> + Write<u8>> Controller<F, L> {
    /// A board that is not scanning yet and will by default measure by `plan`. Its first message is its [`Hello`]: a
    /// program that is listening sees that the board was started anew.
    ///
    /// # Errors
    /// The board cannot carry `plan` out.
    pub fn new(info: &BoardInfo<'_>, plan: Plan, front: F, link: L) -> Result<Self, PlanError> {
        let hello = info.hello();
        let scan = Scan::new(plan, &hello)?;
        let mut this = Self {
            hello,
            front,
            link,
            decoder: Decoder::new(),
            outbox: Outbox::new(),
            scan,
            counters: Counters::default(),
            sequence: 0,
            running: false,
        };
        let hello = FromBoard::Hello(this.hello.clone());
        this.send(&hello);
        Ok(this)
    }

    /// Does what can be done now and returns; never waits.
    ///
    /// Deadline while scanning: once for every block of samples, before the front end runs out of room for blocks. A
    /// missed deadline is an overrun: that frame is lost, counted, and seen by the receiver as a gap in the sequence.
    pub fn poll(&mut self) -> Activity {
        let received = self.receive();
        let scanned = self.running && self.scan();
        let sent = match self.outbox.pump(&mut self.link) {
            Ok(bytes) => bytes > 0,
            Err(_) => {
                Counters::add(&mut self.counters.transmit_errors, 1);
                true
            }
        };
        if received || scanned || sent {
            Activity::Busy
        } else {
            Activity::Idle
        }
    }

    /// Whether frames are being measured.
    pub fn running(&self) -> bool {
        self.running
    }

    /// Whether nothing will be sent until a command comes: no scan, and nothing waiting for the link.
    pub fn is_quiet(&self) -> bool {
        !self.running && self.outbox.is_empty()
    }

    /// What was counted so far.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Who the board says it is.
    pub fn hello(&self) -> &Hello {
        &self.hello
    }

    /// The front end.
    pub fn front_mut(&mut self) -> &mut F {
        &mut self.front
    }

    /// The serial port.
    pub fn link_mut(&mut self) -> &mut L {
        &mut self.link
    }

    fn send(&mut self, message: &FromBoard) {
        let dropped = self.outbox.push(message);
        Counters::add(&mut self.counters.dropped, dropped);
    }

    fn receive(&mut self) -> bool {
        for taken in 0..BYTES_A_POLL {
            match self.link.read() {
                Ok(byte) => match self.decoder.push_byte::<ToBoard>(byte) {
                    None => {}
                    Some(Ok(command)) => {
                        Counters::add(&mut self.counters.commands, 1);
                        self.obey(command);
                    }
                    Some(Err(e)) => self.refuse(BoardError::Command(e)),
                },
                Err(nb::Error::WouldBlock) => return taken > 0,
                Err(nb::Error::Other(_)) => {
                    Counters::add(&mut self.counters.receive_errors, 1);
                    return true;
                }
            }
        }
        true
    }

    fn refuse(&mut self, error: BoardError) {
        Counters::add(&mut self.counters.refused, 1);
        self.send(&FromBoard::Error(error));
    }

    fn obey(&mut self, command: ToBoard) {
        let answer = match command {
            ToBoard::Hello => FromBoard::Hello(self.hello.clone()),
            ToBoard::Start => {
                if !self.running {
                    if let Err(e) = self.front.switch_on() {
                        return self.fail(e.kind());
                    }
                    self.scan.restart();
                    self.running = true;
                }
                FromBoard::Ack(Command::Start)
            }
            ToBoard::Stop => {
                self.running = false;
                if let Err(e) = self.front.switch_off() {
                    return self.fail(e.kind());
                }
                FromBoard::Ack(Command::Stop)
            }
            ToBoard::SetPlan(plan) => match Scan::new(plan, &self.hello) {
                Ok(scan) => {
                    self.scan = scan;
                    FromBoard::Plan(self.scan.plan().clone())
                }
                Err(e) => return self.refuse(BoardError::Plan(e)),
            },
            ToBoard::GetPlan => FromBoard::Plan(self.scan.plan().clone()),
            ToBoard::GetCounters => FromBoard::Counters(self.counters.clone()),
            ToBoard::ResetCounters => {
                self.counters = Counters::default();
                FromBoard::Ack(Command::ResetCounters)
            }
        };
        self.send(&answer);
    }

    /// One step of the scan; whether it did anything.
    fn scan(&mut self) -> bool {
        match self.scan.step(&mut self.front) {
            Ok(Progress::Working) => {}
            Ok(Progress::Complete) => {
                if let Some(frame) = self.scan.take(self.sequence) {
                    self.sequence = self.sequence.wrapping_add(1);
                    Counters::add(&mut self.counters.frames, 1);
                    Counters::add(&mut self.counters.clipped, frame.clipped.count());
                    self.send(&FromBoard::Frame(frame));
                }
            }
            Err(nb::Error::WouldBlock) => return false,
            Err(nb::Error::Other(e)) => {
                // The frame under way is lost: its number is never sent.
                self.sequence = self.sequence.wrapping_add(1);
                self.scan.restart();
                match e {
                    ScanError::FrontEnd(e) if e.kind() == ErrorKind::Overrun => {
                        Counters::add(&mut self.counters.overruns, 1);
                    }
                    ScanError::FrontEnd(e) => self.fail(e.kind()),
                    ScanError::Block(_) => self.fail(ErrorKind::Other),
                }
            }
        }
        true
    }

    /// A fault that the next frame would meet again: stop, make the sheet safe, and say so.
    fn fail(&mut self, kind: ErrorKind) {
        Counters::add(&mut self.counters.front_end_faults, 1);
        self.running = false;
        // Already failing: a source that does not stop either changes nothing about that.
        let _ = self.front.switch_off();
        self.send(&FromBoard::Error(BoardError::FrontEnd(match kind {
            ErrorKind::Timeout => FrontEndFault::Timeout,
            ErrorKind::Route => FrontEndFault::Route,
            ErrorKind::Overrun | ErrorKind::Other => FrontEndFault::Other,
        })));
    }
}
