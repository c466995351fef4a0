//! A made-up skin live: touches come and go on it, and it drifts.

use super::{Press, Skin};
use crate::learned::LearnedSheet;
use crate::live::{Live, LiveFrame, LiveOptions};
use crate::pipeline::FrameResult;
use crate::quality::doubt::Doubt;
use crate::reference::imager::Imager;
use forward::{Drive, Pattern, Sheet};
use std::sync::Arc;

/// Frames a second.
const RATE: f64 = 50.0;

struct Rig {
    skin: Skin,
    live: Live,
    frame: usize,
    /// What all values have gained since the baseline, a second.
    drift: f64,
}

impl Rig {
    /// Taught by so many presses; the baseline is taken while something presses at a place.
    fn new(presses: usize, drift: f64, lying: Option<[f64; 2]>) -> Self {
        let mut skin = Skin::new(true, 0.0, 0.03);
        let (learned, _) = skin.learn(presses);
        let sheet = LearnedSheet {
            learned: Arc::new(learned),
            measurements: skin.measurements.clone(),
            gain: None,
        };
        let imager = Imager::new(&Sheet::paper(), Drive::PAPER, Pattern::opposite(16).unwrap(), 10.0).unwrap();
        let options = LiveOptions {
            baseline_frames: 8,
            ..LiveOptions::default()
        };
        let mut rig = Self {
            skin,
            live: Live::new(Arc::new(imager), options).with_learned(sheet),
            frame: 0,
            drift,
        };
        for _ in 0..8 {
            assert_eq!(rig.step(lying, 1.0), None);
        }
        rig
    }

    /// The next frame, with a press of some strength or none; its result, or none while the baseline is taken.
    fn step(&mut self, place: Option<[f64; 2]>, strength: f64) -> Option<FrameResult> {
        let time_s = self.frame as f64 / RATE;
        self.frame += 1;
        let change = place.map_or_else(|| vec![0.0; self.skin.measurements.len()], |p| self.skin.clean(p));
        let (noise, drift) = (self.skin.noise(), self.drift * time_s);
        let values: Vec<f64> = (change.iter().zip(noise))
            .enumerate()
            .map(|(c, (v, n))| 5.0 + c as f64 / 100.0 + drift + strength * v + 0.2 * n)
            .collect();
        match self.live.frame(time_s, &values).unwrap() {
            LiveFrame::Baseline { .. } => None,
            LiveFrame::Picture(result) => Some(result.clone()),
        }
    }

    /// So many seconds of it: what every frame gave.
    fn last(&mut self, seconds: f64, place: Option<[f64; 2]>, strength: f64) -> Vec<FrameResult> {
        (0..(seconds * RATE) as usize)
            .map(|_| self.step(place, strength).unwrap())
            .collect()
    }
}

/// Touches of any strength are found at their places under one number each, and nothing at rest, though the values drift by twenty
/// times the residuals of a press.
#[test]
fn touches_are_followed_while_the_sheet_drifts() {
    let mut rig = Rig::new(40, 0.01, None);
    for (k, strength) in [1.0, 0.7, 1.6].into_iter().enumerate() {
        assert!(
            rig.last(20.0, None, 0.0)
                .iter()
                .all(|r| r.touches.is_empty() && r.doubt.is_none())
        );
        let place = [[30.0, 5.0], [-10.0, -20.0], [0.0, 40.0]][k];
        let pressed = rig.last(1.0, Some(place), strength);
        // A touch has its number from the third frame on, and a clear one from its first.
        let id = pressed[2].touches[0].id;
        assert!(id.is_some());
        for (n, result) in pressed.iter().enumerate() {
            let [touch] = result.touches[..] else {
                panic!("{} touches", result.touches.len())
            };
            let off_mm = (touch.x_mm - place[0]).hypot(touch.y_mm - place[1]);
            assert!(off_mm < 3.0, "{off_mm} mm off at {place:?}");
            assert!(
                (touch.rise / strength - 1.0).abs() < 0.15,
                "{} of {strength}",
                touch.rise
            );
            assert!(
                touch.id == id || (n < 2 && touch.id.is_none()),
                "{:?} in frame {n}",
                touch.id
            );
            assert_eq!(result.doubt, None);
            // The picture shows it there.
            let grid = &rig.live.imager().grid;
            let brightest = (0..result.x.len())
                .max_by(|a, b| result.x[*a].total_cmp(&result.x[*b]))
                .unwrap();
            let at = grid.centre(brightest);
            assert!(
                (at[0] - touch.x_mm).hypot(at[1] - touch.y_mm) < grid.cell_mm(),
                "{at:?}"
            );
        }
    }
}

/// A finger that rests for ten seconds does not fade, and is not found again where it lay.
#[test]
fn a_touch_that_is_held_stays_and_leaves_nothing() {
    let mut rig = Rig::new(40, 0.0, None);
    let held = rig.last(10.0, Some([20.0, -20.0]), 1.0);
    let strength = |r: &FrameResult| r.touches[0].rise;
    assert!((strength(&held[499]) / strength(&held[0]) - 1.0).abs() < 0.05);
    assert!(rig.last(2.0, None, 0.0).iter().all(|r| r.touches.is_empty()));
}

/// What lay on the sheet when the baseline was taken makes no touch when it is lifted, and after some seconds a touch at another place is
/// right again.
#[test]
fn what_lay_on_the_sheet_in_the_baseline_is_forgotten() {
    let mut rig = Rig::new(40, 0.0, Some([0.0, 30.0]));
    assert!(
        rig.last(1.0, Some([0.0, 30.0]), 1.0)
            .iter()
            .all(|r| r.touches.is_empty())
    );
    let lifted = rig.last(15.0, None, 0.0);
    assert!(lifted[700..].iter().all(|r| r.touches.is_empty() && r.doubt.is_none()));
    let place = [25.0, -25.0];
    for result in rig.last(0.5, Some(place), 1.0) {
        let [touch] = result.touches[..] else {
            panic!("{} touches", result.touches.len())
        };
        assert!((touch.x_mm - place[0]).hypot(touch.y_mm - place[1]) < 3.0, "{touch:?}");
    }
}

/// A change unlike all presses is doubted; so is a frame of which most values are missing, and it shows no touch.
#[test]
fn what_is_no_press_is_doubted() {
    let mut rig = Rig::new(40, 0.0, None);
    let presses: Vec<Press> = rig.skin.presses(3);
    let count = rig.skin.measurements.len();
    let values = |change: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..count).map(|c| 5.0 + c as f64 / 100.0 + change(c)).collect()
    };
    // The changes of a press, each at another measurement.
    let shuffled = values(&|c| 3.0 * presses[0].change[(c * 71 + 5) % count]);
    let LiveFrame::Picture(result) = rig.live.frame(1.0, &shuffled).unwrap() else {
        panic!()
    };
    assert!(
        matches!(result.doubt, Some(Doubt::UnlikePresses { .. })),
        "{:?}",
        result.doubt
    );
    let missing = values(&|c| if c % 3 > 0 { f64::NAN } else { presses[0].change[c] });
    let LiveFrame::Picture(result) = rig.live.frame(1.02, &missing).unwrap() else {
        panic!()
    };
    assert_eq!(result.doubt, Some(Doubt::FewValues { used: 64, of: 192 }));
    assert!(result.touches.is_empty());
}
