//! The three converters: 16 bits, started by TIM2, their codes taken by DMA.
//!
//! Their clock is 50 MHz / 2 (PLL2; a chip of revision V halves it), 25 MHz. 16.5 cycles of sampling and 8.5 of conversion
//! are 1.00 us: the filters' capacitors charge the converter within a tenth of that. Eight are half of the 17.0 us from one
//! row to the next, so that the other half is left to work on the last row of a block.

use crate::pac;

/// A converter, by what it converts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Converter {
    /// ADC1: amplifiers 0 to 7.
    First,
    /// ADC3: amplifiers 8 to 15.
    Second,
    /// ADC2: what one channel sees.
    Third,
}

/// All of them.
const ALL: [Converter; 3] = [Converter::First, Converter::Second, Converter::Third];

/// Inputs in the order of conversion, by their channel numbers, with their pins (DS12110 table 8).
///
/// Amplifiers 0 to 7: PA0, PF11, PF12, PA3, PA5, PA6, PB1, PC0.
const FIRST: [u8; 8] = [16, 2, 6, 15, 19, 3, 5, 10];
/// Amplifiers 8 to 15: PF3, PF4, PF5, PF6, PF7, PF8, PF9, PF10.
const SECOND: [u8; 8] = [5, 9, 4, 8, 3, 7, 2, 6];
/// Behind the multiplexers PF13, difference amplifier PF14, source PC1.
const THIRD: [u8; 3] = [2, 6, 11];

/// Status: the regulator is ready. The register crate does not know it (RM0433 section 25.6.1, revision V).
const REGULATOR_READY: u32 = 1 << 12;

fn registers(converter: Converter) -> &'static pac::adc1::RegisterBlock {
    // SAFETY: the addresses are those of the registers, which are the same ones in the same places for each converter and
    // this module's alone.
    unsafe {
        match converter {
            Converter::First => &*pac::ADC1::ptr(),
            Converter::Second => &*pac::ADC3::ptr(),
            Converter::Third => &*pac::ADC2::ptr(),
        }
    }
}

/// Where DMA reads the codes.
pub fn data_register(converter: Converter) -> u32 {
    registers(converter).dr().as_ptr() as u32
}

/// Powers all up, calibrates offset and linearity, and sets what they convert: 6.6 ms each. Once.
pub fn start() {
    for converter in ALL {
        let adc = registers(converter);
        adc.cr().write(|w| w.deeppwd().power_up());
        adc.cr().write(|w| w.advregen().enabled().boost().lt25());
        while adc.isr().read().bits() & REGULATOR_READY == 0 {}
        adc.cr()
            .modify(|_, w| w.adcaldif().single_ended().adcallin().linearity());
        adc.cr().modify(|_, w| w.adcal().start_calibration());
        while adc.cr().read().adcal().is_calibrating() {}
        adc.isr().write(|w| w.adrdy().clear());
        adc.cr().modify(|_, w| w.aden().enabled());
        while !adc.isr().read().adrdy().is_ready() {}

        let inputs: &[u8] = match converter {
            Converter::First => &FIRST,
            Converter::Second => &SECOND,
            Converter::Third => &THIRD,
        };
        let chosen = inputs.iter().fold(0, |bits, input| bits | 1 << input);
        // SAFETY: the register takes any inputs, and these are ones that the converter has.
        adc.pcsel().write(|w| unsafe { w.bits(chosen) });
        // 16.5 cycles of sampling on every input.
        const EVERY: u32 = 0o3_333_333_333;
        // SAFETY: ten fields of three bits each, all of which take 3.
        unsafe {
            adc.smpr1().write(|w| w.bits(EVERY));
            adc.smpr2().write(|w| w.bits(EVERY));
        }
        let input = |k: usize| inputs.get(k).copied().unwrap_or(0);
        // SAFETY: the fields have five bits, and the inputs are below 20.
        adc.sqr1().write(|w| unsafe {
            w.l().set(inputs.len() as u8 - 1);
            w.sq1().bits(input(0)).sq2().bits(input(1));
            w.sq3().bits(input(2)).sq4().bits(input(3))
        });
        // SAFETY: as above.
        adc.sqr2().write(|w| unsafe {
            w.sq5().bits(input(4)).sq6().bits(input(5));
            w.sq7().bits(input(6)).sq8().bits(input(7))
        });
        // A sequence for every rising edge of TIM2's trigger, 16 bits, DMA without end; codes that were not taken are kept.
        adc.cfgr().write(|w| {
            w.res().sixteen_bit().exten().rising_edge().extsel().tim2_trgo();
            w.dmngt().dma_circular().ovrmod().preserve().jqdis().disabled()
        });
    }
}

/// Stops a converter and forgets what it has not handed over.
pub fn stop(converter: Converter) {
    let adc = registers(converter);
    if adc.cr().read().adstart().is_active() {
        adc.cr().modify(|_, w| w.adstp().stop_conversion());
        while adc.cr().read().adstp().is_stopping() {}
    }
    // Nothing takes codes now: what is left in the converter's queue goes.
    while adc.isr().read().eoc().is_complete() {
        let _ = adc.dr().read();
    }
    adc.isr()
        .write(|w| w.eos().clear().eoc().clear().ovr().clear().eosmp().clear());
}

/// Makes a converter that was stopped wait for triggers.
pub fn wait_for_triggers(converter: Converter) {
    registers(converter).cr().modify(|_, w| w.adstart().start_conversion());
}

/// Whether any of them had to throw a code away.
pub fn overrun() -> bool {
    ALL.into_iter().any(|c| registers(c).isr().read().ovr().is_overrun())
}
