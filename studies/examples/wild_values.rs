//! Frames with values that have nothing to do with the sheet. Table: docs/reliability.md, Wild values.
//!
//! `cargo run --release -p studies --example wild_values -- [--scenes N] [--seed S] [--db D] [--opposite] [--known]`
//! With --opposite the drives are opposite electrodes: a pattern without reciprocal pairs.
//!
//! Single frames with two touches of +20 %, and empty frames with the same noise. In every frame other values are wild. The noise is
//! estimated from every frame; with --known it is known, as from a recording of the unpressed sheet.

use forward::{Drive, Pattern, Sheet};
use inverse::pipeline::{Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::imager::Imager;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use rand::Rng;
use rand::rngs::StdRng;
use std::fmt::Display;
use std::sync::Arc;
use studies::{Kind, MISSED_MM, Score, StudyError, TestSheet, imager, noise_v, noisy, rng};

/// What becomes of a value, with the noise.
type Spoil = fn(f64, f64) -> f64;

fn row(
    name: impl Display,
    count: usize,
    spoil: Spoil,
    (scenes, seed, db, known): (usize, u64, f64, bool),
    imager: &Arc<Imager>,
) -> Result<(), StudyError> {
    let drive = Drive::PAPER;
    let mut rng = rng(seed);
    let mut sheet = TestSheet::new(imager, drive, 0.0, 0.0, &mut rng)?;
    let mut reconstructor = sheet.reconstructor()?;
    let wild = |mut frame: Vec<f64>, sigma: f64, rng: &mut StdRng| {
        for place in rand::seq::index::sample(rng, frame.len(), count) {
            let sign = if rng.random() { 1.0 } else { -1.0 };
            frame[place] = spoil(frame[place], sign * sigma);
        }
        frame
    };
    let (mut score, mut silent, mut doubted, mut phantoms) = (Score::default(), 0, 0, 0);
    for _ in 0..scenes {
        let scene = Kind::Equal(2).scene(&mut rng, db);
        let clean = sheet.clean_frame(&scene.touches)?;
        let sigma = noise_v(&clean, &sheet.baseline, db);
        if known {
            let reference = Reference::new(Arc::clone(imager), sheet.baseline.clone(), FrameNoise::of_frames(sigma))?;
            reconstructor = Reconstructor::new(reference, ReconstructorOptions::for_imager(imager, Method::Nnls));
        }
        let frame = wild(noisy(clean, sigma, &mut rng), sigma, &mut rng);
        let found = reconstructor.frame(&frame)?;
        doubted += usize::from(found.doubt.is_some());
        silent += usize::from(found.doubt.is_none() && found.touches.len() != scene.touches.len());
        score.add(&scene, &found.touches);
        let frame = wild(noisy(sheet.baseline.clone(), sigma, &mut rng), sigma, &mut rng);
        let found = reconstructor.frame(&frame)?;
        phantoms += usize::from(!found.touches.is_empty() && found.doubt.is_none());
    }
    println!(
        "| {name} | {count} | {:.0} % | {:.2} / {:.2} | {silent} | {doubted} | {phantoms} |",
        100.0 * score.counted_part(),
        score.error_mm(0.5).min(MISSED_MM),
        score.error_mm(0.95).min(MISSED_MM),
    );
    Ok(())
}

fn main() -> anyhow::Result<()> {
    let given: Vec<String> = std::env::args().collect();
    let after = |name: &str| given.iter().position(|a| a == name).and_then(|k| given.get(k + 1));
    let number = |name: &str, default: f64| after(name).and_then(|v| v.parse().ok()).unwrap_or(default);
    let (scenes, seed, db) = (
        number("--scenes", 100.0) as usize,
        number("--seed", 4.0) as u64,
        number("--db", 35.0),
    );
    let imager = if given.iter().any(|a| a == "--opposite") {
        let pattern = Pattern::rotating(16, 8, 1)?;
        Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 5.0)?)
    } else {
        imager(Drive::PAPER, 5.0)?
    };
    println!("seed {seed}, {scenes} frames with two touches and as many without, {db} dB");
    println!(
        "| wild values | how many | count right | position mm, median / 95 % | wrong and silent | doubted | empty frames with touches, silent |\n\
         |---|---|---|---|---|---|---|"
    );
    let known = given.iter().any(|a| a == "--known");
    row("none", 0, |v, _| v, (scenes, seed, db, known), &imager)?;
    let kinds: [(&str, Spoil); 6] = [
        ("ten times", |v, _| 10.0 * v),
        ("half as much again", |v, _| 1.5 * v),
        ("the other sign", |v, _| -v),
        ("20 times the noise off", |v, noise| v + 20.0 * noise),
        ("10 times the noise off", |v, noise| v + 10.0 * noise),
        ("6 times the noise off", |v, noise| v + 6.0 * noise),
    ];
    for (name, spoil) in kinds {
        for count in [1, 3, 5, 10, 20] {
            row(name, count, spoil, (scenes, seed, db, known), &imager)?;
        }
    }
    Ok(())
}
