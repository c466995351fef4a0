//! A sheet with a known solution, and the far end of a simulated board's wire.
#![allow(dead_code, reason = "each test uses its own part")]

pub(crate) mod visibility;

use forward::ElectrodeMatrix;
use hil_sim::{PERIOD_SAMPLES, SheetModel, SimBoard, SimConfig, samples};
use nalgebra::DMatrix;
use protocol::{Decoder, Frame, FromBoard, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, ToBoard, encode};
use std::f64::consts::PI;

/// The homogeneous disc of 1 kilohm per square with small electrodes on its rim. A current into a point of the rim makes
/// the potential `-(R / pi) ln(distance)`; an electrode sees itself at a fourth of its width, plus its contact.
pub(crate) fn disc(electrodes: usize) -> ElectrodeMatrix {
    let (r, radius_mm, width_mm, contact_ohm) = (1000.0, 97.5, 10.0, 100.0);
    let potential = |distance: f64| -r / PI * distance.ln();
    ElectrodeMatrix::from_potentials(DMatrix::from_fn(electrodes, electrodes, |i, j| {
        if i == j {
            potential(width_mm / 4.0) + contact_ohm
        } else {
            let half = PI * (i as f64 - j as f64) / electrodes as f64;
            potential(2.0 * radius_mm * half.sin().abs())
        }
    }))
}

/// A command as bytes.
pub(crate) fn framed(command: &ToBoard) -> Vec<u8> {
    encode(command, &mut [0; MAX_TO_BOARD_LEN]).unwrap().to_vec()
}

/// Everything in a stream that must be without damage.
pub(crate) fn messages(bytes: &[u8]) -> Vec<FromBoard> {
    let mut out = Vec::new();
    Decoder::<MAX_FROM_BOARD_LEN>::new().push(bytes, |m| out.push(m.unwrap()));
    out
}

/// The frames among messages.
pub(crate) fn frames(messages: Vec<FromBoard>) -> Vec<Frame> {
    let frame = |m| match m {
        FromBoard::Frame(f) => Some(f),
        _ => None,
    };
    messages.into_iter().filter_map(frame).collect()
}

/// The times of frames that follow one another are so many samples apart; but for the source, which is measured between two
/// of them once a second: a period to settle, two to measure, one to rest. Returns how often.
pub(crate) fn are_apart(times: impl IntoIterator<Item = u64>, each: u64) -> usize {
    let times: Vec<u64> = times.into_iter().collect();
    let mut measured = Vec::new();
    for pair in times.windows(2) {
        let step = pair[1] - pair[0];
        assert!(step == each || step == each + 4 * PERIOD_SAMPLES, "{step} for {each}");
        if step != each {
            measured.push(pair[1]);
        }
    }
    let second = samples(1.0);
    assert!(measured.windows(2).all(|w| w[1] - w[0] >= second), "{measured:?}");
    measured.len()
}

/// A simulated board and one who listens to all it says.
pub(crate) struct Bench<S> {
    pub(crate) board: SimBoard<S>,
    decoder: Decoder<MAX_FROM_BOARD_LEN>,
}

impl<S: SheetModel> Bench<S> {
    pub(crate) fn new(config: SimConfig, sheet: S) -> Self {
        Self {
            board: SimBoard::new(config, sheet).unwrap(),
            decoder: Decoder::new(),
        }
    }

    pub(crate) fn send(&mut self, command: &ToBoard) {
        self.board.receive(&framed(command));
    }

    /// What it says in a time; nothing of it may be damaged.
    pub(crate) fn run(&mut self, duration_s: f64) -> Vec<FromBoard> {
        let bytes = self.board.run(duration_s);
        let mut out = Vec::new();
        self.decoder.push(&bytes, |m| out.push(m.unwrap()));
        out
    }

    /// Frames that it measures in a time after it is started.
    pub(crate) fn measured(&mut self, duration_s: f64) -> Vec<Frame> {
        self.send(&ToBoard::Start);
        frames(self.run(duration_s))
    }
}
