//! Errors of a single touch on sheets with misplaced electrodes, and the part of them that no baseline shows. Table:
//! docs/results.md, Misplaced electrodes.
//!
//! `cargo run --release -p studies --example mismatch -- [--sheets N] [--seed S]`
//!
//! N sheets (default 40) have electrodes displaced by 0.5 mm (standard deviation) and contacts changed by up to 30 %.
//! Each gets 25 frames of one disc of +20 % at 27 dB. A conformal map of the disc onto itself does not change the
//! voltages of point electrodes. The map moves electrodes along the rim by `a + b cos + c sin` of their angle, and
//! touches with them. Here the map of the fitted electrodes is known, and the table lists the errors of the touches
//! with and without it.

use anyhow::Result;
use forward::Drive;
use inverse::reference::electrode_fit;
use studies::conformal::{ConformalMap, angles};
use studies::{Kind, TestSheet, imager, quantile, reconstructor, rng};

const RIM_MM: f64 = 97.5;
const FRAMES: usize = 25;

fn main() -> Result<()> {
    let given: Vec<String> = std::env::args().collect();
    let after = |name: &str| given.iter().position(|a| a == name).and_then(|k| given.get(k + 1));
    let sheets: usize = after("--sheets").map_or(Ok(40), |s| s.parse())?;
    let seed: u64 = after("--seed").map_or(Ok(1), |s| s.parse())?;
    println!("seed {seed}, {sheets} sheets, {FRAMES} frames of each");
    println!("| drive | electrodes | touch, median / 95th percentile mm | electrodes along the rim, rms mm |");
    println!("|---|---|---|---|");
    for (name, drive) in [
        ("voltage", Drive::PAPER),
        ("current", Drive::Current { amplitude_a: 1e-3 }),
    ] {
        let imager = imager(drive, 5.0)?;
        let nominal = angles(imager.model.sheet());
        let mut errors: [Vec<f64>; 5] = Default::default();
        let mut rim: [Vec<f64>; 3] = Default::default();
        let mut rng = rng(seed);
        for _ in 0..sheets {
            let mut perfect = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng)?;
            let mut sheet = TestSheet::new(&imager, drive, 0.5, 0.3, &mut rng)?;
            let truth: Vec<f64> = angles(sheet.as_built())
                .iter()
                .zip(&nominal)
                .map(|(t, n)| RIM_MM * (t - n))
                .collect();
            let Some(found) = electrode_fit::find(&imager, &sheet.baseline) else {
                continue;
            };
            // From the true to the fitted places.
            let off: Vec<f64> = found.moved_mm.iter().zip(&truth).map(|(f, t)| f - t).collect();
            let (map, left) = ConformalMap::nearest(RIM_MM, &off, &nominal)?;
            rim[0].extend(&truth);
            rim[1].extend(&off);
            rim[2].extend(&left);
            let mut ways = [
                reconstructor(&imager, &perfect.baseline)?,
                reconstructor(&imager, &sheet.baseline)?,
                reconstructor(&found.imager, &sheet.baseline)?,
            ];
            for _ in 0..FRAMES {
                let scene = Kind::Equal(1).scene(&mut rng, 27.0);
                let at = scene.touches[0].centre_mm;
                let frames = [perfect.frame(&scene, &mut rng)?, sheet.frame(&scene, &mut rng)?];
                for (way, r) in ways.iter_mut().enumerate() {
                    let touches = &r.frame(&frames[way.min(1)])?.touches;
                    let Some(t) = touches.first() else { continue };
                    errors[way].push((t.x_mm - at[0]).hypot(t.y_mm - at[1]));
                    if way == 2 {
                        let [x, y] = map.move_mm(at);
                        errors[3].push((t.x_mm - at[0] - x).hypot(t.y_mm - at[1] - y));
                        errors[4].push(x.hypot(y));
                    }
                }
            }
        }
        let rms = |v: &[f64]| (v.iter().map(|v| v * v).sum::<f64>() / v.len().max(1) as f64).sqrt();
        let ways = [
            ("where they are said to be, and are", 0.0),
            ("off, and trusted", rms(&rim[0])),
            ("off, and found", rms(&rim[1])),
            ("the same, without the conformal map", rms(&rim[2])),
            (
                "the conformal map alone",
                (rms(&rim[1]).powi(2) - rms(&rim[2]).powi(2)).sqrt(),
            ),
        ];
        for ((way, rim), errors) in ways.into_iter().zip(&errors) {
            let [half, most] = [0.5, 0.95].map(|q| quantile(errors, q));
            println!("| {name} | {way} | {half:.3} / {most:.3} | {rim:.3} |");
        }
    }
    Ok(())
}
