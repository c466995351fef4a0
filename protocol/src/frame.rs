//! One frame of measured values.

use crate::plan::{MAX_SLOTS, MAX_VALUES};
use crate::value::Value;
use crate::variance::Variance;
use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// One bit for every value of a frame. Empty while no bit is set, so that a good frame pays one byte for it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Flags(Vec<u32, { MAX_VALUES / 32 }>);

impl Flags {
    /// No bit set.
    pub const fn new() -> Self {
        Self(Vec::new())
    }

    /// Sets the bit of value `index`. An index of [`MAX_VALUES`] or more is ignored.
    pub fn set(&mut self, index: usize) {
        if index >= MAX_VALUES {
            return;
        }
        let word = index / 32;
        if word >= self.0.len() {
            // Cannot fail: `word` is below the capacity.
            let _ = self.0.resize(word + 1, 0);
        }
        if let Some(w) = self.0.get_mut(word) {
            *w |= 1 << (index % 32);
        }
    }

    /// Whether the bit of value `index` is set.
    pub fn get(&self, index: usize) -> bool {
        self.0.get(index / 32).is_some_and(|w| w >> (index % 32) & 1 == 1)
    }

    /// How many bits are set, 0 to [`MAX_VALUES`].
    pub fn count(&self) -> u32 {
        self.0.iter().map(|w| w.count_ones()).sum()
    }

    /// Clears every bit.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}

/// One frame: every value of a plan, measured once.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Frame {
    /// Counts every frame the board began, from 0 at power-up, wrapping. A gap is as many frames lost: aborted on the
    /// board (overrun), dropped from its queue, or damaged on the wire.
    pub sequence: u32,
    /// When the first sample that went into this frame was taken, in samples since power-up. See
    /// [`crate::Hello::sample_rate`] for the length of a sample.
    pub time: u64,
    /// The plan's own number, [`crate::Plan::id`].
    pub plan: u16,
    /// Values of which at least one sample touched the converter's rails, or that did not fit. Do not trust their size.
    pub clipped: Flags,
    /// In-phase amplitudes, in the order of [`crate::Plan::measurements`].
    pub values: Vec<Value, MAX_VALUES>,
    /// Quadrature amplitudes in the same order; empty unless the plan asks for them.
    pub quadrature: Vec<Value, MAX_VALUES>,
    /// Quality, one for each slot: the variance of its samples about the mean and the odd part of the period, where the
    /// signal is. Noise, settling and all that is not in step with the excitation raise it.
    pub noise: Vec<Variance, MAX_SLOTS>,
}

/// A frame to send, borrowed from where it was measured. On the wire it is a [`Frame`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct FrameRef<'a> {
    /// [`Frame::sequence`].
    pub sequence: u32,
    /// [`Frame::time`].
    pub time: u64,
    /// [`Frame::plan`].
    pub plan: u16,
    /// [`Frame::clipped`].
    pub clipped: &'a Flags,
    /// [`Frame::values`].
    pub values: &'a [Value],
    /// [`Frame::quadrature`].
    pub quadrature: &'a [Value],
    /// [`Frame::noise`].
    pub noise: &'a [Variance],
}

impl<'a> From<&'a Frame> for FrameRef<'a> {
    fn from(frame: &'a Frame) -> Self {
        Self {
            sequence: frame.sequence,
            time: frame.time,
            plan: frame.plan,
            clipped: &frame.clipped,
            values: &frame.values,
            quadrature: &frame.quadrature,
            noise: &frame.noise,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_hold_every_value_and_no_more() {
        let mut f = Flags::default();
        for k in [0, 31, 32, 207, 255, 256, 9999] {
            assert!(!f.get(k));
            f.set(k);
        }
        assert_eq!(f.count(), 5);
        assert!(f.get(207) && f.get(255) && !f.get(256) && !f.get(206));
    }
}
