//! A simulated board whose frames are computed beforehand and come at their times.
//!
//! A real board computes no rubber. One that is simulated beside the reconstruction takes half of a small machine's processor, and its
//! caches with it.

use crate::progress::Progress;
use hil_sim::SimPort;
use link::ports::BAUD;
use protocol::{Decoder, FromBoard, MAX_FROM_BOARD_LEN};
use recording::Splitter;
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Result, Write};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Bits on the wire of a byte.
pub(super) const BITS: f64 = 10.0;
/// Longest that a read waits.
const WAIT: Duration = Duration::from_millis(20);

/// What a board says when, s of its time.
#[derive(Default)]
struct Said {
    splitter: Splitter,
    decoder: Decoder<MAX_FROM_BOARD_LEN>,
    rate: f64,
    /// Messages with the time of the frame that each is or comes after.
    messages: VecDeque<(f64, Vec<u8>)>,
    last_s: Option<f64>,
    /// From one frame to the next, at least.
    frame_s: Option<f64>,
}

impl Said {
    fn push(&mut self, bytes: &[u8]) {
        let Self {
            splitter,
            decoder,
            rate,
            messages,
            last_s,
            frame_s,
        } = self;
        splitter.push(bytes, |message| {
            decoder.push(message, |decoded: std::result::Result<FromBoard, _>| match decoded {
                Ok(FromBoard::Hello(hello)) => *rate = hello.sample_rate(),
                Ok(FromBoard::Frame(frame)) => {
                    let time_s = frame.time as f64 / *rate;
                    if let Some(last_s) = last_s.replace(time_s) {
                        let apart_s = time_s - last_s;
                        *frame_s = Some(frame_s.map_or(apart_s, |least| least.min(apart_s)));
                    }
                }
                _ => {}
            });
            messages.push_back((last_s.unwrap_or(0.0), message.to_vec()));
        });
    }
}

/// A port with such a board behind it. Until its first frame it answers as it is asked. Then everything up to an end is simulated.
/// What was measured before a time is sent at once; the rest from [`Begin::begin`] on, each message when its last byte would arrive.
pub(super) struct Ahead {
    board: SimPort,
    said: Said,
    /// What was measured before that is sent at once, s.
    from_s: f64,
    until_s: f64,
    is_simulated: bool,
    begin: Begin,
    out: VecDeque<u8>,
}

/// Lets the time of an [`Ahead`] pass.
#[derive(Clone, Default)]
pub(super) struct Begin(Arc<OnceLock<Instant>>);

impl Begin {
    /// From now on.
    pub(super) fn begin(&self) {
        self.0.get_or_init(Instant::now);
    }
}

impl Ahead {
    /// A board that runs as fast as it is read, with the part of its time that is to pass at its pace, s.
    pub(super) fn new(board: SimPort, from_s: f64, until_s: f64) -> Self {
        Self {
            board,
            said: Said::default(),
            from_s,
            until_s,
            is_simulated: false,
            begin: Begin::default(),
            out: VecDeque::new(),
        }
    }

    /// What lets its time pass.
    pub(super) fn beginning(&self) -> Begin {
        self.begin.clone()
    }

    /// Simulates to the end.
    fn simulate(&mut self) -> Result<()> {
        let progress = Progress::new("simulating the board");
        let mut bytes = [0; 4096];
        while self.said.last_s.is_none_or(|last_s| last_s < self.until_s) {
            match self.board.read(&mut bytes) {
                Ok(count) => self.said.push(&bytes[..count]),
                Err(why) if why.kind() == ErrorKind::TimedOut => {}
                Err(why) => return Err(why),
            }
            progress.at(
                (1e3 * self.said.last_s.unwrap_or(0.0)) as usize,
                (1e3 * self.until_s) as usize,
            );
        }
        Ok(())
    }

    /// How long it is to the arrival of a message's last byte; none before the beginning.
    fn wait(&self, time_s: f64, length: usize) -> Option<Duration> {
        if time_s < self.from_s {
            return Some(Duration::ZERO);
        }
        let wire_s = BITS * length as f64 / f64::from(BAUD);
        let due_s = time_s + self.said.frame_s.unwrap_or(0.0) + wire_s - self.from_s;
        let begun = self.begin.0.get()?;
        Some(Duration::from_secs_f64(due_s).saturating_sub(begun.elapsed()))
    }

    /// Takes what the board answers, in whole messages; from its first frame on all that it will say.
    fn listen(&mut self) -> Result<()> {
        let mut bytes = [0; 4096];
        let count = self.board.read(&mut bytes)?;
        self.said.push(&bytes[..count]);
        if self.said.last_s.is_none() {
            self.out
                .extend(self.said.messages.drain(..).flat_map(|(_, message)| message));
            return Ok(());
        }
        self.is_simulated = true;
        self.simulate()
    }

    /// Waits for the next message, for a while.
    fn pass_time(&mut self) {
        let next = self.said.messages.front();
        let wait = next.and_then(|(time_s, message)| self.wait(*time_s, message.len()));
        let wait = wait.unwrap_or(Duration::MAX);
        std::thread::sleep(wait.min(WAIT));
        if wait <= WAIT
            && let Some((_, message)) = self.said.messages.pop_front()
        {
            self.out.extend(message);
        }
    }
}

impl Read for Ahead {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        if self.out.is_empty() && !self.is_simulated {
            self.listen()?;
        }
        if self.out.is_empty() && self.is_simulated {
            self.pass_time();
        }
        if self.out.is_empty() {
            return Err(ErrorKind::TimedOut.into());
        }
        self.out.read(buffer)
    }
}

impl Write for Ahead {
    /// Once it is simulated nothing changes what it says.
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        if self.is_simulated {
            return Ok(bytes.len());
        }
        self.board.write(bytes)
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hil_sim::{Pace, SceneFile};
    use link::Session;
    use link::plans::live_plan;

    /// Every frame of the board comes, in order and none before its time; what was measured before the beginning at once.
    #[test]
    fn frames_come_at_their_times() {
        let scene = SceneFile::parse("duration_s = 1.0\n", None).unwrap();
        let (from_s, until_s) = (0.3, 0.6);
        let board = SimPort::new(scene.board().unwrap(), Pace::Unpaced).unwrap();
        let ahead = Ahead::new(board, from_s, until_s);
        let begin = ahead.beginning();
        let session = Session::start(Box::new(ahead), live_plan).unwrap();
        let (frame_s, mut last) = (session.frame_s(), None);
        let mut begun = None;
        while last.is_none_or(|(_, time_s)| time_s < until_s - frame_s) {
            let Some(frame) = session.frame(Duration::from_secs(30)).unwrap() else {
                continue;
            };
            if let Some((sequence, _)) = last {
                assert_eq!(frame.sequence, sequence + 1);
            }
            last = Some((frame.sequence, frame.time_s));
            if frame.time_s < from_s {
                assert!(begun.is_none());
                if frame.time_s + frame_s >= from_s {
                    begun = Some(Instant::now());
                    begin.begin();
                }
            } else {
                let after_s = begun.unwrap().elapsed().as_secs_f64();
                assert!(after_s >= frame.time_s + frame_s - from_s, "{after_s} {}", frame.time_s);
            }
        }
    }
}
