//! The board's self-test on sheets of many resistances, and with faults of the drawn board's circuit.

use crate::common::{Bench, disc};
use forward::ElectrodeMatrix;
use hil_sim::{Electronics, FixedSheet, SimConfig, TICKS_PER_SAMPLE, TIMER_HZ};
use protocol::{Check, FromBoard, SelfTest, ToBoard};

fn tested(electronics: Electronics, faults: &[&str], sheet: ElectrodeMatrix) -> SelfTest {
    let config = SimConfig {
        electronics,
        faults: faults.iter().map(|f| f.parse().unwrap()).collect(),
        ..SimConfig::default()
    };
    let mut bench = Bench::new(config, FixedSheet(sheet));
    bench.run(0.02);
    bench.send(&ToBoard::SelfTest);
    let said = bench.run(0.2);
    let [FromBoard::SelfTest(report)] = &said[..] else {
        panic!("{said:?}")
    };
    report.clone()
}

fn drawn(faults: &[&str]) -> SelfTest {
    tested(Electronics::drawn_board(), faults, disc(16))
}

/// The checks that failed.
fn failed(report: &SelfTest) -> Vec<Check> {
    Check::ALL.into_iter().filter(|check| !report.passed(*check)).collect()
}

/// The disc with this resistivity over 1 kilohm per square; contacts with it.
fn of_resistivity(factor: f64) -> ElectrodeMatrix {
    ElectrodeMatrix::from_potentials(disc(16).potentials_ohm() * factor)
}

#[test]
fn the_drawn_board_passes_on_sheets_from_100_ohm_to_100_kilohm_a_square() {
    for factor in [0.1, 0.3, 1.0, 10.0, 100.0] {
        let report = tested(Electronics::drawn_board(), &[], of_resistivity(factor));
        assert_eq!(failed(&report), [], "{factor}: {report:?}");
        assert_eq!((report.drive_pairs.len(), report.sense_pairs.len()), (16, 16));
    }
}

/// 490 periods of 16 samples, as docs/firmware.md says. A heartbeat may come before it, and the report takes a millisecond of the line.
#[test]
fn it_takes_490_periods() {
    let config = SimConfig {
        electronics: Electronics::drawn_board(),
        ..SimConfig::default()
    };
    let mut bench = Bench::new(config, FixedSheet(disc(16)));
    bench.run(0.02);
    bench.send(&ToBoard::SelfTest);
    let period_s = 16.0 * f64::from(TICKS_PER_SAMPLE) / f64::from(TIMER_HZ);
    let is_report = |m: &FromBoard| matches!(m, FromBoard::SelfTest(_));
    let periods = (1..1000).find(|_| bench.run(period_s).iter().any(is_report)).unwrap();
    assert!((490..=500).contains(&periods), "{periods}");
}

#[test]
fn an_open_electrode_is_named_on_a_sheet_of_any_resistivity() {
    for factor in [0.1, 1.0, 100.0] {
        let report = tested(
            Electronics::drawn_board(),
            &["electrode_open:6@0"],
            of_resistivity(factor),
        );
        assert_eq!(report.suspect, 0b11_0000, "{factor}: {report:?}");
        assert!(
            !report.passed(Check::Electrodes) && report.passed(Check::Amplifier),
            "{report:?}"
        );
    }
    let short = drawn(&["electrodes_short:6,7@0"]);
    assert_eq!((short.suspect, failed(&short)), (1 << 5, vec![Check::Electrodes]));
}

#[test]
fn a_board_without_a_sheet_has_open_electrodes_and_no_dead_amplifier() {
    let open: Vec<String> = (1..=16).map(|n| format!("electrode_open:{n}@0")).collect();
    let open: Vec<&str> = open.iter().map(String::as_str).collect();
    let report = drawn(&open);
    assert_eq!(report.suspect, 0xFFFF, "{report:?}");
    assert!(report.passed(Check::Amplifier), "{report:?}");
}

#[test]
fn the_amplifier_that_carries_the_values_is_tested() {
    let dead = drawn(&["amplifier_dead@0"]);
    assert_eq!((failed(&dead), dead.suspect), (vec![Check::Amplifier], 0), "{dead:?}");
    // 1 V less: 0.24 V too little at 4.97 V on this sheet.
    let saturating = drawn(&["amplifier_saturating:1@0"]);
    assert_eq!(failed(&saturating), [Check::Linearity], "{saturating:?}");
    assert_eq!(saturating.bent, 0xFFFF);
    // The circuit before, at 5 V: its drive was single-ended.
    let before = Electronics {
        supply_v: Some(5.0),
        push_pull: false,
        ..Electronics::drawn_board()
    };
    assert_eq!(failed(&tested(before, &[], disc(16))), [Check::Linearity]);
}

#[test]
fn a_lost_reference_shows_in_source_and_offset() {
    let drive = drawn(&["reference_lost:drive@0"]);
    assert!(!drive.passed(Check::Source), "{drive:?}");
    // Each end of the drive gives every other half wave: half of the amplitude, its mean far below the middle.
    assert!(drive.source_permille.abs_diff(500) < 15, "{drive:?}");
    assert!(drive.source_offset.codes() < -200.0, "{drive:?}");
    let converter = drawn(&["reference_lost:converter@0"]);
    assert!(!converter.passed(Check::Offset), "{converter:?}");
    let healthy = drawn(&[]);
    assert!(healthy.source_offset.codes().abs() < 1.0, "{healthy:?}");
}
