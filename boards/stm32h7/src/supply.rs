//! The supply monitor of the chip.

use crate::pac;
use core::sync::atomic::{AtomicBool, Ordering};

/// The monitor's level, for the field PLS: 2.85 V when the supply falls (DS12110 table 27; RM0433 section 6.8.1).
const LEVEL: u8 = 6;

/// Whether the supply is watched: it was good once.
static WATCHED: AtomicBool = AtomicBool::new(false);

/// Starts the supply monitor and waits a while for the supply to be good. From then on below the level the board restarts
/// ([`sags`]); without that it works, and writes no flash memory.
pub fn wait_for_supply(power: &pac::PWR) -> bool {
    // SAFETY: the field has three bits.
    power
        .cr1()
        .modify(|_, w| unsafe { w.pls().bits(LEVEL).pvde().set_bit() });
    // The clock is the internal one of 64 MHz: some 10 ms.
    let mut patience = 100_000;
    while !supply_is_good() && patience > 0 {
        patience -= 1;
    }
    let good = supply_is_good();
    WATCHED.store(good, Ordering::Relaxed);
    good
}

/// Whether the supply is above the level.
pub fn supply_is_good() -> bool {
    // SAFETY: the address is that of the power controller's registers. Only a status register is read, which has no side
    // effect.
    let power = unsafe { &*pac::PWR::ptr() };
    power.csr1().read().pvdo().bit_is_clear()
}

/// Whether the supply, which was good once, is low now.
pub fn sags() -> bool {
    WATCHED.load(Ordering::Relaxed) && !supply_is_good()
}
