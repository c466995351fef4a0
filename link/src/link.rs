//! The serial link: bytes to messages on a thread of its own, commands the other way, and an account of what was lost.

use crate::error::LinkError;
use crate::inbox::Inbox;
use crate::port::{LinkCounters, Port, Reopen};
use crate::pump::{Order, Pump};
use protocol::{BoardError, FromBoard, ToBoard};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// An open link. Dropping it stops the board's stream, unless it was [left running](Link::leave_running), and closes the
/// port.
pub struct Link {
    stop_at_end: bool,
    reopens: bool,
    orders: Sender<Order>,
    inbox: Arc<Inbox>,
    counters: Arc<Mutex<LinkCounters>>,
    thread: Option<JoinHandle<()>>,
}

impl Link {
    /// Starts to read from a port. Once that is gone, the link is at its end.
    ///
    /// # Errors
    /// [`LinkError::Lost`] when the thread cannot be started.
    pub fn open(port: Box<dyn Port>) -> Result<Self, LinkError> {
        Self::start(port, None)
    }

    /// Starts to read from a port that is opened again whenever it is gone. Then [`Link::receive`] gives [`LinkError::Lost`] once,
    /// and afterwards what comes by the port that was opened again; who is behind it is asked to
    /// introduce itself. What is sent meanwhile is dropped.
    ///
    /// # Errors
    /// As [`Link::open`].
    pub fn reopening(port: Box<dyn Port>, reopen: Reopen) -> Result<Self, LinkError> {
        Self::start(port, Some(reopen))
    }

    fn start(port: Box<dyn Port>, reopen: Option<Reopen>) -> Result<Self, LinkError> {
        let (orders, queue) = channel();
        let inbox = Arc::new(Inbox::default());
        let counters = Arc::new(Mutex::new(LinkCounters::default()));
        let reopens = reopen.is_some();
        let pump = Pump {
            orders: queue,
            messages: inbox.writer(),
            shared: Arc::clone(&counters),
            reopen,
        };
        let thread = std::thread::Builder::new()
            .name("link".to_owned())
            .spawn(move || pump.run(port))
            .map_err(|e| LinkError::Lost(e.to_string()))?;
        Ok(Self {
            stop_at_end: true,
            reopens,
            orders,
            inbox,
            counters,
            thread: Some(thread),
        })
    }

    /// Counts silence from now on: frames are only expected of a board that was started.
    pub(crate) fn expect_frames(&self) {
        let mut counters = self.counters.lock().unwrap_or_else(PoisonError::into_inner);
        (counters.silent, counters.frameless) = (Duration::ZERO, Duration::ZERO);
    }

    /// Whether a frame waits to be taken.
    pub(crate) fn has_frames(&self) -> bool {
        self.inbox.has_frames()
    }

    /// Sends a command; it leaves before the next read.
    pub fn send(&self, command: ToBoard) {
        self.order(Order::Send(Box::new(command)));
    }

    fn order(&self, order: Order) {
        // A link that has ended says so at the next message.
        let _ = self.orders.send(order);
    }

    /// Whether a port that is gone is opened again.
    pub fn reopens(&self) -> bool {
        self.reopens
    }

    /// Closes the port, for this reason, and opens it again: for a port that seems to be there, but brings nothing.
    pub(crate) fn reopen(&self, why: String) {
        self.order(Order::Reopen(why));
    }

    /// Lets the board go on as it is when the link is closed.
    pub fn leave_running(&mut self) {
        self.stop_at_end = false;
    }

    /// For another thread, which is to stop the board should the one that has the link hang.
    pub fn stopper(&self) -> Stopper {
        Stopper {
            orders: self.orders.clone(),
            inbox: Arc::clone(&self.inbox),
        }
    }

    /// The next message, or `None` when none came in time.
    ///
    /// # Errors
    /// [`LinkError::Lost`] once the port is gone: for ever, or until it is [opened again](Link::reopening).
    pub fn receive(&self, wait: Duration) -> Result<Option<FromBoard>, LinkError> {
        match self.inbox.take(wait) {
            Some(Ok(message)) => Ok(Some(message)),
            Some(Err(error)) => Err(error),
            None => Ok(None),
        }
    }

    /// For pictures that must not lag: where frames wait that are older than the newest by more than so many samples of the
    /// board's time, all but the newest are passed over, and counted. The port is read all the time then.
    ///
    /// Without it every frame is kept until it is taken, and a program that leaves hundreds of them waiting
    /// ([more](Link::hold), if it asks) stops the reading: the port loses bytes, and the sequence numbers tell.
    pub fn skip_over(&self, samples: u64) {
        self.inbox.skip_over(samples);
    }

    /// Ends [`Link::skip_over`]: every frame is kept from now on. What was too old already is passed over still.
    pub fn keep_all(&self) {
        self.inbox.keep_all();
    }

    /// Where every frame is kept, as many of them may wait as have a place in this memory, bytes; never fewer than usual.
    pub fn hold(&self, bytes: usize) {
        self.inbox.hold(bytes);
    }

    /// Whether the places for frames were all taken since this was asked last, where every frame is kept.
    pub fn was_full(&self) -> bool {
        self.inbox.was_full()
    }

    /// Sends a command and waits for the answer that `accept` takes; anything else that comes meanwhile is dropped.
    ///
    /// # Errors
    /// No answer in time, a refusal, a lost port.
    pub fn ask<T>(
        &self,
        what: &'static str,
        command: ToBoard,
        wait: Duration,
        mut accept: impl FnMut(FromBoard) -> Option<T>,
    ) -> Result<T, LinkError> {
        self.send(command);
        let end = Instant::now() + wait;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            match self.receive(left)? {
                // A command damaged on the way is the line's fault, and perhaps not even this one.
                Some(FromBoard::Error(BoardError::Command(e))) => {
                    tracing::debug!("the board could not read a command: {e}")
                }
                Some(FromBoard::Error(e)) => return Err(LinkError::Refused(e.to_string())),
                Some(message) => {
                    if let Some(answer) = accept(message) {
                        return Ok(answer);
                    }
                }
                None => {
                    return Err(LinkError::Silent {
                        what,
                        ms: wait.as_millis(),
                    });
                }
            }
        }
    }

    /// What was lost so far.
    pub fn counters(&self) -> LinkCounters {
        LinkCounters {
            skipped_frames: self.inbox.skipped(),
            arrival: self.inbox.arrival(),
            ..*self.counters.lock().unwrap_or_else(PoisonError::into_inner)
        }
    }
}

/// Stops a board while the program ends, whatever the thread that has its [`Link`] does.
pub struct Stopper {
    orders: Sender<Order>,
    inbox: Arc<Inbox>,
}

impl Stopper {
    /// Tells the board to stop, closes the port after it, and waits for that so long; whether it is done.
    pub fn stop(&self, wait: Duration) -> bool {
        // The link has ended perhaps.
        let _ = self.orders.send(Order::Send(Box::new(ToBoard::Stop)));
        let _ = self.orders.send(Order::Close);
        // Its thread may be waiting for a place in it.
        self.inbox.close();
        self.inbox.wait_for_end(wait)
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        if self.stop_at_end {
            self.send(ToBoard::Stop);
        }
        self.order(Order::Close);
        // The thread may be waiting for a place in it.
        self.inbox.close();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread of the link ended badly");
        }
    }
}
