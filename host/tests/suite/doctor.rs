//! `skin doctor`: healthy boards are fit, and every planted fault is told by the right line with the right exit code.

use crate::json_lines::wrong;
use crate::program::{output, program, said, skin, text};
use serde_json::Value;

/// What is printed, as the schema has it, and the exit code.
fn doctor(arguments: &[&str]) -> (Value, Option<i32>) {
    let run = output(&[&["doctor", "--json"], arguments].concat());
    let value: Value = serde_json::from_slice(&run.stdout).unwrap_or_else(|e| panic!("{e}: {}", said(&run)));
    let schema: Value = serde_json::from_str(include_str!("../../../docs/doctor.schema.json")).unwrap();
    assert_eq!(wrong(&schema, &schema, &value), None);
    let code = run.status.code();
    assert_eq!(code == Some(3), value["fit"] == false, "{code:?}: {}", value["fit"]);
    (value, code)
}

fn line<'a>(examination: &'a Value, name: &str) -> &'a Value {
    let lines = examination["lines"].as_array().unwrap();
    lines.iter().find(|l| l["name"] == name).unwrap()
}

/// Names of the lines with this light, but for those on this computer, which depend on how fast and how full it is.
fn with(examination: &Value, light: &str) -> Vec<String> {
    let lines = examination["lines"].as_array().unwrap().iter();
    let of_board = lines.filter(|l| l["light"] == light && l["name"] != "processor" && l["name"] != "disk");
    of_board.map(|l| l["name"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn healthy_boards_are_fit() {
    for preset in ["ideal", "drawn_board", "sixteen_channels"] {
        let (board, code) = doctor(&["--simulate", "--preset", preset]);
        assert_eq!(code, Some(0), "{preset}: {board}");
        assert_eq!(with(&board, "look"), [""; 0], "{preset}: {board}");
        assert_eq!(with(&board, "bad"), [""; 0], "{preset}: {board}");
        // What a simulated board does not have is never said to be well.
        assert_eq!(
            with(&board, "not_known"),
            ["port", "latency_timer", "baseline"],
            "{preset}"
        );
        assert_eq!(board["board"]["electrodes"], 16);
    }
}

/// A pair without a signal is bad. What clips since it is the largest on the sheet that is described is said to be that.
#[test]
fn a_dead_pair_is_bad_and_large_values_of_a_sheet_are_said_to_be_its() {
    let (board, code) = doctor(&["--simulate", "--fault", "channel_dead:3@0"]);
    assert_eq!(
        (code, with(&board, "bad")),
        (Some(3), vec!["contact".to_owned()]),
        "{board}"
    );
    assert_eq!(
        line(&board, "contact")["electrodes"].as_array().unwrap().len(),
        2,
        "{board}"
    );
    let sheet = concat!(env!("CARGO_MANIFEST_DIR"), "/../sheets/square.toml");
    let (board, _) = doctor(&["--simulate", "--sheet", sheet]);
    let saturation = line(&board, "saturation");
    assert_eq!(saturation["light"], "look", "{board}");
    assert!(
        saturation["text"]
            .as_str()
            .unwrap()
            .contains("the largest on this sheet"),
        "{board}"
    );
}

/// Preset, fault, the line that tells it with its light and cause, and its electrodes.
#[test]
fn every_planted_fault_is_told_by_the_right_line() {
    for (preset, fault, name, light, cause, electrodes) in [
        (
            "drawn_board",
            "electrode_open:3@0",
            "contact",
            "bad",
            "wiring",
            &[3][..],
        ),
        (
            "sixteen_channels",
            "electrode_open:3@0",
            "self_test",
            "bad",
            "wiring",
            &[2, 3, 4],
        ),
        (
            "drawn_board",
            "contact_raised:5,3000@0",
            "contact",
            "look",
            "wiring",
            &[5],
        ),
        (
            "drawn_board",
            "electrodes_short:3,4@0",
            "sheet",
            "bad",
            "wiring",
            &[3, 4],
        ),
        (
            "sixteen_channels",
            "saturation:2@0",
            "saturation",
            "bad",
            "hardware",
            &[],
        ),
        ("drawn_board", "saturation@1", "saturation", "bad", "hardware", &[]),
        ("drawn_board", "wires_swapped:5,6@0", "wiring", "bad", "wiring", &[5, 6]),
        (
            "sixteen_channels",
            "bytes_flipped:0.0003@0",
            "line",
            "bad",
            "wiring",
            &[],
        ),
        (
            "sixteen_channels",
            "bytes_flipped:0.0003@0",
            "frames",
            "bad",
            "wiring",
            &[],
        ),
        (
            "sixteen_channels",
            "converter_overrun:0.01@0",
            "frames",
            "bad",
            "hardware",
            &[],
        ),
        ("drawn_board", "source_lost@0", "source", "bad", "hardware", &[]),
        ("drawn_board", "adc_stuck:2048@0", "self_test", "bad", "hardware", &[]),
        (
            "drawn_board",
            "reference_lost:drive@0",
            "self_test",
            "bad",
            "hardware",
            &[],
        ),
        (
            "drawn_board",
            "reference_lost:converter@0",
            "self_test",
            "bad",
            "hardware",
            &[],
        ),
        ("drawn_board", "amplifier_dead@0", "self_test", "bad", "hardware", &[]),
        (
            "drawn_board",
            "multiplexer_stuck:sense_plus,4@0",
            "sheet",
            "bad",
            "hardware",
            &[4],
        ),
        ("drawn_board", "board_reset@2", "uptime", "bad", "hardware", &[]),
        ("drawn_board", "line_break@2+1", "frames", "bad", "wiring", &[]),
        ("drawn_board", "break_to_board@1+1", "line", "look", "wiring", &[]),
        ("drawn_board", "cable_pulled@2", "frames", "bad", "hardware", &[]),
        ("drawn_board", "source_lost@1.5", "noise", "bad", "wiring", &[]),
    ] {
        let (board, code) = doctor(&["--simulate", "--preset", preset, "--fault", fault]);
        let told = line(&board, name);
        assert_eq!(told["light"], light, "{fault}: {told}");
        assert_eq!(told["cause"], cause, "{fault}: {told}");
        assert!(
            told["do"].as_str().is_some_and(|what| !what.is_empty()),
            "{fault}: {told}"
        );
        if !electrodes.is_empty() {
            assert_eq!(told["electrodes"], serde_json::json!(electrodes), "{fault}: {told}");
        }
        assert_eq!(code, Some(if light == "bad" { 3 } else { 0 }), "{fault}");
    }
}

#[test]
fn without_a_board_the_computer_is_examined_all_the_same() {
    let (none, code) = doctor(&["--port", "/dev/no-such-port"]);
    assert_eq!(code, Some(3));
    assert_eq!(with(&none, "bad"), ["port"]);
    assert_eq!(with(&none, "ok"), [""; 0]);
    assert_eq!(none["board"], Value::Null);
    assert_ne!(line(&none, "disk")["light"], "bad");
    // What is there and is no serial port, too.
    let (other, code) = doctor(&["--port", "/dev/null"]);
    assert_eq!(
        (code, line(&other, "port")["cause"].as_str()),
        (Some(3), Some("software")),
        "{other}"
    );
    let run = output(&["doctor", "--port", "/dev/no-such-port", "--simulate"]);
    assert_eq!(run.status.code(), Some(2));
}

/// By a port, whose board's time is this computer's. What depends on how fast that is, or on the touch of the scene, is not looked at.
#[cfg(target_os = "linux")]
#[test]
fn a_board_behind_a_port_is_asked_by_it() {
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("board");
    let _board = crate::reconnect::simulated(&port);
    let state = folder.path().join("state");
    let (board, _) = doctor(&["--port", text(&port), "--state-dir", text(&state), "--seconds", "0.5"]);
    for (name, light) in [
        ("port", "ok"),
        ("board", "ok"),
        ("self_test", "ok"),
        ("latency_timer", "not_known"),
        ("baseline", "look"),
    ] {
        assert_eq!(line(&board, name)["light"], light, "{name}: {board}");
    }
    assert!(
        line(&board, "rate")["figures"]["arrived_per_s"].as_f64() > Some(0.0),
        "{board}"
    );
}

/// A recording has frames and no board: what it cannot say is not known, and never said to be well.
#[test]
fn a_recording_says_what_it_can() {
    let folder = tempfile::tempdir().unwrap();
    let record = |name: &str, scene: &str| {
        let (file, toml) = (folder.path().join(name), folder.path().join("scene.toml"));
        std::fs::write(&toml, scene).unwrap();
        let arguments = [
            "run",
            "--json",
            "--scene",
            text(&toml),
            "--frames",
            "40",
            "--record",
            text(&file),
        ];
        assert!(output(&arguments).status.success());
        file
    };
    let well = record("well.mcap", "duration_s = 60.0\n");
    let (board, code) = doctor(&["--from", text(&well), "--seconds", "0.5"]);
    assert_eq!(code, Some(0), "{board}");
    let not_known = ["port", "self_test", "source", "latency_timer", "baseline"];
    assert_eq!(with(&board, "not_known"), not_known, "{board}");
    assert_eq!(with(&board, "look"), [""; 0], "{board}");
    // A wire that was off as the baseline was taken.
    let open = "duration_s = 60.0\n[[fault]]\nat_s = 0.0\nkind = { electrode_open = { electrode = 7 } }\n";
    let (board, code) = doctor(&["--from", text(&record("open.mcap", open)), "--seconds", "0.5"]);
    assert_eq!(code, Some(3));
    assert_eq!(line(&board, "contact")["electrodes"], serde_json::json!([7]), "{board}");
    let missing = output(&["doctor", "--from", "no-such-file.mcap"]);
    assert_eq!(missing.status.code(), Some(1));
}

#[test]
fn people_read_words_and_no_escape_sequences_in_a_pipe() {
    let words = skin(&["doctor", "--simulate", "--seconds", "0.5"]);
    assert_eq!(
        words.lines().filter(|l| l.starts_with("not known  ")).count(),
        3,
        "{words}"
    );
    assert!(words.contains("\nok         self test      passed\n"), "{words}");
    assert!(
        !words.contains('\x1b') && words.lines().last().unwrap().starts_with("fit"),
        "{words}"
    );
    let unfit = output(&["doctor", "--simulate", "--fault", "electrode_open:3@0"]);
    let words = String::from_utf8(unfit.stdout.clone()).unwrap();
    assert!(words.contains("wiring: look at the clamp"), "{words}");
    assert!(
        words.lines().last().unwrap().starts_with("unfit: self test, contact"),
        "{words}"
    );
    assert!(said(&unfit).contains("unfit"), "{}", said(&unfit));
    assert_eq!(
        program(&["doctor", "--simulate", "--seconds", "0"])
            .output()
            .unwrap()
            .status
            .code(),
        Some(2)
    );
}

/// The files of a zip archive that is not compressed, by its local headers: name and bytes.
fn unzipped(archive: &[u8]) -> Vec<(String, Vec<u8>)> {
    let number = |at: usize, size: usize| {
        let bytes = archive[at..at + size].iter().rev();
        bytes.fold(0usize, |n, b| n << 8 | usize::from(*b))
    };
    let (mut at, mut files) = (0, Vec::new());
    while archive[at..].starts_with(b"PK\x03\x04") {
        let (size, name, extra) = (number(at + 18, 4), number(at + 26, 2), number(at + 28, 2));
        let start = at + 30 + name + extra;
        let name = String::from_utf8(archive[at + 30..at + 30 + name].to_vec()).unwrap();
        files.push((name, archive[start..start + size].to_vec()));
        at = start + size;
    }
    assert!(archive[at..].starts_with(b"PK\x01\x02"));
    files
}

/// The files of a report, and what was said while it was made.
fn report(
    folder: &std::path::Path,
    arguments: &[&str],
    environment: &[(&str, &str)],
) -> (Vec<(String, String)>, String) {
    let file = folder.join("report.zip");
    let mut command = program(&[&["report", text(&file)], arguments].concat());
    let run = command.envs(environment.iter().copied()).output().unwrap();
    assert_eq!(run.status.code(), Some(0), "{}", said(&run));
    let files = unzipped(&std::fs::read(&file).unwrap());
    match std::process::Command::new("python3")
        .args(["-m", "zipfile", "-t", text(&file)])
        .output()
    {
        Ok(python) => assert!(python.status.success(), "{python:?}"),
        Err(why) => eprintln!("not tried: python3: {why}"),
    }
    // Nothing is left beside it.
    let left: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    assert!(
        left.iter().all(|name| !name.to_str().unwrap().contains("report.zip.")),
        "{left:?}"
    );
    let recording = files.iter().find(|(name, _)| name == "recording.mcap");
    if let Some((_, bytes)) = recording {
        std::fs::write(folder.join("of-report.mcap"), bytes).unwrap();
    }
    let texts = files
        .into_iter()
        .map(|(name, bytes)| (name, String::from_utf8_lossy(&bytes).into_owned()));
    (texts.collect(), said(&run))
}

fn names(files: &[(String, String)]) -> Vec<&str> {
    files.iter().map(|(name, _)| name.as_str()).collect()
}

#[test]
fn a_report_holds_what_it_says_and_its_recording_tells_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("config.toml");
    let home = folder.path().join("a-name");
    std::fs::create_dir(&home).unwrap();
    std::fs::write(&config, format!("calibration = {:?}\n", home.join("none.toml"))).unwrap();
    let environment = [("SKIN_CONFIG", text(&config)), ("HOME", text(&home))];
    let arguments = ["--simulate", "--preset", "drawn_board", "--fault", "electrode_open:3@0"];
    let (files, said) = report(folder.path(), &arguments, &environment);
    let expected = [
        "README.txt",
        "doctor.txt",
        "doctor.json",
        "versions.json",
        "settings.txt",
        "log.txt",
        "recording.mcap",
        "config.toml",
    ];
    assert_eq!(names(&files), expected, "{said}");
    let of = |name: &str| &files.iter().find(|(n, _)| n == name).unwrap().1;
    // All that is inside, and what is not, is said.
    for name in &expected[1..] {
        assert!(
            said.contains(&format!("- {name}: ")) && of("README.txt").contains(name),
            "{name}: {said}"
        );
    }
    assert!(
        said.contains("- no calibration.toml (") && said.contains("- no baseline.toml ("),
        "{said}"
    );
    assert!(said.contains("Personal in it"), "{said}");
    // What was said while it was made.
    assert!(
        of("log.txt").contains("measuring a simulated board for 3.0 s") && !said.contains("warning"),
        "{}: {said}",
        of("log.txt")
    );
    for (name, text) in files.iter().filter(|(name, _)| name != "recording.mcap") {
        assert!(!text.contains(home.to_str().unwrap()), "{name}: {text}");
    }
    assert!(of("config.toml").contains("~/none.toml"), "{}", of("config.toml"));
    let found: Value = serde_json::from_str(of("doctor.json")).unwrap();
    assert_eq!(line(&found, "contact")["electrodes"], serde_json::json!([3]));
    let recording = folder.path().join("of-report.mcap");
    let (again, _) = doctor(&["--from", text(&recording)]);
    for name in ["contact", "wiring", "sheet"] {
        // The recording's baseline is of fewer frames.
        for part in ["light", "electrodes", "cause"] {
            assert_eq!(line(&again, name)[part], line(&found, name)[part], "{name}");
        }
    }
    // The self-test that is recorded in it is judged as the live one.
    let hello = |arguments: &[&str]| {
        let run = output(&[&["hello", "--json"], arguments].concat());
        let value: Value = serde_json::from_slice(&run.stdout).unwrap();
        (value["self_test"]["failed"].clone(), run.status.code())
    };
    let recorded = hello(&["--from", text(&recording)]);
    assert_eq!(recorded, hello(&arguments));
    assert_eq!(recorded, (serde_json::json!(["electrodes"]), Some(1)));
    // The recording makes a report, too.
    let (files, _) = report(folder.path(), &["--from", text(&recording)], &environment);
    assert!(names(&files).contains(&"recording.mcap"));
}

#[test]
fn without_a_board_there_is_a_report_that_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let none = [("SKIN_CONFIG", "/dev/null")];
    let (files, said) = report(folder.path(), &["--port", "/dev/no-such-port"], &none);
    assert!(!names(&files).contains(&"recording.mcap"));
    assert!(
        said.contains("- no recording.mcap (") && said.contains("no-such-port"),
        "{said}"
    );
    let (_, found) = files.iter().find(|(name, _)| name == "doctor.txt").unwrap();
    assert!(found.contains("unfit: port"), "{found}");
}
