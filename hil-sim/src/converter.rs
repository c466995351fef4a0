//! The converter's characteristic: from a level to a code.

use crate::electronics::Electronics;
use crate::noise::{mix, unit};
use firmware::full_scale;
use std::f64::consts::TAU;

/// A converter of 16 bits or fewer, which gives 12 or more.
#[derive(Clone, Debug)]
pub(crate) struct Converter {
    /// Highest code.
    most: u16,
    /// Codes between two that it gives.
    step: f64,
    /// Level, in codes, from which on it gives each code; empty for one without flaws.
    from: Vec<f64>,
}

impl Converter {
    pub(crate) fn new(e: &Electronics) -> Self {
        let most = full_scale(e.code_bits());
        let (codes, in_one) = (f64::from(most) + 1.0, e.codes_in_one());
        let from = |code: u16| {
            let x = f64::from(code);
            // Every level departs on its own, so that a width departs by the difference of two.
            let own = unit(mix(mix(e.seed ^ 0xADC) ^ u64::from(code))) - 0.5;
            x - 0.5 + e.inl_codes * in_one * libm::sin(TAU * x / codes) + e.dnl_codes * in_one * own
        };
        let flawed = e.inl_codes != 0.0 || e.dnl_codes != 0.0;
        Self {
            most,
            step: f64::from(1u16 << (e.code_bits() - e.adc_bits.clamp(1, e.code_bits()))),
            from: if flawed {
                (0..=most).map(from).collect()
            } else {
                Vec::new()
            },
        }
    }

    /// Codes between two that it gives.
    pub(crate) fn step(&self) -> f64 {
        self.step
    }

    /// Whether its characteristic is no straight staircase.
    pub(crate) fn is_flawed(&self) -> bool {
        !self.from.is_empty()
    }

    /// The code for a level in codes.
    pub(crate) fn code(&self, level: f64) -> u16 {
        let most = f64::from(self.most);
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
        while code < self.most && level >= from(code + 1) {
            code += 1;
        }
        code
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Codes' widths and centres by a ramp in steps of 1/64 code.
    fn ramp(e: &Electronics) -> (Vec<f64>, Vec<f64>) {
        let converter = Converter::new(e);
        let (mut width, mut first) = (vec![0.0; 4096], vec![f64::NAN; 4096]);
        for k in -64..(4096 * 64) {
            let level = f64::from(k) / 64.0;
            let code = usize::from(converter.code(level));
            width[code] += 1.0 / 64.0;
            first[code] = first[code].min(level);
        }
        (width, first)
    }

    #[test]
    fn a_ramps_histogram_has_the_widths_that_were_asked_for() {
        let dnl_codes = 0.8;
        let e = Electronics {
            dnl_codes,
            ..Electronics::ideal()
        };
        let (width, _) = ramp(&e);
        let departures: Vec<f64> = width[1..4095].iter().map(|w| w - 1.0).collect();
        let most = departures.iter().fold(0.0f64, |a, d| a.max(d.abs()));
        assert!((0.9 * dnl_codes..=dnl_codes + 1.0 / 32.0).contains(&most), "{most}");
        // The difference of two uniform departures of width d has the variance d^2 / 6; no code is missing.
        let variance = departures.iter().map(|d| d * d).sum::<f64>() / 4094.0;
        assert!(
            (variance / (dnl_codes * dnl_codes / 6.0) - 1.0).abs() < 0.1,
            "{variance}"
        );
        assert!(width.iter().all(|w| *w > 0.0));
        // Another converter of the same make is another.
        let other = ramp(&Electronics { seed: 2, ..e }).0;
        assert!(other != width);
    }

    #[test]
    fn the_integral_nonlinearity_is_an_s_of_its_height() {
        let e = Electronics {
            inl_codes: 3.0,
            ..Electronics::ideal()
        };
        let (width, first) = ramp(&e);
        for code in [512usize, 1024, 2048, 3072, 3584] {
            let departs = first[code] - (code as f64 - 0.5);
            let expected = 3.0 * (TAU * code as f64 / 4096.0).sin();
            assert!((departs - expected).abs() < 1.0 / 32.0, "{code}: {departs}");
        }
        // Small and smooth: widths are one to 3 * 2 pi / 4096.
        assert!(width[1..4095].iter().all(|w| (w - 1.0).abs() < 0.0047 + 1.0 / 32.0));
    }
}
