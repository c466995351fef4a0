//! The sine that the DAC puts out in sixteen steps, ahead of the samples by the circuit's delay.

use firmware::SAMPLES_PER_PERIOD;

/// Middle of the DAC's range.
pub const MIDDLE: i32 = 2048;
/// Amplitude at full scale, DAC codes: 1.44 V. The buffered output is linear to 0.2 V, 248 codes, from either end.
const AMPLITUDE: i32 = 1788;
const _: () = assert!(MIDDLE - AMPLITUDE > 248 && MIDDLE + AMPLITUDE < 4095 - 248);

/// How far the sine runs ahead of the samples, in periods: as far as it is delayed on the way to the converter at
/// 3.684 kHz.
///
/// Half a step of the DAC is 1/32 of a period. The second-order low-pass at 10 kHz behind it adds 30.8 degrees, the
/// filter before the converter 14.0, amplifiers and wires 1.2. Together these are 57.2 degrees, which hardware/check.py
/// holds.
const LEAD_TURNS: f64 = if cfg!(feature = "fault-phase") {
    0.0
} else {
    57.2 / 360.0
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

/// The DAC's code of a phase, at so many thousandths of full scale.
pub fn code(phase: usize, permille: u16) -> u16 {
    let full = i32::from(SINE.get(phase).copied().unwrap_or(0));
    (MIDDLE + full * i32::from(permille) / 1000) as u16
}
