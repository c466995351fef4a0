//! The log, over the debug probe: why the board started, what it found, what it refused and lost.

/// Logs at a level of `defmt`, or is nothing. In one line, so that tests/boards.sh can take it out and find the same image.
macro_rules! log {
    ($level:ident, $($text:tt)*) => {
        #[cfg(feature = "defmt")]
        defmt::$level!($($text)*);
    };
}

#[cfg(feature = "defmt")]
pub use told::tell;

#[cfg(feature = "defmt")]
mod told {
    use core::sync::atomic::{AtomicU32, Ordering};
    use defmt_rtt as _;
    use protocol::Counters;

    static OVERRUNS: AtomicU32 = AtomicU32::new(0);
    static FAULTS: AtomicU32 = AtomicU32::new(0);

    /// Logs what was lost or failed since the last call. The measuring itself logs nothing: it must not wait.
    pub fn tell(counters: &Counters) {
        let new = |seen: &AtomicU32, now: u32| {
            let before = seen.load(Ordering::Relaxed);
            seen.store(now, Ordering::Relaxed);
            now != before && now > 0
        };
        if new(&OVERRUNS, counters.overruns) {
            log!(warn, "overruns: {=u32}", counters.overruns);
        }
        if new(&FAULTS, counters.front_end_faults) {
            log!(error, "front end faults: {=u32}", counters.front_end_faults);
        }
    }
}
