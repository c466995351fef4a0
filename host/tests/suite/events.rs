//! What touches do, as the program tells it: in JSON, in recordings and their replays, to commands.

use crate::json_lines::are_by_the_schema;
use crate::program::{lines, output, pictures, program, said, text};
use serde_json::Value;
use std::path::Path;
use std::process::Stdio;

/// A tap, and then a finger that stays.
const SCENE: &str = "duration_s = 6.0\n\
    [[touch]]\nshape = \"finger\"\ntap = { at_s = 0.3, for_s = 0.1, x_mm = 30.0, y_mm = 20.0, force_n = 15.0 }\n\
    [[touch]]\nshape = \"finger\"\npress = { at_s = 1.0, for_s = 4.0, x_mm = -30.0, y_mm = 0.0, force_n = 15.0 }\n";

fn events(lines: &[Value]) -> Vec<Value> {
    let of = |line: &Value| line["events"].as_array().cloned().unwrap_or_default();
    lines.iter().flat_map(of).collect()
}

fn scene(folder: &Path) -> String {
    let file = folder.join("scene.toml");
    std::fs::write(&file, SCENE).unwrap();
    text(&file).to_owned()
}

/// Arguments that show every frame, so that a busy machine sees the same.
fn every_frame(scene: &str) -> [&str; 7] {
    ["run", "--json", "--every-frame", "--scene", scene, "--frames", "230"]
}

#[test]
fn events_are_in_json_and_in_replays_and_forces_are_marked() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, recording) = (scene(folder.path()), folder.path().join("r.mcap"));
    let recording = text(&recording);
    let run = output(&[&every_frame(&scene)[..], &["--record", recording]].concat());
    let lines = lines(&run);
    are_by_the_schema(&lines);
    assert_eq!(lines[0]["calibrated"], false);
    let events = events(&lines);
    let names: Vec<&str> = events.iter().map(|e| e["event"].as_str().unwrap()).collect();
    assert_eq!(names, ["contact", "lift", "tap", "contact", "hold"], "{events:#?}");
    let force = |e: &Value| (e["force_n"].as_f64().unwrap(), e["uncalibrated"] == true);
    let (force_n, marked) = force(&events[4]);
    // What the simulated rubber is pressed with, give or take the fit and its creep.
    assert!((12.0..20.0).contains(&force_n) && marked, "{events:#?}");
    let touched = lines.iter().find(|l| l["touches"][0]["id"].is_u64()).unwrap();
    assert!(force(&touched["touches"][0]).1);
    assert!(said(&run).contains("uncalibrated"), "{}", said(&run));

    let replay = output(&["replay", "--json", "--speed", "max", recording]);
    assert!(
        said(&replay).contains("every one with the recorded touches"),
        "{}",
        said(&replay)
    );
    assert_eq!(pictures(&replay), pictures(&run));
}

/// A command that takes long is not waited for, and a value is never a part of a command.
#[cfg(unix)]
#[test]
fn commands_are_run_and_never_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, told, mark) = (
        scene(folder.path()),
        folder.path().join("told"),
        folder.path().join("mark"),
    );
    std::fs::write(&mark, "").unwrap();
    let write = format!(
        "echo \"$SKIN_EVENT $SKIN_TOUCH $SKIN_X_MM $SKIN_UNCALIBRATED\" >> {}; exit 3",
        text(&told)
    );
    // Ends when the test does.
    let wait = format!("while [ -e {} ]; do sleep 0.1; done", text(&mark));
    let on = ["--on", "tap", &write, "--on", "contact", &wait];
    let arguments = [&every_frame(&scene)[..], &on].concat();
    // Into a file: the command that still runs would hold a pipe open.
    let stderr = folder.path().join("stderr");
    let mut command = program(&arguments);
    command
        .stdout(Stdio::piped())
        .stderr(std::fs::File::create(&stderr).unwrap());
    let run = command.spawn().unwrap().wait_with_output().unwrap();
    let lines = lines(&run);
    assert_eq!(lines.iter().filter(|l| l["kind"] == "picture").count(), 230);
    let told = std::fs::read_to_string(&told).unwrap();
    let words: Vec<&str> = told.split_whitespace().collect();
    assert_eq!(
        (words[0], words[1], words[3], words.len()),
        ("tap", "1", "1", 4),
        "{told}"
    );
    assert!((words[2].parse::<f64>().unwrap() - 30.0).abs() < 3.0, "{told}");
    let said = std::fs::read_to_string(&stderr).unwrap();
    for part in [
        "done: still runs; 1 events so far",
        "done: still runs, and is left running",
        "exit 3: exit status: 3",
        "started 1 times, failed 1, not started for 0",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
}

#[test]
fn an_event_that_does_not_exist_is_wrong_usage() {
    let run = output(&["run", "--simulate", "--on", "wink", "true"]);
    assert_eq!(run.status.code(), Some(2));
    assert!(
        said(&run).contains("no such event; there are contact, lift, tap"),
        "{}",
        said(&run)
    );
}
