//! Answers of a service, sent when whoever asked is ready to hear them.

use super::endpoints::Writer;
use super::tare::Request;
use rustdds::GUID;
use std::collections::HashSet;
use std::time::{Duration, Instant};

/// An answer waits at most so long until its reader is ready.
const PATIENCE: Duration = Duration::from_secs(3);

/// The answering end of a service.
///
/// A client may be known here before it knows of this end, and then never hears of what was said first: readers of Cyclone DDS
/// begin after the first heartbeat that reaches them, and the DDS library sends none while nothing is outstanding. So each
/// client is greeted by an answer to nobody; once that is acknowledged, its heartbeat has come, and the true answer can.
pub(super) struct Replies {
    pub(super) writer: Writer,
    greeted: HashSet<GUID>,
    waiting: Vec<(Request, bool, String, Instant)>,
}

impl Replies {
    pub(super) fn new(writer: Writer) -> Self {
        Self {
            writer,
            greeted: HashSet::new(),
            waiting: Vec::new(),
        }
    }

    /// Takes an answer that is to be sent.
    pub(super) fn add(&mut self, request: Request, success: bool, text: String) {
        self.waiting.push((request, success, text, Instant::now()));
    }

    /// Greets new readers, and sends what can be heard.
    pub(super) fn send_ready(&mut self, readers: &HashSet<GUID>) {
        if !readers.is_subset(&self.greeted) {
            let nobody = Request::of_nobody();
            self.writer.answer(nobody.answer(false, ""), nobody.from);
        }
        self.greeted.clone_from(readers);
        let arrived = !self.waiting.is_empty() && self.writer.wait(Duration::ZERO);
        self.send(|request, since| {
            let asker = request.from.writer_guid.prefix;
            let ready = arrived && readers.iter().any(|reader| reader.prefix == asker);
            ready || since.elapsed() >= PATIENCE
        });
    }

    /// Sends all that waits.
    pub(super) fn send_all(&mut self) {
        self.send(|_, _| true);
    }

    fn send(&mut self, now: impl Fn(&Request, &Instant) -> bool) {
        let writer = &self.writer;
        self.waiting.retain(|(request, success, text, since)| {
            let now = now(request, since);
            if now {
                writer.answer(request.answer(*success, text), request.from);
            }
            !now
        });
    }
}
