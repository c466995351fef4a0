//! The report of the paper's experiments: its numbers lie where theory and the paper put them, the page holds them, and it
//! needs nothing else. And the way that they are made of: calibrate, then run with forces.

use crate::program::skin;
use serde_json::{Value, json};
use std::path::Path;

fn number(v: &Value, path: &str) -> f64 {
    v.pointer(path)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("{path} is no number"))
}

fn list<'a>(v: &'a Value, path: &str) -> &'a Vec<Value> {
    v.pointer(path)
        .and_then(Value::as_array)
        .unwrap_or_else(|| panic!("{path} is no list"))
}

fn near(v: f64, wanted: f64, within: f64, what: &str) {
    assert!(
        (v - wanted).abs() <= within,
        "{what}: {v}, not {wanted} within {within}"
    );
}

#[test]
fn the_report_holds_the_papers_numbers_and_needs_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a").join("report");
    let files = skin(&["paper", "--quick", "--seed", "7", "--out", out.to_str().unwrap()]);
    assert_eq!(files.lines().count(), 2);
    let json: Value = serde_json::from_str(&std::fs::read_to_string(out.join("report.json")).unwrap()).unwrap();
    let html = std::fs::read_to_string(out.join("report.html")).unwrap();
    numbers(&json);
    page(&html, &json);
}

fn numbers(r: &Value) {
    // Fig. 4: by Euler's theorem the products add up to the transfer resistance but for the contacts' part.
    assert_eq!(list(r, "/gradients").len(), 6);
    for g in list(r, "/gradients") {
        let (sum, transfer) = (number(g, "/sum_ohm"), number(g, "/transfer_ohm"));
        assert!(sum < transfer && sum > 0.99 * transfer, "{sum} {transfer}");
        assert!((0.4..0.95).contains(&number(g, "/negative_part")));
    }
    // Fig. 7: what the generalised inverse gives is mostly what pressure cannot make; nnls never falls.
    let range = |name: &str| {
        let panel = list(r, "/touches/panels")
            .iter()
            .find(|p| p["name"].as_str().unwrap().starts_with(name))
            .unwrap();
        [number(panel, "/outcome/range/0"), number(panel, "/outcome/range/1")]
    };
    let inverse = range("generalised inverse, 5");
    assert!(inverse[0] < -0.5 * inverse[1], "{inverse:?}");
    assert_eq!((range("Lawson")[0], range("ours")[0]), (0.0, 0.0));
    // Fig. 8: all are told by ours within two millimetres.
    for (k, scene) in list(r, "/touches/scenes").iter().enumerate() {
        assert_eq!(number(scene, "/ours/found"), (k + 1) as f64);
        assert!(
            list(scene, "/ours/errors_mm").iter().all(|e| e.as_f64().unwrap() < 2.0),
            "{scene}"
        );
    }
    // Figs. 10 and 11, and the creep: the parameters from a hold of their own, the force within 5 % of full scale.
    for (k, part) in [0.08, 0.08, 0.03].into_iter().enumerate() {
        let truth = number(r, &format!("/tracking/hold/truth/{k}"));
        near(
            number(r, &format!("/tracking/hold/fitted/{k}")),
            truth,
            part * truth,
            "fitted",
        );
    }
    for name in ["varying", "repeated"] {
        let of = |what: &str| number(r, &format!("/tracking/{name}/{what}"));
        assert!(of("correlation") > 0.97);
        assert!(
            of("after/rms") < 0.02 && of("after/p99") < 0.05,
            "{name} {} {}",
            of("after/rms"),
            of("after/p99")
        );
        assert!(of("before/rms") > 3.0 * of("after/rms"));
        // The residual of the paper shows, and is gone.
        assert!(
            of("residual_n/0") > 1.5 && of("residual_n/1") > 2.0 && of("residual_n/2") == 0.0,
            "{name}"
        );
    }
    // Signal to noise and time: the paper's way is 1248 periods at 3684 Hz and has 27 dB; a sixth of the samples has a sixth of
    // the information, 7.8 dB, less what rounding adds to both.
    let ways = list(r, "/ways");
    for w in ways {
        near(number(w, "/measured_ms"), number(w, "/computed_ms"), 1e-6, "time");
    }
    near(
        number(&ways[0], "/measured_ms"),
        1248.0 / 3684.21 * 1e3,
        0.01,
        "the paper's time",
    );
    near(number(&ways[0], "/snr_db"), 27.0, 1.0, "the paper's noise");
    let fast = ways.iter().find(|w| w["periods"] == 32.0).unwrap();
    near(
        number(&ways[0], "/snr_db") - number(fast, "/snr_db"),
        7.7,
        1.0,
        "a sixth of the samples",
    );
    // Beyond the paper.
    let separations = list(r, "/reach/separations");
    let widest = separations.iter().filter(|s| number(s, "/apart_mm") == 60.0);
    assert!(widest.clone().count() == 2 && widest.clone().all(|s| number(s, "/ours/both") == 1.0));
    let sum = |who: &str| {
        separations
            .iter()
            .map(|s| number(s, &format!("/{who}/both")))
            .sum::<f64>()
    };
    assert!(sum("ours") > sum("theirs"));
    assert!(number(r, "/reach/positions/ours_mm/0") < 0.2 * number(r, "/reach/positions/theirs_mm/0"));
}

fn page(html: &str, r: &Value) {
    // The pictures are in the page itself; without their data, nothing is fetched and nothing runs.
    let mut pieces = html.split("\"data:image/png;base64,");
    let before = pieces.next().unwrap().to_owned();
    let html = pieces.fold(before, |text, piece| text + piece.split_once('"').unwrap().1);
    for foreign in ["http:", "https:", "//", "<script", "<link", "@import", "src=", "data:"] {
        assert!(!html.contains(foreign), "{foreign}");
    }
    assert!(html.split("url(").skip(1).all(|rest| rest.starts_with('#')));
    for figure in [
        "Fig. 4",
        "Fig. 7",
        "Fig. 8",
        "Figs. 10 and 11",
        "Two touches closer",
        "Position error",
    ] {
        assert!(html.contains(figure), "{figure}");
    }
    for (path, digits) in [
        ("/ways/0/snr_db", 1),
        ("/ways/4/measured_ms", 1),
        ("/tracking/hold/fitted/0", 4),
        ("/tracking/hold/fitted/1", 4),
        ("/gradients/2/sum_ohm", 2),
        ("/reach/positions/theirs_mm/0", 2),
        ("/reach/positions/ours_mm/0", 2),
    ] {
        let text = format!("{:.*}", digits, number(r, path));
        assert!(html.contains(&text), "{path} {text}");
    }
    for (path, digits) in [
        ("/tracking/repeated/after/largest", 1),
        ("/tracking/varying/before/rms", 1),
    ] {
        let text = format!("{:.*}", digits, 100.0 * number(r, path));
        assert!(html.contains(&text), "{path} {text}");
    }
    assert!(!html.contains("NaN") && !html.contains(">inf"));
}

fn calibrated(folder: &Path, arguments: &[&str]) -> (Value, String) {
    let out = folder.join("c.toml");
    let mut all = vec!["calibrate", "--json", "--out", out.to_str().unwrap()];
    all.extend(arguments);
    (
        serde_json::from_str(&skin(&all)).unwrap(),
        std::fs::read_to_string(&out).unwrap(),
    )
}

/// From the nonlinear model on the simulator's own mesh, with the board's noise: a third again with 5 s, 0.2546 N/mm².
#[test]
fn calibrate_tells_the_simulated_rubber_and_from_its_table_the_same_again() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("press.csv");
    let table = table.to_str().unwrap();
    let (found, _) = calibrated(
        folder.path(),
        &["--simulate", "--seconds", "24", "--save", table, "--seed", "3"],
    );
    near(number(&found, "/delayed_ratio"), 1.0 / 3.0, 0.025, "delayed part");
    near(number(&found, "/tau_s"), 5.0, 0.4, "time constant");
    near(number(&found, "/unit_rise_mpa"), 0.2546, 0.008, "unit rise");
    let (again, toml) = calibrated(folder.path(), &[table]);
    near(
        number(&again, "/tau_s"),
        number(&found, "/tau_s"),
        1e-3,
        "from the table",
    );
    assert!(
        toml.contains("[rubber.standard_error]") && toml.contains("unit_rise_mpa"),
        "{toml}"
    );
    // Without the gauge's column: the hold is found in the rises.
    let text = std::fs::read_to_string(table).unwrap();
    let no_gauge: String = text
        .lines()
        .map(|l| {
            l.split(',')
                .enumerate()
                .filter(|(k, _)| *k != 1)
                .map(|(_, v)| v)
                .collect::<Vec<_>>()
                .join(",")
                + "\n"
        })
        .collect();
    std::fs::write(table, no_gauge).unwrap();
    let (held, _) = calibrated(folder.path(), &[table, "--force-n", "25"]);
    near(
        number(&held, "/delayed_ratio"),
        number(&found, "/delayed_ratio"),
        0.03,
        "by its edges",
    );
    near(
        number(&held, "/unit_rise_mpa"),
        number(&found, "/unit_rise_mpa"),
        0.01,
        "by its edges",
    );
}

#[test]
fn run_shows_newtons_with_a_calibration_and_uncalibrated_ones_without() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("c.toml");
    // The demo's rubber does not creep; its first finger presses 20 N.
    std::fs::write(
        &file,
        "delayed_ratio = 0.0\ntau_s = 1.0\nexponent = 1.0\nunit_rise_mpa = 0.2546\nforce_sd_n = 0.2\n",
    )
    .unwrap();
    let mut all = vec![
        "run",
        "--simulate",
        "--json",
        "--every-frame",
        "--plan",
        "quiet",
        "--frames",
        "90",
    ];
    // The scene begins when the baseline is done, which takes as long as the machine does. A finger's first 0.3 s are its way down.
    let forces = |out: &str, uncalibrated: bool| -> Vec<f64> {
        let lines = out.lines().map(|l| serde_json::from_str::<Value>(l).unwrap());
        let pictures: Vec<Value> = lines.filter(|l| l["kind"] == "picture").collect();
        let time_s = |l: &Value| l["time_s"].as_f64().unwrap();
        let touched = pictures.iter().find(|l| l["touches"] != json!([])).map(time_s).unwrap();
        let down = pictures.into_iter().filter(|l| time_s(l) > touched + 0.3);
        let first = |l: Value| {
            l["touches"]
                .as_array()
                .unwrap()
                .iter()
                .min_by_key(|t| t["id"].as_u64())
                .cloned()
        };
        let mut forces: Vec<f64> = down
            .filter_map(first)
            .map(|t| {
                assert_eq!(t["uncalibrated"] == true, uncalibrated, "{t}");
                t["force_n"].as_f64().unwrap()
            })
            .collect();
        assert!(forces.len() >= 10, "{} pictures of the finger", forces.len());
        forces.sort_by(f64::total_cmp);
        forces
    };
    // The demo's rubber is a typical one.
    let without = forces(&skin(&all), true);
    near(without[without.len() / 2], 20.0, 1.5, "the finger's force");
    all.extend(["--calibration", file.to_str().unwrap()]);
    let with = forces(&skin(&all), false);
    near(with[with.len() / 2], 20.0, 1.5, "the finger's force");
}

/// Frames of a table, a second apart: 25 N on creeping rubber, held, and gone.
#[test]
fn a_table_whose_times_are_known_gives_newtons_too() {
    let folder = tempfile::tempdir().unwrap();
    let (table, file) = (folder.path().join("frames.csv"), folder.path().join("c.toml"));
    let (k, tau_s, unit) = (0.4, 2.0, 0.2546);
    std::fs::write(
        &file,
        format!("delayed_ratio = {k}\ntau_s = {tau_s:?}\nexponent = 1.0\nunit_rise_mpa = {unit}\nforce_sd_n = 0.1\n"),
    )
    .unwrap();
    // The lag of a force that rises over the first second, is held for two, falls over one and is gone.
    let solid = inverse::force::solid::Solid {
        delayed_ratio: k,
        tau_s,
        exponent: 1.0,
        unit_rise_mpa: unit,
    };
    let (mut rubber, area) = (
        inverse::force::solid::SolidState::default(),
        std::f64::consts::PI * 12.5 * 12.5,
    );
    let forces = [0.0, 25.0, 25.0, 25.0, 0.0, 0.0];
    let rises = forces.map(|f| solid.rise(rubber.press(&solid.step(1.0), f / area)));
    let columns: Vec<String> = rises
        .iter()
        .map(|rise| skin(&["forward", "--csv", "--touch", &format!("10,-5,12.5,{rise}")]))
        .collect();
    let rows: Vec<Vec<&str>> = columns.iter().map(|c| c.lines().collect()).collect();
    let mut text = "drive_a,drive_b,sense_a,sense_b,rest,f1,f2,f3,f4,f5\n".to_owned();
    for line in 1..rows[0].len() {
        text.push_str(rows[0][line]);
        for column in &rows[1..] {
            text.push(',');
            text.push_str(column[line].rsplit(',').next().unwrap());
        }
        text.push('\n');
    }
    std::fs::write(&table, text).unwrap();
    let (table, file) = (table.to_str().unwrap(), file.to_str().unwrap());
    let out = skin(&[
        "reconstruct",
        table,
        "--baseline",
        "rest",
        "--json",
        "--calibration",
        file,
        "--frame-s",
        "1",
    ]);
    let found: Vec<Vec<f64>> = out
        .lines()
        .map(|l| serde_json::from_str::<Value>(l).unwrap())
        .map(|v| list(&v, "/touches").iter().map(|t| number(t, "/force_n")).collect())
        .collect();
    for (k, touches) in found.iter().enumerate() {
        let force = forces[k + 1];
        assert_eq!(touches.len(), usize::from(force > 0.0), "frame {k}: {touches:?}");
        assert!(
            touches.iter().all(|t| (t - force).abs() < 0.02 * 25.0),
            "frame {k}: {touches:?}"
        );
    }
}
