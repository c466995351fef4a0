//! The touches of a whole hand, five tips and a palm, are counted right and followed. One that is laid flat is one touch.

use forward::{DiscTouch, Drive};
use inverse::touches::touch::Touch;
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

/// Flat hands of 45 to 60 mm radius, weak and strong, at the noise of four fingers at 27 dB.
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

/// Foam of 50 mm radius: a finger at its rim is found, with the foam, each at its place. One far inside is found so or doubted. From the
/// sixth frame on.
#[test]
fn a_finger_on_foam_is_right_or_doubted() {
    let finger = |x: f64, y: f64| DiscTouch {
        centre_mm: [x, y],
        radius_mm: 12.5,
        rise: 0.2,
    };
    for (rise, at, inside) in [(0.02, [20.0, -10.0], true), (0.05, [-40.0, 20.0], false)] {
        let foam = DiscTouch {
            centre_mm: [5.0, 10.0],
            radius_mm: 50.0,
            rise,
        };
        let touches = [foam, finger(at[0], at[1])];
        let mut live = LiveSheet::new(Drive::PAPER, 93, |sheet, _| sheet.clean_frame(&[finger(31.0, -18.0)])).unwrap();
        let clean = live.sheet.clean_frame(&touches).unwrap();
        for frame in 0..40 {
            let result = live.reconstruct(&clean).unwrap();
            let has = |touch: &DiscTouch| {
                let off = |t: &Touch| (t.x_mm - touch.centre_mm[0]).hypot(t.y_mm - touch.centre_mm[1]);
                result.touches.iter().any(|t| off(t) < 1.5)
            };
            let right = result.touches.len() == 2 && touches.iter().all(has);
            assert!(
                frame < 6 || (right && result.doubt.is_none()) || (inside && result.doubt.is_some()),
                "{rise} {frame}: {:?}",
                result.touches
            );
        }
    }
}
