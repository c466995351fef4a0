//! `skin run --calibration` with a calibration from presses, on the simulated board: taught by presses of one scene, it finds those of
//! another.

use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// Presses that teach, and presses to be found.
const TAUGHT: usize = 24;
const FOUND: [[f64; 2]; 5] = [[20.0, 31.0], [-42.0, 8.0], [3.0, -25.0], [-18.0, 47.0], [50.0, -12.0]];

fn taught() -> Vec<[f64; 2]> {
    let place = |k: usize| {
        let (angle, radius) = (2.399_963 * k as f64, 60.0 * ((k as f64 + 0.5) / TAUGHT as f64).sqrt());
        [angle.cos() * radius, angle.sin() * radius].map(|v| (10.0 * v).round() / 10.0)
    };
    // In an order that jumps.
    (0..TAUGHT).map(|k| place(k * 17 % TAUGHT)).collect()
}

/// A press a second, for 0.4 s, on rubber that does not creep.
fn scene(places: &[[f64; 2]]) -> String {
    let mut text = format!("duration_s = {}.0\n[material]\nkind = \"elastic\"\n", places.len() + 1);
    for (k, [x, y]) in places.iter().enumerate() {
        writeln!(
            text,
            "[[touch]]\nshape = \"finger\"\npress = {{ at_s = {k}.6, for_s = 0.4, ramp_s = 0.05, x_mm = {x}, y_mm = {y}, force_n = 15.0 }}"
        )
        .unwrap();
    }
    text
}

struct Run {
    out: String,
    said: String,
    code: Option<i32>,
}

fn skin(folder: &Path, arguments: &[&str]) -> Run {
    let out = Command::new(env!("CARGO_BIN_EXE_skin"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Run {
        code: out.status.code(),
        out: text(out.stdout),
        said: text(out.stderr),
    }
}

/// A folder with the scene `use.toml` and a calibration of the simulated board's own frames, `skin.cal`.
fn calibrated() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("teach.toml"), scene(&taught())).unwrap();
    std::fs::write(path.join("use.toml"), scene(&FOUND)).unwrap();
    let made = skin(path, &["sim", "--scene", "teach.toml", "--every-s", "0.05"]);
    assert_eq!(made.code, Some(0), "{}", made.said);
    let header = made.out.lines().find(|l| l.starts_with("drive_a")).unwrap();
    let frames: Vec<&str> = header.split(',').skip(4).collect();
    let at = |time_s: f64| {
        let off = |name: &&&str| (1e3 * (name[1..].parse::<f64>().unwrap() - time_s).abs()) as u64;
        frames.iter().min_by_key(off).unwrap()
    };
    let mut list = "frame,before,x_mm,y_mm\n".to_owned();
    for (k, [x, y]) in taught().iter().enumerate() {
        let began_s = k as f64 + 0.6;
        writeln!(list, "{},{},{x},{y}", at(began_s + 0.25), at(began_s - 0.1)).unwrap();
    }
    std::fs::write(path.join("teach.csv"), &made.out).unwrap();
    std::fs::write(path.join("presses.csv"), list).unwrap();
    let made = skin(path, &["calibrate", "presses", "teach.csv", "--truth", "presses.csv"]);
    assert_eq!(made.code, Some(0), "{}", made.said);
    folder
}

fn lines(out: &str, kind: &str) -> Vec<Value> {
    let lines = out.lines().map(|l| serde_json::from_str::<Value>(l).unwrap());
    lines.filter(|l| l["kind"] == kind).collect()
}

/// Where the simulated sheet is as the model has it, the model is used; told that it is not, presses alone find the others, one touch at
/// a time and each at its place, and the replay of the recording finds the same.
#[test]
fn touches_are_found_live_by_what_presses_taught() {
    let folder = calibrated();
    let path = folder.path();
    let live = [
        "run",
        "--scene",
        "use.toml",
        "--json",
        "--calibration",
        "skin.cal",
        "--frames",
    ];
    let by_model = skin(path, &[&live[..], &["5"]].concat());
    assert!(
        by_model.said.contains("the sheet's model located its presses better"),
        "{}",
        by_model.said
    );
    assert!(lines(&by_model.out, "header")[0].get("learned_from").is_none());

    let file = path.join("skin.cal");
    let text = std::fs::read_to_string(&file).unwrap();
    assert_eq!(text.matches("better = true").count(), 1);
    std::fs::write(&file, text.replace("better = true", "better = false")).unwrap();
    let run = skin(
        path,
        &[&live[..], &["640", "--every-frame", "--record", "live.mcap"]].concat(),
    );
    assert_eq!(run.code, Some(0), "{}", run.said);
    assert!(run.said.contains("skin.cal, of 24 presses"), "{}", run.said);
    let header = &lines(&run.out, "header")[0];
    assert_eq!(header["learned_from"], 24);
    assert!(header["units"]["rise"].as_str().unwrap().starts_with("strength"));
    let pictures = lines(&run.out, "picture");
    let touches: Vec<&Vec<Value>> = pictures.iter().map(|p| p["touches"].as_array().unwrap()).collect();
    assert_eq!(touches.len(), 640);
    assert!(touches.iter().all(|t| t.len() <= 1), "two touches");
    // 0.4 s of every second is pressed.
    let touched = touches.iter().filter(|t| t.len() == 1).count();
    assert!((200..330).contains(&touched), "{touched}");
    let mut seen = [0; FOUND.len()];
    let mut far = 0;
    for touch in touches.iter().filter_map(|t| t.first()) {
        let at = ["x_mm", "y_mm"].map(|key| touch[key].as_f64().unwrap());
        let near = (0..FOUND.len()).find(|k| (at[0] - FOUND[*k][0]).hypot(at[1] - FOUND[*k][1]) < 5.0);
        match near {
            Some(k) => seen[k] += 1,
            None => far += 1,
        }
        assert!(touch.get("force_n").is_none(), "{touch}");
    }
    assert!(far * 20 <= touched, "{far} of {touched} are far from every place");
    assert!(seen.iter().all(|n| *n >= 30), "{seen:?}");
    let replayed = skin(path, &["replay", "live.mcap", "--json", "--speed", "max"]);
    assert!(
        replayed
            .said
            .contains("640 pictures, every one with the recorded touches"),
        "{}",
        replayed.said
    );
    assert_eq!(lines(&replayed.out, "header")[0]["learned_from"], 24);

    // Options of the model.
    let refused = skin(path, &[&live[..], &["1", "--trust-electrodes"]].concat());
    assert!(
        refused.code == Some(2) && refused.said.contains("leave out --trust-electrodes"),
        "{}",
        refused.said
    );
}
