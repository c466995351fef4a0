//! What is measured when: frames, the watch while nothing touches, and tests in between.

use crate::controller::{Controller, Memory};
use crate::front_end::{Error, ErrorKind, FrontEnd};
use crate::reference::SAMPLES_PER_PERIOD;
use crate::scan::{Pace, Progress, ScanError};
use crate::settings::Settings;
use crate::support::Support;
use core::ops::DerefMut;
use embedded_hal_nb::serial::{Read, Write};
use protocol::{
    BoardError, Counters, FoldedPeriod, FrontEndFault, Heartbeat, Outgoing, Pair, PeriodRequest, QUARTERS, Recipe,
    Sampling, Slot, Watching,
};

/// What is being measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Task {
    /// Nothing.
    Off,
    /// The plan's values.
    Frames,
    /// The watch's values.
    Watch,
    /// The source's amplitude, before and while the board measures.
    Source,
    /// The source's amplitude, first part of the self-test.
    TestSource,
    /// The voltage of one drive pair after the other, second part of the self-test.
    TestPair,
    /// One folded period.
    Period,
}

/// One value that is measured by itself.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Probe {
    pub(crate) request: PeriodRequest,
    slot: Slot,
}

impl Probe {
    /// A value asked for, on a board of `electrodes`, which the sense pair's are.
    pub(crate) fn period(request: PeriodRequest, electrodes: u8) -> Self {
        let Pair { plus, minus } = request.sense;
        let step = (u16::from(plus) + u16::from(electrodes) - u16::from(minus)) % u16::from(electrodes.max(1));
        Self {
            request,
            slot: Slot {
                drive: request.drive,
                sense_step: step as u8,
                sense: 1u32.checked_shl(minus.into()).unwrap_or(0),
                gain: request.gain,
            },
        }
    }

    /// The source, or the voltage of drive pair `m`.
    pub(crate) fn drive_pair(m: u8, electrodes: u8, gain: u8) -> Self {
        let next = (u16::from(m) + 1) % u16::from(electrodes.max(1));
        let drive = Pair {
            plus: m,
            minus: next as u8,
        };
        let request = PeriodRequest {
            drive,
            sense: Pair {
                plus: drive.minus,
                minus: drive.plus,
            },
            gain,
            settle_quarters: 2 * QUARTERS as u16,
            periods: 8,
        };
        Self::period(request, electrodes)
    }

    pub(crate) fn recipe(&self) -> Recipe<'_> {
        Recipe {
            settle_quarters: self.request.settle_quarters,
            integrate_periods: self.request.periods,
            sampling: Sampling::Sequential,
            quadrature: true,
            slots: core::slice::from_ref(&self.slot),
        }
    }
}

/// The recipe of a task.
fn recipe<'b>(task: Task, settings: &'b Settings, probe: &'b Probe) -> Recipe<'b> {
    match (task, &settings.watch) {
        (Task::Frames | Task::Off, _) => settings.plan.recipe(),
        (Task::Watch, Some(watch)) => watch.recipe(),
        _ => probe.recipe(),
    }
}

/// Amplitude of the source, in thousandths of full scale, that the converter's codes and the whole thousandths leave open.
const ROUNDING_PERMILLE: u32 = 2;

impl<F, L, S, M> Controller<'_, F, L, S, M>
where
    F: FrontEnd,
    L: Read<u8> + Write<u8>,
    S: Support,
    M: DerefMut<Target = Memory>,
{
    /// Begins to measure by the settings, the source first. False if it failed, which was then reported.
    pub(crate) fn start(&mut self) -> bool {
        self.running = true;
        self.watching = Watching::Off;
        self.excite() && {
            self.probe = Probe::drive_pair(0, self.info.electrodes, 0);
            self.begin(Task::Source)
        }
    }

    /// Switches the source on at the amplitude that is set.
    pub(crate) fn excite(&mut self) -> bool {
        let set = self.front.set_amplitude(self.memory.settings.excitation_permille);
        match set.and_then(|()| self.front.switch_on()) {
            Ok(()) => true,
            Err(e) => {
                self.fail(e.kind());
                false
            }
        }
    }

    /// Measures what the board was told to, from here on; nothing if it was not.
    pub(crate) fn resume(&mut self) {
        if !self.running {
            self.task = Task::Off;
            self.memory.scan.stop();
            if let Err(e) = self.front.switch_off() {
                self.fail(e.kind());
            }
            return;
        }
        let before = self.watching;
        self.watching = match (&self.memory.settings.watch, before) {
            (None, _) => Watching::Off,
            (Some(_), _) if !self.memory.change.is_ready() => Watching::Learning,
            (Some(_), Watching::Off | Watching::Learning) => Watching::Asleep,
            (Some(_), same) => same,
        };
        let task = match self.watching {
            Watching::Off | Watching::Awake => Task::Frames,
            Watching::Learning | Watching::Asleep => Task::Watch,
        };
        if self.begin(task) && self.watching != before {
            self.beat();
        }
    }

    /// Begins a task now; false if the front end failed, which was then reported.
    pub(crate) fn begin(&mut self, task: Task) -> bool {
        self.begin_after(task, 0)
    }

    fn begin_after(&mut self, task: Task, rest: u16) -> bool {
        self.task = task;
        self.went_on = self.support.now();
        let memory = &mut *self.memory;
        let recipe = recipe(task, &memory.settings, &self.probe);
        let started = match task {
            Task::Off => Ok(()),
            Task::Source | Task::TestSource => memory.scan.start_source(recipe, &mut self.front),
            Task::Watch => memory.scan.start(recipe, Pace::ByOne, rest, &mut self.front),
            Task::Frames | Task::TestPair | Task::Period => {
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
                    (Progress::Complete, Task::TestSource) => self.tested_source(),
                    (Progress::Complete, Task::TestPair) => self.tested_pair(),
                    (Progress::Complete, Task::Period) => self.period(),
                    (Progress::Complete, Task::Off) => {}
                }
                true
            }
            Err(nb::Error::WouldBlock) => {
                // A window, and two periods for a front end that lends late.
                let patience = u64::from(self.memory.scan.window_quarters() + 2 * QUARTERS) * SAMPLES_PER_PERIOD as u64
                    / u64::from(QUARTERS);
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
            Task::Source | Task::TestSource => memory.scan.start_source(recipe, &mut self.front),
            Task::Watch => memory.scan.start(recipe, Pace::ByOne, 0, &mut self.front),
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
    pub(crate) fn fail(&mut self, kind: ErrorKind) {
        Counters::add(&mut self.counters.front_end_faults, 1);
        self.halt(match kind {
            ErrorKind::Timeout => FrontEndFault::Timeout,
            ErrorKind::Route => FrontEndFault::Route,
            ErrorKind::Overrun | ErrorKind::Other => FrontEndFault::Other,
        });
    }

    fn halt(&mut self, fault: FrontEndFault) {
        self.running = false;
        self.watching = Watching::Off;
        self.task = Task::Off;
        self.memory.scan.stop();
        // Already failing: a source that does not stop either changes nothing about that.
        let _ = self.front.switch_off();
        self.send(Outgoing::Error(&BoardError::FrontEnd(fault)));
    }

    /// A frame is complete: the next drive first, then the frame on its way.
    fn frame(&mut self) {
        let between = self.memory.settings.watch.as_ref().map(|w| w.frames_between);
        self.frames = self.frames.saturating_add(1);
        let next = match between {
            Some(most) if self.frames >= most => {
                self.frames = 0;
                Task::Watch
            }
            _ => Task::Frames,
        };
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        Counters::add(&mut self.counters.frames, 1);
        self.begin(next);
        self.send_frame(sequence);
    }

    /// A drive of the watch is over: the next one, or the plan if it showed a change.
    fn watch_slot(&mut self) {
        if self.look() {
            return;
        }
        let memory = &mut *self.memory;
        if let Some(watch) = &memory.settings.watch {
            let went = memory.scan.go_on(watch.recipe(), &mut self.front);
            self.survived(went);
        }
    }

    /// Puts the newest slot to the test; true if it woke the board.
    fn look(&mut self) -> bool {
        let memory = &mut *self.memory;
        let Some(watch) = &memory.settings.watch else {
            return false;
        };
        let Some(slot) = memory.scan.noise().len().checked_sub(1) else {
            return false;
        };
        let values = memory.scan.values();
        let size = watch.slots.get(slot).map_or(0, |s| s.sense.count_ones() as usize);
        let start = values.len().saturating_sub(size);
        memory.change.put(slot, start, values.get(start..).unwrap_or_default());
        let level = memory.change.level();
        self.beat_level = self.beat_level.max(level);
        if self.watching != Watching::Asleep || level < watch.threshold {
            return false;
        }
        self.watching = Watching::Awake;
        (self.frames, self.quiet) = (0, 0);
        Counters::add(&mut self.counters.wakes, 1);
        if self.begin(Task::Frames) {
            self.beat();
        }
        true
    }

    /// A scan of the watch is over.
    fn watch_scan(&mut self) {
        Counters::add(&mut self.counters.watch_scans, 1);
        if self.look() {
            return;
        }
        let memory = &mut *self.memory;
        let Some(watch) = &memory.settings.watch else {
            return self.resume();
        };
        let (level, rest) = (memory.change.level(), watch.rest_quarters);
        match self.watching {
            Watching::Off | Watching::Learning => {
                let ends = watch.slots.iter().scan(0, |end, slot| {
                    *end += slot.sense.count_ones() as usize;
                    Some(*end)
                });
                memory.change.learn_from(memory.scan.values(), ends);
                self.resume();
            }
            Watching::Asleep => {
                memory.change.follow(memory.scan.values());
                self.beat_scans = self.beat_scans.saturating_add(1);
                if self.beat_scans < watch.heartbeat_scans {
                    self.begin_after(Task::Watch, rest);
                } else {
                    // With each sign of life a look at the source.
                    self.probe = Probe::drive_pair(0, self.info.electrodes, 0);
                    if self.begin(Task::Source) {
                        self.beat();
                    }
                }
            }
            Watching::Awake => {
                self.quiet = if level < watch.threshold {
                    self.quiet.saturating_add(1)
                } else {
                    0
                };
                if self.quiet >= watch.quiet_scans {
                    self.watching = Watching::Asleep;
                    if self.begin_after(Task::Watch, rest) {
                        self.beat();
                    }
                } else {
                    self.begin(Task::Frames);
                }
            }
        }
    }

    /// Says that it is alive and what it does.
    fn beat(&mut self) {
        let beat = Heartbeat {
            time: self.support.now(),
            state: self.watching,
            level: self.beat_level,
            scans: self.counters.watch_scans,
        };
        (self.beat_scans, self.beat_level) = (0, 0);
        self.send(Outgoing::Heartbeat(beat));
    }

    /// The source was measured: go on if it is within a tenth of what it is set to, and what rounding makes of a small one.
    fn source(&mut self) {
        let set = u32::from(self.memory.settings.excitation_permille);
        let measured = u32::from(self.source_permille());
        if measured.abs_diff(set) > set / 10 + ROUNDING_PERMILLE {
            Counters::add(&mut self.counters.front_end_faults, 1);
            return self.halt(FrontEndFault::Source);
        }
        self.resume();
    }

    /// The source's amplitude as it was just measured, in thousandths of full scale.
    pub(crate) fn source_permille(&self) -> u16 {
        let values = self.memory.scan.frame(0, 0, true);
        let amplitude = match (values.values, values.quadrature) {
            // The phase of the source is not known this well; its amplitude is what counts.
            ([i], [q]) => {
                let square = |v: &protocol::Value| u32::from(v.sixteenths().unsigned_abs()).pow(2);
                square(i).saturating_add(square(q)).isqrt()
            }
            _ => 0,
        };
        let permille = i64::from(amplitude) * 1000;
        let permille = permille.checked_div(self.info.source_full_scale()).unwrap_or(0);
        permille.clamp(0, u16::MAX.into()) as u16
    }

    /// A folded period is complete.
    fn period(&mut self) {
        let folded = self.memory.scan.folded();
        let period = FoldedPeriod {
            request: self.probe.request,
            time: self.memory.scan.time(),
            clipped: folded.railed(0),
            bins: folded.period(0),
        };
        self.send(Outgoing::Period(&period));
        self.resume();
    }
}
