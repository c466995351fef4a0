//! A frame that shows nothing, or nothing new, is not reconstructed again, and no change is missed. Frames of a scene
//! at rest are averaged.

use forward::{DiscTouch, Drive};
use inverse::pipeline::{FrameResult, Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use inverse::touches::touch::Touch;
use std::collections::BTreeMap;
use studies::{Fault, LiveSheet, Scene, quantile};

fn touch(x: f64, y: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: [x, y],
        radius_mm: 12.5,
        rise: 0.2,
    }
}

/// The noise is that of four touches at 27 dB.
fn live_sheet(seed: u64) -> LiveSheet {
    LiveSheet::new(Drive::PAPER, seed, |sheet, rng| {
        let touches = vec![touch(40.0, 0.0), touch(-40.0, 5.0), touch(0.0, 45.0), touch(3.0, -50.0)];
        sheet.frame(&scene(touches), rng)
    })
    .unwrap()
}

fn scene(touches: Vec<DiscTouch>) -> Scene {
    Scene {
        touches,
        smooth: false,
        snr_db: f64::INFINITY,
        fault: Fault::None,
    }
}

fn clean(live: &mut LiveSheet, touches: &[DiscTouch]) -> Vec<f64> {
    live.sheet.frame(&scene(touches.to_vec()), &mut live.rng).unwrap()
}

#[test]
fn an_untouched_sheet_costs_no_reconstruction_and_no_allocation() {
    let mut live = live_sheet(71);
    let clean = clean(&mut live, &[]);
    for k in 0..2000 {
        let frame = live.frame(&clean);
        let r = &mut live.reconstructor;
        let mut touches = 0;
        let used = allocation_counter::measure(|| touches = r.frame(&frame).unwrap().touches.len());
        assert_eq!(touches, 0, "{k}");
        assert!(k == 0 || used.count_total == 0, "{k}: {used:?}");
    }
}

/// The memory of every step, from the change detector to the fit, is kept from earlier frames of the same kind.
#[test]
fn touches_that_move_are_reconstructed_without_allocation() {
    let mut live = live_sheet(75);
    let frames: Vec<Vec<f64>> = (0..40)
        .map(|k| {
            let angle = 0.05 * f64::from(k);
            let touches: Vec<DiscTouch> = (0..3)
                .map(|t| {
                    let angle = angle + 2.1 * f64::from(t);
                    touch(45.0 * angle.cos(), 45.0 * angle.sin())
                })
                .collect();
            let clean = clean(&mut live, &touches);
            live.frame(&clean)
        })
        .collect();
    for pass in 0..2 {
        for (k, frame) in frames.iter().enumerate() {
            let r = &mut live.reconstructor;
            let mut found = (0, false);
            let used = allocation_counter::measure(|| {
                let result = r.frame(frame).unwrap();
                found = (result.touches.len(), result.anew);
            });
            assert_eq!(found, (3, true), "{k}");
            assert!(pass == 0 || used.count_total == 0, "{k}: {used:?}");
        }
    }
}

/// Two scenes take turns, at rest for 30 frames each. The result is made anew from the mean of 2, 4, 8 and 16 frames.
/// Its error falls with the root of this number, and so does the stated uncertainty.
#[test]
fn a_scene_at_rest_is_averaged() {
    let mut live = live_sheet(72);
    let scenes = [
        [touch(30.0, 20.0), touch(-35.0, -10.0)],
        [touch(-20.0, 40.0), touch(10.0, -45.0)],
    ];
    let clean = scenes.each_ref().map(|scene| clean(&mut live, scene));
    let mut rms: BTreeMap<usize, (f64, f64, f64)> = BTreeMap::new();
    let mut anew = 0;
    for rest in 0..40 {
        for k in 0..30 {
            let frame = live.frame(&clean[rest % 2]);
            let r = &mut live.reconstructor;
            let mut found = &mut FrameResult::default();
            let used = allocation_counter::measure(|| found = r.frame(&frame).unwrap());
            assert_eq!(found.touches.len(), 2, "{rest}, {k}");
            assert!(k > 0 || found.anew && found.frames == 1, "{rest}");
            for t in &scenes[rest % 2] {
                let off = |f: &Touch| (f.x_mm - t.centre_mm[0]).hypot(f.y_mm - t.centre_mm[1]);
                let near = found.touches.iter().map(off).fold(f64::INFINITY, f64::min);
                assert!(near < 1.5, "{rest}, {k}: {near}");
            }
            if !found.anew {
                assert_eq!(used.count_total, 0, "{used:?}");
                continue;
            }
            anew += 1;
            assert!(matches!(found.frames, 1 | 2 | 4 | 8 | 16) && found.frames <= k + 1);
            let (square, said, count) = rms.entry(found.frames).or_default();
            for t in &scenes[rest % 2] {
                let off = |f: &Touch| (f.x_mm - t.centre_mm[0]).hypot(f.y_mm - t.centre_mm[1]);
                let near = found.touches.iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
                *square += off(near).powi(2);
                *said += near.x_sd_mm.unwrap().powi(2) + near.y_sd_mm.unwrap().powi(2);
                *count += 1.0;
            }
        }
    }
    // Five results for every rest, and a few more by chance.
    assert!((180..260).contains(&anew), "{anew} of 1200");
    let [first, last] = [rms[&1], rms[&16]].map(|(square, said, count)| (square / count, said / count));
    assert!((8.0..32.0).contains(&(first.0 / last.0)), "{rms:?}");
    assert!((10.0..20.0).contains(&(first.1 / last.1)), "{rms:?}");
}

/// With a given current a touch near the rim looks like a contact that changed. This is decided in its first frames, so that the others
/// are averaged.
#[test]
fn a_touch_at_rest_is_averaged_as_soon_with_a_given_current() {
    let mut live = LiveSheet::new(Drive::Current { amplitude_a: 1e-3 }, 78, |sheet, rng| {
        sheet.frame(&scene(vec![touch(40.0, 0.0)]), rng)
    })
    .unwrap();
    let empty = clean(&mut live, &[]);
    let (places, looks) = (30, 8);
    let mut averaged = 0;
    for k in 0..places {
        let (angle, radius) = (2.4 * f64::from(k), 62.0 * (f64::from(k) / f64::from(places)).sqrt());
        let touched = clean(&mut live, &[touch(radius * angle.cos(), radius * angle.sin())]);
        for _ in 0..8 {
            let frame = live.frame(&empty);
            live.reconstructor.frame(&frame).unwrap();
        }
        let mut frames = 0;
        for _ in 0..looks {
            let frame = live.frame(&touched);
            let found = live.reconstructor.frame(&frame).unwrap();
            assert_eq!(found.touches.len(), 1, "{k}");
            frames = frames.max(found.frames);
        }
        averaged += i32::from(frames >= 4);
    }
    assert!(averaged + 1 >= places, "{averaged} of {places}");
}

/// Frames of a table are unrelated: each is reconstructed alone, also with known noise. Empty frames show no touch.
#[test]
fn frames_of_a_table_are_not_each_others_results() {
    let mut live = live_sheet(77);
    let (touched, empty) = (clean(&mut live, &[touch(30.0, 20.0)]), clean(&mut live, &[]));
    let imager = live.sheet.fitted_imager();
    let options = ReconstructorOptions::for_imager(&imager, Method::Nnls);
    let noise = FrameNoise::of_frames(live.sigma);
    let mut r = Reconstructor::new(
        Reference::new(imager, live.sheet.baseline.clone(), noise).unwrap(),
        options,
    );
    for k in 0..30 {
        let frame = live.frame(if k % 5 == 4 { &empty } else { &touched });
        let found = r.frame(&frame).unwrap();
        if k % 5 == 4 {
            assert!(found.touches.is_empty(), "{k}");
        } else {
            assert!(found.anew && found.frames == 1 && found.touches.len() == 1, "{k}");
        }
    }
}

/// The noise of the baseline is common to all frames. Averaging 16 of them does not reduce it.
#[test]
fn the_noise_of_the_baseline_is_not_averaged() {
    let mut live = live_sheet(76);
    let clean = clean(&mut live, &[touch(30.0, 20.0)]);
    let said = [None, Some(16)].map(|baseline_frames| {
        let noise = FrameNoise::Known {
            sigma: live.sigma,
            baseline_frames,
        };
        let mut r = live.sheet.live_reconstructor(noise).unwrap();
        let of = |r: &mut Reconstructor, live: &mut LiveSheet| loop {
            let frame = live.frame(&clean);
            let found = r.frame(&frame).unwrap();
            if found.anew && (found.frames == 16 || found.frames == 1) {
                return found.noise.unwrap().sigma;
            }
        };
        let one = of(&mut r, &mut live);
        (0..3)
            .map(|_| of(&mut r, &mut live) / one)
            .fold(f64::INFINITY, f64::min)
    });
    assert!((said[0] - 0.25).abs() < 1e-9, "{said:?}");
    assert!((said[1] - (2.0_f64 / 17.0).sqrt()).abs() < 1e-9, "{said:?}");
}

/// The move from frame to frame is smaller than the noise; only the sum of many moves is visible.
#[test]
fn a_slow_touch_is_followed() {
    let mut live = live_sheet(73);
    let mut errors = Vec::new();
    for k in 0..300 {
        let x = -30.0 + 0.05 * f64::from(k);
        let clean = clean(&mut live, &[touch(x, 10.0)]);
        let frame = live.frame(&clean);
        let found = live.reconstructor.frame(&frame).unwrap();
        assert_eq!(found.touches.len(), 1, "{k}");
        errors.push((found.touches[0].x_mm - x).hypot(found.touches[0].y_mm - 10.0));
    }
    // The noise is that of four touches, about twice as much as 27 dB of this touch alone.
    let (median, most) = (quantile(&errors, 0.5), quantile(&errors, 0.95));
    assert!(median < 0.6 && most < 1.6, "{median} {most}");
}

/// A touch slides at 6 to 45 mm/s (115 frames a second). The place that is said is within two stated deviations of the true one: the mean
/// of frames in which it moved is of no place. 19 of 20 coordinates would be so without a lag. At its end every frame is by itself. Where the
/// touch comes to rest, 16 frames are averaged again.
#[test]
fn a_touch_that_slides_is_where_it_is_said_to_be() {
    let mut live = live_sheet(77);
    let mut within = Vec::new();
    for step in [0.05, 0.1, 0.2, 0.4] {
        let moving = (25.0 / step) as u32;
        let mut averaged = 0;
        for k in 0..20 + moving + 64 {
            let x = -12.5 + step * f64::from(k.clamp(20, 20 + moving) - 20);
            let clean = clean(&mut live, &[touch(x, 10.0)]);
            let frame = live.frame(&clean);
            let found = live.reconstructor.frame(&frame).unwrap();
            assert_eq!(found.touches.len(), 1, "{step} {k}");
            let t = &found.touches[0];
            if (20..20 + moving).contains(&k) {
                let (x_sd, y_sd) = (t.x_sd_mm.unwrap(), t.y_sd_mm.unwrap());
                within.push((t.x_mm - x).abs() < 2.0 * x_sd);
                within.push((t.y_mm - 10.0).abs() < 2.0 * y_sd);
            }
            assert!(
                !(10 + moving..20 + moving).contains(&k) || found.frames <= 2,
                "{step} {k}"
            );
            if k > 40 + moving {
                averaged = averaged.max(found.frames);
            }
        }
        assert_eq!(averaged, 16, "{step}");
    }
    let part = within.iter().filter(|w| **w).count() as f64 / within.len() as f64;
    println!("{part:.3} of {} coordinates within two deviations", within.len());
    assert!(part > 0.9, "{part}");
}

/// A touch that presses harder and harder in one place does not slide: frames are averaged.
#[test]
fn a_touch_that_grows_in_its_place_is_averaged() {
    let mut live = live_sheet(79);
    let (mut averaged, frames) = (0, 400);
    for k in 0..frames {
        let pressed = DiscTouch {
            rise: 0.2 + 0.3 * f64::from(k) / f64::from(frames),
            ..touch(-30.0, 20.0)
        };
        let clean = clean(&mut live, &[pressed]);
        let frame = live.frame(&clean);
        averaged += u32::from(live.reconstructor.frame(&frame).unwrap().frames > 1);
    }
    assert!(averaged > frames / 2, "{averaged} of {frames}");
}

#[test]
fn what_comes_and_goes_is_seen_at_once() {
    let mut live = live_sheet(74);
    for k in 0..12 {
        let count = [0, 1, 2, 0, 2, 1][k % 6];
        let touches: Vec<DiscTouch> = (0..count).map(|t| touch(45.0 * f64::from(t) - 20.0, 12.0)).collect();
        let clean = clean(&mut live, &touches);
        let frame = live.frame(&clean);
        let found = live.reconstructor.frame(&frame).unwrap();
        assert_eq!(found.touches.len(), touches.len(), "{k}");
        // A frame with values that are not numbers is always reconstructed.
        let mut broken = frame.clone();
        for v in broken.iter_mut().step_by(50) {
            *v = f64::NAN;
        }
        let found = live.reconstructor.frame(&broken).unwrap();
        assert_eq!(found.touches.len(), touches.len(), "{k}, broken");
    }
}
