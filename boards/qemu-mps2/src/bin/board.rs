//! The whole firmware: commands and frames on the machine's first UART.
#![no_std]
#![no_main]

use cortex_m_rt::entry;
use cortex_m_semihosting::hprintln;
use firmware::{BoardInfo, Controller, Memory};
use protocol::{Plan, ResetCause};
use qemu_mps2::{Chip, RemoteFrontEnd, Uart};

#[entry]
fn main() -> ! {
    static mut MEMORY: Memory = Memory::new();
    // The front end is simulated by the PC with these constants; see `hil_sim::SimBoard`.
    let info = BoardInfo {
        name: "skin-qemu-mps2",
        serial: "emulated",
        git: "",
        electrodes: 16,
        channels: 16,
        timer_hz: 84_000_000,
        ticks_per_sample: 1425,
        in_turn: 16,
        skew_ticks: 60,
        adc_bits: 12,
        adc_span_uv: 3_300_000,
        excitation_uv: 2_250_000,
        source_gain_milli: 586,
        gains_milli: [13_000, 600, 0, 0],
        reset: ResetCause::PowerOn,
        last_panic: "",
    };
    let Ok(front) = RemoteFrontEnd::open() else {
        panic!("no front-end.request and front-end.reply in the working directory");
    };
    let mut controller = match Controller::new(info, Plan::fast(), front, Uart::new(), Chip::default(), MEMORY) {
        Ok(controller) => controller,
        Err(e) => panic!("{e}"),
    };
    hprintln!("up");
    loop {
        controller.poll();
    }
}
