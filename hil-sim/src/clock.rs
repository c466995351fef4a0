//! Simulated time: it counts samples, as the board does.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Clock of the sampling timer, Hz: an STM32F4's timer clock.
pub const TIMER_HZ: u32 = 84_000_000;

/// Timer ticks from one sample to the next: 84 MHz / (16 * 1425) = 3684.2 Hz of excitation.
pub const TICKS_PER_SAMPLE: u32 = 1425;

/// Samples in a period of the excitation.
pub const PERIOD_SAMPLES: u64 = firmware::SAMPLES_PER_PERIOD as u64;

/// Samples in a quarter period: nothing on a board happens between their boundaries.
pub const QUARTER_SAMPLES: u64 = firmware::QUARTER_SAMPLES as u64;

/// Seconds that a number of samples takes.
pub fn seconds(samples: u64) -> f64 {
    samples as f64 * f64::from(TICKS_PER_SAMPLE) / f64::from(TIMER_HZ)
}

/// Whole samples in a time, s; 0 for a negative one.
pub fn samples(seconds: f64) -> u64 {
    (seconds * f64::from(TIMER_HZ) / f64::from(TICKS_PER_SAMPLE)) as u64
}

/// The time now, in samples since power-up; all parts of a board hold a clone of the same clock.
#[derive(Clone, Debug, Default)]
pub struct Clock(Arc<AtomicU64>);

impl Clock {
    /// At power-up.
    pub fn new() -> Self {
        Self::default()
    }

    /// Samples since power-up.
    pub fn now(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }

    /// Lets time pass.
    pub fn advance(&self, samples: u64) {
        self.0.fetch_add(samples, Ordering::Relaxed);
    }
}

impl firmware::Clock for Clock {
    fn now(&mut self) -> u64 {
        Clock::now(self)
    }
}
