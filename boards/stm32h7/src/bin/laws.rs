//! The duties of front end, clock and memory (`firmware::laws`), tried on the chip itself. Stored settings are erased.
//!
//! The outcome is in a `Hello`, in the place of the last panic. It is empty when every duty is kept.
#![no_std]
#![no_main]
#![allow(dead_code, reason = "parts of the board")]

use stm32h7_pac::stm32h743v as pac;

#[macro_use]
#[path = "../../../stm32f4/src/log.rs"]
mod log;

#[path = "../chip.rs"]
mod chip;
#[path = "../../../stm32f4/src/clock_search.rs"]
mod clock_search;
#[path = "../clocks.rs"]
mod clocks;
#[path = "../converter.rs"]
mod converter;
#[path = "../dac.rs"]
mod dac;
#[path = "../dma.rs"]
mod dma;
#[path = "../../../stm32f4/src/duties.rs"]
mod duties;
#[path = "../flash.rs"]
mod flash;
#[path = "../front_end.rs"]
mod front_end;
#[path = "../../../stm32f4/src/identity.rs"]
mod identity;
#[path = "../lines.rs"]
mod lines;
#[path = "../../../stm32f4/src/multiplexer.rs"]
mod multiplexer;
#[path = "../../../stm32f4/src/panic_record.rs"]
mod panic_record;
#[path = "../../../stm32f4/src/ring.rs"]
mod ring;
#[path = "../sampler.rs"]
mod sampler;
#[path = "../serial.rs"]
mod serial;
#[path = "../../../stm32f4/src/sine.rs"]
mod sine;
#[path = "../../../stm32f4/src/source.rs"]
mod source;
#[path = "../supply.rs"]
mod supply;
#[path = "../../../stm32f4/src/timebase.rs"]
mod timebase;

use chip::Chip;
use core::fmt::Write;
use duties::Both;
use firmware::{Blocking, BoardInfo, Excitation, Folded, Route, Router, Sector, Sense, Store, Watchdog, Window, laws};
use front_end::FrontEnd;
use protocol::{Pair, PanicText, ResetCause};
use serial::Serial;

/// Of the introduction only what was found counts.
const INFO: BoardInfo<'static> = BoardInfo {
    name: "laws",
    serial: "",
    git: "",
    electrodes: 16,
    channels: CHANNELS,
    timer_hz: sampler::TIMER_HZ,
    ticks_per_sample: sampler::TICKS_PER_SAMPLE,
    in_turn: 8,
    skew_ticks: sampler::SKEW_TICKS,
    adc_bits: 16,
    adc_span_uv: 3_300_000,
    excitation_uv: 2_250_000,
    source_gain_milli: 288,
    gains_milli: [12_600, 588, 0, 0],
    reset: ResetCause::Unknown,
    last_panic: "",
};

const CHANNELS: u8 = 16;

/// More than the ring of four periods holds: 2 ms.
const STALL_CYCLES: u32 = 800_000;

/// The amplitude of the first channel from which on a sheet or a ring is there, sixteenths of codes of 12 bits: a sixteenth of
/// half of the range.
const THERE: i16 = 16 * 128;

#[cortex_m_rt::entry]
fn main() -> ! {
    let (Some(mut core), Some(device)) = (cortex_m::Peripherals::take(), pac::Peripherals::take()) else {
        panic!("started twice");
    };
    chip::start(&device, &mut core);
    let mut both = Both(FrontEnd::start(), Chip);
    let mut link = Serial::start();
    let mut found = PanicText::new();
    all_channels(&mut both, &mut found);
    // The source itself: the strongest signal, in phase whatever is on the sheet.
    let route = Route {
        drive: Pair { plus: 0, minus: 1 },
        sense: Sense::Source,
        gain: 0,
    };
    duties::front_end(&mut both, &route, &INFO, STALL_CYCLES, &mut found);
    duties::clock(&mut both, &mut found);
    if let Err(e) = laws::store(&mut Fed(Chip)) {
        let _ = write!(found, "{e:?}");
    }
    let info = BoardInfo {
        last_panic: &found,
        ..INFO
    };
    duties::say(&info, &mut link);
    loop {
        both.1.feed();
    }
}

/// All channels at once, on the sheet or the ring. A board without either is told that they were not tried.
#[inline(never)]
fn all_channels(both: &mut Both, found: &mut PanicText) {
    // The first channel is electrode 1 against 0, two pairs from this drive, and in phase with it.
    let route = Route {
        drive: Pair { plus: 2, minus: 3 },
        sense: Sense::All { step: 1 },
        gain: 0,
    };
    let window = Window {
        settle_quarters: 8,
        periods: 1,
        channels: CHANNELS,
    };
    let mut folded = Folded::of_bits(INFO.adc_bits);
    folded.reset(CHANNELS);
    let measured = both.0.switch_on().and_then(|()| both.0.select(&route)).and_then(|()| {
        Blocking(&mut both.0).capture(window, |block| {
            let _ = folded.add(block);
        })
    });
    let (phasor, _) = folded.correlate(0);
    match measured {
        Ok(()) if phasor.in_phase_value(window.periods).0.sixteenths() >= THERE => {
            duties::front_end(both, &route, &INFO, STALL_CYCLES, found);
        }
        Ok(()) => {
            let _ = write!(found, "no sheet: channels not tried. ");
        }
        Err(e) => {
            let _ = write!(found, "{e:?}");
        }
    }
}

/// The chip's memory, with the watchdog fed before every erasure, which takes 4 s at most.
struct Fed(Chip);

impl Store for Fed {
    type Error = <Chip as Store>::Error;

    fn sector_len(&self) -> u32 {
        self.0.sector_len()
    }

    fn write_len(&self) -> u32 {
        self.0.write_len()
    }

    fn read(&mut self, sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), Self::Error> {
        self.0.read(sector, offset, out)
    }

    fn write(&mut self, sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.0.write(sector, offset, bytes)
    }

    fn erase(&mut self, sector: Sector) -> Result<(), Self::Error> {
        self.0.feed();
        self.0.erase(sector)
    }
}
