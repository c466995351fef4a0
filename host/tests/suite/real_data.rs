//! The command line on frames of real tomographs: what is in the tank must be what is found.

use serde_json::Value;
use std::process::Command;

fn data(name: &str) -> String {
    // An absolute path stays what it is.
    std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../tests/data")
        .join(name)
        .display()
        .to_string()
}

/// The JSON lines of `skin reconstruct`, by frame.
fn reconstruct(file: &str, arguments: &[&str]) -> Vec<(String, Value)> {
    let output = Command::new(env!("CARGO_BIN_EXE_skin"))
        .arg("reconstruct")
        .arg(data(file))
        .arg("--json")
        .args(arguments)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout)
        .unwrap()
        .lines()
        .map(|line| {
            let value: Value = serde_json::from_str(line).unwrap();
            (value["frame"].as_str().unwrap().to_owned(), value)
        })
        .collect()
}

/// Polar coordinates (mm, degrees) of a frame's touches, strongest first.
fn touches(lines: &[(String, Value)], frame: &str) -> Vec<[f64; 2]> {
    let (_, value) = lines.iter().find(|(name, _)| name == frame).unwrap();
    let list = value["touches"].as_array().unwrap();
    let rises: Vec<f64> = list.iter().map(|t| t["rise"].as_f64().unwrap()).collect();
    assert!(rises.windows(2).all(|w| w[0] >= w[1]), "{frame}: {rises:?}");
    list.iter()
        .map(|t| {
            let (x, y) = (t["x_mm"].as_f64().unwrap(), t["y_mm"].as_f64().unwrap());
            [x.hypot(y), y.atan2(x).to_degrees()]
        })
        .collect()
}

/// Angle between two directions, 0 to 180 degrees.
fn apart(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(360.0);
    d.min(360.0 - d)
}

fn lct2004() -> Vec<(String, Value)> {
    reconstruct(
        "lct2004_voltage.csv",
        &[
            "--baseline",
            "water_1,water_2,water_3",
            "--clockwise",
            "--first-electrode-deg",
            "90",
        ],
    )
}

/// Touches of one set of the small tank, each against its own reference.
fn small_tank(set: &str) -> Vec<[f64; 2]> {
    let baseline = format!("{set}_ref");
    let lines = reconstruct(
        "pyeidors2026_tank.csv",
        &["--baseline", &baseline, "--drive", "current", "--diameter-mm", "60"],
    );
    touches(&lines, &format!("{set}_obj"))
}

#[test]
fn plastic_rods_are_found_at_their_angles() {
    let lines = lct2004();
    assert_eq!(touches(&lines, "plastic_1").len(), 1);
    for (frame, angle, tolerance) in [
        ("plastic_2_180", 180.0, 10.0),
        ("plastic_2_90", 90.0, 10.0),
        ("plastic_2_45", 45.0, 15.0),
    ] {
        let t = touches(&lines, frame);
        assert_eq!(t.len(), 2, "{frame}: {t:?}");
        assert!((apart(t[0][1], t[1][1]) - angle).abs() <= tolerance, "{frame}: {t:?}");
    }
}

#[test]
fn every_line_has_its_proof() {
    for (frame, value) in lct2004() {
        assert!(value["gap"].as_f64().unwrap() < 1e-8, "{frame}: {value}");
        assert!(value["residual"].as_f64().unwrap() < 0.2, "{frame}: {value}");
        assert!(value["solve_us"].as_f64().unwrap() >= 0.0);
    }
}

#[test]
fn metal_is_no_touch() {
    let lines = lct2004();
    for metal in ["metal_1", "metal_2_180", "metal_2_90", "metal_2_45"] {
        assert!(
            touches(&lines, metal).is_empty(),
            "{metal}: {:?}",
            touches(&lines, metal)
        );
    }
    assert!(small_tank("e01M_213831").is_empty());
}

#[test]
fn plastic_is_found_beside_metal() {
    // Electrode 5 is at 90 degrees, 9 at 180, the metal at 0 and 270.
    for (set, angles) in [
        ("e01Me05P_213616", vec![90.0]),
        ("e01Me05Pe09P_213029", vec![90.0, 180.0]),
        ("e01Me05Pe09Pe13M_212131", vec![90.0, 180.0]),
    ] {
        let mut found = small_tank(set);
        assert_eq!(found.len(), angles.len(), "{set}: {found:?}");
        found.sort_by(|a, b| a[1].abs().total_cmp(&b[1].abs()));
        for ([r, angle], truth) in found.iter().zip(&angles) {
            assert!(*r > 10.0 && apart(*angle, *truth) < 15.0, "{set}: {found:?}");
        }
    }
}

#[test]
fn water_against_water_is_empty() {
    let lines = reconstruct(
        "lct2004_voltage.csv",
        &["--baseline", "water_1", "--clockwise", "--first-electrode-deg", "90"],
    );
    for frame in ["water_2", "water_3"] {
        assert!(touches(&lines, frame).is_empty(), "{frame}");
    }
}

#[test]
fn values_left_out_are_not_zeros() {
    let folder = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(data("lct2004_voltage.csv")).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let header: Vec<String> = lines
        .iter()
        .find(|l| l.starts_with("drive_a"))
        .unwrap()
        .split(',')
        .map(str::to_owned)
        .collect();
    let column = header.iter().position(|h| h == "plastic_1_re").unwrap();
    for (k, line) in lines
        .iter_mut()
        .filter(|l| l.starts_with(|c: char| c.is_ascii_digit()))
        .enumerate()
    {
        if k % 11 == 3 {
            let mut fields: Vec<&str> = line.split(',').collect();
            fields[column] = if k % 2 == 0 { "" } else { "NaN" };
            *line = fields.join(",");
        }
    }
    let path = folder.path().join("gaps.csv");
    std::fs::write(&path, lines.join("\n")).unwrap();
    let found = reconstruct(
        path.to_str().unwrap(),
        &[
            "--baseline",
            "water_1,water_2,water_3",
            "--clockwise",
            "--first-electrode-deg",
            "90",
        ],
    );
    let (gaps, whole) = (touches(&found, "plastic_1"), touches(&lct2004(), "plastic_1"));
    assert_eq!(gaps.len(), 1, "{gaps:?}");
    assert!(
        apart(gaps[0][1], whole[0][1]) < 5.0 && (gaps[0][0] - whole[0][0]).abs() < 5.0,
        "{gaps:?} {whole:?}"
    );
}
