//! Recordings: what is recorded of a simulated skin, replayed, cut off, killed. Nothing here depends on how fast the machine is.

use crate::program::{Started, events, lines, output, pictures, program, said, skin, text};
use recording::{Ended, Reader, Topic};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Messages of a topic, and how the file ended.
fn messages(path: &Path, topic: Topic) -> (Vec<(u64, Vec<u8>)>, Ended) {
    let mut reader = Reader::open(path).unwrap();
    let mut out = Vec::new();
    while let Some(message) = reader.next().unwrap() {
        if message.topic == Some(topic) {
            out.push((message.log_ns, message.data.to_vec()));
        }
    }
    (out, reader.ended().unwrap())
}

/// The ages of the baseline, in whole seconds.
fn ages_s(output: &Output) -> Vec<f64> {
    let age = |line: &Value| line["baseline"]["age_s"].as_f64();
    lines(output).iter().filter_map(age).collect()
}

/// So many seconds are those of the pictures, however long the baseline was looked into before.
#[test]
fn a_recording_of_so_many_seconds_has_pictures_of_as_many() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("r.mcap");
    skin(&[
        "record",
        text(&file),
        "--scene",
        "one-touch",
        "--every-frame",
        "--seconds",
        "0.5",
    ]);
    let (touches, _) = messages(&file, Topic::Touches);
    let time_s = |(_, data): &(u64, Vec<u8>)| {
        let picture: Value = serde_json::from_slice(data).unwrap();
        picture["time_s"].as_f64().unwrap()
    };
    let length_s = time_s(touches.last().unwrap()) - time_s(&touches[0]);
    // The last frame is the first that is not earlier.
    assert!((0.5..0.52).contains(&length_s), "{length_s}");
}

/// What `skin run` prints while it records is what the replay prints, to the last bit; and nothing is missing in the file.
pub(crate) fn same_again(folder: &Path, name: &str, arguments: &[&str]) -> Vec<Value> {
    let file = folder.join(name);
    let run = output(&[&["run", "--json", "--record", text(&file)], arguments].concat());
    let live = pictures(&run);
    let replay = output(&["replay", text(&file), "--json", "--speed", "max"]);
    assert_eq!(live, pictures(&replay));
    assert_eq!(events(&run), events(&replay));
    // A picture is recorded just after it was printed, perhaps in the next second.
    let (then, now) = (ages_s(&run), ages_s(&replay));
    assert_eq!(then.len(), now.len());
    assert!(
        then.iter()
            .zip(&now)
            .all(|(then, now)| (0.0..=1.0).contains(&(now - then)))
    );
    let says = format!("{} pictures, every one with the recorded touches", live.len());
    assert!(said(&replay).contains(&says), "{}", said(&replay));
    assert!(!said(&replay).contains("warning: skin"), "{}", said(&replay));
    live
}

fn touched(pictures: &[Value]) -> usize {
    pictures
        .iter()
        .filter(|p| !p["touches"].as_array().unwrap().is_empty())
        .count()
}

#[test]
fn a_replay_gives_the_recorded_touches_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let pictures = same_again(folder.path(), "hand.mcap", &["--scene", "hand", "--frames", "350"]);
    assert!(touched(&pictures) > 10, "{}", touched(&pictures));
}

#[test]
fn a_replay_has_the_forces_too() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = folder.path().join("calibration.toml");
    let keys = "delayed_ratio = 0.3\ntau_s = 5.0\nexponent = 1.0\nunit_rise_mpa = 0.25\nforce_sd_n = 0.1\n";
    std::fs::write(&calibration, keys).unwrap();
    let arguments = [
        "--scene",
        "fast-tap",
        "--frames",
        "300",
        "--every-frame",
        "--calibration",
        text(&calibration),
    ];
    let pictures = same_again(folder.path(), "tap.mcap", &arguments);
    let forces = pictures.iter().flat_map(|p| p["touches"].as_array().unwrap());
    assert!(
        forces
            .filter(|t| t["force_n"].as_f64().is_some_and(|f| f > 0.0))
            .count()
            > 10
    );
}

/// The stored baseline is in the recording: the replay needs no folder, and stores nothing.
#[test]
fn a_replay_starts_from_the_stored_baseline() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    pictures(&output(&[
        "run",
        "--json",
        "--frames",
        "1",
        "--simulate",
        "--state-dir",
        text(&state),
    ]));
    let arguments = [
        "--frames",
        "20",
        "--scene",
        "preload",
        "--baseline",
        "stored",
        "--state-dir",
        text(&state),
    ];
    let pictures = same_again(folder.path(), "resting.mcap", &arguments);
    assert_eq!(touched(&pictures), 20);
    assert_eq!(pictures[0]["baseline"]["stored"], true);
}

/// Records until the file holds some seconds, and kills without a warning at a random moment. The file and when it was killed.
fn killed(folder: &Path, name: &str, after: Duration) -> (PathBuf, f64) {
    let file = folder.join(name);
    let mut child = Started::new(
        program(&["record", text(&file), "--scene", "hand"])
            .stdout(Stdio::null())
            .stderr(Stdio::null()),
    );
    // From the first frame on.
    loop {
        let begun = file.exists() && Reader::open(&file).is_ok_and(|mut r| r.find(Topic::Board).unwrap().is_some());
        if begun {
            break;
        }
        assert!(child.0.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(after);
    let at_s = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs_f64();
    child.kill();
    (file, at_s)
}

/// Everything up to the last flush can be read, frames in their order, and recovering makes a closed file of the same messages. How
/// much older than the kill the last frame is, s.
fn is_readable(folder: &Path, file: &Path, at_s: f64) -> f64 {
    let (wire, ended) = messages(file, Topic::Board);
    assert_eq!(ended, Ended::Cut, "{}", file.display());
    let mut decoder = protocol::Decoder::<{ protocol::MAX_FROM_BOARD_LEN }>::new();
    let mut sequences = Vec::new();
    for (_, bytes) in &wire {
        decoder.push(bytes, |message: Result<protocol::FromBoard, _>| {
            if let Ok(protocol::FromBoard::Frame(frame)) = message {
                sequences.push(frame.sequence);
            }
        });
    }
    assert!(sequences.windows(2).all(|w| w[1] > w[0]), "{sequences:?}");
    let whole = folder.join("recovered.mcap");
    skin(&["recover", text(file), "--out", text(&whole)]);
    assert_eq!(messages(&whole, Topic::Board), (wire.clone(), Ended::Whole));
    std::fs::remove_file(&whole).unwrap();
    at_s - 1e-9 * wire.last().unwrap().0 as f64
}

#[test]
fn a_killed_recording_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    for (k, after_ms) in [30, 620, 1_700].into_iter().enumerate() {
        let (file, at_s) = killed(folder.path(), &format!("{k}.mcap"), Duration::from_millis(after_ms));
        is_readable(folder.path(), &file, at_s);
        // A file that is cut short is played like a whole one.
        let replay = output(&["replay", text(&file), "--json", "--speed", "max"]);
        assert!(said(&replay).contains("was cut short"), "{}", said(&replay));
        pictures(&replay);
    }
}

/// `cargo test -p host --test suite -- --ignored killed_at_1000_random_moments --nocapture`
#[test]
#[ignore = "a measurement of some minutes"]
fn killed_at_1000_random_moments() {
    const KILLS: u64 = 1_000;
    let next = std::sync::atomic::AtomicU64::new(0);
    let ages = std::sync::Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                let folder = tempfile::tempdir().unwrap();
                loop {
                    let k = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                    if k >= KILLS {
                        break;
                    }
                    // Evenly spread over 1.5 s, in no order.
                    let after = Duration::from_micros(k * 611_953 % 1_500_000);
                    let (file, at_s) = killed(folder.path(), "killed.mcap", after);
                    let age_s = is_readable(folder.path(), &file, at_s);
                    std::fs::remove_file(&file).unwrap();
                    ages.lock().unwrap().push(age_s);
                }
            });
        }
    });
    let mut ages = ages.into_inner().unwrap();
    ages.sort_by(f64::total_cmp);
    let at = |part: f64| ages[(part * (ages.len() - 1) as f64) as usize];
    println!(
        "{} kills: the last frame is older than the kill by {:.2} s median, {:.2} s 99th percentile, {:.2} s at most",
        ages.len(),
        at(0.5),
        at(0.99),
        at(1.0)
    );
    assert!(at(1.0) < 1.0, "on an idle machine nothing older than a second is lost");
}

#[test]
fn a_recording_tells_what_is_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("info.mcap");
    let recorded = output(&["record", text(&file), "--scene", "hand", "--seconds", "1.5"]);
    assert!(recorded.status.success(), "{}", said(&recorded));
    let info: Value = serde_json::from_str(&skin(&["info", text(&file), "--json"])).unwrap();
    let count = |key: &str| info[key].as_u64().unwrap();
    assert_eq!(info["ended"], "closed");
    assert_eq!(info["session"]["board"]["serial"], "sim");
    assert_eq!(
        (count("lost_frames"), count("resets"), count("damaged_messages")),
        (0, 0, 0)
    );
    assert_eq!((count("lost_messages"), count("lost_bytes")), (0, 0));
    let of_topic = |topic: Topic| messages(&file, topic).0.len() as u64;
    assert_eq!(count("pictures"), of_topic(Topic::Touches));
    assert_eq!(info["messages"]["/board"].as_u64().unwrap(), of_topic(Topic::Board));
    assert_eq!(info["messages"]["/host"].as_u64().unwrap(), of_topic(Topic::Host));
    assert!(count("frames") > count("pictures"), "{info}");
    // The pictures are PNG files.
    let (images, _) = messages(&file, Topic::Picture);
    let image: Value = serde_json::from_slice(&images[0].1).unwrap();
    assert!(image["data"].as_str().unwrap().starts_with("iVBORw0KGgo"), "{image}");
    // The log is what was said.
    let (log, _) = messages(&file, Topic::Clock);
    assert!(log.len() >= 2);

    let again = output(&["record", text(&file), "--simulate"]);
    assert_eq!(again.status.code(), Some(1));
    assert!(said(&again).contains("there is such a file"), "{}", said(&again));
}

/// A tip of 25 mm that presses with 25 N from 2.8 s to 12.8 s, on a board that waits for its reader: recorded in no time.
#[cfg(target_os = "linux")]
fn held_press(folder: &Path, faults: &[&str]) -> PathBuf {
    use std::io::{BufRead, BufReader};
    let scene = folder.join("hold.toml");
    let keys = [[2.5, 0.0], [2.8, 25.0], [12.8, 25.0], [13.1, 0.0]]
        .map(|[t, n]| format!("{{ t_s = {t:?}, x_mm = 53.0, y_mm = 28.0, force_n = {n:?} }}"));
    let described = format!(
        "duration_s = 26.0\n[[touch]]\nshape = \"disc\"\nradius_mm = 12.5\nkeys = [{}]\n",
        keys.join(", ")
    );
    std::fs::write(&scene, described).unwrap();
    let arguments = [&["sim", "--pty", "--unpaced", "--scene", text(&scene)], faults].concat();
    let mut board = Started::new(program(&arguments).stdout(Stdio::piped()));
    let mut port = String::new();
    BufReader::new(board.0.stdout.take().unwrap())
        .read_line(&mut port)
        .unwrap();
    let file = folder.join("hold.mcap");
    let recorded = output(&["record", text(&file), "--port", port.trim(), "--seconds", "20"]);
    board.kill();
    assert!(recorded.status.success(), "{}", said(&recorded));
    file
}

/// A board that was reset in the middle of a frame, and bytes that were lost on the way: the same happens in the replay.
#[cfg(target_os = "linux")]
#[test]
fn a_replay_goes_through_a_reset_and_damaged_frames() {
    let folder = tempfile::tempdir().unwrap();
    let faults = ["--fault", "board_reset@6+0.1", "--fault", "bytes_lost:0.0005@8+4"];
    let file = held_press(folder.path(), &faults);
    let info: Value = serde_json::from_str(&skin(&["info", text(&file), "--json"])).unwrap();
    assert_eq!(info["resets"], 1, "{info}");
    assert!(info["damaged_messages"].as_u64().unwrap() > 10, "{info}");
    let replay = output(&["replay", text(&file), "--json", "--speed", "max"]);
    let says = format!("{} pictures, every one with the recorded touches", info["pictures"]);
    assert!(said(&replay).contains(&says), "{}", said(&replay));
    assert_eq!(pictures(&replay).len() as u64, info["pictures"].as_u64().unwrap());
}

/// What reads a board reads a recording, and what reads a table too; all exports hold the same frames.
#[cfg(target_os = "linux")]
#[test]
fn commands_read_a_recording_as_they_read_a_board() {
    let folder = tempfile::tempdir().unwrap();
    let file = held_press(folder.path(), &[]);
    let name = |name: &str| text(&folder.path().join(name)).to_owned();
    let json = |arguments: &[&str]| -> Value { serde_json::from_str(&skin(arguments)).unwrap() };

    let check = json(&["check", "--from", text(&file), "--touch", "53,28", "--json"]);
    assert_eq!(
        (&check["wrong"], &check["electrodes"]),
        (&Value::Bool(false), &Value::from(16))
    );
    let order: Vec<u64> = check["touch"]["order"]
        .as_array()
        .unwrap()
        .iter()
        .map(|l| l.as_u64().unwrap())
        .collect();
    assert_eq!(order, (1..=16).collect::<Vec<u64>>(), "{check}");

    // The default rubber: a third again with 5 s, 0.2546 N/mm².
    let out = name("calibration.toml");
    let calibration = json(&[
        "calibrate",
        "--from",
        text(&file),
        "--force-n",
        "25",
        "--seconds",
        "18",
        "--json",
        "--out",
        &out,
    ]);
    for (key, wanted, within) in [
        ("delayed_ratio", 1.0 / 3.0, 0.025),
        ("tau_s", 5.0, 0.4),
        ("unit_rise_mpa", 0.2546, 0.012),
    ] {
        let found = calibration[key].as_f64().unwrap();
        assert!((found - wanted).abs() < within, "{key}: {found}, not {wanted}");
    }

    // A part without the baseline says so.
    let part = ["--from-s", "0", "--to-s", "16", "--every", "40"];
    let refused = output(&["reconstruct", "--from", text(&file), "--from-s", "5"]);
    assert!(
        said(&refused).contains("name some with --baseline"),
        "{}",
        said(&refused)
    );
    let frames = |arguments: &[&str]| -> Vec<Value> {
        let lines = skin(&[&["reconstruct", "--json", "--no-progress"], arguments].concat());
        lines.lines().map(|l| serde_json::from_str(l).unwrap()).collect()
    };
    let touches = |frames: &[Value]| -> Vec<Value> { frames.iter().map(|f| f["touches"].clone()).collect() };
    let [csv, npz, mat, plain] = ["a.csv", "a.npz", "a.mat", "a.frames.csv"].map(name);
    for (format, out) in [("csv", &csv), ("npz", &npz), ("mat", &mat), ("frames-csv", &plain)] {
        skin(&[&["export", text(&file), "--to", format, "--out", out], &part[..]].concat());
    }
    let first = ["--baseline", "t0.0000"];
    let direct = frames(&[&["--from", text(&file)], &part[..], &first[..]].concat());
    let from_csv = frames(&[&[csv.as_str()], &first[..]].concat());
    assert_eq!(touches(&direct), touches(&from_csv));
    let found = direct.iter().filter_map(|f| f["touches"].get(0));
    let off = |t: &Value| (t["x_mm"].as_f64().unwrap() - 53.0).hypot(t["y_mm"].as_f64().unwrap() - 28.0);
    let (near, all) = found.fold((0, 0), |(near, all), t| (near + i32::from(off(t) < 4.0), all + 1));
    assert!(all > 25 && near == all, "{near} of {all}");
    // One baseline of several frames, by another name in each file.
    let numbered = [
        frames(&[&npz, "--order", "pyeit", "--variable", "v", "--baseline", "1"]),
        frames(&[&mat, "--order", "eidors", "--variable", "vi", "--baseline", "1"]),
        frames(&[&plain, "--order", "adjacent16", "--baseline", "1"]),
    ];
    for other in &numbered {
        assert_eq!(touches(other), touches(&direct));
    }
    // The whole recording knows the frames of its baseline.
    let whole = frames(&["--from", text(&file), "--to-s", "6"]);
    let at_end = whole.last().unwrap()["touches"][0].clone();
    assert!(off(&at_end) < 2.0, "{at_end}");
}

/// Whether two values are the same to the six digits that are printed.
#[cfg(target_os = "linux")]
fn same_digits(printed: &Value, recorded: &Value) -> bool {
    match (printed, recorded) {
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same_digits(a, b)),
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len() && a.iter().all(|(k, a)| b.get(k).is_some_and(|b| same_digits(a, b)))
        }
        (Value::Number(a), Value::Number(b)) => {
            let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
            (a - b).abs() <= 5.1e-6 * b.abs()
        }
        (a, b) => a == b,
    }
}

/// Waits until a recording that goes on holds what is wanted.
#[cfg(target_os = "linux")]
fn until(file: &Path, child: &mut Started, holds: impl Fn(&[(u64, Vec<u8>)]) -> bool) {
    loop {
        let ready = Reader::open(file).is_ok() && holds(&messages(file, Topic::Live).0);
        if ready {
            return;
        }
        assert!(child.0.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// How many steps of a kind there are.
#[cfg(target_os = "linux")]
fn steps(live: &[(u64, Vec<u8>)], kind: &str) -> usize {
    let is = |m: &&(u64, Vec<u8>)| serde_json::from_slice::<Value>(&m.1).unwrap()["step"] == kind;
    live.iter().filter(is).count()
}

/// Somebody at the page takes the baseline anew while a hand presses, and takes it back; the program is ended by a signal. The
/// replay does the same at the same frames.
#[cfg(target_os = "linux")]
#[test]
fn a_replay_takes_baselines_where_the_page_did() {
    use std::io::{BufRead, BufReader, Read, Write};
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("page.mcap");
    let arguments = [
        "run",
        "--scene",
        "hand",
        "--listen",
        "0",
        "--no-open",
        "--record",
        text(&file),
    ];
    let mut child = Started::new(program(&arguments).stdout(Stdio::null()).stderr(Stdio::piped()));
    let mut lines = BufReader::new(child.0.stderr.take().unwrap()).lines();
    let url = lines
        .find_map(|l| Some(l.unwrap().split_once("http://")?.1.split(' ').next()?.to_owned()))
        .unwrap();
    let (address, token) = url.split_once("/#").unwrap();
    // The rest is read so that the program never waits for it.
    let rest = std::thread::spawn(move || lines.count());

    let mut page = std::net::TcpStream::connect(address).unwrap();
    let hello = format!(
        "GET /live HTTP/1.1\r\nHost: {address}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: \
         dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    );
    page.write_all(hello.as_bytes()).unwrap();
    let mut answer = [0; 12];
    page.read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"HTTP/1.1 101");
    // A text of a WebSocket, masked by zeros.
    let mut ask = |text: &str| {
        let head = [0x81, 0x80 | u8::try_from(text.len()).unwrap(), 0, 0, 0, 0];
        page.write_all(&[&head, text.as_bytes()].concat()).unwrap();
    };
    until(&file, &mut child, |live| steps(live, "in_force") == 1);
    ask(&format!("{{\"kind\":\"enter\",\"key\":\"{token}\"}}"));
    ask("{\"kind\":\"tare\"}");
    until(&file, &mut child, |live| {
        steps(live, "tare") == 1 && steps(live, "in_force") == 2
    });
    ask("{\"kind\":\"undo_baseline\"}");
    until(&file, &mut child, |live| {
        steps(live, "resume") == 1 && steps(live, "in_force") == 3
    });
    let pictures = |file: &Path| messages(file, Topic::Touches).0.len();
    let so_far = pictures(&file);
    until(&file, &mut child, |_| pictures(&file) > so_far + 30);
    Command::new("kill").arg(child.0.id().to_string()).status().unwrap();
    assert!(child.0.wait().unwrap().success());
    rest.join().unwrap();

    let replay = output(&["replay", text(&file), "--json", "--speed", "max"]);
    let (recorded, ended) = messages(&file, Topic::Touches);
    assert_eq!(ended, Ended::Whole);
    let shown = self::pictures(&replay);
    let says = format!("{} pictures, every one with the recorded touches", recorded.len());
    assert!(said(&replay).contains(&says), "{}", said(&replay));
    for (shown, (_, recorded)) in shown.iter().zip(&recorded) {
        let recorded: Value = serde_json::from_slice(recorded).unwrap();
        assert_eq!(shown["frame"], recorded["frame"]);
        assert!(
            same_digits(&shown["touches"], &recorded["touches"]),
            "{shown} {recorded}"
        );
    }
    assert_eq!(shown.len(), recorded.len());
}
