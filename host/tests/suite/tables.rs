//! Tables in every form that is read: the same frames give the same touches, and nothing about a table is passed over.

use serde_json::Value;
use std::fmt::Write as _;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn skin(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_skin"))
        .args(arguments)
        .output()
        .unwrap()
}

/// Electrodes from 1 of every row, and its value.
pub(crate) type Rows = Vec<([usize; 4], f64)>;

/// What `skin forward` says of a sheet with these options.
pub(crate) fn forward(options: &[&str]) -> Rows {
    let output = skin(&[&["forward", "--csv"], options].concat());
    assert!(output.status.success());
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines()
        .skip(1)
        .map(|line| {
            let fields: Vec<&str> = line.split(',').collect();
            let electrode = |k: usize| fields[k].parse().unwrap();
            ([0, 1, 2, 3].map(electrode), fields[4].parse().unwrap())
        })
        .collect()
}

pub(crate) fn values(rows: &Rows) -> Vec<f64> {
    rows.iter().map(|(_, v)| *v).collect()
}

pub(crate) const TOUCH: [&str; 2] = ["--touch", "30,20,9,0.2"];

/// A table with drive and sense electrodes.
pub(crate) fn table(rows: &Rows, frames: &[(&str, Vec<f64>)]) -> String {
    let mut text = "drive_a,drive_b,sense_a,sense_b".to_owned();
    for (name, _) in frames {
        write!(text, ",{name}").unwrap();
    }
    for (k, ([a, b, c, d], _)) in rows.iter().enumerate() {
        write!(text, "\n{a},{b},{c},{d}").unwrap();
        for (_, values) in frames {
            write!(text, ",{:e}", values[k]).unwrap();
        }
    }
    text + "\n"
}

pub(crate) struct Folder(tempfile::TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn file(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

/// Lines of JSON and what is said beside them.
pub(crate) fn reconstruct(file: &Path, options: &[&str]) -> (Vec<Value>, String) {
    let output = skin(
        &[
            &["reconstruct", file.to_str().unwrap(), "--json", "--no-progress"],
            options,
        ]
        .concat(),
    );
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{options:?}: {said}");
    let lines = String::from_utf8(output.stdout).unwrap();
    (lines.lines().map(|l| serde_json::from_str(l).unwrap()).collect(), said)
}

pub(crate) fn refused(file: &Path, options: &[&str]) -> String {
    let output = skin(&[&["reconstruct", file.to_str().unwrap()], options].concat());
    assert_eq!(output.status.code(), Some(1), "{options:?}");
    assert!(output.stdout.is_empty());
    String::from_utf8(output.stderr).unwrap()
}

/// Places of a frame's touches, mm.
pub(crate) fn places(line: &Value) -> Vec<[f64; 2]> {
    let list = line["touches"].as_array().unwrap();
    list.iter()
        .map(|t| ["x_mm", "y_mm"].map(|k| t[k].as_f64().unwrap()))
        .collect()
}

fn apart_mm(a: &Value, b: &Value) -> f64 {
    let (a, b) = (places(a), places(b));
    assert_eq!((a.len(), b.len()), (1, 1));
    (a[0][0] - b[0][0]).hypot(a[0][1] - b[0][1])
}

fn lines(frames: &[&[f64]], separator: &str, before: &str) -> String {
    frames.iter().fold(String::new(), |text, frame| {
        let numbers: Vec<String> = frame.iter().map(|v| format!("{v:e}")).collect();
        text + before + &numbers.join(separator) + "\n"
    })
}

/// numpy's format, written by another hand than the reader's.
fn npy(frames: &[&[f64]]) -> Vec<u8> {
    let mut header = format!(
        "{{'descr': '<f8', 'fortran_order': False, 'shape': ({}, {}), }}",
        frames.len(),
        frames[0].len()
    );
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(frames.iter().flat_map(|f| f.iter()).flat_map(|v| v.to_le_bytes()));
    bytes
}

/// MATLAB's level 5 with a variable `v` whose columns are the frames.
fn mat(frames: &[&[f64]]) -> Vec<u8> {
    let tagged = |kind: u32, data: &[u8]| {
        let mut out = [kind.to_le_bytes(), u32::try_from(data.len()).unwrap().to_le_bytes()].concat();
        out.extend(data);
        out.resize(out.len().next_multiple_of(8), 0);
        out
    };
    let sides = [frames[0].len(), frames.len()].map(|n| i32::try_from(n).unwrap().to_le_bytes());
    let numbers: Vec<u8> = frames
        .iter()
        .flat_map(|f| f.iter())
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let matrix = [
        tagged(6, &[6, 0, 0, 0, 0, 0, 0, 0]),
        tagged(5, &sides.concat()),
        tagged(1, b"v"),
        tagged(9, &numbers),
    ];
    let mut bytes = vec![b' '; 124];
    bytes[..10].copy_from_slice(b"MATLAB 5.0");
    bytes.extend([0, 1, b'I', b'M']);
    bytes.extend(tagged(14, &matrix.concat()));
    bytes
}

#[test]
fn the_same_frames_in_every_order_and_format_are_the_same_touches() {
    let folder = Folder::new();
    let (rows, touched) = (forward(&[]), values(&forward(&TOUCH)));
    let empty = values(&rows);
    let csv = folder.file("t.csv", table(&rows, &[("1", empty.clone()), ("2", touched.clone())]));
    let (expected, _) = reconstruct(&csv, &["--baseline", "1"]);
    let [[x, y]] = places(&expected[0])[..] else {
        panic!("{expected:?}")
    };
    assert!((x - 30.0).hypot(y - 20.0) < 1.0, "{x} {y}");

    let plain = [empty.as_slice(), touched.as_slice()];
    // All 256 values of a drive and a sense pair, those on driven electrodes nonsense; and the same rotated.
    let at = |frame: &[f64], drive: usize, sense: usize| {
        let wanted = [drive + 1, (drive + 1) % 16 + 1, sense + 1, (sense + 1) % 16 + 1];
        rows.iter().position(|(e, _)| *e == wanted).map(|k| frame[k])
    };
    let arranged = |frame: &[f64], rotated: bool, whole: bool| -> Vec<f64> {
        let pairs = (0..16).flat_map(|m| (0..16).map(move |k| (m, if rotated { (m + k) % 16 } else { k })));
        pairs
            .filter_map(|(m, n)| at(frame, m, n).or(whole.then_some(1e3)))
            .collect()
    };
    let all = |rotated, whole| plain.map(|f| arranged(f, rotated, whole));
    let (rotated, whole, both) = (all(true, false), all(false, true), all(true, true));
    fn of(frames: &[Vec<f64>; 2]) -> [&[f64]; 2] {
        [&frames[0], &frames[1]]
    }
    for (name, bytes, order) in [
        ("a.csv", lines(&plain, ",", "").into_bytes(), "adjacent16"),
        ("p.txt", lines(&plain, " ", "").into_bytes(), "pyeit"),
        ("e.txt", lines(&plain, ";", "").into_bytes(), "eidors"),
        ("o.txt", lines(&plain, ",", "magnitudes : ").into_bytes(), "openeit"),
        ("p.npy", npy(&plain), "pyeit"),
        ("e.mat", mat(&plain), "eidors"),
        ("f.npy", npy(&of(&rotated)), "pyeit-fmmu"),
        ("r.mat", mat(&of(&rotated)), "eidors-rotated"),
        ("w.mat", mat(&of(&whole)), "eidors"),
        ("b.csv", lines(&of(&both), ",", "").into_bytes(), "pyeit-fmmu"),
    ] {
        let file = folder.file(name, bytes);
        let (found, said) = reconstruct(&file, &["--order", order, "--baseline", "1"]);
        // Another order of the rows rounds differently, no more.
        let off = apart_mm(&found[0], &expected[0]);
        assert!(off < 1e-3, "{name}: {off} mm");
        assert!(said.contains(&format!("2 frames in the order {order}")), "{said}");
        let hint = refused(&file, &["--baseline", "1"]);
        assert!(hint.contains(&format!("--order {order}")), "{hint}");
        if name.starts_with(['w', 'b']) {
            assert!(said.contains("48 of 256 values"), "{said}");
        }
    }
}

#[test]
fn wires_are_checked_of_frames_in_every_order() {
    let folder = Folder::new();
    let rows = forward(&[]);
    let [empty, touched] = [values(&rows), values(&forward(&TOUCH))];
    let csv = folder.file("t.csv", table(&rows, &[("1", empty.clone()), ("2", touched.clone())]));
    let check = |file: &Path, options: &[&str]| {
        let given = [
            "check",
            file.to_str().unwrap(),
            "--baseline",
            "1",
            "--touch",
            "30,20",
            "--frame",
            "2",
        ];
        let output = skin(&[&given, options].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let expected = check(&csv, &[]);
    let plain = [empty.as_slice(), touched.as_slice()];
    for (name, bytes, order) in [
        ("p.txt", lines(&plain, " ", "").into_bytes(), "pyeit"),
        ("e.mat", mat(&plain), "eidors"),
    ] {
        assert_eq!(check(&folder.file(name, bytes), &["--order", order]), expected);
    }
}

#[test]
fn another_order_than_the_frames_have_is_noticed() {
    let folder = Folder::new();
    let (empty, touched) = (values(&forward(&[])), values(&forward(&TOUCH)));
    let file = folder.file("a.csv", lines(&[&empty, &touched], ",", ""));
    let other = ["--order", "pyeit-fmmu", "--baseline", "1", "--cell-mm", "15"];
    let said = refused(&file, &other);
    assert!(said.contains("--order") && said.contains("--sheet FILE"), "{said}");
    let (_, said) = reconstruct(&file, &[&other[..], &["--diameter-mm", "195"]].concat());
    assert!(said.contains("number and order of the electrodes"), "{said}");
}

/// Nothing is shown of another sheet as if it were the paper's disc; whoever insists is told in every frame.
#[test]
fn a_square_that_nothing_names_is_not_taken_for_a_disc() {
    let folder = Folder::new();
    let square = folder.file("square.toml", SQUARE);
    let of_square = ["--sheet", square.to_str().unwrap()];
    let rest = forward(&of_square);
    let touched = forward(&[&of_square[..], &TOUCH].concat());
    let frames = [("rest", values(&rest)), ("pressed", values(&touched))];
    let file = folder.file("frames.csv", table(&rest, &frames));
    let coarse = ["--baseline", "rest", "--cell-mm", "15"];
    let said = refused(&file, &coarse);
    assert!(
        said.contains("not that of the paper's disc") && said.contains("--sheet FILE"),
        "{said}"
    );
    let (lines, said) = reconstruct(&file, &[&coarse[..], &["--diameter-mm", "195"]].concat());
    assert!(lines[0]["doubt"].is_string(), "{}", lines[0]);
    assert!(said.contains("not that of the sheet as described"), "{said}");
    let (lines, said) = reconstruct(&file, &[&coarse[..], &of_square].concat());
    let (at, doubt) = (places(&lines[0]), &lines[0]["doubt"]);
    assert!(
        at.len() == 1 && (at[0][0] - 30.0).hypot(at[0][1] - 20.0) < 0.5 && doubt.is_null(),
        "{lines:?} {said}"
    );
}

const SQUARE: &str = include_str!("../../../sheets/square.toml");

#[test]
fn every_result_says_what_it_was_made_with() {
    let folder = Folder::new();
    let rows: Rows = forward(&[])[..100].to_vec();
    let (empty, touched) = (values(&rows), values(&forward(&TOUCH))[..100].to_vec());
    let mut gap = touched.clone();
    gap[7] = f64::NAN;
    let file = folder.file(
        "t.csv",
        table(&rows, &[("empty", empty), ("one", touched), ("gap", gap)]),
    );
    let (lines, said) = reconstruct(&file, &["--baseline", "empty", "--cell-mm", "15"]);
    for (line, left_out) in lines.iter().zip([0, 1]) {
        assert_eq!(line["baseline"], "empty");
        assert_eq!(line["pattern"], "adjacent, 100 of 208 values");
        assert!(line["sheet"].as_str().unwrap().starts_with("disc, 195.0 x 195.0 mm"));
        let number = |key: &str| line[key].as_u64().unwrap();
        assert_eq!(number("values") - number("used"), left_out);
        let missing = line["missing"].as_array().unwrap();
        let all = forward(&[]);
        assert_eq!(missing.len(), 108);
        for (row, (electrodes, _)) in missing.iter().zip(&all[100..]) {
            assert_eq!(*row, serde_json::json!(electrodes));
        }
    }
    assert!(
        said.contains("100 of 208 values; missing: drive 8-9: sense 13-14"),
        "{said}"
    );
}

const THIRTY_TWO: &str = "sheet_resistance_ohm = 1000.0
outline = { kind = \"disc\", diameter_mm = 195.0 }
[electrode_ring]
count = 32
width_mm = 6.0
contact_mm = 1.0
";

#[test]
fn thirty_two_electrodes_need_their_sheet_and_then_are_as_good() {
    let folder = Folder::new();
    let sheet = folder.file("s.toml", THIRTY_TWO);
    let sheet = sheet.to_str().unwrap();
    let rows = forward(&["--sheet", sheet]);
    assert_eq!(rows.len(), 928);
    let touched = values(&forward(&[&["--sheet", sheet], TOUCH.as_slice()].concat()));
    let csv = folder.file(
        "t.csv",
        table(&rows, &[("empty", values(&rows)), ("one", touched.clone())]),
    );
    let said = refused(&csv, &["--baseline", "empty"]);
    assert!(
        said.contains("32 electrodes") && said.contains("--sheet FILE"),
        "{said}"
    );
    let quick = ["--sheet", sheet, "--trust-electrodes", "--cell-mm", "10"];
    let (lines, _) = reconstruct(&csv, &[&quick, ["--baseline", "empty"].as_slice()].concat());
    let [[x, y]] = places(&lines[0])[..] else {
        panic!("{lines:?}")
    };
    assert!((x - 30.0).hypot(y - 20.0) < 1.0, "{x} {y}");
    // A line of OpenEIT has the same 928 values.
    let file = folder.file("o.txt", self::lines(&[&values(&rows), &touched], ",", "magnitudes : "));
    let (same, _) = reconstruct(
        &file,
        &[&quick, ["--order", "openeit", "--baseline", "1"].as_slice()].concat(),
    );
    assert!(apart_mm(&same[0], &lines[0]) < 1e-6);
    let said = refused(&file, &["--order", "openeit", "--baseline", "1"]);
    assert!(said.contains("32 electrodes"), "{said}");
    // Sixteen electrodes on it are refused in either form: their first and last are no neighbours there.
    let rows = forward(&[]);
    let small = folder.file("small.csv", table(&rows, &[("1", values(&rows)), ("2", values(&rows))]));
    let lines = lines_of(&values(&rows));
    let also = folder.file("small.txt", lines);
    for (file, options) in [(&small, [].as_slice()), (&also, ["--order", "pyeit"].as_slice())] {
        let said = refused(file, &[options, &["--baseline", "1", "--sheet", sheet]].concat());
        assert!(said.contains("a pattern of 16 electrodes"), "{said}");
    }
    // And so is a comment over one frame a line that names another sheet.
    let text = format!(
        "# sheet: disc, 150.0 x 150.0 mm, 176.7 cm2, 16 electrodes\n{}",
        lines_of(&values(&rows))
    );
    let said = refused(&folder.file("c.txt", text), &["--order", "pyeit", "--baseline", "1"]);
    assert!(said.contains("150.0 x 150.0 mm, not 195.0"), "{said}");
}

fn lines_of(frame: &[f64]) -> String {
    lines(&[frame, frame], ",", "")
}

#[test]
fn a_frame_with_a_baseline_of_its_own_is_compared_with_that() {
    let folder = Folder::new();
    let (rows, touched) = (forward(&[]), values(&forward(&TOUCH)));
    let other = values(&forward(&["--touch", "-40,10,9,0.2"]));
    let empty = values(&rows);
    // All voltages drift by a fifth between the presses: more than a touch changes any.
    let drifted = |frame: &[f64]| -> Vec<f64> { frame.iter().map(|v| 1.2 * v).collect() };
    let frames = [
        ("u0", empty.clone()),
        ("p0", touched),
        ("u1", drifted(&empty)),
        ("p1", drifted(&other)),
    ];
    let file = folder.file("t.csv", table(&rows, &frames));
    let before = folder.file("before.csv", "frame,before,x_mm\np0,u0,30\np1,u1,-40\n");
    let (lines, _) = reconstruct(&file, &["--before", before.to_str().unwrap()]);
    let names: Vec<&str> = lines.iter().map(|l| l["frame"].as_str().unwrap()).collect();
    assert_eq!(names, ["p0", "p1"]);
    for (line, (baseline, [x, y])) in lines.iter().zip([("u0", [30.0, 20.0]), ("u1", [-40.0, 10.0])]) {
        assert_eq!(line["baseline"], baseline);
        let [[a, b]] = places(line)[..] else { panic!("{line}") };
        assert!((a - x).hypot(b - y) < 1.0, "{a} {b}");
    }
    // Without a frame before it, one is compared with --baseline; without that, it is an error.
    let part = folder.file("part.csv", "frame,before\np0,\np1,u1\n");
    let part = part.to_str().unwrap();
    let said = refused(&file, &["--before", part]);
    assert!(said.contains("part.csv:2") && said.contains("--baseline"), "{said}");
    let (lines, said) = reconstruct(&file, &["--before", part, "--baseline", "u0"]);
    assert_eq!(
        (&lines[0]["baseline"], &lines[1]["baseline"]),
        (&"u0".into(), &"u1".into())
    );
    assert!(
        said.contains("1 frames have no frame before them") && said.contains("p0"),
        "{said}"
    );
}

/// Each press comes where a dent of the one before is still, of which 30 % goes meanwhile. That is found, said and taken off.
#[test]
fn dents_that_recover_under_a_press_are_taken_off() {
    let folder = Folder::new();
    let rows = forward(&[]);
    let places: Vec<[f64; 2]> = (0..11)
        .map(|k| {
            let (angle, radius) = (2.4 * f64::from(k), 25.0 + 5.0 * f64::from(k % 7));
            [radius * angle.cos(), radius * angle.sin()]
        })
        .collect();
    let touch = |[x, y]: [f64; 2], rise: f64| format!("{x:.2},{y:.2},10,{rise}");
    let noisy = |frame: Vec<f64>, n: usize| -> Vec<f64> {
        let noise = |c: usize| 1.0 + 3e-5 * ((c * 104_729 + n * 1_299_709) as f64).sin();
        frame.iter().enumerate().map(|(c, v)| v * noise(c)).collect()
    };
    let mut frames = Vec::new();
    let mut list = "frame,before\n".to_owned();
    let names: Vec<[String; 2]> = (1..11).map(|k| [format!("u{k}"), format!("p{k}")]).collect();
    for (k, [u, p]) in names.iter().enumerate() {
        let before = values(&forward(&["--touch", &touch(places[k], 0.06)]));
        let pressed = [
            "--touch",
            &touch(places[k], 0.042),
            "--touch",
            &touch(places[k + 1], 0.3),
        ];
        frames.push((u.as_str(), noisy(before, 2 * k)));
        frames.push((p.as_str(), noisy(values(&forward(&pressed)), 2 * k + 1)));
        list += &format!("{p},{u}\n");
    }
    frames.push(("rest", values(&rows)));
    let file = folder.file("t.csv", table(&rows, &frames));
    let before = folder.file("before.csv", list);
    let (lines, said) = reconstruct(&file, &["--before", before.to_str().unwrap(), "--baseline", "rest"]);
    let found = lines[0]["creep_recovered"].as_f64().unwrap_or(0.0);
    assert!((found - 0.3).abs() < 0.1 && said.contains("creep: "), "{found}: {said}");
    assert_eq!(lines[0]["creep_dented"], serde_json::Value::Null);
    // Dents are a fifth of a press. Without --baseline no frame shows the sheet without them.
    let (dented, said) = reconstruct(&file, &["--before", before.to_str().unwrap()]);
    let [part, depth] = ["creep_recovered", "creep_dented"].map(|key| dented[0][key].as_f64().unwrap_or(0.0));
    assert!((part - 0.3).abs() < 0.1 && (depth - 0.2).abs() < 0.1, "{part} {depth}");
    assert!(said.contains("% of a press, in the mean"), "{said}");
    for lines in [lines, dented] {
        for (line, [x, y]) in lines.iter().zip(&places[1..]) {
            let [[a, b]] = self::places(line)[..] else {
                panic!("{line}")
            };
            assert!((a - x).hypot(b - y) < 0.5, "{a} {b}, {x} {y}");
        }
    }
}

#[test]
fn changes_alone_are_found_with_the_models_voltages() {
    let folder = Folder::new();
    let (rows, touched) = (forward(&[]), values(&forward(&TOUCH)));
    let change: Vec<f64> = touched.iter().zip(&rows).map(|(t, (_, u))| t - u).collect();
    let millivolts: Vec<f64> = change.iter().map(|v| 1e3 * v).collect();
    let file = folder.file("t.csv", table(&rows, &[("volts", change)]));
    let (lines, _) = reconstruct(&file, &["--difference"]);
    assert_eq!(lines[0]["baseline"], "the model");
    let [[x, y]] = places(&lines[0])[..] else {
        panic!("{lines:?}")
    };
    assert!((x - 30.0).hypot(y - 20.0) < 1.0, "{x} {y}");
    let file = folder.file("m.csv", table(&rows, &[("volts", millivolts)]));
    let (same, _) = reconstruct(&file, &["--difference", "--unit-v", "1e-3"]);
    assert!(apart_mm(&same[0], &lines[0]) < 1e-3);
}

/// What is assumed, or does not fit, is in the lines as it is on stderr; and what makes no sense is refused.
#[test]
fn what_does_not_fit_is_said_in_the_lines_too() {
    let folder = Folder::new();
    let (rows, touched) = (forward(&[]), values(&forward(&TOUCH)));
    let frames = [("u", values(&rows)), ("t", touched.clone())];
    let noted = |(lines, said): &(Vec<Value>, String), what: &str| {
        assert!(said.contains(what), "{said}");
        for line in lines {
            let notes = line["notes"].as_array().unwrap();
            assert!(notes.iter().any(|note| note.as_str().unwrap().contains(what)), "{line}");
        }
    };

    let file = folder.file("voltages.csv", table(&rows, &frames));
    let said = refused(&file, &["--difference"]);
    assert!(said.contains("not changes of them; leave out --difference"), "{said}");
    // A plate on the whole sheet changes all voltages nearly alike, and is a change.
    let plate = values(&forward(&["--touch", "0,0,96,0.2"]));
    let plate = plate.iter().zip(&rows).map(|(t, (_, u))| t - u).collect();
    let file = folder.file("plate.csv", table(&rows, &[("t", plate)]));
    reconstruct(&file, &["--difference"]);

    let microvolts = touched.iter().zip(&rows).map(|(t, (_, u))| 1e6 * (t - u));
    let file = folder.file("changes.csv", table(&rows, &[("t", microvolts.collect())]));
    noted(
        &reconstruct(&file, &["--difference"]),
        "Say what 1 in the table is with --unit-v",
    );

    let file = folder.file(
        "drive.csv",
        format!("# drive: current, 1 mA\n{}", table(&rows, &frames)),
    );
    let options = ["--baseline", "u", "--cell-mm", "15"];
    noted(
        &reconstruct(&file, &options),
        "a current drives the sheet, and --drive voltage is used",
    );
    let (lines, said) = reconstruct(&file, &[&options[..], &["--drive", "current"]].concat());
    assert!(lines[0]["notes"].is_null() && !said.contains("drives"), "{said}");

    // No sheet has its values in this order.
    let mixed = |v: &[f64]| (0..v.len()).map(|k| v[5 * k % v.len()]).collect::<Vec<f64>>();
    let frames = frames.map(|(name, v)| (name, mixed(&v)));
    let file = folder.file("mixed.csv", table(&rows, &frames));
    let read = reconstruct(&file, &[&options[..], &["--diameter-mm", "195"]].concat());
    noted(&read, "the baseline is not that of the sheet as described");
    let doubt = read.0[0]["doubt"].as_str().unwrap();
    assert!(
        doubt.starts_with("the baseline is not that of the sheet as described"),
        "{doubt}"
    );

    let opposite = THIRTY_TWO.replace("= 32", "= 16") + "[pattern]\ndrive_step = 8\nsense_step = 8\n";
    let sheet = folder.file("opposite.toml", opposite);
    let of_sheet = ["--sheet", sheet.to_str().unwrap()];
    let rows = forward(&of_sheet);
    let touched = forward(&[&of_sheet[..], &TOUCH].concat());
    let file = folder.file(
        "opposite.csv",
        table(&rows, &[("u", values(&rows)), ("t", values(&touched))]),
    );
    noted(
        &reconstruct(&file, &[&of_sheet[..], &["--baseline", "u"]].concat()),
        "change all values alike",
    );
}

/// Frames of the baseline that something pressed, a converter's rail, and numbers with few digits.
#[test]
fn a_table_says_what_its_values_have_lost() {
    let folder = Folder::new();
    let (sheet, touched) = (values(&forward(&[])), values(&forward(&TOUCH)));
    let pressed = values(&forward(&["--touch", "-40,10,9,0.1"]));
    let rows = forward(&[]);
    // Noise of every value, the same in every run.
    let noisy = |v: &[f64], frame: usize| -> Vec<f64> {
        let noise = |k: usize| {
            let mut hash = DefaultHasher::new();
            (k, frame).hash(&mut hash);
            6e-6 * (hash.finish() as f64 / u64::MAX as f64 - 0.5)
        };
        v.iter().enumerate().map(|(k, v)| v + noise(k)).collect()
    };
    let names = ["b1", "b2", "b3", "b4", "b5", "b6", "b7", "b8"];
    let frames = |of: &dyn Fn(usize) -> Vec<f64>| -> Vec<(&str, Vec<f64>)> {
        let baseline = names.iter().enumerate().map(|(j, name)| (*name, noisy(&of(j), j)));
        baseline
            .chain([("t", noisy(&touched, 8)), ("e", noisy(&sheet, 9))])
            .collect()
    };
    let read = |name: &str, frames: &[(&str, Vec<f64>)]| {
        reconstruct(&folder.file(name, table(&rows, frames)), &["--baseline", "b1-b8"])
    };
    let is_right = |line: &Value| {
        let found = places(line);
        assert!(
            found.len() == 1 && (found[0][0] - 30.0).hypot(found[0][1] - 20.0) < 1.0,
            "{line}"
        );
    };

    let (lines, said) = read("rest.csv", &frames(&|_| sheet.clone()));
    is_right(&lines[0]);
    assert!(places(&lines[1]).is_empty() && lines.iter().all(|line| line["doubt"].is_null()));
    assert!(!said.contains("warning"), "{said}");

    let (lines, said) = read("pressed.csv", &frames(&|j| [&sheet, &pressed][j % 2].clone()));
    assert!(said.contains("differ from each other by"), "{said}");
    for line in &lines {
        assert!(
            line["doubt"]
                .as_str()
                .unwrap()
                .starts_with("the sheet moved while the baseline was taken")
        );
        assert_eq!(line["left_out"][0]["kind"], "moved");
    }

    let mut clipped = frames(&|_| sheet.clone());
    let mut sizes = sheet.clone();
    sizes.sort_by(f64::total_cmp);
    let rail = 0.5 * (sizes[190] + sizes[189]);
    clipped
        .iter_mut()
        .flat_map(|(_, values)| values)
        .for_each(|v| *v = v.min(rail));
    let (lines, said) = read("clipped.csv", &clipped);
    assert!(said.contains("as at the rail of a converter"), "{said}");
    is_right(&lines[0]);
    assert!(places(&lines[1]).is_empty());
    assert!(lines[0]["notes"].to_string().contains("as at the rail of a converter"));

    let rounded = |digits: usize| -> Vec<(&str, Vec<f64>)> {
        let mut frames = frames(&|_| sheet.clone());
        let round = |v: &f64| format!("{v:.digits$}").parse().unwrap();
        frames
            .iter_mut()
            .for_each(|(_, values)| *values = values.iter().map(round).collect());
        frames
    };
    let (_, said) = read("millivolts.csv", &rounded(3));
    assert!(said.contains("its values are rounded by"), "{said}");
    let (lines, said) = read("microvolts.csv", &rounded(6));
    is_right(&lines[0]);
    assert!(places(&lines[1]).is_empty() && !said.contains("rounded"), "{said}");
}

#[test]
fn a_simulated_board_of_thirty_two_electrodes_feels_the_finger() {
    let folder = Folder::new();
    let sheet = folder.file("s.toml", THIRTY_TWO);
    let sheet = sheet.to_str().unwrap();
    let truth = folder.file("truth.jsonl", "");
    let every = [
        "--duration-s",
        "2.6",
        "--every-s",
        "0.1",
        "--truth",
        truth.to_str().unwrap(),
    ];
    let output = skin(&[&["sim", "--sheet", sheet], every.as_slice()].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let file = folder.file("t.csv", &output.stdout);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains(", 32 electrodes, 1 at (97.5, 0.0)"), "{text}");
    let truth: Vec<Value> = std::fs::read_to_string(truth)
        .unwrap()
        .lines()
        .map(|l| serde_json::from_str(l).unwrap())
        .collect();
    let header = text.lines().find(|l| l.starts_with("drive_a")).unwrap();
    let names: Vec<&str> = header.split(',').skip(4).collect();
    assert_eq!(names.len(), truth.len());
    let rest = truth
        .iter()
        .take_while(|t| t["touches"].as_array().unwrap().is_empty())
        .count();
    assert!(rest >= 8, "{rest}");
    let baseline = format!("{}-{}", names[0], names[rest - 2]);
    let (lines, said) = reconstruct(&file, &["--sheet", sheet, "--baseline", &baseline, "--cell-mm", "8"]);
    assert!(
        said.contains("256 of 928 values, all that its header announces"),
        "{said}"
    );
    assert!(lines[0].get("missing").is_none());
    // It is found in every frame in which it stands still, though few pairs of these values are reciprocal.
    let force_n = |t: &Value| t["touches"][0]["force_n"].as_f64().unwrap_or(0.0);
    let (frames, held) = (&truth[rest - 1..], force_n(&truth[truth.len() - 1]));
    assert_eq!(lines.len(), frames.len());
    let mut off: Vec<f64> = Vec::new();
    for (line, _) in lines.iter().zip(frames).filter(|(_, t)| force_n(t) == held) {
        let [[a, b]] = places(line)[..] else { panic!("{line}") };
        off.push((a + 30.0).hypot(b - 20.0));
        assert!(off.iter().all(|off| *off < 4.0), "{line}");
    }
    // One frame says the place to a millimetre: its uncertainty in x and in y is 0.7 mm. The finger stands still in all of these.
    off.sort_by(f64::total_cmp);
    assert!(off.len() >= 4 && off[off.len() / 2] < 2.0, "{off:?}");
}
