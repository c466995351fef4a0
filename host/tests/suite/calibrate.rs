//! A board that is calibrated over its serial port, and forces on rubber whose resistivity rises with a power of the strain: the
//! programs as a person runs them, one behind the port of the other. The simulated board waits for its reader, so that the
//! same happens on a machine of any speed.
#![cfg(target_os = "linux")]

use crate::program::skin;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// `skin sim --pty` with a scene.
struct Board {
    program: Child,
    port: String,
}

impl Board {
    fn start(scene: &Path) -> Self {
        let mut program = Command::new(env!("CARGO_BIN_EXE_skin"))
            .args(["sim", "--pty", "--unpaced", "--scene"])
            .arg(scene)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut port = String::new();
        BufReader::new(program.stdout.take().unwrap())
            .read_line(&mut port)
            .unwrap();
        Self {
            program,
            port: port.trim().to_owned(),
        }
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

fn calibrate(arguments: &[&str]) -> Value {
    serde_json::from_str(&skin(&[&["calibrate", "--json"], arguments].concat())).unwrap()
}

fn near(found: &Value, key: &str, wanted: f64, within: f64) {
    let v = found[key].as_f64().unwrap();
    assert!((v - wanted).abs() <= within, "{key}: {v}, not {wanted} within {within}");
}

/// A tip of 25 mm: `keys` are times (s) and forces (N), straight from one to the next.
fn scene(folder: &Path, name: &str, material: &str, at_mm: [f64; 2], keys: &[[f64; 2]]) -> PathBuf {
    let [x, y] = at_mm;
    let key = |[t, n]: &[f64; 2]| format!("{{ t_s = {t:?}, x_mm = {x:?}, y_mm = {y:?}, force_n = {n:?} }}");
    let keys: Vec<String> = keys.iter().map(key).collect();
    let text = format!(
        "duration_s = 26.0\n[material]\n{material}\n[[touch]]\nshape = \"disc\"\nradius_mm = 12.5\nkeys = [{}]\n",
        keys.join(", ")
    );
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

/// A third again with 5 s, 0.2546 N/mm² (the default rubber): a press that only says how hard it was.
#[test]
fn a_board_behind_a_serial_port_is_calibrated_by_a_press_that_is_held() {
    let folder = tempfile::tempdir().unwrap();
    let keys = [[2.5, 0.0], [2.8, 25.0], [12.8, 25.0], [13.1, 0.0]];
    let board = Board::start(&scene(folder.path(), "hold.toml", "", [0.0, 0.0], &keys));
    let [out, table] = ["c.toml", "press.csv"].map(|name| folder.path().join(name).display().to_string());
    let port = ["--port", &board.port, "--force-n", "25", "--seconds", "18"];
    let found = calibrate(&[&port[..], &["--out", &out, "--save", &table]].concat());
    println!("{found}");
    near(&found, "delayed_ratio", 1.0 / 3.0, 0.025);
    near(&found, "tau_s", 5.0, 0.4);
    near(&found, "unit_rise_mpa", 0.2546, 0.008);
    // What it saved is a table to calibrate from again, its forces found by the press's edges already.
    let again = calibrate(&[&table, "--out", &out]);
    near(&again, "tau_s", found["tau_s"].as_f64().unwrap(), 0.05);
}

/// Forces (N) of the only touch in the frames of a table from one time to another, in the order of size. Every frame of a
/// table is looked at, where a live picture passes frames over when it is late.
fn forces(table: &str, calibration: &str, [from_s, to_s]: [f64; 2]) -> Vec<f64> {
    let text = std::fs::read_to_string(table).unwrap();
    let header = text.lines().find(|l| l.starts_with("drive_a")).unwrap();
    let names: Vec<&str> = header.split(',').skip(4).collect();
    let time_s = |name: &str| name.trim_start_matches('t').parse::<f64>().unwrap();
    let every_s = (time_s(names[names.len() - 1]) - time_s(names[0])) / (names.len() - 1) as f64;
    let rest: Vec<&str> = names.iter().copied().filter(|n| time_s(n) < 1.9).collect();
    let (rest, every_s) = (rest.join(","), every_s.to_string());
    let given = ["--baseline", &rest, "--calibration", calibration, "--frame-s", &every_s];
    let lines = skin(&[&["reconstruct", "--json", table], &given[..]].concat());
    let mut out: Vec<f64> = Vec::new();
    for line in lines.lines() {
        let frame: Value = serde_json::from_str(line).unwrap();
        if (from_s..to_s).contains(&time_s(frame["frame"].as_str().unwrap())) {
            let touches = frame["touches"].as_array().unwrap();
            assert_eq!(touches.len(), 1, "{line}");
            out.push(touches[0]["force_n"].as_f64().unwrap());
        }
    }
    out.sort_by(f64::total_cmp);
    out
}

/// Rise = gauge strain^1.5, +20 % at 25 N on the tip as ever. A calibration that knows of the exponent gives the forces of
/// other loads elsewhere within 5 % of full scale, and one that takes it to be 1 does not.
#[test]
fn an_exponent_is_told_by_two_forces_and_makes_forces_elsewhere_right() {
    let folder = tempfile::tempdir().unwrap();
    let material = "gauge = 17.4\nexponent = 1.5";
    // By the law: (s / unit)^1.5 = 17.4 (s / MPa)^1.5.
    let unit_mpa = 17.4_f64.powf(-1.0 / 1.5);
    let stairs = [
        [2.0, 0.0],
        [2.5, 12.0],
        [7.0, 12.0],
        [7.5, 25.0],
        [17.0, 25.0],
        [17.5, 0.0],
    ];
    let stairs = scene(folder.path(), "stairs.toml", material, [10.0, -20.0], &stairs);
    let [with, without, table] =
        ["with.toml", "without.toml", "stairs.csv"].map(|name| folder.path().join(name).display().to_string());
    let stairs = stairs.to_str().unwrap();
    let found = calibrate(&["--scene", stairs, "--exponent", "--out", &with, "--save", &table]);
    println!("{found}");
    near(&found, "exponent", 1.5, 0.03);
    near(&found, "unit_rise_mpa", unit_mpa, 0.03 * unit_mpa);
    near(&found, "delayed_ratio", 1.0 / 3.0, 0.025);
    near(&found, "tau_s", 5.0, 0.4);
    calibrate(&[&table, "--out", &without]);

    let loads = [
        [2.0, 0.0],
        [2.5, 22.0],
        [5.0, 22.0],
        [5.5, 14.0],
        [9.0, 14.0],
        [9.5, 0.0],
    ];
    let loads = scene(folder.path(), "loads.toml", material, [-25.0, 10.0], &loads);
    let table = skin(&[
        "sim",
        "--scene",
        loads.to_str().unwrap(),
        "--every-s",
        "0.15",
        "--duration-s",
        "10",
    ]);
    let measured = folder.path().join("measured.csv").display().to_string();
    std::fs::write(&measured, table).unwrap();
    let worst = |calibration: &str| {
        [([3.0, 5.0], 22.0), ([6.0, 9.0], 14.0)]
            .map(|(times_s, truth)| {
                let list = forces(&measured, calibration, times_s);
                assert!(list.len() > 8, "{}", list.len());
                let median = list[list.len() / 2];
                println!(
                    "{truth} N: {:.2} to {:.2}, median {median:.2}",
                    list[0],
                    list[list.len() - 1]
                );
                (median - truth).abs()
            })
            .into_iter()
            .fold(0.0, f64::max)
    };
    let [with, without] = [with, without].map(|c| worst(&c));
    assert!(with < 0.05 * 25.0, "{with}");
    assert!(without > 2.0 * with, "{without} {with}");
}
