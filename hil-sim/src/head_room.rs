//! Where source and amplifiers meet the ends of their supply: what that makes of a period of the excitation.

use crate::electronics::Electronics;
use crate::filter::{Complex, low_pass, magnitude, times};
use crate::wave::EXCITATION_HZ;
use firmware::SAMPLES_PER_PERIOD;
use std::f64::consts::TAU;
use std::sync::LazyLock;

/// Points of a period at which the circuit is computed. The corner where an amplifier stops follows in steps of a point:
/// with twice as many a value changes by less than 1e-4 of itself.
const POINTS: usize = 256;
/// Harmonics of what is missing that are followed through the channel's low-pass: up to 118 kHz, where 1/8 is left.
const HARMONICS: usize = 32;
/// Sine and cosine of minus every point's angle.
static CIRCLE: LazyLock<[(f64, f64); POINTS]> =
    LazyLock::new(|| std::array::from_fn(|k| libm::sincos(-TAU * (k as f64 / POINTS as f64))));
/// Rounding of volts is below 1e-14.
const ROUNDING_V: f64 = 1e-12;

/// The circuit's voltages around the sheet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HeadRoom {
    supply_v: f64,
    /// Where the drive rests, V.
    middle_v: f64,
    push_pull: bool,
    op_amp_margin_v: f64,
    inner_shift_v: f64,
    inner_margin_v: f64,
    /// The margin of the same amplifier's own output, V.
    output_margin_v: f64,
    /// Output of a resting amplifier, V.
    rest_v: f64,
    settling_s: f64,
}

/// A pair of electrodes in the sheet's current: resistances between each and the positive end of the drive, switches
/// included, and between the ends, ohm.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pickup {
    pub(crate) to_plus_ohm: f64,
    pub(crate) to_minus_ohm: f64,
    pub(crate) drive_ohm: f64,
}

/// The amplifier of a route.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Amplifier {
    /// Two stages: the first has all of the gain, and lies above the inputs.
    Instrument { gain: f64 },
    /// One op-amp.
    Difference { gain: f64 },
}

impl HeadRoom {
    /// Of these electronics; `None` where nothing ever meets the supply. `reference_lost`: the middle of the supply is at 0;
    /// `reach_lost_v`: the amplifier of gain 0 comes so much less near to the supply's ends, V.
    pub(crate) fn new(e: &Electronics, reference_lost: bool, reach_lost_v: f64) -> Option<Self> {
        let supply_v = e.supply_v?;
        Some(Self {
            supply_v,
            middle_v: if reference_lost { 0.0 } else { 0.5 * supply_v },
            push_pull: e.push_pull,
            op_amp_margin_v: e.op_amp_margin_v,
            inner_shift_v: e.inner_shift_v,
            inner_margin_v: e.inner_margin_v + reach_lost_v,
            output_margin_v: e.inner_margin_v,
            rest_v: 0.5 * e.adc_span_v,
            settling_s: e.settling_s,
        })
    }

    /// Voltages of the drive's two ends when the drive should be `drive_v`.
    fn ends_v(&self, drive_v: f64) -> [f64; 2] {
        let op_amp = |v: f64| within(v, self.supply_v, self.op_amp_margin_v);
        if self.push_pull {
            [
                op_amp(self.middle_v + 0.5 * drive_v),
                op_amp(self.middle_v - 0.5 * drive_v),
            ]
        } else {
            [op_amp(self.middle_v + drive_v), self.middle_v]
        }
    }

    /// What an amplifier gives for a pair, from its rest, V, when the drive should be `drive_v`.
    fn output_v(&self, amplifier: Amplifier, pair: Pickup, drive_v: f64) -> f64 {
        let [plus_v, minus_v] = self.ends_v(drive_v);
        let current_a = (plus_v - minus_v) / pair.drive_ohm;
        let (a, b) = (
            plus_v - current_a * pair.to_plus_ohm,
            plus_v - current_a * pair.to_minus_ohm,
        );
        let (output_v, margin_v) = match amplifier {
            Amplifier::Instrument { gain } => {
                let inner = |own: f64, other: f64| {
                    let v = 0.5 * (own + other) + self.inner_shift_v + 0.5 * gain * (own - other);
                    within(v, self.supply_v, self.inner_margin_v)
                };
                (inner(a, b) - inner(b, a), self.output_margin_v)
            }
            Amplifier::Difference { gain } => (gain * (a - b), self.op_amp_margin_v),
        };
        within(self.rest_v + output_v, self.supply_v, margin_v) - self.rest_v
    }

    /// What the source's monitor is given, in volts of the drive between its ends, when that should be `drive_v`.
    fn monitored_v(&self, drive_v: f64) -> f64 {
        let from_rest = self.ends_v(drive_v)[0] - 0.5 * self.supply_v;
        if self.push_pull { 2.0 * from_rest } else { from_rest }
    }

    /// What a pair's period at the converter differs by from the sine that the circuit should make of a drive of this
    /// amplitude: at each sample, `late_turns` of a period after it. `None` if by nothing. The gain is the one between pair
    /// and converter, with the low-pass.
    pub(crate) fn missing_v(
        &self,
        instrument: bool,
        gain: f64,
        pair: Pickup,
        amplitude_v: f64,
        late_turns: f64,
    ) -> Option<[f64; SAMPLES_PER_PERIOD]> {
        // The low-pass is behind the amplifier, whose own gain is larger by what it takes.
        let own = gain / magnitude(low_pass(EXCITATION_HZ, self.settling_s));
        let amplifier = if instrument {
            Amplifier::Instrument { gain: own }
        } else {
            Amplifier::Difference { gain: own }
        };
        let share = own * (pair.to_minus_ohm - pair.to_plus_ohm) / pair.drive_ohm;
        self.filtered(amplitude_v, late_turns, |v| {
            self.output_v(amplifier, pair, v) - share * v
        })
    }

    /// The same of the source's own channel.
    pub(crate) fn missing_of_source_v(&self, gain: f64, amplitude_v: f64) -> Option<[f64; SAMPLES_PER_PERIOD]> {
        let own = gain / magnitude(low_pass(EXCITATION_HZ, self.settling_s));
        self.filtered(amplitude_v, 0.0, |v| own * (self.monitored_v(v) - v))
    }

    /// A period of something that depends on the drive's voltage, behind the low-pass, whose delay at the excitation's
    /// frequency the board makes up for.
    fn filtered(
        &self,
        amplitude_v: f64,
        late_turns: f64,
        of_drive: impl Fn(f64) -> f64,
    ) -> Option<[f64; SAMPLES_PER_PERIOD]> {
        // Everything is a straight line in the drive's voltage until something meets an end of the supply; at the drive's own ends
        // first.
        if [-amplitude_v, amplitude_v]
            .iter()
            .all(|v| of_drive(*v).abs() < ROUNDING_V)
        {
            return None;
        }
        let turns = |k: usize| k as f64 / POINTS as f64;
        let period: [f64; POINTS] = std::array::from_fn(|k| of_drive(amplitude_v * libm::sin(TAU * turns(k))));
        if period.iter().all(|v| v.abs() < ROUNDING_V) {
            return None;
        }
        let (re, im) = low_pass(EXCITATION_HZ, self.settling_s);
        let ahead = -libm::atan2(im, re) / TAU;
        let harmonics: Vec<Complex> = (0..=HARMONICS)
            .map(|h| {
                let sum = period.iter().enumerate().fold((0.0, 0.0), |sum: Complex, (k, v)| {
                    let (sin, cos) = CIRCLE[h * k % POINTS];
                    (sum.0 + v * cos, sum.1 + v * sin)
                });
                let part = if h == 0 { 1.0 } else { 2.0 } / POINTS as f64;
                times(
                    (part * sum.0, part * sum.1),
                    low_pass(h as f64 * EXCITATION_HZ, self.settling_s),
                )
            })
            .collect();
        Some(std::array::from_fn(|sample| {
            let at = sample as f64 / SAMPLES_PER_PERIOD as f64 + late_turns + ahead;
            let wave = |(h, c): (usize, &Complex)| {
                let (sin, cos) = libm::sincos(TAU * h as f64 * at);
                times(*c, (cos, sin)).0
            };
            harmonics.iter().enumerate().map(wave).sum()
        }))
    }
}

fn within(v: f64, supply_v: f64, margin_v: f64) -> f64 {
    v.clamp(margin_v.min(0.5 * supply_v), (supply_v - margin_v).max(0.5 * supply_v))
}
