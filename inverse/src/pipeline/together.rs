//! Frames that no discs explain, located once more: all of them together tell how far each measurement follows the model.

use crate::pipeline::frame_solver::unexplained::INDEPENDENT;
use crate::pipeline::options::ReconstructorOptions;
use crate::pipeline::result::FrameResult;
use crate::quality::doubt::Doubt;
use crate::reference::Reference;
use crate::stats::median;
use crate::touches::fit::disc::Disc;
use crate::touches::fit::frame_fit::touch_of;
use crate::touches::fit::responses::ResponseTable;
use crate::touches::fit::trust::{FEWEST, MOST, Trust};
use crate::touches::polarity::Polarity;
use crate::touches::touch::Touch;

/// Strengths below this part of the usual one are none: what a press leaves behind is as large.
const LEAST_STRENGTH: f64 = 0.1;
/// Odds from which evidence for a touch is strong (Jeffreys 1961), in a frame that by itself shows nothing.
const STRONG: f64 = 10.0;

/// Gives frames (the baseline's unit) that no discs explain, or that show nothing by themselves, the touch that they have by what all of
/// them tell. Those with several touches stay as they are, and those of which something else is known; and so do all where that
/// tells nothing. Gives the number of frames that have other touches now. Their pictures stay those of each frame by itself.
pub(crate) fn locate_together(
    reference: &Reference,
    options: &ReconstructorOptions,
    frames: &[&[f64]],
    results: &mut [FrameResult],
) -> usize {
    located(reference, options, frames, results).unwrap_or(0)
}

/// Whether nothing is known of a frame but what all values say.
fn is_plain(result: &FrameResult) -> bool {
    matches!(result.doubt, None | Some(Doubt::NotTouches))
        && result.faults.is_empty()
        && result.contacts.is_empty()
        && result.used > 0
}

fn located(
    reference: &Reference,
    options: &ReconstructorOptions,
    frames: &[&[f64]],
    results: &mut [FrameResult],
) -> Option<usize> {
    let fit = options.fit?;
    let imager = reference.imager();
    let asked = || {
        let all = frames.iter().zip(results.iter());
        all.filter(|(_, r)| r.explained.is_some() && is_plain(r))
    };
    let count = asked().count();
    (count >= FEWEST && 2 * count > results.len()).then_some(())?;
    let change = |frame: &[f64], rejected: &[usize]| -> Option<Vec<f64>> {
        let mut change = reference.difference(frame).ok()?.y.as_slice().to_vec();
        rejected.iter().for_each(|k| change[*k] = 0.0);
        Some(change)
    };
    let changes: Vec<Vec<f64>> = asked()
        .step_by(count.div_ceil(MOST))
        .map(|(frame, r)| change(frame, &r.rejected))
        .collect::<Option<_>>()?;
    let changes: Vec<&[f64]> = changes.iter().map(Vec::as_slice).collect();
    let polarity = options.polarity.unwrap_or(Polarity::Either);
    let independent = INDEPENDENT * imager.model.electrodes() as f64;
    let table = ResponseTable::new(&imager.model, imager.drive, &imager.pattern, fit.radius_mm)?;
    let told = (polarity, independent);
    let trust = Trust::of_frames(&table, imager.pattern.measurements(), &changes, told)?;
    let mut response: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
    let mut found: Vec<Option<(Touch, f64, f64)>> = Vec::with_capacity(results.len());
    for (frame, result) in frames.iter().zip(results.iter()) {
        let change = is_plain(result).then(|| change(frame, &result.rejected)).flatten();
        let placed = change.and_then(|change| Some((trust.place(&change, told)?, change)));
        found.push(placed.map(|(placed, change)| {
            let at = response.each_mut().map(Vec::as_mut_slice);
            table.at(placed.place_mm, fit.radius_mm, at);
            let response = &response[0][..table.length()];
            let disc = Disc {
                at: placed.place_mm,
                radius: fit.radius_mm,
                strength: trust.strength(&change, response),
            };
            let touch = touch_of(&disc.believable(), 1.0, |i, k| {
                (i == k && i < 2).then(|| placed.variances_mm2[i])
            });
            (touch, placed.evidence, part(&change, response))
        }));
    }
    let strength = |f: &Option<(Touch, f64, f64)>| f.as_ref().map(|(t, ..)| t.total_mm2.abs());
    let usual = median(
        (found.iter().zip(results.iter()))
            .filter(|(_, r)| r.explained.is_some())
            .filter_map(|(f, _)| strength(f)),
    );
    let outline = imager.model.geometry().outline();
    let mut changed = 0;
    for (found, result) in found.into_iter().zip(results) {
        let Some((touch, evidence, part)) = found else { continue };
        let hidden = !result.changed;
        let may = (hidden && evidence > STRONG.ln()) || (result.explained.is_some() && result.touches.len() < 2);
        let sd_mm = touch.x_sd_mm.unwrap_or(0.0).max(touch.y_sd_mm.unwrap_or(0.0));
        let placed = sd_mm <= options.unplaced_mm.max(outline.nearest([touch.x_mm, touch.y_mm]).1);
        if may && placed && touch.total_mm2.abs() > LEAST_STRENGTH * usual {
            if hidden {
                (result.changed, result.residual) = (true, (1.0 - part).max(0.0).sqrt());
            }
            result.touches = vec![touch];
            result.explained = Some(part);
            result.doubt.get_or_insert(Doubt::NotTouches);
            changed += 1;
        }
    }
    Some(changed)
}

/// Part of a change that a touch with this response takes.
fn part(change: &[f64], response: &[f64]) -> f64 {
    let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let squares = sum(change, change) * sum(response, response);
    if squares > 0.0 {
        sum(change, response).powi(2) / squares
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{Batch, BatchOptions};
    use crate::reference::diagnosis::Fault;
    use crate::reference::imager::Imager;
    use crate::solvers::Method;
    use forward::{Drive, Pattern, Sheet};
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    const FRAMES: usize = 40;

    /// Of a sheet whose measurements follow the model in part. Frames of which something else is known stay as they are, and few tell
    /// nothing.
    #[test]
    fn frames_are_located_together_but_for_those_of_which_more_is_known() {
        let imager = Imager::new(&Sheet::paper(), Drive::PAPER, Pattern::adjacent(16).unwrap(), 8.0).unwrap();
        let table = ResponseTable::new(&imager.model, imager.drive, &imager.pattern, 12.5).unwrap();
        let baseline: Vec<f64> = imager.model_v.to_vec();
        let mut rng = StdRng::seed_from_u64(1);
        let mut at: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
        let (places, frames): (Vec<[f64; 2]>, Vec<Vec<f64>>) = (0..FRAMES)
            .map(|_| {
                let (angle, radius) = (
                    rng.random_range(0.0..std::f64::consts::TAU),
                    70.0 * rng.random_range(0.0..1.0_f64).sqrt(),
                );
                let place = [radius * angle.cos(), radius * angle.sin()];
                table.at(place, 12.5, at.each_mut().map(Vec::as_mut_slice));
                let size = (at[0].iter().map(|v| v * v).sum::<f64>() / baseline.len() as f64).sqrt();
                let value = |(k, (v, response)): (usize, (&f64, &f64))| {
                    let error = size * rng.sample::<f64, _>(StandardNormal);
                    v + 0.3 * if k * 7 % 10 < 4 { error } else { response + 0.2 * error }
                };
                (place, baseline.iter().zip(&at[0]).enumerate().map(value).collect())
            })
            .unzip();
        let frames: Vec<&[f64]> = frames.iter().map(Vec::as_slice).collect();
        let mut batch = Batch::new(imager.into(), &[&baseline], BatchOptions::of(Method::Nnls)).unwrap();
        let alone: Vec<FrameResult> = (0..FRAMES).map(|k| batch.frame(k, frames[k]).unwrap()).collect();
        let mut results = alone.clone();
        let touch = results.iter().find_map(|r| r.touches.first()).copied().unwrap();
        results[0].faults = vec![Fault::Source];
        results[1].touches = vec![touch, touch];
        results[2].doubt = Some(Doubt::NotThisSheet);
        let known: Vec<FrameResult> = results[..3].to_vec();
        let located = batch.together(&frames, &mut results);
        assert!(located > FRAMES / 2, "{located}");
        for (before, after) in known.iter().zip(&results) {
            assert_eq!((&before.touches, before.explained), (&after.touches, after.explained));
        }
        let off = |results: &[FrameResult]| {
            median(results.iter().zip(&places).skip(3).map(|(r, [x, y])| {
                let off = |t: &Touch| (t.x_mm - x).hypot(t.y_mm - y);
                r.touches.first().map_or(f64::INFINITY, off)
            }))
        };
        assert!(off(&results) < 0.7 * off(&alone), "{} {}", off(&results), off(&alone));
        let doubted = results.iter().filter(|r| r.doubt == Some(Doubt::NotTouches)).count();
        assert!(doubted >= located, "{doubted} of {located}");
        let mut few = alone[..FEWEST - 1].to_vec();
        assert_eq!(batch.together(&frames[..FEWEST - 1], &mut few), 0);
    }
}
