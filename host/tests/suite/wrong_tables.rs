//! Tables whose frames are not what they are taken for: nothing is shown of them as if it were a touch.

use crate::tables::{Folder, TOUCH, forward, places, reconstruct, refused, table, values};
use serde_json::Value;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

/// Noise of 5 uV, the same in every run: the sum of twelve even numbers, as good as Gaussian.
fn noisy(values: &[f64], frame: usize) -> Vec<f64> {
    let even = |k: usize, j: usize| {
        let mut hash = DefaultHasher::new();
        (k, frame, j).hash(&mut hash);
        hash.finish() as f64 / u64::MAX as f64 - 0.5
    };
    let noise = |k: usize| 5e-6 * (0..12).map(|j| even(k, j)).sum::<f64>();
    values.iter().enumerate().map(|(k, v)| v + noise(k)).collect()
}

fn scaled(values: &[f64], by: f64) -> Vec<f64> {
    values.iter().map(|v| by * v).collect()
}

/// What is said of these frames after a baseline of these, all with their names.
fn said_of(baseline: &[Vec<f64>], frames: &[(&'static str, Vec<f64>)]) -> Vec<Value> {
    let folder = Folder::new();
    let names = ["b1", "b2", "b3", "b4", "b5", "b6", "b7", "b8"];
    let mut all: Vec<(&str, Vec<f64>)> = names.into_iter().zip(baseline.iter().cloned()).collect();
    all.extend_from_slice(frames);
    let file = folder.file("t.csv", table(&forward(&[]), &all));
    let named = format!("b1-b{}", baseline.len());
    reconstruct(&file, &["--baseline", &named]).0
}

fn eight(sheet: &[f64]) -> Vec<Vec<f64>> {
    (0..8).map(|j| noisy(sheet, j)).collect()
}

fn is_finger(line: &Value) -> bool {
    let found = places(line);
    found.len() == 1 && (found[0][0] - 30.0).hypot(found[0][1] - 20.0) < 1.0 && line["doubt"].is_null()
}

/// Of two and three columns, too, whichever of them is pressed; a source that drifts presses nothing.
#[test]
fn a_column_of_a_small_baseline_that_is_pressed_is_said() {
    let (sheet, touched) = (values(&forward(&[])), values(&forward(&TOUCH)));
    let light = values(&forward(&["--touch", "-40,10,9,0.1"]));
    let frames = || [("pressed", noisy(&touched, 8)), ("empty", noisy(&sheet, 9))];
    for count in [2, 3] {
        let drifts: Vec<Vec<f64>> = (0..count)
            .map(|j| noisy(&scaled(&sheet, 1.0 + 0.003 * j as f64), j))
            .collect();
        let lines = said_of(&drifts, &frames());
        assert!(is_finger(&lines[0]), "{count}: {}", lines[0]);
        assert!(places(&lines[1]).is_empty() && lines[1]["doubt"].is_null());
        for pressed in 0..count {
            let mut baseline = drifts.clone();
            baseline[pressed] = noisy(&light, pressed);
            for line in said_of(&baseline, &frames()) {
                let doubt = line["doubt"].as_str().unwrap_or_default();
                assert!(doubt.starts_with("the sheet moved"), "{pressed} of {count}: {line}");
                assert_eq!(line["left_out"][0]["kind"], "moved");
            }
        }
    }
}

#[test]
fn columns_of_a_baseline_that_have_nothing_in_common_are_refused() {
    let folder = Folder::new();
    let (rows, touched) = (forward(&[]), values(&forward(&TOUCH)));
    let sheet = values(&rows);
    for (gains, said) in [
        (&[1.0, -1.0][..], "b is -1.000 times a"),
        (&[1.0, 1000.0], "b is 1000.0"),
        (&[1.0, 1.0, -1.0], "c is -1.000 times a"),
        (&[1.0, 1.0, 1e3, 1e3], "d is 1000.0"),
    ] {
        let columns = ["a", "b", "c", "d"].into_iter().zip(gains).enumerate();
        let mut frames: Vec<(&str, Vec<f64>)> = columns
            .map(|(j, (name, gain))| (name, scaled(&noisy(&sheet, j), *gain)))
            .collect();
        let named: Vec<&str> = frames.iter().map(|(name, _)| *name).collect();
        let named = named.join(",");
        frames.push(("t", touched.clone()));
        let refused = refused(&folder.file("t.csv", table(&rows, &frames)), &["--baseline", &named]);
        assert!(
            refused.contains(said) && refused.contains("name columns that are alike"),
            "{refused}"
        );
    }
}

#[test]
fn ratios_are_no_changes() {
    let folder = Folder::new();
    let (rows, touched) = (forward(&[]), values(&forward(&TOUCH)));
    let ratio = |of: &[f64]| of.iter().zip(&rows).map(|(v, (_, u))| v / u).collect::<Vec<f64>>();
    let frames = [("a", ratio(&touched)), ("e", ratio(&noisy(&values(&rows), 1)))];
    let said = refused(&folder.file("r.csv", table(&rows, &frames)), &["--difference"]);
    assert!(
        said.contains("near 1 throughout") && said.contains("subtract 1"),
        "{said}"
    );
}

/// At any rail below the baseline's largest value.
#[test]
fn a_frame_that_was_clipped_shows_what_its_other_values_do() {
    let (sheet, touched) = (values(&forward(&[])), values(&forward(&TOUCH)));
    for rail in [0.1, 0.08, 0.045] {
        let clipped = |of: &[f64], frame: usize| noisy(of, frame).iter().map(|v| v.min(rail)).collect::<Vec<f64>>();
        let frames = [("pressed", clipped(&touched, 8)), ("empty", clipped(&sheet, 9))];
        let lines = said_of(&eight(&sheet), &frames);
        assert!(is_finger(&lines[0]), "{rail}: {}", lines[0]);
        assert!(places(&lines[1]).is_empty(), "{rail}: {}", lines[1]);
        let notes = lines[0]["notes"].to_string();
        assert!(notes.contains(&format!("values are {rail}")), "{notes}");
    }
}

/// What a source has left is divided out, whatever the frame before; with less than a fifth nothing is shown without a doubt.
#[test]
fn each_frame_has_the_gain_that_it_has_alone() {
    let (sheet, touched) = (values(&forward(&[])), values(&forward(&TOUCH)));
    let gains = [("a", 0.5), ("b", 0.3), ("c", 1.0), ("d", 0.22), ("e", 0.4)];
    let of = |(j, (name, gain)): (usize, &(&'static str, f64))| (*name, noisy(&scaled(&touched, *gain), 8 + j));
    let mut frames: Vec<(&str, Vec<f64>)> = gains.iter().enumerate().map(of).collect();
    frames.push(("lost", noisy(&scaled(&touched, 0.1), 20)));
    // Clipped before the noise: no two values are the same.
    let soft: Vec<f64> = sheet.iter().map(|v| v.min(0.045)).collect();
    frames.push(("soft", noisy(&soft, 21)));
    let lines = said_of(&eight(&sheet), &frames);
    for ((_, gain), line) in gains.iter().zip(&lines) {
        let found = line["drift"]["gain"].as_f64().unwrap_or(1.0);
        assert!(is_finger(line) && (found / gain - 1.0).abs() < 0.01, "{gain}: {line}");
    }
    for line in &lines[gains.len()..] {
        assert!(line["doubt"].is_string(), "{line}");
    }
    assert!(places(&lines[gains.len()]).is_empty());
}

/// A band along the rim is neither an unevenness nor an offset that drifted: it is doubted, or shown as what it is but for a gain, a disc within
/// the band that is lower than the rest.
#[test]
fn a_band_along_the_rim_is_no_drift() {
    let sheet = values(&forward(&[]));
    let band = |name, of: [&str; 2], j| (name, noisy(&values(&forward(&["--touch", of[0], "--touch", of[1]])), j));
    let frames = [
        band("strong", ["0,0,97.4,0.3", "0,0,80,-0.3"], 8),
        band("weak", ["0,0,97.4,0.2", "0,0,75,-0.2"], 9),
    ];
    for (line, within_mm) in said_of(&eight(&sheet), &frames).iter().zip([80.0_f64, 75.0]) {
        let disc = std::f64::consts::PI * within_mm.powi(2);
        let touches = line["touches"].as_array().unwrap();
        let of = |key: &str| touches[0][key].as_f64().unwrap();
        let is_disc = touches.len() == 1 && of("rise") < 0.0 && (of("area_mm2") / disc - 1.0).abs() < 0.15;
        assert!(line["doubt"].is_string() || is_disc, "{line}");
    }
}
