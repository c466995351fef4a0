//! A recording as a board, and its frames as they are asked for.

use crate::event::Event;
use anyhow::{Context, Result};
use link::{Link, MeasuredFrame, Port, Session};
use recording::{Known, Pace, Playback, Speed};
use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A recording as a board: its frames, as fast as they are taken.
pub(crate) struct PlayedBoard {
    pub(crate) session: Session,
    /// Is true once the recording was read to its end.
    pub(crate) ended: Arc<AtomicBool>,
}

impl PlayedBoard {
    /// Opens a recording.
    ///
    /// # Errors
    /// It cannot be read, or no board introduced itself in it.
    pub(crate) fn open(path: &Path, speed: Speed) -> Result<Self> {
        Self::open_at(path, speed, Pace::default(), None)
    }

    /// Opens a recording at a place of it, to be played at a pace.
    ///
    /// # Errors
    /// As [`PlayedBoard::open`].
    pub(crate) fn open_at(path: &Path, speed: Speed, pace: Pace, place: Option<(&Known, u64)>) -> Result<Self> {
        let playback = Playback::open_at(path, speed, pace, place)?;
        let (plan, ended) = (playback.plan().clone(), playback.ended());
        // Where the board went away and came back, so does the recorded one.
        let again = playback.clone();
        let reopen = move || {
            let again = again.reopen().map_err(|e| e.to_string())?;
            Ok(Box::new(again) as Box<dyn Port>)
        };
        let link = Link::reopening(Box::new(playback), Box::new(reopen))?;
        let session = Session::start_on(link, |_| Ok(plan)).with_context(|| path.display().to_string())?;
        Ok(Self { session, ended })
    }

    /// The next frame; none at the end.
    ///
    /// # Errors
    /// The board stopped with an error then.
    pub(crate) fn frame(&self) -> Result<Option<MeasuredFrame>> {
        // The file may be read to its end while what came before still waits, and a port that is lost is told at once: only
        // waits in vain tell that nothing is left.
        let mut in_vain = 0;
        loop {
            let ended = self.ended.load(Ordering::Acquire);
            let begin = Instant::now();
            match self.session.frame(WAIT) {
                Ok(Some(frame)) => return Ok(Some(frame)),
                Ok(None) if ended && self.session.is_away() && begin.elapsed() >= WAIT => in_vain += 1,
                Ok(None) => in_vain = 0,
                Err(why) => return Err(why.into()),
            }
            if in_vain == 2 {
                return Ok(None);
            }
        }
    }
}

/// A frame of a recording is waited for so long at a time.
const WAIT: Duration = Duration::from_millis(100);

/// Frames that are looked through for one that was taken: as many as can wait between the port and the picture, twice.
const AHEAD: usize = 512;

/// The frames of a recording, as they are asked for.
#[derive(Default)]
pub(crate) struct Frames {
    /// Newer than the one asked for last, as far as their numbers tell; each with how often the board had come back before it.
    waiting: VecDeque<(u32, MeasuredFrame)>,
    /// How often the board has come back so far.
    connection: u32,
    ended: bool,
}

impl Frames {
    /// Something happened on the line then.
    pub(crate) fn happened(&mut self, event: &Event) {
        self.connection += u32::from(matches!(event, Event::BoardBack { .. }));
    }

    /// The next frame of a number. Those before it were passed over when it was recorded; none where it is not in the file.
    ///
    /// # Errors
    /// The board stopped with an error then.
    pub(crate) fn find(
        &mut self,
        board: &PlayedBoard,
        sequence: u32,
        stop: &AtomicBool,
    ) -> Result<Option<MeasuredFrame>> {
        let mut looked = 0;
        loop {
            while looked < self.waiting.len() {
                let (connection, frame) = &self.waiting[looked];
                if *connection > self.connection {
                    return Ok(None);
                }
                if *connection == self.connection && frame.sequence == sequence {
                    self.waiting.drain(..looked);
                    return Ok(self.waiting.pop_front().map(|(_, frame)| frame));
                }
                // After a reset the numbers begin anew: what seems newer may come before it.
                if *connection < self.connection || sequence.wrapping_sub(frame.sequence) < u32::MAX / 2 {
                    self.waiting.remove(looked);
                } else {
                    looked += 1;
                }
            }
            if self.ended || looked >= AHEAD || stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            match board.frame()? {
                Some(frame) => self.waiting.push_back((board.session.restored(), frame)),
                None => self.ended = true,
            }
        }
    }
}
