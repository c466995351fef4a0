//! Every kind of file, mutated: whatever is in it, a reader gives a result or says what is wrong.
//!
//! `MUTATED=100000 cargo test -p host mutated -- --nocapture --test-threads 1` tries so many of each kind, and prints how
//! many were taken, the slowest by the processor's time of its thread, and the most memory that the process had until then.
//! docs/reliability.md has its figures.

mod datasets;
mod presses;

use crate::config::Config;
use crate::files::arrays;
use crate::files::baseline_file;
use crate::files::measurements::MeasurementTable;
use crate::files::sheet_line::SheetLine;
use crate::files::{before, calibration_file, ordered, press_table};
use crate::skin_file;
use crate::table_pattern::TablePattern;
use ::forward::file::parse_sheet;
use ::forward::order::ValueOrder;
use ::forward::{Drive, Model, ModelOptions, Pattern, Solver};
use ::recording::Reader;
use hil_sim::SceneFile;
use link::flash::Image;
use std::path::Path;
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

/// SplitMix64 (Steele et al. 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    fn of<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.below(list.len())]
    }
}

const NUMBERS: [&str; 30] = [
    "0",
    "-0.0",
    "1",
    "-1",
    "2",
    "3",
    "16",
    "255",
    "256",
    "257",
    "1024",
    "65536",
    "4294967295",
    "9223372036854775807",
    "18446744073709551616",
    "0.5",
    "1e-3",
    "1e-9",
    "1e-300",
    "5e-324",
    "1e6",
    "1e9",
    "1e18",
    "1e154",
    "1e308",
    "1.7976931348623157e308",
    "nan",
    "inf",
    "-inf",
    "0x10",
];
const TEXTS: [&str; 12] = [
    "",
    "\0",
    "\u{feff}",
    "é",
    "\u{202e}",
    "\"",
    "[[",
    "{",
    "#",
    ",",
    "\n",
    "magnitudes :",
];
const WORDS: [u32; 8] = [0, 1, 0x7f, 0xff, 0x7fff_ffff, 0x8000_0000, 0xffff_fff0, 0xffff_ffff];

/// Places of the numbers of a text.
fn numbers(text: &[u8]) -> Vec<(usize, usize)> {
    let part = |b: &u8| b.is_ascii_digit() || b".-+e".contains(b);
    let mut found = Vec::new();
    let mut at = 0;
    while at < text.len() {
        let len = text[at..].iter().take_while(|b| part(b)).count();
        if len > 0 && text[at..at + len].iter().any(u8::is_ascii_digit) {
            found.push((at, at + len));
        }
        at += len.max(1);
    }
    found
}

/// Changes a number: to an extreme one, or by some powers of ten. Half of all files of text are changed so only: these get
/// deepest.
fn other_number(text: &mut Vec<u8>, random: &mut Random) {
    let places = numbers(text);
    if places.is_empty() {
        return;
    }
    let (from, to) = places[random.below(places.len())];
    let old: Option<f64> = std::str::from_utf8(&text[from..to]).ok().and_then(|t| t.parse().ok());
    let new = match (random.below(2), old) {
        (0, Some(old)) => {
            let decades = random.next() as f64 / u64::MAX as f64 * 12.0 - 6.0;
            format!("{:?}", old * 10_f64.powf(decades))
        }
        _ => random.of(&NUMBERS).to_owned(),
    };
    text.splice(from..to, new.into_bytes());
}

/// Flips, cuts, doubles, moves and replaces.
fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    let at = random.below(bytes.len() + 1);
    let end = (at + random.below(64)).min(bytes.len());
    match random.below(9) {
        0 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
        1 => bytes.truncate(at),
        2 => drop(bytes.drain(at..end)),
        3 => {
            let piece = bytes[at..end].to_vec();
            let to = random.below(bytes.len() + 1);
            bytes.splice(to..to, piece);
        }
        4 => drop(bytes.splice(at..end, random.of(&TEXTS).bytes())),
        5 if at + 4 <= bytes.len() => bytes[at..at + 4].copy_from_slice(&random.of(&WORDS).to_le_bytes()),
        6 => {
            let mut lines: Vec<&[u8]> = bytes.split_inclusive(|b| *b == b'\n').collect();
            let (a, b) = (random.below(lines.len()), random.below(lines.len()));
            lines.swap(a, b);
            *bytes = lines.concat();
        }
        7 => drop(bytes.splice(at..at, "[".repeat(random.below(3000)).into_bytes())),
        _ => {
            let noise: Vec<u8> = (at..end).map(|_| random.next() as u8).collect();
            bytes.splice(at..end, noise);
        }
    }
}

/// Processor time of this thread; where the system does not tell, time by the clock.
fn spent() -> Duration {
    static BEGIN: LazyLock<Instant> = LazyLock::new(Instant::now);
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|text| text.split_whitespace().next()?.parse().ok());
    nanoseconds.map_or_else(|| BEGIN.elapsed(), Duration::from_nanos)
}

/// Feeds so many mutated files, and the whole ones first, to a reader that says whether it takes them.
fn feed(kind: &str, whole: &[Vec<u8>], text: bool, mut take: impl FnMut(&[u8]) -> bool) {
    for (k, bytes) in whole.iter().enumerate() {
        assert!(take(bytes), "{kind} {k} is not taken before it is mutated");
    }
    let asked = std::env::var("MUTATED").ok().and_then(|n| n.parse().ok());
    let count: u64 = asked.unwrap_or(1000);
    let (mut taken, mut slowest) = (0, (Duration::ZERO, 0));
    for seed in 0..count {
        let mut random = Random(seed);
        let mut bytes = whole[random.below(whole.len())].clone();
        let only_numbers = text && random.below(2) == 0;
        for _ in 0..=random.below(4) {
            if only_numbers || text && random.below(3) == 0 {
                other_number(&mut bytes, &mut random);
            } else if !bytes.is_empty() {
                damage(&mut bytes, &mut random);
            }
        }
        let start = spent();
        taken += u64::from(take(&bytes));
        slowest = slowest.max((spent().saturating_sub(start), seed));
    }
    assert!(taken > 0 && taken < count, "{kind}: {taken} of {count} taken");
    if asked.is_some() {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let memory = status
            .lines()
            .find_map(|l| l.strip_prefix("VmHWM:"))
            .unwrap_or(" unknown");
        let (time, seed) = slowest;
        println!(
            "| {kind} | {count} | {taken} | {:.2} s (seed {seed}) | {} |",
            time.as_secs_f64(),
            memory.trim()
        );
    }
}

fn file(path: &str) -> Vec<u8> {
    let folder = env!("CARGO_MANIFEST_DIR");
    std::fs::read(format!("{folder}/{path}")).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn utf8(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap_or("\u{fffd} other bytes")
}

#[test]
fn mutated_tables() {
    let names = [
        "../tests/data/lct2004_voltage.csv",
        "tests/cli/thirty-two.csv",
        "tests/cli/other-sheet.csv",
    ];
    feed("table of frames", &names.map(file), true, |bytes| {
        let read = MeasurementTable::parse("t", bytes, |_, _| ());
        let Ok(table) = read.inspect_err(|e| assert!(!e.to_string().is_empty())) else {
            return false;
        };
        let values = || table.columns.iter().map(|c| &c.values);
        assert!(values().all(|v| v.len() == table.measurements.len() && v.iter().all(|v| !v.is_infinite())));
        let pattern = TablePattern::of_rows(table.electrodes, &table.measurements);
        let _ = pattern.missing_text(&table.measurements);
        Pattern::from_list(table.electrodes, table.measurements.clone()).is_ok()
    });
}

#[test]
fn mutated_arrays() {
    let line = (0..208)
        .map(|k| format!("{:.3}", 1.0 + 0.01 * f64::from(k)))
        .collect::<Vec<_>>()
        .join(",");
    let mut npy = b"\x93NUMPY\x01\0".to_vec();
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 208), }\n";
    npy.extend((header.len() as u16).to_le_bytes());
    npy.extend(header.as_bytes());
    npy.extend((0..208).flat_map(|k| (1.0 + f64::from(k)).to_le_bytes()));
    feed("frames of another program", &[line.into_bytes(), npy], true, |bytes| {
        let Ok((kind, arrays)) = arrays::parse("t", bytes) else {
            return false;
        };
        assert!(arrays.iter().all(|a| a.values.len() == a.rows * a.columns));
        let tables = ValueOrder::ALL
            .iter()
            .filter_map(|order| ordered::table(*order, "t", kind, &arrays, &[]).ok());
        tables.map(|t| assert!(!t.columns.is_empty())).count() > 0
    });
}

#[test]
fn mutated_sheets() {
    let ring = "[electrode_ring]\ncount = 8\nwidth_mm = 10.0\ncontact_mm = 1.0\nfirst_deg = 3.0\nclockwise = true\n";
    let head = "sheet_resistance_ohm = 800.0\n";
    let whole = [
        file("tests/cli/four-electrodes.toml"),
        format!(
            "{head}outline = {{ kind = \"rectangle\", width_mm = 200.0, height_mm = 120.0 }}\nholes = [{{ kind = \"disc\", \
             diameter_mm = 20.0, centre_mm = [30.0, 0.0] }}]\n{ring}[[electrodes]]\ncentre_mm = [-20.0, 0.0]\nradius_mm = 3.0\n\
             contact_mm = 1.0\n[pattern]\ndrive_step = 1\nsense_step = 2\n"
        )
        .into_bytes(),
        format!(
            "{head}outline = {{ kind = \"smooth\", points_mm = [[-50.0, -50.0], [60.0, -40.0], [40.0, 70.0], [-30.0, 40.0]] }}\n{ring}"
        )
        .into_bytes(),
        format!(
            "{head}outline = {{ kind = \"polygon\", points_mm = [[-50.0, -50.0], [60.0, -40.0], [40.0, 70.0]] }}\n\
             [[electrodes]]\nangle_deg = 10.0\nwidth_mm = 5.0\ncontact_mm = 1.0\n[[electrodes]]\narc_mm = 20.0\nwidth_mm = 5.0\n\
             contact_mm = 1.0\n[[electrodes]]\npoint_mm = [-50.0, -50.0]\nwidth_mm = 5.0\ncontact_mm = 1.0\n[[electrodes]]\n\
             angle_deg = 200.0\nwidth_mm = 5.0\ncontact_mm = 1.0\n[pattern]\nmeasurements = [[1, 2, 3, 4], [2, 3, 4, 1]]\n"
        )
        .into_bytes(),
    ];
    // The accuracy of `skin forward` makes no mesh larger than the limits, but takes its time.
    let options = ModelOptions {
        accuracy: 1e-2,
        ..ModelOptions::default()
    };
    feed("sheet", &whole, true, |bytes| {
        let Ok((sheet, pattern)) = parse_sheet(utf8(bytes)) else {
            return false;
        };
        let Ok(model) = Model::new(&sheet, &options) else {
            return false;
        };
        let line = SheetLine::of(&sheet).unwrap();
        assert!(line.area_cm2.is_finite() && line.size_mm.iter().all(|v| v.is_finite()));
        let Ok(solver) = Solver::new(Arc::new(model)) else {
            return false;
        };
        let volts = Drive::PAPER.frame_v(solver.electrode_matrix(), &pattern);
        assert!(volts.iter().all(|v| v.is_finite()), "{volts:?}");
        true
    });
}

#[test]
fn mutated_scenes() {
    let names = [
        "creep",
        "drifting-sheet",
        "fast-tap",
        "hand",
        "lost-electrode",
        "noisy-motor",
        "preload",
    ];
    let whole = names.map(|name| file(&format!("../hil-sim/scenes/{name}.toml")));
    feed("scene", &whole, true, |bytes| {
        let Ok(scene) = SceneFile::parse(utf8(bytes), None) else {
            return false;
        };
        assert!(scene.duration_s.is_finite());
        for touch in &scene.scene.touches {
            for k in 0..10 {
                let key = touch.at(scene.duration_s * 0.1 * f64::from(k));
                assert!(key.is_none_or(|key| [key.x_mm, key.y_mm, key.force_n].iter().all(|v| v.is_finite())));
            }
        }
        true
    });
}

#[test]
fn mutated_calibrations() {
    let whole = b"delayed_ratio = 0.3\ntau_s = 5.0\nexponent = 1.0\nunit_rise_mpa = 0.25\nforce_sd_n = 0.1\n".to_vec();
    feed("calibration", &[whole], true, |bytes| {
        let Ok(calibration) = calibration_file::parse("t", utf8(bytes)) else {
            return false;
        };
        let text = calibration_file::text(&calibration, None).unwrap();
        assert_eq!(calibration_file::parse("t", &text).unwrap(), calibration);
        true
    });
}

#[test]
fn mutated_press_tables() {
    let mut whole = "time_s,force_n,rise_mm2,area_mm2\n".to_owned();
    let mut delayed = 0.0;
    for k in 0..150 {
        let force = if (20..90).contains(&k) { 25.0 } else { 0.0 };
        delayed += 0.1 * (0.3 * force - delayed);
        whole += &format!("{:.2},{force},{:.4},490\n", 0.1 * f64::from(k), 4.0 * (force + delayed));
    }
    feed("table of a press", &[whole.into_bytes()], true, |bytes| {
        let Ok(samples) = press_table::parse("t", utf8(bytes), Some(25.0)) else {
            return false;
        };
        let Ok(fit) = inverse::force::calibration::fit(&samples, false) else {
            return false;
        };
        fit.calibration.solid.check().unwrap();
        assert!(fit.calibration.force_sd_n.is_finite() && fit.residual_mm2.is_finite());
        true
    });
}

#[test]
fn mutated_lists_of_what_came_before() {
    feed(
        "list of frames before",
        &[file("tests/cli/before.csv")],
        true,
        |bytes| before::parse("t", utf8(bytes)).is_ok(),
    );
}

#[test]
fn mutated_baselines() {
    let (subject, whole) = baseline_file::tests::sample();
    feed("stored baseline", &[whole.into_bytes()], true, |bytes| {
        let Ok(stored) = baseline_file::parse("t", utf8(bytes), &subject) else {
            return false;
        };
        assert!(stored.baseline.values_v.iter().all(|v| !v.is_infinite()));
        assert!(stored.baseline.noise_v.is_finite());
        true
    });
}

#[test]
fn mutated_recordings() {
    feed("recording", &[file("tests/cli/short.mcap")], false, |bytes| {
        let Ok(mut reader) = Reader::new(bytes, "t") else {
            return false;
        };
        loop {
            match reader.next() {
                Ok(Some(message)) => assert!(message.data.len() <= 64 << 20),
                Ok(None) => return true,
                Err(_) => return false,
            }
        }
    });
}

#[test]
fn mutated_programs() {
    feed(
        "program (ELF)",
        &[file("../fuzz/seeds/programs/board.elf")],
        false,
        |bytes| Image::read(bytes).is_ok_and(|image| !image.is_empty()),
    );
}

#[test]
fn mutated_files_of_skins() {
    let whole = "[[skin]]\nname = \"left\"\nserial = \"A7\"\nsheet = \"square.toml\"\nwires = [2, 1, 3, 4]\n[skin.place]\n\
                 frame = \"base\"\nposition_mm = [1.0, 2.0, 3.0]\n[[skin]]\nname = \"right\"\nscene = \"hand\"\nplan = \"fast\"\n";
    feed("file of skins", &[whole.into()], true, |bytes| {
        skin_file::parse(utf8(bytes), Path::new("")).is_ok_and(|skins| !skins.is_empty())
    });
}

#[test]
fn mutated_configurations() {
    let whole = "serial = \"A7\"\nsheet = \"square.toml\"\ncalibration = \"skin.cal\"\nlisten = 9000\nopen = false\n";
    feed("configuration", &[whole.into()], true, |bytes| {
        Config::of(utf8(bytes), Some(Path::new("skin/config.toml")), &|_| None).is_ok()
    });
}
