//! The supply monitor of the chip.

use core::sync::atomic::{AtomicBool, Ordering};
use stm32f4xx_hal::pac;

/// The monitor's level, for the field PLS: 2.93 V when the supply falls, 3.03 V when it rises (data sheets of the chips; RM0390
/// section 5.4.1, RM0090 sections 5.4.1 and 5.5.1).
const LEVEL: u8 = 6;

/// Whether the supply is watched: it was good once.
static WATCHED: AtomicBool = AtomicBool::new(false);

/// Starts the supply monitor and waits a while for the supply to be good: above 3.03 V. From then on below 2.93 V the board
/// restarts ([`sags`]); without that it works, and writes no flash memory.
pub fn wait_for_supply(power: &pac::PWR) -> bool {
    power.cr().modify(|_, w| w.pls().set(LEVEL).pvde().enabled());
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
    // SAFETY: the address is that of the power controller's registers. Only the status register is read, which has no side effect.
    let power = unsafe { &*pac::PWR::ptr() };
    power.csr().read().pvdo().is_higher()
}

/// Whether the supply, which was good once, is low now.
pub fn sags() -> bool {
    WATCHED.load(Ordering::Relaxed) && !supply_is_good()
}
