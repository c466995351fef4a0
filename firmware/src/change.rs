//! Whether anything touches: the values of the watch against their baseline and their noise, in integers.
//!
//! The level is the mean over all n values of `(change / noise)^2`. While nothing touches, n times the level has a chi-square
//! distribution with n degrees of freedom: a threshold has a known rate of false alarms. A touch adds the square of its
//! signal to noise ratio. The level is formed after every slot, of the newest change of each value.

use heapless::Vec;
use protocol::{Baseline, MAX_WATCH_SLOTS, MAX_WATCH_VALUES, Value};

/// One in the unit of a level.
pub const LEVEL_ONE: u32 = 256;

/// Bits of fraction of a baseline, in units of a [`Value`].
const FRACTION: u32 = 16;

/// Logarithm of the time constant, in scans, with which the baseline follows the values: 2^16 scans. More lets drift of the
/// sheet wake the board; less lets the baseline follow a slow press.
const DRIFT: u32 = 16;

/// Least variance of a value, in sixteenths of a squared unit: a quarter. Rounding alone makes a twelfth. Less lets a value
/// that happened to be steady while learning raise false alarms; more hides touches on a quiet board.
const LEAST_VARIANCE: u32 = 4;

/// What is known of one value.
#[derive(Clone, Copy, Debug, Default)]
struct Channel {
    /// While learning the sum of the values less the first one; then the baseline with [`FRACTION`] bits of fraction.
    mean: i32,
    /// While learning the sum of their squares; then the variance in sixteenths of a squared unit.
    spread: u32,
    /// The first value learned.
    first: i16,
}

/// The change test. Its state is all there is; it is told the values as they come.
#[derive(Clone, Debug, Default)]
pub struct ChangeTest {
    channels: Vec<Channel, MAX_WATCH_VALUES>,
    /// Per slot: the sum over its values of (change / noise)^2, in units of [`LEVEL_ONE`].
    slots: Vec<u32, MAX_WATCH_SLOTS>,
    /// Scans learned from so far.
    learned: u16,
    /// Scans to learn from.
    wanted: u16,
}

impl ChangeTest {
    /// Knows nothing.
    pub const fn new() -> Self {
        Self {
            channels: Vec::new(),
            slots: Vec::new(),
            learned: 0,
            wanted: 0,
        }
    }

    /// Forgets the baseline; it will be learned from so many scans, at least 2, of so many values and slots. More than it
    /// has room for are left out of the test.
    pub fn learn(&mut self, scans: u16, values: usize, slots: usize) {
        self.channels.clear();
        let _ = self.channels.resize(values.min(MAX_WATCH_VALUES), Channel::default());
        self.slots.clear();
        let _ = self.slots.resize(slots.min(MAX_WATCH_SLOTS), 0);
        self.learned = 0;
        self.wanted = scans.max(2);
    }

    /// Whether the baseline is known.
    pub fn is_ready(&self) -> bool {
        self.wanted > 0 && self.learned >= self.wanted
    }

    /// Takes all values of a scan in, to learn from. `slot_ends[s]` is how many values there are up to the end of slot s.
    /// Does nothing once the baseline is known.
    pub fn learn_from(&mut self, values: &[Value], slot_ends: impl Iterator<Item = usize>) {
        if self.is_ready() {
            return;
        }
        for (channel, value) in self.channels.iter_mut().zip(values) {
            let value = value.sixteenths();
            if self.learned == 0 {
                *channel = Channel {
                    first: value,
                    ..Channel::default()
                };
            }
            let d = i32::from(value) - i32::from(channel.first);
            channel.mean = channel.mean.saturating_add(d);
            channel.spread = channel.spread.saturating_add(d.unsigned_abs().saturating_pow(2));
        }
        self.learned += 1;
        if self.is_ready() {
            self.finish(slot_ends);
        }
    }

    /// From sums to baselines and variances.
    fn finish(&mut self, slot_ends: impl Iterator<Item = usize>) {
        // Two or more, as is asked for; the compiler cannot know.
        let n = i64::from(self.learned.max(2));
        for channel in &mut self.channels {
            let (sum, squares) = (i64::from(channel.mean), i64::from(channel.spread));
            let mean = (i64::from(channel.first) << FRACTION) + (sum << FRACTION) / n;
            let variance = 16 * (squares - sum * sum / n) / (n - 1);
            channel.mean = mean.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
            channel.spread = variance.clamp(LEAST_VARIANCE.into(), u16::MAX.into()) as u32;
        }
        // A variance learned from few scans is now and then far too small, and that value would cry wolf: none counts for
        // less than the mean of its slot, whose values share amplifier and drive.
        let mut start = 0;
        for end in slot_ends {
            if let Some(slot) = self.channels.get_mut(start..end.min(MAX_WATCH_VALUES)) {
                let sum: u32 = slot.iter().map(|c| c.spread).sum();
                let mean = sum.checked_div(slot.len() as u32).unwrap_or(0);
                slot.iter_mut().for_each(|c| c.spread = c.spread.max(mean));
            }
            start = end;
        }
        self.slots.iter_mut().for_each(|s| *s = 0);
    }

    /// Takes the newest values of one slot in; `first` is the number of its first value.
    pub fn put(&mut self, slot: usize, first: usize, values: &[Value]) {
        if !self.is_ready() {
            return;
        }
        let mut sum = 0u32;
        for (channel, value) in self.channels.iter().skip(first).zip(values) {
            // In sixteenths of a unit, and stopped at 1024 units, so that sixteen squares still fit 32 bits.
            let d = change(channel, *value) >> (FRACTION - 4);
            let d = d.unsigned_abs().min(16_383);
            sum = sum.saturating_add((d * d * 16).checked_div(channel.spread).unwrap_or(0));
        }
        if let Some(place) = self.slots.get_mut(slot) {
            *place = sum;
        }
    }

    /// The level now, in 256ths; stops at `u16::MAX`.
    pub fn level(&self) -> u16 {
        let sum = self.slots.iter().fold(0u32, |a, b| a.saturating_add(*b));
        let mean = sum.checked_div(self.channels.len() as u32).unwrap_or(0);
        mean.min(u16::MAX.into()) as u16
    }

    /// Lets the baseline follow a scan on which nothing touched.
    pub fn follow(&mut self, values: &[Value]) {
        if !self.is_ready() {
            return;
        }
        for (channel, value) in self.channels.iter_mut().zip(values) {
            let step = (i64::from(change(channel, *value)) + (1 << (DRIFT - 1))) >> DRIFT;
            channel.mean = channel.mean.saturating_add(step as i32);
        }
    }

    /// The baseline as it goes out.
    pub fn baseline(&self) -> Baseline {
        if !self.is_ready() {
            return Baseline::default();
        }
        let value = |c: &Channel| Value::new((c.mean.saturating_add(1 << (FRACTION - 1)) >> FRACTION) as i16);
        Baseline {
            scans: self.learned,
            values: self.channels.iter().map(value).collect(),
            variance: self.channels.iter().map(|c| c.spread as u16).collect(),
        }
    }
}

/// How far a value is from its baseline, with [`FRACTION`] bits of fraction.
fn change(channel: &Channel, value: Value) -> i32 {
    (i32::from(value.sixteenths()) << FRACTION).saturating_sub(channel.mean)
}
