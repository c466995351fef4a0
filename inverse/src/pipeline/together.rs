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
use crate::touches::fit::trust::Trust;
use crate::touches::polarity::Polarity;
use crate::touches::touch::Touch;

/// Strengths below this part of the usual one are none: what a press leaves behind is as large.
const LEAST_STRENGTH: f64 = 0.1;
/// Odds from which evidence for a touch is strong (Jeffreys 1961), in a frame that by itself shows nothing.
const STRONG: f64 = 10.0;

/// Gives frames (the baseline's unit) that no discs explain, or that show nothing by themselves, the touch that they have by what all of
/// them tell. Those with several touches stay as they are, and so do all where that tells nothing.
pub(crate) fn locate_together(
    reference: &Reference,
    options: &ReconstructorOptions,
    frames: &[&[f64]],
    results: &mut [FrameResult],
) -> Option<()> {
    let fit = options.fit?;
    let imager = reference.imager();
    let unexplained = results.iter().filter(|r| r.explained.is_some()).count();
    (2 * unexplained > results.len()).then_some(())?;
    let changes: Vec<Vec<f64>> = (frames.iter())
        .map(|f| Some(reference.difference(f).ok()?.y.as_slice().to_vec()))
        .collect::<Option<_>>()?;
    let asked: Vec<&[f64]> = (changes.iter().zip(results.iter()))
        .filter(|(_, r)| r.explained.is_some())
        .map(|(c, _)| c.as_slice())
        .collect();
    let polarity = options.polarity.unwrap_or(Polarity::Either);
    let independent = INDEPENDENT * imager.model.electrodes() as f64;
    let table = ResponseTable::new(&imager.model, imager.drive, &imager.pattern, fit.radius_mm)?;
    let told = (polarity, independent);
    let trust = Trust::of_frames(&table, imager.pattern.measurements(), &asked, told)?;
    let mut response: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
    let mut found: Vec<Option<(Touch, f64, f64)>> = Vec::with_capacity(results.len());
    for change in &changes {
        let placed = trust.place(change, told);
        found.push(placed.map(|placed| {
            table.at(
                placed.place_mm,
                fit.radius_mm,
                response.each_mut().map(Vec::as_mut_slice),
            );
            let response = &response[0][..table.length()];
            let disc = Disc {
                at: placed.place_mm,
                radius: fit.radius_mm,
                strength: trust.strength(change, response),
            };
            let touch = touch_of(&disc.believable(), 1.0, |i, k| {
                (i == k && i < 2).then(|| placed.variances_mm2[i])
            });
            (touch, placed.evidence, part(change, response))
        }));
    }
    let strength = |f: &Option<(Touch, f64, f64)>| f.as_ref().map(|(t, ..)| t.total_mm2.abs());
    let usual = median(
        (found.iter().zip(results.iter()))
            .filter(|(_, r)| r.explained.is_some())
            .filter_map(|(f, _)| strength(f)),
    );
    let outline = imager.model.geometry().outline();
    for (found, result) in found.into_iter().zip(results) {
        let Some((touch, evidence, part)) = found else { continue };
        let hidden = !result.changed;
        let may = (hidden && evidence > STRONG.ln()) || (result.explained.is_some() && result.touches.len() < 2);
        let sd_mm = touch.x_sd_mm.unwrap_or(0.0).max(touch.y_sd_mm.unwrap_or(0.0));
        let placed = sd_mm <= options.unplaced_mm.max(outline.nearest([touch.x_mm, touch.y_mm]).1);
        if may && placed && touch.total_mm2.abs() > LEAST_STRENGTH * usual {
            result.touches = vec![touch];
            result.explained = Some(part);
            result.changed = true;
            result.doubt.get_or_insert(Doubt::NotTouches);
        }
    }
    Some(())
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
