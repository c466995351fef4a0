//! The sensor board's firmware on an STM32F4: the peripherals' registers under `firmware`'s traits. All of the logic is in
//! that library; wiring and pins are in docs/board.md.
#![no_std]
#![no_main]

mod chip;
mod flash;
mod front_end;
mod multiplexer;
mod panic_record;
mod ring;
mod sampler;
mod serial;
mod source;

use chip::Chip;
use cortex_m_rt::entry;
use firmware::{Activity, BoardInfo, Controller};
use front_end::FrontEnd;
use protocol::{Plan, Sampling};
use stm32f4xx_hal::pac;

/// Everything about the board that never changes.
const INFO: BoardInfo<'static> = BoardInfo {
    name: if cfg!(feature = "f405") {
        "skin-stm32f405"
    } else if cfg!(feature = "f427") {
        "skin-stm32f427"
    } else {
        "skin-stm32f446"
    },
    serial: "",
    git: env!("SKIN_GIT"),
    electrodes: 16,
    channels: 1,
    timer_hz: sampler::TIMER_HZ,
    ticks_per_sample: sampler::TICKS_PER_SAMPLE,
    skew_ticks: 0,
    adc_span_uv: 3_300_000,
    excitation_uv: 2_250_000,
    source_gain_milli: 586,
    gains_milli: [13_000, 600, 0, 0],
    reset: protocol::ResetCause::Unknown,
    last_panic: "",
};

const _: () = assert!(INFO.is_sound());

#[entry]
fn main() -> ! {
    let (Some(core), Some(device)) = (cortex_m::Peripherals::take(), pac::Peripherals::take()) else {
        panic!("started twice");
    };
    let report = panic_record::take();
    let mut serial_number = [0; 24];
    let serial_number = chip::serial_number(&mut serial_number);
    let (reset, port) = chip::start(device, core);
    let info = BoardInfo {
        serial: serial_number,
        reset: if report.is_some() {
            protocol::ResetCause::Panic
        } else {
            reset
        },
        last_panic: report.as_ref().map_or("", |r| r.text()),
        ..INFO
    };
    // 208 values one after the other, a period to settle and one to integrate, until the host says otherwise.
    let plan = Plan {
        sampling: Sampling::Sequential,
        ..Plan::fast()
    };
    let mut controller = match Controller::new(info, plan, FrontEnd::start(), port, Chip::new()) {
        Ok(controller) => controller,
        Err(_) => panic!("the first plan does not suit the board"),
    };
    panic_record::planted();
    loop {
        if controller.poll() == Activity::Idle {
            multiplexer::rest();
        }
    }
}
