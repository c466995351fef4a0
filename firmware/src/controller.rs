//! The board's one loop: commands in, frames out.

use crate::answers::Answers;
use crate::board_info::BoardInfo;
use crate::front_end::FrontEnd;
use crate::measuring::Measuring;
use crate::memory::Memory;
use crate::route::Router;
use crate::settings::{self, Settings, StoreFault};
use crate::support::Support;
use crate::task::Probe;
use core::ops::DerefMut;
use embedded_hal_nb::serial::{Read, Write};
use protocol::{
    BoardError, Command, Counters, FrameError, Hello, Limits, Notice, Outgoing, PeriodRequest, Plan, PlanError, Recipe,
    Refusal, Sampling, Status, Stored, ToBoard, Watch, WatchNumber, Watching,
};

/// Most bytes of commands taken in one poll: a flood of commands cannot starve the scan. At 1 Mbit/s 64 bytes arrive in 640 us;
/// fewer could fall behind the link between rare polls, more delay the next block of samples.
const BYTES_A_POLL: usize = 64;

/// Whether a poll found anything to do. A board may sleep until the next interrupt when it did not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// Nothing to do until a block is complete, a byte arrives or the transmitter has room.
    Idle,
    /// Something was done; poll again.
    Busy,
}

/// The whole firmware above the chip: a front end, a serial port, the chip's clock, watchdog and store, and what is between
/// them, in a [`Memory`] of its own: a `&'static mut` one on a board, a boxed one elsewhere.
#[derive(Debug)]
pub struct Controller<'a, F, L, S, M> {
    measuring: Measuring<'a, F, S, M>,
    link: L,
    /// How the store goes together with the settings.
    stored: Stored,
    answers: Answers,
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
            measuring: Measuring::new(info, front, support, memory),
            link,
            stored: Stored::Nothing,
            answers: Answers::NONE,
        };
        this.measuring.memory_mut().settings.plan = plan;
        Ok(this)
    }

    /// Takes up the stored settings, and introduces the board. Once, before the first poll.
    ///
    /// After a panic or the watchdog's reset it does not start by itself; after three of them in a row it does not look at
    /// the stored settings either. It says so. Half a minute of measuring, or any other reset, and they count no more.
    pub fn start_up(&mut self) {
        self.measuring.begin_life();
        let lives = self.measuring.lives();
        if lives.takes_settings() {
            self.remember();
        } else {
            self.stored = Stored::Unread;
        }
        self.measuring.forget_baseline();
        self.introduce();
        self.tell_careful();
        log!(info, "resets by faults of its own, in a row: {=u8}", lives.resets());
        if self.measuring.memory().settings.autostart && lives.resets() == 0 {
            self.measuring.start();
        }
    }

    /// Says that the board does less than it was told to keep, if so.
    fn tell_careful(&mut self) {
        let lives = self.measuring.lives();
        let (resets, settings) = (lives.resets(), lives.takes_settings());
        if resets > 0 {
            self.measuring
                .send(Outgoing::Notice(Notice::Careful { resets, settings }));
        }
    }

    /// Takes up the stored settings, if there are any that the board can carry out. A store that does not work is found by
    /// the self-test; the board works without.
    #[inline(never)]
    fn remember(&mut self) {
        let (info, front, memory, support) = self.measuring.parts();
        let mut taken = false;
        let found = settings::load_with(support, |stored| {
            if suits(stored, info, front) {
                memory.settings.copy_from(stored);
                taken = true;
            }
        });
        self.stored = match (found, taken) {
            (Ok(false), _) => Stored::Nothing,
            (Ok(true), true) => Stored::InForce,
            (Ok(true), false) | (Err(_), _) => Stored::Unusable,
        };
        log!(info, "settings: {}", self.stored);
    }

    /// Does what can be done now and returns; never waits, except for the store.
    ///
    /// Deadline while scanning: once for every block of samples, before the front end runs out of room for blocks. A
    /// missed deadline is an overrun: that frame is lost, counted, and seen by the receiver as a gap in the sequence.
    pub fn poll(&mut self) -> Activity {
        self.measuring.support_mut().feed();
        let received = self.receive();
        if self.answers.is_owing() {
            self.tell_passed_over();
        }
        let measured = self.measuring.measure();
        let sent = match self.measuring.memory_mut().outbox.pump(&mut self.link) {
            Ok(bytes) => bytes > 0,
            Err(_) => {
                Counters::add(&mut self.measuring.counters_mut().transmit_errors, 1);
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
        self.measuring.running()
    }

    /// What the board does about its watch.
    pub fn watching(&self) -> Watching {
        self.measuring.watching()
    }

    /// Whether nothing will be sent until a command comes: nothing is measured, and nothing waits for the link.
    pub fn is_quiet(&self) -> bool {
        self.measuring.is_at_rest() && self.measuring.memory().outbox.is_empty()
    }

    /// What was counted so far.
    pub fn counters(&self) -> &Counters {
        self.measuring.counters()
    }

    /// What the board is set to and does.
    pub fn status(&self) -> Status {
        let settings = &self.measuring.memory().settings;
        Status {
            running: self.running(),
            watching: self.watching(),
            autostart: settings.autostart,
            excitation_permille: settings.excitation_permille,
            stored: self.stored,
        }
    }

    /// Who the board says it is.
    pub fn hello(&self) -> Hello {
        self.measuring.info().hello()
    }

    /// The front end.
    pub fn front_mut(&mut self) -> &mut F {
        self.measuring.front_mut()
    }

    /// The serial port.
    pub fn link_mut(&mut self) -> &mut L {
        &mut self.link
    }

    /// Clock, watchdog and store.
    pub fn support_mut(&mut self) -> &mut S {
        self.measuring.support_mut()
    }

    fn receive(&mut self) -> bool {
        for taken in 0..BYTES_A_POLL {
            match self.link.read() {
                Ok(byte) => self.take(byte),
                Err(nb::Error::WouldBlock) => return taken > 0,
                Err(nb::Error::Other(_)) => {
                    Counters::add(&mut self.measuring.counters_mut().receive_errors, 1);
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
                Counters::add(&mut self.measuring.counters_mut().commands, 1);
                if let Err(e) = self.obey(command) {
                    self.refuse(&e);
                }
            }
            Some(Err(e)) => {
                let (now, second) = (self.now(), self.measuring.info().samples_per_second());
                if self.answers.answers(now, second) {
                    self.refuse(&BoardError::Command(*e));
                } else {
                    Counters::add(&mut self.measuring.counters_mut().refused, 1);
                }
            }
        }
    }

    // In a function of its own, whose stack is free again when the command is carried out.
    #[inline(never)]
    fn decoded(&mut self, byte: u8) -> Option<Result<ToBoard, FrameError>> {
        self.measuring.memory_mut().decoder.push_byte(byte)
    }

    fn now(&mut self) -> u64 {
        self.measuring.support_mut().now()
    }

    /// Says what was passed over, once it may.
    #[inline(never)]
    fn tell_passed_over(&mut self) {
        let now = self.now();
        if let Some(count) = self.answers.take(now) {
            log!(warn, "passed over: {=u32} messages that cannot be read", count);
            self.measuring.send(Outgoing::Notice(Notice::PassedOver { count }));
        }
    }

    fn refuse(&mut self, error: &BoardError) {
        log!(warn, "refused: {}", error);
        Counters::add(&mut self.measuring.counters_mut().refused, 1);
        self.measuring.send(Outgoing::Error(error));
    }

    fn acknowledge(&mut self, command: Command) {
        self.measuring.send(Outgoing::Ack(command));
    }

    /// Carries a command out and answers it.
    ///
    /// # Errors
    /// The command was refused and changed nothing.
    fn obey(&mut self, command: &ToBoard) -> Result<(), BoardError> {
        match command {
            ToBoard::Hello => self.introduce(),
            ToBoard::Start => self.start(),
            ToBoard::Stop => self.stop(),
            ToBoard::SetPlan(plan) => return self.set_plan(plan),
            ToBoard::GetPlan => self.send_plan(),
            ToBoard::GetCounters => self.send_counters(),
            ToBoard::ResetCounters => self.reset_counters(),
            ToBoard::SetWatch(watch) => return self.set_watch(watch.as_ref()),
            ToBoard::GetWatch => self.send_watch(),
            ToBoard::TakeBaseline => return self.take_baseline(),
            ToBoard::GetBaseline => self.send_baseline(),
            ToBoard::SelfTest => return self.self_test(),
            ToBoard::GetPeriod(request) => return self.measure_period(*request),
            ToBoard::SetExcitation(permille) => return self.set_excitation(*permille),
            ToBoard::SetAutostart(on) => self.set_autostart(*on),
            ToBoard::SaveSettings => return self.save_settings(),
            ToBoard::GetStatus => self.send_status(),
            ToBoard::ForgetSettings => return self.forget_settings(),
        }
        Ok(())
    }

    // The large messages are made in functions of their own, so that the loop's stack need not hold them.
    #[inline(never)]
    fn introduce(&mut self) {
        let hello = self.hello();
        self.measuring.send(Outgoing::Hello(&hello));
    }

    #[inline(never)]
    fn send_baseline(&mut self) {
        let baseline = self.measuring.memory().change.baseline();
        self.measuring.send(Outgoing::Baseline(&baseline));
    }

    fn send_plan(&mut self) {
        let memory = self.measuring.memory_mut();
        let dropped = memory.outbox.push(&Outgoing::Plan(&memory.settings.plan));
        Counters::add(&mut self.measuring.counters_mut().dropped, dropped);
    }

    fn send_watch(&mut self) {
        let memory = self.measuring.memory_mut();
        let dropped = memory.outbox.push(&Outgoing::Watch(&memory.settings.watch));
        Counters::add(&mut self.measuring.counters_mut().dropped, dropped);
    }

    fn send_counters(&mut self) {
        let counters = self.counters().clone();
        self.measuring.send(Outgoing::Counters(&counters));
    }

    fn send_status(&mut self) {
        // Before the answer: whoever waits for that has both.
        self.tell_careful();
        let status = self.status();
        self.measuring.send(Outgoing::Status(status));
    }

    /// Measures from here on. A failure is reported in place of the answer.
    fn start(&mut self) {
        if self.measuring.run() {
            self.acknowledge(Command::Start);
        }
    }

    /// Measures nothing more. A failure is reported in place of the answer.
    fn stop(&mut self) {
        if self.measuring.stop() {
            self.acknowledge(Command::Stop);
        }
    }

    fn reset_counters(&mut self) {
        *self.measuring.counters_mut() = Counters::default();
        self.acknowledge(Command::ResetCounters);
    }

    #[inline(never)]
    fn set_plan(&mut self, plan: &Plan) -> Result<(), BoardError> {
        let info = self.measuring.info();
        let check = plan.recipe().check(info.electrodes, info.gains(), &info.limits());
        check.map_err(BoardError::Plan)?;
        check_wired(plan.recipe(), self.measuring.front_mut()).map_err(BoardError::Plan)?;
        if self.measuring.memory().settings.plan != *plan {
            self.changed();
        }
        settings::copy_plan(&mut self.measuring.memory_mut().settings.plan, plan);
        self.send_plan();
        self.measuring.restart_frame();
        Ok(())
    }

    #[inline(never)]
    fn set_watch(&mut self, watch: Option<&Watch>) -> Result<(), BoardError> {
        if let Some(watch) = watch {
            let info = self.measuring.info();
            check_watch(watch, info, &info.limits())?;
            check_wired(watch.recipe(), self.measuring.front_mut()).map_err(BoardError::Watch)?;
        }
        if self.measuring.memory().settings.watch.as_ref() != watch {
            self.changed();
        }
        self.measuring.memory_mut().settings.watch = watch.cloned();
        self.measuring.forget_baseline();
        self.send_watch();
        self.resume_unless_testing();
        Ok(())
    }

    fn take_baseline(&mut self) -> Result<(), BoardError> {
        if self.measuring.memory().settings.watch.is_none() {
            return Err(BoardError::Refused(Refusal::NoWatch));
        }
        self.measuring.forget_baseline();
        self.resume_unless_testing();
        self.acknowledge(Command::TakeBaseline);
        Ok(())
    }

    /// Begins the self-test; its report is the answer.
    fn self_test(&mut self) -> Result<(), BoardError> {
        self.only_between_tests()?;
        self.measuring.test();
        Ok(())
    }

    /// Checks a request for a folded period and begins to measure it; the period is the answer.
    fn measure_period(&mut self, request: PeriodRequest) -> Result<(), BoardError> {
        self.only_between_tests()?;
        if !F::SAMPLED {
            return Err(BoardError::Refused(Refusal::NoSamples));
        }
        let info = self.measuring.info();
        let count = info.electrodes;
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
        Probe::period(request, count)
            .recipe()
            .check(count, info.gains(), &info.limits())
            .map_err(BoardError::Period)?;
        self.measuring.measure_period(request);
        Ok(())
    }

    /// Sets the source's amplitude. A failure of the source is reported in place of the answer.
    fn set_excitation(&mut self, given: u16) -> Result<(), BoardError> {
        self.only_between_tests()?;
        if given == 0 || given > 1000 {
            return Err(BoardError::Refused(Refusal::Excitation { given }));
        }
        if self.measuring.memory().settings.excitation_permille != given {
            self.changed();
        }
        self.measuring.memory_mut().settings.excitation_permille = given;
        self.measuring.forget_baseline();
        if !self.measuring.running() || self.measuring.start() {
            self.acknowledge(Command::SetExcitation);
        }
        Ok(())
    }

    fn set_autostart(&mut self, on: bool) {
        if self.measuring.memory().settings.autostart != on {
            self.changed();
        }
        self.measuring.memory_mut().settings.autostart = on;
        self.acknowledge(Command::SetAutostart);
    }

    fn save_settings(&mut self) -> Result<(), BoardError> {
        self.only_at_rest()?;
        let (_, _, memory, support) = self.measuring.parts();
        settings::save(support, &memory.settings).map_err(refused)?;
        self.stored = Stored::InForce;
        self.acknowledge(Command::SaveSettings);
        Ok(())
    }

    fn forget_settings(&mut self) -> Result<(), BoardError> {
        self.only_at_rest()?;
        settings::forget(self.measuring.support_mut()).map_err(refused)?;
        self.stored = Stored::Nothing;
        self.acknowledge(Command::ForgetSettings);
        Ok(())
    }

    /// Something of the settings was changed.
    fn changed(&mut self) {
        if self.stored == Stored::InForce {
            self.stored = Stored::Others;
        }
    }

    fn resume_unless_testing(&mut self) {
        if !self.measuring.is_testing() {
            self.measuring.resume();
        }
    }

    fn only_at_rest(&self) -> Result<(), BoardError> {
        refuse_if(!self.measuring.is_at_rest())
    }

    fn only_between_tests(&self) -> Result<(), BoardError> {
        refuse_if(self.measuring.is_testing())
    }
}

fn refuse_if(busy: bool) -> Result<(), BoardError> {
    if busy {
        Err(BoardError::Refused(Refusal::Busy))
    } else {
        Ok(())
    }
}

fn refused(fault: StoreFault) -> BoardError {
    BoardError::Refused(match fault {
        StoreFault::Failed => Refusal::Store,
        StoreFault::ReadBack => Refusal::ReadBack,
    })
}

/// Whether stored settings are ones that this board can carry out, and its amplifiers are wired for.
fn suits<F: Router>(settings: &Settings, info: &BoardInfo<'_>, front: &F) -> bool {
    let limits = info.limits();
    let plan = settings.plan.recipe();
    let carries = plan.check(info.electrodes, info.gains(), &limits).is_ok() && check_wired(plan, front).is_ok();
    let watches = |w: &Watch| check_watch(w, info, &limits).is_ok() && check_wired(w.recipe(), front).is_ok();
    carries && settings.watch.as_ref().is_none_or(watches) && (1..=1000).contains(&settings.excitation_permille)
}

/// Whether the amplifiers are where a recipe wants them.
fn check_wired<F: Router>(recipe: Recipe<'_>, front: &F) -> Result<(), PlanError> {
    for (slot, wanted) in (0..).zip(recipe.slots) {
        let (step, gain) = (wanted.sense_step, wanted.gain);
        if recipe.sampling == Sampling::Simultaneous && !front.senses_all(step, gain) {
            return Err(PlanError::NotWired { slot, step, gain });
        }
    }
    Ok(())
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
