//! What drifts since the baseline makes no touches, and takes nothing from those that are there.

use forward::{DiscTouch, Drive};
use inverse::reference::noise::FrameNoise;
use inverse::touches::touch::Touch;
use rand::Rng;
use rand_distr::StandardNormal;
use std::f64::consts::PI;
use std::ops::Range;
use studies::{Drift, TestSheet, imager, noise_v, noisy, rng, smooth_field};

const CURRENT: Drive = Drive::Current { amplitude_a: 1e-3 };

fn finger(x: f64, y: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: [x, y],
        radius_mm: 12.5,
        rise: 0.2,
    }
}

/// Frames at 27 dB, each alone, on another mesh and by the nonlinear model: a gain a tenth off, a sheet 10 K warmer (0.5 %/K),
/// contacts 10 % off by a normal distribution, and all of them.
#[test]
fn drift_makes_no_touch_and_moves_none() {
    for (drive, seed) in [(Drive::PAPER, 101), (CURRENT, 102)] {
        let imager = imager(drive, 5.0).unwrap();
        let mut rng = rng(seed);
        let mut sheet = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng).unwrap();
        let mut reconstructor = sheet.reconstructor().unwrap();
        let gain = Drift {
            gain: 1.1,
            ..Drift::none(16)
        };
        let warm = Drift {
            resistance: 0.95,
            ..Drift::none(16)
        };
        let contacts = Drift::none(16).with_contacts(0.1, &mut rng);
        let all = Drift {
            gain: 0.9,
            resistance: 1.05,
            ..Drift::none(16).with_contacts(0.1, &mut rng)
        };
        for drift in [gain, warm, contacts, all] {
            let sigma = noise_v(
                &sheet.clean_frame(&[finger(48.0, 0.0)]).unwrap(),
                &sheet.baseline.clone(),
                27.0,
            );
            let empty = sheet.drifted_frame(&[], &drift).unwrap();
            let touch = finger(-30.0, 45.0);
            let touched = sheet.drifted_frame(&[touch], &drift).unwrap();
            let name = format!("{drive:?} {drift:?}");
            for _ in 0..10 {
                let frame = noisy(empty.clone(), sigma, &mut rng);
                let found = reconstructor.frame(&frame).unwrap();
                assert!(found.touches.is_empty(), "{name}: {:?}", found.touches);
                let frame = noisy(touched.clone(), sigma, &mut rng);
                let found = reconstructor.frame(&frame).unwrap();
                assert_eq!(found.touches.len(), 1, "{name}: {:?}", found.touches);
                let t = found.touches[0];
                let off = (t.x_mm + 30.0).hypot(t.y_mm - 45.0);
                assert!(off < 0.8, "{name}: {off} mm");
                let total = touch.rise * std::f64::consts::PI * touch.radius_mm.powi(2);
                assert!(
                    (t.total_mm2 / total - 1.0).abs() < 0.1,
                    "{name}: {}",
                    t.total_mm2 / total
                );
            }
        }
    }
}

/// A gain is found to a thousandth, and said; one that did not drift is not.
#[test]
fn a_common_gain_is_found_and_said() {
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut rng = rng(103);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let mut reconstructor = sheet.reconstructor().unwrap();
    for gain in [0.5, 0.9, 1.0, 1.03, 2.0] {
        for touches in [vec![], vec![finger(10.0, -60.0)]] {
            let drift = Drift {
                gain,
                ..Drift::none(16)
            };
            let clean = sheet.drifted_frame(&touches, &drift).unwrap();
            let sigma = noise_v(
                &sheet.clean_frame(&[finger(48.0, 0.0)]).unwrap(),
                &sheet.baseline.clone(),
                27.0,
            );
            let found = reconstructor.frame(&noisy(clean, sigma, &mut rng)).unwrap();
            assert!(
                (found.drift.gain / gain - 1.0).abs() < 2e-3,
                "{gain} {}: {}",
                touches.len(),
                found.drift.gain
            );
            assert_eq!(found.drift.notice().is_some(), gain != 1.0);
        }
    }
}

/// A sheet that was bent, and one that was stretched in parts, since the baseline; channels whose gains drifted. Each alone: no touch where
/// there is none, and a finger at its place. What is beside the touches is said.
#[test]
fn unevenness_and_channels_make_no_touch_and_move_none() {
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut rng = rng(106);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let mut reconstructor = sheet.reconstructor().unwrap();
    let clean = sheet.clean_frame(&[finger(48.0, 0.0)]).unwrap();
    let sigma = noise_v(&clean, &sheet.baseline.clone(), 27.0);
    let parts = smooth_field(0.01, 90.0, &mut rng);
    let channels = Drift::none(16).with_channels(0.005, &mut rng);
    for touches in [vec![], vec![finger(-30.0, 45.0)]] {
        let frames = [
            sheet.uneven_frame(&touches, |p| 0.03 * (0.8 * p[0] - 0.6 * p[1]) / 97.5),
            sheet.uneven_frame(&touches, &parts),
            sheet.drifted_frame(&touches, &channels),
        ];
        for (k, frame) in frames.into_iter().enumerate() {
            let frame = frame.unwrap();
            for _ in 0..4 {
                let found = reconstructor.frame(&noisy(frame.clone(), sigma, &mut rng)).unwrap();
                assert_eq!(found.touches.len(), touches.len(), "{k}: {:?}", found.touches);
                assert_eq!(found.drift.uneven > 0.002, k < 2, "{k}: {:?}", found.drift);
                for t in &found.touches {
                    let off = (t.x_mm + 30.0).hypot(t.y_mm - 45.0);
                    assert!(off < 2.0, "{k}: {off} mm");
                }
            }
        }
    }
}

/// An hour in which the gain drifts by 10 %, the sheet warms by 10 K and contacts drift by 10 % rms: no touch where there is none,
/// a tap a minute at its place, and one that is held for ten minutes does not fade.
#[test]
fn an_hour_of_drift_makes_no_touch_and_one_that_is_held_stays() {
    let contacts = Drift::none(16).with_contacts(0.1, &mut rng(104));
    let drift = Drift {
        gain: 0.9,
        resistance: 1.05,
        ..contacts
    };
    let seen = hour(&drift, 0.0, 40..50, 105);
    println!("{seen:?}");
    assert_eq!((seen.phantoms, seen.wrong), (0, 0));
    let [first, last] = seen.held;
    assert!((last / first - 1.0).abs() < 0.05, "{first} {last}");
}

/// Channels that drift by 1 % rms in an hour are followed while nothing touches.
#[test]
fn channels_that_drift_are_followed() {
    let seen = hour(&Drift::none(16), 0.01, 0..0, 106);
    println!("{seen:?}");
    assert_eq!((seen.phantoms, seen.wrong), (0, 0));
}

/// What became of an hour: frames with touches where there are none, frames without the true touch; total of the touch that is held,
/// in its first and last 25 s, over the true one.
#[derive(Debug, Default)]
struct Seen {
    phantoms: usize,
    wrong: usize,
    held: [f64; 2],
}

/// An hour of drift that goes on evenly, channels by this standard deviation, with a tap of 5 s in every minute and one that is held
/// in these minutes. Frames come every 0.25 s.
fn hour(drift: &Drift, channels: f64, hold: Range<u32>, seed: u64) -> Seen {
    const FRAMES: usize = 240;
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut rng = rng(seed);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let loud = sheet.clean_frame(&[finger(48.0, 0.0)]).unwrap();
    let sigma = noise_v(&loud, &sheet.baseline, 27.0);
    let mut reconstructor = sheet.live_reconstructor(FrameNoise::of_frames(sigma)).unwrap();
    let gains: Vec<f64> = (0..16)
        .map(|_| channels * rng.sample::<f64, _>(StandardNormal))
        .collect();
    let senses: Vec<usize> = imager.pattern.measurements().iter().map(|m| m.sense.plus).collect();
    let whole = 0.2 * PI * 12.5 * 12.5;
    let (mut seen, mut totals) = (Seen::default(), Vec::new());
    for minute in 0..60 {
        let holds = hold.contains(&minute);
        let angle = if holds { 2.0 } else { f64::from(minute) };
        let touch = finger(55.0 * angle.cos(), 55.0 * angle.sin());
        // Without and with the touch, at the minute's beginning and end.
        let frames = [minute, minute + 1].map(|m| {
            let part = f64::from(m) / 60.0;
            [None, Some(touch)].map(|touch| {
                let mut frame = sheet.drifted_frame(touch.as_slice(), &drift.part(part)).unwrap();
                frame
                    .iter_mut()
                    .zip(&senses)
                    .for_each(|(v, s)| *v *= 1.0 + part * gains[*s]);
                frame
            })
        });
        for k in 0..FRAMES {
            let pressed = holds || (10..30).contains(&k);
            let part = k as f64 / FRAMES as f64;
            let [from, to] = [0, 1].map(|end| &frames[end][usize::from(pressed)]);
            let clean: Vec<f64> = from.iter().zip(to).map(|(a, b)| a + part * (b - a)).collect();
            let frame = noisy(clean, sigma, &mut rng);
            let found = &reconstructor
                .frame_after(&frame, Some(60.0 / FRAMES as f64))
                .unwrap()
                .touches;
            // One that comes or goes is searched for in some frames.
            let just = |at: usize| (at..at + 4).contains(&k);
            if just(0) || (!holds && (just(10) || just(30))) {
                continue;
            }
            if !pressed {
                seen.phantoms += usize::from(!found.is_empty());
                continue;
            }
            let [x, y] = touch.centre_mm;
            let at = |t: &Touch| (t.x_mm - x).hypot(t.y_mm - y) < 1.5;
            seen.wrong += usize::from(!(found.len() == 1 && at(&found[0])));
            if holds {
                totals.extend(found.first().map(|t| t.total_mm2 / whole));
            }
        }
    }
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    if totals.len() > 200 {
        seen.held = [mean(&totals[..100]), mean(&totals[totals.len() - 100..])];
    }
    seen
}
