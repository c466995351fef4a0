//! The time line of a scene, which may begin later than the board.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Time since a scene began. Until then the time is 0: what the scene has at 0, touches and faults, is there. Clones are the
/// same time line.
#[derive(Clone, Debug)]
pub(crate) struct SceneTime(Arc<AtomicU64>);

impl Default for SceneTime {
    /// It begins at power-up.
    fn default() -> Self {
        Self(Arc::new(AtomicU64::new(0.0_f64.to_bits())))
    }
}

impl SceneTime {
    fn begin_s(&self) -> f64 {
        f64::from_bits(self.0.load(Ordering::Relaxed))
    }

    /// Keeps the time at 0 until [`SceneTime::begin`].
    pub(crate) fn hold(&self) {
        self.0.store(f64::INFINITY.to_bits(), Ordering::Relaxed);
    }

    /// Begins now, s since power-up, unless it has begun.
    pub(crate) fn begin(&self, now_s: f64) {
        if self.began_s().is_none() {
            self.0.store(now_s.to_bits(), Ordering::Relaxed);
        }
    }

    /// When it began, s since power-up; `None` while it is held.
    pub(crate) fn began_s(&self) -> Option<f64> {
        Some(self.begin_s()).filter(|s| s.is_finite())
    }

    /// The scene's time at a time since power-up, both in s.
    pub(crate) fn at(&self, true_s: f64) -> f64 {
        (true_s - self.begin_s()).max(0.0)
    }
}
