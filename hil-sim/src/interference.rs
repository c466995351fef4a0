//! What comes through the air: the mains, a motor.

use crate::electronics_error::{ElectronicsError, in_range};
use crate::filter::low_pass;
use firmware::MAX_CHANNELS;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// A line that interferes: a field across the sheet, whose voltage a sense pair picks up by how far its electrodes lie apart
/// along the field. Its frequency is true, whatever the board's crystal makes of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Frequency of the fundamental, Hz.
    pub frequency_hz: f64,
    /// Amplitude between two points of the rim that lie opposite to each other along the field, V before the amplifiers.
    /// 0: absent. Two neighbours of 16 that lie along the field see a fifth of it.
    pub amplitude_v: f64,
    /// Direction of the field, degrees from the x axis.
    #[serde(default)]
    pub direction_deg: f64,
    /// Phase of the fundamental's sine when the simulation begins, degrees.
    #[serde(default)]
    pub phase_deg: f64,
    /// Amplitudes of the harmonics from the second on, relative to the fundamental, at most 31.
    #[serde(default)]
    pub harmonics: Vec<f64>,
    /// Depth of an amplitude modulation; each of its two sidebands has half of it. 0: none.
    #[serde(default)]
    pub modulation: f64,
    /// Frequency of the modulation, Hz: how far the sidebands are off.
    #[serde(default)]
    pub modulation_hz: f64,
    /// Bursts a second, as of a motor with pulse-width modulation; 0: it never pauses.
    #[serde(default)]
    pub burst_hz: f64,
    /// Part of each burst's period in which it is on.
    #[serde(default = "half")]
    pub burst_duty: f64,
    /// When it begins, s.
    #[serde(default)]
    pub from_s: f64,
    /// How long it lasts, s; absent: for ever.
    #[serde(default)]
    pub for_s: Option<f64>,
}

fn half() -> f64 {
    0.5
}

/// Most harmonics of a line.
const MOST_HARMONICS: usize = 31;

impl Line {
    /// A line without harmonics that never pauses.
    pub fn new(frequency_hz: f64, amplitude_v: f64) -> Self {
        Self {
            frequency_hz,
            amplitude_v,
            direction_deg: 0.0,
            phase_deg: 0.0,
            harmonics: Vec::new(),
            modulation: 0.0,
            modulation_hz: 0.0,
            burst_hz: 0.0,
            burst_duty: half(),
            from_s: 0.0,
            for_s: None,
        }
    }

    /// The mains at 50 or 60 Hz, with the odd harmonics of rectifiers nearby.
    pub fn mains(frequency_hz: f64, amplitude_v: f64) -> Self {
        Self {
            harmonics: vec![0.0, 0.2, 0.0, 0.1, 0.0, 0.05],
            ..Self::new(frequency_hz, amplitude_v)
        }
    }

    pub(crate) fn validate(&self) -> Result<(), ElectronicsError> {
        let frequency = "between 0 and 10 MHz";
        for (field, value) in [
            ("interference.frequency_hz", self.frequency_hz),
            ("interference.modulation_hz", self.modulation_hz),
            ("interference.burst_hz", self.burst_hz),
        ] {
            in_range(field, value, 0.0..=1e7, frequency)?;
        }
        for (field, value) in [
            ("interference.amplitude_v", self.amplitude_v),
            ("interference.from_s", self.from_s),
            ("interference.for_s", self.for_s.unwrap_or(0.0)),
        ] {
            in_range(field, value, 0.0.., "0 or more, and finite")?;
        }
        for (field, value) in [
            ("interference.direction_deg", self.direction_deg),
            ("interference.phase_deg", self.phase_deg),
        ] {
            in_range(field, value, .., "finite")?;
        }
        for (field, value) in [
            ("interference.modulation", self.modulation),
            ("interference.burst_duty", self.burst_duty),
        ] {
            in_range(field, value, 0.0..=1.0, "between 0 and 1")?;
        }
        for value in &self.harmonics {
            in_range("interference.harmonics", *value, .., "finite")?;
        }
        if self.harmonics.len() > MOST_HARMONICS {
            return Err(ElectronicsError::Length {
                field: "interference.harmonics",
                given: self.harmonics.len(),
                allowed: "it may have the second to the 32nd, 31 at most",
            });
        }
        Ok(())
    }
}

/// A line at work: its components behind the channels' low-pass.
#[derive(Clone, Debug)]
pub(crate) struct Running {
    line: Line,
    direction: [f64; 2],
    components: Vec<Component>,
}

#[derive(Clone, Debug)]
struct Component {
    frequency_hz: f64,
    phase: f64,
    amplitude_v: f64,
    /// Cosine and sine of how much later in its period each channel is converted.
    late: [(f64, f64); MAX_CHANNELS],
}

/// Turns without the whole ones, so that the sine stays exact however long it runs.
fn turns(cycles: f64) -> f64 {
    cycles - cycles.floor()
}

impl Running {
    /// `None` for a line that is absent.
    pub(crate) fn new(line: &Line, settling_s: f64, late_s: &[f64; MAX_CHANNELS]) -> Option<Self> {
        if line.amplitude_v == 0.0 {
            return None;
        }
        let parts = std::iter::once(1.0).chain(line.harmonics.iter().copied());
        let components = parts.zip(1u16..).filter(|(part, _)| *part != 0.0).map(|(part, order)| {
            let frequency_hz = line.frequency_hz * f64::from(order);
            let (re, im) = low_pass(frequency_hz, settling_s);
            Component {
                frequency_hz,
                phase: line.phase_deg.to_radians() * f64::from(order) + libm::atan2(im, re),
                amplitude_v: line.amplitude_v * part * (re * re + im * im).sqrt(),
                late: late_s.map(|late| {
                    let (sin, cos) = libm::sincos(TAU * frequency_hz * late);
                    (cos, sin)
                }),
            }
        });
        let (sin, cos) = libm::sincos(line.direction_deg.to_radians());
        Some(Self {
            direction: [cos, sin],
            components: components.collect(),
            line: line.clone(),
        })
    }

    /// Adds what the channels pick up at a time, given how far apart along x and y the electrodes of each lie.
    pub(crate) fn add(&self, time_s: f64, chords: &[[f64; 2]; MAX_CHANNELS], out: &mut [f64]) {
        let envelope = self.envelope(time_s);
        if envelope == 0.0 {
            return;
        }
        for c in &self.components {
            let (sin, cos) = libm::sincos(TAU * turns(c.frequency_hz * time_s) + c.phase);
            let amplitude = c.amplitude_v * envelope;
            for ((v, chord), (late_cos, late_sin)) in out.iter_mut().zip(chords).zip(&c.late) {
                let seen = chord[0] * self.direction[0] + chord[1] * self.direction[1];
                *v += seen * amplitude * (sin * late_cos + cos * late_sin);
            }
        }
    }

    fn envelope(&self, time_s: f64) -> f64 {
        let line = &self.line;
        let since_s = time_s - line.from_s;
        if since_s < 0.0 || line.for_s.is_some_and(|length| since_s >= length) {
            return 0.0;
        }
        if line.burst_hz > 0.0 && turns(line.burst_hz * since_s) >= line.burst_duty {
            return 0.0;
        }
        if line.modulation == 0.0 {
            return 1.0;
        }
        1.0 + line.modulation * libm::cos(TAU * turns(line.modulation_hz * time_s))
    }
}
