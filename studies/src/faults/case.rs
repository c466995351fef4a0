//! The faults that are tried.

use forward::Pattern;
use hil_sim::Preset;
use protocol::PlanName;

/// Something wrong in the values of a frame. Values and channels are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ValueFault {
    /// One value is multiplied.
    Value(usize, f64),
    /// The values of an amplifier, between this electrode and the next, are multiplied.
    ChannelGain(usize, f64),
    /// Volts are added to the values of an amplifier.
    ChannelOffset(usize, f64),
}

impl ValueFault {
    /// Makes a frame (V, in the pattern's order) a faulty one.
    pub fn apply(self, values_v: &mut [f64], pattern: &Pattern) {
        let next = |l: usize| (l + 1) % pattern.electrodes();
        for (k, (v, m)) in values_v.iter_mut().zip(pattern.measurements()).enumerate() {
            let is_of = |l: usize| {
                [m.sense.plus, m.sense.minus].contains(&l) && [m.sense.plus, m.sense.minus].contains(&next(l))
            };
            match self {
                Self::Value(index, factor) if index == k => *v *= factor,
                Self::ChannelGain(l, factor) if is_of(l) => *v *= factor,
                Self::ChannelOffset(l, volts) if is_of(l) => *v += volts,
                _ => {}
            }
        }
    }
}

/// A fault with what it has to be named by.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// As in a table.
    pub name: String,
    /// Of the board and its line: kinds as on the command line, without the time.
    pub board: Vec<String>,
    /// How long the board's faults last, s; none: to the end.
    pub for_s: Option<f64>,
    /// In the values.
    pub values: Option<ValueFault>,
    /// Which board.
    pub preset: Preset,
    /// What is measured; none: what `skin run` chooses.
    pub plan: Option<PlanName>,
    /// It is named once all of one of these were said.
    pub named: Vec<Vec<String>>,
}

impl Case {
    fn new(name: &str, named: &[&str]) -> Self {
        Self {
            name: name.to_owned(),
            board: Vec::new(),
            for_s: None,
            values: None,
            preset: Preset::default(),
            plan: None,
            named: named
                .iter()
                .map(|all| all.split(" & ").map(str::to_owned).collect())
                .collect(),
        }
    }

    /// Faults of the board, in its words.
    fn board(kinds: &[&str], named: &[&str]) -> Self {
        Self {
            board: kinds.iter().map(|&k| k.to_owned()).collect(),
            ..Self::new(&format!("`{}`", kinds.join("`, `")), named)
        }
    }

    fn lasting(self, for_s: f64) -> Self {
        Self {
            name: format!("{} for {for_s} s", self.name),
            for_s: Some(for_s),
            ..self
        }
    }

    fn with_plan(self, plan: PlanName) -> Self {
        Self {
            name: format!("{}, plan {}", self.name, plan.name()),
            plan: Some(plan),
            ..self
        }
    }

    fn on(self, preset: Preset) -> Self {
        Self {
            name: format!("{}, board {}", self.name, preset.name()),
            preset,
            ..self
        }
    }

    fn in_values(name: &str, fault: ValueFault, named: &[&str]) -> Self {
        Self {
            values: Some(fault),
            ..Self::new(name, named)
        }
    }
}

/// Every fault of docs/simulator.md, and some in the values. The first is none.
pub fn cases() -> Vec<Case> {
    let frames_lost: &[&str] = &["frames are lost", "did not answer"];
    let mut out = vec![Case::new("none", &[])];
    for kind in ["bytes_lost", "bytes_flipped", "bytes_doubled"] {
        for rate in ["0.0001", "0.01"] {
            out.push(Case::board(&[&format!("{kind}:{rate}")], frames_lost));
        }
    }
    out.push(Case::board(&["line_break"], &["sent nothing for", "frames are lost"]).lasting(1.0));
    out.push(Case::board(&["break_to_board"], &[]).lasting(0.5));
    out.push(Case::board(&["cable_pulled"], &["connection to the board is lost"]).lasting(0.5));
    for kind in ["board_reset", "board_hangs"] {
        out.push(Case::board(&[kind], &["the board was reset"]).lasting(0.3));
    }
    out.extend([
        Case::board(&["electrode_open:3"], &["electrode 3 "]),
        Case::board(
            &["electrode_open:3", "electrode_open:4"],
            &["electrodes 3 and 4 ", "electrode 3 gives & electrode 4 gives"],
        ),
        Case::board(
            &["electrode_open:3", "electrode_open:9"],
            &["electrodes 3 and 9 ", "electrode 3 gives & electrode 9 gives"],
        ),
        Case::board(
            &["electrode_open:3", "electrode_open:8", "electrode_open:13"],
            &[
                "electrodes 3, 8 and 13 ",
                "electrode 3 gives & electrode 8 gives & electrode 13 gives",
            ],
        ),
    ]);
    for ohm in [20, 50, 100, 500, 5000] {
        out.push(Case::board(&[&format!("contact_raised:3,{ohm}")], &["electrode 3 "]));
    }
    for ohm in [50, 100] {
        let both = [3, 9].map(|electrode| format!("contact_raised:{electrode},{ohm}"));
        out.push(Case::board(
            &both.each_ref().map(String::as_str),
            &["electrodes 3 and 9 "],
        ));
    }
    out.push(Case::board(
        &["contact_raised:3,500", "contact_raised:9,200"],
        &["electrodes 3 and 9 "],
    ));
    out.extend([
        Case::board(&["electrodes_short:3,4"], &["electrodes 3 and 4 "]),
        Case::board(&["electrodes_short:3,10"], &["electrodes 3 and 10 "]),
        Case::board(&["electrodes_short:3,4,100"], &["electrodes 3 and 4 "]),
        Case::board(&["electrodes_short:3,4,10000"], &["electrodes 3 and 4 "]),
        Case::board(&["electrodes_short:3,4,100000"], &["electrodes 3 and 4 "]),
        Case::board(&["electrodes_short:3,10,30000"], &["electrodes 3 and 10 "]),
        Case::board(&["electrodes_short:3,10,300000"], &["electrodes 3 and 10 "]),
        Case::board(&["source_lost"], &["the source "]),
        Case::board(&["adc_stuck:0"], &["rail"]),
        Case::board(&["adc_stuck:2048"], &["converter"]),
        Case::board(&["adc_stuck:4095"], &["rail"]),
    ]);
    for (line, named) in [
        ("drive_plus", "drive + multiplexer"),
        ("drive_minus", "drive - multiplexer"),
    ] {
        out.push(Case::board(&[&format!("multiplexer_stuck:{line},3")], &[named]));
    }
    for (line, named) in [
        ("sense_plus", "sense + multiplexer"),
        ("sense_minus", "sense - multiplexer"),
    ] {
        let case = Case::board(&[&format!("multiplexer_stuck:{line},3")], &[named]);
        out.push(case.with_plan(PlanName::SequentialFast));
    }
    out.extend([
        Case::board(&["saturation:5"], &["electrodes 6 and 7 "]),
        Case::board(&["saturation"], &["rail"]),
        Case::board(&["converter_overrun:0.001"], frames_lost),
        Case::board(&["converter_overrun:0.02"], frames_lost),
        Case::in_values("one value x10", ValueFault::Value(100, 10.0), &["value of drive"]),
        Case::in_values(
            "one channel's gain +1 %",
            ValueFault::ChannelGain(6, 1.01),
            &["electrodes 7 and 8 "],
        ),
        Case::in_values(
            "one channel's gain +5 %",
            ValueFault::ChannelGain(6, 1.05),
            &["electrodes 7 and 8 "],
        ),
        Case::in_values(
            "one channel's offset 1 mV",
            ValueFault::ChannelOffset(6, 1e-3),
            &["electrodes 7 and 8 "],
        ),
        Case::in_values(
            "one channel's offset 10 mV",
            ValueFault::ChannelOffset(6, 1e-2),
            &["electrodes 7 and 8 "],
        ),
    ]);
    for [a, b] in [[3, 4], [3, 11]] {
        out.push(Case::board(
            &[&format!("wires_swapped:{a},{b}")],
            &[&format!("electrodes {a} and {b} "), "another order"],
        ));
    }
    for part in ["0.9", "0.5", "0.05"] {
        out.push(Case::board(
            &[&format!("source_sags:{part}")],
            &["the voltages are", "the source's amplitude"],
        ));
    }
    out.push(Case::board(&["electrode_open:3", "source_sags:0.8"], &["electrode 3 "]));
    for (line, ohm, pair) in [
        ("drive_plus", 100, "electrodes 3 and 4 "),
        ("drive_plus", 300, "electrodes 3 and 4 "),
        ("drive_minus", 300, "electrodes 2 and 3 "),
    ] {
        let kind = format!("switch_resistance:{line},3,{ohm}");
        out.push(Case::board(&[&kind], &[pair]));
    }
    for (line, named) in [
        ("drive_plus,0,1", "drive + multiplexer"),
        ("drive_plus,1,2", "drive + multiplexer"),
        ("drive_minus,0,2", "drive - multiplexer"),
    ] {
        out.push(Case::board(&[&format!("address_swapped:{line}")], &[named]));
    }
    for (line, named) in [
        ("sense_plus,0,1", "sense + multiplexer"),
        ("sense_minus,1,2", "sense - multiplexer"),
    ] {
        out.push(Case::board(&[&format!("address_swapped:{line}")], &[named]).on(Preset::DrawnBoard));
    }
    out.extend([
        Case::board(&["switch_resistance:sense_plus,3,300"], &[]).on(Preset::DrawnBoard),
        Case::board(&["amplifier_dead"], &["amplifiers"]).on(Preset::DrawnBoard),
        Case::board(&["amplifier_saturating:1"], &["amplifiers saturate"]).on(Preset::DrawnBoard),
        Case::board(&["amplifier_saturating:1.5"], &["amplifiers saturate"]).on(Preset::DrawnBoard),
        Case::board(&["channel_dead:6"], &["electrodes 7 and 8 "]).on(Preset::DrawnSixteen),
        Case::board(&["channel_saturating:6,1.5"], &["electrodes 7 and 8 "]).on(Preset::DrawnSixteen),
        Case::board(
            &["reference_lost:drive"],
            &["the voltages are", "the source's amplitude"],
        )
        .on(Preset::DrawnBoard),
        Case::board(&["reference_lost:converter"], &["rail"]).on(Preset::DrawnBoard),
    ]);
    // Two of different kinds at once.
    for (beside, named) in [
        ("electrodes_short:9,10,30", "electrodes 9 and 10 "),
        ("electrodes_short:9,10,10000", "electrodes 9 and 10 "),
        ("contact_raised:9,200", "electrode 9 "),
        ("wires_swapped:8,9", "electrodes 8 and 9 "),
        ("multiplexer_stuck:drive_plus,9", "drive + multiplexer"),
        ("switch_resistance:drive_plus,9,300", "electrodes 9 and 10 "),
    ] {
        // Exchanged wires are told by the baseline as another order.
        let [both, order] = [named, "another order"].map(|named| format!("electrode 3 & {named}"));
        out.push(Case::board(&["electrode_open:3", beside], &[&both, &order]));
    }
    out.extend([
        Case::board(
            &["contact_raised:3,500", "electrodes_short:9,10,10000"],
            &["electrode 3 & electrodes 9 and 10 "],
        ),
        Case::board(
            &["channel_dead:6", "electrode_open:12"],
            &["electrodes 7 and 8 & electrode 12 "],
        )
        .on(Preset::DrawnSixteen),
    ]);
    out
}
