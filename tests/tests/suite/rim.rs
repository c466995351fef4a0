//! Fingers on the electrodes at the rim, half of them beside the sheet: they are touches, and nothing is broken.

use forward::Sheet;
use hil_sim::{Key, Pace, SceneFile, Shape, SimPort, Touch};
use inverse::live::{LiveFrame, LiveOptions};
use link::plans::live_plan;
use studies::chain::Chain;

/// Time between two presses, of which each lasts 0.7 s.
const EVERY_S: f64 = 1.2;
const FIRST_S: f64 = 4.0;
const PRESSES: usize = 16;

/// One finger on every electrode in turn, and two others on the sheet. The places on the electrode, from 4 mm inside to the rim, and of
/// the others follow no pattern.
fn fingers(press: usize) -> [(f64, f64, f64); 3] {
    let part = |k: usize| (0.618_034 * (3 * press + k) as f64).fract();
    let angle = std::f64::consts::TAU * (press as f64 / 16.0) + (part(0) - 0.5) * 0.12;
    let at = |radius: f64, angle: f64, force: f64| (radius * angle.cos(), radius * angle.sin(), force);
    [
        at(96.0 + 4.0 * part(1), angle, 8.0 + 14.0 * part(2)),
        at(65.0 * part(3).sqrt(), angle + 2.2, 15.0),
        at(75.0, angle + 4.0 + part(4), 8.0 + 12.0 * part(5)),
    ]
}

#[test]
fn fingers_on_electrodes_are_no_fault() {
    let at = |press: usize| FIRST_S + EVERY_S * press as f64;
    let end_s = at(PRESSES);
    let mut file = SceneFile::parse(&format!("duration_s = {end_s}\n[material]\nkind = \"elastic\"\n"), None).unwrap();
    file.scene.touches = (0..PRESSES)
        .flat_map(|press| {
            fingers(press).map(|(x, y, force)| {
                let key = |after_s: f64, force| Key::new(at(press) + after_s, x, y, force);
                let keys = [key(0.0, 0.0), key(0.03, force), key(0.67, force), key(0.7, 0.0)];
                Touch::new(Shape::Finger, 6.75, keys.to_vec())
            })
        })
        .collect();
    let port = SimPort::new(file.board().unwrap(), Pace::Unpaced).unwrap();
    let mut chain = Chain::start(Box::new(port), &Sheet::paper(), live_plan, |_| LiveOptions::default()).unwrap();
    let mut named = Vec::new();
    let mut right = [(0, 0); PRESSES];
    let mut first_s = None;
    loop {
        let (frame, _, made) = chain.next_frame().unwrap();
        let time_s = frame.time_s - *first_s.get_or_insert(frame.time_s);
        if time_s > end_s - 0.3 {
            break;
        }
        let LiveFrame::Picture(result) = made else { continue };
        let press = ((time_s - FIRST_S) / EVERY_S).max(0.0) as usize;
        named.extend(result.faults.iter().map(|fault| (press, *fault)));
        let into_s = time_s - at(press);
        if (0.1..0.6).contains(&into_s) {
            right[press].0 += usize::from(result.touches.len() == 3 && result.doubt.is_none());
            right[press].1 += 1;
        }
    }
    assert!(named.is_empty(), "{named:?}");
    let all_right = right
        .iter()
        .filter(|(right, of)| 10 * right > 9 * of && *of > 40)
        .count();
    assert!(all_right >= 12, "{right:?}");
}
