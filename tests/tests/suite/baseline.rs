//! The baseline of a simulated skin, however late it is taken, and the way back to an earlier one.

use forward::{Drive, Pattern, Sheet};
use hil_sim::{Material, Pace, Scene, SceneFile, Shape, SimPort, Touch};
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::pipeline::FrameResult;
use inverse::reference::baseline::Baseline;
use inverse::reference::departure::{Departure, DriftOptions};
use inverse::reference::imager::Imager;
use inverse::touches::touch::Touch as Found;
use link::plans::live_plan;
use link::{MeasuredFrame, Session};
use std::sync::Arc;
use std::time::Duration;

/// Only for a chain that hangs.
const NOT_FOR_EVER: Duration = Duration::from_secs(120);
/// Frames of a baseline: 0.7 s.
const FRAMES: usize = 80;

/// A finger that comes down at 1.5 s and stays.
const PLACE_MM: [f64; 2] = [-30.0, 25.0];

fn file(touches: Vec<Touch>, seed: u64) -> SceneFile {
    let mut file = SceneFile::demo(Sheet::paper());
    file.scene = Scene {
        touches,
        ..Scene::empty()
    };
    file.config.electronics.seed = seed;
    file
}

fn finger() -> Vec<Touch> {
    let [x, y] = PLACE_MM;
    vec![Touch::pressed(
        Shape::Finger,
        6.75,
        x,
        y,
        &[(1.5, 0.0), (1.6, 20.0), (1000.0, 20.0)],
    )]
}

/// How far from the finger a touch was found.
fn off_mm(found: &Found) -> f64 {
    (found.x_mm - PLACE_MM[0]).hypot(found.y_mm - PLACE_MM[1])
}

struct Chain {
    port: SimPort,
    session: Session,
    live: Live,
}

impl Chain {
    /// As `skin run --every-frame` starts.
    fn start(file: &SceneFile, held: bool) -> Self {
        let board = file.board().unwrap();
        let board = if held { board.holding_scene() } else { board };
        let port = SimPort::new(board, Pace::Unpaced).unwrap();
        let session = Session::start(Box::new(port.clone()), live_plan).unwrap();
        let pattern = Pattern::from_pairs(session.electrodes(), session.measurements()).unwrap();
        let imager = Imager::new(&file.sheet, Drive::PAPER, pattern, 5.0).unwrap();
        let options = LiveOptions {
            baseline_frames: FRAMES,
            ..LiveOptions::default()
        };
        Self {
            live: Live::new(Arc::new(imager), options),
            port,
            session,
        }
    }

    fn frame(&self) -> MeasuredFrame {
        self.session.frame(NOT_FOR_EVER).unwrap().unwrap()
    }

    /// The program is busy until this time of the board, s.
    fn busy_until(&self, time_s: f64) {
        while self.frame().time_s < time_s {}
    }

    fn baseline(&mut self) -> Baseline {
        loop {
            let frame = self.frame();
            let made = self.live.frame(frame.time_s, &frame.values_v).unwrap();
            if matches!(made, LiveFrame::Baseline { left: 0, .. }) {
                return self.live.baseline().unwrap().clone();
            }
        }
    }

    fn picture(&mut self) -> (f64, FrameResult) {
        let frame = self.frame();
        match self.live.frame(frame.time_s, &frame.values_v).unwrap() {
            LiveFrame::Picture(result) => (frame.time_s, result.clone()),
            other => panic!("{other:?}"),
        }
    }
}

/// Whether two baselines differ by more than their noise alone.
fn differ(a: &Baseline, b: &Baseline) -> bool {
    let no_drift = DriftOptions {
        restart: 0.0,
        per_hour: 0.0,
        most: 0.0,
        ..DriftOptions::default()
    };
    Departure::of(a, b, 0.0, &no_drift).unwrap().differs
}

#[test]
fn a_late_baseline_is_the_untouched_sheets_and_the_first_picture_is_the_scenes_first() {
    let untouched = Chain::start(&file(Vec::new(), 5), false).baseline();

    let mut held = Chain::start(&file(finger(), 6), true);
    // Far beyond the first touch.
    held.busy_until(4.0);
    assert!(!differ(&held.baseline(), &untouched));
    held.busy_until(7.0);
    held.port.begin_scene();
    let began_s = held.port.scene_began_s().unwrap();
    assert!(began_s >= 7.0);
    held.busy_until(began_s);
    // Nothing for 1.5 s, then the finger where it is.
    loop {
        let (time_s, result) = held.picture();
        let scene_s = time_s - began_s;
        if scene_s < 1.49 {
            assert!(result.touches.is_empty(), "{scene_s}: {:?}", result.touches);
        } else if scene_s > 1.7 {
            let [touch] = result.touches.as_slice() else {
                panic!("{scene_s}: {:?}", result.touches)
            };
            assert!(off_mm(touch) < 1.0, "{scene_s}: {touch:?}");
            break;
        }
    }
    assert_eq!(held.session.link().counters().skipped_frames, 0);

    // What the law guards against: a scene that does not wait has its finger in the late baseline.
    let mut running = Chain::start(&file(finger(), 6), false);
    running.busy_until(4.0);
    assert!(differ(&running.baseline(), &untouched));
}

/// A finger that comes down or lifts while the baseline is taken: it is of the frames before or after, where these are most, or taken again.
#[test]
fn a_baseline_is_taken_again_where_a_finger_moved_meanwhile() {
    let [x, y] = PLACE_MM;
    for (seed, forces) in [[(0.35, 0.0), (0.4, 20.0)], [(0.3, 20.0), (0.35, 0.0)]]
        .iter()
        .enumerate()
    {
        let finger = Touch::pressed(Shape::Finger, 6.75, x, y, forces);
        let mut chain = Chain::start(&file(vec![finger], 20 + seed as u64), false);
        let mut begun_anew = 0;
        loop {
            let frame = chain.frame();
            match chain.live.frame(frame.time_s, &frame.values_v).unwrap() {
                LiveFrame::Baseline { left: 0, .. } => break,
                LiveFrame::Baseline { again, .. } => begun_anew += usize::from(again),
                LiveFrame::Picture(_) => panic!("there is no baseline yet"),
            }
        }
        let baseline = chain.live.baseline().unwrap();
        assert!(
            begun_anew <= 2 && begun_anew + baseline.unlike > 0,
            "{seed}: {begun_anew}"
        );
        assert_eq!(baseline.moved, 0.0, "{seed}");
    }
}

/// A finger that rests on the sheet when the baseline is taken, and is lifted while two others press, is no unevenness of the sheet: the
/// others are where they are, or the frame is doubted.
#[test]
fn a_finger_that_is_lifted_moves_no_others() {
    let press = |x, y, forces: &[(f64, f64)]| Touch::pressed(Shape::Finger, 6.75, x, y, forces);
    let places = [[-40.0, 0.0], [40.0, -30.0]];
    let mut held = file(
        vec![
            press(30.0, 20.0, &[(0.0, 12.0), (2.0, 12.0), (2.1, 0.0)]),
            press(places[0][0], places[0][1], &[(0.5, 0.0), (0.6, 10.0), (1000.0, 10.0)]),
            press(places[1][0], places[1][1], &[(1.0, 0.0), (1.1, 10.0), (1000.0, 10.0)]),
        ],
        30,
    );
    held.scene.preloaded = true;
    held.scene.material = Material::default();
    let mut chain = Chain::start(&held, true);
    chain.baseline();
    chain.port.begin_scene();
    let began_s = chain.port.scene_began_s().unwrap();
    chain.busy_until(began_s);
    let (mut silent, mut right, mut frames) = (0, 0, 0);
    loop {
        let (time_s, result) = chain.picture();
        let scene_s = time_s - began_s;
        if scene_s > 4.0 {
            break;
        }
        if scene_s < 2.4 {
            continue;
        }
        frames += 1;
        let is_there = |[x, y]: [f64; 2]| {
            let mut found = result.touches.iter();
            found.any(|t| (t.x_mm - x).hypot(t.y_mm - y) < 3.0)
        };
        let is_right = result.touches.len() == 2 && places.into_iter().all(is_there);
        right += usize::from(is_right);
        silent += usize::from(!is_right && result.doubt.is_none());
    }
    assert!(
        silent == 0 && right * 10 >= frames * 9,
        "{silent} silent, {right} right of {frames}"
    );
}

/// What lay on the sheet in the baseline has gone. A finger that comes down while the new one is being made is shown all the same, and is
/// no part of it: once it has lifted, the sheet is quiet.
#[test]
fn a_baseline_that_renews_itself_takes_no_finger_into_it() {
    let press = |x, y, forces: &[(f64, f64)]| Touch::pressed(Shape::Finger, 6.75, x, y, forces);
    let during = |from: f64, to: f64| [(from, 0.0), (from + 0.05, 12.0), (to, 12.0), (to + 0.05, 0.0)];
    let mut held = file(
        vec![
            press(-25.0, 15.0, &[(0.0, 12.0), (1.0, 12.0), (1.1, 0.0)]),
            press(30.0, 20.0, &during(1.5, 2.5)),
            press(30.0, -20.0, &during(3.15, 5.0)),
        ],
        31,
    );
    held.scene.preloaded = true;
    held.scene.material = Material::default();
    let mut chain = Chain::start(&held, true);
    let pressed = chain.baseline();
    chain.port.begin_scene();
    let began_s = chain.port.scene_began_s().unwrap();
    chain.busy_until(began_s);
    let (mut seen, mut held_frames, mut renewed, mut quiet) = (0, 0, 0, 0);
    loop {
        let (time_s, result) = chain.picture();
        let scene_s = time_s - began_s;
        let is_there = |t: &inverse::touches::touch::Touch| (t.x_mm - 30.0).hypot(t.y_mm + 20.0) < 3.0;
        if (3.3..5.0).contains(&scene_s) {
            held_frames += 1;
            seen += usize::from(result.touches.iter().any(is_there));
        }
        if scene_s > 6.5 {
            let is_quiet = result.touches.is_empty() && result.doubt.is_none();
            assert!(is_quiet, "{scene_s}: {:?} {:?}", result.touches, result.doubt);
            quiet += 1;
        }
        if scene_s > 7.5 {
            break;
        }
        if let Some(baseline) = chain.live.rested() {
            renewed += 1;
            chain.live.resume(baseline).unwrap();
        }
    }
    assert!(renewed == 1 && differ(chain.live.baseline().unwrap(), &pressed));
    assert!(held_frames > 100 && seen == held_frames, "{seen} of {held_frames}");
    assert!(quiet > 50, "{quiet}");
}

#[test]
fn an_earlier_baseline_brings_its_touches_back_and_their_numbers_go_on() {
    let mut chain = Chain::start(&file(finger(), 7), true);
    let untouched = chain.baseline();
    chain.port.begin_scene();
    chain.busy_until(chain.port.scene_began_s().unwrap() + 2.0);
    // A touch has its number with its third frame.
    let third = |chain: &mut Chain| [chain.picture(), chain.picture(), chain.picture()][2].1.touches.clone();
    let before = third(&mut chain);
    assert_eq!(before.len(), 1);

    // Under the finger: it is no touch any more.
    chain.live.tare();
    let pressed = chain.baseline();
    assert!(differ(&pressed, &untouched));
    assert!(chain.picture().1.touches.is_empty());

    // Half of another one, and back.
    chain.live.tare();
    let frame = chain.frame();
    chain.live.frame(frame.time_s, &frame.values_v).unwrap();
    chain.live.resume(untouched.clone()).unwrap();
    assert_eq!(chain.live.baseline(), Some(&untouched));
    let after = third(&mut chain);
    assert_eq!(after.len(), 1);
    assert!(
        off_mm(&after[0]) < 1.0 && off_mm(&before[0]) < 1.0,
        "{after:?} {before:?}"
    );
    // It was gone for longer than a touch keeps its number; one that starts anew would have the first again.
    assert!(after[0].id > before[0].id, "{:?} {:?}", after[0].id, before[0].id);

    let mut short = untouched;
    short.values_v.pop();
    assert!(chain.live.resume(short).is_err());
    assert_eq!(chain.picture().1.touches.len(), 1);
}

#[test]
fn what_begins_anew_is_as_new_and_looks_at_no_baseline_twice() {
    let file = file(finger(), 7);
    let mut chain = Chain::start(&file, true);
    let baseline = chain.baseline();
    chain.port.begin_scene();
    chain.busy_until(chain.port.scene_began_s().unwrap() + 1.5);
    let frames: Vec<MeasuredFrame> = (0..40).map(|_| chain.frame()).collect();
    let pictures = |live: &mut Live| -> Vec<FrameResult> {
        let picture = |frame: &MeasuredFrame| match live.frame(frame.time_s, &frame.values_v).unwrap() {
            LiveFrame::Picture(result) => FrameResult {
                solve_us: 0.0,
                ..result.clone()
            },
            other => panic!("{other:?}"),
        };
        frames.iter().map(picture).collect()
    };
    let mut anew = Chain::start(&file, true).live;
    anew.resume(baseline.clone()).unwrap();
    let wanted = pictures(&mut anew);
    assert!(wanted.last().unwrap().touches.iter().any(|t| t.id.is_some()));
    // Whatever it saw before, and whichever baseline was in force.
    let looked = Arc::clone(chain.live.imager());
    pictures(&mut chain.live);
    for tared in [false, true] {
        if tared {
            chain.live.tare();
            chain.baseline();
            assert!(!Arc::ptr_eq(chain.live.imager(), &looked));
        }
        chain.live = chain.live.anew();
        assert!(chain.live.baseline().is_none());
        chain.live.resume(baseline.clone()).unwrap();
        assert!(Arc::ptr_eq(chain.live.imager(), &looked));
        assert_eq!(pictures(&mut chain.live), wanted);
    }
}
