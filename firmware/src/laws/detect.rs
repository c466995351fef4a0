//! The duties of a front end that measures amplitude and phase itself.

use crate::capture::{QUARTER_SAMPLES, Window};
use crate::detect::Detect;
use crate::error::{Error, ErrorKind};
use crate::fold::Folded;
use crate::front_end::FrontEnd;
use crate::reference::SAMPLES_PER_PERIOD;
use crate::route::{Route, Sense};
use crate::scan_error::ScanError;

/// A duty that a front end which gives phasors does not keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum DetectViolation {
    /// It reported an error where none was due.
    Refused(ErrorKind),
    /// What it put is not of the channels or the periods asked for.
    Shape,
    /// It gave something with no window open, or a window's result twice.
    Surplus,
    /// It took its first sample before the settling was over, or before an earlier result's.
    Early {
        /// Earliest time allowed.
        earliest: u64,
        /// Time it gave.
        found: u64,
    },
    /// The result was there before the window's periods were over.
    Hasty {
        /// Earliest time allowed.
        earliest: u64,
        /// When it came.
        found: u64,
    },
    /// The signal is not in phase with the excitation.
    Signal {
        /// In-phase sum.
        in_phase: i64,
        /// Quadrature sum.
        quadrature: i64,
    },
    /// With half the excitation the signal is not half as large, within one part in 32.
    Amplitude {
        /// In-phase sum with all of it.
        full: i64,
        /// With half of it.
        half: i64,
    },
    /// Nothing came, however often it was polled.
    Stuck,
}

/// Polls without a result before a front end counts as stuck. Fewer may accuse a slow front end; more only delay the report.
const PATIENCE: u32 = 50_000_000;
/// Samples by which two times of one event may differ: the clock is read a moment before or after.
const MOMENT: u64 = QUARTER_SAMPLES as u64;

/// Runs every law on a front end that gives phasors. `route` must put a voltage on its first channel in phase with the
/// excitation. `channels` is how many channels `route` has. `now` tells the time in samples, as [`crate::Clock`] does.
///
/// # Errors
/// The first duty found broken. The excitation is then left on.
pub fn detect<F: FrontEnd>(
    front: &mut F,
    route: &Route,
    channels: u8,
    now: impl FnMut(&mut F) -> u64,
) -> Result<(), DetectViolation> {
    let refused = |e: F::Error| DetectViolation::Refused(e.kind());
    let channels = match route.sense {
        Sense::One(_) | Sense::Source => 1,
        Sense::All { .. } => channels,
    };
    let mut bench = Bench { now, last: 0 };
    front.switch_on().map_err(refused)?;
    front.select(route).map_err(refused)?;
    let mut full = 0;
    for (settle_quarters, periods) in [(4, 1), (0, 1), (1, 2), (13, 4), (0, 5), (6, 40)] {
        let window = Window {
            settle_quarters,
            periods,
            channels,
        };
        full = bench.measure(front, window)? / i64::from(periods);
    }

    // A window begun anew gives its own periods only.
    let long = Window {
        settle_quarters: 0,
        periods: 1000,
        channels,
    };
    let short = Window {
        settle_quarters: 8,
        periods: 3,
        channels,
    };
    front.begin(long).map_err(refused)?;
    bench.measure(front, short)?;

    front.set_amplitude(500).map_err(refused)?;
    let half = bench.measure(front, short)? / i64::from(short.periods);
    front.set_amplitude(1000).map_err(refused)?;
    if (2 * half - full).abs() > full / 32 {
        return Err(DetectViolation::Amplitude { full, half });
    }
    front.switch_off().map_err(refused)
}

struct Bench<N> {
    now: N,
    /// The first sample of the last result.
    last: u64,
}

impl<N> Bench<N> {
    /// Measures a window; the in-phase sum of the first channel.
    fn measure<F: FrontEnd>(&mut self, front: &mut F, window: Window) -> Result<i64, DetectViolation>
    where
        N: FnMut(&mut F) -> u64,
    {
        let began = (self.now)(front);
        front.begin(window).map_err(|e| DetectViolation::Refused(e.kind()))?;
        let mut seen = Folded::new();
        seen.reset(window.channels);
        let time = poll(front, &mut seen)?;
        let settled = began + u64::from(window.settle_quarters) * QUARTER_SAMPLES as u64;
        let earliest = settled.saturating_sub(MOMENT).max(self.last);
        if time < earliest {
            return Err(DetectViolation::Early { earliest, found: time });
        }
        self.last = time;
        let over = time + u64::from(window.periods) * SAMPLES_PER_PERIOD as u64;
        let (earliest, found) = (over.saturating_sub(MOMENT), (self.now)(front));
        if found < earliest {
            return Err(DetectViolation::Hasty { earliest, found });
        }
        if seen.periods() != window.periods {
            return Err(DetectViolation::Shape);
        }
        let mut more = Folded::new();
        more.reset(window.channels);
        if front.detect(&mut more).is_ok() {
            return Err(DetectViolation::Surplus);
        }
        let (p, _) = seen.correlate(0);
        if p.in_phase <= 0 || p.quadrature.abs() > p.in_phase / 4 {
            return Err(DetectViolation::Signal {
                in_phase: p.in_phase,
                quadrature: p.quadrature,
            });
        }
        Ok(p.in_phase)
    }
}

/// Polls until a result comes; its time.
fn poll<F: Detect>(front: &mut F, seen: &mut Folded) -> Result<u64, DetectViolation> {
    for _ in 0..PATIENCE {
        match front.detect(seen) {
            Ok(time) => return Ok(time),
            Err(nb::Error::WouldBlock) => {}
            Err(nb::Error::Other(ScanError::FrontEnd(e))) => return Err(DetectViolation::Refused(e.kind())),
            Err(nb::Error::Other(ScanError::Block(_))) => return Err(DetectViolation::Shape),
        }
    }
    Err(DetectViolation::Stuck)
}
