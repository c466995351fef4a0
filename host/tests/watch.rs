//! A frame that shows nothing, or nothing new, is not reconstructed again, and nothing is missed by that.
#![allow(clippy::unwrap_used, reason = "a test")]

use forward::{DiscTouch, Drive};
use host::reconstructor::Reconstructor;
use host::study::scenes::{Bench, Fault, Scene, imager, noisy, quantile, rng};
use rand::rngs::StdRng;

struct Watched {
    bench: Bench,
    reconstructor: Reconstructor,
    sigma: f64,
    rng: StdRng,
}

fn touch(x: f64, y: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: [x, y],
        radius_mm: 12.5,
        rise: 0.2,
    }
}

impl Watched {
    /// The noise is known, and that of four touches at 27 dB.
    fn new(seed: u64) -> Self {
        let mut rng = rng(seed);
        let imager = imager(Drive::PAPER, 5.0).unwrap();
        let mut bench = Bench::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
        let mut reconstructor = bench.live_reconstructor();
        let touches = vec![touch(40.0, 0.0), touch(-40.0, 5.0), touch(0.0, 45.0), touch(3.0, -50.0)];
        let scene = Self::scene(touches);
        let clean = bench.frame(&scene, &mut rng).unwrap();
        let change: f64 = clean.iter().zip(&bench.baseline).map(|(a, b)| (a - b).powi(2)).sum();
        let sigma = (change / clean.len() as f64).sqrt() * 10.0_f64.powf(-27.0 / 20.0);
        let gain = reconstructor.imager().gain(&bench.baseline);
        reconstructor.set_noise(Some(sigma * gain));
        Self {
            bench,
            reconstructor,
            sigma,
            rng,
        }
    }

    fn scene(touches: Vec<DiscTouch>) -> Scene {
        Scene {
            touches,
            smooth: false,
            snr_db: f64::INFINITY,
            fault: Fault::None,
        }
    }

    fn clean(&mut self, touches: &[DiscTouch]) -> Vec<f64> {
        let scene = Self::scene(touches.to_vec());
        self.bench.frame(&scene, &mut self.rng).unwrap()
    }

    fn noisy(&mut self, clean: &[f64]) -> Vec<f64> {
        noisy(clean.to_vec(), self.sigma, &mut self.rng)
    }
}

#[test]
fn an_untouched_sheet_costs_no_reconstruction_and_no_allocation() {
    let mut w = Watched::new(71);
    let clean = w.clean(&[]);
    for k in 0..2000 {
        let frame = w.noisy(&clean);
        let (r, baseline) = (&mut w.reconstructor, &w.bench.baseline);
        let mut touches = 0;
        let used = allocation_counter::measure(|| touches = r.frame(baseline, &frame).unwrap().touches.len());
        assert_eq!(touches, 0, "{k}");
        assert!(k == 0 || used.count_total == 0, "{k}: {used:?}");
    }
}

/// Everything that a frame needs is there once frames like it have come: picture, peaks, fit, noise, what the watch keeps.
#[test]
fn touches_that_move_are_reconstructed_without_allocation() {
    let mut w = Watched::new(75);
    let frames: Vec<Vec<f64>> = (0..40)
        .map(|k| {
            let angle = 0.05 * f64::from(k);
            let touches: Vec<DiscTouch> = (0..3)
                .map(|t| {
                    let angle = angle + 2.1 * f64::from(t);
                    touch(45.0 * angle.cos(), 45.0 * angle.sin())
                })
                .collect();
            let clean = w.clean(&touches);
            w.noisy(&clean)
        })
        .collect();
    for pass in 0..2 {
        for (k, frame) in frames.iter().enumerate() {
            let (r, baseline) = (&mut w.reconstructor, &w.bench.baseline);
            let mut found = (0, false);
            let used = allocation_counter::measure(|| {
                let result = r.frame(baseline, frame).unwrap();
                found = (result.touches.len(), result.anew);
            });
            assert_eq!(found, (3, true), "{k}");
            assert!(pass == 0 || used.count_total == 0, "{k}: {used:?}");
        }
    }
}

#[test]
fn a_scene_at_rest_keeps_its_result() {
    let mut w = Watched::new(72);
    let truth = [touch(30.0, 20.0), touch(-35.0, -10.0)];
    let clean = w.clean(&truth);
    let (mut anew, mut worst) = (0, 0.0_f64);
    for _ in 0..400 {
        let frame = w.noisy(&clean);
        let (r, baseline) = (&mut w.reconstructor, &w.bench.baseline);
        let mut before = Vec::new();
        let found = r.frame(baseline, &frame).unwrap();
        assert_eq!(found.touches.len(), 2);
        anew += usize::from(found.anew);
        for t in &truth {
            let near = |f: &host::picture::Touch| (f.x_mm - t.centre_mm[0]).hypot(f.y_mm - t.centre_mm[1]);
            worst = worst.max(found.touches.iter().map(near).fold(f64::INFINITY, f64::min));
        }
        before.clone_from(&found.touches);
        // The very frame again is nothing new, and costs nothing.
        let used = allocation_counter::measure(|| {
            let again = r.frame(baseline, &frame).unwrap();
            assert!(!again.anew && again.touches == before);
        });
        assert_eq!(used.count_total, 0, "{used:?}");
    }
    // A frame that happened to lie far out is left soon, but then the next ones differ from it.
    assert!(anew < 200, "{anew} of 400");
    assert!(worst < 1.5, "{worst}");
}

/// Slower than the noise shows from frame to frame, so that only the sum of many frames' moves can be seen.
#[test]
fn a_slow_touch_is_followed() {
    let mut w = Watched::new(73);
    let mut errors = Vec::new();
    for k in 0..300 {
        let x = -30.0 + 0.05 * f64::from(k);
        let clean = w.clean(&[touch(x, 10.0)]);
        let frame = w.noisy(&clean);
        let found = w.reconstructor.frame(&w.bench.baseline, &frame).unwrap();
        assert_eq!(found.touches.len(), 1, "{k}");
        errors.push((found.touches[0].x_mm - x).hypot(found.touches[0].y_mm - 10.0));
    }
    // Noise of four touches: about twice as much as 27 dB of this one alone.
    let (median, most) = (quantile(&errors, 0.5), quantile(&errors, 0.95));
    assert!(median < 0.6 && most < 1.6, "{median} {most}");
}

#[test]
fn what_comes_and_goes_is_seen_at_once() {
    let mut w = Watched::new(74);
    for k in 0..12 {
        let count = [0, 1, 2, 0, 2, 1][k % 6];
        let touches: Vec<DiscTouch> = (0..count).map(|t| touch(45.0 * f64::from(t) - 20.0, 12.0)).collect();
        let clean = w.clean(&touches);
        let frame = w.noisy(&clean);
        let found = w.reconstructor.frame(&w.bench.baseline, &frame).unwrap();
        assert_eq!(found.touches.len(), touches.len(), "{k}");
        // A frame with values that are no number is looked into, whatever was before.
        let mut broken = frame.clone();
        for v in broken.iter_mut().step_by(50) {
            *v = f64::NAN;
        }
        let found = w.reconstructor.frame(&w.bench.baseline, &broken).unwrap();
        assert_eq!(found.touches.len(), touches.len(), "{k}, broken");
    }
}
