//! Runs scenes on a test sheet: simulates, reconstructs, scores.

use crate::error::StudyError;
use crate::scene::{Kind, Scene};
use crate::score::Score;
use crate::test_sheet::TestSheet;
use inverse::pipeline::{FrameResult, Reconstructor};
use rand::rngs::StdRng;
use std::time::Instant;

/// Runs scenes of a kind on a test sheet.
///
/// # Errors
/// See [`run`].
pub fn score(
    sheet: &mut TestSheet,
    r: &mut Reconstructor,
    kind: Kind,
    snr_db: f64,
    scenes: usize,
    rng: &mut StdRng,
) -> Result<Score, StudyError> {
    let mut score = Score::default();
    run(sheet, r, kind, snr_db, scenes, rng, &mut score)?;
    Ok(score)
}

/// Runs scenes of a kind on a test sheet and adds them to a score.
///
/// # Errors
/// [`StudyError`] where the model has no solution or the reconstructor is not of this sheet.
pub fn run(
    sheet: &mut TestSheet,
    r: &mut Reconstructor,
    kind: Kind,
    snr_db: f64,
    scenes: usize,
    rng: &mut StdRng,
    score: &mut Score,
) -> Result<(), StudyError> {
    for _ in 0..scenes {
        let scene = kind.scene(rng, snr_db);
        let frame = sheet.frame(&scene, rng)?;
        let start = Instant::now();
        let found = r.frame(&frame)?;
        score.times_us.push(start.elapsed().as_secs_f64() * 1e6);
        let before = score.counted;
        score.add(&scene, &found.touches);
        score.unfitted += usize::from(found.misfit.is_none());
        if score.counted == before {
            log(&scene, found);
        }
    }
    Ok(())
}

/// Logs a scene with the wrong count, at level debug.
fn log(scene: &Scene, found: &FrameResult) {
    let is: Vec<String> = scene
        .touches
        .iter()
        .map(|t| {
            let [x, y] = t.centre_mm;
            format!("{x:.1} {y:.1} r {:.1} rise {:.2}", t.radius_mm, t.rise)
        })
        .collect();
    let was: Vec<String> = found
        .touches
        .iter()
        .map(|t| {
            let r = (t.area_mm2 / std::f64::consts::PI).sqrt();
            format!(
                "{:.1} {:.1} r {r:.1} rise {:.2} sd {:?}",
                t.x_mm, t.y_mm, t.rise, t.x_sd_mm
            )
        })
        .collect();
    tracing::debug!(?is, ?was, used = found.used, misfit = ?found.misfit, residual = found.residual, "wrong count");
}
