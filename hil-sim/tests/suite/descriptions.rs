//! Electronics and faults as files and command lines describe them.

use hil_sim::{Electronics, Fault, FaultKind, Line, Multiplexer, Reference, SimBoard, SimConfig};

#[derive(Debug, serde::Deserialize)]
struct File {
    electronics: Electronics,
    fault: Vec<Fault>,
}

const FILE: &str = r#"
    [electronics]
    noise_codes = 0.5
    gain_error = [0.01, -0.02]
    swing_v = 1.2

    [[electronics.interference]]
    frequency_hz = 50.0
    amplitude_v = 0.01
    harmonics = [0.0, 0.3]

    [[fault]]
    at_s = 3.0
    for_s = 2.0
    kind = { electrode_open = { electrode = 6 } }

    [[fault]]
    at_s = 4.0
    kind = "cable_pulled"
"#;

#[test]
fn a_file_says_what_differs_and_comes_back_the_same() {
    let file: File = toml::from_str(FILE).unwrap();
    let expected = Electronics {
        noise_codes: 0.5,
        gain_error: vec![0.01, -0.02],
        swing_v: Some(1.2),
        interference: vec![Line {
            harmonics: vec![0.0, 0.3],
            ..Line::new(50.0, 0.01)
        }],
        ..Electronics::default()
    };
    assert_eq!(file.electronics, expected);
    assert_eq!(
        file.fault,
        [
            Fault::lasting(3.0, 2.0, FaultKind::ElectrodeOpen { electrode: 5 }),
            Fault::new(4.0, FaultKind::CablePulled),
        ]
    );
    for fault in &file.fault {
        let text = toml::to_string(fault).unwrap();
        assert_eq!(&toml::from_str::<Fault>(&text).unwrap(), fault, "{text}");
    }
    // Electrodes count from 1.
    let zero = toml::from_str::<File>(&FILE.replace("electrode = 6", "electrode = 0")).unwrap_err();
    assert!(zero.to_string().contains("count from 1"), "{zero}");
    for electronics in [expected, Electronics::default(), Electronics::ideal()] {
        let text = toml::to_string(&electronics).unwrap();
        assert_eq!(toml::from_str::<Electronics>(&text).unwrap(), electronics, "{text}");
    }
}

#[test]
fn what_is_not_known_is_named_with_its_line() {
    for (wrong, line, name) in [
        ("noise_codes = 0.5", "line 3", "noise_code"),
        ("harmonics = [0.0, 0.3]", "line 10", "harmonic"),
        (
            "kind = { electrode_open = { electrode = 6 } }",
            "line 15",
            "kind = \"electrode_opened\"",
        ),
    ] {
        let broken = match name {
            "noise_code" => FILE.replace("noise_codes", "noise_code"),
            "harmonic" => FILE.replace("harmonics", "harmonic"),
            _ => FILE.replace(wrong, name),
        };
        let error = toml::from_str::<File>(&broken).unwrap_err().to_string();
        assert!(error.contains(line) && error.contains("unknown"), "{error}");
    }
}

#[test]
fn values_that_cannot_be_are_refused_in_words() {
    let mut wrong = Electronics {
        crosstalk: 0.7,
        ..Electronics::default()
    };
    let said = "electronics: crosstalk is 0.7; it must be between -0.5 and 0.5";
    assert_eq!(wrong.validate().unwrap_err().to_string(), said);
    wrong = Electronics {
        offset_v: vec![0.0; 17],
        ..Electronics::default()
    };
    assert!(
        wrong
            .validate()
            .unwrap_err()
            .to_string()
            .contains("offset_v has 17 entries")
    );
    wrong = Electronics {
        interference: vec![Line::new(f64::NAN, 1.0)],
        ..Electronics::default()
    };
    assert!(
        wrong
            .validate()
            .unwrap_err()
            .to_string()
            .contains("interference.frequency_hz")
    );
    let config = SimConfig {
        electronics: wrong,
        ..SimConfig::default()
    };
    let sheet = hil_sim::FixedSheet(forward::ElectrodeMatrix::from_potentials(nalgebra::DMatrix::identity(
        16, 16,
    )));
    let error = SimBoard::new(config, sheet).err().unwrap();
    assert!(
        error.to_string().contains("interference.frequency_hz is NaN"),
        "{error}"
    );
}

#[test]
fn faults_are_written_as_words() {
    for (text, fault) in [
        ("cable_pulled@5+2", Fault::lasting(5.0, 2.0, FaultKind::CablePulled)),
        ("board_reset@0.5", Fault::new(0.5, FaultKind::BoardReset)),
        ("board_hangs@0.5", Fault::new(0.5, FaultKind::BoardHangs)),
        (
            "source_sags:0.7@1",
            Fault::new(1.0, FaultKind::SourceSags { part: 0.7 }),
        ),
        (
            "bytes_flipped:1e-3@0",
            Fault::new(0.0, FaultKind::BytesFlipped { rate: 1e-3 }),
        ),
        (
            "electrodes_short:4,5@1+2",
            Fault::lasting(
                1.0,
                2.0,
                FaultKind::ElectrodesShort {
                    electrodes: [3, 4],
                    ohm: 0.0,
                },
            ),
        ),
        (
            "multiplexer_stuck:sense_minus,8@1",
            Fault::new(
                1.0,
                FaultKind::MultiplexerStuck {
                    multiplexer: Multiplexer::SenseMinus,
                    electrode: 7,
                },
            ),
        ),
        ("amplifier_dead@1", Fault::new(1.0, FaultKind::AmplifierDead)),
        (
            "amplifier_saturating:0.5@0",
            Fault::new(0.0, FaultKind::AmplifierSaturating { volt: 0.5 }),
        ),
        (
            "channel_dead:7@0",
            Fault::new(0.0, FaultKind::ChannelDead { channel: 7 }),
        ),
        (
            "channel_saturating:7,0.5@0",
            Fault::new(0.0, FaultKind::ChannelSaturating { channel: 7, volt: 0.5 }),
        ),
        (
            "switch_resistance:drive_plus,16,150@0",
            Fault::new(
                0.0,
                FaultKind::SwitchResistance {
                    multiplexer: Multiplexer::DrivePlus,
                    electrode: 15,
                    ohm: 150.0,
                },
            ),
        ),
        (
            "address_swapped:sense_plus,0,2@0",
            Fault::new(
                0.0,
                FaultKind::AddressSwapped {
                    multiplexer: Multiplexer::SensePlus,
                    lines: [0, 2],
                },
            ),
        ),
        (
            "wires_swapped:5,6@0",
            Fault::new(0.0, FaultKind::WiresSwapped { electrodes: [4, 5] }),
        ),
        (
            "reference_lost:converter@0",
            Fault::new(
                0.0,
                FaultKind::ReferenceLost {
                    reference: Reference::Converter,
                },
            ),
        ),
        ("saturation@2", Fault::new(2.0, FaultKind::Saturation { channel: None })),
        (
            "saturation:2@2",
            Fault::new(2.0, FaultKind::Saturation { channel: Some(2) }),
        ),
    ] {
        assert_eq!(text.parse(), Ok(fault), "{text}");
    }
    for text in [
        "",
        "cable_pulled",
        "cable@1",
        "cable_pulled:1@1",
        "electrode_open@1",
        "electrode_open:0@1",
        "adc_stuck:70000@1",
        "board_reset@x",
    ] {
        let error = text.parse::<Fault>().unwrap_err().to_string();
        assert!(error.contains("write KIND@SECONDS"), "{error}");
    }
}

#[test]
fn faults_that_cannot_be_are_refused() {
    for text in [
        "electrode_open:17@1",
        "electrodes_short:3,3@1",
        "bytes_lost:1.5@1",
        "bytes_lost:nan@1",
        "adc_stuck:4096@1",
        "saturation:16@1",
        "wires_swapped:3,3@1",
        "address_swapped:drive_plus,1,1@1",
        "address_swapped:drive_plus,0,3@1",
        "switch_resistance:drive_plus,17,10@1",
        "amplifier_saturating:-1@1",
        "channel_dead:16@1",
        "channel_saturating:3,-1@1",
        "contact_raised:3,-1@1",
        "board_reset@-1",
        "board_reset@1+-1",
        "board_reset@nan",
    ] {
        let fault: Fault = text.parse().unwrap();
        assert!(fault.validate(16).is_err(), "{text}");
    }
    assert_eq!("electrode_open:16@1".parse::<Fault>().unwrap().validate(16), Ok(()));
}
