//! `skin run` that goes on and on, beside a simulated board whose time passes as fast as it is read: every frame is accounted for, and
//! nothing piles up.

use crate::program::{Started, program, text};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

/// A board with one channel, which sends few frames in much time, and a finger every five minutes. Looked at ten times a second, on a
/// sheet that is at rest between: it costs little to simulate.
const SCENE: &str = r#"
duration_s = 300.0
loop_s = 300.0

[material]
kind = "elastic"

[board]
plan = "sequential-fast"
look_s = 0.1

[electronics]
one_channel = true

[[touch]]
shape = "finger"
press = { at_s = 20.0, for_s = 1.0, x_mm = -30.0, y_mm = 25.0, force_n = 15.0 }
"#;

/// Memory of a process, KiB.
fn resident_kib(id: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap();
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:")).unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}

/// Runs for so long, s of the board's time, and records it where that is asked for. Returns the program's memory after a tenth of
/// the time and at the end, KiB.
fn run(seconds: f64, record: Option<&Path>) -> (u64, u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (scene, port, said) = (path("scene.toml"), path("port"), path("said"));
    std::fs::write(&scene, SCENE).unwrap();
    let mut command = program(&[
        "sim",
        "--pty",
        "--unpaced",
        "--link",
        text(&port),
        "--scene",
        text(&scene),
    ]);
    let mut board = Started::new(command.stdout(Stdio::piped()));
    let mut named = String::new();
    let mut names = BufReader::new(board.0.stdout.take().unwrap());
    names.read_line(&mut named).unwrap();
    assert!(named.starts_with("/dev/"), "{named}");
    let mut command = program(&[
        "run",
        "--json",
        "--every-frame",
        "--baseline",
        "new",
        "--calibration",
        "none",
    ]);
    command.args(["--plan", "sequential-fast", "--port", text(&port)]);
    if let Some(file) = record {
        command.args(["--record", text(file)]);
    }
    command
        .stdout(Stdio::piped())
        .stderr(std::fs::File::create(&said).unwrap());
    let mut shown = Started::new(command.env("XDG_STATE_HOME", folder.path()));
    let mut lines = BufReader::new(shown.0.stdout.take().unwrap());
    let ids = [shown.0.id(), board.0.id()];
    let memory = || ids.map(resident_kib);
    let start = Instant::now();
    let (mut frames, mut touched, mut downs, mut events) = (0_u64, 0_u64, 0_u64, Vec::new());
    let (mut last, mut first_s, mut early, mut hour) = (None::<u64>, f64::NAN, None, 1.0);
    let mut line = String::new();
    let counted = loop {
        line.clear();
        let said = || std::fs::read_to_string(&said).unwrap();
        assert!(lines.read_line(&mut line).unwrap() > 0, "it ended: {}", said());
        let seen: Value = serde_json::from_str(&line).unwrap();
        if seen["kind"] != "picture" {
            events.push(line.clone());
            continue;
        }
        let (number, time_s) = (seen["frame"].as_u64().unwrap(), seen["time_s"].as_f64().unwrap());
        assert_eq!(number, last.map_or(number, |last| last + 1), "{line}");
        if last.is_none() {
            first_s = time_s;
        }
        last = Some(number);
        frames += 1;
        touched += u64::from(!seen["touches"].as_array().unwrap().is_empty());
        let contacts = seen["events"]
            .as_array()
            .into_iter()
            .flatten()
            .filter(|e| e["event"] == "contact");
        downs += contacts.count() as u64;
        let counted = ["lost_frames", "skipped_frames"].map(|name| seen[name].as_u64().unwrap());
        let run_s = time_s - first_s;
        if early.is_none() && run_s >= seconds / 10.0 {
            early = Some(memory());
        }
        if run_s >= hour * 3600.0 {
            let clock_s = start.elapsed().as_secs();
            println!(
                "{hour} h after {clock_s} s: {frames} frames, {touched} touched; {:?} KiB",
                memory()
            );
            hour += 1.0;
        }
        if run_s >= seconds {
            break counted;
        }
    };
    let (early, end) = (early.unwrap(), memory());
    let status = Command::new("kill").args(["-TERM", &shown.0.id().to_string()]).status();
    assert!(status.unwrap().success());
    std::io::copy(&mut lines, &mut std::io::sink()).unwrap();
    assert!(shown.0.wait().unwrap().success());
    let said = std::fs::read_to_string(&said).unwrap();
    println!(
        "{seconds} s of the board's time in {} s: {frames} frames, {touched} with a touch, {downs} contacts, {counted:?} lost and passed over; memory of the program and of the simulated board {early:?} KiB after a tenth, {end:?} KiB at the end\n{said}",
        start.elapsed().as_secs(),
    );
    assert_eq!(counted, [0, 0]);
    // The first lines, and what was said at the start.
    assert!(events.len() <= 4, "{events:?}");
    // A finger every five minutes, and of many frames few are taken for a touch by chance.
    let fingers = ((seconds - 20.0) / 300.0).ceil();
    let off = downs as f64 - fingers;
    assert!(
        (-1.0..=1.0 + 1e-5 * frames as f64).contains(&off),
        "{downs} contacts of {fingers} fingers"
    );
    (early[0], end[0])
}

#[test]
fn every_frame_of_a_run_is_accounted_for() {
    run(130.0, None);
}

/// As long as SKIN_HOURS says, and recorded into the file that SKIN_HOURS_RECORD names.
#[test]
#[ignore = "as long as SKIN_HOURS says"]
fn a_run_as_long_as_one_likes_takes_no_more_memory() {
    let hours: f64 = std::env::var("SKIN_HOURS").map_or(1.0, |s| s.parse().unwrap());
    let file = std::env::var_os("SKIN_HOURS_RECORD");
    let (early, end) = run(3600.0 * hours, file.as_deref().map(Path::new));
    // Frames wait, up to 64 MB of them, where the board is quicker than the program, as on a busy machine.
    assert!(end <= early + (64 << 10), "{early} {end} KiB");
}
