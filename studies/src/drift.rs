//! What drifts between a baseline and a frame.

use rand::Rng;
use rand::rngs::StdRng;
use rand_distr::StandardNormal;

/// Drift since the baseline, as factors: 1 where nothing drifted.
#[derive(Clone, Debug, PartialEq)]
pub struct Drift {
    /// Of every value: the source, an amplifier, the reference.
    pub gain: f64,
    /// Of the sheet's resistance: its temperature.
    pub resistance: f64,
    /// Of every contact's impedance.
    pub contacts: Vec<f64>,
}

impl Drift {
    /// None, for so many electrodes.
    pub fn none(electrodes: usize) -> Self {
        Self {
            gain: 1.0,
            resistance: 1.0,
            contacts: vec![1.0; electrodes],
        }
    }

    /// This part of it, 0 to 1: as far as it has come.
    pub fn part(&self, part: f64) -> Self {
        Self {
            gain: self.gain.powf(part),
            resistance: self.resistance.powf(part),
            contacts: self.contacts.iter().map(|c| c.powf(part)).collect(),
        }
    }

    /// Contacts that drifted by this standard deviation of their logarithm.
    pub fn with_contacts(self, sd: f64, rng: &mut StdRng) -> Self {
        let contacts = self.contacts.iter();
        Self {
            contacts: contacts
                .map(|c| c * (sd * rng.sample::<f64, _>(StandardNormal)).exp())
                .collect(),
            ..self
        }
    }
}
