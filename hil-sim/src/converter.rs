//! The converter's characteristic: from a level to a code.

use crate::electronics::Electronics;
use crate::noise::{mix, unit};
use firmware::FULL_SCALE;
use std::f64::consts::TAU;

/// A converter of 12 bits or fewer.
#[derive(Clone, Debug)]
pub(crate) struct Converter {
    /// Codes between two that it gives.
    step: f64,
    /// Level, in codes, from which on it gives each code; empty for one without flaws.
    from: Vec<f64>,
}

impl Converter {
    pub(crate) fn new(e: &Electronics) -> Self {
        let codes = f64::from(FULL_SCALE) + 1.0;
        let from = |code: u16| {
            let x = f64::from(code);
            // Every level departs on its own, so that a width departs by the difference of two.
            let own = unit(mix(mix(e.seed ^ 0xADC) ^ u64::from(code))) - 0.5;
            x - 0.5 + e.inl_codes * libm::sin(TAU * x / codes) + e.dnl_codes * own
        };
        let flawed = e.inl_codes != 0.0 || e.dnl_codes != 0.0;
        Self {
            step: f64::from(1u16 << (12 - e.adc_bits.clamp(1, 12))),
            from: if flawed {
                (0..=FULL_SCALE).map(from).collect()
            } else {
                Vec::new()
            },
        }
    }

    /// The code for a level in codes.
    pub(crate) fn code(&self, level: f64) -> u16 {
        let most = f64::from(FULL_SCALE);
        let ideal = level.round().clamp(0.0, most) as u16;
        let code = if self.from.is_empty() {
            ideal
        } else {
            self.flawed(level, ideal)
        };
        if self.step == 1.0 {
            return code;
        }
        ((f64::from(code) / self.step).round() * self.step).min(most) as u16
    }

    fn flawed(&self, level: f64, ideal: u16) -> u16 {
        let from = |code: u16| self.from.get(usize::from(code)).copied().unwrap_or(f64::INFINITY);
        let mut code = ideal;
        while code > 0 && level < from(code) {
            code -= 1;
        }
        while code < FULL_SCALE && level >= from(code + 1) {
            code += 1;
        }
        code
    }
}
