//! The time: samples taken and in memory since power-up.
//!
//! The DMA stream tells how far the ring of samples is filled. The processor's cycle counter, which runs from the same clock,
//! tells how often the stream went round. `sampler` says what the ring is and how far it is filled.

use crate::sampler::{CYCLES_PER_SAMPLE, RING, position};
use core::cell::Cell;
use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m::interrupt::{self, Mutex};
use cortex_m::peripheral::DWT;

/// Counts samples since power-up.
#[derive(Clone, Copy)]
struct Timebase {
    /// Samples taken and in memory, as of `cycles` on the cycle counter.
    total: u64,
    position: usize,
    cycles: u32,
}

/// There is one, so that all who ask agree.
static TIME: Mutex<Cell<Timebase>> = Mutex::new(Cell::new(Timebase {
    total: 0,
    position: 0,
    cycles: 0,
}));

/// Samples taken and in memory since power-up.
///
/// The next call has to come before the cycle counter has gone round once: within 25 s at 168 MHz, 10 s at 400 MHz. If the
/// sampling stops, the time goes on, twice as fast: a wait for samples has an end.
pub fn now() -> u64 {
    interrupt::free(|key| {
        let cell = TIME.borrow(key);
        let mut time = cell.get();
        if time.advance() {
            cell.set(time);
        }
        time.total
    })
}

/// Calls [`now`] every 2^24 cycles, so that nobody else has to.
pub fn keep_up() {
    static LAST: AtomicBool = AtomicBool::new(false);
    let bit = DWT::cycle_count() & 1 << 24 != 0;
    if LAST.load(Ordering::Relaxed) != bit {
        LAST.store(bit, Ordering::Relaxed);
        now();
    }
}

/// The sampling was stopped: it will go on at the time of the next whole ring, and at the ring's beginning.
pub fn stopped() {
    interrupt::free(|key| {
        let cell = TIME.borrow(key);
        let mut time = cell.get();
        time.advance();
        cell.set(Timebase {
            total: time.total.next_multiple_of(RING as u64),
            position: 0,
            ..time
        });
    });
}

/// The sampling was started this moment. Its first sample is a sample's time away, and written to memory a moment later.
pub fn started() {
    interrupt::free(|key| {
        let cell = TIME.borrow(key);
        cell.set(Timebase {
            cycles: DWT::cycle_count(),
            ..cell.get()
        });
    });
}

impl Timebase {
    /// Brings it up to date; false if nothing has changed.
    #[inline]
    fn advance(&mut self) -> bool {
        let (cycles, position) = (DWT::cycle_count(), position());
        // The usual case: this is called some ten times a sample.
        if position == self.position && cycles.wrapping_sub(self.cycles) < RING as u32 / 2 * CYCLES_PER_SAMPLE {
            return false;
        }
        let further = (RING + position - self.position) % RING;
        // The cycle counter tells how many whole rounds that leaves out; it may be off by a few samples, not by half a
        // ring.
        let about = (cycles.wrapping_sub(self.cycles) / CYCLES_PER_SAMPLE) as usize;
        let rounds = (about + RING / 2).saturating_sub(further) / RING;
        let samples = further + rounds * RING;
        // Parts of a sample are not counted, and so must not be forgotten.
        if samples > 0 {
            self.total += samples as u64;
            self.position = position;
            self.cycles = cycles;
        }
        samples > 0
    }
}
