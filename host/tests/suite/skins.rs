//! Several skins in one process: lines, recording and commands by name. Nothing here depends on how fast the machine is.

use crate::json_lines::are_by_the_schema;
use crate::program::{lines, output, said, skin, text};
use recording::{Reader, Topic};
use serde_json::Value;
use std::path::{Path, PathBuf};

const NAMES: [&str; 3] = ["palm", "chest", "forearm"];

fn sheets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../sheets")
}

/// What is the same in a run and in its replay: without the time of the moment and of solving.
fn told(lines: &[Value], name: &str) -> Vec<Value> {
    let of_skin = lines.iter().filter(|l| l["skin"] == name && l["kind"] == "picture");
    let lasting = |line: &Value| {
        let mut line = line.clone();
        let fields = line.as_object_mut().unwrap();
        for key in ["unix_s", "solve_us", "baseline"] {
            fields.remove(key);
        }
        line
    };
    of_skin.map(lasting).collect()
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let list = value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap());
    list.collect::<Vec<_>>().try_into().unwrap()
}

/// Where one turn after the other, about the robot's own axes, and the position take a point of the sheet.
fn moved(place: &Value, [x, y]: [f64; 2]) -> [f64; 3] {
    let [roll, pitch, yaw] = numbers::<3>(&place["roll_pitch_yaw_deg"]).map(f64::to_radians);
    let [x, y, z] = [x, y * roll.cos(), y * roll.sin()];
    let [x, y, z] = [x * pitch.cos() + z * pitch.sin(), y, z * pitch.cos() - x * pitch.sin()];
    let turned = [x * yaw.cos() - y * yaw.sin(), x * yaw.sin() + y * yaw.cos(), z];
    let position = numbers::<3>(&place["position_mm"]);
    [0, 1, 2].map(|k| turned[k] + position[k])
}

/// How many touches of an exported table are where the place of their skin takes them; without a place nothing is said of the robot.
fn exported_on_the_robot(csv: &str, header: &Value) -> usize {
    let mut lines = csv.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let mut touches = 0;
    for line in lines {
        let fields: Vec<&str> = line.split(',').collect();
        let of = |name: &str| fields[names.iter().position(|n| *n == name).unwrap()];
        let robot = ["robot_x_mm", "robot_y_mm", "robot_z_mm"].map(of);
        if header["place"].is_null() {
            assert_eq!(robot, [""; 3], "{line}");
            continue;
        }
        let wanted = moved(&header["place"], ["x_mm", "y_mm"].map(|name| of(name).parse().unwrap()));
        let is = robot.map(|text| text.parse::<f64>().unwrap());
        assert!((0..3).all(|k| (is[k] - wanted[k]).abs() < 1e-9), "{line}");
        touches += 1;
    }
    touches
}

/// Touches are where one turn after the other, about the robot's own axes, and the position take them.
fn is_on_the_robot(lines: &[Value]) -> usize {
    let place = &lines[0]["place"];
    let mut touches = 0;
    for line in lines.iter().filter(|l| l["kind"] == "picture") {
        let of = |key: &str| line[key].as_array().cloned().unwrap_or_default();
        for touch in of("touches").iter().chain(&of("events")) {
            let wanted = moved(place, ["x_mm", "y_mm"].map(|key| touch[key].as_f64().unwrap()));
            let is = numbers::<3>(&touch["robot_mm"]);
            // Six digits are printed of both.
            assert!((0..3).all(|k| (is[k] - wanted[k]).abs() < 2e-3), "{touch} in {place}");
            touches += 1;
        }
    }
    touches
}

/// The sheets that come with the program, each in the simulator, end to end: lines, one recording, replays bit for bit, exports.
#[test]
fn three_skins_are_shown_recorded_and_replayed_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("robot.mcap");
    let skins = sheets().join("skins.toml");
    let arguments = [
        "run",
        "--skins",
        text(&skins),
        "--json",
        "--frames",
        "40",
        "--record",
        text(&file),
    ];
    let run = output(&arguments);
    let live = lines(&run);
    for (name, electrodes) in NAMES.into_iter().zip([16, 16, 32]) {
        let own: Vec<Value> = live.iter().filter(|l| l["skin"] == name).cloned().collect();
        are_by_the_schema(&own);
        assert_eq!(own[0]["board"]["electrodes"], electrodes, "{name}");
        is_on_the_robot(&own);
        let one = format!("{}#{name}", text(&file));
        let replay = output(&["replay", &one, "--json", "--speed", "max"]);
        let says = "40 pictures, every one with the recorded touches";
        assert!(said(&replay).contains(says), "{}", said(&replay));
        assert_eq!(told(&live, name).len(), 40);
        assert_eq!(told(&live, name), told(&lines(&replay), name), "{name}");
    }
    assert_eq!(live.iter().filter(|l| l["skin"].is_null()).count(), 0);
    assert!(said(&run).contains("3 skins: "), "{}", said(&run));

    let info = skin(&["info", text(&file), "--json"]);
    let info: Vec<Value> = info.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let names: Vec<&str> = info.iter().map(|i| i["session"]["skin"].as_str().unwrap()).collect();
    assert_eq!(names, NAMES);
    assert!(
        info.iter()
            .all(|i| i["pictures"] == 40 && i["messages"]["other"].is_null())
    );
    // All at once, in one process.
    let replay = output(&["replay", text(&file), "--json", "--speed", "max"]);
    for name in NAMES {
        assert_eq!(told(&live, name), told(&lines(&replay), name), "{name}");
    }
    // What is one skin's has to say of which.
    let refused = output(&["export", text(&file), "--to", "npz"]);
    assert_eq!(refused.status.code(), Some(1));
    let says = "robot.mcap: a recording of several skins, palm, chest, forearm; name one, such as ";
    assert!(said(&refused).contains(says), "{}", said(&refused));
    let png = ["replay", text(&file), "--png", "x.png"];
    assert_eq!(output(&png).status.code(), Some(2));
    assert!(said(&output(&["replay", &format!("{}#foot", text(&file))])).contains("several skins"));
    skin(&["export", &format!("{}#chest", text(&file)), "--to", "npz"]);
    assert!(folder.path().join("robot-chest.npz").exists());
    let tables = folder.path().join("tables");
    skin(&["export", text(&file), "--to", "parquet", "--out", text(&tables)]);
    for name in NAMES {
        assert!(tables.join(format!("touches/skin={name}")).is_dir(), "{name}");
    }
    skin(&["export", text(&file), "--to", "rosbag2"]);
    let metadata = std::fs::read_to_string(folder.path().join("robot.rosbag2/metadata.yaml")).unwrap();
    assert!(
        NAMES
            .iter()
            .all(|name| metadata.contains(&format!("name: /{name}/touches")))
    );
    // One table of all: each touch where its skin's place takes it.
    let of_place = |name: &str| {
        live.iter()
            .find(|l| l["skin"] == name && l["kind"] == "header")
            .unwrap()
    };
    for name in NAMES {
        let one = format!("{}#{name}", text(&file));
        let csv = folder.path().join(format!("{name}.csv"));
        skin(&["export", &one, "--to", "touches-csv", "--out", text(&csv)]);
        exported_on_the_robot(&std::fs::read_to_string(&csv).unwrap(), of_place(name));
    }
    let recovered = folder.path().join("recovered.mcap");
    skin(&["recover", text(&file), "--out", text(&recovered)]);
    assert_eq!(skin(&["info", text(&recovered), "--json"]).lines().count(), 3);
}

/// A skin without its board ends, which is said with its name and by the exit code; the other one goes on, and its commands know its name.
#[test]
fn a_skin_that_fails_leaves_the_others_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (skins, told) = (folder.path().join("skins.toml"), folder.path().join("told"));
    let file = "[[skin]]\nname = \"gone\"\nport = \"/dev/there-is-no-such-port\"\n\
                [[skin]]\nname = \"tapped\"\nscene = \"fast-tap\"\n\
                [skin.place]\nframe = \"wrist\"\nposition_mm = [10, -20, 30]\nroll_pitch_yaw_deg = [25, -40, 110]\n";
    std::fs::write(&skins, file).unwrap();
    let robot = "$SKIN_ROBOT_FRAME $SKIN_ROBOT_X_MM $SKIN_ROBOT_Y_MM $SKIN_ROBOT_Z_MM";
    let command = format!("echo $SKIN_NAME $SKIN_TIME_S {robot} >> '{}'", text(&told));
    let run = output(&[
        "run",
        "--skins",
        text(&skins),
        "--json",
        "--frames",
        "400",
        // A busy machine sees the same touches.
        "--every-frame",
        "--on",
        "contact",
        &command,
    ]);
    assert_eq!(run.status.code(), Some(1), "{}", said(&run));
    assert!(said(&run).contains("gone: warning: "), "{}", said(&run));
    let pictures = String::from_utf8(run.stdout).unwrap();
    let of = |name: &str| {
        pictures
            .lines()
            .filter(|l| l.contains(&format!("{{\"skin\":\"{name}\",\"kind\":\"picture\"")))
            .count()
    };
    assert_eq!((of("gone"), of("tapped")), (0, 400));
    let tapped: Vec<Value> = pictures.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    are_by_the_schema(&tapped);
    assert!(is_on_the_robot(&tapped) > 10);
    if cfg!(unix) {
        let told = std::fs::read_to_string(&told).unwrap();
        // Name and place on the robot are those of the line's event.
        let contacts = tapped
            .iter()
            .flat_map(|line| line["events"].as_array().cloned().unwrap_or_default());
        let contacts: Vec<Value> = contacts.filter(|event| event["event"] == "contact").collect();
        assert!(!told.is_empty() && told.lines().count() <= contacts.len(), "{told}");
        for line in told.lines() {
            let words: Vec<&str> = line.split(' ').collect();
            assert_eq!((words[0], words[2], words.len()), ("tapped", "wrist", 6), "{line}");
            let numbers: Vec<f64> = [1, 3, 4, 5].iter().map(|k| words[*k].parse().unwrap()).collect();
            let event = contacts
                .iter()
                .find(|event| (event["time_s"].as_f64().unwrap() - numbers[0]).abs() < 1e-4)
                .unwrap();
            let wanted = self::numbers::<3>(&event["robot_mm"]);
            assert!(
                (0..3).all(|k| (wanted[k] - numbers[k + 1]).abs() < 0.011),
                "{line} is not {event}"
            );
        }
    }
}

/// A pulled cable is one skin's: the other sees nothing of it, and the recording knows whose it was.
#[test]
fn each_skin_comes_back_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let press = "duration_s = 30.0\n[[touch]]\nshape = \"finger\"\n\
                 press = { at_s = 0.3, for_s = 29.0, x_mm = 30.0, y_mm = 20.0, force_n = 15.0 }\n";
    write("still.toml", press);
    let fault = "[[fault]]\nkind = \"cable_pulled\"\nat_s = 1.0\nfor_s = 0.3\n";
    write("pulled.toml", &format!("{press}{fault}"));
    let skin_of = |name: &str| format!("[[skin]]\nname = \"{name}\"\nscene = \"{name}.toml\"\n");
    write("skins.toml", &(skin_of("still") + &skin_of("pulled")));
    let file = folder.path().join("both.mcap");
    let skins = folder.path().join("skins.toml");
    let live = lines(&output(&[
        "run",
        "--skins",
        text(&skins),
        "--json",
        "--frames",
        "200",
        "--record",
        text(&file),
    ]));
    for (name, times) in [("still", 0), ("pulled", 1)] {
        let one = PathBuf::from(format!("{}#{name}", text(&file)));
        let mut reader = Reader::open(&one).unwrap();
        let mut recorded = Vec::new();
        while let Some(message) = reader.next().unwrap() {
            if message.topic == Some(Topic::Live) {
                recorded.push(String::from_utf8(message.data.to_vec()).unwrap());
            }
        }
        for event in ["board_away", "board_back"] {
            let shown = live.iter().filter(|l| l["skin"] == name && l["event"] == event);
            assert_eq!(shown.count(), times, "{name} {event}");
            assert_eq!(
                recorded.iter().filter(|l| l.contains(event)).count(),
                times,
                "{name} {event}"
            );
        }
        assert_eq!(
            recorded.iter().filter(|l| l.contains("\"port\"")).count(),
            times,
            "{name}"
        );
        assert_eq!(told(&live, name).len(), 200);
    }
}

#[test]
fn what_is_of_one_board_is_refused_for_several() {
    let skins = sheets().join("skins.toml");
    for other in [
        &["--port", "x"][..],
        &["--scene", "hand"],
        &["--simulate"],
        &["--png", "x.png"],
    ] {
        let refused = output(&[&["run", "--skins", text(&skins)], other].concat());
        assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    }
}
