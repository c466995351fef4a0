//! The supply monitor of the chip.

use core::sync::atomic::{AtomicBool, Ordering};
use stm32f4xx_hal::pac;

/// Whether the supply is watched: it was good once.
static WATCHED: AtomicBool = AtomicBool::new(false);

/// Starts the supply monitor and waits a while for the supply to be good: above 3.03 V. From then on below 2.93 V the board
/// restarts ([`sags`]); without that it works, and writes no flash memory.
pub fn wait_for_supply(power: &pac::PWR) -> bool {
    // Level 6.
    power
        .cr()
        .modify(|r, w| unsafe { w.bits(r.bits() & !(7 << 5) | 6 << 5 | 1 << 4) });
    // The clock is the internal one of 16 MHz: some 50 ms.
    let mut patience = 100_000;
    while !supply_is_good() && patience > 0 {
        patience -= 1;
    }
    let good = supply_is_good();
    WATCHED.store(good, Ordering::Relaxed);
    good
}

/// Whether the supply is above 2.93 V, and above 3.03 V once it was below.
pub fn supply_is_good() -> bool {
    // SAFETY: a status register.
    let power = unsafe { &*pac::PWR::ptr() };
    power.csr().read().bits() & 1 << 2 == 0
}

/// Whether the supply, which was good once, is low now.
pub fn sags() -> bool {
    WATCHED.load(Ordering::Relaxed) && !supply_is_good()
}
