//! Commands that ask a board: of a recording they say what they said live, and what only a live board can tell.

use crate::program::{output, pictures, said, skin, text};
use serde_json::{Value, json};
use std::path::Path;

fn json_of(arguments: &[&str]) -> Value {
    serde_json::from_str(&skin(arguments)).unwrap()
}

/// The same fields of two objects.
fn assert_same(live: &Value, recorded: &Value, but: &[&str]) {
    let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(live), keys(recorded));
    for key in keys(live).iter().filter(|key| !but.contains(&key.as_str())) {
        assert_eq!(live[key], recorded[key], "{key}");
    }
}

#[test]
fn a_recorded_board_is_who_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("r.mcap");
    skin(&["record", text(&file), "--simulate", "--seconds", "0.3"]);
    let live = json_of(&["hello", "--simulate", "--json"]);
    let recorded = json_of(&["hello", "--from", text(&file), "--json"]);
    let only_live = ["port", "self_test", "channels_not_tried", "recorded_restarts"];
    assert_same(&live, &recorded, &only_live);
    assert!(live["self_test"].is_object() && live["recorded_restarts"].is_null());
    assert_eq!(recorded["port"], "recording of simulated skin");
    assert_eq!(
        (&recorded["self_test"], &recorded["recorded_restarts"]),
        (&Value::Null, &json!([]))
    );
    let words = skin(&["hello", "--from", text(&file)]);
    assert!(
        words.contains("self-test   not in the recording; only a live board can tell"),
        "{words}"
    );
    for (wrong, code) in [
        (&["--port", "x"][..], 2),
        (&["--simulate"], 2),
        (&["--phantom", "470"], 2),
    ] {
        let run = output(&[&["hello", "--from", text(&file)], wrong].concat());
        assert_eq!(run.status.code(), Some(code), "{wrong:?}: {}", said(&run));
    }
}

/// Every start anew is told, with its reason.
#[test]
fn a_recorded_board_that_was_reset_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, file) = (folder.path().join("reset.toml"), folder.path().join("r.mcap"));
    let faults = [0.9, 1.6].map(|at_s| format!("[[fault]]\nkind = \"board_reset\"\nat_s = {at_s}\n"));
    std::fs::write(&scene, format!("duration_s = 9.0\n{}", faults.concat())).unwrap();
    skin(&[
        "run",
        "--json",
        "--scene",
        text(&scene),
        "--frames",
        "200",
        "--record",
        text(&file),
    ]);
    let recorded = json_of(&["hello", "--from", text(&file), "--json"]);
    assert_eq!(recorded["recorded_restarts"].as_array().unwrap().len(), 2, "{recorded}");
    let info = json_of(&["info", text(&file), "--json"]);
    assert_eq!(info["resets"], 2);
    let words = skin(&["hello", "--from", text(&file)]);
    assert!(words.contains("restarted   2 times while recorded: "), "{words}");
}

/// What a recording says of plan, watch and source is what the board says that was recorded.
#[cfg(target_os = "linux")]
#[test]
fn a_recorded_board_was_set_to_what_it_is_set_to() {
    let folder = tempfile::tempdir().unwrap();
    let (port, file) = (folder.path().join("port"), folder.path().join("r.mcap"));
    let _board = crate::reconnect::simulated(&port);
    let set = [
        "settings",
        "set",
        "--excitation",
        "900",
        "--autostart",
        "on",
        "--port",
        text(&port),
    ];
    skin(&set);
    let record = [
        "run",
        "--json",
        "--watch",
        "--plan",
        "fastest",
        "--frames",
        "20",
        "--record",
        text(&file),
    ];
    skin(&[&record[..], &["--port", text(&port)]].concat());
    let recorded = json_of(&["settings", "--from", text(&file), "--json"]);
    let live = json_of(&["settings", "--port", text(&port), "--json"]);
    // It measured then, and was asked before it watched.
    assert_same(&live, &recorded, &["port", "running", "watching"]);
    assert_eq!(
        (&recorded["excitation_permille"], &recorded["autostart"]),
        (&json!(900), &json!(true))
    );
    assert_eq!(
        (&recorded["plan"]["name"], &recorded["watch"]["name"]),
        (&json!("fastest"), &json!("paper"))
    );
    assert_eq!(
        (&recorded["running"], &recorded["not_recorded"]),
        (&json!(true), &json!([]))
    );
    // A recording is no board that could be set.
    for action in [&["set", "--plan", "fast"][..], &["store"], &["forget"], &["baseline"]] {
        let run = output(&[&["settings"], action, &["--from", text(&file)]].concat());
        assert_eq!(run.status.code(), Some(2), "{action:?}");
        assert!(said(&run).contains("a recording only shows"), "{}", said(&run));
    }
}

/// Two fingers, one after the other and together.
const SCENE: &str = "duration_s = 6.0\n\
    [[touch]]\nshape = \"finger\"\npress = { at_s = 0.4, for_s = 2.4, x_mm = 34.0, y_mm = -24.0, force_n = 10.0 }\n\
    [[touch]]\nshape = \"finger\"\npress = { at_s = 1.4, for_s = 2.4, x_mm = -38.0, y_mm = 12.0, force_n = 15.0 }\n";
const PLACES: [[f64; 2]; 2] = [[34.0, -24.0], [-38.0, 12.0]];

fn report(file: &Path, folder: &Path, more: &[&str]) -> (Value, String) {
    let out = folder.join(format!("report{}", more.len()));
    let files = skin(&[&["paper", "--from", text(file), "--out", text(&out)], more].concat());
    assert_eq!(files.lines().count(), 2);
    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
    (serde_json::from_str(&read("report.json")).unwrap(), read("report.html"))
}

fn floats(value: &Value, key: &str) -> Vec<f64> {
    let list = value.as_array().unwrap().iter();
    list.map(|v| v[key].as_f64().unwrap()).collect()
}

fn places(value: &Value) -> Vec<[f64; 2]> {
    serde_json::from_value(value.clone()).unwrap()
}

/// Distance of every true place to the nearest that was found, mm.
fn off_mm(found: &[[f64; 2]]) -> Vec<f64> {
    let nearest = |[x, y]: &[f64; 2]| {
        let all = found.iter().map(|[a, b]| (a - x).hypot(b - y));
        all.fold(f64::INFINITY, f64::min)
    };
    PLACES.iter().map(nearest).collect()
}

/// The figures of a recorded run are those of the run: its forces and touches, and what `reconstruct` makes of its frames.
#[test]
fn the_papers_figures_of_a_recording_are_those_of_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (scene, file, calibration) = (path("scene.toml"), path("r.mcap"), path("calibration.toml"));
    std::fs::write(&scene, SCENE).unwrap();
    let keys = "delayed_ratio = 0.3\ntau_s = 5.0\nexponent = 1.0\nunit_rise_mpa = 0.25\nforce_sd_n = 0.1\n";
    std::fs::write(&calibration, keys).unwrap();
    let arguments = [
        "run",
        "--json",
        "--every-frame",
        "--frames",
        "420",
        "--scene",
        text(&scene),
        "--calibration",
        text(&calibration),
        "--record",
        text(&file),
    ];
    let shown = pictures(&output(&arguments));
    let (report, html) = report(&file, folder.path(), &[]);

    // Figs. 10 and 11: the forces that were printed, at their times.
    let moments = &report["forces"]["moments"];
    assert_eq!(moments.as_array().unwrap().len(), shown.len());
    let times: Vec<f64> = shown.iter().map(|p| p["time_s"].as_f64().unwrap()).collect();
    let total = |p: &Value| -> f64 { floats(&p["touches"], "force_n").iter().sum() };
    let begin_s = floats(moments, "time_s")[0] - times[0];
    for ((moment, picture), time_s) in moments.as_array().unwrap().iter().zip(&shown).zip(&times) {
        assert!((moment["time_s"].as_f64().unwrap() - begin_s - time_s).abs() < 1e-4);
        // Six digits are printed.
        let (recorded_n, printed_n) = (moment["recorded_n"].as_f64().unwrap(), total(picture));
        assert!(
            (recorded_n - printed_n).abs() <= 2e-5 * printed_n.abs(),
            "{recorded_n} {printed_n}"
        );
    }
    assert_eq!(
        (&report["forces"]["uncalibrated"], &report["forces"]["errors"]),
        (&json!(false), &Value::Null)
    );

    // Fig. 8: the touches that were printed of these frames, and by both methods where the fingers are.
    let scenes = report["scenes"].as_array().unwrap();
    assert_eq!(scenes.len(), 2, "{scenes:#?}");
    for scene in scenes {
        let frame = shown.iter().find(|p| p["frame"] == scene["sequence"]).unwrap();
        let recorded = places(&scene["recorded_mm"]);
        for (place, touch) in recorded.iter().zip(frame["touches"].as_array().unwrap()) {
            let printed = ["x_mm", "y_mm"].map(|key| touch[key].as_f64().unwrap());
            assert!((place[0] - printed[0]).hypot(place[1] - printed[1]) < 1e-3);
        }
    }
    let two = &scenes[1];
    let ours = off_mm(&places(&two["ours"]["places_mm"]));
    let theirs = off_mm(&places(&two["theirs"]["places_mm"]));
    assert!(ours.iter().all(|off| *off < 3.0), "{ours:?}");
    assert!(theirs.iter().all(|off| *off < 15.0), "{theirs:?}");

    // Fig. 7: what `reconstruct` finds by the paper's method in this frame.
    let arguments = [
        "reconstruct",
        "--from",
        text(&file),
        "--method",
        "lawson-hanson",
        "--json",
    ];
    let all = skin(&arguments);
    let lines: Vec<Value> = all.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let column = format!("t{:.4}", two["at_s"].as_f64().unwrap());
    let line = lines.iter().find(|line| line["frame"] == column.as_str()).unwrap();
    let found: Vec<[f64; 2]> = floats(&line["touches"], "x_mm")
        .into_iter()
        .zip(floats(&line["touches"], "y_mm"))
        .map(|(x, y)| [x, y])
        .collect();
    // JSON has six digits.
    let theirs = places(&two["theirs"]["places_mm"]);
    assert_eq!(found.len(), theirs.len());
    for (found, place) in found.iter().zip(&theirs) {
        assert!(
            (found[0] - place[0]).hypot(found[1] - place[1]) < 1e-4,
            "{found:?} {place:?}"
        );
    }
    let panels = report["panels"].as_array().unwrap();
    let paper = panels
        .iter()
        .find(|p| p["name"].as_str().unwrap().starts_with("Lawson"))
        .unwrap();
    assert_eq!(paper["outcome"]["places_mm"], two["theirs"]["places_mm"]);
    // The generalised inverse falls where pressure cannot, as on the paper's page; ours never does.
    let lowest = |name: &str| {
        let panel = panels
            .iter()
            .find(|p| p["name"].as_str().unwrap().starts_with(name))
            .unwrap();
        panel["outcome"]["range"][0].as_f64().unwrap()
    };
    assert!(lowest("generalised inverse, 5") < 0.0);
    assert_eq!((lowest("ours"), lowest("Lawson")), (0.0, 0.0));

    // Noise and times: the plan's 32 periods of 3684 Hz.
    let timing = &report["timing"];
    let number = |key: &str| timing[key].as_f64().unwrap();
    let plan_ms = 1e3 * 32.0 * 16.0 * 1425.0 / 84e6;
    assert!((number("measured_ms") / plan_ms - 1.0).abs() < 0.01, "{timing}");
    assert!(number("snr_db") > 10.0 && number("bytes") > 400.0, "{timing}");
    // Pictures may have any letters.
    let pictures = html.split("data:image/png;base64,");
    let words: String = pictures
        .map(|part| part.split_once('"').map_or(part, |(_, rest)| rest))
        .collect();
    assert!(words.contains("Fig. 7") && !words.contains("NaN") && !words.contains("://"));
    assert_eq!(html.matches("<svg").count(), 2 * 2 + 5 + 1);
}

/// A gauge that reads what was recorded leaves no difference, and one that reads half of it leaves half.
#[test]
fn a_gauge_beside_a_recording_is_what_its_forces_are_held_against() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, file) = (folder.path().join("scene.toml"), folder.path().join("r.mcap"));
    std::fs::write(&scene, SCENE).unwrap();
    skin(&[
        "run",
        "--json",
        "--frames",
        "200",
        "--scene",
        text(&scene),
        "--record",
        text(&file),
    ]);
    let (without, _) = report(&file, folder.path(), &[]);
    assert_eq!(without["forces"]["uncalibrated"], true);
    let moments = without["forces"]["moments"].as_array().unwrap();
    for (part, wanted) in [(1.0, 0.0), (0.5, 1.0)] {
        let gauge = folder.path().join("gauge.csv");
        let line = |m: &Value| format!("{},{}\n", m["time_s"], part * m["recorded_n"].as_f64().unwrap());
        std::fs::write(
            &gauge,
            "time_s,force_n\n".to_owned() + &moments.iter().map(line).collect::<String>(),
        )
        .unwrap();
        let (with, _) = report(&file, folder.path(), &["--gauge", text(&gauge)]);
        let recorded = &with["forces"]["errors"][2];
        let largest = recorded["largest"].as_f64().unwrap();
        assert!((largest - wanted).abs() < 1e-9, "{recorded}");
        // By the best gain the paper's method is as near to a half as to the whole.
        let theirs = with["forces"]["errors"][0]["rms"].as_f64().unwrap();
        assert!(theirs > 0.0 && theirs < 0.5, "{theirs}");
    }
    let refused = output(&["paper", "--out", text(folder.path()), "--gauge", "x.csv"]);
    assert_eq!(refused.status.code(), Some(2));
}
