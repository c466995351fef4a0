//! Scenes with a known truth, drawn from a seed.

use forward::DiscTouch;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

/// Radius of the paper's sheet, mm.
pub(crate) const RIM_MM: f64 = 97.5;

/// Touches on a sheet, and the noise and fault of their frame.
#[derive(Clone, Debug)]
pub struct Scene {
    /// What is pressed.
    pub touches: Vec<DiscTouch>,
    /// Whether the touches are smooth bumps of the same peak and second moment instead of discs.
    pub smooth: bool,
    /// Ratio of signal to noise, dB. The signal is the change from the baseline; both are 2-norms over the frame.
    pub snr_db: f64,
    /// The fault of the electronics.
    pub fault: Fault,
}

/// A fault at an electrode that is drawn at random.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// No fault.
    None,
    /// Every value that uses the electrode is random.
    Electrode,
    /// Every value that uses the electrode is not a number.
    Missing,
    /// Every value of the sense pair that starts at the electrode is the same.
    Stuck,
}

/// Increase of a contact's resistance since the baseline, ohm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Worse {
    /// In the wire, a plug or a switch. The field in the sheet does not change.
    Wire(f64),
    /// Between metal and sheet, evenly over the electrode. The electrode also shunts the sheet less.
    Face(f64),
}

/// A kind of scene, made from a seed.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// Discs of 25 mm and +20 %, at least 50 mm apart.
    Equal(usize),
    /// Smooth bumps at such places.
    Fingers(usize),
    /// Two discs of 25 mm and +20 %, their centres this far apart, mm.
    Pair(f64),
    /// 1 to 4 discs of 16 to 32 mm, +8 to +40 %, at least 40 mm apart.
    Unequal,
    /// 1 to 4 discs of 25 mm with this rise.
    Strong(f64),
    /// 1 or 2 discs of 25 mm and +20 %, and a fault.
    Broken(Fault),
}

impl Kind {
    /// Draws a scene with this ratio of signal to noise, dB.
    pub fn scene(self, rng: &mut StdRng, snr_db: f64) -> Scene {
        let disc = |at: [f64; 2], radius_mm: f64, rise: f64| DiscTouch {
            centre_mm: at,
            radius_mm,
            rise,
        };
        let mut fault = Fault::None;
        let touches: Vec<DiscTouch> = match self {
            Self::Equal(n) | Self::Fingers(n) => places(rng, n, 50.0).into_iter().map(|p| disc(p, 12.5, 0.2)).collect(),
            Self::Strong(rise) => {
                let n = rng.random_range(1..=4);
                places(rng, n, 50.0).into_iter().map(|p| disc(p, 12.5, rise)).collect()
            }
            Self::Pair(apart) => loop {
                let a = places(rng, 1, 0.0)[0];
                let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
                let b = [a[0] + apart * angle.cos(), a[1] + apart * angle.sin()];
                if b[0].hypot(b[1]) < RIM_MM - 20.0 {
                    break vec![disc(a, 12.5, 0.2), disc(b, 12.5, 0.2)];
                }
            },
            Self::Unequal => {
                let n = rng.random_range(1..=4);
                places(rng, n, 40.0)
                    .into_iter()
                    .map(|p| disc(p, rng.random_range(8.0..16.0), rng.random_range(0.08..0.4)))
                    .collect()
            }
            Self::Broken(f) => {
                fault = f;
                let n = rng.random_range(1..=2);
                places(rng, n, 50.0).into_iter().map(|p| disc(p, 12.5, 0.2)).collect()
            }
        };
        Scene {
            touches,
            smooth: matches!(self, Self::Fingers(_)),
            snr_db,
            fault,
        }
    }
}

fn places(rng: &mut StdRng, n: usize, apart: f64) -> Vec<[f64; 2]> {
    loop {
        let mut out: Vec<[f64; 2]> = Vec::new();
        for _ in 0..1000 {
            let p: [f64; 2] = [0; 2].map(|_| rng.random_range(-RIM_MM..RIM_MM));
            let free = out.iter().all(|q| (p[0] - q[0]).hypot(p[1] - q[1]) >= apart);
            if p[0].hypot(p[1]) < RIM_MM - 20.0 && free {
                out.push(p);
            }
            if out.len() == n {
                return out;
            }
        }
    }
}

/// The random generator of all studies.
pub fn rng(seed: u64) -> StdRng {
    StdRng::seed_from_u64(seed)
}
