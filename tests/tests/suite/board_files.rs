//! The drawn board's files against each other: description, lists, docs/board.md, the firmware's pins; and the phantom's
//! values by two ways.

use forward::{Model, ModelOptions, Pair, Sheet, Solver};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn text(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// Rows of a generated list by the names in its first line. Fields in quotation marks may have commas.
fn list(path: &str) -> Vec<BTreeMap<String, String>> {
    let split = |line: &str| {
        let (mut fields, mut quoted) = (vec![String::new()], false);
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => fields.push(String::new()),
                _ => fields.last_mut().unwrap().push(c),
            }
        }
        fields
    };
    let text = text(path);
    let mut lines = text.lines();
    let names = split(lines.next().unwrap());
    let rows: Vec<BTreeMap<String, String>> = lines
        .map(|line| {
            let fields = split(line);
            assert_eq!(fields.len(), names.len(), "{path}: {line}");
            names.iter().cloned().zip(fields).collect()
        })
        .collect();
    assert!(!rows.is_empty(), "{path} is empty");
    rows
}

/// Rows of the table in docs/board.md whose first line begins so.
fn table(head: &str) -> Vec<Vec<String>> {
    let text = text("docs/board.md");
    let from = text
        .find(&format!("\n{head}"))
        .unwrap_or_else(|| panic!("docs/board.md has no table {head}"));
    text[from..]
        .lines()
        .skip(1)
        .take_while(|line| line.starts_with('|'))
        .skip(2)
        .map(|line| {
            let cells = line.trim_matches('|').split('|');
            cells.map(|cell| cell.trim().to_owned()).collect()
        })
        .collect()
}

/// The four multiplexers, as the lists, docs/board.md and the programs name them.
const MULTIPLEXERS: [(&str, &str, &str); 4] = [
    ("sense -", "sense −", "SENSE_MINUS"),
    ("sense +", "sense +", "SENSE_PLUS"),
    ("drive +", "drive +", "DRIVE_PLUS"),
    ("drive -", "drive −", "DRIVE_MINUS"),
];

/// `address` and `enable` of the constant of this name in a program.
fn lines_of(program: &str, name: &str) -> [u32; 2] {
    let from = program
        .find(&format!("const {name}: "))
        .unwrap_or_else(|| panic!("no constant {name}"));
    let end = program[from..].find(';').unwrap();
    ["address: ", "enable: "].map(|field| {
        let constant = &program[from..from + end];
        let value = &constant[constant.find(field).unwrap() + field.len()..];
        let digits: String = value.chars().take_while(char::is_ascii_digit).collect();
        digits.parse().unwrap()
    })
}

/// Processor pin by what it is for, of the generated list.
fn pins() -> BTreeMap<String, BTreeMap<String, String>> {
    list("hardware/generated/pins.csv")
        .into_iter()
        .map(|row| (row["pin"].clone(), row))
        .collect()
}

#[test]
fn the_program_and_the_emulated_board_have_the_pins_of_the_description() {
    let pins = pins();
    let function = |pin: &str| {
        pins.get(pin)
            .map_or("nothing", |row| row["function"].as_str())
            .to_owned()
    };
    for path in ["boards/stm32f4/src/lines.rs", "boards/emulator/src/world.rs"] {
        let program = text(path);
        for (name, _, constant) in MULTIPLEXERS {
            let [address, enable] = lines_of(&program, constant);
            for bit in 0..3 {
                assert_eq!(
                    function(&format!("PB{}", address + bit)),
                    format!("address A{bit} of {name}"),
                    "{path}"
                );
            }
            for half in 0..2 {
                let (first, last) = (8 * half + 1, 8 * half + 8);
                assert_eq!(
                    function(&format!("PC{}", enable + half)),
                    format!("enable of {name}, electrodes {first}-{last}"),
                    "{path}"
                );
            }
        }
    }
    let sampler = text("boards/stm32f4/src/sampler.rs");
    for (input, wanted) in [
        ("Amplified", "converter, amplifier"),
        ("Divided", "converter, difference amplifier"),
        ("Source", "converter, source"),
    ] {
        let from = sampler.find(&format!("{input} = ")).unwrap() + input.len() + 3;
        let channel: String = sampler[from..].chars().take_while(char::is_ascii_digit).collect();
        assert_eq!(function(&format!("PA{channel}")), wanted);
    }
    let busy = text("boards/stm32f4/src/lines.rs");
    assert!(busy.contains("const BUSY_PIN: u32 = 1 << 8;"));
    assert_eq!(function("PA8"), "busy");
}

#[test]
fn the_table_of_pins_is_that_of_the_description() {
    let pins = pins();
    let mut seen = BTreeSet::new();
    for row in table("| pin | Nucleo | is | goes to |") {
        let names: Vec<&str> = row[0].split(", ").collect();
        let places: Vec<&str> = row[1].split(", ").collect();
        assert_eq!(names.len(), places.len(), "{row:?}");
        for (k, (name, place)) in names.iter().zip(&places).enumerate() {
            let pin = pins
                .get(*name)
                .unwrap_or_else(|| panic!("docs/board.md: {name} is not in pins.csv"));
            assert_eq!(pin["connector"], *place, "{name}");
            assert!(seen.insert((*name).to_owned()), "{name} is in two rows");
            // The words: a multiplexer's address lines from the lowest on and its enables from the first half on; the
            // converter's input by its number.
            for (given, shown, _) in MULTIPLEXERS {
                let [address, enable] = ["address", "enable"].map(|kind| {
                    let of = format!("{kind} of {shown}");
                    row[2] == of || row[2].starts_with(&format!("{of},"))
                });
                if address {
                    assert_eq!(pin["function"], format!("address A{k} of {given}"), "{name}");
                }
                if enable {
                    let (first, last) = (8 * k + 1, 8 * k + 8);
                    let function = format!("enable of {given}, electrodes {first}-{last}");
                    assert_eq!(pin["function"], function, "{name}");
                }
                let line = pin["function"].contains(&format!(" of {given}"));
                assert!(
                    !line || address || enable,
                    "{name} is {}, not {}",
                    pin["function"],
                    row[2]
                );
            }
            if let Some(input) = row[2].strip_prefix("converter input ") {
                assert!(pin["function"].starts_with("converter"), "{name}");
                assert_eq!(format!("PA{}", &input[..1]), *name);
            }
            for chip in pin["goes_to"].split(' ').filter(|to| to.starts_with('U')) {
                let chip = chip.split('-').next().unwrap();
                let words: Vec<&str> = row[3].split([' ', ';', ',']).collect();
                assert!(
                    words.contains(&chip),
                    "{name} goes to {chip}, docs/board.md says {}",
                    row[3]
                );
            }
        }
    }
    let listed: BTreeSet<String> = pins.into_keys().collect();
    assert_eq!(seen, listed, "pins of docs/board.md and of the description");
}

/// The board with sixteen channels: description, docs/board.md, the program and the emulated board.
#[test]
fn the_board_with_sixteen_channels_has_the_pins_of_its_description() {
    let pins: BTreeMap<String, BTreeMap<String, String>> = list("hardware/generated/sixteen/pins.csv")
        .into_iter()
        .map(|row| (row["pin"].clone(), row))
        .collect();
    let function = |pin: String| {
        pins.get(&pin)
            .map_or("nothing", |row| row["function"].as_str())
            .to_owned()
    };
    for path in ["boards/stm32h7/src/lines.rs", "boards/emulator/src/h743/world.rs"] {
        let program = text(path);
        for (name, _, constant) in MULTIPLEXERS {
            let [address, enable] = lines_of(&program, constant);
            for bit in 0..3 {
                let is = function(format!("PE{}", address + bit));
                assert_eq!(is, format!("address A{bit} of {name}"), "{path}");
            }
            for half in 0..2 {
                let is = function(format!("PD{}", enable + half));
                let (first, last) = (8 * half + 1, 8 * half + 8);
                assert_eq!(is, format!("enable of {name}, electrodes {first}-{last}"), "{path}");
            }
        }
    }
    assert!(text("boards/stm32h7/src/lines.rs").contains("const BUSY_PIN: u32 = 1 << 14;"));
    assert_eq!(function("PE14".to_owned()), "busy");

    // Inputs of the converters by pin (DS12110 table 8).
    let inputs: BTreeMap<&str, u32> = [
        ("PA0", 16),
        ("PF11", 2),
        ("PF12", 6),
        ("PA3", 15),
        ("PA5", 19),
        ("PA6", 3),
        ("PB1", 5),
        ("PC0", 10),
        ("PF3", 5),
        ("PF4", 9),
        ("PF5", 4),
        ("PF6", 8),
        ("PF7", 3),
        ("PF8", 7),
        ("PF9", 2),
        ("PF10", 6),
        ("PF13", 2),
        ("PF14", 6),
        ("PC1", 11),
    ]
    .into();
    let of = |what: String| {
        let found = pins.iter().find(|(_, row)| row["function"] == what);
        inputs[found.unwrap_or_else(|| panic!("no pin is {what}")).0.as_str()].to_string()
    };
    let first: Vec<String> = (0..8).map(|k| of(format!("converter, channel {k}"))).collect();
    let second: Vec<String> = (0..8).map(|k| of(format!("converter, channel {}", k + 8))).collect();
    let behind = ["amplifier", "difference amplifier", "source"].map(|what| of(format!("converter, {what}")));
    let program = text("boards/stm32h7/src/converter.rs");
    for (name, inputs) in [("FIRST", &first[..]), ("SECOND", &second[..]), ("THIRD", &behind[..])] {
        let line = format!("const {name}: [u8; {}] = [{}];", inputs.len(), inputs.join(", "));
        assert!(program.contains(&line), "{line}");
    }
    let emulated = text("boards/emulator/src/h743/converter.rs");
    for inputs in [&first, &second] {
        assert!(emulated.contains(&format!("place(&[{}])", inputs.join(", "))));
    }

    let mut seen = BTreeSet::new();
    for row in table("| pin | Nucleo-144 | is |") {
        let names: Vec<&str> = row[0].split(", ").collect();
        let places: Vec<&str> = row[1].split(", ").collect();
        assert_eq!(names.len(), places.len(), "{row:?}");
        for (name, place) in names.iter().zip(places) {
            assert_eq!(pins[*name]["connector"], place, "{name}");
            assert!(seen.insert((*name).to_owned()), "{name} is in two rows");
        }
    }
    assert_eq!(seen, pins.into_keys().collect::<BTreeSet<String>>());
}

/// Each channel's amplifier is on its electrode and the next one, and its output at the pin of the list.
#[test]
fn every_channel_is_wired_to_its_electrodes_and_its_pin() {
    let mut nets: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for wire in list("hardware/generated/sixteen/wiring.csv") {
        let net = nets.entry(wire["net"].clone()).or_default();
        net.extend([wire["from"].clone(), wire["to"].clone()]);
    }
    let rows = list("hardware/generated/sixteen/channels.csv");
    assert_eq!(rows.len(), 16);
    for (n, row) in rows.iter().enumerate() {
        let (amplifier, plus) = (&row["amplifier"], (n + 1) % 16 + 1);
        assert_eq!(row["channel"], n.to_string());
        assert!(nets[&format!("S{plus}")].contains(&format!("{amplifier}-4")), "{n}");
        assert!(nets[&format!("S{}", n + 1)].contains(&format!("{amplifier}-1")), "{n}");
        assert!(nets[&format!("AMP{n}")].contains(&format!("{amplifier}-7")), "{n}");
        assert!(nets[&row["pin"]].contains(&format!("{}-2", row["protection"])), "{n}");
    }
}

/// Pins by net, put together from the single wires of a folder's wiring.csv.
fn nets(folder: &str) -> BTreeMap<String, BTreeSet<String>> {
    let mut nets: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for wire in list(&format!("{folder}/wiring.csv")) {
        let net = nets.entry(wire["net"].clone()).or_default();
        // Each wire goes on where one before it ended.
        assert!(net.is_empty() || net.contains(&wire["from"]), "{wire:?}");
        net.extend([wire["from"].clone(), wire["to"].clone()]);
    }
    nets
}

#[test]
fn every_electrode_has_its_wire_to_every_multiplexer() {
    // Pins of Y0 to Y7 of a 4051.
    const Y: [usize; 8] = [13, 14, 15, 12, 1, 5, 2, 4];
    // Chips of the lower and the upper eight electrodes, by column of the list.
    const CHIPS: [(&str, [&str; 2]); 4] = [
        ("sense_minus", ["U4", "U5"]),
        ("sense_plus", ["U6", "U7"]),
        ("drive_plus", ["U8", "U9"]),
        ("drive_minus", ["U10", "U11"]),
    ];
    let rows = list("hardware/generated/electrodes.csv");
    let nets = nets("hardware/generated");
    assert_eq!(rows.len(), 16);
    let mut used = BTreeSet::new();
    for (k, row) in rows.iter().enumerate() {
        assert_eq!(row["electrode"], (k + 1).to_string());
        assert_eq!(row["connector"], format!("J1-{}", k + 1));
        let electrode = &nets[&format!("E{}", k + 1)];
        let sense = &nets[&format!("S{}", k + 1)];
        for (column, chips) in CHIPS {
            let place = format!("{}-{}", chips[k / 8], Y[k % 8]);
            assert_eq!(row[column], place);
            let net = if column.starts_with("drive") { electrode } else { sense };
            assert!(net.contains(&place), "{place} is not wired to electrode {}", k + 1);
            used.insert(place);
        }
        let (resistor, esd) = (&row["resistor"], &row["esd"]);
        assert!(electrode.contains(&row["connector"]) && electrode.contains(&format!("{esd}-1")));
        assert!(electrode.contains(&format!("{resistor}-1")) && sense.contains(&format!("{resistor}-2")));
    }
    assert_eq!(used.len(), 64);
}

/// Parts that a folder's bom.csv has, each once, are those that its wiring.csv has.
fn parts(folder: &str) -> Vec<BTreeMap<String, String>> {
    let rows = list(&format!("{folder}/bom.csv"));
    let mut references = BTreeSet::new();
    for row in &rows {
        for field in ["package", "mpn", "maker", "second_mpn", "seen"] {
            assert!(!row[field].is_empty(), "{folder}: {field} of {}", row["references"]);
        }
        if row["references"] == "-" {
            continue;
        }
        let parts: Vec<&str> = row["references"].split(' ').collect();
        assert_eq!(row["quantity"], parts.len().to_string(), "{}", row["references"]);
        for part in parts {
            assert!(references.insert(part.to_owned()), "{folder}: {part} twice");
        }
    }
    let wired: BTreeSet<String> = nets(folder)
        .into_values()
        .flatten()
        .map(|pin| pin.split('-').next().unwrap().to_owned())
        .filter(|part| !part.starts_with("TP"))
        .collect();
    assert_eq!(references, wired, "{folder}: parts bought and parts wired");
    rows
}

/// Pieces of a value in a parts list.
fn pieces(rows: &[BTreeMap<String, String>], value: &str) -> u32 {
    let of_value = rows.iter().filter(|r| r["value"] == value);
    of_value.map(|r| r["quantity"].parse::<u32>().unwrap()).sum()
}

#[test]
fn the_parts_lists_have_every_part_once_and_what_the_page_says() {
    let rows = parts("hardware/generated");
    for row in table("| part | quantity | package |") {
        assert_eq!(pieces(&rows, &row[0]).to_string(), row[1], "{}", row[0]);
    }
    let rows = parts("hardware/generated/sixteen");
    let said = ["INA826", "BAT85"]
        .map(|part| format!("{} {part}", pieces(&rows, part)))
        .join(", ");
    assert!(text("docs/board.md").contains(&format!(": {said},\n")), "{said}");
}

#[test]
fn the_page_has_every_test_point_of_the_description() {
    let listed: Vec<Vec<String>> = list("hardware/generated/test_points.csv")
        .into_iter()
        .map(|row| ["point", "net", "expected"].map(|field| row[field].clone()).to_vec())
        .collect();
    assert_eq!(table("| point | net | expected |"), listed);
}

/// Holds wherever there is a Python; hardware/check.py does the same.
#[test]
fn generated_files_are_fresh() {
    for (name, check) in [("hardware/board.py", "--check"), ("hardware/sixteen.py", "--files")] {
        let script = root().join(name);
        match Command::new("python3").arg("-B").arg(&script).arg(check).output() {
            Ok(done) => assert!(
                done.status.success(),
                "run python3 {name} and look at the difference: {}",
                String::from_utf8_lossy(&done.stderr)
            ),
            Err(e) => eprintln!("skipped: no python3 ({e})"),
        }
    }
}

/// What the netlists take for the paper's sheet is what the forward model gives.
#[test]
fn the_simulated_sheet_is_the_papers() {
    let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap());
    let solver = Solver::new(model).unwrap();
    let pair = |plus: usize| Pair {
        plus,
        minus: (plus + 1) % 16,
    };
    let transfer = |k: usize| solver.electrode_matrix().transfer_ohm(pair(0), pair(k));
    let rows = list("hardware/sheet.csv");
    assert_eq!(rows.len(), 8);
    for row in rows {
        let (sense, ohm): (usize, f64) = (row["pair"].parse().unwrap(), row["ohm"].parse().unwrap());
        let modelled = transfer(sense).abs();
        assert!(
            (ohm / modelled - 1.0).abs() < 1e-3,
            "pair {sense}: {ohm} against {modelled}"
        );
    }
}

/// Voltages of the nodes of a network from their conductances to each other and the currents into them; node 0 is ground.
fn solve(mut g: Vec<Vec<f64>>, mut i: Vec<f64>) -> Vec<f64> {
    let n = i.len();
    g[0] = vec![0.0; n];
    (g[0][0], i[0]) = (1.0, 0.0);
    for k in 0..n {
        let pivot = (k..n).max_by(|a, b| g[*a][k].abs().total_cmp(&g[*b][k].abs())).unwrap();
        g.swap(k, pivot);
        i.swap(k, pivot);
        for row in 0..n {
            if row != k {
                let factor = g[row][k] / g[k][k];
                let (from, current) = (g[k].clone(), i[k]);
                g[row].iter_mut().zip(&from).for_each(|(x, y)| *x -= factor * y);
                i[row] -= factor * current;
            }
        }
    }
    (0..n).map(|k| i[k] / g[k][k]).collect()
}

/// Sense voltage of a ring of sixteen resistors (electrode n to n + 1: `ring[n]`), driven through two switches, V.
fn ring_value(ring: &[f64; 16], switch_ohm: f64, drive: usize, sense: usize) -> f64 {
    // Node 0 is ground, node 1 the source, node 2 + k electrode k.
    let n = 18;
    let mut g = vec![vec![0.0; n]; n];
    let mut join = |a: usize, b: usize, ohm: f64| {
        for (x, y) in [(a, b), (b, a)] {
            g[x][x] += 1.0 / ohm;
            g[x][y] -= 1.0 / ohm;
        }
    };
    for (k, ohm) in ring.iter().enumerate() {
        join(2 + k, 2 + (k + 1) % 16, *ohm);
    }
    join(0, 2 + (drive + 1) % 16, switch_ohm);
    join(1, 2 + drive, switch_ohm);
    // The source as a current through 1 microohm: 2.25 V to a part in a billion.
    join(0, 1, 1e-6);
    let mut i = vec![0.0; n];
    i[1] = 2.25 / 1e-6;
    let u = solve(g, i);
    u[2 + sense] - u[2 + (sense + 1) % 16]
}

/// Converter codes of an amplitude between two electrodes, by the gain of the drawn circuit.
fn codes(volts: f64) -> f64 {
    volts * 12.6 / (3.3 / 4095.0)
}

#[test]
fn the_phantom_gives_what_the_page_says() {
    let rows = table("| ring | own resistance | 70 ohm switches | 100 ohm | 180 ohm |");
    assert_eq!(rows.len(), 3);
    for row in rows {
        let ohm: f64 = row[0].parse().unwrap();
        let ring = [ohm; 16];
        // R beside 15 R.
        assert_eq!(row[1], format!("{:.0}", ohm * 15.0 / 16.0));
        for (cell, switch) in row[2..].iter().zip([70.0, 100.0, 180.0]) {
            let formula = 2.25 * (ohm / 16.0) / (15.0 * ohm / 16.0 + 2.0 * switch);
            let mut count = 0;
            for drive in 0..16 {
                for step in 2..15 {
                    let value = ring_value(&ring, switch, drive, (drive + step) % 16);
                    assert!(
                        (value.abs() / formula - 1.0).abs() < 1e-6,
                        "{ohm} {drive} {step}: {value} {formula}"
                    );
                    count += 1;
                }
            }
            assert_eq!(count, 208);
            let shown = format!("{:.1} mV, {:.0} codes", formula * 1e3, codes(formula));
            assert_eq!(*cell, shown, "ring of {ohm} ohm, switches of {switch} ohm");
        }
    }
    // One resistor 10 % larger: its own pair 10 % more than the others of the same drive, for every drive but those at it.
    let mut ring = [470.0; 16];
    ring[4] = 517.0;
    for drive in (0..16).filter(|d| ![3, 4, 5].contains(d)) {
        let other = (0..16).find(|s| *s != 4 && (s + 16 - drive) % 16 > 1 && (s + 16 - drive) % 16 < 15);
        let ratio = ring_value(&ring, 100.0, drive, 4) / ring_value(&ring, 100.0, drive, other.unwrap());
        assert!((ratio - 1.1).abs() < 1e-6, "drive {drive}: {ratio}");
    }
}
