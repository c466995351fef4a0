//! What the noise of a frame is told by: patterns without reciprocal pairs, wild values, and the noise of each value by itself.

use forward::{DiscTouch, Drive, Pattern, Sheet};
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::pipeline::{Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::diagnosis::Fault;
use inverse::reference::imager::Imager;
use inverse::reference::noise::{FrameNoise, NoiseSource};
use inverse::solvers::Method;
use inverse::touches::touch::Touch;
use rand::Rng;
use rand::rngs::StdRng;
use rand_distr::StandardNormal;
use std::sync::Arc;
use studies::{TestSheet, imager, noise_v, noisy, rng};

fn finger(x: f64, y: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: [x, y],
        radius_mm: 12.5,
        rise: 0.2,
    }
}

/// Opposite drive and adjacent sense, one frame as the baseline. The estimate is that of the noise within a factor of two, and
/// touches are fitted as well as with reciprocal pairs.
#[test]
fn touches_are_fitted_without_reciprocal_pairs() {
    let pattern = Pattern::rotating(16, 8, 1).unwrap();
    assert!(pattern.reciprocal_indices().iter().all(Option::is_none));
    let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 5.0).unwrap());
    let mut rng = rng(111);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let mut reconstructor = sheet.reconstructor().unwrap();
    for touches in [
        vec![finger(40.0, 10.0)],
        vec![finger(-30.0, 45.0), finger(20.0, -50.0)],
        vec![finger(70.0, 0.0), finger(-40.0, 0.0), finger(0.0, 60.0)],
    ] {
        let clean = sheet.clean_frame(&touches).unwrap();
        let sigma = noise_v(&clean, &sheet.baseline.clone(), 27.0);
        for _ in 0..8 {
            let found = reconstructor.frame(&noisy(clean.clone(), sigma, &mut rng)).unwrap();
            let noise = found.noise.unwrap();
            assert!(matches!(noise.source, NoiseSource::Residual { .. }));
            assert!((0.5..2.0).contains(&(noise.sigma / sigma)), "{} {sigma}", noise.sigma);
            assert_eq!(found.touches.len(), touches.len(), "{:?}", found.touches);
            assert!(
                found.misfit.is_some() && found.doubt.is_none(),
                "{:?} {:?} {}",
                found.misfit,
                found.doubt,
                noise.sigma / sigma
            );
            for t in &touches {
                let off = |f: &inverse::touches::touch::Touch| (f.x_mm - t.centre_mm[0]).hypot(f.y_mm - t.centre_mm[1]);
                let near = found.touches.iter().map(off).fold(f64::INFINITY, f64::min);
                assert!(near < 1.0, "{near} mm: {:?}", found.touches);
            }
        }
    }
    // An empty frame shows nothing.
    let sigma = noise_v(
        &sheet.clean_frame(&[finger(48.0, 0.0)]).unwrap(),
        &sheet.baseline.clone(),
        27.0,
    );
    for _ in 0..20 {
        let frame = noisy(sheet.baseline.clone(), sigma, &mut rng);
        assert!(reconstructor.frame(&frame).unwrap().touches.is_empty());
    }
}

/// A few values of a frame that are anything: they are left out, touches are where they are, and no electrode is blamed.
#[test]
fn a_few_wild_values_are_no_open_electrode() {
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut rng = rng(113);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let clean = sheet.clean_frame(&[finger(-10.0, 10.0)]).unwrap();
    let sigma = noise_v(&clean, &sheet.baseline, 50.0);
    let noise = FrameNoise::of_frames(sigma);
    let reference = Reference::new(Arc::clone(&imager), sheet.baseline.clone(), noise).unwrap();
    let options = ReconstructorOptions::for_imager(&imager, Method::Nnls);
    let mut reconstructor = Reconstructor::new(reference, options);
    let (mut right, mut frames) = (0, 0);
    for wild in 2..=6 {
        for touched in [false, true, false, true] {
            let mut frame = noisy(
                if touched { clean.clone() } else { sheet.baseline.clone() },
                sigma,
                &mut rng,
            );
            for place in rand::seq::index::sample(&mut rng, frame.len(), wild) {
                frame[place] *= [0.2, 0.5, 1.5, 3.0][rng.random_range(0..4)];
            }
            let found = reconstructor.frame(&frame).unwrap();
            assert!(
                !found.faults.iter().any(|f| matches!(f, Fault::Open(_))),
                "{wild}: {:?}",
                found.faults
            );
            let is_there = |t: &Touch| (t.x_mm + 10.0).hypot(t.y_mm - 10.0) < 2.0;
            let is_right = found.touches.len() == usize::from(touched) && found.touches.iter().all(is_there);
            assert!(is_right || found.doubt.is_some(), "{wild}: {:?}", found.touches);
            (right, frames) = (right + usize::from(is_right), frames + 1);
        }
    }
    assert!(right * 10 >= frames * 9, "{right} of {frames}");
}

/// One value in twenty that is off by ten standard deviations, or in ten: touches are where they are without.
#[test]
fn many_values_off_by_ten_times_the_noise_move_no_touch() {
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut rng = rng(112);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let touches = [finger(-30.0, 45.0), finger(20.0, -50.0)];
    let clean = sheet.clean_frame(&touches).unwrap();
    let sigma = noise_v(&clean, &sheet.baseline, 27.0);
    let reference = Reference::new(
        Arc::clone(&imager),
        sheet.baseline.clone(),
        FrameNoise::of_frames(sigma),
    );
    let options = ReconstructorOptions::for_imager(&imager, Method::Nnls);
    let mut reconstructor = Reconstructor::new(reference.unwrap(), options);
    const FRAMES: usize = 16;
    let mut without = None;
    for wild in [0, 10, 20] {
        let (mut square, mut right, mut left_out, mut of_wild) = (0.0, 0, 0, 0);
        let spoil = |clean: &[f64], rng: &mut StdRng| {
            let mut frame = noisy(clean.to_vec(), sigma, rng);
            let places = rand::seq::index::sample(rng, frame.len(), wild).into_vec();
            for place in &places {
                frame[*place] += if rng.random() { 10.0 } else { -10.0 } * sigma;
            }
            (frame, places)
        };
        for _ in 0..FRAMES {
            let (empty, _) = spoil(&sheet.baseline, &mut rng);
            let found = reconstructor.frame(&empty).unwrap();
            assert!(
                found.touches.is_empty() && found.doubt.is_none(),
                "{wild} wild: {:?} {:?}",
                found.touches,
                found.doubt
            );
            let (frame, places) = spoil(&clean, &mut rng);
            let found = reconstructor.frame(&frame).unwrap();
            left_out += found.rejected.len();
            of_wild += found.rejected.iter().filter(|k| places.contains(k)).count();
            if found.touches.len() != touches.len() || found.doubt.is_some() {
                continue;
            }
            right += 1;
            for t in &touches {
                let off = |f: &inverse::touches::touch::Touch| (f.x_mm - t.centre_mm[0]).hypot(f.y_mm - t.centre_mm[1]);
                let near = found.touches.iter().map(off).fold(f64::INFINITY, f64::min);
                square += near * near;
            }
        }
        let rms = (square / (2 * right) as f64).sqrt();
        let sound = *without.get_or_insert(rms);
        assert!(right >= FRAMES - 1, "{wild} wild: {right} right");
        assert!(rms < 2.0 * sound, "{wild} wild: {rms} mm, {sound} mm without");
        // Some are told as pairs, of which one is sound.
        assert!(
            4 * of_wild >= 3 * left_out,
            "{wild} wild: {of_wild} of {left_out} left out"
        );
    }
}

/// One value in ten with the other sign, and nothing but the frame tells its noise: what is wrong then is doubted, and half is right.
#[test]
fn what_many_wild_values_do_to_a_frame_is_not_silent() {
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut rng = rng(113);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let mut reconstructor = sheet.reconstructor().unwrap();
    let touches = [finger(-30.0, 45.0), finger(20.0, -50.0)];
    let clean = sheet.clean_frame(&touches).unwrap();
    let sigma = noise_v(&clean, &sheet.baseline.clone(), 35.0);
    const FRAMES: usize = 16;
    let mut right = 0;
    for _ in 0..FRAMES {
        for truth in [&touches[..], &[]] {
            let values = if truth.is_empty() { &sheet.baseline } else { &clean };
            let mut frame = noisy(values.clone(), sigma, &mut rng);
            for place in rand::seq::index::sample(&mut rng, frame.len(), 20) {
                frame[place] *= -1.0;
            }
            let found = reconstructor.frame(&frame).unwrap();
            let counted = found.touches.len() == truth.len();
            right += usize::from(counted);
            assert!(counted || found.doubt.is_some(), "{:?}", found.touches);
        }
    }
    assert!(right > FRAMES, "{right} of {}", 2 * FRAMES);
}

fn normal(rng: &mut StdRng) -> f64 {
    rng.sample(StandardNormal)
}

type Noise = fn(&mut [f64], f64, &mut StdRng);

/// The noise of a source is in proportion to each value, one amplifier is noisier than the others, or a converter has steps of ten times the
/// noise: the baseline tells it. Empty frames show nothing, and a finger is found once, as exactly as is said.
#[test]
fn noise_that_is_not_the_same_for_all_values_is_no_touch() {
    let kinds: [(Noise, f64); 3] = [
        (
            |frame, _, rng| frame.iter_mut().for_each(|v| *v *= 1.0 + 0.002 * normal(rng)),
            3.0,
        ),
        (
            |frame, sigma, rng| {
                let noisy = frame.iter_mut().skip(5).step_by(13);
                noisy.for_each(|v| *v += 10.0 * sigma * normal(rng));
            },
            0.5,
        ),
        // A coarse converter.
        (
            |frame, sigma, _| {
                frame
                    .iter_mut()
                    .for_each(|v| *v = (*v / (10.0 * sigma)).round() * 10.0 * sigma)
            },
            2.0,
        ),
    ];
    for (k, (noise, most_mm)) in kinds.into_iter().enumerate() {
        let mut rng = rng(113);
        let imager = imager(Drive::PAPER, 5.0).unwrap();
        let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.3, 0.2, &mut rng).unwrap();
        let at = [31.0, -18.0];
        let touched = sheet.clean_frame(&[finger(at[0], at[1])]).unwrap();
        let sigma = noise_v(&touched, &sheet.baseline, 27.0);
        let options = LiveOptions::default();
        let mut live = Live::new(imager, options);
        let (mut square, mut count): (f64, f64) = (0.0, 0.0);
        for frame in 0..options.baseline_frames + 120 {
            let down = frame >= options.baseline_frames + 60;
            let clean = if down { &touched } else { &sheet.baseline };
            let mut values = noisy(clean.clone(), sigma, &mut rng);
            noise(&mut values, sigma, &mut rng);
            let LiveFrame::Picture(result) = live.frame(frame as f64 / 115.0, &values).unwrap() else {
                continue;
            };
            assert!(result.doubt.is_none() && result.faults.is_empty(), "{k} {frame}");
            assert_eq!(
                result.touches.len(),
                usize::from(down),
                "{k} {frame}: {:?}",
                result.touches
            );
            for t in &result.touches {
                let off = [t.x_mm - at[0], t.y_mm - at[1]];
                assert!(off[0].hypot(off[1]) < most_mm, "{k} {frame}: {off:?} mm");
                for (off, sd) in off.iter().zip([t.x_sd_mm, t.y_sd_mm]) {
                    square += (off / sd.unwrap()).powi(2);
                    count += 1.0;
                }
            }
        }
        // Means of frames at rest are not independent of each other.
        assert!(square < 2.0 * count, "{k}: {}", square / count);
    }
}
