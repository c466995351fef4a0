//! The excitation: a sine of sixteen steps from the first DAC channel (PA4), stepped by the sampling timer itself, so that
//! its phase at every sample is fixed by the wiring. A table in memory goes round by DMA for ever; switching on and off and
//! setting the amplitude write the table.

use crate::ring::Shared;
use firmware::{ErrorKind, SAMPLES_PER_PERIOD};
use stm32f4xx_hal::pac;

/// Middle of the DAC's range.
const MIDDLE: i32 = 2048;
/// Amplitude at full scale, DAC codes: 1.44 V. The buffered output is linear to 0.2 V, 248 codes, from either end.
const AMPLITUDE: i32 = 1788;
const _: () = assert!(MIDDLE - AMPLITUDE > 248 && MIDDLE + AMPLITUDE < 4095 - 248);

/// The sine runs ahead of the samples by what the way to the electrodes holds it back at 3.684 kHz: half a step of the DAC
/// (1/32 of a period) and the second-order low-pass at 10 kHz behind it (31.1 degrees), 42.3 degrees together.
const LEAD_TURNS: f64 = if cfg!(feature = "fault-phase") {
    0.0
} else {
    42.33 / 360.0
};

/// Full-scale codes about the middle, by phase.
const SINE: [i16; SAMPLES_PER_PERIOD] = table();

const fn table() -> [i16; SAMPLES_PER_PERIOD] {
    let (mut out, mut k) = ([0; SAMPLES_PER_PERIOD], 0);
    while k < SAMPLES_PER_PERIOD {
        let mut turns = k as f64 / SAMPLES_PER_PERIOD as f64 + LEAD_TURNS;
        while turns > 0.5 {
            turns -= 1.0;
        }
        let x = core::f64::consts::TAU * turns;
        // The sine's power series; 1e-9 after twelve terms for |x| up to pi.
        let (mut term, mut sin, mut n) = (x, x, 1);
        while n < 12 {
            term *= -x * x / ((2 * n) as f64 * (2 * n + 1) as f64);
            sin += term;
            n += 1;
        }
        let code = sin * AMPLITUDE as f64;
        out[k] = if code < 0.0 {
            (code - 0.5) as i16
        } else {
            (code + 0.5) as i16
        };
        k += 1;
    }
    out
}

/// Status bit: the DAC had no new value when it was stepped.
const UNDERRUN: u32 = 1 << 13;

/// What the DMA channel reads. The entry for the first sample is last: the DAC holds one value ahead.
static TABLE: Shared<u16, SAMPLES_PER_PERIOD> = Shared::new(MIDDLE as u16);

/// The source.
pub struct Source {
    on: bool,
    permille: u16,
}

impl Source {
    pub const fn new() -> Self {
        Self {
            on: false,
            permille: 1000,
        }
    }

    /// Makes DAC and DMA ready; they wait for the timer. The first step of the timer puts out phase 0.
    pub fn arm(&self) {
        self.fill();
        // SAFETY: the DAC and this stream are this module's alone.
        let (dac, dma) = unsafe { (&*pac::DAC::ptr(), &*pac::DMA1::ptr()) };
        dac.cr().write(|w| unsafe { w.bits(0) });
        // An underrun of before: cleared by writing 1.
        dac.sr().write(|w| unsafe { w.bits(UNDERRUN) });
        let stream = dma.st(5);
        stream.cr().write(|w| unsafe { w.bits(0) });
        while stream.cr().read().bits() & 1 != 0 {}
        dma.hifcr().write(|w| unsafe { w.bits(0x3D << 6) });
        stream.par().write(|w| unsafe { w.bits(dac.dhr12r1().as_ptr() as u32) });
        stream.m0ar().write(|w| unsafe { w.bits(TABLE.address()) });
        stream.ndtr().write(|w| unsafe { w.bits(SAMPLES_PER_PERIOD as u32) });
        // Channel 7, 16 bits to 16 bits, memory incremented, circular, from memory; then enabled.
        let control = 7 << 25 | 1 << 13 | 1 << 11 | 1 << 10 | 1 << 8 | 1 << 6;
        stream.cr().write(|w| unsafe { w.bits(control) });
        stream.cr().write(|w| unsafe { w.bits(control | 1) });
        dac.dhr12r1().write(|w| unsafe { w.bits(self.code(0).into()) });
        // DMA, trigger 4 (TIM2), trigger enabled, channel enabled.
        dac.cr().write(|w| unsafe { w.bits(1 << 12 | 4 << 3 | 1 << 2 | 1) });
    }

    /// Whether the DAC ran out of values, which would have put it out of step.
    pub fn underrun(&self) -> bool {
        // SAFETY: a status register.
        let dac = unsafe { &*pac::DAC::ptr() };
        dac.sr().read().bits() & UNDERRUN != 0
    }

    pub fn set(&mut self, on: bool) {
        self.on = on;
        self.fill();
    }

    /// # Errors
    /// An amplitude that the source has not.
    pub fn set_amplitude(&mut self, permille: u16) -> Result<(), ErrorKind> {
        if !(1..=1000).contains(&permille) {
            return Err(ErrorKind::Other);
        }
        self.permille = permille;
        self.fill();
        Ok(())
    }

    fn code(&self, phase: usize) -> u16 {
        let full = i32::from(SINE.get(phase).copied().unwrap_or(0));
        let part = if self.on {
            full * i32::from(self.permille) / 1000
        } else {
            0
        };
        (MIDDLE + part) as u16
    }

    fn fill(&self) {
        for phase in 0..SAMPLES_PER_PERIOD {
            TABLE.write((phase + SAMPLES_PER_PERIOD - 1) % SAMPLES_PER_PERIOD, self.code(phase));
        }
    }
}
