//! What is measured when: frames, the watch while nothing touches, and tests in between.

mod source;
mod testing;
mod watch;

use crate::board_info::BoardInfo;
use crate::error::{Error, ErrorKind};
use crate::front_end::FrontEnd;
use crate::lives::Lives;
use crate::memory::Memory;
use crate::reference::SAMPLES_PER_PERIOD;
use crate::scan::{Pace, Progress};
use crate::scan_error::ScanError;
use crate::support::Support;
use crate::task::{Probe, Task, recipe};
use crate::watch_state::WatchState;
use core::ops::DerefMut;
use protocol::{BoardError, Counters, FrontEndFault, Heartbeat, Outgoing, QUARTERS, Watching};

/// Periods beyond a window's own that a front end may take to lend it. Fewer stop a board whose front end lends late; more
/// only delay the report of a front end that hangs.
const LATE_PERIODS: u32 = 2;

/// Everything that is measured, and the state of measuring. It owns what measuring works on: the front end, the chip's
/// support and the memory. Messages go to the memory's outbox.
#[derive(Debug)]
pub(crate) struct Measuring<'a, F, S, M> {
    info: BoardInfo<'a>,
    front: F,
    support: S,
    memory: M,
    counters: Counters,
    /// Of the next frame.
    sequence: u32,
    /// Whether the board was told to measure.
    running: bool,
    task: Task,
    /// What is measured by itself, for a test or a diagnosis.
    probe: Probe,
    /// When the scan last went on, in samples since power-up.
    went_on: u64,
    watch: WatchState,
    lives: Lives,
    /// When the source is measured next between two frames, in samples since power-up.
    check_at: u64,
    /// Its amplitude when measuring began, in thousandths of full scale; 0 until that is known.
    began_permille: u16,
    /// Whether it was wrong when it was measured last.
    source_is_off: bool,
}

impl<'a, F, S, M> Measuring<'a, F, S, M>
where
    F: FrontEnd,
    S: Support,
    M: DerefMut<Target = Memory>,
{
    /// Nothing is measured yet.
    pub(crate) fn new(info: BoardInfo<'a>, front: F, support: S, mut memory: M) -> Self {
        memory.scan.wire(info.wiring());
        Self {
            info,
            front,
            support,
            memory,
            counters: Counters::default(),
            sequence: 0,
            running: false,
            task: Task::Off,
            probe: Probe::default(),
            went_on: 0,
            watch: WatchState::OFF,
            lives: Lives::NONE,
            check_at: 0,
            began_permille: 0,
            source_is_off: false,
        }
    }

    /// Counts this life, before anything that could end it.
    pub(crate) fn begin_life(&mut self) {
        self.lives = Lives::begun(self.info.reset, self.support.recall());
        self.support.keep(self.lives.word());
    }

    /// The lives before this one that ended badly.
    pub(crate) fn lives(&self) -> Lives {
        self.lives
    }

    /// The board's constants.
    pub(crate) fn info(&self) -> &BoardInfo<'a> {
        &self.info
    }

    /// The front end.
    pub(crate) fn front_mut(&mut self) -> &mut F {
        &mut self.front
    }

    /// Clock, watchdog and store.
    pub(crate) fn support_mut(&mut self) -> &mut S {
        &mut self.support
    }

    /// The large part of the state.
    pub(crate) fn memory(&self) -> &Memory {
        &self.memory
    }

    /// The same, to be changed.
    pub(crate) fn memory_mut(&mut self) -> &mut Memory {
        &mut self.memory
    }

    /// Constants, front end, memory and support at once: for settings, and the store that keeps them.
    pub(crate) fn parts(&mut self) -> (&BoardInfo<'a>, &F, &mut Memory, &mut S) {
        (&self.info, &self.front, &mut self.memory, &mut self.support)
    }

    /// What was counted so far.
    pub(crate) fn counters(&self) -> &Counters {
        &self.counters
    }

    /// The same, to be changed.
    pub(crate) fn counters_mut(&mut self) -> &mut Counters {
        &mut self.counters
    }

    /// Whether the board was told to measure, and does.
    pub(crate) fn running(&self) -> bool {
        self.running
    }

    /// What the board does about its watch.
    pub(crate) fn watching(&self) -> Watching {
        self.watch.watching()
    }

    /// Whether nothing is measured.
    pub(crate) fn is_at_rest(&self) -> bool {
        self.task == Task::Off
    }

    /// Whether a test or a folded period is under way, which is finished and answered whatever else is asked for.
    pub(crate) fn is_testing(&self) -> bool {
        matches!(
            self.task,
            Task::TestSource | Task::TestPair | Task::TestSense | Task::Period
        )
    }

    /// Queues a message for the link.
    pub(crate) fn send(&mut self, message: Outgoing<'_>) {
        let dropped = self.memory.outbox.push(&message);
        Counters::add(&mut self.counters.dropped, dropped);
    }

    /// Measures from here on, or once a test under way is over. False if it failed, which was then reported.
    pub(crate) fn run(&mut self) -> bool {
        if self.is_testing() {
            self.begin_running();
            true
        } else {
            self.running || self.start()
        }
    }

    /// Measures nothing more. A test under way is finished first. False if the source could not be switched off, which was
    /// then reported.
    pub(crate) fn stop(&mut self) -> bool {
        self.running = false;
        self.watch.switch_off();
        self.is_testing() || self.rest()
    }

    /// Begins the frame under way anew, if there is one: the plan was changed.
    pub(crate) fn restart_frame(&mut self) {
        if self.task == Task::Frames {
            self.begin(Task::Frames);
        }
    }

    /// The baseline of the watch is to be learned anew.
    pub(crate) fn forget_baseline(&mut self) {
        let memory = &mut *self.memory;
        match &memory.settings.watch {
            Some(w) => memory
                .change
                .learn(w.learn_scans, w.recipe().value_count(), w.slots.len()),
            None => memory.change.learn(0, 0, 0),
        }
        self.watch.switch_off();
    }

    /// Begins to measure by the settings, the source first. False if it failed, which was then reported.
    pub(crate) fn start(&mut self) -> bool {
        self.begin_running();
        self.watch.switch_off();
        self.excite() && {
            self.probe = Probe::drive_pair(0, self.info.electrodes, 0);
            self.begin(Task::Source)
        }
    }

    /// The board measures from here on; its source is not known yet.
    fn begin_running(&mut self) {
        self.running = true;
        let now = self.support.now();
        self.lives.measures_from(now);
        (self.began_permille, self.source_is_off) = (0, false);
    }

    /// Measures what the board was told to, from here on; nothing if it was not.
    pub(crate) fn resume(&mut self) {
        if !self.running {
            self.rest();
            return;
        }
        let before = self.watch.watching();
        let memory = &*self.memory;
        let task = self
            .watch
            .resume(memory.settings.watch.as_ref(), memory.change.is_ready());
        if self.begin(task) && self.watch.watching() != before {
            self.beat();
        }
    }

    /// Ends what is under way and makes the sheet safe. False if the source could not be switched off, which was then
    /// reported.
    fn rest(&mut self) -> bool {
        self.task = Task::Off;
        self.memory.scan.stop();
        match self.front.switch_off() {
            Ok(()) => true,
            Err(e) => {
                self.fail(e.kind());
                false
            }
        }
    }

    /// Begins a task now; false if the front end failed, which was then reported.
    fn begin(&mut self, task: Task) -> bool {
        self.begin_after(task, 0)
    }

    fn begin_after(&mut self, task: Task, rest: u16) -> bool {
        self.task = task;
        self.went_on = self.support.now();
        let memory = &mut *self.memory;
        let recipe = recipe(task, &memory.settings, &self.probe);
        let started = match task {
            Task::Off => Ok(()),
            Task::Source | Task::Check | Task::TestSource => memory.scan.start_source(recipe, &mut self.front),
            Task::Watch => memory.scan.start(recipe, Pace::ByOne, rest, &mut self.front),
            Task::Frames => memory.scan.start(recipe, Pace::Through, rest, &mut self.front),
            Task::TestPair | Task::TestSense | Task::Period => {
                memory.scan.start(recipe, Pace::Ahead, rest, &mut self.front)
            }
        };
        self.survived(started)
    }

    /// One step of what is measured; whether it did anything. In a function of its own, so that a board's test can look at what
    /// is reached from here.
    #[inline(never)]
    pub(crate) fn measure(&mut self) -> bool {
        if self.task == Task::Off {
            return false;
        }
        let memory = &mut *self.memory;
        let recipe = recipe(self.task, &memory.settings, &self.probe);
        match memory.scan.step(recipe, &mut self.front) {
            Ok(progress) => {
                // As good as the time now, which costs more to ask for.
                self.went_on = self.memory.scan.reached();
                match (progress, self.task) {
                    (Progress::Working, _) => {}
                    (Progress::Slot, Task::Watch) => self.watch_slot(),
                    (Progress::Slot, _) => {}
                    (Progress::Complete, Task::Frames) => self.frame(),
                    (Progress::Complete, Task::Watch) => self.watch_scan(),
                    (Progress::Complete, Task::Source) => self.source(),
                    (Progress::Complete, Task::Check) => self.checked(),
                    (Progress::Complete, Task::TestSource) => self.tested_source(),
                    (Progress::Complete, Task::TestPair) => self.tested_pair(),
                    (Progress::Complete, Task::TestSense) => self.tested_sense(),
                    (Progress::Complete, Task::Period) => self.period(),
                    (Progress::Complete, Task::Off) => {}
                }
                true
            }
            Err(nb::Error::WouldBlock) => {
                let quarters = self.memory.scan.window_quarters() + LATE_PERIODS * QUARTERS;
                let patience = u64::from(quarters) * SAMPLES_PER_PERIOD as u64 / u64::from(QUARTERS);
                if self.support.now().saturating_sub(self.went_on) > patience {
                    self.fail(ErrorKind::Timeout);
                    return true;
                }
                false
            }
            Err(nb::Error::Other(e)) => {
                self.survived(Err(e));
                true
            }
        }
    }

    /// Deals with a scan's error: a lost sample costs what is measured now, which begins anew; anything else would come
    /// again, and stops the board.
    fn survived(&mut self, result: Result<(), ScanError<F::Error>>) -> bool {
        let kind = match result {
            Ok(()) => return true,
            Err(ScanError::FrontEnd(e)) => e.kind(),
            Err(ScanError::Block(_)) => ErrorKind::Other,
        };
        if self.task == Task::Frames {
            // The frame under way is lost: its number is never sent.
            self.sequence = self.sequence.wrapping_add(1);
        }
        if kind != ErrorKind::Overrun {
            self.fail(kind);
            return false;
        }
        Counters::add(&mut self.counters.overruns, 1);
        let memory = &mut *self.memory;
        let recipe = recipe(self.task, &memory.settings, &self.probe);
        let again = match self.task {
            Task::Source | Task::Check | Task::TestSource => memory.scan.start_source(recipe, &mut self.front),
            Task::Watch => memory.scan.start(recipe, Pace::ByOne, 0, &mut self.front),
            Task::Frames => memory.scan.start(recipe, Pace::Through, 0, &mut self.front),
            _ => memory.scan.start(recipe, Pace::Ahead, 0, &mut self.front),
        };
        self.went_on = self.support.now();
        match again {
            Ok(()) => true,
            Err(ScanError::FrontEnd(e)) => {
                self.fail(e.kind());
                false
            }
            Err(ScanError::Block(_)) => {
                self.fail(ErrorKind::Other);
                false
            }
        }
    }

    /// A fault that the next frame would meet again: stop, make the sheet safe, and say so.
    fn fail(&mut self, kind: ErrorKind) {
        Counters::add(&mut self.counters.front_end_faults, 1);
        self.halt(match kind {
            ErrorKind::Timeout => FrontEndFault::Timeout,
            ErrorKind::Route => FrontEndFault::Route,
            ErrorKind::Overrun | ErrorKind::Other => FrontEndFault::Other,
        });
    }

    fn halt(&mut self, fault: FrontEndFault) {
        self.running = false;
        self.watch.switch_off();
        self.task = Task::Off;
        self.memory.scan.stop();
        // Already failing: a source that does not stop either changes nothing about that.
        let _ = self.front.switch_off();
        self.send(Outgoing::Error(&BoardError::FrontEnd(fault)));
    }

    /// A frame is complete: the next drive first, then the frame on its way.
    fn frame(&mut self) {
        let next = if self.went_on >= self.check_at {
            self.probe = Probe::source(self.info.electrodes);
            Task::Check
        } else {
            self.watch.after_frame(self.memory.settings.watch.as_ref())
        };
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        Counters::add(&mut self.counters.frames, 1);
        self.begin(next);
        self.send_frame(sequence);
    }

    /// Queues the complete frame, as it is in the scan.
    fn send_frame(&mut self, sequence: u32) {
        let memory = &mut *self.memory;
        let plan = &memory.settings.plan;
        let frame = memory.scan.frame(sequence, plan.id, plan.quadrature);
        Counters::add(&mut self.counters.clipped, frame.clipped.count());
        let dropped = memory.outbox.push(&Outgoing::Frame(frame));
        Counters::add(&mut self.counters.dropped, dropped);
    }

    /// Says that it is alive and what it does.
    fn beat(&mut self) {
        let beat = Heartbeat {
            time: self.support.now(),
            state: self.watch.watching(),
            level: self.watch.take_level(),
            scans: self.counters.watch_scans,
        };
        self.send(Outgoing::Heartbeat(beat));
    }
}
