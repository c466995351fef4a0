//! Instructions of the hot path, counted: run with `-icount shift=0`, where a tick of SysTick (25 MHz) is forty
//! instructions exactly. Prints one line for each part: name, channels, instructions.
#![no_std]
#![no_main]

use core::hint::black_box;
use cortex_m::peripheral::{Peripherals, SYST, syst::SystClkSource};
use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprintln};
use firmware::{Block, Folded, MAX_CHANNELS, Rails, SAMPLES_PER_PERIOD};
use qemu_mps2 as _;

const INSTRUCTIONS_PER_TICK: u32 = 40;
const REPEATS: u32 = 1000;
/// SysTick counts down from here; it has 24 bits.
const SYSTICK_MAX: u32 = 0x00FF_FFFF;

/// Instructions of one call, to the nearest.
fn count(syst: &mut SYST, mut work: impl FnMut()) -> u32 {
    let mut ticks = || {
        syst.clear_current();
        let start = SYST::get_current();
        for _ in 0..REPEATS {
            work();
        }
        start.wrapping_sub(SYST::get_current()) & SYSTICK_MAX
    };
    ticks();
    (ticks() * INSTRUCTIONS_PER_TICK + REPEATS / 2) / REPEATS
}

#[entry]
fn main() -> ! {
    let Some(peripherals) = Peripherals::take() else {
        panic!("no peripherals");
    };
    let mut syst = peripherals.SYST;
    syst.set_clock_source(SystClkSource::Core);
    syst.set_reload(SYSTICK_MAX);
    syst.clear_current();
    syst.enable_counter();
    let mut folded = Folded::new();
    for channels in [1, MAX_CHANNELS as u8] {
        let samples = [2048; MAX_CHANNELS * SAMPLES_PER_PERIOD];
        let block = Block {
            samples: samples
                .get(..usize::from(channels) * SAMPLES_PER_PERIOD)
                .unwrap_or_default(),
            channels,
            sequence: 0,
            time: 0,
            rails: Rails::Unknown,
        };
        folded.reset(channels);
        let fold = count(&mut syst, || {
            if folded.periods() >= 1000 || folded.periods() == 0 {
                folded.reset(channels);
            }
            black_box(folded.add(black_box(&block))).ok();
        });
        let clear = Block {
            rails: Rails::Clear,
            ..block
        };
        folded.reset(channels);
        let fold_clear = count(&mut syst, || {
            if folded.periods() >= 1000 {
                folded.reset(channels);
            }
            black_box(folded.add(black_box(&clear))).ok();
        });
        hprintln!("fold-clear {} {}", channels, fold_clear);
        let reset = count(&mut syst, || folded.reset(black_box(channels)));
        let _ = folded.add(&block);
        let correlate = count(&mut syst, || {
            for channel in 0..usize::from(channels) {
                black_box(folded.correlate(black_box(channel)));
            }
        });
        let (phasor, scatter) = folded.correlate(0);
        let values = count(&mut syst, || {
            for _ in 0..channels {
                black_box(black_box(phasor).in_phase_value(folded.periods()));
            }
        });
        let variance = count(&mut syst, || {
            black_box(black_box(scatter).variance(folded.periods()));
        });
        hprintln!("fold {} {}", channels, fold);
        hprintln!("reset {} {}", channels, reset);
        hprintln!("correlate {} {}", channels, correlate);
        hprintln!("values {} {}", channels, values);
        hprintln!("variance {} {}", channels, variance);
    }
    loop {
        debug::exit(debug::EXIT_SUCCESS);
    }
}
