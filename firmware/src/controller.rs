//! The board's one loop: commands in, frames out.

use crate::board_info::BoardInfo;
use crate::change::ChangeTest;
use crate::front_end::{Error, FrontEnd};
use crate::measuring::{Probe, Task};
use crate::outbox::Outbox;
use crate::scan::Scan;
use crate::settings::{self, Settings};
use crate::support::Support;
use core::ops::DerefMut;
use embedded_hal_nb::serial::{Read, Write};
use protocol::{
    BoardError, Command, Counters, Decoder, FrameError, Hello, Limits, MAX_TO_BOARD_LEN, Outgoing, PeriodRequest, Plan,
    PlanError, Refusal, SelfTest, Status, Stored, ToBoard, Watch, WatchNumber, Watching,
};

/// Bytes of messages that can wait for the link: two frames of 208 values, or one with quadrature and some answers.
const QUEUE: usize = 1280;

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

/// All of a controller that is large, about 5 KiB. A board keeps it in a static, since a stack that could build it would
/// have to be as large again.
#[derive(Debug)]
pub struct Memory {
    decoder: Decoder<MAX_TO_BOARD_LEN>,
    outbox: Outbox<QUEUE>,
    pub(crate) scan: Scan,
    pub(crate) settings: Settings,
    pub(crate) change: ChangeTest,
    pub(crate) report: SelfTest,
}

impl Default for Memory {
    fn default() -> Self {
        Self::new()
    }
}

impl Memory {
    /// As at power-up.
    pub const fn new() -> Self {
        Self {
            decoder: Decoder::new(),
            outbox: Outbox::new(),
            scan: Scan::new(),
            settings: Settings::NONE,
            change: ChangeTest::new(),
            report: SelfTest::NONE,
        }
    }
}

/// The whole firmware above the chip: a front end, a serial port, the chip's clock, watchdog and store, and what is between
/// them, in a [`Memory`] of its own: a `&'static mut` one on a board, a boxed one elsewhere.
#[derive(Debug)]
pub struct Controller<'a, F, L, S, M> {
    pub(crate) info: BoardInfo<'a>,
    pub(crate) front: F,
    link: L,
    pub(crate) support: S,
    pub(crate) memory: M,
    pub(crate) counters: Counters,
    /// Of the next frame.
    pub(crate) sequence: u32,
    /// Whether the board was told to measure.
    pub(crate) running: bool,
    pub(crate) task: Task,
    /// What is measured by itself, for a test or a diagnosis.
    pub(crate) probe: Probe,
    /// When the scan last went on.
    pub(crate) went_on: u64,
    pub(crate) watching: Watching,
    /// Frames since the watch was last scanned between them.
    pub(crate) frames: u16,
    /// Scans of the watch in a row that showed no change, while awake.
    pub(crate) quiet: u16,
    /// Scans since the last heartbeat, and the highest level of them.
    pub(crate) beat_scans: u16,
    pub(crate) beat_level: u16,
    /// How the store goes together with the settings.
    stored: Stored,
}

impl<'a, F, L, S, M> Controller<'a, F, L, S, M>
where
    F: FrontEnd,
    L: Read<u8> + Write<u8>,
    S: Support,
    M: DerefMut<Target = Memory>,
{
    /// A board that measures by the settings in its store, or by `plan` when there are none that it can carry out. It is not
    /// scanning yet, unless the settings say so. Its first message is its [`Hello`]: a program that is listening sees that
    /// the board was started anew.
    ///
    /// # Errors
    /// The board cannot carry `plan` out.
    pub fn new(info: BoardInfo<'a>, plan: Plan, front: F, link: L, support: S, memory: M) -> Result<Self, PlanError> {
        let mut this = Self::asleep(info, plan, front, link, support, memory)?;
        this.start_up();
        Ok(this)
    }

    /// The same before [`Controller::start_up`], for a board whose stack is too small for both at once.
    ///
    /// # Errors
    /// As [`Controller::new`].
    pub fn asleep(
        info: BoardInfo<'a>,
        plan: Plan,
        front: F,
        link: L,
        support: S,
        memory: M,
    ) -> Result<Self, PlanError> {
        plan.recipe().check(info.electrodes, info.gains(), &info.limits())?;
        let mut this = Self {
            info,
            front,
            link,
            support,
            memory,
            counters: Counters::default(),
            sequence: 0,
            running: false,
            task: Task::Off,
            probe: Probe::default(),
            went_on: 0,
            watching: Watching::Off,
            frames: 0,
            quiet: 0,
            beat_scans: 0,
            beat_level: 0,
            stored: Stored::Nothing,
        };
        this.memory
            .scan
            .wire(info.electrodes, info.skew_ticks, info.ticks_per_sample);
        this.memory.settings.plan = plan;
        Ok(this)
    }

    /// Takes up the stored settings, and introduces the board. Once, before the first poll.
    pub fn start_up(&mut self) {
        self.remember();
        self.forget_baseline();
        self.introduce();
        if self.memory.settings.autostart {
            self.start();
        }
    }

    /// Takes up the stored settings, if there are any that the board can carry out. A store that does not work is found by
    /// the self-test; the board works without.
    #[inline(never)]
    fn remember(&mut self) {
        let (info, settings) = (&self.info, &mut self.memory.settings);
        let mut taken = false;
        let found = settings::load_with(&mut self.support, |stored| {
            if suits(stored, info, &info.limits()) {
                settings.copy_from(stored);
                taken = true;
            }
        });
        self.stored = match (found, taken) {
            (Ok(false), _) => Stored::Nothing,
            (Ok(true), true) => Stored::InForce,
            (Ok(true), false) | (Err(_), _) => Stored::Unusable,
        };
    }

    /// Something of the settings was changed.
    fn changed(&mut self) {
        if self.stored == Stored::InForce {
            self.stored = Stored::Others;
        }
    }

    /// Does what can be done now and returns; never waits, except for the store.
    ///
    /// Deadline while scanning: once for every block of samples, before the front end runs out of room for blocks. A
    /// missed deadline is an overrun: that frame is lost, counted, and seen by the receiver as a gap in the sequence.
    pub fn poll(&mut self) -> Activity {
        self.support.feed();
        let received = self.receive();
        let measured = self.measure();
        let sent = match self.memory.outbox.pump(&mut self.link) {
            Ok(bytes) => bytes > 0,
            Err(_) => {
                Counters::add(&mut self.counters.transmit_errors, 1);
                true
            }
        };
        if received || measured || sent {
            Activity::Busy
        } else {
            Activity::Idle
        }
    }

    /// Whether the board was told to measure, and does.
    pub fn running(&self) -> bool {
        self.running
    }

    /// What the board does about its watch.
    pub fn watching(&self) -> Watching {
        self.watching
    }

    /// Whether nothing will be sent until a command comes: nothing is measured, and nothing waits for the link.
    pub fn is_quiet(&self) -> bool {
        self.task == Task::Off && self.memory.outbox.is_empty()
    }

    /// What was counted so far.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// What the board is set to and does.
    pub fn status(&self) -> Status {
        let settings = &self.memory.settings;
        Status {
            running: self.running,
            watching: self.watching,
            autostart: settings.autostart,
            excitation_permille: settings.excitation_permille,
            stored: self.stored,
        }
    }

    /// Who the board says it is.
    pub fn hello(&self) -> Hello {
        self.info.hello()
    }

    /// The front end.
    pub fn front_mut(&mut self) -> &mut F {
        &mut self.front
    }

    /// The serial port.
    pub fn link_mut(&mut self) -> &mut L {
        &mut self.link
    }

    /// Clock, watchdog and store.
    pub fn support_mut(&mut self) -> &mut S {
        &mut self.support
    }

    pub(crate) fn send(&mut self, message: Outgoing<'_>) {
        let dropped = self.memory.outbox.push(&message);
        Counters::add(&mut self.counters.dropped, dropped);
    }

    /// The complete frame, as it is in the scan.
    pub(crate) fn send_frame(&mut self, sequence: u32) {
        let memory = &mut *self.memory;
        let plan = &memory.settings.plan;
        let frame = memory.scan.frame(sequence, plan.id, plan.quadrature);
        Counters::add(&mut self.counters.clipped, frame.clipped.count());
        let dropped = memory.outbox.push(&Outgoing::Frame(frame));
        Counters::add(&mut self.counters.dropped, dropped);
    }

    // The large messages are made in functions of their own, so that the loop's stack need not hold them.
    #[inline(never)]
    fn introduce(&mut self) {
        let hello = self.info.hello();
        self.send(Outgoing::Hello(&hello));
    }

    #[inline(never)]
    fn send_baseline(&mut self) {
        let baseline = self.memory.change.baseline();
        self.send(Outgoing::Baseline(&baseline));
    }

    fn send_plan(&mut self) {
        let memory = &mut *self.memory;
        let dropped = memory.outbox.push(&Outgoing::Plan(&memory.settings.plan));
        Counters::add(&mut self.counters.dropped, dropped);
    }

    fn send_watch(&mut self) {
        let memory = &mut *self.memory;
        let dropped = memory.outbox.push(&Outgoing::Watch(&memory.settings.watch));
        Counters::add(&mut self.counters.dropped, dropped);
    }

    fn receive(&mut self) -> bool {
        for taken in 0..BYTES_A_POLL {
            match self.link.read() {
                Ok(byte) => self.take(byte),
                Err(nb::Error::WouldBlock) => return taken > 0,
                Err(nb::Error::Other(_)) => {
                    Counters::add(&mut self.counters.receive_errors, 1);
                    return true;
                }
            }
        }
        true
    }

    #[inline(never)]
    fn take(&mut self, byte: u8) {
        // Looked at where it is: the largest commands are too large for a stack twice.
        match &self.decoded(byte) {
            None => {}
            Some(Ok(command)) => {
                Counters::add(&mut self.counters.commands, 1);
                if let Err(e) = self.obey(command) {
                    self.refuse(&e);
                }
            }
            Some(Err(e)) => self.refuse(&BoardError::Command(*e)),
        }
    }

    // In a function of its own, whose stack is free again when the command is carried out.
    #[inline(never)]
    fn decoded(&mut self, byte: u8) -> Option<Result<ToBoard, FrameError>> {
        self.memory.decoder.push_byte(byte)
    }

    fn refuse(&mut self, error: &BoardError) {
        Counters::add(&mut self.counters.refused, 1);
        self.send(Outgoing::Error(error));
    }

    fn obey(&mut self, command: &ToBoard) -> Result<(), BoardError> {
        let done = match command {
            ToBoard::Hello => {
                self.introduce();
                return Ok(());
            }
            ToBoard::Start => {
                if self.testing() {
                    // Once the test is over.
                    self.running = true;
                } else if !self.running && !self.start() {
                    return Ok(());
                }
                Command::Start
            }
            ToBoard::Stop if self.testing() => {
                // The test is answered first, and then the excitation goes off.
                self.running = false;
                self.watching = Watching::Off;
                Command::Stop
            }
            ToBoard::Stop => {
                self.running = false;
                self.watching = Watching::Off;
                self.task = Task::Off;
                self.memory.scan.stop();
                if let Err(e) = self.front.switch_off() {
                    self.fail(e.kind());
                    return Ok(());
                }
                Command::Stop
            }
            ToBoard::SetPlan(plan) => return self.set_plan(plan),
            ToBoard::GetPlan => {
                self.send_plan();
                return Ok(());
            }
            ToBoard::GetCounters => {
                let counters = self.counters.clone();
                self.send(Outgoing::Counters(&counters));
                return Ok(());
            }
            ToBoard::ResetCounters => {
                self.counters = Counters::default();
                Command::ResetCounters
            }
            ToBoard::SetWatch(watch) => return self.set_watch(watch.as_ref()),
            ToBoard::GetWatch => {
                self.send_watch();
                return Ok(());
            }
            ToBoard::TakeBaseline => {
                if self.memory.settings.watch.is_none() {
                    return Err(BoardError::Refused(Refusal::NoWatch));
                }
                self.forget_baseline();
                self.resume_unless_testing();
                Command::TakeBaseline
            }
            ToBoard::GetBaseline => {
                self.send_baseline();
                return Ok(());
            }
            ToBoard::SelfTest | ToBoard::GetPeriod(_) | ToBoard::SetExcitation(_) if self.testing() => {
                return Err(BoardError::Refused(Refusal::Busy));
            }
            ToBoard::SelfTest => {
                self.test();
                return Ok(());
            }
            ToBoard::GetPeriod(request) => return self.measure_period(*request),
            &ToBoard::SetExcitation(given) => {
                if given == 0 || given > 1000 {
                    return Err(BoardError::Refused(Refusal::Excitation { given }));
                }
                if self.memory.settings.excitation_permille != given {
                    self.changed();
                }
                self.memory.settings.excitation_permille = given;
                self.forget_baseline();
                if self.running && !self.start() {
                    return Ok(());
                }
                Command::SetExcitation
            }
            &ToBoard::SetAutostart(on) => {
                if self.memory.settings.autostart != on {
                    self.changed();
                }
                self.memory.settings.autostart = on;
                Command::SetAutostart
            }
            ToBoard::SaveSettings => {
                self.only_at_rest()?;
                settings::save(&mut self.support, &self.memory.settings)
                    .map_err(|_| BoardError::Refused(Refusal::Store))?;
                self.stored = Stored::InForce;
                Command::SaveSettings
            }
            ToBoard::GetStatus => {
                let status = self.status();
                self.send(Outgoing::Status(status));
                return Ok(());
            }
            ToBoard::ForgetSettings => {
                self.only_at_rest()?;
                settings::forget(&mut self.support).map_err(|_| BoardError::Refused(Refusal::Store))?;
                self.stored = Stored::Nothing;
                Command::ForgetSettings
            }
        };
        self.send(Outgoing::Ack(done));
        Ok(())
    }

    #[inline(never)]
    fn set_plan(&mut self, plan: &Plan) -> Result<(), BoardError> {
        let check = plan
            .recipe()
            .check(self.info.electrodes, self.info.gains(), &self.info.limits());
        check.map_err(BoardError::Plan)?;
        if self.memory.settings.plan != *plan {
            self.changed();
        }
        settings::copy_plan(&mut self.memory.settings.plan, plan);
        self.send_plan();
        if self.task == Task::Frames {
            self.begin(Task::Frames);
        }
        Ok(())
    }

    #[inline(never)]
    fn set_watch(&mut self, watch: Option<&Watch>) -> Result<(), BoardError> {
        if let Some(watch) = watch {
            check_watch(watch, &self.info, &self.info.limits())?;
        }
        if self.memory.settings.watch.as_ref() != watch {
            self.changed();
        }
        self.memory.settings.watch = watch.cloned();
        self.forget_baseline();
        self.send_watch();
        self.resume_unless_testing();
        Ok(())
    }

    /// Whether a test or a folded period is under way, which is finished and answered whatever else is asked for.
    fn testing(&self) -> bool {
        matches!(self.task, Task::TestSource | Task::TestPair | Task::Period)
    }

    fn resume_unless_testing(&mut self) {
        if !self.testing() {
            self.resume();
        }
    }

    fn only_at_rest(&self) -> Result<(), BoardError> {
        if self.task == Task::Off {
            Ok(())
        } else {
            Err(BoardError::Refused(Refusal::Busy))
        }
    }

    /// Checks a request for a folded period and begins to measure it.
    fn measure_period(&mut self, request: PeriodRequest) -> Result<(), BoardError> {
        let count = self.info.electrodes;
        for electrode in [request.sense.plus, request.sense.minus] {
            if electrode >= count {
                let error = PlanError::Electrode {
                    slot: 0,
                    electrode,
                    count,
                };
                return Err(BoardError::Period(error));
            }
        }
        let probe = Probe::period(request, count);
        probe
            .recipe()
            .check(count, self.info.gains(), &self.info.limits())
            .map_err(BoardError::Period)?;
        self.probe = probe;
        self.begin(Task::Period);
        Ok(())
    }

    /// The baseline of the watch is to be learned anew.
    fn forget_baseline(&mut self) {
        let memory = &mut *self.memory;
        match &memory.settings.watch {
            Some(w) => memory
                .change
                .learn(w.learn_scans, w.recipe().value_count(), w.slots.len()),
            None => memory.change.learn(0, 0, 0),
        }
        self.watching = Watching::Off;
    }
}

/// Whether stored settings are ones that this board can carry out.
fn suits(settings: &Settings, info: &BoardInfo<'_>, limits: &Limits) -> bool {
    let plan = settings.plan.recipe().check(info.electrodes, info.gains(), limits);
    let watch = settings.watch.as_ref().map_or(Ok(()), |w| check_watch(w, info, limits));
    plan.is_ok() && watch.is_ok() && (1..=1000).contains(&settings.excitation_permille)
}

/// Whether the board can carry a watch out.
fn check_watch(watch: &Watch, info: &BoardInfo<'_>, limits: &Limits) -> Result<(), BoardError> {
    let limits = Limits {
        slots: limits.watch_slots,
        values: limits.watch_values.into(),
        ..limits.clone()
    };
    watch
        .recipe()
        .check(info.electrodes, info.gains(), &limits)
        .map_err(BoardError::Watch)?;
    for (what, given, least) in [
        (WatchNumber::LearnScans, watch.learn_scans, 2),
        (WatchNumber::Threshold, watch.threshold, 1),
        (WatchNumber::FramesBetween, watch.frames_between, 1),
        (WatchNumber::QuietScans, watch.quiet_scans, 1),
        (WatchNumber::HeartbeatScans, watch.heartbeat_scans, 1),
    ] {
        if given < least {
            return Err(BoardError::Refused(Refusal::Watch { what, least }));
        }
    }
    Ok(())
}
