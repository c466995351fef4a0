//! `skin calibrate presses` and `skin reconstruct --calibration`, on a made-up skin that turns with its electrodes.

use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

fn skin() -> Command {
    Command::new(env!("CARGO_BIN_EXE_skin"))
}

/// Places of presses, spread by the golden angle over a disc of 50 mm, in an order that jumps.
fn places(count: usize) -> Vec<[f64; 2]> {
    (0..count)
        .map(|k| {
            let k = (k * 17) % count;
            let (angle, radius) = (2.399_963 * k as f64, 50.0 * ((k as f64 + 0.5) / count as f64).sqrt());
            [angle.cos() * radius, angle.sin() * radius]
        })
        .collect()
}

/// What a press does to a sense pair `offset` electrodes on from the drive electrode, which is turned by so many: the product of two
/// fields, as on a disc of 62 mm radius. But the sense electrodes are a tenth of a turn from where they are said to be.
fn response(offset: usize, turned: usize, place: [f64; 2]) -> f64 {
    let field = |electrode: f64| {
        let (sin, cos) = (TAU * electrode / 16.0).sin_cos();
        let to = [place[0] / 62.0 - cos, place[1] / 62.0 - sin];
        to.map(|v| v / (to[0] * to[0] + to[1] * to[1]))
    };
    let pair = |plus: f64, minus: f64| {
        let [a, b] = [field(plus), field(minus)];
        [a[0] - b[0], a[1] - b[1]]
    };
    let drive = turned as f64;
    let sense = drive + offset as f64 + 1.6;
    let [u, v] = [pair(drive, drive + 8.0), pair(sense + 1.0, sense)];
    u[0] * v[0] + u[1] * v[1]
}

/// A table of opposite drive pairs with a frame before each press, or of changes alone, and the list of presses.
fn write(folder: &Path, places: &[[f64; 2]], known: usize, difference: bool) {
    let mut table = "drive_a,drive_b,sense_a,sense_b".to_owned();
    for k in 0..places.len() {
        table += &if difference {
            format!(",p{k}")
        } else {
            format!(",u{k},p{k}")
        };
    }
    table.push('\n');
    for drive in 0..16 {
        for offset in (1..7).chain(9..15) {
            let sense = (drive + offset) % 16;
            let electrode = |e: usize| e % 16 + 1;
            write!(table, "{},{}", electrode(drive), electrode(drive + 8)).unwrap();
            write!(table, ",{},{}", electrode(sense), electrode(sense + 1)).unwrap();
            for (k, place) in places.iter().enumerate() {
                // A drift, and noise of a fixed pattern.
                let before = 5.0 + 0.01 * k as f64;
                let noise = 0.02 * ((k * 7919 + drive * 104_729 + offset * 1_299_709) as f64).sin();
                let change = response(offset, drive, *place) + noise;
                if difference {
                    write!(table, ",{change}").unwrap();
                } else {
                    write!(table, ",{before},{}", before + change).unwrap();
                }
            }
            table.push('\n');
        }
    }
    std::fs::write(folder.join("table.csv"), table).unwrap();
    let list = |rows: std::ops::Range<usize>| {
        let mut text = "frame,before,x_mm,y_mm\n".to_owned();
        for k in rows {
            let before = if difference { String::new() } else { format!("u{k}") };
            writeln!(text, "p{k},{before},{},{}", places[k][0], places[k][1]).unwrap();
        }
        text
    };
    std::fs::write(folder.join("known.csv"), list(0..known)).unwrap();
    std::fs::write(folder.join("all.csv"), list(0..places.len())).unwrap();
}

#[test]
fn twenty_presses_locate_the_others_and_frames_before_are_as_good_as_changes() {
    let places = places(60);
    let mut lines = Vec::new();
    for difference in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &places, 20, difference);
        let mut calibrate = skin();
        calibrate.current_dir(folder.path()).args([
            "calibrate",
            "presses",
            "table.csv",
            "--truth",
            "known.csv",
            "--json",
        ]);
        let mut reconstruct = skin();
        reconstruct.current_dir(folder.path()).args([
            "reconstruct",
            "table.csv",
            "--calibration",
            "skin.cal",
            "--json",
        ]);
        if difference {
            calibrate.arg("--difference");
            reconstruct.arg("--difference");
        } else {
            reconstruct.args(["--before", "all.csv"]);
        }
        let made = calibrate.output().unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        let found: serde_json::Value = serde_json::from_slice(&made.stdout).unwrap();
        assert_eq!(
            (&found["presses"], &found["clockwise"]),
            (&20.into(), &false.into()),
            "{found}"
        );
        assert!(found["explained"].as_f64().unwrap() > 0.8, "{found}");
        // No sheet gives such frames, and changes alone do not tell what they are a part of.
        assert_eq!(
            found["model"]["better"].as_bool(),
            (!difference).then_some(false),
            "{found}"
        );
        assert_eq!(found["model_not_tried"].is_string(), difference, "{found}");
        let out = reconstruct.output().unwrap();
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        let text = String::from_utf8(out.stdout).unwrap();
        let mut errors = Vec::new();
        for (line, place) in text.lines().zip(&places).skip(20) {
            let frame: serde_json::Value = serde_json::from_str(line).unwrap();
            let touches = frame["touches"].as_array().unwrap();
            assert_eq!(touches.len(), 1, "{line}");
            let at = |name: &str| touches[0][name].as_f64().unwrap();
            errors.push((at("x_mm") - place[0]).hypot(at("y_mm") - place[1]));
            assert!((0.05..10.0).contains(&at("x_sd_mm")), "{line}");
        }
        assert_eq!(errors.len(), 40);
        errors.sort_by(f64::total_cmp);
        assert!(errors[20] < 1.5 && errors[37] < 5.0, "{errors:?}");
        lines.push(errors);
    }
    let apart = lines[0].iter().zip(&lines[1]).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) < 0.1, "{lines:?}");
}

#[test]
fn what_cannot_be_calibrated_from_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &places(12), 12, true);
    let run = |arguments: &[&str]| {
        let out = skin().current_dir(folder.path()).args(arguments).output().unwrap();
        (out.status.code(), String::from_utf8(out.stderr).unwrap())
    };
    let presses = ["calibrate", "presses", "table.csv", "--truth"];
    let (code, said) = run(&[&presses[..], &["known.csv"]].concat());
    assert!(code == Some(1) && said.contains("--difference"), "{said}");
    std::fs::write(folder.path().join("few.csv"), "frame,before,x_mm,y_mm\np0,,1,2\n").unwrap();
    let (code, said) = run(&[&presses[..], &["few.csv", "--difference"]].concat());
    assert!(code == Some(1) && said.contains("give 5 or more"), "{said}");
    std::fs::write(folder.path().join("other.csv"), "frame,before,x_mm,y_mm\nq,,1,2\n").unwrap();
    let (code, said) = run(&[&presses[..], &["other.csv", "--difference"]].concat());
    assert!(code == Some(1) && said.contains("other.csv:2"), "{said}");
    assert!(!folder.path().join("skin.cal").exists());
    let (code, said) = run(&[&presses[..], &["known.csv", "--difference"]].concat());
    assert!(code == Some(0), "{said}");
    // Rows of another pattern.
    std::fs::write(
        folder.path().join("adjacent.csv"),
        "drive_a,drive_b,sense_a,sense_b,p\n1,2,3,4,1\n1,2,4,5,1\n",
    )
    .unwrap();
    let with = ["--calibration", "skin.cal", "--difference"];
    let (code, said) = run(&[&["reconstruct", "adjacent.csv"][..], &with].concat());
    assert!(
        code == Some(1) && said.contains("calibrate with this pattern"),
        "{said}"
    );
    // The simulated board measures adjacent pairs, this calibration is of opposite ones.
    let live = ["run", "--simulate", "--json", "--frames", "2", "--calibration"];
    let (code, said) = run(&[&live[..], &["skin.cal"]].concat());
    assert!(
        code == Some(1) && said.contains("calibrate with this pattern"),
        "{said}"
    );
    std::fs::create_dir(folder.path().join("state")).unwrap();
    let stored = folder.path().join("state/calibration-sim.toml");
    std::fs::copy(folder.path().join("skin.cal"), stored).unwrap();
    let (code, said) = run(&[&live[..5], &["--state-dir", "state"]].concat());
    assert!(
        code == Some(0) && said.contains("is not used: ") && said.contains("calibrate with this pattern"),
        "{said}"
    );
    let (code, said) = run(&[&["reconstruct", "table.csv", "--png", "pictures"][..], &with].concat());
    assert!(code == Some(2) && said.contains("--png"), "{said}");
    let text = std::fs::read_to_string(folder.path().join("skin.cal")).unwrap();
    std::fs::write(
        folder.path().join("skin.cal"),
        text.replace("version = 4", "version = 9"),
    )
    .unwrap();
    let (code, said) = run(&[&["reconstruct", "table.csv"][..], &with].concat());
    assert!(code == Some(1) && said.contains("version 9"), "{said}");
}

#[test]
fn the_benchmark_learns_more_from_more_presses_and_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let bench = || {
        let mut bench = skin();
        bench.args(["bench", "skins", "--json"]).arg(folder.path());
        bench.arg("--svg").arg(folder.path().join("errors.svg"));
        let out = bench.output().unwrap();
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        (
            String::from_utf8(out.stdout).unwrap(),
            String::from_utf8(out.stderr).unwrap(),
        )
    };
    let (rows, said) = bench();
    assert!(rows.is_empty() && said.contains("skipped"), "{said}");
    write(folder.path(), &places(45), 45, true);
    std::fs::rename(folder.path().join("table.csv"), folder.path().join("made.csv")).unwrap();
    std::fs::rename(folder.path().join("all.csv"), folder.path().join("made_truth.csv")).unwrap();
    let (rows, _) = bench();
    let rows: Vec<serde_json::Value> = rows.lines().map(|r| serde_json::from_str(r).unwrap()).collect();
    let known: Vec<u64> = rows.iter().map(|r| r["known"].as_u64().unwrap()).collect();
    // With none known the model alone is tried, which has nothing to do with this skin.
    assert_eq!(known, [0, 5, 10, 20]);
    let number = |row: usize, key: &str| rows[row][key].as_f64().unwrap();
    assert!(
        rows[0]["expected_mm"].is_null() && number(0, "explained") < number(3, "explained"),
        "{rows:?}"
    );
    assert!(number(3, "median_mm") < number(1, "median_mm"), "{rows:?}");
    assert!(number(3, "median_mm") < number(3, "ridge_median_mm"), "{rows:?}");
    assert!((0.0..=1.0).contains(&number(3, "both_of_two")), "{rows:?}");
    let drawn = std::fs::read_to_string(folder.path().join("errors.svg")).unwrap();
    assert!(
        drawn.contains("made") && drawn.matches("<circle").count() == 6,
        "{drawn}"
    );
}

#[test]
fn options_of_the_model_are_refused_and_the_rubbers_commands_say_which_calibration_this_is() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &places(12), 12, true);
    let run = |arguments: &[&str]| {
        let out = skin().current_dir(folder.path()).args(arguments).output().unwrap();
        (out.status.code(), String::from_utf8(out.stderr).unwrap())
    };
    let made = run(&[
        "calibrate",
        "presses",
        "table.csv",
        "--truth",
        "known.csv",
        "--difference",
    ]);
    assert_eq!(made.0, Some(0), "{}", made.1);
    let by_presses = ["reconstruct", "table.csv", "--calibration", "skin.cal", "--difference"];
    let (code, said) = run(&[&by_presses[..], &["--clockwise", "--method", "tikhonov"]].concat());
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("leave out --clockwise, --method"), "{said}");
    let (code, said) = run(&[
        "run",
        "--simulate",
        "--json",
        "--frames",
        "1",
        "--calibration",
        "skin.cal",
    ]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("it has 0 of the 192 measurements"), "{said}");
}

/// A sheet as the model has it, simulated with a mesh of its own and no linearisation: what presses teach is worth less than the model,
/// which is used then; the answer is nearly that without a calibration.
#[test]
fn where_the_model_locates_better_than_what_was_learned_it_is_used() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let out = skin().current_dir(folder.path()).args(arguments).output().unwrap();
        let said = String::from_utf8(out.stderr).unwrap();
        assert!(out.status.success(), "{said}");
        (String::from_utf8(out.stdout).unwrap(), said)
    };
    let column = |touch: &str| {
        let touch = if touch.is_empty() {
            vec![]
        } else {
            vec!["--touch", touch]
        };
        let (table, _) = run(&[&["forward", "--csv"][..], &touch].concat());
        let rows = table.lines().skip(1).map(|row| row.rsplit_once(',').unwrap());
        rows.map(|(row, value)| (row.to_owned(), value.parse::<f64>().unwrap()))
            .collect::<Vec<_>>()
    };
    let unpressed = column("");
    let places = places(14);
    let pressed: Vec<_> = places.iter().map(|[x, y]| column(&format!("{x},{y},8,0.3"))).collect();
    let mut table = "drive_a,drive_b,sense_a,sense_b".to_owned();
    let mut list = "frame,before,x_mm,y_mm\n".to_owned();
    for (k, [x, y]) in places.iter().enumerate() {
        write!(table, ",u{k},p{k}").unwrap();
        writeln!(list, "p{k},u{k},{x},{y}").unwrap();
    }
    for (c, (row, value)) in unpressed.iter().enumerate() {
        write!(table, "\n{row}").unwrap();
        for (k, press) in pressed.iter().enumerate() {
            let noise = |n: usize| 1.0 + 1e-4 * ((k * 7919 + c * 104_729 + n * 1_299_709) as f64).sin();
            write!(table, ",{},{}", value * noise(0), press[c].1 * noise(1)).unwrap();
        }
    }
    std::fs::write(folder.path().join("table.csv"), table + "\n").unwrap();
    std::fs::write(folder.path().join("known.csv"), list).unwrap();
    let (found, _) = run(&["calibrate", "presses", "table.csv", "--truth", "known.csv", "--json"]);
    let found: serde_json::Value = serde_json::from_str(&found).unwrap();
    assert_eq!(found["model"]["better"], true, "{found}");
    let model_mm = found["model"]["error_median_mm"].as_f64().unwrap();
    assert!(
        model_mm < 0.5 && model_mm < found["error_median_mm"].as_f64().unwrap(),
        "{found}"
    );
    let reconstruct = ["reconstruct", "table.csv", "--before", "known.csv", "--json"];
    let touches = |out: &str| -> Vec<serde_json::Value> {
        let frame = |l: &str| serde_json::from_str::<serde_json::Value>(l).unwrap()["touches"].clone();
        out.lines().map(frame).collect()
    };
    let (without, _) = run(&reconstruct);
    let (with, said) = run(&[&reconstruct[..], &["--calibration", "skin.cal"]].concat());
    assert!(said.contains("skin.cal: the sheet's model"), "{said}");
    assert!(
        with.lines().all(|l| l.contains(r#""calibration":"skin.cal""#)),
        "{with}"
    );
    // On a sheet that is as the model has it, presses tell next to nothing: touches stay within their uncertainty, and as near.
    let of = |out: &str, key: &str| -> Vec<f64> {
        let one = |t: serde_json::Value| t.as_array().filter(|t| t.len() == 1).and_then(|t| t[0][key].as_f64());
        touches(out).into_iter().map(|t| one(t).unwrap()).collect()
    };
    let mut squares = [0.0; 2];
    for (axis, key) in ["x_mm", "y_mm"].into_iter().enumerate() {
        let (a, b, sd) = (
            of(&without, key),
            of(&with, key),
            of(&without, ["x_sd_mm", "y_sd_mm"][axis]),
        );
        assert_eq!((a.len(), b.len()), (14, 14));
        for k in 0..14 {
            assert!((a[k] - b[k]).abs() < sd[k], "{key} {k}: {} {} {}", a[k], b[k], sd[k]);
            for (sum, found) in squares.iter_mut().zip([&a, &b]) {
                *sum += (found[k] - places[k][axis]).powi(2);
            }
        }
    }
    assert!(squares[1] < 1.2 * squares[0], "{squares:?}");
    // It is of one sheet.
    let other = [&reconstruct[..], &["--calibration", "skin.cal", "--diameter-mm", "150"]].concat();
    let out = skin().current_dir(folder.path()).args(other).output().unwrap();
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(
        out.status.code() == Some(1) && said.contains("made on another sheet"),
        "{said}"
    );
}

/// Places in another unit and tables of another sheet are refused where the sheet is known, or doubted.
#[test]
fn places_that_cannot_be_on_the_sheet_and_sheets_of_another_number_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let places = places(12);
    write(path, &places, 12, true);
    let run = |arguments: &[&str]| {
        let presses = ["calibrate", "presses", "--difference"];
        let out = skin().current_dir(path).args(presses).args(arguments).output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (out.status.code(), text(out.stdout), text(out.stderr))
    };
    let disc = |name: &str, count: usize| {
        let text = format!(
            "sheet_resistance_ohm = 1000.0\noutline = {{ kind = \"disc\", diameter_mm = 124.0 }}\n[electrode_ring]\ncount = {count}\nwidth_mm = 4.0\ncontact_mm = 1.0\n"
        );
        std::fs::write(path.join(name), text).unwrap();
    };
    disc("sheet.toml", 16);
    disc("other.toml", 32);
    let table = std::fs::read_to_string(path.join("table.csv")).unwrap();
    let headed = |name: &str, electrodes: usize| {
        let header = format!("# sheet: disc, 124.0 x 124.0 mm, 120.8 cm2, {electrodes} electrodes, 1 at (62.0, 0.0)\n");
        std::fs::write(path.join(name), header + &table).unwrap();
    };
    headed("headed.csv", 16);
    headed("wrong.csv", 32);
    let scaled = |name: &str, factor: f64| {
        let mut text = "frame,before,x_mm,y_mm\n".to_owned();
        for (k, [x, y]) in places.iter().enumerate() {
            writeln!(text, "p{k},,{},{}", factor * x, factor * y).unwrap();
        }
        std::fs::write(path.join(name), text).unwrap();
    };
    scaled("um.csv", 1000.0);
    scaled("cm.csv", 0.1);
    for known in [&["table.csv", "--sheet", "sheet.toml"][..], &["headed.csv"]] {
        let with = |list: &str| run(&[known, &["--truth", list]].concat());
        let (code, _, said) = with("um.csv");
        assert!(
            code == Some(1)
                && said.contains("um.csv:2: ")
                && said.contains("is not on the sheet")
                && said.contains("millimetres"),
            "{said}"
        );
        assert!(!path.join("skin.cal").exists());
        let (code, _, said) = with("cm.csv");
        assert!(
            code == Some(0) && said.contains("warning: cm.csv: all places are within"),
            "{said}"
        );
        let (code, out, said) = with("known.csv");
        assert!(code == Some(0) && !said.contains("warning: known.csv"), "{said}");
        // Twelve of them.
        assert!(out.contains("more presses    advised; fewer than 20"), "{out}");
        std::fs::remove_file(path.join("skin.cal")).unwrap();
    }
    for (known, words) in [
        (
            &["table.csv", "--sheet", "other.toml"][..],
            "but the sheet has 32; describe the sheet",
        ),
        (&["wrong.csv"], "but the sheet of its header has 32; correct the header"),
    ] {
        let (code, _, said) = run(&[known, &["--truth", "known.csv"]].concat());
        assert!(
            code == Some(1) && said.contains("a pattern of 16 electrodes") && said.contains(words),
            "{said}"
        );
    }
    // Without a sheet nobody knows.
    let (code, out, said) = run(&["table.csv", "--truth", "cm.csv", "--json"]);
    assert!(code == Some(0) && !said.contains("warning"), "{said}");
    let found: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(found["more_presses"], "too_few_to_tell", "{found}");
    assert!(found["expected_mm"].is_null(), "{found}");
}

/// Files that are damaged, or that somebody else needs.
#[test]
fn a_calibration_that_is_cut_off_says_so_and_other_files_are_not_written_over() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write(path, &places(12), 12, true);
    let run = |arguments: &[&str]| {
        let out = skin().current_dir(path).args(arguments).output().unwrap();
        (out.status.code(), String::from_utf8(out.stderr).unwrap())
    };
    let made = run(&[
        "calibrate",
        "presses",
        "table.csv",
        "--truth",
        "known.csv",
        "--difference",
    ]);
    assert_eq!(made.0, Some(0), "{}", made.1);
    let text = std::fs::read_to_string(path.join("skin.cal")).unwrap();
    for (cut, words) in [(20_000, "the file seems to be cut off"), (0, "it is empty")] {
        std::fs::write(path.join("cut.cal"), &text[..cut]).unwrap();
        let (code, said) = run(&["reconstruct", "table.csv", "--calibration", "cut.cal", "--difference"]);
        assert_eq!(code, Some(1), "{said}");
        assert!(
            said.contains("cut.cal: ") && said.contains(words) && !said.contains("--frame-s") && said.len() < 300,
            "{said}"
        );
    }
    std::fs::write(path.join("press.csv"), "mine\n").unwrap();
    let gcode = ["calibrate", "gcode", "--count", "5", "--out", "press.gcode"];
    let (code, said) = run(&gcode);
    assert!(code == Some(1) && said.contains("--positions"), "{said}");
    assert_eq!(std::fs::read_to_string(path.join("press.csv")).unwrap(), "mine\n");
    // Its own list is made anew.
    std::fs::remove_file(path.join("press.csv")).unwrap();
    assert_eq!((run(&gcode).0, run(&gcode).0), (Some(0), Some(0)));
    let (code, said) = run(&["calibrate", "marks", "--svg", "m.x", "--csv", "m.x"]);
    assert!(
        code == Some(1) && said.contains("two files") && !path.join("m.x").exists(),
        "{said}"
    );
}
