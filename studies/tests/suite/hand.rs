//! The touches of a whole hand, five tips and a palm, are counted right and followed. One that is laid flat is one touch.

use forward::{DiscTouch, Drive};
use studies::LiveSheet;
use studies::cost::Happening;

/// The hand moves 1 mm from frame to frame. The noise is that of four fingers at 27 dB.
#[test]
fn a_hand_that_moves_keeps_its_count_and_its_palm() {
    let mut live = LiveSheet::new(Drive::PAPER, 91, |sheet, _| {
        sheet.clean_frame(&Happening::Four.touches(0))
    })
    .unwrap();
    let (mut right, mut allocated, frames) = (0, 0, 48);
    let sequence: Vec<Vec<f64>> = (0..frames)
        .map(|k| {
            let clean = live.sheet.clean_frame(&Happening::Hand.touches(k)).unwrap();
            live.frame(&clean)
        })
        .collect();
    for pass in 0..2 {
        for (k, frame) in sequence.iter().enumerate() {
            let mut found = Vec::new();
            let used = allocation_counter::measure(|| {
                let touches = &live.reconstructor.frame(frame).unwrap().touches;
                found.clone_from(touches);
            });
            // The copy of the touches above allocates once.
            allocated += usize::from(pass > 0 && k > 0 && used.count_total > 1);
            let truth = Happening::Hand.touches(k);
            right += usize::from(found.len() == truth.len());
            // From the second frame on, the palm is one wide touch at its place.
            let palm = truth[0];
            let off =
                |t: &&inverse::touches::touch::Touch| (t.x_mm - palm.centre_mm[0]).hypot(t.y_mm - palm.centre_mm[1]);
            let nearest = found.iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
            let radius = (nearest.area_mm2 / std::f64::consts::PI).sqrt();
            assert!(
                k == 0 || (off(&nearest) < 2.5 && (radius / palm.radius_mm - 1.0).abs() < 0.15),
                "{pass} {k}: {nearest:?}"
            );
        }
    }
    assert!(right >= 2 * frames * 9 / 10, "{right} of {}", 2 * frames);
    assert_eq!(allocated, 0);
}

/// Flat hands and lower arms of 45 to 60 mm radius, weak and strong, at the noise of four fingers at 27 dB.
#[test]
fn a_hand_laid_flat_is_one_wide_touch() {
    for (centre_mm, radius_mm, rise) in [
        ([10.0, -8.0], 45.0, 0.1),
        ([10.0, -8.0], 60.0, 0.02),
        ([25.0, 20.0], 60.0, 0.3),
        ([40.0, 10.0], 45.0, 0.1),
    ] {
        let mut live = LiveSheet::new(Drive::PAPER, 92, |sheet, _| {
            sheet.clean_frame(&Happening::Four.touches(0))
        })
        .unwrap();
        let hand = DiscTouch {
            centre_mm,
            radius_mm,
            rise,
        };
        let clean = live.sheet.clean_frame(&[hand]).unwrap();
        for frame in 0..24 {
            let result = live.reconstruct(&clean).unwrap();
            let [one] = result.touches[..] else {
                panic!("{hand:?} {frame}: {:?}", result.touches)
            };
            let radius = (one.area_mm2 / std::f64::consts::PI).sqrt();
            let total_mm2 = rise * std::f64::consts::PI * radius_mm * radius_mm;
            assert!(result.doubt.is_none(), "{hand:?} {frame}: {:?}", result.doubt);
            assert!(
                (one.x_mm - centre_mm[0]).hypot(one.y_mm - centre_mm[1]) < 1.5
                    && (radius / radius_mm - 1.0).abs() < 0.05
                    && (one.total_mm2 / total_mm2 - 1.0).abs() < 0.05,
                "{hand:?} {frame}: {one:?}"
            );
        }
    }
}

/// A finger presses on foam; a fist has its knuckles beside it; a lower arm lies at the rim, and two hands on the sheet. From the sixth frame
/// on there are as many touches as there are, each at its place.
#[test]
fn what_lies_on_something_wide_is_a_touch_of_its_own() {
    let disc = |x: f64, y: f64, radius_mm: f64, rise: f64| DiscTouch {
        centre_mm: [x, y],
        radius_mm,
        rise,
    };
    let scenes = [
        vec![disc(5.0, 10.0, 50.0, 0.02), disc(20.0, -10.0, 12.5, 0.2)],
        vec![disc(5.0, 10.0, 50.0, 0.05), disc(-40.0, 20.0, 12.5, 0.2)],
        vec![disc(-30.0, 10.0, 40.0, 0.1), disc(50.0, -30.0, 12.5, 0.2)],
        vec![
            disc(-10.0, 0.0, 28.0, 0.1),
            disc(10.0, 22.0, 10.0, 0.15),
            disc(-14.0, 30.0, 10.0, 0.15),
        ],
        vec![disc(-45.0, 0.0, 35.0, 0.1), disc(45.0, 10.0, 35.0, 0.1)],
    ];
    for (k, touches) in scenes.into_iter().enumerate() {
        let mut live = LiveSheet::new(Drive::PAPER, 93, |sheet, _| {
            sheet.clean_frame(&[disc(31.0, -18.0, 12.5, 0.2)])
        })
        .unwrap();
        let clean = live.sheet.clean_frame(&touches).unwrap();
        let mut wrong = 0;
        for frame in 0..40 {
            let result = live.reconstruct(&clean).unwrap();
            let at_its_place = |touch: &DiscTouch| {
                let [x, y] = touch.centre_mm;
                let off = |t: &inverse::touches::touch::Touch| (t.x_mm - x).hypot(t.y_mm - y);
                result.touches.iter().any(|t| off(t) < 2.5)
            };
            let right = result.touches.len() == touches.len() && touches.iter().all(at_its_place);
            wrong += usize::from(frame >= 6 && !(right && result.doubt.is_none()));
        }
        assert!(wrong <= 3, "scene {k}: {wrong} of 34 frames");
    }
}
