//! A front end that gives phasors, under the same scan, plan, watch and protocol as one that gives samples.

use crate::fake::analyser::{Analyser, Broken, NOISE};
use crate::fake::{Chip, ELECTRODES, Wire, amplitude};
use crate::scan::INFO;
use firmware::laws::{self, DetectViolation};
use firmware::{BoardInfo, Controller, ErrorKind, FoldError, Folded, Memory, Reading, Route, Sense};
use proptest::prelude::*;
use protocol::{
    BoardError, Decoder, Frame, FromBoard, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, Pair, PeriodRequest, Plan, Refusal,
    Sampling, SelfTest, ToBoard, Variance, Watch, Watching, encode,
};
use std::cell::Cell;
use std::rc::Rc;

const ALL: Route = Route {
    drive: Pair { plus: 0, minus: 1 },
    sense: Sense::All { step: 1 },
    gain: 0,
};

fn found(broken: Option<Broken>) -> Result<(), DetectViolation> {
    let mut front = Analyser::new();
    front.broken = broken;
    laws::detect(&mut front, &ALL, ELECTRODES, |f| f.clock.get())
}

#[test]
fn the_analyser_keeps_the_laws() {
    assert_eq!(found(None), Ok(()));
}

#[test]
fn an_analyser_that_breaks_a_law_is_found_out() {
    assert!(matches!(
        found(Some(Broken::Unsettled)),
        Err(DetectViolation::Early { .. })
    ));
    assert!(matches!(found(Some(Broken::Hasty)), Err(DetectViolation::Hasty { .. })));
    assert_eq!(found(Some(Broken::Twice)), Err(DetectViolation::Surplus));
    assert_eq!(found(Some(Broken::Short)), Err(DetectViolation::Shape));
    assert!(matches!(
        found(Some(Broken::Turned)),
        Err(DetectViolation::Signal { .. })
    ));
    assert!(matches!(
        found(Some(Broken::Fixed)),
        Err(DetectViolation::Amplitude { .. })
    ));
    assert_eq!(found(Some(Broken::Mute)), Err(DetectViolation::Stuck));
    let mut failing = Analyser::new();
    failing.fault = Some(ErrorKind::Overrun);
    let said = laws::detect(&mut failing, &ALL, ELECTRODES, |f| f.clock.get());
    assert_eq!(said, Err(DetectViolation::Refused(ErrorKind::Overrun)));
}

/// A board with an analyser, and what it says.
struct Bench {
    board: Controller<'static, Analyser, Wire, Chip, Box<Memory>>,
    wire: Wire,
    decoder: Decoder<MAX_FROM_BOARD_LEN>,
    touch: Rc<Cell<f64>>,
}

impl Bench {
    fn new(plan: Plan) -> Self {
        let wire = Wire::default();
        wire.room.set(usize::MAX);
        let (front, mut chip) = (Analyser::new(), Chip::new());
        chip.clock = front.clock.clone();
        let touch = front.touch.clone();
        let info = BoardInfo { skew_ticks: 0, ..INFO };
        Self {
            board: Controller::new(info, plan, front, wire.clone(), chip, Box::default()).unwrap(),
            wire,
            decoder: Decoder::new(),
            touch,
        }
    }

    fn command(&mut self, command: &ToBoard) {
        let mut buffer = [0; MAX_TO_BOARD_LEN];
        self.wire
            .to_board
            .borrow_mut()
            .extend(encode(command, &mut buffer).unwrap().iter());
    }

    fn run(&mut self, polls: usize) -> Vec<FromBoard> {
        for _ in 0..polls {
            self.board.poll();
        }
        let bytes = std::mem::take(&mut *self.wire.from_board.borrow_mut());
        let mut out = Vec::new();
        self.decoder.push(&bytes, |m| out.push(m.unwrap()));
        out
    }
}

fn frames(said: Vec<FromBoard>) -> Vec<Frame> {
    let frame = |m| match m {
        FromBoard::Frame(f) => Some(f),
        _ => None,
    };
    said.into_iter().filter_map(frame).collect()
}

#[test]
fn a_frame_has_the_amplitudes_that_the_analyser_measured() {
    for sampling in [Sampling::Sequential, Sampling::Simultaneous] {
        let plan = Plan {
            sampling,
            quadrature: true,
            ..Plan::fast()
        };
        let mut bench = Bench::new(plan.clone());
        bench.command(&ToBoard::Start);
        let list = frames(bench.run(40_000));
        assert!(list.len() > 2, "{sampling:?}");
        let expected: Vec<f64> = plan
            .slots
            .iter()
            .flat_map(|s| s.sense_pairs(ELECTRODES).map(|pair| amplitude(s.drive, pair)))
            .collect();
        for pair in list.windows(2) {
            let quarters = (pair[1].time - pair[0].time) / 4;
            // A poll comes a quarter late at most, once a window.
            let windows = if sampling == Sampling::Sequential { 208 } else { 16 };
            let quickest = u64::from(plan.quarters());
            assert!((quickest..=quickest + 2 * windows).contains(&quarters), "{quarters}");
        }
        for f in &list {
            let values: Vec<f64> = f.values.iter().map(|v| v.codes()).collect();
            assert_eq!(values, expected, "{sampling:?}");
            assert!(f.quadrature.iter().all(|v| v.sixteenths() == 0) && f.clipped.count() == 0);
            let noise = |v: &Variance| (v.parts() as f64 / NOISE.parts() as f64 - 1.0).abs() < 0.13;
            assert!(
                f.noise.len() == plan.slots.len() && f.noise.iter().all(noise),
                "{:?}",
                f.noise
            );
        }
    }
}

#[test]
fn the_self_test_passes_and_asks_nothing_of_samples() {
    let mut bench = Bench::new(Plan::fast());
    bench.command(&ToBoard::SelfTest);
    let said = bench.run(60_000);
    let test = said.iter().find_map(|m| match m {
        FromBoard::SelfTest(t) => Some(t.clone()),
        _ => None,
    });
    let test: SelfTest = test.unwrap();
    assert_eq!((test.failed, test.bent, test.suspect), (0, 0, 0), "{test:?}");
    assert_eq!((test.offset.sixteenths(), test.source_permille), (0, 1000));
    assert_eq!(test.drive_pairs.len(), 16);
}

#[test]
fn a_folded_period_is_refused_with_the_reason() {
    let mut bench = Bench::new(Plan::fast());
    bench.run(3);
    bench.command(&ToBoard::GetPeriod(PeriodRequest {
        periods: 1,
        drive: Pair { plus: 0, minus: 1 },
        sense: Pair { plus: 3, minus: 2 },
        ..PeriodRequest::default()
    }));
    let refused = FromBoard::Error(BoardError::Refused(Refusal::NoSamples));
    assert_eq!(bench.run(1000), [refused]);
}

#[test]
fn its_watch_learns_sleeps_and_wakes_at_a_touch() {
    let mut bench = Bench::new(Plan::fast());
    bench.command(&ToBoard::SetWatch(Some(Watch::paper())));
    bench.command(&ToBoard::Start);
    let state = |said: &[FromBoard]| {
        let beat = |m: &FromBoard| match m {
            FromBoard::Heartbeat(h) => Some(h.state),
            _ => None,
        };
        said.iter().filter_map(beat).next_back()
    };
    let said = bench.run(60_000);
    assert_eq!(state(&said), Some(Watching::Asleep));
    assert!(frames(said).is_empty());
    bench.touch.set(5.0);
    let said = bench.run(5_000);
    assert_eq!(state(&said), Some(Watching::Awake));
    let list = frames(said);
    let value = list[0].values[0].codes();
    assert_eq!(
        value,
        5.0 + amplitude(Pair { plus: 0, minus: 1 }, Pair { plus: 3, minus: 2 })
    );
}

proptest! {
    /// Of any reading over any periods a value is its amplitude, rounded to the nearest sixteenth of a code.
    #[test]
    fn a_reading_is_rounded_once(
        in_phase in any::<i32>(),
        quadrature in any::<i32>(),
        periods in 1..=u16::MAX,
        parts in 1..1u32 << 24,
    ) {
        let mut f = Folded::new();
        let noise = Variance::new(parts);
        f.put(&[Reading { in_phase, quadrature, noise, clipped: true }], periods).unwrap();
        prop_assert_eq!((f.periods(), f.railed(0), f.is_sampled()), (periods, true, false));
        let (phasor, scatter) = f.correlate(0);
        for ((value, fitted), given) in [
            (phasor.in_phase_value(periods), in_phase),
            (phasor.quadrature_value(periods), quadrature),
        ] {
            // 2^16 units are a sixteenth; halves go away from zero.
            let nearest = ((i64::from(given).abs() + (1 << 15)) >> 16) * i64::from(given.signum());
            prop_assert_eq!(i64::from(value.sixteenths()), nearest.clamp(-32_768, 32_767));
            prop_assert_eq!(fitted, i16::try_from(nearest).is_ok());
        }
        let told = f64::from(scatter.variance(periods).parts());
        let given = f64::from(noise.parts());
        prop_assert!((told - given).abs() <= 0.125 * given + 256.0 / 112.0, "{told} {given}");
    }
}

#[test]
fn what_is_no_window_of_its_channels_is_refused() {
    let mut f = Folded::new();
    f.reset(2);
    let one = Reading::default();
    assert_eq!(f.put(&[one], 1), Err(FoldError::Shape));
    assert_eq!(f.put(&[one; 3], 1), Err(FoldError::Shape));
    assert_eq!(f.put(&[one; 2], 0), Err(FoldError::Shape));
    assert_eq!(f.put(&[one; 2], 7), Ok(()));
    assert_eq!(f.put(&[one; 2], 7), Err(FoldError::TooManyPeriods));
    // Samples after it neither.
    let block = firmware::Block {
        samples: &[2048; 32],
        channels: 2,
        sequence: 0,
        time: 0,
        rails: firmware::Rails::Unknown,
    };
    assert_eq!(f.add(&block), Err(FoldError::Shape));
    assert_eq!(f.periods(), 7);
}
