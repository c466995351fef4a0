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
    /// Of the values of every sense pair, by the electrode on its plus side: the amplifier of a channel.
    pub channels: Vec<f64>,
}

impl Drift {
    /// None, for so many electrodes.
    pub fn none(electrodes: usize) -> Self {
        Self {
            gain: 1.0,
            resistance: 1.0,
            contacts: vec![1.0; electrodes],
            channels: vec![1.0; electrodes],
        }
    }

    /// This part of it, 0 to 1: as far as it has come.
    pub fn part(&self, part: f64) -> Self {
        Self {
            gain: self.gain.powf(part),
            resistance: self.resistance.powf(part),
            contacts: self.contacts.iter().map(|c| c.powf(part)).collect(),
            channels: self.channels.iter().map(|c| c.powf(part)).collect(),
        }
    }

    /// Contacts that drifted by this standard deviation of their logarithm.
    pub fn with_contacts(self, sd: f64, rng: &mut StdRng) -> Self {
        Self {
            contacts: spread(&self.contacts, sd, rng),
            ..self
        }
    }

    /// Channels whose gains drifted by this standard deviation of their logarithm.
    pub fn with_channels(self, sd: f64, rng: &mut StdRng) -> Self {
        Self {
            channels: spread(&self.channels, sd, rng),
            ..self
        }
    }
}

fn spread(factors: &[f64], sd: f64, rng: &mut StdRng) -> Vec<f64> {
    let mut drifted = |factor: &f64| factor * (sd * rng.sample::<f64, _>(StandardNormal)).exp();
    factors.iter().map(&mut drifted).collect()
}

/// A smooth field over the sheet (a place in mm to a relative rise): a Gaussian process with the squared exponential covariance of this
/// standard deviation and correlation length, mm, by random Fourier features (Rahimi and Recht 2007).
pub fn smooth_field(sd: f64, length_mm: f64, rng: &mut StdRng) -> impl Fn([f64; 2]) -> f64 + use<> {
    const WAVES: usize = 64;
    let wave = |_| {
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let [x, y] = [normal() / length_mm, normal() / length_mm];
        [x, y, normal(), normal()]
    };
    let waves: Vec<[f64; 4]> = (0..WAVES).map(wave).collect();
    move |at| {
        let of = |w: &[f64; 4]| {
            let (sin, cos) = (w[0] * at[0] + w[1] * at[1]).sin_cos();
            w[2] * sin + w[3] * cos
        };
        sd * waves.iter().map(of).sum::<f64>() / (WAVES as f64).sqrt()
    }
}
