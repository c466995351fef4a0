//! From a recipe to amplitudes: routes in order, blocks folded, values written down.

use crate::capture::{QUARTER_SAMPLES, Window};
use crate::fold::{Folded, MAX_CHANNELS};
use crate::front_end::FrontEnd;
use crate::phasor::{Phasor, Rotation};
use crate::route::{Route, Sense};
use crate::scan_error::ScanError;
use crate::scatter::Scatter;
use crate::wiring::Wiring;
use heapless::Vec;
use protocol::{Flags, FrameRef, MAX_SLOTS, MAX_VALUES, Pair, QUARTERS, Recipe, Sampling, Slot, Value, Variance};

/// Most amplitudes of a frame, in-phase and quadrature together: 208 of each.
pub const MAX_AMPLITUDES: usize = 416;

const _: () = assert!(MAX_AMPLITUDES >= MAX_VALUES);

/// What a step of a scan came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Progress {
    /// Something was done; no slot was completed.
    Working,
    /// A slot is complete, more follow.
    Slot,
    /// All values are there.
    Complete,
}

/// When the next route is selected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Pace {
    /// As soon as a window is over, before its samples are worked up: a new drive settles meanwhile.
    Ahead,
    /// The same, and what the last window showed is only written down by the next start, or by [`Scan::finish`]: also the next
    /// recipe's first drive settles meanwhile. With sixteen channels writing down takes longer than a sample.
    Through,
    /// In [`Scan::go_on`], so that what a slot showed can decide what is measured next.
    ByOne,
}

/// What a window showed and is not written down yet.
#[derive(Clone, Copy, Debug)]
struct Pending {
    sampling: Sampling,
    quadrature: bool,
    /// Bits of the slot that it measured.
    bits: u32,
}

/// A place in a recipe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Place {
    slot: usize,
    /// Bits of the slot's sense mask that are not measured yet.
    left: u32,
}

/// Measures the values of one recipe after the other. The recipe is the caller's: the same from one `start` to the next.
///
/// Deadline: with [`Pace::Ahead`] the step that takes the last block of a route selects the next route. A caller that steps
/// within one sample of a block's end loses nothing to switching. A later caller loses a quarter period for each route
/// measured without settling, and nothing else.
///
/// What was measured can be read until the first window of the next start is over: a frame is packed while the next one is
/// under way.
#[derive(Clone, Debug)]
pub struct Scan {
    electrodes: u8,
    rotations: [Rotation; MAX_CHANNELS],
    /// Whether a window is open.
    open: bool,
    pace: Pace,
    /// The source itself is measured instead of a sense pair.
    source: bool,
    /// What is measured now.
    place: Place,
    pending: Option<Pending>,
    /// Quarter periods that the window under way takes.
    window_quarters: u32,
    folded: Folded,
    /// Whether the values are still those of the recipe before.
    stale: bool,
    /// When the first sample was taken: of the values, and of the window under way.
    time: u64,
    window_time: u64,
    /// When the last block ended.
    reached: u64,
    clipped: Flags,
    /// The in-phase values, and from `count` on the quadrature in the same order.
    amplitudes: [Value; MAX_AMPLITUDES],
    /// Values that the recipe has.
    count: usize,
    /// Values that are there.
    done: usize,
    scatter: Scatter,
    noise: Vec<Variance, MAX_SLOTS>,
}

impl Default for Scan {
    fn default() -> Self {
        Self::new()
    }
}

impl Scan {
    /// Nothing measured, on no board yet.
    pub const fn new() -> Self {
        Self {
            electrodes: 0,
            rotations: [Rotation::NONE; MAX_CHANNELS],
            open: false,
            pace: Pace::Ahead,
            source: false,
            place: Place { slot: 0, left: 0 },
            pending: None,
            window_quarters: 0,
            folded: Folded::new(),
            stale: false,
            time: 0,
            window_time: 0,
            reached: 0,
            clipped: Flags::new(),
            amplitudes: [Value::new(0); MAX_AMPLITUDES],
            count: 0,
            done: 0,
            scatter: Scatter::NONE,
            noise: Vec::new(),
        }
    }

    /// On a board that is wired like this.
    pub fn wire(&mut self, wiring: Wiring) {
        self.electrodes = wiring.electrodes;
        self.folded = Folded::of_bits(wiring.adc_bits);
        for (channel, rotation) in (0u8..).zip(&mut self.rotations) {
            let later = channel.checked_rem(wiring.in_turn).unwrap_or(channel);
            *rotation = Rotation::new(u32::from(later) * u32::from(wiring.skew_ticks), wiring.ticks_per_sample);
        }
    }

    /// Begins with a recipe, which the board was checked to be able to carry out; the first window waits `rest` quarter
    /// periods in addition to its settling. What was under way is abandoned.
    ///
    /// # Errors
    /// The front end reported one.
    pub fn start<F: FrontEnd>(
        &mut self,
        recipe: Recipe<'_>,
        pace: Pace,
        rest: u16,
        front: &mut F,
    ) -> Result<(), ScanError<F::Error>> {
        self.pace = pace;
        self.source = false;
        self.begin(recipe, rest, front)
    }

    /// Begins to measure the source itself, as the one value of a recipe of one slot.
    ///
    /// # Errors
    /// The front end reported one.
    pub fn start_source<F: FrontEnd>(&mut self, recipe: Recipe<'_>, front: &mut F) -> Result<(), ScanError<F::Error>> {
        self.pace = Pace::Ahead;
        self.source = true;
        self.begin(recipe, 0, front)
    }

    fn begin<F: FrontEnd>(&mut self, recipe: Recipe<'_>, rest: u16, front: &mut F) -> Result<(), ScanError<F::Error>> {
        self.place = first(recipe, 0);
        let opened = self.open(recipe, rest, front);
        self.finish();
        self.stale = true;
        self.folded.reset(opened?);
        Ok(())
    }

    /// Writes down what is not yet, after [`Progress::Complete`] where the pace is [`Pace::Through`].
    pub fn finish(&mut self) {
        if let Some(pending) = self.pending.take() {
            self.write_down(pending);
            // Cannot fail: there are no more than so many slots.
            let _ = self.noise.push(self.scatter.variance(self.folded.periods()));
            self.scatter = Scatter::default();
        }
    }

    /// Selects the next route after [`Progress::Slot`], where the pace is [`Pace::ByOne`].
    ///
    /// # Errors
    /// The front end reported one.
    pub fn go_on<F: FrontEnd>(&mut self, recipe: Recipe<'_>, front: &mut F) -> Result<(), ScanError<F::Error>> {
        if !self.open {
            let channels = self.open(recipe, 0, front)?;
            self.folded.reset(channels);
        }
        Ok(())
    }

    /// Abandons what is under way.
    pub fn stop(&mut self) {
        self.open = false;
    }

    /// Does what can be done now, at most one block's worth.
    ///
    /// # Errors
    /// `WouldBlock` when the front end has nothing yet, or no window is open. After any other error start anew.
    pub fn step<F: FrontEnd>(
        &mut self,
        recipe: Recipe<'_>,
        front: &mut F,
    ) -> nb::Result<Progress, ScanError<F::Error>> {
        if !self.open {
            return Err(nb::Error::WouldBlock);
        }
        let before = self.folded.quarters();
        let time = front.detect(&mut self.folded)?;
        self.reached = time + u64::from(self.folded.quarters() - before) * QUARTER_SAMPLES as u64;
        if before == 0 {
            self.window_time = time;
        }
        if self.folded.quarters() < QUARTERS * u32::from(recipe.integrate_periods) {
            return Ok(Progress::Working);
        }
        self.window_is_over(recipe, front)
    }

    /// Goes on to the next route, and writes down what the last one gave.
    fn window_is_over<F: FrontEnd>(
        &mut self,
        recipe: Recipe<'_>,
        front: &mut F,
    ) -> nb::Result<Progress, ScanError<F::Error>> {
        self.open = false;
        if core::mem::take(&mut self.stale) {
            self.time = self.window_time;
            self.clipped.clear();
            self.count = recipe.value_count().min(MAX_VALUES);
            self.done = 0;
            self.scatter = Scatter::default();
            self.noise.clear();
        }
        let over = self.place;
        // The bits of the slot that the window measured: one, or all that are left.
        let measured = match recipe.sampling {
            Sampling::Sequential => over.left & over.left.wrapping_neg(),
            Sampling::Simultaneous => over.left,
        };
        self.place.left &= !measured;
        let slot_over = self.place.left == 0;
        if slot_over {
            self.place = self::first(recipe, over.slot + 1);
        }
        let more = self.place.slot < recipe.slots.len();
        let ahead = more && (self.pace != Pace::ByOne || !slot_over);
        let next_channels = if ahead {
            Some(self.open(recipe, 0, front)?)
        } else {
            None
        };
        let seen = Pending {
            sampling: recipe.sampling,
            quadrature: recipe.quadrature,
            bits: measured,
        };
        if slot_over {
            self.pending = Some(seen);
            if more || self.pace != Pace::Through {
                self.finish();
            }
        } else {
            self.write_down(seen);
        }
        if let Some(channels) = next_channels {
            self.folded.reset(channels);
        }
        Ok(match (more, slot_over) {
            (false, _) => Progress::Complete,
            (true, true) => Progress::Slot,
            (true, false) => Progress::Working,
        })
    }

    /// Quarter periods that the window under way takes.
    pub fn window_quarters(&self) -> u32 {
        self.window_quarters
    }

    /// When the last block ended, in samples since power-up.
    pub fn reached(&self) -> u64 {
        self.reached
    }

    /// Values that are there, in order.
    pub fn values(&self) -> &[Value] {
        self.amplitudes.get(..self.done).unwrap_or_default()
    }

    /// When the first sample was taken.
    pub fn time(&self) -> u64 {
        self.time
    }

    /// Variances of the slots that are complete.
    pub fn noise(&self) -> &[Variance] {
        &self.noise
    }

    /// Values with a sample at a rail.
    pub fn clipped(&self) -> &Flags {
        &self.clipped
    }

    /// What was folded last: after a recipe of one value, that value's period.
    pub fn folded(&self) -> &Folded {
        &self.folded
    }

    /// The frame under this sequence number; what is there of it.
    pub fn frame(&self, sequence: u32, plan: u16, quadrature: bool) -> FrameRef<'_> {
        let second = if quadrature {
            self.count..self.count + self.done
        } else {
            0..0
        };
        FrameRef {
            sequence,
            time: self.time,
            plan,
            clipped: &self.clipped,
            values: self.values(),
            quadrature: self.amplitudes.get(second).unwrap_or_default(),
            noise: &self.noise,
        }
    }

    /// Selects the route of the present place and opens its window; how many channels it has.
    fn open<F: FrontEnd>(&mut self, recipe: Recipe<'_>, rest: u16, front: &mut F) -> Result<u8, ScanError<F::Error>> {
        let Some(slot) = recipe.slots.get(self.place.slot) else {
            return Ok(1);
        };
        let (sense, channels) = match recipe.sampling {
            _ if self.source => (Sense::Source, 1),
            Sampling::Sequential => {
                let lowest = Slot {
                    sense: self.place.left & self.place.left.wrapping_neg(),
                    ..*slot
                };
                let pair: Pair = lowest.sense_pairs(self.electrodes).next().unwrap_or_default();
                (Sense::One(pair), 1)
            }
            Sampling::Simultaneous => (Sense::All { step: slot.sense_step }, self.electrodes),
        };
        let route = Route {
            drive: slot.drive,
            sense,
            gain: slot.gain,
        };
        let window = Window {
            settle_quarters: recipe.settle_quarters.saturating_add(rest),
            periods: recipe.integrate_periods,
            channels,
        };
        front.select(&route).map_err(ScanError::FrontEnd)?;
        front.begin(window).map_err(ScanError::FrontEnd)?;
        self.open = true;
        self.window_quarters = window.quarters();
        Ok(channels)
    }

    /// Turns the folded periods into values, one for each of these bits of the slot.
    fn write_down(&mut self, seen: Pending) {
        let mut bits = seen.bits;
        let periods = self.folded.periods();
        while bits != 0 {
            let channel = match seen.sampling {
                Sampling::Sequential => 0,
                Sampling::Simultaneous => bits.trailing_zeros() as usize,
            };
            bits &= bits - 1;
            let (phasor, scatter) = self.folded.correlate(channel);
            let rotation = self.rotations.get(channel).copied().unwrap_or(Rotation::NONE);
            self.scatter.add(scatter);
            let (value, mut fitted) = if seen.quadrature {
                let phasor = phasor.turned_back(rotation);
                let (quadrature, fitted) = phasor.quadrature_value(periods);
                if let Some(place) = self.amplitudes.get_mut(self.count + self.done) {
                    *place = quadrature;
                }
                let (value, also) = phasor.in_phase_value(periods);
                (value, fitted && also)
            } else {
                let in_phase = phasor.in_phase_turned_back(rotation);
                Phasor { in_phase, ..phasor }.in_phase_value(periods)
            };
            fitted &= !self.folded.railed(channel);
            if !fitted {
                self.clipped.set(self.done);
            }
            if let Some(place) = self.amplitudes.get_mut(self.done) {
                *place = value;
            }
            self.done += 1;
        }
    }
}

/// The first value of a slot.
fn first(recipe: Recipe<'_>, slot: usize) -> Place {
    Place {
        slot,
        left: recipe.slots.get(slot).map_or(0, |s| s.sense),
    }
}
