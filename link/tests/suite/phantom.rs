//! The production test on the simulated board with a ring of resistors: good boards pass, planted faults are named.

use hil_sim::{Electronics, FixedSheet, Pace, SimBoard, SimConfig, SimPort};
use link::phantom::{Finding, Known, Multiplexer, Ring, Verdict, Wiring, judge, read};
use link::{Link, LinkError, greet};
use nalgebra::{DMatrix, DVector};

/// A ring that nobody has measured.
const SAID: Known = Known {
    said_ohm: 470.0,
    between_ohm: None,
};

fn tested(electronics: Electronics, sheet: FixedSheet, faults: &[&str]) -> Result<Verdict, LinkError> {
    tested_as(SAID, electronics, sheet, faults)
}

fn tested_as(known: Known, electronics: Electronics, sheet: FixedSheet, faults: &[&str]) -> Result<Verdict, LinkError> {
    let config = SimConfig {
        electronics,
        faults: faults.iter().map(|f| f.parse().unwrap()).collect(),
        ..SimConfig::default()
    };
    let port = SimPort::new(SimBoard::new(config, sheet).unwrap(), Pace::Unpaced).unwrap();
    let link = Link::open(Box::new(port))?;
    let hello = greet(&link)?;
    let readings = read(&link, &hello)?;
    Ok(judge(&hello, known, 1.0, &readings))
}

fn drawn(faults: &[&str]) -> Verdict {
    tested(Electronics::drawn_board(), FixedSheet::ring(16, 470.0), faults).unwrap()
}

/// The ring's formulas against the network solved node by node.
#[test]
fn the_ring_is_what_the_network_gives() {
    let ring = Ring {
        electrodes: 16,
        ohm: 470.0,
        switch_ohm: 100.0,
        source_v: 2.25,
    };
    for wiring in [
        Wiring::Right,
        Wiring::Electrodes(2, 9),
        Wiring::Address(Multiplexer::DrivePlus, 0, 2),
    ] {
        for (drive, sense) in [([0, 1], [3, 2]), ([4, 3], [9, 12]), ([1, 2], [1, 2])] {
            let to = |m: usize, plus: bool| match wiring {
                Wiring::Electrodes(a, b) if m == a || m == b => a + b - m,
                Wiring::Address(..) if plus => [0, 4, 2, 6, 1, 5, 3, 7][m % 8] + m / 8 * 8,
                _ => m,
            };
            let sense_at = |m| {
                if matches!(wiring, Wiring::Electrodes(..)) {
                    to(m, false)
                } else {
                    m
                }
            };
            let (plus, minus) = (to(drive[0], true), to(drive[1], false));
            // Ohm's law at every node; node 16 is the source's positive end, its negative one is ground.
            let mut g = DMatrix::zeros(17, 17);
            let mut join = |a: usize, b: Option<usize>, ohm: f64| {
                g[(a, a)] += 1.0 / ohm;
                if let Some(b) = b {
                    g[(b, b)] += 1.0 / ohm;
                    g[(a, b)] -= 1.0 / ohm;
                    g[(b, a)] -= 1.0 / ohm;
                }
            };
            (0..16).for_each(|n| join(n, Some((n + 1) % 16), 470.0));
            join(16, Some(plus), 100.0);
            join(minus, None, 100.0);
            let unit = g
                .lu()
                .solve(&DVector::from_fn(17, |k, _| f64::from(u8::from(k == 16))))
                .unwrap();
            let v = |n: usize| unit[n] / unit[16] * 2.25;
            let expected = v(sense_at(sense[0])) - v(sense_at(sense[1]));
            let seen = ring.voltage_v(wiring, drive, sense);
            assert!(
                (seen - expected).abs() < 1e-9,
                "{wiring:?} {drive:?} {sense:?}: {seen} {expected}"
            );
        }
    }
}

#[test]
fn a_good_board_passes_with_the_figures_of_theory() {
    let verdict = drawn(&[]);
    assert_eq!(verdict.findings, [], "{verdict:?}");
    // 2.25 V (R/16) / (15 R/16 + 2 R_on), at 12.6 and 3.3 V for 4095 codes.
    let theory = 2.25 * 470.0 / 16.0 / (15.0 * 470.0 / 16.0 + 200.0) * 12.6 / 3.3 * 4095.0;
    assert!((verdict.mean_codes / theory - 1.0).abs() < 1e-3, "{verdict:?}");
    assert!((verdict.expected_codes / theory - 1.0).abs() < 3e-3, "{verdict:?}");
    assert!((verdict.switch_ohm - 100.0).abs() < 1.0, "{verdict:?}");
    assert!(
        (verdict.gain_ratio - 1.0).abs() < 2e-3 && verdict.spread < 2e-3,
        "{verdict:?}"
    );
    // 0.4 codes and the rounding over the root of eight; 64 values know it to 9 %, four of them.
    let sigma = ((0.4f64.powi(2) + 1.0 / 12.0) / 8.0).sqrt();
    assert!((verdict.sigma / sigma - 1.0).abs() < 0.36, "{verdict:?}");
    assert!(verdict.phase_deg < 0.2 && verdict.offset_codes < 1.0, "{verdict:?}");
    // A board of sixteen channels is as good.
    let other = tested(Electronics::default(), FixedSheet::ring(16, 470.0), &[]).unwrap();
    assert_eq!(other.findings, [], "{other:?}");
}

fn sixteen(faults: &[&str]) -> Verdict {
    tested(Electronics::drawn_sixteen(), FixedSheet::ring(16, 470.0), faults).unwrap()
}

#[test]
fn on_a_board_with_sixteen_channels_every_channels_fault_is_named() {
    let good = sixteen(&[]);
    assert_eq!(good.findings, [], "{good:?}");
    assert!((good.switch_ohm - 100.0).abs() < 1.5, "{good:?}");
    for channel in [0, 6, 15] {
        let verdict = sixteen(&[&format!("channel_dead:{channel}@0")]);
        assert_eq!(verdict.findings, [Finding::ChannelDead { channel }], "{verdict:?}");
        let verdict = sixteen(&[&format!("channel_saturating:{channel},1.2@0")]);
        assert!(
            matches!(verdict.findings[..], [Finding::Channel { channel: found, worst, .. }] if found == channel && worst > 0.025),
            "{verdict:?}"
        );
    }
    // One gain resistor of 5 % too much.
    let mut gain_error = vec![0.0; 16];
    gain_error[3] = -0.05;
    let electronics = Electronics {
        gain_error,
        ..Electronics::drawn_sixteen()
    };
    let verdict = tested(electronics, FixedSheet::ring(16, 470.0), &[]).unwrap();
    assert!(
        matches!(verdict.findings[..], [Finding::Channel { channel: 3, ratio, worst }]
            if (ratio - 0.95).abs() < 2e-3 && worst < 5e-3),
        "{verdict:?}"
    );
}

#[test]
fn on_a_board_with_sixteen_channels_what_it_shares_with_the_other_is_named_alike() {
    assert_eq!(sixteen(&["amplifier_dead@0"]).findings, [Finding::AmplifierDead]);
    for (fault, expected) in [
        ("wires_swapped:5,6@0", Wiring::Electrodes(4, 5)),
        (
            "address_swapped:sense_minus,0,2@0",
            Wiring::Address(Multiplexer::SenseMinus, 0, 2),
        ),
        (
            "address_swapped:drive_plus,0,1@0",
            Wiring::Address(Multiplexer::DrivePlus, 0, 1),
        ),
    ] {
        let verdict = sixteen(&[fault]);
        assert_eq!(verdict.findings, [Finding::Wiring(expected)], "{fault}: {verdict:?}");
    }
    let verdict = sixteen(&["switch_resistance:drive_plus,5,150@0"]);
    assert!(
        matches!(verdict.findings[..], [Finding::Switches { drive: 4, .. }]),
        "{verdict:?}"
    );
    let verdict = sixteen(&["amplifier_saturating:0.5@0"]);
    assert!(
        matches!(verdict.findings[..], [Finding::Saturation { of: 208, .. }]),
        "{verdict:?}"
    );
    let refused = tested(
        Electronics::drawn_sixteen(),
        FixedSheet::ring(16, 470.0),
        &["reference_lost:drive@0"],
    );
    assert!(matches!(refused, Err(LinkError::Refused(_))), "{refused:?}");
}

#[test]
fn wrong_wires_are_named() {
    for (fault, wiring) in [
        ("wires_swapped:5,6@0", Wiring::Electrodes(4, 5)),
        ("wires_swapped:2,11@0", Wiring::Electrodes(1, 10)),
        (
            "address_swapped:sense_plus,0,1@0",
            Wiring::Address(Multiplexer::SensePlus, 0, 1),
        ),
        (
            "address_swapped:sense_minus,1,2@0",
            Wiring::Address(Multiplexer::SenseMinus, 1, 2),
        ),
        (
            "address_swapped:drive_plus,0,2@0",
            Wiring::Address(Multiplexer::DrivePlus, 0, 2),
        ),
        (
            "address_swapped:drive_minus,0,1@0",
            Wiring::Address(Multiplexer::DriveMinus, 0, 1),
        ),
        (
            "multiplexer_stuck:drive_plus,3@0",
            Wiring::Stuck(Multiplexer::DrivePlus, 2),
        ),
    ] {
        let verdict = drawn(&[fault]);
        assert_eq!(verdict.findings, [Finding::Wiring(wiring)], "{fault}: {verdict:?}");
    }
}

#[test]
fn the_amplifiers_faults_are_named() {
    assert_eq!(drawn(&["amplifier_dead@0"]).findings, [Finding::AmplifierDead]);
    let verdict = drawn(&["amplifier_saturating:0.5@0"]);
    assert!(
        matches!(verdict.findings[..], [Finding::Saturation { count, of: 208 }] if count > 16),
        "{verdict:?}"
    );
    let offset = Electronics {
        offset_v: vec![0.1],
        ..Electronics::drawn_board()
    };
    let verdict = tested(offset, FixedSheet::ring(16, 470.0), &[]).unwrap();
    assert_eq!(verdict.findings, [Finding::Offset], "{verdict:?}");
    let noisy = Electronics {
        noise_codes: 1.2,
        ..Electronics::drawn_board()
    };
    assert_eq!(
        tested(noisy, FixedSheet::ring(16, 470.0), &[]).unwrap().findings,
        [Finding::Noise]
    );
    // Switches of another make.
    let switches = Electronics {
        switch_ohm: 250.0,
        ..Electronics::drawn_board()
    };
    let verdict = tested(switches, FixedSheet::ring(16, 470.0), &[]).unwrap();
    assert!(
        matches!(verdict.findings[..], [Finding::AllSwitches { ohm }] if (ohm - 250.0).abs() < 3.0),
        "{verdict:?}"
    );
}

#[test]
fn a_switch_and_a_resistor_are_named_with_their_ohms() {
    let verdict = drawn(&["switch_resistance:drive_plus,5,150@0"]);
    assert!(
        matches!(verdict.findings[..], [Finding::Switches { drive: 4, ohm, median_ohm }]
            if (ohm - 350.0).abs() < 3.0 && (median_ohm - 200.0).abs() < 2.0),
        "{verdict:?}"
    );
    // One of the resistors has 517 ohm: its own pair reads 10 % more in every drive.
    let mut g = DMatrix::<f64>::zeros(16, 16);
    for n in 0..16 {
        let next = (n + 1) % 16;
        let s = 1.0 / if n == 4 { 517.0 } else { 470.0 };
        g[(n, n)] += s;
        g[(next, next)] += s;
        g[(n, next)] -= s;
        g[(next, n)] -= s;
    }
    // Any node may be the ground: a large resistor from each to it.
    let potentials = (g + DMatrix::identity(16, 16) * 1e-9).try_inverse().unwrap();
    let sheet = FixedSheet(forward::ElectrodeMatrix::from_potentials(potentials));
    let verdict = tested(Electronics::drawn_board(), sheet, &[]).unwrap();
    assert!(
        matches!(verdict.findings[..], [Finding::Resistor { electrode: 4, ohm }] if (ohm - 517.0).abs() < 5.0),
        "{verdict:?}"
    );
}

#[test]
fn another_ring_than_said_is_no_good_board() {
    // What is seen is a switch's part of a resistor: 220 ohm said to be 470 make 100 ohm of a switch 214.
    let verdict = tested(Electronics::drawn_board(), FixedSheet::ring(16, 220.0), &[]).unwrap();
    assert!(
        verdict
            .findings
            .iter()
            .any(|f| matches!(f, Finding::AllSwitches { .. })),
        "{verdict:?}"
    );
    let verdict = tested(Electronics::drawn_board(), FixedSheet::ring(16, 2000.0), &[]).unwrap();
    assert!(!verdict.findings.is_empty(), "{verdict:?}");
}

/// 330 ohm with switches of 100 give the very values of 470 with switches of 142.
#[test]
fn a_ring_of_330_ohm_does_not_pass_as_one_of_470_and_switches_of_142_do_where_the_ring_was_measured() {
    let typical = Electronics::drawn_board;
    let poor = || Electronics {
        switch_ohm: 47000.0 / 330.0,
        ..typical()
    };
    let measured = |ohm: f64| Known {
        // One beside fifteen.
        between_ohm: Some(ohm * 15.0 / 16.0),
        ..SAID
    };
    for (electronics, ring) in [(typical(), 330.0), (poor(), 470.0)] {
        let verdict = tested(electronics, FixedSheet::ring(16, ring), &[]).unwrap();
        assert!(
            matches!(verdict.findings[..], [Finding::RingOrSwitches { switch_ohm, ring_ohm, between_ohm }]
                if (switch_ohm / 142.4 - 1.0).abs() < 0.01 && (ring_ohm / 330.0 - 1.0).abs() < 0.01
                    && (between_ohm - 440.6).abs() < 0.1),
            "{verdict:?}"
        );
    }
    let verdict = tested_as(measured(330.0), typical(), FixedSheet::ring(16, 330.0), &[]).unwrap();
    let other = Finding::OtherRing {
        ohm: 330.0,
        said_ohm: 470.0,
    };
    assert_eq!(verdict.findings, [other], "{verdict:?}");
    assert!((verdict.switch_ohm - 100.0).abs() < 1.0, "{verdict:?}");
    let verdict = tested_as(measured(470.0), poor(), FixedSheet::ring(16, 470.0), &[]).unwrap();
    assert_eq!(verdict.findings, [], "{verdict:?}");
    assert!((verdict.switch_ohm / 142.4 - 1.0).abs() < 0.01, "{verdict:?}");
}

#[test]
fn a_board_without_its_reference_does_not_start() {
    let refused = tested(
        Electronics::drawn_board(),
        FixedSheet::ring(16, 470.0),
        &["reference_lost:drive@0"],
    );
    assert!(matches!(refused, Err(LinkError::Refused(_))), "{refused:?}");
}
