//! The wire between the board and the serial adapter, and what goes wrong on it.

use crate::fault::FaultKind;
use crate::noise::{mix, unit};
use crate::timeline::Timeline;

/// Which way a byte goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Direction {
    FromBoard,
    ToBoard,
}

/// The wire. What is random on it depends on the seed, the direction and the bytes so far.
#[derive(Debug)]
pub(crate) struct Line {
    faults: Timeline,
    seed: u64,
    /// Bytes that were sent each way.
    count: [u64; 2],
    state: State,
    /// Whether a break began that nobody asked for yet, each way.
    break_begins: [bool; 2],
    valid_until_s: f64,
}

/// What is wrong now.
#[derive(Clone, Copy, Debug, Default)]
struct State {
    lost: f64,
    flipped: f64,
    doubled: f64,
    pulled: bool,
    /// Held at 0, each way.
    broken: [bool; 2],
}

impl Line {
    pub(crate) fn new(faults: Timeline, seed: u64) -> Self {
        Self {
            faults,
            seed: mix(seed ^ 0x11_4E),
            count: [0; 2],
            state: State::default(),
            break_begins: [false; 2],
            valid_until_s: f64::NEG_INFINITY,
        }
    }

    /// Looks at what is wrong at a time.
    pub(crate) fn look(&mut self, time_s: f64) {
        if time_s < self.valid_until_s {
            return;
        }
        self.valid_until_s = self.faults.next_change_s(time_s);
        let mut now = State::default();
        for fault in self.faults.active(time_s) {
            match *fault {
                FaultKind::BytesLost { rate } => now.lost = now.lost.max(rate),
                FaultKind::BytesFlipped { rate } => now.flipped = now.flipped.max(rate),
                FaultKind::BytesDoubled { rate } => now.doubled = now.doubled.max(rate),
                FaultKind::CablePulled => now.pulled = true,
                FaultKind::LineBreak => now.broken[Direction::FromBoard as usize] = true,
                FaultKind::BreakToBoard => now.broken[Direction::ToBoard as usize] = true,
                _ => {}
            }
        }
        for way in [0, 1] {
            self.break_begins[way] |= now.broken[way] && !self.state.broken[way] && !now.pulled;
        }
        self.state = now;
    }

    /// Whether a break began this way since this was last asked.
    pub(crate) fn take_break(&mut self, direction: Direction) -> bool {
        std::mem::take(&mut self.break_begins[direction as usize])
    }

    /// Sends a byte, and hands over what arrives of it.
    pub(crate) fn pass(&mut self, direction: Direction, byte: u8, mut take: impl FnMut(u8)) {
        let count = &mut self.count[direction as usize];
        *count += 1;
        let State {
            lost,
            flipped,
            doubled,
            pulled,
            broken,
        } = self.state;
        if pulled || broken[direction as usize] {
            return;
        }
        if lost + flipped + doubled == 0.0 {
            take(byte);
            return;
        }
        let own = mix(self.seed ^ mix(*count << 1 | direction as u64));
        let chance = |kind: u64, rate: f64| rate > 0.0 && unit(mix(own ^ kind)) <= rate;
        if chance(1, lost) {
            return;
        }
        let seen = if chance(2, flipped) {
            byte ^ 1 << (own & 7)
        } else {
            byte
        };
        take(seen);
        if chance(3, doubled) {
            take(seen);
        }
    }
}
