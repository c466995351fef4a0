//! What has to be set up once, and what is left over: clocks, pins, watchdog, supply, time.

use crate::flash;
use crate::multiplexer;
use crate::sampler;
use firmware::{Clock, Sector, Store, Watchdog};
use protocol::ResetCause;
use stm32f4xx_hal::pac;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Config;

/// The chip's number, three words.
const UNIQUE_ID: *const u32 = 0x1FFF_7A10 as *const u32;

/// The chip's number in hexadecimal.
pub fn serial_number(out: &'static mut [u8; 24]) -> &'static str {
    for (word, digits) in (0..).zip(out.chunks_exact_mut(8)) {
        // SAFETY: read-only memory of every STM32F4.
        let value = unsafe { UNIQUE_ID.add(word).read_volatile() };
        hexadecimal(value, digits);
    }
    core::str::from_utf8(out).unwrap_or_default()
}

/// Eight digits, the most significant first.
pub fn hexadecimal(value: u32, digits: &mut [u8]) {
    for (k, digit) in digits.iter_mut().rev().take(8).enumerate() {
        let nibble = (value >> (4 * k) & 15) as u8;
        *digit = if nibble < 10 { b'0' + nibble } else { b'a' + nibble - 10 };
    }
}

/// Sets the chip up: watchdog first, then clocks and pins. Why it was started.
pub fn start(device: pac::Peripherals, mut core: cortex_m::Peripherals) -> ResetCause {
    // A program that is being debugged is not bitten.
    device
        .DBGMCU
        .apb1_fz()
        .modify(|r, w| unsafe { w.bits(r.bits() | 1 << 12) });
    // 32 kHz / 64: 1000 of these are 2 s. Erasing a sector of the settings takes half a second at most.
    device.IWDG.kr().write(|w| unsafe { w.bits(0xCCCC) });
    device.IWDG.kr().write(|w| unsafe { w.bits(0x5555) });
    device.IWDG.pr().write(|w| unsafe { w.bits(4) });
    device.IWDG.rlr().write(|w| unsafe { w.bits(1000) });
    // They count once the slow clock has taken them over; then from the new value.
    while device.IWDG.sr().read().bits() != 0 {}
    device.IWDG.kr().write(|w| unsafe { w.bits(0xAAAA) });

    let cause = reset_cause(device.RCC.csr().read().bits());
    device.RCC.csr().modify(|r, w| unsafe { w.bits(r.bits() | 1 << 24) });
    // Ports A, B and C, both DMA controllers; TIM2, power control, DAC; ADC1, USART1.
    device
        .RCC
        .ahb1enr()
        .modify(|r, w| unsafe { w.bits(r.bits() | 0b111 | 0b11 << 21) });
    device
        .RCC
        .apb1enr()
        .modify(|r, w| unsafe { w.bits(r.bits() | 1 | 1 << 28 | 1 << 29) });
    device
        .RCC
        .apb2enr()
        .modify(|r, w| unsafe { w.bits(r.bits() | 1 << 8 | 1 << 4) });
    // Supply monitor at 2.9 V: below it no flash memory is written.
    device
        .PWR
        .cr()
        .modify(|r, w| unsafe { w.bits(r.bits() | 7 << 5 | 1 << 4) });

    let crystal = Config::hse(8.MHz());
    // A Nucleo gets its 8 MHz from the debugger on it, without a crystal.
    let clock = if cfg!(feature = "f446") {
        crystal.bypass_hse_oscillator()
    } else {
        crystal
    };
    let rcc = device
        .RCC
        .freeze(clock.sysclk(168.MHz()).pclk1(42.MHz()).pclk2(84.MHz()));
    // From here on a crystal that stops is a non-maskable interrupt, not a frequency that silently changes.
    // SAFETY: one bit of a register that nothing else writes any more.
    let registers = unsafe { &*pac::RCC::ptr() };
    registers.cr().modify(|r, w| unsafe { w.bits(r.bits() | 1 << 19) });
    drop(rcc);

    core.DCB.enable_trace();
    // A reset does not clear it, and the samples' time begins at 0.
    core.DWT.set_cycle_count(0);
    core.DWT.enable_cycle_counter();
    multiplexer::start();
    // Analog: PA0, PA1 and PA6 to the converter, PA4 from the DAC.
    device
        .GPIOA
        .moder()
        .modify(|r, w| unsafe { w.bits(r.bits() | 0b11 << 12 | 0b11 << 8 | 0b1111) });
    // The converters' clock is 84 MHz / 4.
    device
        .ADC_COMMON
        .ccr()
        .modify(|r, w| unsafe { w.bits(r.bits() & !(3 << 16) | 1 << 16) });
    cause
}

fn reset_cause(flags: u32) -> ResetCause {
    let set = |bit: u32| flags >> bit & 1 == 1;
    if set(29) || set(30) {
        ResetCause::Watchdog
    } else if set(28) {
        ResetCause::Software
    } else if set(27) {
        ResetCause::PowerOn
    } else if set(25) {
        ResetCause::BrownOut
    } else if set(26) {
        ResetCause::Pin
    } else {
        ResetCause::Unknown
    }
}

#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    panic!("the crystal stopped");
}

/// Whether the supply is above 2.9 V.
pub fn supply_is_good() -> bool {
    // SAFETY: a status register.
    let power = unsafe { &*pac::PWR::ptr() };
    power.csr().read().bits() & 1 << 2 == 0
}

/// Clock, watchdog and store.
pub struct Chip;

impl Clock for Chip {
    fn now(&mut self) -> u64 {
        sampler::now()
    }
}

impl Watchdog for Chip {
    fn feed(&mut self) {
        // However long nobody measures, the time is asked before the cycle counter came round.
        sampler::now();
        // SAFETY: a key register, for writing only.
        let watchdog = unsafe { &*pac::IWDG::ptr() };
        watchdog.kr().write(|w| unsafe { w.bits(0xAAAA) });
    }
}

impl Store for Chip {
    type Error = flash::FlashError;

    fn sector_len(&self) -> u32 {
        flash::SECTOR_LEN
    }

    fn read(&mut self, sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), Self::Error> {
        flash::read(sector, offset, out)
    }

    fn write(&mut self, sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        flash::write(sector, offset, bytes)
    }

    fn erase(&mut self, sector: Sector) -> Result<(), Self::Error> {
        flash::erase(sector)
    }
}
