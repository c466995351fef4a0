//! A touch that lands while frames are measured: every drive sees another pressure.

use forward::{DiscTouch, Drive};
use studies::{LiveSheet, TestSheet};

/// Frames in a second of the paper's board.
const FRAMES_PER_S: f64 = 115.1;
/// How long a press takes to full force, s.
const RAMP_S: f64 = 0.3;
/// The rise there.
const FULL: f64 = 0.2;
/// Steps of the rise at which the sheet is solved.
const STEPS: usize = 10;

fn touch([x, y]: [f64; 2], rise: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: [x, y],
        radius_mm: 12.5,
        rise,
    }
}

/// A frame whose values are measured one after another, of which the first is measured at `begins_s`.
fn frame(levels: &[Vec<f64>], begins_s: f64) -> Vec<f64> {
    let values = levels[0].len();
    let value = |k: usize| {
        let t = begins_s + k as f64 / (values as f64 * FRAMES_PER_S);
        let at = (t / RAMP_S).clamp(0.0, 1.0) * STEPS as f64;
        let low = (at as usize).min(STEPS - 1);
        let part = at - low as f64;
        (1.0 - part) * levels[low][k] + part * levels[low + 1][k]
    };
    (0..values).map(value).collect()
}

fn levels(sheet: &mut TestSheet, at: [f64; 2]) -> Vec<Vec<f64>> {
    (0..=STEPS)
        .map(|k| match k {
            0 => sheet.baseline.clone(),
            _ => sheet.clean_frame(&[touch(at, FULL * k as f64 / STEPS as f64)]).unwrap(),
        })
        .collect()
}

/// Such a frame may look like two touches beside each other of which neither is sure. The noise has 27 dB of a touch of 8 %.
#[test]
fn a_touch_that_lands_is_told_in_every_frame() {
    for (seed, at) in [(151, [53.0, 28.0]), (152, [-30.0, 55.0])] {
        let mut live = LiveSheet::new(Drive::PAPER, seed, |sheet, _| {
            sheet.clean_frame(&[touch(at, 0.4 * FULL)])
        })
        .unwrap();
        let levels = levels(&mut live.sheet, at);
        let (landings, frames) = (60, 40);
        for landing in 0..landings {
            for _ in 0..8 {
                let empty = live.empty();
                live.reconstructor
                    .frame_after(&empty, Some(1.0 / FRAMES_PER_S))
                    .unwrap();
            }
            let phase = f64::from(landing) / f64::from(landings);
            for k in 0..frames {
                let begins_s = (f64::from(k) - phase) / FRAMES_PER_S;
                let frame = frame(&levels, begins_s);
                let frame = live.frame(&frame);
                let result = live
                    .reconstructor
                    .frame_after(&frame, Some(1.0 / FRAMES_PER_S))
                    .unwrap();
                // A quarter of the full force.
                if begins_s < 0.25 * RAMP_S {
                    continue;
                }
                let off = |t: &inverse::touches::touch::Touch| (t.x_mm - at[0]).hypot(t.y_mm - at[1]);
                assert!(
                    result.touches.iter().any(|t| off(t) < 12.5) && result.doubt.is_none(),
                    "{at:?}, landing {landing}, frame {k}: {:?}, {:?}",
                    result.touches,
                    result.doubt
                );
            }
        }
    }
}
