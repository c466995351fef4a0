//! What a person is told on stderr of frames of a table.

use crate::drive::DriveKind;
use crate::files::measurements::MeasurementTable;
use crate::number;
use ::forward::Measurement;
use inverse::batch::BatchOptions;
use inverse::pipeline::FrameResult;
use inverse::reference::noise::NoiseSource;
use inverse::reference::rounding;
use inverse::solvers::{Method, Status};

/// What a finger of +20 % in the middle changes the voltages by, root mean squares, and the part of the voltages from which rounding them
/// by a tenth of that is told.
const LIGHT_CHANGE: f64 = 2e-3;
const MOST_ROUNDED: f64 = 0.1 * LIGHT_CHANGE;

/// Of so many values the places are told.
const MOST_TOLD: usize = 4;

/// What speaks against a frame's result, and what is left out of it.
pub(crate) fn of_frame(frame: &str, result: &FrameResult, measurements: &[Measurement]) {
    if let Some(doubt) = result.doubt {
        eprintln!("warning: frame {frame}: {doubt}");
    } else if let Some(notice) = result.notice() {
        eprintln!("notice: frame {frame}: {notice}");
    }
    let doubted = result.doubt.map(|doubt| doubt.to_string());
    let faults = result.faults.iter().map(ToString::to_string);
    for fault in faults.filter(|fault| doubted.as_ref() != Some(fault)) {
        eprintln!("warning: frame {frame}: {fault}");
    }
    if let Some(rejected) = rejected(&result.rejected, measurements) {
        eprintln!("notice: frame {frame}: {rejected}");
    }
    match result.status {
        Status::Converged => {}
        Status::Stopped => eprintln!(
            "warning: frame {frame}: the solver stopped at a relative gap of {:.1e}",
            result.gap
        ),
        Status::BadInput => {
            eprintln!("warning: frame {frame}: its values are too large to compute with; look at its unit");
        }
    }
}

/// Which values of a frame have nothing to do with the others; none where all have.
pub(crate) fn rejected(places: &[usize], measurements: &[Measurement]) -> Option<String> {
    let told = places.iter().filter_map(|k| measurements.get(*k)).take(MOST_TOLD);
    let told: Vec<String> = told
        .map(|m| {
            let [a, b, c, d] = [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus].map(|e| e + 1);
            format!("drive {a}-{b}, sense {c}-{d}")
        })
        .collect();
    let more = match places.len() - told.len() {
        0 => String::new(),
        more => format!("; and {more} more"),
    };
    let have = match places.len() {
        0 => return None,
        1 => "1 value has nothing to do with the others and is".to_owned(),
        count => format!("{count} values have nothing to do with the others and are"),
    };
    Some(format!("{have} left out ({}{more})", told.join("; ")))
}

/// What is wrong with the drive, where a table's header says another one.
pub(crate) fn of_drive(table: &MeasurementTable, used: DriveKind) -> Option<String> {
    let said = table.drive.filter(|said| *said != used)?;
    let [said, used] = [said, used].map(DriveKind::name);
    let note = format!("its header says that a {said} drives the sheet, and --drive {used} is used");
    eprintln!("warning: {}: {note}", table.file);
    Some(note)
}

/// That values are rounded so much that weak touches are lost, where they are.
pub(crate) fn of_rounding(table: &MeasurementTable) -> Option<String> {
    let part = |values: &[f64]| {
        let rounding = number::root_mean_square(&rounding(values)?);
        Some(rounding / number::root_mean_square(values).max(f64::MIN_POSITIVE))
    };
    let parts: Option<Vec<f64>> = table.columns.iter().map(|c| part(&c.values)).collect();
    let usual = number::median(parts?.into_iter());
    (usual > MOST_ROUNDED).then(|| {
        let note = format!(
            "its values are rounded by {:.2} % of their root mean square, and a finger in the middle changes them by {:.1} %: weak touches \
             are lost or misplaced. Write them with more digits, or measure with a larger gain",
            100.0 * usual,
            100.0 * LIGHT_CHANGE
        );
        eprintln!("warning: {}: {note}", table.file);
        note
    })
}

/// What all frames have in common.
pub(crate) fn of_all<'a>(results: impl Iterator<Item = &'a FrameResult> + Clone, method: Method) {
    let by_residual =
        |result: &FrameResult| matches!(result.noise.map(|n| n.source), Some(NoiseSource::Residual { .. }));
    if results.clone().any(by_residual) {
        eprintln!(
            "notice: few or no pairs of this pattern are reciprocal, so that the noise is estimated from the part of a frame that touches \
             hardly reach. {} or more frames of the unpressed sheet (--baseline) measure it, and make weak touches surer",
            BatchOptions::of(method).noise_frames
        );
    }
    let explained: Vec<f64> = results.clone().filter_map(|result| result.explained).collect();
    if !explained.is_empty() {
        eprintln!(
            "notice: in {} of {} frames the touches of the model explain {:.0} % of the change (median): the sheet is not as the model \
             takes it to be. Presses at known places teach it: skin calibrate presses (docs/real-skins.md)",
            explained.len(),
            results.count(),
            100.0 * number::median(explained.into_iter())
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::forward::Pattern;

    #[test]
    fn a_few_values_that_are_left_out_are_named() {
        let pattern = Pattern::adjacent(16).unwrap();
        let said = |places: &[usize]| rejected(places, pattern.measurements());
        assert_eq!(said(&[]), None);
        let one = said(&[0]).unwrap();
        assert!(
            one.starts_with("1 value has") && one.ends_with("(drive 1-2, sense 3-4)"),
            "{one}"
        );
        let many = said(&[0, 1, 2, 3, 4, 5]).unwrap();
        assert!(
            many.starts_with("6 values have") && many.ends_with("; and 2 more)"),
            "{many}"
        );
    }
}
