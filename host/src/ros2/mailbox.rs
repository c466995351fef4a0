//! What the threads of the skins hand over, and the one that sends takes. Nobody waits here for the network.

use super::facts::Facts;
use super::tare::{Sheet, Tare};
use crate::event::{Event, Said};
use inverse::pipeline::FrameResult;
use inverse::reference::imager::Imager;
use inverse::touches::touch::Touch;
use link::MeasuredFrame;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use view::picture::Picture;

/// So many frames of a skin wait at most; then the oldest is passed over, and counted.
pub(super) const WAITING: usize = 64;
/// A picture in which nothing is new is sent again after so long, s of the board's time.
const IMAGE_AGAIN_S: f64 = 0.25;
/// Pictures of what changes follow one another by so much at least, s of the board's time: as often as an eye follows.
const IMAGE_S: f64 = 1.0 / 30.0;

/// A frame that is to be sent.
pub(super) struct Sample {
    pub(super) unix_s: f64,
    pub(super) sequence: u32,
    pub(super) time_s: f64,
    pub(super) touches: Vec<Touch>,
    pub(super) doubt: Option<String>,
    /// Rise of every cell, where a picture is due and somebody wants it.
    pub(super) image: Option<(Arc<Imager>, Vec<f32>)>,
}

/// What is known of a skin.
#[derive(Default)]
pub(super) struct Slot {
    pub(super) waiting: VecDeque<Sample>,
    /// Frames that were passed over for newer ones.
    pub(super) passed_over: u64,
    pub(super) facts: Facts,
    pub(super) sheet: Sheet,
    pub(super) tare: Tare,
    /// Whether somebody listens to pictures.
    pub(super) image_wanted: bool,
    /// The skin has ended.
    pub(super) ended: bool,
}

impl Slot {
    /// Puts a frame in, in place of the oldest where there is no room.
    pub(super) fn put(&mut self, sample: Sample) {
        if self.waiting.len() >= WAITING {
            self.waiting.pop_front();
            self.passed_over += 1;
        }
        self.waiting.push_back(sample);
    }
}

#[derive(Default)]
pub(super) struct Inner {
    pub(super) slots: Vec<Slot>,
    /// Nothing is to be sent any more.
    pub(super) ended: bool,
}

/// Shared by the skins and the thread that sends.
#[derive(Default)]
pub(super) struct Mailbox {
    inner: Mutex<Inner>,
    wake: Condvar,
}

impl Mailbox {
    pub(super) fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until there is something to send, at most so long.
    pub(super) fn wait(&self, most: Duration) -> MutexGuard<'_, Inner> {
        let idle = |inner: &mut Inner| !inner.ended && inner.slots.iter().all(|slot| slot.waiting.is_empty());
        let waited = self.wake.wait_timeout_while(self.lock(), most, idle);
        waited.unwrap_or_else(PoisonError::into_inner).0
    }

    pub(super) fn ring(&self) {
        self.wake.notify_one();
    }
}

/// A skin's end of it: what becomes of its frames is handed over here.
pub(crate) struct Node {
    mailbox: Arc<Mailbox>,
    slot: usize,
    image_s: f64,
}

impl Node {
    /// A new one; a recording can take no baseline.
    pub(super) fn new(mailbox: &Arc<Mailbox>, recorded: bool) -> Self {
        let mut inner = mailbox.lock();
        let sheet = Sheet {
            recorded,
            ..Sheet::default()
        };
        inner.slots.push(Slot {
            sheet,
            ..Slot::default()
        });
        Self {
            mailbox: Arc::clone(mailbox),
            slot: inner.slots.len() - 1,
            image_s: f64::NEG_INFINITY,
        }
    }

    pub(super) fn slot(&self) -> usize {
        self.slot
    }

    fn with<T>(&self, act: impl FnOnce(&mut Slot) -> T) -> T {
        act(&mut self.mailbox.lock().slots[self.slot])
    }

    /// Whether somebody takes the picture of a frame: one is due.
    pub(crate) fn wants_image(&self, result: &FrameResult, time_s: f64) -> bool {
        let since_s = time_s - self.image_s;
        let again = !(0.0..IMAGE_AGAIN_S).contains(&since_s);
        let new = result.anew && (!result.changed || since_s > IMAGE_S);
        (again || new) && self.with(|slot| slot.image_wanted)
    }

    /// The touches of a frame that press, and its picture where one is due ([`Node::wants_image`]).
    pub(crate) fn picture(
        &mut self,
        unix_s: f64,
        imager: &Arc<Imager>,
        result: &FrameResult,
        frame: &MeasuredFrame,
        touches: Vec<Touch>,
    ) {
        // One that was asked for a moment later waits for the next frame.
        let image = (result.is_pictured && self.wants_image(result, frame.time_s)).then(|| {
            self.image_s = frame.time_s;
            let rise = result.x.iter().map(|x| *x as f32).collect();
            (Arc::clone(imager), rise)
        });
        let sample = Sample {
            unix_s,
            sequence: frame.sequence,
            time_s: frame.time_s,
            touches,
            doubt: result.doubt.map(|doubt| doubt.to_string()),
            image,
        };
        self.with(|slot| {
            slot.sheet.touches = sample.touches.len();
            slot.facts.trouble = result.doubt.is_some() || !result.faults.is_empty();
            slot.put(sample);
        });
        self.mailbox.ring();
    }

    /// What is shown now, with all that is said beside it.
    pub(crate) fn shown(&self, picture: &Arc<Picture>) {
        self.with(|slot| slot.facts.shown = Some((Arc::clone(picture), Instant::now())));
    }

    /// Whether somebody asks for a new baseline.
    pub(crate) fn wants_baseline(&self) -> bool {
        self.with(|slot| slot.tare.wanted())
    }

    /// Something happened.
    pub(crate) fn event(&self, said: &Said) {
        self.with(|slot| {
            match said.event {
                Event::BaselineBegun => slot.sheet.in_force = false,
                Event::BaselineInForce { .. } => (slot.sheet.in_force, slot.sheet.touches) = (true, 0),
                Event::BoardAway { .. } => slot.sheet.away = true,
                Event::BoardBack { .. } => slot.sheet.away = false,
                _ => {}
            }
            slot.tare.event(said);
        });
        self.mailbox.ring();
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        self.with(|slot| {
            slot.tare.end();
            slot.ended = true;
        });
        self.mailbox.ring();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(sequence: u32) -> Sample {
        Sample {
            unix_s: 0.0,
            sequence,
            time_s: 0.0,
            touches: Vec::new(),
            doubt: None,
            image: None,
        }
    }

    #[test]
    fn the_newest_frames_wait_and_those_passed_over_are_counted() {
        let mut slot = Slot::default();
        let more = 5;
        (0..WAITING as u32 + more).for_each(|k| slot.put(sample(k)));
        assert_eq!(slot.passed_over, u64::from(more));
        let kept: Vec<u32> = slot.waiting.iter().map(|s| s.sequence).collect();
        assert_eq!(kept, (more..WAITING as u32 + more).collect::<Vec<_>>());
    }
}
