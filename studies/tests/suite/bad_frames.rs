//! Frames that are wrong as a whole: of the baseline, and after it.

use forward::{DiscTouch, Drive, Pattern};
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::pipeline::{FrameResult, Reconstructor, ReconstructorOptions};
use inverse::quality::doubt::Doubt;
use inverse::reference::Reference;
use inverse::reference::diagnosis::{Electrodes, Fault};
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use inverse::touches::touch::Touch;
use nalgebra::DMatrix;
use rand::rngs::StdRng;
use studies::{TestSheet, imager, noise_v, noisy, rng};

const AT_MM: [f64; 2] = [31.0, -18.0];
const FINGER: DiscTouch = DiscTouch {
    centre_mm: AT_MM,
    radius_mm: 12.5,
    rise: 0.2,
};
/// Time from a frame to the next, s.
const INTERVAL_S: f64 = 1.0 / 115.0;

/// A sheet with its baseline frames, frames without and with a finger, and their noise.
struct Rig {
    sheet: TestSheet,
    touched: Vec<f64>,
    sigma: f64,
    rng: StdRng,
    live: Live,
    frames: usize,
}

impl Rig {
    fn new(seed: u64, spoil: impl FnMut(usize, &mut Vec<f64>)) -> Self {
        Self::of(seed, Method::Nnls, spoil)
    }

    fn of(seed: u64, method: Method, mut spoil: impl FnMut(usize, &mut Vec<f64>)) -> Self {
        let mut rng = rng(seed);
        let imager = imager(Drive::PAPER, 5.0).unwrap();
        let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.3, 0.2, &mut rng).unwrap();
        let touched = sheet.clean_frame(&[FINGER]).unwrap();
        let sigma = noise_v(&touched, &sheet.baseline, 27.0);
        let options = LiveOptions {
            baseline_frames: 80,
            method,
            ..LiveOptions::default()
        };
        let mut live = Live::new(imager, options);
        for k in 0..options.baseline_frames {
            let mut frame = sheet.empty(sigma, &mut rng);
            spoil(k, &mut frame);
            live.frame(k as f64 * INTERVAL_S, &frame).unwrap();
        }
        Self {
            sheet,
            touched,
            sigma,
            rng,
            live,
            frames: options.baseline_frames,
        }
    }

    /// The next frame: its touches, and whether they are doubted.
    fn next(&mut self, touched: bool, spoil: impl FnOnce(&mut Vec<f64>)) -> (Vec<Touch>, bool) {
        let result = self.result(touched, spoil);
        let doubted = result.doubt.is_some() || !result.faults.is_empty();
        (result.touches.clone(), doubted)
    }

    /// All that is known of it.
    fn result(&mut self, touched: bool, spoil: impl FnOnce(&mut Vec<f64>)) -> &FrameResult {
        let clean = if touched { &self.touched } else { &self.sheet.baseline };
        let mut frame = noisy(clean.clone(), self.sigma, &mut self.rng);
        spoil(&mut frame);
        self.frames += 1;
        match self.live.frame(self.frames as f64 * INTERVAL_S, &frame).unwrap() {
            LiveFrame::Picture(result) => result,
            LiveFrame::Baseline { .. } => panic!("the baseline is taken"),
        }
    }
}

fn is_right(touches: &[Touch], touched: bool) -> bool {
    match touches {
        [] => !touched,
        [one] => touched && (one.x_mm - AT_MM[0]).hypot(one.y_mm - AT_MM[1]) < 5.0,
        _ => false,
    }
}

type Spoil = fn(&mut Vec<f64>);

/// Of 80 frames of a baseline one is spoilt, or eight: a finger is found as ever, and it is said how many were left out.
#[test]
fn a_bad_frame_of_the_baseline_hides_no_finger() {
    let spoils: [Spoil; 4] = [
        |f| f.fill(0.0),
        |f| f.iter_mut().for_each(|v| *v = -*v),
        |f| f.iter_mut().for_each(|v| *v *= 1000.0),
        |f| f.rotate_left(1),
    ];
    for (k, spoil) in spoils.into_iter().enumerate() {
        for bad in [1, 8] {
            let mut rig = Rig::new(880, |frame, values| {
                if frame % (80 / bad) == 5 {
                    spoil(values);
                }
            });
            let said = rig.live.inspection().unwrap().notes().join("\n");
            let part = format!("{:.0} % of the baseline's frames are unlike", 100.0 * bad as f64 / 80.0);
            assert!(said.contains(&part), "{said}");
            for frame in 0..30 {
                let touched = frame >= 10;
                let (touches, doubted) = rig.next(touched, |_| ());
                assert!(
                    is_right(&touches, touched) && !doubted,
                    "{k}, {bad} bad, frame {frame}: {touches:?}"
                );
            }
        }
    }
    let healthy = Rig::new(880, |_, _| ());
    let inspection = healthy.live.inspection().unwrap();
    assert_eq!(
        [inspection.warnings(), inspection.notes()].concat(),
        Vec::<String>::new()
    );
}

/// A source whose amplitude is another in every frame, or that still settles, hides no finger either.
#[test]
fn the_gain_of_a_baseline_frame_is_no_noise() {
    let gains: [fn(usize) -> f64; 2] = [
        |k| 1.0 + 0.01 * (2.4 * k as f64).sin(),
        |k| 1.0 - 0.02 * (-(k as f64) / 30.0).exp(),
    ];
    for gain in gains {
        let mut rig = Rig::new(881, |k, frame| frame.iter_mut().for_each(|v| *v *= gain(k)));
        for frame in 0..30 {
            let touched = frame >= 10;
            let (touches, doubted) = rig.next(touched, |f| f.iter_mut().for_each(|v| *v *= gain(80 + frame)));
            assert!(is_right(&touches, touched) && !doubted, "frame {frame}: {touches:?}");
        }
    }
}

/// A buffer that nobody fills any more is told by its ninth frame, and frames that come twice are none.
#[test]
fn the_same_frame_again_and_again_is_no_finger_that_rests() {
    let mut rig = Rig::new(883, |_, _| ());
    let mut last = Vec::new();
    for frame in 0..20 {
        let (touches, doubted) = rig.next(true, |f| last.clone_from(f));
        assert!(is_right(&touches, true) && !doubted, "frame {frame}: {touches:?}");
    }
    for frame in 0..60 {
        let (_, doubted) = rig.next(false, |f| f.clone_from(&last));
        assert_eq!(doubted, frame >= 7, "frame {frame}");
    }
    for frame in 0..40 {
        let (touches, doubted) = rig.next(false, |f| {
            if frame % 2 == 1 {
                f.clone_from(&last);
            }
            last.clone_from(f);
        });
        assert!(touches.is_empty() && !doubted, "frame {frame}: {touches:?}");
    }
}

/// What changes by more than touches do, and differently in every frame, leaves a search no time to end. It is doubted all the same.
#[test]
fn what_no_touch_explains_is_doubted_however_it_changes() {
    let spoils: [Spoil; 3] = [
        |f| f.rotate_left(1),
        |f| {
            let most = 0.9 * f.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            f.iter_mut().for_each(|v| *v = v.clamp(-most, most));
        },
        |f| {
            let before = f.clone();
            f.iter_mut()
                .skip(1)
                .zip(&before)
                .for_each(|(v, b)| *v += 0.03 * (b - *v));
        },
    ];
    for (kind, spoil) in spoils.into_iter().enumerate() {
        let mut rig = Rig::new(882, |_, _| ());
        let mut silent = 0;
        for frame in 0..120 {
            let touched = frame >= 60;
            let (touches, doubted) = rig.next(touched, spoil);
            // A tenth of a second after a change everything is to be said.
            if frame % 60 >= 12 && !is_right(&touches, touched) && !doubted {
                silent += 1;
            }
        }
        assert!(
            silent <= 2,
            "kind {kind}: {silent} of 96 frames are wrong and not doubted"
        );
    }
}

/// A multiplexer that has no time to settle: some of every value is still that of the value before. No sheet gives such values, though
/// touches may be found that explain them. Exchanged drive and sense tell it at rest. With the same in the baseline touches are right.
#[test]
fn values_that_remember_the_one_before_are_doubted_at_rest() {
    fn remember(f: &mut [f64]) {
        for k in (1..f.len()).rev() {
            f[k] += 0.004 * (f[k - 1] - f[k]);
        }
    }
    let mut rig = Rig::new(884, |_, _| ());
    let mut said = 0;
    for frame in 0..120 {
        let touched = frame >= 60;
        let result = rig.result(touched, |f| remember(f));
        said += usize::from(result.doubt == Some(Doubt::NotReciprocal));
        assert!(frame % 60 == 0 || result.doubt.is_some(), "frame {frame}");
    }
    assert!(said > 100, "{said}");
    let mut rig = Rig::new(884, |_, f| remember(f));
    for frame in 0..120 {
        let touched = frame >= 60;
        let (touches, doubted) = rig.next(touched, |f| remember(f));
        assert!(
            frame % 60 < 4 || (is_right(&touches, touched) && !doubted),
            "frame {frame}: {touches:?}"
        );
    }
}

/// A drive whose values are zero in one frame of nine is no touch that comes down. What is between is believed, and once one of its two
/// electrodes is named, what is left of these frames is, too.
#[test]
fn frames_that_come_and_go_are_doubted() {
    let mut rig = Rig::new(885, |_, _| ());
    let (mut silent, mut sound, mut believed, mut is_named) = (0, 0, 0, false);
    for frame in 0..240 {
        let touched = frame >= 120;
        let bad = frame % 9 == 5;
        let result = rig.result(touched, |f| {
            if bad {
                f[26..39].fill(0.0);
            }
        });
        is_named = match result.faults.as_slice() {
            [] => false,
            [Fault::Loose(electrodes)] => {
                assert!([[2], [3]].iter().any(|of| of == electrodes.list()), "{electrodes}");
                true
            }
            others => panic!("{others:?}"),
        };
        let (right, doubted) = (is_right(&result.touches, touched), result.doubt.is_some());
        // Three are no chance any more.
        if frame % 120 >= 24 {
            silent += usize::from(!right && !doubted);
            sound += usize::from(!bad || is_named);
            believed += usize::from((!bad || is_named) && right && !doubted);
        }
    }
    assert!(is_named);
    assert_eq!(silent, 0);
    // The search in the frame after may not come to its end.
    assert!(believed * 10 >= sound * 9, "{believed} of {sound}");
}

/// A contact that fails in single frames, or in two, is named within a second. From then on touches are right, also where it fails. It
/// takes part again when it has not failed for long.
#[test]
fn a_contact_that_comes_and_goes_is_named() {
    const LOOSE: usize = 6;
    let loose = Fault::Loose(Electrodes::of(&[LOOSE]));
    // Open, and worse by so many ohm.
    for (seed, ohm) in [(890, None), (891, Some(300.0))] {
        for touched in [false, true] {
            let mut rig = Rig::new(seed, |_, _| ());
            let touches: &[DiscTouch] = if touched { &[FINGER] } else { &[] };
            let worse = |r: &mut DMatrix<f64>| r[(LOOSE, LOOSE)] += ohm.unwrap_or(0.0);
            let failed = rig.sheet.rewired_frame(touches, worse).unwrap();
            let pattern = Pattern::adjacent(16).unwrap();
            let mut named_at = None;
            for frame in 0..1000 {
                let fails = frame < 300 && (frame % 10 == 3 || frame % 30 == 4);
                let under = touched && frame < 400;
                let result = rig.result(under, |values| {
                    for ((v, failed), m) in values.iter_mut().zip(&failed).zip(pattern.measurements()) {
                        let of = [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus].contains(&LOOSE);
                        match ohm {
                            None if fails && of => *v = 0.0,
                            Some(_) if fails => *v = *failed,
                            _ => {}
                        }
                    }
                });
                let right = is_right(&result.touches, under);
                if result.faults == [loose] {
                    named_at.get_or_insert(frame);
                } else {
                    assert_eq!(result.faults, [], "frame {frame}");
                }
                if let Some(named) = named_at
                    && frame > named
                {
                    assert!(right && result.doubt.is_none(), "{ohm:?}, frame {frame}");
                    if !(800..950).contains(&frame) {
                        assert_eq!(result.faults.is_empty(), frame >= 950, "{ohm:?}, frame {frame}");
                    }
                }
            }
            let named = named_at.unwrap_or(usize::MAX) as f64 * INTERVAL_S;
            assert!(named < 1.0, "{ohm:?}, {touched}: {named} s");
        }
    }
}

/// Taps of one frame on an electrode, as fast as they may come, are no contact that comes and goes.
#[test]
fn quick_taps_on_an_electrode_are_no_loose_contact() {
    let mut rig = Rig::new(892, |_, _| ());
    let mut doubted = 0;
    for electrode in [0, 5, 11] {
        let angle = std::f64::consts::TAU * electrode as f64 / 16.0;
        for from_rim in [8.0, 14.0] {
            let out = 98.0 - from_rim;
            let tap = DiscTouch {
                centre_mm: [out * angle.cos(), out * angle.sin()],
                ..FINGER
            };
            let tapped = rig.sheet.clean_frame(&[tap]).unwrap();
            let change: Vec<f64> = tapped.iter().zip(&rig.sheet.baseline).map(|(t, b)| t - b).collect();
            for frame in 0..120 {
                // It comes with the frame, or in the middle of it.
                let first = if frame % 24 == 5 { 0 } else { change.len() / 2 };
                let result = rig.result(false, |values| {
                    if frame % 12 == 5 {
                        let later = values.iter_mut().zip(&change).skip(first);
                        later.for_each(|(v, change)| *v += change);
                    }
                });
                doubted += usize::from(result.doubt == Some(Doubt::NotTouches));
                let is_loose = |fault: &Fault| matches!(fault, Fault::Loose(_));
                assert!(
                    !result.faults.iter().any(is_loose),
                    "{electrode}, {from_rim}, frame {frame}"
                );
            }
        }
    }
    // They are what frames that come and go look like.
    assert!(doubted >= 6, "{doubted}");
}

/// A conductive thing between two electrodes, or before one, is no leak from one wire to the other.
#[test]
fn a_conductive_thing_at_the_rim_is_no_leak() {
    let mut rig = Rig::new(893, |_, _| ());
    for k in 0..16 {
        let rise = [-0.4, -0.8, -0.05, -0.1][k / 2 % 4];
        let angle = std::f64::consts::TAU * 0.5 * k as f64 / 16.0;
        let out = [97.5 - 9.0, 97.5 - 15.0, 97.5 - 25.0][k % 3];
        let thing = DiscTouch {
            centre_mm: [out * angle.cos(), out * angle.sin()],
            radius_mm: 8.0,
            rise,
        };
        let with = rig.sheet.clean_frame(&[thing]).unwrap();
        let change: Vec<f64> = with.iter().zip(&rig.sheet.baseline).map(|(w, b)| w - b).collect();
        for frame in 0..72 {
            let result = rig.result(false, |values| {
                if frame < 60 {
                    values.iter_mut().zip(&change).for_each(|(v, change)| *v += change);
                }
            });
            let is_short = |fault: &Fault| matches!(fault, Fault::Short { .. } | Fault::Leak { .. });
            assert!(!result.faults.iter().any(is_short), "{thing:?}: {:?}", result.faults);
        }
    }
}

/// Voltages of the other sign, or of a tenth, are named as what they are; by a factor above a fifth touches are right.
#[test]
fn another_scale_is_named() {
    for factor in [-1.0, -1000.0, 0.1, -0.5, 0.5, 3.0, 1000.0] {
        let mut rig = Rig::new(886, |_, _| ());
        for frame in 0..40 {
            let touched = frame >= 20;
            let result = rig.result(touched, |f| f.iter_mut().for_each(|v| *v *= factor));
            if factor > 0.2 {
                assert!(
                    frame % 20 < 4 || is_right(&result.touches, touched) && result.faults.is_empty(),
                    "frame {frame}: {:?}",
                    result.touches
                );
                continue;
            }
            if frame >= 4 {
                let [Fault::Scale(found)] = result.faults[..] else {
                    panic!("{factor}, frame {frame}: {:?}", result.faults);
                };
                assert!((found / factor - 1.0).abs() < 0.03, "{factor}: {found}");
                assert!(result.touches.is_empty());
            }
        }
    }
}

/// An offset of all values that grows with time is no touch. When it comes at once, it is not asked for in the first half of a second.
#[test]
fn an_offset_of_all_values_is_drift() {
    let mut rig = Rig::new(887, |_, _| ());
    let rms = (rig.sheet.baseline.iter().map(|v| v * v).sum::<f64>() / rig.sheet.baseline.len() as f64).sqrt();
    let mut wrong = 0;
    for frame in 0..690 {
        let touched = frame / 115 % 2 == 1;
        let offset = 0.03 * rms * (frame as f64 / 460.0).min(1.0);
        let result = rig.result(touched, |f| f.iter_mut().for_each(|v| *v += offset));
        let right = is_right(&result.touches, touched) && result.doubt.is_none() && result.faults.is_empty();
        wrong += usize::from(frame % 115 >= 12 && !right);
        if frame >= 560 && frame % 115 >= 30 {
            // What is taken into account is said: all but what the baseline has followed in three seconds of ten.
            let part = result.drift.offset * rms / offset;
            assert!((0.7..1.02).contains(&part), "frame {frame}: {part}");
            let notice = result.notice().map(|notice| notice.to_string());
            assert!(notice.is_some_and(|text| text.contains("offset")), "frame {frame}");
        }
    }
    assert!(wrong < 60, "{wrong} of 618 frames");
    for frame in 0..40 {
        let result = rig.result(false, |f| f.iter_mut().for_each(|v| *v += 0.2 * rms));
        assert!(
            frame < 4 || result.faults == [Fault::OffsetOfAll],
            "frame {frame}: {:?}",
            result.faults
        );
    }
}

/// One value that is wild in some frames at rest is left out there, and is no drift that later frames are freed of.
#[test]
fn a_wild_value_at_rest_spoils_no_later_frame() {
    for wild in [10.0, 1e5, 1e200, -1e308] {
        let mut rig = Rig::new(888, |_, _| ());
        for frame in 0..80 {
            let touched = frame >= 50;
            let bad = frame < 30 && frame % 6 == 3;
            let result = rig.result(touched, |f| {
                if bad {
                    f[100] *= wild;
                }
            });
            // What no converter gives is said to be left out at once.
            assert!(
                !bad || wild.abs() < 1e13 || result.rejected.contains(&100),
                "{wild}, frame {frame}"
            );
            let right = is_right(&result.touches, touched) && result.doubt.is_none() && result.faults.is_empty();
            assert!(bad || right, "{wild}, frame {frame}: {:?}", result.touches);
        }
    }
}

/// On a sheet that is the same all around, exchanged pairs are rounded alike. They agree, and yet values are off by up to half of a step. A
/// finger is found all the same, in a table and live, and none where nothing touches.
#[test]
fn values_that_are_rounded_alike_are_not_taken_for_exact() {
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut rng = rng(889);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let step = 5e-5;
    let rounded = |frame: &[f64]| -> Vec<f64> { frame.iter().map(|v| (v / step).round() * step).collect() };
    let empty = rounded(&sheet.baseline);
    let mut live = Live::new(imager.clone(), LiveOptions::default());
    let mut frames = 0;
    let mut next = |frame: &[f64]| -> Option<Vec<Touch>> {
        frames += 1;
        match live.frame(f64::from(frames) * INTERVAL_S, frame).unwrap() {
            LiveFrame::Picture(result) => result.doubt.is_none().then(|| result.touches.clone()),
            LiveFrame::Baseline { .. } => None,
        }
    };
    for _ in 0..LiveOptions::default().baseline_frames {
        next(&empty);
    }
    let options = ReconstructorOptions::for_imager(&imager, Method::Nnls);
    let reference = Reference::new(imager.clone(), empty.clone(), FrameNoise::Unknown).unwrap();
    let mut of_table = Reconstructor::new(reference, options);
    for k in 0..12 {
        let angle = 2.4 * f64::from(k);
        let centre_mm = [6.0 * f64::from(k) * angle.cos(), 6.0 * f64::from(k) * angle.sin()];
        let finger = DiscTouch {
            centre_mm,
            radius_mm: 12.5,
            rise: 0.3,
        };
        let touched = rounded(&sheet.clean_frame(&[finger]).unwrap());
        let is_found = |touches: &[Touch]| {
            let [one] = touches else { return false };
            (one.x_mm - centre_mm[0]).hypot(one.y_mm - centre_mm[1]) < 5.0
        };
        let found = of_table.frame(&touched).unwrap();
        assert!(
            is_found(&found.touches) && found.doubt.is_none(),
            "{centre_mm:?}: {:?} {:?}",
            found.touches,
            found.doubt
        );
        assert!(of_table.frame(&empty).unwrap().touches.is_empty());
        for frame in 0..8 {
            let found = next(&touched);
            assert!(
                frame < 3 || found.as_deref().is_some_and(is_found),
                "{centre_mm:?}, {frame}: {found:?}"
            );
        }
        for frame in 0..8 {
            let found = next(&empty);
            assert!(
                frame < 3 || found == Some(Vec::new()),
                "{centre_mm:?}, {frame}: {found:?}"
            );
        }
    }
}

/// A baseline that has an offset is compared with as any other: what is found is right or doubted, and no fault hides it.
#[test]
fn an_offset_of_the_baseline_blocks_nothing() {
    let offset = |f: &mut Vec<f64>| f.iter_mut().for_each(|v| *v += 0.008);
    let mut rig = Rig::new(890, |_, f| offset(f));
    assert!(rig.live.inspection().unwrap().fault.is_none());
    for frame in 0..40 {
        let touched = frame >= 20;
        let result = rig.result(touched, offset);
        let right = is_right(&result.touches, touched);
        assert!(result.faults.is_empty(), "frame {frame}: {:?}", result.faults);
        assert!(
            frame % 20 < 4 || right || result.doubt.is_some(),
            "frame {frame}: {:?}",
            result.touches
        );
    }
}

/// Pictures alone explain nothing: that exchanged pairs disagree is not asked.
#[test]
fn pictures_without_a_fit_are_not_doubted_for_their_pairs() {
    let mut rig = Rig::of(891, Method::Tikhonov, |_, _| ());
    for frame in 0..40 {
        let result = rig.result(frame >= 20, |_| ());
        assert_ne!(result.doubt, Some(Doubt::NotReciprocal), "frame {frame}");
    }
}
