//! A board that has introduced itself and streams frames.

use crate::ask::{PATIENCE, greet, insist};
use crate::error::LinkError;
use crate::link::{Link, Port};
use protocol::{BoardError, Command, Frame, FromBoard, Hello, Plan, PlanError, ToBoard, Watch, Watching};
use std::cell::{Cell, RefCell};
use std::time::{Duration, Instant};

/// A running session.
pub struct Session {
    link: Link,
    hello: Hello,
    plan: Plan,
    /// When the board was last told what to do.
    told: Cell<Instant>,
    /// The watch in force.
    watch: RefCell<Option<Watch>>,
    /// What the board does about it, as it last said.
    watching: Cell<Watching>,
}

/// One measured frame as numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredFrame {
    /// The board's count.
    pub sequence: u32,
    /// The board's time, s.
    pub time_s: f64,
    /// In-phase amplitudes at the sense pairs, V, in the plan's order; not a number where the converter clipped.
    pub values_v: Vec<f64>,
}

impl MeasuredFrame {
    /// A frame of a board and a plan as numbers.
    pub fn of(hello: &Hello, plan: &Plan, frame: &Frame) -> Self {
        let gains = plan
            .slots
            .iter()
            .flat_map(|slot| std::iter::repeat_n(slot.gain, slot.sense.count_ones() as usize));
        let values_v = frame
            .values
            .iter()
            .zip(gains)
            .enumerate()
            .map(|(k, (value, gain))| match hello.volts_per_code(gain) {
                Some(volts) if !frame.clipped.get(k) => value.codes() * volts,
                _ => f64::NAN,
            })
            .collect();
        Self {
            sequence: frame.sequence,
            time_s: frame.time as f64 / hello.sample_rate(),
            values_v,
        }
    }
}

impl Session {
    /// Greets the board behind a port, gives it the plan that `choose` makes for it and starts it, without a watch: it sends
    /// frames all the time until [`Session::set_watch`].
    ///
    /// # Errors
    /// [`LinkError`]: no answer, another protocol, a plan that the board cannot carry out.
    pub fn start(
        port: Box<dyn Port>,
        choose: impl FnOnce(&Hello) -> Result<Plan, PlanError>,
    ) -> Result<Self, LinkError> {
        let link = Link::open(port)?;
        let hello = greet(&link)?;
        let plan = choose(&hello)?;
        let plan = insist(
            &link,
            "the scan plan",
            &ToBoard::SetPlan(plan.clone()),
            PATIENCE,
            |m| match m {
                FromBoard::Plan(p) if p.id == plan.id => Some(p),
                _ => None,
            },
        )?;
        insist(&link, "the watch", &ToBoard::SetWatch(None), PATIENCE, |m| {
            matches!(m, FromBoard::Watch(None)).then_some(())
        })?;
        insist(&link, "the start", &ToBoard::Start, PATIENCE, |m| {
            matches!(m, FromBoard::Ack(Command::Start)).then_some(())
        })?;
        link.expect_frames();
        Ok(Self {
            link,
            hello,
            plan,
            told: Cell::new(Instant::now()),
            watch: RefCell::new(None),
            watching: Cell::new(Watching::Off),
        })
    }

    /// Who the board is.
    pub fn hello(&self) -> &Hello {
        &self.hello
    }

    /// The plan in force.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The link, for its counters.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// Lets the board watch while nothing touches, or send frames all the time (`None`). It learns the watch's baseline now:
    /// nothing may touch. While it is asleep no frames come, but signs of life.
    pub fn set_watch(&self, watch: Option<Watch>) {
        self.told.set(Instant::now());
        self.watching.set(Watching::Off);
        self.link.send(ToBoard::SetWatch(watch.clone()));
        self.watch.replace(watch);
    }

    /// For pictures that must not lag: [`Session::frame`] passes over frames of which newer ones by more than so many seconds of
    /// the board's time wait, and takes the newest ([`Link::skip_over`]).
    pub fn skip_over(&self, lag_s: f64) {
        self.link.skip_over((lag_s * self.hello.sample_rate()) as u64);
    }

    /// For a baseline: ends [`Session::skip_over`], every frame is kept until it is taken ([`Link::keep_all`]).
    pub fn keep_all(&self) {
        self.link.keep_all();
    }

    /// What the board does about its watch, as it last said.
    pub fn watching(&self) -> Watching {
        self.watching.get()
    }

    /// Says so where the board has sent neither a frame nor a sign of life while its port was listened to for so long.
    ///
    /// # Errors
    /// [`LinkError::NoFrames`].
    pub fn check_silence(&self, most: Duration) -> Result<(), LinkError> {
        if self.link.counters().silent > most {
            return Err(LinkError::NoFrames { s: most.as_secs() });
        }
        Ok(())
    }

    /// Electrodes of the board.
    pub fn electrodes(&self) -> usize {
        self.hello.electrodes.into()
    }

    /// The measurements of a frame, in the order of its values: drive and sense pair, each `[plus, minus]`, electrodes
    /// counted from 0.
    pub fn measurements(&self) -> impl Iterator<Item = [[usize; 2]; 2]> + '_ {
        let pair = |p: protocol::Pair| [p.plus.into(), p.minus.into()];
        self.plan
            .measurements(self.hello.electrodes)
            .map(move |(drive, sense)| [pair(drive), pair(sense)])
    }

    /// The next frame of the plan in force, or `None` when none came in time, or the board said that it watches. A board that was reset meanwhile (its
    /// sequence and its time begin anew) is given the plan again and started.
    ///
    /// # Errors
    /// The port is gone, another board is behind it, or the board stopped with an error.
    pub fn frame(&self, wait: Duration) -> Result<Option<MeasuredFrame>, LinkError> {
        let end = Instant::now() + wait;
        loop {
            match self.link.receive(end.saturating_duration_since(Instant::now()))? {
                None => {
                    // Perhaps it was reset and its introduction was lost. Starting twice is no error.
                    if self.patience_is_over() {
                        self.told.set(Instant::now());
                        self.link.send(ToBoard::Start);
                    }
                    return Ok(None);
                }
                Some(FromBoard::Frame(frame)) if self.fits(&frame) => {
                    return Ok(Some(MeasuredFrame::of(&self.hello, &self.plan, &frame)));
                }
                Some(FromBoard::Hello(hello)) if !hello.is_same_board(&self.hello) => {
                    return Err(LinkError::Lost("another board is behind the port now".to_owned()));
                }
                Some(FromBoard::Heartbeat(beat)) => {
                    self.told.set(Instant::now());
                    self.watching.set(beat.state);
                    return Ok(None);
                }
                // It was reset: every time it is, at once.
                Some(FromBoard::Hello(_)) => self.resume(),
                // It was reset, its introduction was lost, and it has the plan of its power-up.
                Some(FromBoard::Frame(_)) if self.patience_is_over() => self.resume(),
                Some(FromBoard::Error(BoardError::Command(e))) => {
                    tracing::debug!("the board could not read a command: {e}");
                }
                Some(FromBoard::Error(e)) => return Err(LinkError::Refused(e.to_string())),
                Some(_) => {}
            }
        }
    }

    /// Whether the board was told what to do so long ago that it must have heard it or lost it.
    fn patience_is_over(&self) -> bool {
        self.told.get().elapsed() >= PATIENCE
    }

    /// Tells the board again what to do.
    fn resume(&self) {
        self.told.set(Instant::now());
        self.link.send(ToBoard::SetWatch(self.watch.borrow().clone()));
        self.link.send(ToBoard::SetPlan(self.plan.clone()));
        self.link.send(ToBoard::Start);
    }

    fn fits(&self, frame: &Frame) -> bool {
        frame.plan == self.plan.id && frame.values.len() == self.plan.value_count()
    }
}
