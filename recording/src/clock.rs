//! One time base: the host's monotonic clock, tied once to the system's clock; and the board's clock against it.

use std::collections::VecDeque;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// The monotonic clock of the host. As wall-clock time it never jumps, even where the system's clock is set meanwhile.
#[derive(Clone, Copy, Debug)]
pub struct HostClock {
    started: Instant,
    wall: Duration,
}

impl Default for HostClock {
    fn default() -> Self {
        Self::now()
    }
}

impl HostClock {
    /// One that starts now.
    pub fn now() -> Self {
        Self {
            started: Instant::now(),
            // A clock that was never set stands at 1970.
            wall: SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default(),
        }
    }

    /// Seconds since it started.
    pub fn seconds(&self, at: Instant) -> f64 {
        at.saturating_duration_since(self.started).as_secs_f64()
    }

    /// When it started, s since 1970 (UTC).
    pub fn started_unix_s(&self) -> f64 {
        self.wall.as_secs_f64()
    }

    /// A moment as nanoseconds since 1970 (UTC).
    pub fn unix_ns(&self, at: Instant) -> u64 {
        nanoseconds(self.wall + at.saturating_duration_since(self.started))
    }

    /// So many seconds after the start as nanoseconds since 1970 (UTC); the start where they are no number or below 0.
    pub fn unix_ns_of(&self, seconds: f64) -> u64 {
        let after = Duration::try_from_secs_f64(seconds).unwrap_or_default();
        nanoseconds(self.wall.saturating_add(after))
    }
}

/// Holds until the year 2554.
fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

/// How the board's clock goes against the host's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockFit {
    /// The host's time at the board's time 0, s. The least delay from a frame's first sample to its arrival is in it.
    pub offset_s: f64,
    /// By how much the board's seconds are longer than the host's, in millionths; none before that can be told.
    pub drift_ppm: Option<f64>,
    /// Root of the mean squared deviation of the frames that the fit is of, s.
    pub residual_s: f64,
}

impl ClockFit {
    /// The host's time at a time of the board, s.
    pub fn host_s(&self, board_s: f64) -> f64 {
        self.offset_s + board_s * (1.0 + 1e-6 * self.drift_ppm.unwrap_or(0.0))
    }
}

/// The board's clock against the host's, from when its frames arrived.
///
/// A frame may be late, by the adapter and by a busy host, but never early. So the fit is of the frame of every second that took
/// least time, over ten minutes.
#[derive(Clone, Debug, Default)]
pub struct BoardClock {
    /// Board's time and by how much the host's is ahead, s: the quickest frame of every full second.
    quickest: VecDeque<[f64; 2]>,
    now: Option<[f64; 2]>,
    /// The board's second of `now`.
    second: i64,
    last_s: Option<f64>,
}

/// Seconds that the fit is of.
const WINDOW: usize = 600;
/// Below this span no drift is told: a delay that is uncertain by 1 ms tells it no better than the crystals' data sheets, 100 ppm.
const LEAST_SPAN_S: f64 = 10.0;

impl BoardClock {
    /// A frame measured at a time of the board (s) arrived at a time of the host (s). A board's time that falls is that of a
    /// board that was reset: the fit begins anew.
    pub fn arrived(&mut self, board_s: f64, host_s: f64) {
        if self.last_s.is_some_and(|last| board_s < last) {
            *self = Self::default();
        }
        self.last_s = Some(board_s);
        let second = board_s.floor() as i64;
        let ahead = host_s - board_s;
        match &mut self.now {
            Some(now) if self.second == second => {
                if ahead < now[1] {
                    *now = [board_s, ahead];
                }
            }
            now => {
                if let Some(done) = now.replace([board_s, ahead]) {
                    self.quickest.push_back(done);
                    if self.quickest.len() > WINDOW {
                        self.quickest.pop_front();
                    }
                }
                self.second = second;
            }
        }
    }

    /// The board's newest time, s.
    pub fn newest_s(&self) -> Option<f64> {
        self.last_s
    }

    /// The fit; none before the first frame.
    pub fn fit(&self) -> Option<ClockFit> {
        let points: Vec<[f64; 2]> = self.quickest.iter().copied().collect();
        let (Some(first), Some(last)) = (points.first(), points.last()) else {
            return self.now.map(|[_, ahead]| ClockFit {
                offset_s: ahead,
                drift_ppm: None,
                residual_s: 0.0,
            });
        };
        let n = points.len() as f64;
        let mean = |k: usize| points.iter().map(|p| p[k]).sum::<f64>() / n;
        let (board, ahead) = (mean(0), mean(1));
        let slope = if last[0] - first[0] < LEAST_SPAN_S {
            None
        } else {
            let (mut both, mut alone) = (0.0, 0.0);
            for p in &points {
                both += (p[0] - board) * (p[1] - ahead);
                alone += (p[0] - board).powi(2);
            }
            Some(both / alone)
        };
        let tilt = slope.unwrap_or(0.0);
        let squares = points.iter().map(|p| (p[1] - ahead - tilt * (p[0] - board)).powi(2));
        Some(ClockFit {
            offset_s: ahead - tilt * board,
            drift_ppm: slope.map(|s| 1e6 * s),
            residual_s: (squares.sum::<f64>() / n).sqrt(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offset_and_drift_are_found_under_delays() {
        // Frames at 115 /s whose delay beyond the least is uniform up to 16 ms, as that of an adapter: the quickest of a second is
        // late by 16/116 ms on average, the slope of 300 such by 0.14 ms sqrt(12 / 300) / 300 s = 0.1 ppm.
        for (drift_ppm, offset_s) in [(-40.0, 3.5), (0.0, -2.0), (55.0, 0.25)] {
            let mut clock = BoardClock::default();
            let mut state = 1_u64;
            for k in 0..115 * 300 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let late = 16e-3 * (state >> 40) as f64 / f64::from(1 << 24);
                let board_s = 20.0 + f64::from(k) / 115.0;
                clock.arrived(board_s, offset_s + board_s * (1.0 + 1e-6 * drift_ppm) + late);
            }
            let fit = clock.fit().unwrap();
            assert!((fit.drift_ppm.unwrap() - drift_ppm).abs() < 0.5, "{fit:?}");
            let at_s = 250.0;
            let off_s = fit.host_s(at_s) - offset_s - at_s * (1.0 + 1e-6 * drift_ppm);
            assert!((0.0..0.5e-3).contains(&off_s), "{off_s}");
        }
    }

    #[test]
    fn a_reset_begins_anew_and_a_short_span_tells_no_drift() {
        let mut clock = BoardClock::default();
        assert_eq!(clock.fit(), None);
        for k in 0..500 {
            clock.arrived(100.0 + 0.01 * f64::from(k), 0.01 * f64::from(k));
        }
        let fit = clock.fit().unwrap();
        assert_eq!(fit.drift_ppm, None);
        assert!((fit.offset_s + 100.0).abs() < 1e-9);
        clock.arrived(0.0, 7.0);
        assert_eq!((clock.newest_s(), clock.fit().unwrap().offset_s), (Some(0.0), 7.0));
    }

    #[test]
    fn the_host_clock_counts_from_its_start() {
        let clock = HostClock::now();
        let later = Instant::now() + Duration::from_secs(3);
        let ns = clock.unix_ns(later) - clock.unix_ns_of(clock.seconds(later));
        // The nanosecond that a floating-point number does not hold.
        assert!(ns < 2_000, "{ns}");
        assert_eq!(clock.unix_ns_of(f64::NAN), clock.unix_ns_of(0.0));
    }
}
