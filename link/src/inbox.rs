//! Messages on their way from the link's thread to the program: all of them in order, or of the frames only those that are new.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use protocol::FromBoard;

use crate::error::LinkError;
use crate::port::Arrival;

/// Messages that may wait, unless more are [held](Inbox::hold).
const MOST: usize = 256;

type Message = Result<FromBoard, LinkError>;

/// A queue for one writer and one reader.
#[derive(Debug, Default)]
pub(crate) struct Inbox {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    waiting: VecDeque<(Message, Arrival)>,
    /// How messages had arrived when the one that was taken last did.
    arrival: Arrival,
    /// Frames older than the newest by more than so many samples are passed over.
    span: Option<u64>,
    skipped: u64,
    /// Messages that may wait beyond the usual number, where every frame is kept.
    held: usize,
    /// Nobody could wait any more.
    was_full: bool,
    /// Nobody reads, or nobody writes any more.
    closed: bool,
    ended: bool,
}

fn is_frame((message, _): &(Message, Arrival)) -> bool {
    matches!(message, Ok(FromBoard::Frame(_)))
}

impl State {
    /// Messages that may wait.
    fn most(&self) -> usize {
        if self.span.is_some() { MOST } else { MOST + self.held }
    }

    /// Makes room by passing over the oldest frame; false if none waits.
    fn drop_oldest(&mut self) -> bool {
        let at = self.waiting.iter().position(is_frame);
        at.and_then(|k| self.waiting.remove(k)).is_some_and(|_| {
            self.skipped += 1;
            true
        })
    }

    /// Passes over all frames but the newest, if the oldest is too old.
    fn skip(&mut self) {
        let Some(span) = self.span else { return };
        let mut frames = self.waiting.iter().filter_map(|(m, _)| match m {
            Ok(FromBoard::Frame(frame)) => Some(frame),
            _ => None,
        });
        let (Some(oldest), Some(newest)) = (frames.next(), frames.next_back()) else {
            return;
        };
        // After a reset the board's time begins anew: then nothing is known to be old.
        if newest.time.saturating_sub(oldest.time) <= span {
            return;
        }
        let mut older = self.waiting.iter().filter(|m| is_frame(m)).count() - 1;
        self.skipped += older as u64;
        self.waiting.retain(|m| {
            let drop = older > 0 && is_frame(m);
            older -= usize::from(drop);
            !drop
        });
    }
}

impl Inbox {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn put(&self, message: Message, arrival: Arrival) {
        let mut state = self.state();
        while state.waiting.len() >= state.most() && !state.closed && !(state.span.is_some() && state.drop_oldest()) {
            state.was_full |= state.span.is_none();
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        if !state.closed {
            state.waiting.push_back((message, arrival));
            self.changed.notify_all();
        }
    }

    /// The next message; none if none came in time. After the writer's end and its last message: [`LinkError::Lost`].
    pub(crate) fn take(&self, wait: Duration) -> Option<Message> {
        let end = Instant::now() + wait;
        let mut state = self.state();
        loop {
            state.skip();
            if let Some((message, arrival)) = state.waiting.pop_front() {
                state.arrival = arrival;
                self.changed.notify_all();
                return Some(message);
            }
            if state.ended {
                return Some(Err(LinkError::Lost("the link has ended".to_owned())));
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return None;
            }
            let woken = self.changed.wait_timeout(state, left);
            state = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    pub(crate) fn skip_over(&self, samples: u64) {
        self.state().span = Some(samples);
        // The writer may wait for a place.
        self.changed.notify_all();
    }

    /// Every frame that waits and is not too old already is kept from now on.
    pub(crate) fn keep_all(&self) {
        let mut state = self.state();
        state.skip();
        state.span = None;
    }

    pub(crate) fn hold(&self, bytes: usize) {
        self.state().held = bytes / size_of::<(Message, Arrival)>();
        self.changed.notify_all();
    }

    /// Whether a frame waits.
    pub(crate) fn has_frames(&self) -> bool {
        self.state().waiting.iter().any(is_frame)
    }

    pub(crate) fn was_full(&self) -> bool {
        std::mem::take(&mut self.state().was_full)
    }

    pub(crate) fn skipped(&self) -> u64 {
        self.state().skipped
    }

    pub(crate) fn arrival(&self) -> Arrival {
        self.state().arrival
    }

    /// Nobody reads any more.
    pub(crate) fn close(&self) {
        self.state().closed = true;
        self.changed.notify_all();
    }

    /// Whether nobody writes any more, at most after so long.
    pub(crate) fn wait_for_end(&self, wait: Duration) -> bool {
        let woken = self
            .changed
            .wait_timeout_while(self.state(), wait, |state| !state.ended);
        woken.unwrap_or_else(PoisonError::into_inner).0.ended
    }

    /// For the writer to hold: once it is dropped, nobody writes any more.
    pub(crate) fn writer(self: &Arc<Self>) -> Writer {
        Writer(Arc::clone(self))
    }
}

/// The writer's end.
#[derive(Debug)]
pub(crate) struct Writer(Arc<Inbox>);

impl Writer {
    /// Puts a message in. Where every frame counts it waits for a place, and drops the message once nobody reads.
    pub(crate) fn put(&self, message: Message, arrival: Arrival) {
        self.0.put(message, arrival);
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        self.0.state().ended = true;
        self.0.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use protocol::{Command, Frame};

    const NOW: Duration = Duration::ZERO;

    fn frame(sequence: u32, time: u64) -> Message {
        Ok(FromBoard::Frame(Frame {
            sequence,
            time,
            ..Frame::default()
        }))
    }

    fn sequences(inbox: &Inbox) -> Vec<Option<u32>> {
        std::iter::from_fn(|| inbox.take(NOW))
            .map(|m| match m {
                Ok(FromBoard::Frame(f)) => Some(f.sequence),
                _ => None,
            })
            .collect()
    }

    #[test]
    fn what_is_old_is_passed_over_and_the_rest_keeps_its_order() {
        let inbox = Inbox::default();
        inbox.skip_over(25);
        for k in 0..3 {
            inbox.put(frame(k, 10 * u64::from(k)), Arrival::default());
        }
        assert_eq!(sequences(&inbox), [Some(0), Some(1), Some(2)], "20 samples are not old");
        for k in 0..4 {
            inbox.put(frame(k, 10 * u64::from(k)), Arrival::default());
            inbox.put(Ok(FromBoard::Ack(Command::Start)), Arrival::default());
        }
        assert_eq!(sequences(&inbox), [None, None, None, Some(3), None]);
        assert_eq!(inbox.skipped(), 3);
        // What is too old when all is to be kept is passed over; nothing after it is.
        for k in 0..6 {
            inbox.put(frame(k, 10 * u64::from(k)), Arrival::default());
        }
        inbox.keep_all();
        for k in 6..9 {
            inbox.put(frame(k, 10 * u64::from(k)), Arrival::default());
        }
        assert_eq!(sequences(&inbox), [Some(5), Some(6), Some(7), Some(8)]);
        assert_eq!(inbox.skipped(), 8);
        inbox.skip_over(25);
        // A reset: the times fall.
        inbox.put(frame(4, 1000), Arrival::default());
        inbox.put(frame(0, 0), Arrival::default());
        assert_eq!(sequences(&inbox), [Some(4), Some(0)]);
    }

    #[test]
    fn as_many_frames_wait_as_the_memory_has_places_for() {
        let inbox = Arc::new(Inbox::default());
        let places = 1000;
        inbox.hold(places * size_of::<(Message, Arrival)>());
        let all = u32::try_from(MOST + places).unwrap();
        for k in 0..all {
            inbox.put(frame(k, u64::from(k)), Arrival::default());
        }
        assert!(!inbox.was_full());
        // One more waits for a place, and says so.
        let writer = inbox.writer();
        let waits = std::thread::spawn(move || writer.put(frame(all, u64::from(all)), Arrival::default()));
        while !inbox.was_full() {
            std::thread::yield_now();
        }
        let taken: Vec<_> = (0..=all).map(|_| inbox.take(Duration::from_secs(30))).collect();
        waits.join().unwrap();
        for (k, message) in taken.into_iter().enumerate() {
            assert!(
                matches!(message, Some(Ok(FromBoard::Frame(f))) if f.sequence as usize == k),
                "{k}"
            );
        }
    }

    proptest! {
        /// Whenever the reader looks, every frame put in was taken, passed over, or is newer than what it takes next; what it takes
        /// is in order and never older than the span against what waits; and the writer never waits.
        #[test]
        fn nothing_is_lost_and_nothing_old_is_taken(
            steps in prop::collection::vec((0..400u32, 0..4usize), 1..40), span in 0..100u64
        ) {
            let inbox = Inbox::default();
            inbox.skip_over(span);
            let (mut put, mut taken) = (0, 0);
            let mut last = None;
            for (arrive, looks) in steps {
                for _ in 0..arrive {
                    inbox.put(frame(put, 7 * u64::from(put)), Arrival::default());
                    put += 1;
                }
                for _ in 0..looks {
                    let Some(Ok(FromBoard::Frame(f))) = inbox.take(NOW) else { break };
                    prop_assert!(last.is_none_or(|l| f.sequence > l));
                    prop_assert!(7 * u64::from(put - 1) - f.time <= span);
                    last = Some(f.sequence);
                    taken += 1;
                }
            }
            let left = sequences(&inbox).len() as u64;
            prop_assert_eq!(u64::from(put), taken + inbox.skipped() + left);
        }
    }
}
