//! `skin run` with baselines that are stored: the program as a person runs it, with the simulated skin. Nothing here depends on
//! how fast the machine is: the scene waits for the baseline.

use crate::program::{lines, said};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn run(state: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_skin"))
        .args(["run", "--json", "--frames", "3", "--state-dir"])
        .arg(state)
        .args(arguments)
        .output()
        .unwrap()
}

/// The pictures, with the baseline's age.
fn pictures(output: &Output) -> Vec<Value> {
    let mut lines = lines(output);
    lines.retain(|line| line["kind"] == "picture");
    lines
}

/// The only file in a folder.
fn only_file(folder: &Path) -> Vec<u8> {
    let files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    assert_eq!(files.len(), 1, "{files:?}");
    std::fs::read(&files[0]).unwrap()
}

#[test]
fn a_stored_baseline_shows_what_rests_on_the_sheet_and_a_new_one_warns_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path();
    let first = pictures(&run(state, &["--simulate"]));
    assert_eq!(first[0]["touches"], Value::Array(Vec::new()));
    assert_eq!(first[0]["baseline"]["stored"], false);
    assert_eq!(first[0]["baseline"].get("warning"), None);
    let stored = only_file(state);

    // The finger of 20 N is in the new baseline, which is therefore not stored.
    let preload = run(state, &["--scene", "preload"]);
    for picture in pictures(&preload) {
        let warning = picture["baseline"]["warning"].as_str().unwrap().to_owned();
        assert!(warning.contains("something may rest on it"), "{warning}");
    }
    assert!(
        said(&preload).contains("start with --baseline stored"),
        "{}",
        said(&preload)
    );
    assert!(only_file(state) == stored);

    let resting = run(state, &["--scene", "preload", "--baseline", "stored"]);
    assert!(said(&resting).contains("baseline of "), "{}", said(&resting));
    for picture in pictures(&resting) {
        assert_eq!(picture["baseline"]["stored"], true);
        let touches = picture["touches"].as_array().unwrap();
        assert_eq!(touches.len(), 1, "{picture}");
        let at = |key: &str| touches[0][key].as_f64().unwrap();
        let off_mm = (at("x_mm") + 35.0).hypot(at("y_mm") - 20.0);
        assert!(off_mm < 2.0, "{picture}");
    }
    assert!(only_file(state) == stored);

    // On request it is stored nevertheless.
    pictures(&run(state, &["--scene", "preload", "--baseline", "replace"]));
    assert!(only_file(state) != stored);
}

#[test]
fn a_stored_baseline_of_something_else_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path();
    let refused = |arguments: &[&str], says: &str, code| {
        let output = run(state, arguments);
        assert_eq!(output.status.code(), Some(code), "{}", said(&output));
        assert!(said(&output).contains(says), "{}", said(&output));
    };
    refused(
        &["--simulate", "--baseline", "stored"],
        "no baseline of this board is stored",
        1,
    );
    refused(
        &["--simulate", "--baseline", "stored", "--watch"],
        "leave one of them out",
        2,
    );
    pictures(&run(state, &["--simulate"]));
    let stored = |more: &[&'static str]| [&["--simulate", "--baseline", "stored"], more].concat();
    refused(&stored(&["--plan", "sequential"]), "another plan", 1);
    refused(
        &stored(&["--sheet", "tests/cli/four-electrodes.toml"]),
        "16 electrodes, the board has 4",
        1,
    );
    refused(&stored(&["--sheet", "tests/cli/other-sheet.toml"]), "another sheet", 1);
}

#[test]
fn a_simulated_skin_stores_nothing_unless_told_where() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_skin"))
            .args(["run", "--json", "--simulate", "--frames", "1"])
            .args(arguments)
            .env("XDG_STATE_HOME", folder.path())
            .output()
            .unwrap()
    };
    assert_eq!(pictures(&run(&[])).len(), 1);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    let stored = run(&["--baseline", "stored"]);
    assert_eq!(stored.status.code(), Some(1));
    assert!(said(&stored).contains("name one with --state-dir"), "{}", said(&stored));
}

/// `cargo test -p host --test suite -- --ignored starts_beside_busy_loops --nocapture`
#[test]
#[ignore = "a measurement of some minutes"]
fn starts_beside_busy_loops() {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    const STARTS: usize = 100;
    let folder = tempfile::tempdir().unwrap();
    pictures(&run(folder.path(), &["--simulate"]));
    let stop = Arc::new(AtomicBool::new(false));
    let loops: Vec<_> = (0..4)
        .map(|_| {
            let stop = Arc::clone(&stop);
            std::thread::spawn(move || while !stop.load(Ordering::Relaxed) {})
        })
        .collect();
    // Right: nothing in the first picture, and a baseline that is the stored one but for noise and drift.
    let right = (0..STARTS)
        .filter(|_| {
            let first = &pictures(&run(folder.path(), &["--simulate"]))[0];
            first["touches"] == Value::Array(Vec::new()) && first["baseline"].get("warning").is_none()
        })
        .count();
    stop.store(true, Ordering::Relaxed);
    loops.into_iter().for_each(|l| l.join().unwrap());
    println!("{right} of {STARTS} first pictures are right");
    assert_eq!(right, STARTS);
}
