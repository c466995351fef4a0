//! A contact that got worse is no touch, and a touch at the rim is no contact.
#![allow(clippy::unwrap_used, reason = "a test")]

use forward::{DiscTouch, Drive};
use inverse::pipeline::Reconstructor;
use inverse::reference::noise::FrameNoise;
use rand::Rng;
use rand::rngs::StdRng;
use studies::{TestSheet, Worse, imager, noise_v, noisy, rng};

const CURRENT: Drive = Drive::Current { amplitude_a: 1e-3 };

fn finger(x: f64, y: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: [x, y],
        radius_mm: 12.5,
        rise: 0.2,
    }
}

struct Stage {
    sheet: TestSheet,
    reconstructor: Reconstructor,
    /// Noise at which a finger half way to the rim has 27 dB, known to the reconstructor.
    sigma: f64,
    rng: StdRng,
}

impl Stage {
    fn new(drive: Drive, seed: u64) -> Self {
        let mut rng = rng(seed);
        let imager = imager(drive, 5.0).unwrap();
        let mut sheet = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng).unwrap();
        let clean = sheet.clean_frame(&[finger(48.0, 0.0)]).unwrap();
        let sigma = noise_v(&clean, &sheet.baseline, 27.0);
        let reconstructor = sheet.live_reconstructor(FrameNoise::of_frames(sigma)).unwrap();
        Self {
            sheet,
            reconstructor,
            sigma,
            rng,
        }
    }

    /// Contacts named, and places of the touches.
    fn frame(&mut self, clean: &[f64]) -> (Vec<usize>, Vec<[f64; 2]>) {
        let frame = noisy(clean.to_vec(), self.sigma, &mut self.rng);
        let found = self.reconstructor.frame(&frame).unwrap();
        let doubted = found.doubt.is_some();
        assert!(doubted || found.contacts.is_empty());
        (
            found.contacts.clone(),
            found.touches.iter().map(|t| [t.x_mm, t.y_mm]).collect(),
        )
    }

    fn rest(&mut self) {
        let clean = self.sheet.baseline.clone();
        assert_eq!(self.frame(&clean), (vec![], vec![]));
    }

    /// With nothing on the sheet, and with a finger elsewhere, 1.5 mm off at most; not in the first frames, but after some.
    fn told(&mut self, electrode: usize, worse: Worse) {
        let opposite = std::f64::consts::TAU * (electrode as f64 / 16.0 + self.rng.random_range(0.3..0.7));
        let at = [45.0 * opposite.cos(), 45.0 * opposite.sin()];
        for touches in [vec![], vec![finger(at[0], at[1])]] {
            self.rest();
            let clean = self.sheet.worse_frame(&touches, &[(electrode, worse)]).unwrap();
            for _ in 0..10 {
                assert!(self.frame(&clean).0.is_empty(), "{worse:?}");
            }
            let (contacts, found) = (0..20).map(|_| self.frame(&clean)).last().unwrap();
            assert_eq!(contacts, [electrode], "{worse:?}, {touches:?}: {found:?}");
            assert_eq!(found.len(), touches.len(), "{worse:?} at {electrode}: {found:?}");
            for [x, y] in found {
                assert!(
                    (x - at[0]).hypot(y - at[1]) < 1.5,
                    "{worse:?} at {electrode}: {x} {y}, {at:?}"
                );
            }
        }
    }
}

#[test]
fn a_worse_contact_is_named_and_shows_no_touch() {
    let mut stage = Stage::new(Drive::PAPER, 81);
    for (k, ohm) in [20.0, 60.0, 200.0, 500.0].into_iter().enumerate() {
        stage.told((5 * k + 1) % 16, Worse::Face(ohm));
        stage.told((7 * k + 4) % 16, Worse::Wire(ohm));
    }
}

#[test]
fn with_a_given_current_it_is_the_shunt_that_tells_a_contact() {
    let mut stage = Stage::new(CURRENT, 82);
    for (electrode, ohm) in [(2, 100.0), (9, 250.0)] {
        stage.told(electrode, Worse::Face(ohm));
    }
    // What is in the wire does not matter to a current.
    stage.rest();
    let clean = stage.sheet.worse_frame(&[], &[(3, Worse::Wire(500.0))]).unwrap();
    assert_eq!(stage.frame(&clean), (vec![], vec![]));
}

#[test]
fn touches_at_the_rim_are_no_contacts() {
    for (drive, seed) in [(Drive::PAPER, 83), (CURRENT, 84)] {
        let mut stage = Stage::new(drive, seed);
        for k in 0..40 {
            // In front of an electrode and between two, the centre from 6 to 20 mm from the rim.
            let angle = std::f64::consts::TAU * f64::from(k) / 32.0;
            let radius = stage.rng.random_range(77.5..91.5);
            let touch = finger(radius * angle.cos(), radius * angle.sin());
            let clean = stage.sheet.clean_frame(&[touch]).unwrap();
            stage.rest();
            for _ in 0..20 {
                let (contacts, found) = stage.frame(&clean);
                assert!(contacts.is_empty(), "{drive:?} {k}: {contacts:?} {found:?}");
                assert_eq!(found.len(), 1, "{drive:?} {k}");
            }
        }
    }
}

/// Frames that have nothing to do with each other, as in a table, are each judged by themselves.
#[test]
fn a_frame_alone_names_a_worse_contact_too() {
    let mut stage = Stage::new(Drive::PAPER, 86);
    stage.reconstructor = stage.sheet.reconstructor().unwrap();
    for k in 0..8 {
        let electrode = (5 * k + 2) % 16;
        let worse = [Worse::Face(100.0), Worse::Wire(100.0)][k % 2];
        let clean = stage.sheet.worse_frame(&[], &[(electrode, worse)]).unwrap();
        assert_eq!(stage.frame(&clean), (vec![electrode], vec![]), "{worse:?}");
        let angle = std::f64::consts::TAU * k as f64 / 32.0;
        let radius = stage.rng.random_range(77.5..91.5);
        let touch = finger(radius * angle.cos(), radius * angle.sin());
        let clean = stage.sheet.clean_frame(&[touch]).unwrap();
        let (contacts, found) = stage.frame(&clean);
        assert!(contacts.is_empty() && found.len() == 1, "{k}: {contacts:?} {found:?}");
    }
}

#[test]
fn a_contact_that_recovers_is_believed_again() {
    let mut stage = Stage::new(Drive::PAPER, 85);
    let touch = [finger(-30.0, 20.0)];
    let worse = stage.sheet.worse_frame(&touch, &[(6, Worse::Face(150.0))]).unwrap();
    let well = stage.sheet.clean_frame(&touch).unwrap();
    for _ in 0..30 {
        stage.frame(&worse);
    }
    for _ in 0..40 {
        let (contacts, touches) = stage.frame(&worse);
        assert_eq!((contacts.as_slice(), touches.len()), ([6].as_slice(), 1));
    }
    let frames = (0..40).take_while(|_| !stage.frame(&well).0.is_empty()).count();
    assert!(frames <= 20, "{frames}");
}
