//! What the tests of the emulated board share.

pub(crate) mod sixteen;

use emulator::run::Outcome;
use firmware::settings::{self, Settings};
use firmware::{Excitation, Pace, Progress, Scan, Sector, Store, Wiring};
use forward::ElectrodeMatrix;
use hil_sim::{Clock, Electronics, FixedSheet, Flash, SimFrontEnd};
use nalgebra::DMatrix;
use protocol::{Frame, FromBoard, Hello, Plan};
use std::f64::consts::PI;
use std::path::PathBuf;

/// When the first command is sent, ns: the board is up long before.
pub(crate) const AWAKE_NS: u64 = 20_000_000;

pub(crate) fn program(name: &str) -> PathBuf {
    let folder = std::env::var_os("SKIN_STM32_PROGRAMS").expect("SKIN_STM32_PROGRAMS: run tests/boards.sh");
    PathBuf::from(folder).join(name)
}

/// The homogeneous disc with small electrodes on its rim, one place of it lifted so that no symmetry hides a wrong
/// route.
pub(crate) fn sheet() -> ElectrodeMatrix {
    let potential = |distance: f64| -1000.0 / PI * distance.ln();
    ElectrodeMatrix::from_potentials(DMatrix::from_fn(16, 16, |i, j| {
        let uneven = 3.0 * ((i * j) as f64).sqrt() + 2.0 * (i + j) as f64;
        if i == j {
            potential(2.5) + 100.0 + uneven
        } else {
            let half = PI * (i as f64 - j as f64) / 16.0;
            potential(195.0 * half.sin().abs()) + uneven
        }
    }))
}

/// The sheet with a touch: potentials near one place rise by a little.
pub(crate) fn touched() -> ElectrodeMatrix {
    let rest = sheet();
    ElectrodeMatrix::from_potentials(DMatrix::from_fn(16, 16, |i, j| {
        let near = |k: usize| (-(k as f64 - 5.0).powi(2) / 8.0).exp();
        rest.potentials_ohm()[(i, j)] + 4.0 * near(i) * near(j)
    }))
}

pub(crate) fn frames(outcome: &Outcome) -> Vec<Frame> {
    let frame = |(_, m): &(u64, FromBoard)| match m {
        FromBoard::Frame(f) => Some(f.clone()),
        _ => None,
    };
    outcome.messages.iter().filter_map(frame).collect()
}

pub(crate) fn hellos(outcome: &Outcome) -> Vec<Hello> {
    let hello = |(_, m): &(u64, FromBoard)| match m {
        FromBoard::Hello(h) => Some(h.clone()),
        _ => None,
    };
    outcome.messages.iter().filter_map(hello).collect()
}

/// What the chip's two sectors hold after these savings: written by the same library to the simulator's flash memory of the
/// same size.
pub(crate) fn stored(savings: &[Settings]) -> Vec<u8> {
    let mut flash = Flash::new(16 * 1024);
    for saving in savings {
        settings::save(&mut flash, saving).unwrap();
    }
    let mut bytes = vec![0; 32 * 1024];
    for (sector, part) in [Sector::A, Sector::B].into_iter().zip(bytes.chunks_mut(16 * 1024)) {
        flash.read(sector, 0, part).unwrap();
    }
    bytes
}

/// What the same firmware measures in process, the first sample of the first frame at a time.
pub(crate) fn in_process(plan: &Plan, first: u64, count: usize) -> Vec<Frame> {
    in_process_on(sheet(), plan, first, count)
}

/// The same on another sheet.
pub(crate) fn in_process_on(sheet: ElectrodeMatrix, plan: &Plan, first: u64, count: usize) -> Vec<Frame> {
    in_process_with(Electronics::drawn_board(), sheet, plan, first, count)
}

/// The same with other electronics.
pub(crate) fn in_process_with(
    electronics: Electronics,
    sheet: ElectrodeMatrix,
    plan: &Plan,
    first: u64,
    count: usize,
) -> Vec<Frame> {
    let clock = Clock::new();
    clock.advance(first - u64::from(plan.settle_quarters) * 4);
    let mut front = SimFrontEnd::new(electronics, FixedSheet(sheet), clock)
        .unwrap()
        .self_clocked();
    front.switch_on().unwrap();
    let mut scan = Scan::new();
    scan.wire(Wiring::one_channel(16));
    (0..count as u32)
        .map(|sequence| {
            scan.start(plan.recipe(), Pace::Ahead, 0, &mut front).unwrap();
            while nb::block!(scan.step(plan.recipe(), &mut front)).unwrap() != Progress::Complete {}
            let frame = scan.frame(sequence, plan.id, plan.quadrature);
            let mut bytes = [0; protocol::MAX_FROM_BOARD_LEN];
            let framed = protocol::encode(&protocol::Outgoing::Frame(frame), &mut bytes).unwrap();
            let mut decoder = protocol::Decoder::<{ protocol::MAX_FROM_BOARD_LEN }>::new();
            let mut out = None;
            decoder.push::<FromBoard>(framed, |m| out = Some(m.unwrap()));
            match out {
                Some(FromBoard::Frame(f)) => f,
                other => panic!("{other:?}"),
            }
        })
        .collect()
}
