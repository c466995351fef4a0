//! Files of calibrations: parts put together, refused, and as older programs wrote them.

use super::*;
use ::forward::Pattern;
use inverse::learned::{Press, Setting, learn};

/// What a few presses on a made-up skin taught.
fn taught(test: impl FnOnce(&Taught<'_>)) {
    let pattern = Pattern::adjacent(8).unwrap();
    let presses: Vec<Press> = (0..8)
        .map(|k| {
            let (angle, radius) = (2.4 * k as f64, 40.0 * ((k as f64 + 0.5) / 8.0).sqrt());
            let place_mm = [radius * angle.cos(), radius * angle.sin()];
            let change = |c: usize| {
                let at = [20.0 * (c as f64).cos(), 20.0 * (c as f64).sin()];
                let square = (place_mm[0] - at[0]).powi(2) + (place_mm[1] - at[1]).powi(2);
                (-0.5 * square / 900.0).exp() + 0.01 * ((31 * k + 7 * c) as f64).sin()
            };
            Press {
                place_mm,
                change: (0..pattern.len()).map(change).collect(),
            }
        })
        .collect();
    let setting = Setting {
        measurements: pattern.measurements(),
        electrodes: 8,
        turn: 8,
        extent: None,
    };
    let (learned, found) = learn(&presses, &setting, |_, _| ()).unwrap();
    let forces: Vec<_> = presses.iter().map(|p| (p.place_mm, 1.0, 5.0)).collect();
    let sheet = Sheet::disc(100.0, 8, 6.0, 1.0, 1000.0);
    test(&Taught {
        learned: &learned,
        found: &found,
        model: None,
        gain: Gain::learn(&forces).as_ref(),
        measurements: pattern.measurements(),
        electrodes: 8,
        difference: false,
        of: Of::new(Some(&sheet), pattern.measurements())
            .unwrap()
            .with_board("b", "A7"),
    });
}

fn rubber() -> RubberKeys {
    calibration_file::old_keys(
        "delayed_ratio = 0.3\ntau_s = 5.0\nexponent = 1.0\nunit_rise_mpa = 0.25\nforce_sd_n = 0.1\n",
    )
    .unwrap()
}

#[test]
fn presses_and_rubber_go_into_one_file_in_either_order_and_files_of_older_programs_too() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    taught(|taught| {
        let of = || taught.of.clone();
        assert!(!put_presses(&at("a"), taught).unwrap());
        assert!(put_rubber(&at("a"), rubber(), of()).unwrap());
        assert!(!put_rubber(&at("b"), rubber(), of()).unwrap());
        assert!(!is(&at("b")).unwrap() && is(&at("a")).unwrap());
        assert!(put_presses(&at("b"), taught).unwrap());
        for name in ["a", "b"] {
            let read = read(&at(name)).unwrap();
            assert_eq!(read.rubber, Some(calibration_file::read(&at(name)).unwrap()));
            assert!(read.gain.is_some() && read.measurements == taught.measurements);
            assert!(made_on(&at(name)).unwrap().is_some());
        }
        // The rubber alone, as it was written before.
        let solid = rubber().calibration("t").unwrap();
        write(&at("old"), &calibration_file::text(&solid, None).unwrap()).unwrap();
        assert!(put_presses(&at("old"), taught).unwrap());
        // Presses of older programs are refused.
        let text = std::fs::read_to_string(at("a")).unwrap();
        let keys = toml::to_string(&taught.keys()).unwrap();
        let alone = format!("kind = \"presses\"\nversion = 1\n{keys}");
        let of = |version: &str| text.replace("version = 4", version);
        for old in [of("version = 2"), of("version = 3"), alone] {
            write(&at("older"), &old).unwrap();
            let said = read(&at("older")).err().unwrap().to_string();
            assert!(is(&at("older")).unwrap() && said.contains("calibrate anew"), "{said}");
        }
    });
}

#[test]
fn parts_of_another_sheet_or_board_and_changed_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("c");
    taught(|taught| {
        put_presses(&file, taught).unwrap();
        let other = Of::sheet(&Sheet::paper()).unwrap();
        let said = put_rubber(&file, rubber(), other).unwrap_err().to_string();
        assert!(said.contains("another sheet") && said.contains("--out"), "{said}");
        let board = Of::default().with_board("b", "B8");
        let said = put_rubber(&file, rubber(), board).unwrap_err().to_string();
        assert!(said.contains("another board"), "{said}");
        let text = std::fs::read_to_string(&file).unwrap();
        for (from, to, says) in [
            ("version = 4", "version = 5", "version 5"),
            ("[1, 2, 3, 4]", "[1, 2, 3, 5]", "pattern_sha256"),
            ("1000.0", "1001.0", "sheet_sha256"),
            ("\n[presses]\n", "\n[pressed]\n", "pressed"),
        ] {
            assert!(text.contains(from), "{from}: {}", &text[..1500]);
            let said = parse("c".to_owned(), text.replacen(from, to, 1))
                .err()
                .unwrap()
                .to_string();
            assert!(said.contains(says) && said.contains("skin calibrate"), "{said}");
        }
    });
}
