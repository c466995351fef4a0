//! Faults of the board and of values, through the whole chain in simulated time: named within a second, and no wrong touch without
//! a doubt.

use studies::faults::{Bench, Outcome, When, cases};

/// Frames that may be wrong and silent until a fault is known: a tenth of a second.
const UNKNOWN: usize = 12;

fn run(name: &str, when: When) -> Outcome {
    let case = cases().into_iter().find(|c| c.name == name).unwrap();
    let outcome = Bench::new().unwrap().run(&case, when).unwrap();
    let named = outcome.naming(&case);
    assert!(
        named.is_some_and(|(after_s, _)| after_s < 1.0),
        "{name}, {when:?}: {:?}",
        outcome.said
    );
    let silent = outcome.touched.silent + outcome.rest.silent;
    assert!(silent <= UNKNOWN, "{name}, {when:?}: {outcome:?}");
    outcome
}

/// Frames of a source of which a half is left are divided by less, and are as noisy as twice the voltage of their noise.
#[test]
fn a_source_of_which_a_half_is_left_shows_no_phantoms() {
    let name = "`source_sags:0.5`";
    for when in [When::UnderTouch, When::AtRest] {
        let outcome = run(name, when);
        let [touched, rest] = [outcome.touched, outcome.rest];
        assert_eq!((touched.silent, rest.silent), (0, 0), "{name}, {when:?}: {outcome:?}");
        assert!(
            touched.right_part() > 0.98 && rest.right_part() > 0.98,
            "{name}: {outcome:?}"
        );
        assert!(touched.doubted + rest.doubted <= 5, "{name}: {outcome:?}");
    }
}

/// What a fault leaves is as good as if the values were missing from the start.
#[test]
fn touches_beside_what_is_left_out_are_right() {
    let left = [
        ("`electrode_open:3`, `electrode_open:9`", When::UnderTouch),
        (
            "`electrode_open:3`, `electrode_open:8`, `electrode_open:13`",
            When::AtRest,
        ),
        ("`saturation:5`", When::UnderTouch),
        ("`electrode_open:3`, `source_sags:0.8`", When::UnderTouch),
        ("`electrode_open:3`, `source_sags:0.8`", When::AtRest),
        ("one value x10", When::AtRest),
        ("one channel's gain +5 %", When::AtRest),
        ("one channel's offset 10 mV", When::UnderTouch),
        ("`switch_resistance:drive_plus,3,300`", When::AtRest),
        ("`channel_saturating:6,1.5`, board drawn_sixteen", When::UnderTouch),
        ("`contact_raised:3,100`, `contact_raised:9,100`", When::AtRest),
    ];
    for (name, when) in left {
        let outcome = run(name, when);
        assert!(outcome.touched.right_part() > 0.95, "{name}: {outcome:?}");
        assert!(outcome.rest.right_part() > 0.95, "{name}: {outcome:?}");
    }
}

/// What a weak leak does is known; the values of its electrodes are left out.
#[test]
fn touches_beside_a_weak_leak_are_right() {
    for (name, when) in [
        ("`electrodes_short:3,4,10000`", When::AtRest),
        ("`electrodes_short:3,4,100000`", When::UnderTouch),
        ("`electrodes_short:3,10,300000`", When::AtRest),
    ] {
        let outcome = run(name, when);
        assert!(outcome.touched.right_part() > 0.93, "{name}: {outcome:?}");
        assert!(
            outcome.rest.right_part() > 0.95 && outcome.rest.doubted == 0,
            "{name}: {outcome:?}"
        );
    }
}

/// What changes all values of a baseline by a law is named, and touches are right beside it.
#[test]
fn what_distorts_a_baseline_is_named() {
    for name in [
        "`electrodes_short:3,4,10000`",
        "`electrodes_short:3,4,100000`",
        "`electrodes_short:3,10,300000`",
        "`contact_raised:3,500`, `electrodes_short:9,10,10000`",
        "`amplifier_saturating:1`, board drawn_board",
        "`amplifier_saturating:1.5`, board drawn_board",
    ] {
        let outcome = run(name, When::Baseline);
        let [touched, rest] = [outcome.touched, outcome.rest];
        assert!(
            touched.right_part() > 0.95 && rest.right_part() > 0.95,
            "{name}: {outcome:?}"
        );
    }
}

/// Two of different kinds at once are named both, whatever each would look like by itself, and leave what the worse of them leaves.
#[test]
fn two_faults_at_once_are_both_named() {
    let two = [
        ("`electrode_open:3`, `electrodes_short:9,10,10000`", When::AtRest, true),
        ("`electrode_open:3`, `contact_raised:9,200`", When::UnderTouch, true),
        (
            "`electrode_open:3`, `switch_resistance:drive_plus,9,300`",
            When::AtRest,
            true,
        ),
        (
            "`channel_dead:6`, `electrode_open:12`, board drawn_sixteen",
            When::UnderTouch,
            true,
        ),
        (
            "`electrode_open:3`, `electrodes_short:9,10,30`",
            When::UnderTouch,
            false,
        ),
        ("`electrode_open:3`, `wires_swapped:8,9`", When::AtRest, false),
        (
            "`electrode_open:3`, `multiplexer_stuck:drive_plus,9`",
            When::AtRest,
            false,
        ),
    ];
    for (name, when, leaves_touches) in two {
        let outcome = run(name, when);
        let [touched, rest] = [outcome.touched, outcome.rest];
        let known = if leaves_touches { touched.right } else { touched.doubted };
        let case = cases().into_iter().find(|c| c.name == name).unwrap();
        let last = outcome.last.join(" & ");
        let both = case
            .named
            .iter()
            .any(|words| words.iter().all(|word| last.contains(word)));
        assert!(both && outcome.last.len() == 2, "{name}: {last}");
        // The second is looked for once the first is known.
        assert!(touched.frames <= known + 2 * UNKNOWN, "{name}: {outcome:?}");
        assert!(rest.right_part() > 0.95, "{name}: {outcome:?}");
    }
}

/// What drifts slowly does not take the place of a fault that comes from one frame to the next.
#[test]
fn a_sudden_fault_is_taken_for_no_drift() {
    let sudden = [
        ("one channel's gain +1 %", When::AtRest),
        ("one channel's gain +5 %", When::AtRest),
        ("`contact_raised:3,50`", When::UnderTouch),
    ];
    for (name, when) in sudden {
        let case = cases().into_iter().find(|c| c.name == name).unwrap();
        let named = run(name, when).naming(&case).map(|(after_s, _)| after_s);
        assert!(named.is_some_and(|after_s| after_s < 0.3), "{name}: {named:?}");
    }
}

/// A contact that changes while nothing touches may look like touches that fall until it is named. The finger that comes later rises all
/// the same.
#[test]
fn a_fault_at_rest_teaches_no_sign() {
    let cases = cases();
    let case = cases.iter().find(|c| c.name == "`contact_raised:3,500`").unwrap();
    let mut bench = Bench::new().unwrap();
    for case in [&cases[0], case, case, case] {
        let outcome = bench.run(case, When::AtRest).unwrap();
        assert!(outcome.touched.right_part() > 0.95, "{}: {outcome:?}", case.name);
    }
}

/// Where nothing is left that tells touches, none are shown.
#[test]
fn what_leaves_no_touches_is_doubted_and_shows_none() {
    let none = [
        ("`electrodes_short:3,4`", When::AtRest),
        ("`electrodes_short:3,4,100`", When::UnderTouch),
        ("`source_lost`", When::AtRest),
        ("`adc_stuck:2048`", When::UnderTouch),
        ("`saturation`", When::AtRest),
        ("`multiplexer_stuck:drive_plus,3`", When::AtRest),
        ("`wires_swapped:3,4`", When::AtRest),
        ("`address_swapped:drive_plus,0,1`", When::UnderTouch),
        ("`address_swapped:sense_minus,1,2`, board drawn_board", When::Baseline),
        ("`amplifier_saturating:1`, board drawn_board", When::AtRest),
        ("`amplifier_saturating:1.5`, board drawn_board", When::UnderTouch),
        ("`amplifier_dead`, board drawn_board", When::Baseline),
        ("`electrodes_short:3,10`", When::Baseline),
    ];
    for (name, when) in none {
        let outcome = run(name, when);
        let doubted = outcome.touched.doubted + outcome.rest.doubted;
        let frames = outcome.touched.frames + outcome.rest.frames;
        assert!(doubted + UNKNOWN >= frames, "{name}: {outcome:?}");
        assert!(outcome.rest.right_part() > 0.95, "{name}: {outcome:?}");
    }
}

#[test]
fn frames_lost_on_the_line_are_said() {
    for name in ["`bytes_lost:0.01`", "`converter_overrun:0.02`"] {
        run(name, When::AtRest);
    }
}

#[test]
fn a_sound_board_has_no_fault() {
    let none = cases().into_iter().find(|c| c.name == "none").unwrap();
    for when in When::ALL {
        let outcome = Bench::new().unwrap().run(&none, when).unwrap();
        assert!(outcome.said.is_empty(), "{when:?}: {:?}", outcome.said);
        assert_eq!((outcome.touched.silent, outcome.rest.silent), (0, 0), "{when:?}");
    }
}
