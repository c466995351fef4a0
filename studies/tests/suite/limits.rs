//! Strengths at the model's limit.

use forward::{DiscTouch, Drive};
use studies::LiveSheet;

/// A hole, whose resistivity rises without end, is said to rise by at least as much as discs may; a finger of +300 % is measured.
#[test]
fn a_hole_is_at_the_limit_and_a_strong_finger_is_not() {
    let touch = |rise: f64| DiscTouch {
        centre_mm: [20.0, 30.0],
        radius_mm: 12.5,
        rise,
    };
    for (rise, at_limit) in [(300.0, true), (3.0, false)] {
        let mut live = LiveSheet::new(Drive::PAPER, 11, |sheet, _| sheet.clean_frame(&[touch(0.2)])).unwrap();
        let clean = live.sheet.clean_frame(&[touch(rise)]).unwrap();
        (0..31).for_each(|_| {
            live.reconstruct(&clean).unwrap();
        });
        let touches = live.reconstruct(&clean).unwrap().touches.clone();
        let [found] = touches[..] else {
            panic!("{touches:?}");
        };
        assert!((found.x_mm - 20.0).hypot(found.y_mm - 30.0) < 5.0, "{found:?}");
        assert_eq!(found.at_limit, at_limit, "{found:?}");
        // s = 2 c / (2 + c) is no larger than 1.7.
        assert!(!at_limit || (found.rise - 3.4 / 0.3).abs() < 1e-9, "{found:?}");
    }
}
