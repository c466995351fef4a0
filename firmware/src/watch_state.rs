//! What the watch makes the board do next: learn, sleep, wake, go back to sleep.

use crate::task::Task;
use protocol::{Watch, Watching};

/// What follows a scan of the watch that woke nobody.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AfterScan {
    /// The baseline learns from the scan.
    Learn,
    /// The baseline follows the scan; another scan after the rest.
    Sleep,
    /// The same, and a heartbeat is due, the source being measured for it.
    Heartbeat,
    /// The touch is over: the board begins to sleep.
    FallAsleep,
    /// The touch goes on: back to frames.
    Frames,
}

/// The state of the watch. It knows neither the front end nor the baseline: levels come in, decisions go out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WatchState {
    watching: Watching,
    /// Frames since the last scan of the watch, while awake.
    frames: u16,
    /// Scans in a row without a change, while awake.
    quiet_scans: u16,
    /// Scans since the last heartbeat.
    scans: u16,
    /// Highest level since the last heartbeat.
    level: u16,
}

impl WatchState {
    /// As at power-up.
    pub(crate) const OFF: Self = Self {
        watching: Watching::Off,
        frames: 0,
        quiet_scans: 0,
        scans: 0,
        level: 0,
    };

    /// What the board does about its watch.
    pub(crate) fn watching(&self) -> Watching {
        self.watching
    }

    /// Nothing is watched until [`WatchState::resume`].
    pub(crate) fn switch_off(&mut self) {
        self.watching = Watching::Off;
    }

    /// What a running board measures from here on. `baseline` says whether the baseline is known.
    pub(crate) fn resume(&mut self, watch: Option<&Watch>, baseline: bool) -> Task {
        self.watching = match (watch, self.watching) {
            (None, _) => Watching::Off,
            (Some(_), _) if !baseline => Watching::Learning,
            (Some(_), Watching::Off | Watching::Learning) => Watching::Asleep,
            (Some(_), same) => same,
        };
        match self.watching {
            Watching::Off | Watching::Awake => Task::Frames,
            Watching::Learning | Watching::Asleep => Task::Watch,
        }
    }

    /// What is measured after a frame.
    pub(crate) fn after_frame(&mut self, watch: Option<&Watch>) -> Task {
        self.frames = self.frames.saturating_add(1);
        match watch {
            Some(watch) if self.frames >= watch.frames_between => {
                self.frames = 0;
                Task::Watch
            }
            _ => Task::Frames,
        }
    }

    /// Takes the level after a slot in; true if it wakes the board.
    pub(crate) fn wakes(&mut self, level: u16, watch: &Watch) -> bool {
        self.level = self.level.max(level);
        let wakes = self.watching == Watching::Asleep && level >= watch.threshold;
        if wakes {
            self.watching = Watching::Awake;
            (self.frames, self.quiet_scans) = (0, 0);
        }
        wakes
    }

    /// What follows a complete scan that ended at this level.
    pub(crate) fn after_scan(&mut self, level: u16, watch: &Watch) -> AfterScan {
        match self.watching {
            Watching::Off | Watching::Learning => AfterScan::Learn,
            Watching::Asleep => {
                self.scans = self.scans.saturating_add(1);
                if self.scans < watch.heartbeat_scans {
                    AfterScan::Sleep
                } else {
                    AfterScan::Heartbeat
                }
            }
            Watching::Awake => {
                self.quiet_scans = if level < watch.threshold {
                    self.quiet_scans.saturating_add(1)
                } else {
                    0
                };
                if self.quiet_scans < watch.quiet_scans {
                    return AfterScan::Frames;
                }
                self.watching = Watching::Asleep;
                AfterScan::FallAsleep
            }
        }
    }

    /// The highest level since the last heartbeat. Another heartbeat's time begins.
    pub(crate) fn take_level(&mut self) -> u16 {
        self.scans = 0;
        core::mem::take(&mut self.level)
    }
}
