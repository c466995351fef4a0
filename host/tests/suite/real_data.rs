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

/// Polar coordinates (mm, degrees) of what raises the resistivity of a frame, strongest first.
fn touches(lines: &[(String, Value)], frame: &str) -> Vec<[f64; 2]> {
    objects(lines, frame, 1.0)
}

/// The same of what lowers it.
fn falls(lines: &[(String, Value)], frame: &str) -> Vec<[f64; 2]> {
    objects(lines, frame, -1.0)
}

fn objects(lines: &[(String, Value)], frame: &str, sign: f64) -> Vec<[f64; 2]> {
    let (_, value) = lines.iter().find(|(name, _)| name == frame).unwrap();
    let list = value["touches"].as_array().unwrap();
    let rises: Vec<f64> = list.iter().map(|t| t["rise"].as_f64().unwrap()).collect();
    assert!(rises.windows(2).all(|w| w[0].abs() >= w[1].abs()), "{frame}: {rises:?}");
    list.iter()
        .filter(|t| sign * t["rise"].as_f64().unwrap() > 0.0)
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

/// Frames of one set of the small tank, against its own reference.
fn small_tank(set: &str) -> (Vec<(String, Value)>, String) {
    let baseline = format!("{set}_ref");
    let lines = reconstruct(
        "pyeidors2026_tank.csv",
        &["--baseline", &baseline, "--drive", "current", "--diameter-mm", "60"],
    );
    (lines, format!("{set}_obj"))
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
fn metal_lowers_and_is_found_as_plastic_is() {
    let lines = lct2004();
    for (frame, rises, angles) in [
        ("metal_1", 0, vec![]),
        ("metal_2_180", 0, vec![(180.0, 10.0)]),
        ("metal_2_90", 0, vec![(90.0, 10.0)]),
        ("metal_2_45", 0, vec![(45.0, 15.0)]),
        // Two of plastic, two of metal.
        ("4_phantoms_adj", 2, vec![(90.0, 10.0)]),
        ("plastic_1", 1, vec![]),
        ("plastic_2_180", 2, vec![]),
        ("plastic_2_90", 2, vec![]),
        ("plastic_2_45", 2, vec![]),
    ] {
        let (up, down) = (touches(&lines, frame), falls(&lines, frame));
        assert_eq!(up.len(), rises, "{frame}: {up:?}");
        let metal = if frame == "metal_1" { 1 } else { 2 * angles.len() };
        assert_eq!(down.len(), metal, "{frame}: {down:?}");
        for (angle, tolerance) in angles {
            assert!(
                (apart(down[0][1], down[1][1]) - angle).abs() <= tolerance,
                "{frame}: {down:?}"
            );
        }
    }
}

/// What is said of the sheet decides which of them are touches.
#[test]
fn objects_of_the_other_sign_are_no_touches() {
    for (rise, kept) in [("up", 1.0), ("down", -1.0), ("either", 0.0)] {
        let water = "water_1,water_2,water_3";
        let arguments = [
            "--baseline",
            water,
            "--clockwise",
            "--first-electrode-deg",
            "90",
            "--rise",
            rise,
        ];
        let lines = reconstruct("lct2004_voltage.csv", &arguments);
        let (up, down) = (touches(&lines, "4_phantoms_adj"), falls(&lines, "4_phantoms_adj"));
        assert_eq!(up.len(), if kept < 0.0 { 0 } else { 2 }, "{rise}: {up:?}");
        assert_eq!(down.len(), if kept > 0.0 { 0 } else { 2 }, "{rise}: {down:?}");
    }
}

#[test]
fn plastic_and_metal_are_found_beside_each_other() {
    // Electrode 5 is at 90 degrees, 9 at 180, the metal at 0 and 270.
    for (set, plastic, metal) in [
        ("e01M_213831", vec![], vec![0.0]),
        ("e01Me05P_213616", vec![90.0], vec![0.0]),
        ("e01Me05Pe09P_213029", vec![90.0, 180.0], vec![0.0]),
        ("e01Me05Pe09Pe13M_212131", vec![90.0, 180.0], vec![0.0, -90.0]),
    ] {
        let (lines, frame) = small_tank(set);
        for (found, angles) in [(touches(&lines, &frame), plastic), (falls(&lines, &frame), metal)] {
            assert_eq!(found.len(), angles.len(), "{set}: {found:?}");
            for truth in angles {
                let near = |o: &&[f64; 2]| o[0] > 10.0 && apart(o[1], truth) < 15.0;
                assert_eq!(found.iter().filter(near).count(), 1, "{set}: {found:?}");
            }
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
