//! `skin calibrate presses` on the simulated skin, with a simulated finger or robot; nothing here depends on how fast the machine is.

use serde_json::Value;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

struct Ran {
    out: String,
    said: String,
    code: Option<i32>,
}

/// Runs the program in a folder, with these keys pressed.
fn skin(folder: &Path, arguments: &[&str], keys: &str) -> Ran {
    let mut child = Command::new(env!("CARGO_BIN_EXE_skin"))
        .current_dir(folder)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // Dropped, so that its end is seen.
    child.stdin.take().unwrap().write_all(keys.as_bytes()).unwrap();
    let out = child.wait_with_output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Ran {
        code: out.status.code(),
        out: text(out.stdout),
        said: text(out.stderr),
    }
}

/// A scene of rubber that does not creep, which nobody touches.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let text = "duration_s = 1.0\n[material]\nkind = \"elastic\"\n";
    std::fs::write(folder.path().join("rubber.toml"), text).unwrap();
    folder
}

/// Presses on that scene.
fn on_rubber(folder: &Path, arguments: &[&str], keys: &str) -> Ran {
    let presses = ["calibrate", "presses", "--scene", "rubber.toml"];
    skin(folder, &[&presses[..], arguments].concat(), keys)
}

/// Columns of a CSV by their names.
fn columns<const N: usize>(path: &Path, names: [&str; N]) -> Vec<[f64; N]> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let at = names.map(|name| header.iter().position(|h| *h == name).unwrap());
    lines
        .map(|line| {
            let fields: Vec<&str> = line.split(',').collect();
            at.map(|k| fields[k].parse().unwrap())
        })
        .collect()
}

/// A finger that is guided over the simulated skin gives a calibration that locates the presses of another run, and their forces.
#[test]
fn a_guided_run_gives_a_calibration_that_finds_other_presses_and_their_forces() {
    let folder = folder();
    let path = folder.path();
    let guided = ["--count", "20", "--json", "--state-dir", "state"];
    let taught = on_rubber(path, &guided, "n\n");
    assert_eq!(taught.code, Some(0), "{}", taught.said);
    for said in [
        "taking the baseline, do not touch",
        "skipped: x ",
        "mm from the middle towards electrode",
        "press 1 of 20 at x ",
        "press 20 taken: ",
        " before put it at ",
        "skin.table.csv, skin.presses.csv: what was taken",
        "stored; skin run loads it by itself",
    ] {
        assert!(taught.said.contains(said), "{said}: {}", taught.said);
    }
    let found: Value = serde_json::from_str(&taught.out).unwrap();
    assert_eq!(
        (&found["presses"], &found["forces_known"]),
        (&20.into(), &20.into()),
        "{found}"
    );
    let skipped = taught.said.lines().find(|line| line.starts_with("skipped: ")).unwrap();
    let places = columns(&path.join("skin.presses.csv"), ["x_mm", "y_mm"]);
    assert_eq!(places.len(), 20);
    assert!(
        places
            .iter()
            .all(|[x, y]| !skipped.contains(&format!("x {x:.1}, y {y:.1} mm"))),
        "{skipped}"
    );
    // The rim is among them.
    assert!(places.iter().any(|[x, y]| x.hypot(*y) > 97.5 - 7.0), "{places:?}");

    let marks = "x_mm,y_mm\n20,31\n-42,8\n3,-25\n-18,47\n50,-12\n-60,-35\n";
    std::fs::write(path.join("others.csv"), marks).unwrap();
    let others = [
        "--marks",
        "others.csv",
        "--count",
        "6",
        "--seed",
        "7",
        "--out",
        "others.cal",
    ];
    let others = on_rubber(path, &others, "");
    assert_eq!(others.code, Some(0), "{}", others.said);
    // On a sheet as the model has it the model is better; told that it is not, the presses have to do.
    let file = path.join("skin.cal");
    let text = std::fs::read_to_string(&file).unwrap();
    assert!(
        text.contains("kind = \"skin\"\nversion = 4\n") && text.contains("sheet_sha256 = "),
        "{}",
        &text[..900]
    );
    std::fs::write(&file, text.replace("better = true", "better = false")).unwrap();
    let located = [
        "reconstruct",
        "others.table.csv",
        "--before",
        "others.presses.csv",
        "--calibration",
        "skin.cal",
        "--json",
    ];
    let located = skin(path, &located, "");
    assert_eq!(located.code, Some(0), "{}", located.said);
    let truth = columns(&path.join("others.presses.csv"), ["x_mm", "y_mm", "force_n"]);
    assert_eq!((truth.len(), located.out.lines().count()), (6, 6));
    let mut off: Vec<f64> = Vec::new();
    for (line, [x, y, force_n]) in located.out.lines().zip(&truth) {
        let frame: Value = serde_json::from_str(line).unwrap();
        let touches = frame["touches"].as_array().unwrap();
        assert_eq!(touches.len(), 1, "{line}");
        let at = |name: &str| touches[0][name].as_f64().unwrap();
        off.push((at("x_mm") - x).hypot(at("y_mm") - y));
        assert!((at("force_n") / force_n - 1.0).abs() < 0.35, "{line}: {force_n} N");
    }
    off.sort_by(f64::total_cmp);
    // As near as was told, or nearer. Its model is better still, and is used.
    let told = found["error_median_mm"].as_f64().unwrap();
    assert!(told < 5.0 && off[2] < told && off[5] < 7.5, "{off:?}, {told}");

    // Whatever happens to the file, it is of this sheet.
    let other = "sheet_resistance_ohm = 1000.0\noutline = { kind = \"disc\", diameter_mm = 150.0 }\n[electrode_ring]\ncount = 16\nwidth_mm = 8.0\ncontact_mm = 1.0\n";
    std::fs::write(path.join("other.toml"), other).unwrap();
    let run = ["run", "--simulate", "--json", "--frames", "2", "--state-dir", "state"];
    let refused = skin(
        path,
        &[&run[..], &["--sheet", "other.toml", "--calibration", "skin.cal"]].concat(),
        "",
    );
    assert_eq!(refused.code, Some(1), "{}", refused.said);
    assert!(
        refused.said.contains("made on another sheet") && refused.said.contains("--calibration none"),
        "{}",
        refused.said
    );
    // The one that is stored for the board is loaded by itself, and said.
    let header = |ran: &Ran| -> Value { serde_json::from_str(ran.out.lines().next().unwrap()).unwrap() };
    let by_itself = skin(path, &run, "");
    assert_eq!(by_itself.code, Some(0), "{}", by_itself.said);
    assert!(
        by_itself.said.contains("--calibration none does without"),
        "{}",
        by_itself.said
    );
    assert_eq!(header(&by_itself)["calibration"]["stored"], true);
    let without = skin(path, &[&run[..], &["--calibration", "none"]].concat(), "");
    assert!(
        header(&without).get("calibration").is_none() && without.code == Some(0),
        "{}",
        without.said
    );
    let elsewhere = skin(path, &[&run[..], &["--sheet", "other.toml"]].concat(), "");
    assert!(
        elsewhere.said.contains("is not used: ") && elsewhere.said.contains("another sheet"),
        "{}",
        elsewhere.said
    );
    assert!(header(&elsewhere).get("calibration").is_none());

    // The rubber's creep goes into the same file, and the presses stay in it.
    let mut hold = "time_s,rise_mm2,force_n\n".to_owned();
    for k in 0..300 {
        let t = 0.1 * f64::from(k);
        let (on, off) = ((t - 2.0).max(0.0), (t - 20.0).max(0.0));
        let grown = |t: f64| 1.0 - (-t / 5.0).exp();
        let force = if (2.0..20.0).contains(&t) { 20.0 } else { 0.0 };
        let rise = 4.0 * (force + 20.0 * 0.3 * (grown(on) - grown(off)));
        hold += &format!("{t:.2},{rise:.4},{force}\n");
    }
    std::fs::write(path.join("hold.csv"), hold).unwrap();
    let creep = skin(path, &["calibrate", "hold.csv", "--out", "skin.cal"], "");
    assert_eq!(creep.code, Some(0), "{}", creep.said);
    assert!(
        creep.said.contains("the presses that were in it are kept"),
        "{}",
        creep.said
    );
    let text = std::fs::read_to_string(&file).unwrap();
    assert!(text.contains("[rubber]") && text.contains("[presses.learned") && text.contains("[force]"));
}

/// G-code's list of positions leads a simulated robot, whose presses are found in the stream by their times.
#[test]
fn a_robots_list_says_where_the_presses_of_a_stream_were() {
    let folder = folder();
    let path = folder.path();
    let gcode = [
        "calibrate",
        "gcode",
        "--count",
        "6",
        "--out",
        "press.gcode",
        "--bed-mm",
        "250,250",
        "--origin-mm",
        "125,125",
    ];
    let made = skin(path, &gcode, "");
    assert_eq!(made.code, Some(0), "{}", made.said);
    let robot = ["--positions", "press.csv", "--out", "robot.cal"];
    let ran = on_rubber(path, &robot, "");
    assert_eq!(ran.code, Some(0), "{}", ran.said);
    let listed = columns(&path.join("press.csv"), ["x_mm", "y_mm"]);
    let found = columns(&path.join("robot.presses.csv"), ["x_mm", "y_mm"]);
    assert_eq!(found, listed);
    let wrong = ["--positions", "nowhere.csv"];
    let wrong = on_rubber(path, &wrong, "");
    assert!(
        wrong.code == Some(1) && wrong.said.contains("nowhere.csv"),
        "{}",
        wrong.said
    );
}

/// A list whose lines have the places of other presses from somewhere on is refused with its line, and presses at wrong places are left out:
/// the sheet's model, which knows nothing of the list, tells both.
#[test]
fn a_list_that_does_not_fit_its_presses_is_said() {
    let folder = folder();
    let path = folder.path();
    let guided = ["--count", "20", "--json"];
    let taught = on_rubber(path, &guided, "");
    assert_eq!(taught.code, Some(0), "{}", taught.said);
    let found: Value = serde_json::from_str(&taught.out).unwrap();
    assert!(
        found["gross"].as_array().unwrap().is_empty() && found["unreached"].is_null(),
        "{found}"
    );
    let text = std::fs::read_to_string(path.join("skin.presses.csv")).unwrap();
    let places = columns(&path.join("skin.presses.csv"), ["x_mm", "y_mm"]);
    let with = |name: &str, place: &dyn Fn(usize) -> [f64; 2]| {
        let mut lines = text.lines();
        let mut out = lines.next().unwrap().to_owned() + "\n";
        for (k, line) in lines.enumerate() {
            let fields: Vec<&str> = line.split(',').collect();
            let [x, y] = place(k);
            out += &format!("{},{},{x},{y},{},{}\n", fields[0], fields[1], fields[4], fields[5]);
        }
        std::fs::write(path.join(name), out).unwrap();
    };
    let learn = |list: &str, more: &[&str]| {
        let learn = [
            "calibrate",
            "presses",
            "skin.table.csv",
            "--truth",
            list,
            "--out",
            "again.cal",
            "--json",
        ];
        skin(path, &[&learn[..], more].concat(), "")
    };
    // From the tenth press on each line has the place of the press after: that of line 11 is in line 10.
    with("skipped.csv", &|k| places[if k < 9 { k } else { (k + 1) % 20 }]);
    let refused = learn("skipped.csv", &[]);
    assert_eq!(refused.code, Some(1), "{}", refused.said);
    let line: usize = refused
        .said
        .split("skipped.csv:")
        .nth(1)
        .unwrap()
        .split(':')
        .next()
        .unwrap()
        .parse()
        .unwrap();
    assert!((10..=13).contains(&line), "{}", refused.said);
    assert!(
        refused.said.contains("the line before theirs") && refused.said.contains("--as-listed"),
        "{}",
        refused.said
    );
    assert!(!path.join("again.cal").exists());
    let as_listed = learn("skipped.csv", &["--as-listed"]);
    assert_eq!(as_listed.code, Some(0), "{}", as_listed.said);
    let found: Value = serde_json::from_str(&as_listed.out).unwrap();
    assert_eq!(
        (&found["shifted"]["by"], &found["shifted"]["line"]),
        (&(-1).into(), &line.into()),
        "{found}"
    );

    // Five of twenty on the other side of the sheet.
    let wrong: Vec<usize> = (0..20)
        .filter(|k| places[*k][0].hypot(places[*k][1]) > 50.0)
        .step_by(2)
        .take(5)
        .collect();
    with("wrong.csv", &|k| {
        places[k].map(|v| if wrong.contains(&k) { -v } else { v })
    });
    let without = learn("wrong.csv", &[]);
    assert_eq!(without.code, Some(0), "{}", without.said);
    let found: Value = serde_json::from_str(&without.out).unwrap();
    let names: Vec<String> = wrong.iter().map(|k| format!("p{k}")).collect();
    assert_eq!(found["gross"], serde_json::json!(names), "{found}");
    assert_eq!(found["model"]["better"], true, "{found}");
    assert!(
        found["model"]["error_95th_percentile_mm"].as_f64().unwrap() < 1.0,
        "{found}"
    );
}

/// Presses cost an hour of somebody's or of a robot's time: none is overwritten, and what cannot be written is found before the first.
#[test]
fn nothing_of_earlier_presses_is_overwritten_and_what_cannot_be_written_is_found_first() {
    let folder = folder();
    let path = folder.path();
    let guided = |more: &[&str]| {
        let five = ["--count", "5"];
        on_rubber(path, &[&five[..], more].concat(), "")
    };
    // The rubber's creep that is there stays, and presses go beside it.
    let creep = "kind = \"skin\"\nversion = 4\n[of]\n[rubber]\ndelayed_ratio = 0.3\ntau_s = 5.0\nexponent = 1.0\nunit_rise_mpa = 0.25\nforce_sd_n = 0.1\n";
    std::fs::write(path.join("skin.cal"), creep).unwrap();
    // A table's frames need a time for it.
    let table = [
        "reconstruct",
        "table.csv",
        "--baseline",
        "1",
        "--calibration",
        "skin.cal",
    ];
    let refused = skin(path, &table, "");
    assert!(
        refused.code == Some(2) && refused.said.contains("--frame-s"),
        "{}",
        refused.said
    );
    let first = guided(&[]);
    assert_eq!(first.code, Some(0), "{}", first.said);
    assert!(
        first.said.contains("the rubber's creep that was in it is kept"),
        "{}",
        first.said
    );
    let files = ["skin.table.csv", "skin.presses.csv", "skin.cal"];
    let read = || files.map(|file| std::fs::read_to_string(path.join(file)).unwrap());
    let before = read();
    let again = guided(&["--seed", "9"]);
    assert_eq!(again.code, Some(1), "{}", again.said);
    for said in files.iter().chain(&["--out"]) {
        assert!(again.said.contains(said), "{said}: {}", again.said);
    }
    assert!(
        !again.said.contains("taking the baseline") && read() == before,
        "{}",
        again.said
    );
    for out in ["nowhere/skin.cal", "."] {
        let refused = guided(&["--out", out]);
        assert_eq!(refused.code, Some(1), "{out}: {}", refused.said);
        assert!(!refused.said.contains("taking the baseline"), "{out}: {}", refused.said);
    }
    // A folder that cannot be made, since a file is there.
    let refused = guided(&["--out", "other.cal", "--state-dir", "rubber.toml"]);
    assert_eq!(refused.code, Some(1), "{}", refused.said);
    assert!(
        refused.said.contains("name another folder with --state-dir") && !refused.said.contains("taking the baseline"),
        "{}",
        refused.said
    );
    // From the table the calibration is made again.
    let table = ["calibrate", "presses", files[0], "--truth", files[1]];
    assert_eq!(skin(path, &table, "").code, Some(0));
    // Marks in another unit.
    std::fs::write(path.join("marks.csv"), "x_mm,y_mm\n0,0\n500,0\n0,50\n-50,0\n30,30\n").unwrap();
    let off = guided(&["--marks", "marks.csv", "--out", "off.cal"]);
    assert_eq!(off.code, Some(1), "{}", off.said);
    assert!(
        off.said.contains("marks.csv:3: x 500.0, y 0.0 mm is not on the sheet")
            && !off.said.contains("taking the baseline"),
        "{}",
        off.said
    );
}

/// A list that lacks a press does not end the recording before its last one.
#[test]
fn a_recording_is_read_to_its_end_whatever_the_list_lacks() {
    let folder = folder();
    let path = folder.path();
    let places = [[0, 0], [22, 66], [78, 49], [33, 11], [-72, -57], [-66, 0], [40, -82]];
    let mut scene = "duration_s = 30.0\n[material]\nkind = \"elastic\"\n".to_owned();
    let mut list = "t_s,x_mm,y_mm\n".to_owned();
    let mut at_s = 2.5;
    for (k, [x, y]) in places.iter().enumerate() {
        scene += &format!(
            "[[touch]]\nshape = \"finger\"\npress = {{ at_s = {at_s:.3}, for_s = 1.2, ramp_s = 0.1, x_mm = {x}.0, y_mm = {y}.0, force_n = 12.0 }}\n"
        );
        if k != 1 {
            list += &format!("{at_s:.3},{x},{y}\n");
        }
        at_s += 2.5 + 0.3 * (k as f64 * 2.3).sin();
    }
    std::fs::write(path.join("robot.toml"), scene).unwrap();
    std::fs::write(path.join("list.csv"), list).unwrap();
    let recorded = skin(
        path,
        &["record", "robot.mcap", "--scene", "robot.toml", "--seconds", "19"],
        "",
    );
    assert_eq!(recorded.code, Some(0), "{}", recorded.said);
    let ran = skin(
        path,
        &[
            "calibrate",
            "presses",
            "--from",
            "robot.mcap",
            "--positions",
            "list.csv",
        ],
        "",
    );
    assert_eq!(ran.code, Some(0), "{}", ran.said);
    let found = columns(&path.join("skin.presses.csv"), ["x_mm", "y_mm"]);
    let listed = columns(&path.join("list.csv"), ["x_mm", "y_mm"]);
    assert_eq!(found, listed, "{}", ran.said);
    assert!(
        ran.said.contains("1 presses of the stream are not in the list") && !ran.said.contains("were not found"),
        "{}",
        ran.said
    );
}
