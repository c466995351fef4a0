//! `skin hello` on the simulated drawn board: a good one passes, every planted fault is named.

use serde_json::Value;
use std::process::{Command, Output};

fn hello(arguments: &[&str]) -> Output {
    let always = ["hello", "--simulate", "--preset", "drawn_board"];
    Command::new(env!("CARGO_BIN_EXE_skin"))
        .args(always)
        .args(arguments)
        .output()
        .unwrap()
}

fn json(arguments: &[&str]) -> (Value, Option<i32>) {
    let all: Vec<&str> = arguments.iter().copied().chain(["--json"]).collect();
    let output = hello(&all);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let value = serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{arguments:?}: {e}: {said}"));
    (value, output.status.code())
}

fn text(arguments: &[&str]) -> String {
    String::from_utf8(hello(arguments).stdout).unwrap()
}

#[test]
fn a_good_board_passes_on_the_sheet_and_on_the_phantom() {
    for arguments in [&[][..], &["--phantom", "470"][..]] {
        let (board, code) = json(arguments);
        assert_eq!(
            (board["self_test"]["failed"].as_array().unwrap().len(), code),
            (0, Some(0)),
            "{board}"
        );
        assert_eq!(board["phantom"]["passed"].as_bool(), arguments.get(1).map(|_| true));
    }
    let said = text(&["--phantom", "470"]);
    assert!(
        said.contains("mean of the values") && said.matches("passed").count() == 2,
        "{said}"
    );
}

/// On the phantom: fault, name of what is found, and words of what is said.
#[test]
fn every_planted_fault_is_found_and_named_on_the_phantom() {
    for (fault, name, words) in [
        ("amplifier_dead@0", "amplifier_dead", "gives no signal"),
        ("amplifier_saturating:0.5@0", "saturation", "the amplifier saturates"),
        (
            "switch_resistance:drive_plus,5,150@0",
            "switch_resistance",
            "electrodes 5 and the next have 350 ohm",
        ),
        (
            "address_swapped:sense_minus,0,2@0",
            "wiring",
            "address lines A0 and A2 of multiplexer sense - are swapped",
        ),
        (
            "wires_swapped:5,6@0",
            "wiring",
            "the wires of electrodes 5 and 6 are swapped",
        ),
    ] {
        let (board, code) = json(&["--phantom", "470", "--fault", fault]);
        let findings = board["phantom"]["findings"].as_array().unwrap();
        assert_eq!(findings.len(), 1, "{fault}: {board}");
        assert_eq!(findings[0]["name"], name, "{fault}");
        let what = findings[0]["what"].as_str().unwrap();
        assert!(what.contains(words), "{fault}: {what}");
        assert_eq!(
            (code, &board["phantom"]["passed"]),
            (Some(1), &Value::Bool(false)),
            "{fault}"
        );
    }
}

/// Without a board the ring is simulated as it was measured.
#[test]
fn a_ring_that_was_measured_is_the_one_that_is_judged() {
    let (board, code) = json(&["--phantom", "470", "--measured", "309.4"]);
    assert_eq!(board["phantom"]["findings"][0]["name"], "other_ring", "{board}");
    assert_eq!(
        (code, &board["phantom"]["ring_measured"]),
        (Some(1), &Value::Bool(true))
    );
    let (board, code) = json(&["--phantom", "470", "--measured", "441"]);
    assert_eq!(
        (code, &board["phantom"]["passed"]),
        (Some(0), &Value::Bool(true)),
        "{board}"
    );
    let said = text(&["--phantom", "470", "--measured", "441"]);
    assert!(
        said.contains("a resistor as measured, ohm") && said.contains("456 to 484"),
        "{said}"
    );
}

/// On a sheet, a board with sixteen channels: each is held against the amplifier behind the multiplexers.
#[test]
fn a_channels_amplifier_is_tried_on_a_sheet_too() {
    let tried = |arguments: &[&str]| {
        let always = ["hello", "--simulate", "--preset", "drawn_sixteen", "--json"];
        let mut command = Command::new(env!("CARGO_BIN_EXE_skin"));
        let output = command.args(always).args(arguments).output().unwrap();
        let board: Value = serde_json::from_slice(&output.stdout).unwrap();
        (board["channels"].clone(), output.status.code())
    };
    assert_eq!(tried(&[]), (serde_json::json!([]), Some(0)));
    for (fault, name) in [
        ("channel_dead:6@0", "channel_dead"),
        ("channel_saturating:6,1.2@0", "channel"),
    ] {
        let (found, code) = tried(&["--fault", fault]);
        assert_eq!(found.as_array().unwrap().len(), 1, "{fault}: {found}");
        assert_eq!((&found[0]["name"], code), (&Value::from(name), Some(1)), "{found}");
        let what = found[0]["what"].as_str().unwrap();
        assert!(what.contains("channel 7"), "{fault}: {what}");
    }
}

/// What the self-test itself names, on a sheet.
#[test]
fn faults_of_the_circuit_are_named_on_a_sheet() {
    for (fault, check) in [
        ("amplifier_dead@0", "amplifier"),
        ("amplifier_saturating:1@0", "linearity"),
        ("electrode_open:4@0", "electrodes"),
        ("source_lost@0", "source"),
    ] {
        let (board, code) = json(&["--fault", fault]);
        assert_eq!(
            board["self_test"]["failed"],
            serde_json::json!([check]),
            "{fault}: {board}"
        );
        assert_eq!(code, Some(1), "{fault}");
    }
    for (fault, words) in [
        ("reference_lost:drive@0", "V_R is lost"),
        ("reference_lost:converter@0", "1.65 V is lost"),
    ] {
        let said = text(&["--fault", fault]);
        assert!(said.contains(words), "{fault}: {said}");
        let (board, code) = json(&["--phantom", "470", "--fault", fault]);
        assert!(board["lost_reference"].as_str().unwrap().contains(words), "{board}");
        assert_eq!(
            (code, &board["phantom"]["passed"]),
            (Some(1), &Value::Bool(false)),
            "{fault}"
        );
    }
    let (good, _) = json(&[]);
    assert!(good["lost_reference"].is_null(), "{good}");
}

#[test]
fn what_makes_no_sense_is_refused() {
    for (arguments, words) in [
        (&["--phantom=-5"][..], "a resistance in ohm above 0"),
        (&["--fault", "electrode_open:17@0"][..], "there is no electrode 17"),
        (&["--phantom", "470", "--no-test"][..], "cannot be used with"),
        (&["--measured", "441"][..], "--phantom"),
    ] {
        let output = hello(arguments);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(
            !output.status.success() && said.contains(words),
            "{arguments:?}: {said}"
        );
    }
}
