//! A board that has introduced itself and streams frames.

use crate::ask::{PATIENCE, greet, insist};
use crate::connection::{Connection, ConnectionEvent, Identity};
use crate::error::LinkError;
use crate::link::Link;
use crate::port::Port;
use protocol::{
    BoardError, Command, Frame, FromBoard, Hello, Notice, Plan, PlanError, QUARTERS, ToBoard, Watch, Watching,
};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
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
    /// Amplitude of the source, in thousandths of full scale, once the board has said it.
    excitation: Cell<Option<u16>>,
    connection: RefCell<Connection>,
    events: RefCell<VecDeque<ConnectionEvent>>,
    notices: RefCell<VecDeque<Notice>>,
    /// How often the connection was restored.
    restored: Cell<u32>,
}

/// A board that is looked for is asked so often who it is.
const GREETING: Duration = Duration::from_millis(200);

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
        Self::start_on(Link::open(port)?, choose)
    }

    /// The same on a link. With one that [opens its port again](Link::reopening) the session outlives a lost connection: it waits for
    /// the same board, gives it what it had (watch, amplitude, plan) and starts it ([`Session::event`] tells).
    ///
    /// # Errors
    /// As [`Session::start`].
    pub fn start_on(link: Link, choose: impl FnOnce(&Hello) -> Result<Plan, PlanError>) -> Result<Self, LinkError> {
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
        // Its amplitude is to be the same after a power cut. The answer comes among the frames.
        link.send(ToBoard::GetStatus);
        link.expect_frames();
        Ok(Self {
            link,
            hello,
            plan,
            told: Cell::new(Instant::now()),
            watch: RefCell::new(None),
            watching: Cell::new(Watching::Off),
            excitation: Cell::new(None),
            connection: RefCell::new(Connection::Up),
            events: RefCell::default(),
            notices: RefCell::default(),
            restored: Cell::new(0),
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
        if watch.is_none() {
            self.link.expect_frames();
        }
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

    /// Says so where the board has sent neither a frame nor, if it is to watch, a sign of life while its port was listened to for so
    /// long. It counts from when no frame waits any more. Where the port can be opened again, that is done instead.
    ///
    /// # Errors
    /// [`LinkError::NoFrames`], [`LinkError::Watches`].
    pub fn check_silence(&self, most: Duration) -> Result<(), LinkError> {
        if self.link.has_frames() {
            self.link.expect_frames();
            return Ok(());
        }
        let counters = self.link.counters();
        // Only who watches may do without frames.
        let watches = self.watch.borrow().is_some();
        if counters
            .silent
            .max(if watches { Duration::ZERO } else { counters.frameless })
            <= most
        {
            return Ok(());
        }
        let (s, bytes) = (most.as_secs(), counters.bytes_unread);
        let why = if counters.silent <= most {
            LinkError::Watches { s }
        } else {
            LinkError::NoFrames { s, bytes }
        };
        if !self.link.reopens() {
            return Err(why);
        }
        self.link.reopen(why.to_string());
        self.link.expect_frames();
        Ok(())
    }

    /// What became of the connection, oldest first; each is told once. What [`Session::frame`] gave before belongs before it.
    pub fn event(&self) -> Option<ConnectionEvent> {
        self.events.borrow_mut().pop_front()
    }

    /// What the board said unasked, oldest first; each is told once.
    pub fn notice(&self) -> Option<Notice> {
        self.notices.borrow_mut().pop_front()
    }

    /// Whether the board is missed now.
    pub fn is_away(&self) -> bool {
        *self.connection.borrow() != Connection::Up
    }

    /// How often the connection was restored: frames of the same count came by one connection.
    pub fn restored(&self) -> u32 {
        self.restored.get()
    }

    /// How long a frame of the plan takes, s: what the plan promises.
    pub fn frame_s(&self) -> f64 {
        f64::from(self.plan.quarters()) / f64::from(QUARTERS) / self.hello.excitation_hz().max(1.0)
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

    /// The next frame of the plan in force. `None` when none came in time, when the board said that it watches, and when there is
    /// an [event](Session::event). A board that was reset meanwhile (its sequence and its time begin anew) is given the plan again
    /// and started.
    ///
    /// # Errors
    /// The port is gone and cannot be opened again, another board is behind it, or the board stopped with an error.
    pub fn frame(&self, wait: Duration) -> Result<Option<MeasuredFrame>, LinkError> {
        let end = Instant::now() + wait;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let away = self.is_away();
            let received = match self.link.receive(if away { left.min(GREETING) } else { left }) {
                Err(LinkError::Lost(why)) if self.link.reopens() => {
                    self.lose(why);
                    return Ok(None);
                }
                received => received?,
            };
            if away {
                let over = self.look_for(received)?;
                if over || Instant::now() >= end {
                    return Ok(None);
                }
                continue;
            }
            match received {
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
                Some(FromBoard::Hello(hello)) => {
                    // It was reset: every time it is, at once.
                    if hello.is_same_board(&self.hello) {
                        self.resume();
                    } else if self.link.reopens() {
                        self.lose("another board is behind the port now".to_owned());
                        self.meet(&hello)?;
                        return Ok(None);
                    } else {
                        return Err(LinkError::Lost("another board is behind the port now".to_owned()));
                    }
                }
                // It was reset, its introduction was lost, and it has the watch of its power-up.
                Some(FromBoard::Heartbeat(_)) if self.watch.borrow().is_none() => {
                    if self.patience_is_over() {
                        self.resume();
                    }
                    return Ok(None);
                }
                Some(FromBoard::Heartbeat(beat)) => {
                    self.told.set(Instant::now());
                    self.watching.set(beat.state);
                    return Ok(None);
                }
                // It was reset, its introduction was lost, and it has the plan of its power-up.
                Some(FromBoard::Frame(_)) if self.patience_is_over() => self.resume(),
                Some(FromBoard::Status(status)) => {
                    if self.excitation.get().is_none() {
                        self.excitation.set(Some(status.excitation_permille));
                    }
                }
                Some(FromBoard::Notice(notice)) => self.notices.borrow_mut().push_back(notice),
                Some(FromBoard::Error(BoardError::Command(e))) => {
                    tracing::debug!("the board could not read a command: {e}");
                }
                Some(FromBoard::Error(e)) => return Err(LinkError::Refused(e.to_string())),
                Some(_) => {}
            }
        }
    }

    /// The port was lost.
    fn lose(&self, why: String) {
        let since = match &*self.connection.borrow() {
            Connection::Up => None,
            Connection::Lost { since, other } => Some((*since, *other)),
            Connection::Told { since, .. } => Some((*since, false)),
        };
        if since.is_none() {
            self.events.borrow_mut().push_back(ConnectionEvent::Lost { why });
        }
        let (since, other) = since.unwrap_or((Instant::now(), false));
        self.connection.replace(Connection::Lost { since, other });
        self.watching.set(Watching::Off);
        // The link asks whoever comes.
        self.told.set(Instant::now());
    }

    /// Asks whoever is there; nobody hears it while the port is gone.
    fn ask_who(&self) {
        self.told.set(Instant::now());
        self.link.send(ToBoard::Hello);
    }

    /// Takes what comes while the board is missed; whether it is back. Frames are nobody's as long as it is not known whose.
    fn look_for(&self, received: Option<FromBoard>) -> Result<bool, LinkError> {
        match received {
            Some(FromBoard::Hello(hello)) => self.meet(&hello)?,
            Some(FromBoard::Plan(said)) => {
                let confirmed = self.connection.borrow().confirmed(&said, &self.plan);
                if let Some((since, firmware)) = confirmed {
                    self.connection.replace(Connection::Up);
                    self.restored.set(self.restored.get() + 1);
                    let away = since.elapsed();
                    let restored = ConnectionEvent::Restored { away, firmware };
                    self.events.borrow_mut().push_back(restored);
                    return Ok(true);
                }
            }
            Some(FromBoard::Error(BoardError::Command(_))) => {}
            Some(FromBoard::Error(e)) if matches!(&*self.connection.borrow(), Connection::Told { .. }) => {
                return Err(LinkError::Refused(e.to_string()));
            }
            _ => {}
        }
        let patience = match &*self.connection.borrow() {
            Connection::Told { .. } => PATIENCE,
            _ => GREETING,
        };
        if self.told.get().elapsed() >= patience {
            self.ask_who();
        }
        Ok(false)
    }

    /// Somebody introduced itself where the board was.
    fn meet(&self, hello: &Hello) -> Result<(), LinkError> {
        let (since, told) = match &*self.connection.borrow() {
            Connection::Up => return Ok(()),
            Connection::Lost { since, other } => (*since, *other),
            Connection::Told { since, .. } => (*since, false),
        };
        let firmware = match Identity::of(hello, &self.hello) {
            Identity::Same => None,
            Identity::OtherFirmware(firmware) => Some(firmware),
            Identity::Changed => return Err(LinkError::Changed),
            Identity::Other => {
                if !told {
                    self.events.borrow_mut().push_back(ConnectionEvent::OtherBoard {
                        serial: hello.serial.to_string(),
                        wanted: self.hello.serial.to_string(),
                    });
                }
                self.connection.replace(Connection::Lost { since, other: true });
                self.link.reopen("another board is behind the port".to_owned());
                return Ok(());
            }
        };
        self.connection.replace(Connection::Told { since, firmware });
        self.resume();
        Ok(())
    }

    /// Whether the board was told what to do so long ago that it must have heard it or lost it.
    fn patience_is_over(&self) -> bool {
        self.told.get().elapsed() >= PATIENCE
    }

    /// Tells the board again what to do.
    fn resume(&self) {
        self.told.set(Instant::now());
        self.link.send(ToBoard::SetWatch(self.watch.borrow().clone()));
        if let Some(permille) = self.excitation.get() {
            self.link.send(ToBoard::SetExcitation(permille));
        }
        self.link.send(ToBoard::SetPlan(self.plan.clone()));
        self.link.send(ToBoard::Start);
    }

    fn fits(&self, frame: &Frame) -> bool {
        frame.plan == self.plan.id && frame.values.len() == self.plan.value_count()
    }
}
