//! What comes through the air: the mains, a motor.

use crate::electronics::{ElectronicsError, in_range};
use serde::{Deserialize, Serialize};

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
