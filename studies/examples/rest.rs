//! Gain from averaging frames of a scene at rest. Table: docs/results.md, Scenes at rest.
//!
//! `cargo run --release -p studies --example rest -- [--scenes N] [--seed S]`
//!
//! Touches come between two frames and stay. Frames are simulated like those of `touch_accuracy`. The noise is that
//! of a board on which one touch of +20 % has 27 dB. The baseline is the mean of 24 frames with the same noise. The
//! table lists the results of the live reconstruction after several numbers of frames.

use forward::Drive;
use inverse::reference::noise::FrameNoise;
use inverse::touches::radius_filter::RadiusFilter;
use inverse::touches::tracker::{Tracker, TrackerOptions};
use studies::{Kind, Score, TestSheet, imager, live_reconstructor, noise_v, noisy, quantile, rng};

/// Numbers of frames after which the touches are scored.
const LOOKS: [usize; 6] = [1, 2, 4, 8, 16, 57];
const BASELINE_FRAMES: usize = 24;
const FRAME_S: f64 = 1.0 / 115.0;

fn main() -> anyhow::Result<()> {
    let given: Vec<String> = std::env::args().collect();
    let after = |name: &str| given.iter().position(|a| a == name).and_then(|k| given.get(k + 1));
    let number = |name: &str, default: u64| after(name).and_then(|v| v.parse().ok()).unwrap_or(default);
    let (scenes, seed) = (number("--scenes", 50), number("--seed", 1));
    println!("seed {seed}, {scenes} scenes of every kind");
    println!(
        "| scenes | frames | count right % | median mm | p95 mm | within 2 sd % | total, median / p95 off | \
         total within 2 sd % |\n|---|---|---|---|---|---|---|---|"
    );
    for (drive_name, drive) in [
        ("voltage", Drive::PAPER),
        ("current", Drive::Current { amplitude_a: 1e-3 }),
    ] {
        let imager = imager(drive, 5.0)?;
        for (name, kind, rise) in [
            ("one", Kind::Equal(1), 0.2),
            ("four", Kind::Equal(4), 0.2),
            ("four fingers", Kind::Fingers(4), 0.2),
            ("+100 %", Kind::Strong(1.0), 1.0),
            ("+300 %", Kind::Strong(3.0), 3.0),
        ] {
            let mut rng = rng(seed);
            let mut scores = vec![Score::default(); LOOKS.len()];
            for _ in 0..scenes {
                let mut sheet = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng)?;
                let scene = kind.scene(&mut rng, f64::INFINITY);
                let clean = sheet.frame(&scene, &mut rng)?;
                // The response of a disc of rise c is 2 c / (2 + c).
                let response = |c: f64| 2.0 * c / (2.0 + c);
                let sigma = noise_v(&clean, &sheet.baseline, 27.0) * response(0.2) / response(rise);
                let of_baseline = 1.0 / BASELINE_FRAMES as f64;
                let baseline = noisy(sheet.baseline.clone(), sigma * of_baseline.sqrt(), &mut rng);
                let noise = FrameNoise::Known {
                    sigma,
                    baseline_frames: Some(BASELINE_FRAMES),
                };
                let mut reconstructor = live_reconstructor(&sheet.fitted_imager(), &baseline, noise)?;
                let (mut tracker, mut radius_filter) =
                    (Tracker::new(TrackerOptions::new(20.0, 0.5)), RadiusFilter::default());
                let mut looks = LOOKS.iter().zip(&mut scores).peekable();
                for frame in 1.. {
                    let time_s = frame as f64 * FRAME_S;
                    let result = reconstructor.frame(&noisy(clean.clone(), sigma, &mut rng))?;
                    tracker.update(time_s, &mut result.touches, result.doubt.is_some());
                    if result.anew {
                        radius_filter.update(time_s, result.grown, &mut result.touches);
                    } else {
                        radius_filter.keep(time_s, &result.touches);
                    }
                    if let Some((_, score)) = looks.next_if(|(at, _)| **at == frame) {
                        score.add(&scene, &result.touches);
                    }
                    if looks.peek().is_none() {
                        break;
                    }
                }
            }
            for (frames, s) in LOOKS.iter().zip(&scores) {
                println!(
                    "| {drive_name} {name} | {frames} | {:.0} | {:.3} | {:.3} | {:.1} | {:.3} / {:.3} | {:.1} |",
                    100.0 * s.counted_part(),
                    s.error_mm(0.5),
                    s.error_mm(0.95),
                    100.0 * s.honest_part(),
                    quantile(&s.totals, 0.5),
                    quantile(&s.totals.iter().map(|t| (t - 1.0).abs()).collect::<Vec<_>>(), 0.95),
                    100.0 * s.honest_total_part(),
                );
            }
        }
    }
    Ok(())
}
