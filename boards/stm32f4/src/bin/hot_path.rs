//! The hot path alone: what runs for every block of samples. It is only linked, never run.
//!
//! Its panic handler calls a function that does not exist. The program therefore links exactly if the compiler proves
//! that nothing in it panics.
#![no_std]
#![no_main]
#![allow(dead_code, reason = "parts of the board")]

#[path = "../dac.rs"]
mod dac;
#[path = "../front_end.rs"]
mod front_end;
#[path = "../lines.rs"]
mod lines;
#[path = "../multiplexer.rs"]
mod multiplexer;
#[path = "../ring.rs"]
mod ring;
#[path = "../sampler.rs"]
mod sampler;
#[path = "../sine.rs"]
mod sine;
#[path = "../source.rs"]
mod source;
#[path = "../timebase.rs"]
mod timebase;

use stm32f4xx_hal::pac;

use core::hint::black_box;
use firmware::{Pace, Scan};
use front_end::FrontEnd;
use protocol::{Recipe, Sampling, Slot};

#[cortex_m_rt::entry]
fn main() -> ! {
    static mut SCAN: Scan = Scan::new();
    let scan = SCAN;
    let front = &mut FrontEnd::start();
    let slots = black_box([Slot::default(); 32]);
    let recipe = Recipe {
        settle_quarters: black_box(1),
        integrate_periods: black_box(1),
        sampling: black_box(Sampling::Sequential),
        quadrature: black_box(true),
        slots: &slots,
    };
    let _ = black_box(scan.start(recipe, black_box(Pace::Ahead), black_box(0), front));
    loop {
        let _ = black_box(scan.step(recipe, front));
        let _ = black_box(scan.go_on(recipe, front));
        #[cfg(feature = "fault-hot-path")]
        black_box(slots[black_box(33)]);
    }
}

// SAFETY: nothing has this name; what would call it does not link.
unsafe extern "C" {
    fn the_hot_path_can_panic() -> !;
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    // SAFETY: never runs: the function does not exist, so that a program with this call does not link.
    unsafe { the_hot_path_can_panic() }
}
