//! Who looks at pictures changes no touch.

use forward::{Drive, Pattern};
use hil_sim::{Pace, SceneFile, SimPort};
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::pipeline::FrameResult;
use inverse::reference::imager::Imager;
use link::plans::live_plan;
use link::{MeasuredFrame, Session};
use std::sync::Arc;
use std::time::Duration;

/// Frames of a baseline: 0.7 s.
const FRAMES: usize = 80;

/// Two fingers of which one comes, moves and goes, and the other stays.
const SCENE: &str = r#"
duration_s = 3.0
[[touch]]
shape = "finger"
slide = { at_s = 1.0, for_s = 0.6, from_mm = [30.0, 10.0], to_mm = [50.0, -10.0], force_n = 18.0 }
[[touch]]
shape = "finger"
press = { at_s = 1.2, for_s = 2.0, x_mm = -40.0, y_mm = -20.0, force_n = 20.0 }
"#;

fn frames() -> (Arc<Imager>, Vec<MeasuredFrame>) {
    let file = SceneFile::parse(SCENE, None).unwrap();
    let port = SimPort::new(file.board().unwrap(), Pace::Unpaced).unwrap();
    let session = Session::start(Box::new(port), live_plan).unwrap();
    let pattern = Pattern::from_pairs(session.electrodes(), session.measurements()).unwrap();
    let imager = Imager::new(&file.sheet, Drive::PAPER, pattern, 5.0).unwrap();
    let mut frames: Vec<MeasuredFrame> = Vec::new();
    while frames.last().is_none_or(|frame| frame.time_s < 2.0) {
        frames.push(session.frame(Duration::from_secs(120)).unwrap().unwrap());
    }
    (Arc::new(imager), frames)
}

/// Results of all frames, with a picture so often; `look` says of which frames one is asked for by itself.
fn results(
    (imager, frames): &(Arc<Imager>, Vec<MeasuredFrame>),
    picture_s: f64,
    look: impl Fn(usize) -> bool,
) -> Vec<FrameResult> {
    let options = LiveOptions {
        baseline_frames: FRAMES,
        picture_s,
        ..LiveOptions::default()
    };
    let mut live = Live::new(Arc::clone(imager), options);
    let mut results = Vec::new();
    for (k, frame) in frames.iter().enumerate() {
        let made = live.frame(frame.time_s, &frame.values_v).unwrap();
        let LiveFrame::Picture(result) = made else { continue };
        results.push(if look(k) {
            live.picture().unwrap().clone()
        } else {
            result.clone()
        });
    }
    results
}

#[test]
fn touches_are_the_same_whoever_looks_and_a_picture_is_of_its_own_frame() {
    let frames = frames();
    let nobody = results(&frames, f64::INFINITY, |_| false);
    let every = results(&frames, 0.0, |_| false);
    let asked = results(&frames, f64::INFINITY, |_| true);
    let now_and_then = results(&frames, 1.0 / 30.0, |k| k % 5 == 0);
    assert!(nobody.iter().any(|r| r.touches.len() == 2) && nobody.iter().any(|r| !r.is_pictured));
    for (k, result) in nobody.iter().enumerate() {
        for other in [&every[k], &asked[k], &now_and_then[k]] {
            assert_eq!(result.touches, other.touches, "picture {k}");
            assert_eq!(
                (result.doubt, &result.faults),
                (other.doubt, &other.faults),
                "picture {k}"
            );
            assert_eq!(result.residual, other.residual, "picture {k}");
        }
        // Of its own frame, by whatever way the solver came there.
        assert!(every[k].is_pictured && asked[k].is_pictured, "picture {k}");
        let largest = every[k].x.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let apart = every[k].x.iter().zip(&asked[k].x).map(|(a, b)| (a - b).abs());
        let apart = apart.fold(0.0, f64::max);
        assert!(apart <= 1e-6 * largest, "picture {k}: {apart} of {largest}");
    }
}
