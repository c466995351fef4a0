//! Strengths at the model's limit.

use forward::{DiscTouch, Drive};
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::pipeline::FrameResult;
use inverse::reference::imager::Imager;
use rand::rngs::StdRng;
use std::sync::Arc;
use studies::{TestSheet, imager, noise_v, noisy, rng};

/// Time from a frame to the next, s.
const INTERVAL_S: f64 = 1.0 / 115.0;
const BASELINE: usize = 80;

fn finger(at: [f64; 2], rise: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: at,
        radius_mm: 12.5,
        rise,
    }
}

/// A sheet on another mesh than the imager's, with the noise at which a finger of +20 % has 27 dB.
struct Rig {
    sheet: TestSheet,
    sigma: f64,
    rng: StdRng,
    live: Live,
    frames: usize,
}

impl Rig {
    fn new(imager: &Arc<Imager>, seed: u64) -> Self {
        let mut rng = rng(seed);
        let mut sheet = TestSheet::of_sheet(imager, Drive::PAPER, imager.model.sheet()).unwrap();
        let one = sheet.clean_frame(&[finger([31.0, -18.0], 0.2)]).unwrap();
        let sigma = noise_v(&one, &sheet.baseline, 27.0);
        let options = LiveOptions {
            baseline_frames: BASELINE,
            ..LiveOptions::default()
        };
        let mut live = Live::new(Arc::clone(imager), options);
        for k in 0..BASELINE {
            let frame = sheet.empty(sigma, &mut rng);
            live.frame(k as f64 * INTERVAL_S, &frame).unwrap();
        }
        Self {
            sheet,
            sigma,
            rng,
            live,
            frames: BASELINE,
        }
    }

    /// Takes frames of a scene at rest, and looks at every result.
    fn rest(&mut self, clean: &[f64], frames: usize, mut look: impl FnMut(usize, &FrameResult)) {
        for k in 0..frames {
            let frame = noisy(clean.to_vec(), self.sigma, &mut self.rng);
            self.frames += 1;
            match self.live.frame(self.frames as f64 * INTERVAL_S, &frame).unwrap() {
                LiveFrame::Picture(result) => look(k, result),
                LiveFrame::Baseline { .. } => panic!("the baseline is taken"),
            }
        }
    }
}

/// Whether every touch of these is found within 5 mm, and nothing else.
fn are(result: &FrameResult, touches: &[DiscTouch]) -> bool {
    let near = |t: &DiscTouch| {
        let [x, y] = t.centre_mm;
        result
            .touches
            .iter()
            .any(|found| (found.x_mm - x).hypot(found.y_mm - y) < 5.0)
    };
    result.touches.len() == touches.len() && touches.iter().all(near)
}

/// A hole, whose resistivity rises without end, is said to rise by at least as much as discs may; a finger of +300 % is measured.
#[test]
fn a_hole_is_at_the_limit_and_a_strong_finger_is_not() {
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    for (rise, at_limit) in [(300.0, true), (3.0, false)] {
        let mut rig = Rig::new(&imager, 11);
        let touch = finger([20.0, 30.0], rise);
        let clean = rig.sheet.clean_frame(&[touch]).unwrap();
        let mut last = None;
        rig.rest(&clean, 32, |_, result| last = Some(result.clone()));
        let last = last.unwrap();
        assert!(are(&last, &[touch]), "{last:?}");
        assert_eq!(last.touches[0].at_limit, at_limit, "{last:?}");
        // s = 2 c / (2 + c) is no larger than 1.7.
        assert!(!at_limit || (last.touches[0].rise - 3.4 / 0.3).abs() < 1e-9, "{last:?}");
    }
}
