//! From a plan to frames: routes in order, blocks folded, values written down.

use crate::capture::Window;
use crate::fold::{FoldError, Folded};
use crate::front_end::FrontEnd;
use crate::route::{Route, Sense};
use protocol::{Frame, Hello, Pair, Plan, PlanError, Sampling, Slot};

/// What a step of a scan came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Something was done; the frame is not complete.
    Working,
    /// The frame is complete: take it with [`Scan::take`].
    Complete,
}

/// Why a frame cannot be finished.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScanError<E> {
    /// The front end reported an error.
    FrontEnd(E),
    /// The front end lent a block that breaks its promises.
    Block(FoldError),
}

/// Where a scan is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// The next route is to be selected.
    Route,
    /// A window is open.
    Capture,
    /// All values are there.
    Complete,
}

/// Measures one frame after the other by one plan.
///
/// The plan never changes; a new plan is a new scan. Deadline: the next route is selected in the very step that takes
/// the last block of the one before, so a caller that steps within one sample of a block's end loses no period to
/// switching. One that comes later loses one period for each route measured without settling, and nothing else.
#[derive(Clone, Debug)]
pub struct Scan {
    plan: Plan,
    electrodes: u8,
    state: State,
    slot: usize,
    /// Bits of the slot's sense mask that are not measured yet.
    left: u32,
    folded: Folded,
    frame: Frame,
}

impl Scan {
    /// A scan at the start of its first frame.
    ///
    /// # Errors
    /// The board cannot carry the plan out; see [`Plan::check`].
    pub fn new(plan: Plan, board: &Hello) -> Result<Self, PlanError> {
        plan.check(board)?;
        let mut scan = Self {
            plan,
            electrodes: board.electrodes,
            state: State::Route,
            slot: 0,
            left: 0,
            folded: Folded::new(),
            frame: Frame::default(),
        };
        scan.restart();
        Ok(scan)
    }

    /// The plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Throws away what was measured of the frame and starts it again.
    pub fn restart(&mut self) {
        self.state = State::Route;
        self.slot = 0;
        self.left = self.plan.slots.first().map_or(0, |s| s.sense);
        self.frame.time = 0;
        self.frame.clipped.clear();
        self.frame.values.clear();
        self.frame.quadrature.clear();
    }

    /// Does what can be done now, at most one block's worth.
    ///
    /// # Errors
    /// `WouldBlock` when the front end has nothing yet, or the complete frame was not taken. After any other error
    /// [`Scan::restart`] it.
    pub fn step<F: FrontEnd>(&mut self, front: &mut F) -> nb::Result<Progress, ScanError<F::Error>> {
        match self.state {
            State::Complete => Err(nb::Error::WouldBlock),
            State::Route => {
                self.open(front)?;
                Ok(Progress::Working)
            }
            State::Capture => {
                let folded = &mut self.folded;
                let first = folded.periods() == 0;
                let (result, time) = front
                    .poll_block(|block| (folded.add(block), block.time))
                    .map_err(|e| e.map(ScanError::FrontEnd))?;
                result.map_err(ScanError::Block)?;
                if first && self.frame.values.is_empty() {
                    self.frame.time = time;
                }
                if self.folded.periods() < u32::from(self.plan.integrate_periods) {
                    return Ok(Progress::Working);
                }
                self.write_down();
                if self.left == 0 {
                    self.slot += 1;
                    self.left = self.slot().map_or(0, |s| s.sense);
                }
                if self.slot().is_none() {
                    self.state = State::Complete;
                    return Ok(Progress::Complete);
                }
                self.open(front)?;
                Ok(Progress::Working)
            }
        }
    }

    /// The complete frame, under this sequence number; the next frame begins. `None` while it is not complete.
    pub fn take(&mut self, sequence: u32) -> Option<Frame> {
        if self.state != State::Complete {
            return None;
        }
        let frame = Frame {
            sequence,
            plan: self.plan.id,
            ..core::mem::take(&mut self.frame)
        };
        self.restart();
        Some(frame)
    }

    fn slot(&self) -> Option<&Slot> {
        self.plan.slots.get(self.slot)
    }

    /// The sense pair of the lowest bit left.
    fn next_pair(&self, slot: &Slot) -> Pair {
        let lowest = Slot {
            sense: self.left & self.left.wrapping_neg(),
            ..*slot
        };
        lowest.sense_pairs(self.electrodes).next().unwrap_or_default()
    }

    /// Selects the next route and opens its window.
    fn open<F: FrontEnd>(&mut self, front: &mut F) -> Result<(), ScanError<F::Error>> {
        let Some(slot) = self.slot().copied() else {
            return Ok(());
        };
        let (sense, channels) = match self.plan.sampling {
            Sampling::Sequential => (Sense::One(self.next_pair(&slot)), 1),
            Sampling::Simultaneous => (Sense::All { step: slot.sense_step }, self.electrodes),
        };
        let route = Route {
            drive: slot.drive,
            sense,
            gain: slot.gain,
        };
        let window = Window {
            settle_periods: self.plan.settle_periods,
            periods: self.plan.integrate_periods,
            channels,
        };
        self.folded.reset(channels);
        front.select(&route).map_err(ScanError::FrontEnd)?;
        front.begin(window).map_err(ScanError::FrontEnd)?;
        self.state = State::Capture;
        Ok(())
    }

    /// Turns the folded periods into values: one, or one for each bit of the slot.
    fn write_down(&mut self) {
        loop {
            let bit = self.left.trailing_zeros();
            if bit >= u32::BITS {
                return;
            }
            self.left &= self.left - 1;
            let channel = match self.plan.sampling {
                Sampling::Sequential => 0,
                Sampling::Simultaneous => bit as usize,
            };
            let (value, quadrature, fitted) = self.folded.correlate(channel).values(self.folded.periods());
            let index = self.frame.values.len();
            if !fitted || self.folded.railed(channel) {
                self.frame.clipped.set(index);
            }
            // Cannot fail: the plan was checked to fit a frame.
            let _ = self.frame.values.push(value);
            if self.plan.quadrature {
                let _ = self.frame.quadrature.push(quadrature);
            }
            if self.plan.sampling == Sampling::Sequential {
                return;
            }
        }
    }
}
