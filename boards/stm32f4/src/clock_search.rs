//! The clock that the samples and the serial line run from: found by looking for it, and measured before it is used.
//!
//! A Nucleo's debugger puts a clock on the high-speed input, other boards have a crystal, some have neither, and not all have
//! 8 MHz. Each way is tried. What then runs is counted against the internal oscillator by a timer that captures edges of the
//! input. Which timer, and how the input gets there, is the chip's: module `clocks`.

use crate::clocks::{self, Counter, INTERNAL_MHZ};
use crate::pac;

/// What is said where no known clock is found.
pub const NO_CLOCK: &str = "no clock of 8, 12, 16 or 25 MHz: on the internal one, 1 % off";

/// How the high-speed input gets its clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Origin {
    /// Something else makes it: the debugger of a Nucleo, an oscillator.
    Outside,
    /// The chip's own oscillator, with a crystal.
    Crystal,
}

/// A clock that was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Found {
    /// Where it comes from.
    pub origin: Origin,
    /// Its frequency, MHz: one of [`KNOWN_MHZ`].
    pub mhz: u32,
}

/// Frequencies that boards have, and that the PLL makes the processor's of exactly.
const KNOWN_MHZ: [u32; 4] = [8, 12, 16, 25];

/// How far the internal oscillator can be off, in percent: 1 at 25 degrees, some 5 from -40 to 105 (data sheets). Half of
/// the way between two known frequencies is 14 at least.
const INTERNAL_PERCENT: u32 = 6;

/// Edges of the input between two captures: the RTC's divider, then the capture's own.
const RTC_DIVIDER: u8 = 31;
const CAPTURE_DIVIDER: u32 = 8;
const EDGES: u32 = RTC_DIVIDER as u32 * CAPTURE_DIVIDER;

/// Rounds of waiting for the input: some 50 ms of the internal oscillator at eight cycles a round.
const START_PATIENCE: u32 = 6_250 * INTERNAL_MHZ;
/// Rounds of waiting for a capture: some 5 ms. With 4 MHz one comes every 62 us.
const CAPTURE_PATIENCE: u32 = 625 * INTERNAL_MHZ;

/// Looks for a clock from outside, then for a crystal. What is found runs on.
pub fn find(rcc: &pac::RCC, timer: &Counter) -> Option<Found> {
    let found = [Origin::Outside, Origin::Crystal].into_iter().find_map(|origin| {
        if !starts(rcc, origin) {
            return None;
        }
        let ticks = ticks_between_captures(rcc, timer)?;
        known_mhz(ticks).map(|mhz| Found { origin, mhz })
    });
    if found.is_none() {
        rcc.cr().modify(|_, w| w.hseon().off());
        rcc.cr().modify(|_, w| w.hsebyp().not_bypassed());
    }
    found
}

/// Starts the input in one of its ways; whether it runs after 50 ms at most.
fn starts(rcc: &pac::RCC, origin: Origin) -> bool {
    let bypassed = origin == Origin::Outside;
    // The way can only be changed while the input is off.
    rcc.cr().modify(|_, w| w.hseon().off());
    let mut patience = START_PATIENCE;
    while rcc.cr().read().hserdy().is_ready() && patience > 0 {
        patience -= 1;
    }
    rcc.cr().modify(|_, w| w.hsebyp().bit(bypassed));
    rcc.cr().modify(|_, w| w.hseon().on());
    patience = START_PATIENCE;
    while !rcc.cr().read().hserdy().is_ready() && patience > 0 {
        patience -= 1;
    }
    rcc.cr().read().hserdy().is_ready()
}

/// Ticks of the internal oscillator in [`EDGES`] periods of the input; `None` where no edge comes.
fn ticks_between_captures(rcc: &pac::RCC, timer: &Counter) -> Option<u32> {
    clocks::counter_on(rcc, timer);
    rcc.cfgr().modify(|_, w| w.rtcpre().set(RTC_DIVIDER));
    timer.ccmr1_input().write(|w| w.cc1s().ti1().ic1psc().eight_events());
    timer.ccer().write(|w| w.cc1e().set_bit());
    timer.arr().write(|w| w.arr().set(u16::MAX));
    timer.cr1().write(|w| w.cen().enabled());
    let ticks = two_captures(timer);
    timer.cr1().write(|w| w.cen().disabled());
    timer.ccer().write(|w| w.cc1e().clear_bit());
    rcc.cfgr().modify(|_, w| w.rtcpre().set(0));
    clocks::counter_off(rcc);
    ticks
}

fn two_captures(timer: &Counter) -> Option<u32> {
    /// A pair between which a capture was missed is tried again.
    const TRIES: usize = 4;
    let capture = || {
        let mut patience = CAPTURE_PATIENCE;
        // Reading the value clears the flag.
        while !timer.sr().read().cc1if().bit_is_set() {
            patience -= 1;
            if patience == 0 {
                return None;
            }
        }
        Some(timer.ccr1().read().ccr().bits())
    };
    for _ in 0..TRIES {
        timer.sr().modify(|_, w| w.cc1if().clear_bit().cc1of().clear_bit());
        let (first, second) = (capture()?, capture()?);
        if !timer.sr().read().cc1of().bit_is_set() {
            return Some(second.wrapping_sub(first).into());
        }
    }
    None
}

/// The known frequency that so many ticks are; `None` where they are none's.
fn known_mhz(ticks: u32) -> Option<u32> {
    let of = |mhz: u32| EDGES * INTERNAL_MHZ / mhz;
    // A capture is up to a tick late.
    KNOWN_MHZ
        .into_iter()
        .find(|mhz| ticks.abs_diff(of(*mhz)) <= of(*mhz) * INTERNAL_PERCENT / 100 + 1)
}
