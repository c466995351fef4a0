//! Scan, command loop and outbox on the smallest front end.

use crate::fake::{Chip, ELECTRODES, Fake, Flaw, SKEW_TICKS, SOURCE_GAIN_MILLI, TICKS_PER_SAMPLE, Wire, amplitude};
use firmware::{
    Activity, Blocking, BoardInfo, Controller, ErrorKind, Folded, Memory, Outbox, Pace, Progress, Route, Scan, Sense,
    Window, laws, laws::Violation,
};
use proptest::prelude::*;
use protocol::{
    BoardError, Check, Command, Decoder, Frame, FrameError, FromBoard, FrontEndFault, MAX_FROM_BOARD_LEN,
    MAX_TO_BOARD_LEN, Outgoing, Pair, PeriodRequest, Plan, PlanError, Refusal, ResetCause, SCHEMA, Sampling, ToBoard,
    Value, Watch, encode, text,
};

pub(crate) const INFO: BoardInfo<'static> = BoardInfo {
    name: "fake",
    serial: "1",
    git: "0123456",
    electrodes: ELECTRODES,
    channels: 16,
    timer_hz: 84_000_000,
    ticks_per_sample: TICKS_PER_SAMPLE,
    in_turn: 16,
    skew_ticks: SKEW_TICKS,
    adc_bits: 12,
    adc_span_uv: 3_300_000,
    excitation_uv: 2_250_000,
    source_gain_milli: SOURCE_GAIN_MILLI,
    gains_milli: [1000, 0, 0, 0],
    reset: ResetCause::PowerOn,
    last_panic: "",
};

struct Bench {
    board: Controller<'static, Fake, Wire, Chip, Box<Memory>>,
    wire: Wire,
    decoder: Decoder<MAX_FROM_BOARD_LEN>,
}

impl Bench {
    /// A board whose start-up message was read.
    fn new(plan: Plan) -> Self {
        let wire = Wire::default();
        wire.room.set(usize::MAX);
        let board = Controller::new(INFO, plan, Fake::new(), wire.clone(), Chip::new(), Box::default()).unwrap();
        let mut this = Self {
            board,
            wire,
            decoder: Decoder::new(),
        };
        let first = this.run(3);
        assert!(matches!(&first[..], [FromBoard::Hello(h)] if h.board == "fake"));
        this
    }

    fn command(&mut self, command: &ToBoard) {
        let mut buffer = [0; MAX_TO_BOARD_LEN];
        let bytes = encode(command, &mut buffer).unwrap();
        self.wire.to_board.borrow_mut().extend(bytes);
    }

    fn run(&mut self, polls: usize) -> Vec<FromBoard> {
        for _ in 0..polls {
            self.board.poll();
        }
        self.read()
    }

    fn read(&mut self) -> Vec<FromBoard> {
        let mut out = Vec::new();
        let bytes = std::mem::take(&mut *self.wire.from_board.borrow_mut());
        self.decoder.push(&bytes, |m| out.push(m.unwrap()));
        out
    }

    fn frames(&mut self, polls: usize) -> Vec<Frame> {
        let frame = |m| match m {
            FromBoard::Frame(f) => Some(f),
            _ => None,
        };
        self.run(polls).into_iter().filter_map(frame).collect()
    }
}

#[test]
fn the_fake_keeps_the_laws() {
    let route = Route {
        drive: Pair { plus: 0, minus: 1 },
        sense: Sense::All { step: 1 },
        gain: 0,
    };
    let stall = |f: &mut &mut Fake| f.now += 100_000;
    assert_eq!(laws::check(&mut &mut Fake::new(), &route, 16, 12, stall), Ok(()));
}

#[test]
fn a_front_end_that_breaks_a_law_is_found_out() {
    let found = |flaw| {
        let route = Route {
            drive: Pair { plus: 0, minus: 1 },
            sense: Sense::All { step: 1 },
            gain: 0,
        };
        let mut fake = Fake::new();
        fake.flaw = Some(flaw);
        laws::check(&mut fake, &route, 16, 12, |f| f.now += 100_000)
    };
    assert!(matches!(found(Flaw::Late), Err(Violation::Phase { .. })));
    assert!(matches!(found(Flaw::Skips), Err(Violation::Gap { .. })));
    assert!(matches!(found(Flaw::Repeats), Err(Violation::Sequence { .. })));
    assert!(matches!(found(Flaw::Hasty), Err(Violation::Settling { .. })));
    assert!(matches!(found(Flaw::Cut), Err(Violation::Shape { .. })));
    assert!(matches!(found(Flaw::Surplus), Err(Violation::Quarters { .. })));
    assert!(matches!(found(Flaw::Reversed), Err(Violation::Signal { .. })));
    assert!(matches!(found(Flaw::Ahead), Err(Violation::Signal { .. })));
    assert_eq!(found(Flaw::Silent), Err(Violation::SilentOverrun));
    assert_eq!(found(Flaw::Mute), Err(Violation::Stuck));
}

/// What a frame shows does not depend on when its last drive is written down: at once, by the next start, or when asked.
#[test]
fn the_last_drive_is_written_down_before_it_is_read_whenever_that_is() {
    let plan = Plan {
        quadrature: true,
        ..Plan::fast()
    };
    let measured = |pace: Pace, next: bool| {
        let mut front = Fake::new();
        front.on = true;
        let mut scan = Scan::new();
        scan.wire(INFO.wiring());
        scan.start(plan.recipe(), pace, 0, &mut front).unwrap();
        while nb::block!(scan.step(plan.recipe(), &mut front)).unwrap() != Progress::Complete {}
        let there = scan.values().len();
        if next {
            scan.start(plan.recipe(), pace, 0, &mut front).unwrap();
        } else {
            scan.finish();
        }
        let frame = scan.frame(0, 0, true);
        let numbers = |values: &[Value]| values.iter().map(|v| v.sixteenths()).collect::<Vec<_>>();
        let (values, quadrature) = (numbers(frame.values), numbers(frame.quadrature));
        (there, values, quadrature, frame.noise.to_vec(), frame.clipped.count())
    };
    let (all, values, quadrature, noise, clipped) = measured(Pace::Ahead, false);
    assert_eq!((all, values.len(), noise.len()), (208, 208, 16));
    for next in [false, true] {
        // The last drive's thirteen are not there yet.
        let found = measured(Pace::Through, next);
        assert_eq!(found, (195, values.clone(), quadrature.clone(), noise.clone(), clipped));
    }
}

#[test]
fn the_blocking_adapter_lends_the_whole_window() {
    let mut front = Fake::new();
    front.on = true;
    let pair = Pair { plus: 3, minus: 2 };
    front.route = Some(Route {
        drive: Pair { plus: 0, minus: 1 },
        sense: Sense::One(pair),
        gain: 0,
    });
    let mut folded = Folded::new();
    let window = Window {
        settle_quarters: 9,
        periods: 7,
        channels: 1,
    };
    Blocking(&mut front)
        .capture(window, |b| folded.add(b).unwrap())
        .unwrap();
    assert_eq!(folded.periods(), 7);
    let a = folded.correlate(0).0.in_phase_value(7).0.codes();
    assert!((a - amplitude(Pair { plus: 0, minus: 1 }, pair)).abs() < 0.3);
}

#[test]
fn values_come_in_the_plans_order_either_way() {
    for plan in [Plan::paper(), Plan::fast()] {
        let mut bench = Bench::new(plan.clone());
        bench.command(&ToBoard::Start);
        let frames = bench.frames(20_000);
        assert!(frames.len() > 1, "{}", frames.len());
        for (k, frame) in frames.iter().enumerate() {
            assert_eq!((frame.sequence, frame.plan), (k as u32, plan.id));
            assert_eq!((frame.values.len(), frame.quadrature.len()), (208, 0));
            assert_eq!(frame.clipped.count(), 0);
            for (value, (drive, sense)) in frame.values.iter().zip(plan.measurements(ELECTRODES)) {
                // Rounding to codes costs at most 2/16 * sum |sin| / 2 = 0.63 code.
                let expected = amplitude(drive, sense);
                assert!((value.codes() - expected).abs() < 0.64, "{drive:?} {sense:?}");
            }
        }
        // As long as the plan says, and first sample after the first settling.
        let n = 4;
        let duration = frames[1].time - frames[0].time;
        assert_eq!(duration, u64::from(plan.quarters()) * n);
    }
}

#[test]
fn quadrature_comes_when_asked_for() {
    let plan = Plan {
        quadrature: true,
        ..Plan::fast()
    };
    let mut bench = Bench::new(plan);
    bench.command(&ToBoard::Start);
    let frame = bench.frames(200).remove(0);
    assert_eq!(frame.quadrature.len(), 208);
    assert!(frame.quadrature.iter().all(|q| q.codes().abs() < 0.64));
}

#[test]
fn every_command_is_answered() {
    let mut bench = Bench::new(Plan::paper());
    bench.command(&ToBoard::Hello);
    bench.command(&ToBoard::GetPlan);
    bench.command(&ToBoard::SetPlan(Plan::fast()));
    bench.command(&ToBoard::GetPlan);
    bench.command(&ToBoard::Stop);
    bench.command(&ToBoard::GetCounters);
    bench.command(&ToBoard::ResetCounters);
    let answers = bench.run(30);
    assert!(matches!(&answers[0], FromBoard::Hello(h) if h.electrodes == 16));
    assert_eq!(answers[1], FromBoard::Plan(Plan::paper()));
    assert_eq!(answers[2], FromBoard::Plan(Plan::fast()));
    assert_eq!(answers[3], FromBoard::Plan(Plan::fast()));
    assert_eq!(answers[4], FromBoard::Ack(Command::Stop));
    assert!(matches!(&answers[5], FromBoard::Counters(c) if c.commands == 6));
    assert_eq!(answers[6], FromBoard::Ack(Command::ResetCounters));
    assert_eq!(bench.board.poll(), Activity::Idle);
}

#[test]
fn what_cannot_be_done_is_refused_and_changes_nothing() {
    let mut bench = Bench::new(Plan::fast());
    let mut bad = Plan::paper();
    bad.slots[9].drive.plus = 200;
    bench.command(&ToBoard::SetPlan(bad));
    // An undamaged message of a later protocol, and a damaged one.
    let mut buffer = [0; 64];
    let unknown = encode(&99u8, &mut buffer).unwrap().to_vec();
    bench.wire.to_board.borrow_mut().extend(&unknown);
    bench.wire.to_board.borrow_mut().extend(&[5, 1, 2, 3, 4, 2, 9, 0]);
    bench.command(&ToBoard::GetPlan);
    let refusal = PlanError::Electrode {
        slot: 9,
        electrode: 200,
        count: 16,
    };
    let expected = [
        FromBoard::Error(BoardError::Plan(refusal)),
        FromBoard::Error(BoardError::Command(FrameError::Unknown)),
        FromBoard::Error(BoardError::Command(FrameError::Crc)),
        FromBoard::Plan(Plan::fast()),
    ];
    assert_eq!(bench.run(30), expected);
    assert_eq!(bench.board.counters().refused, 3);
}

#[test]
fn an_overrun_costs_one_frame_and_leaves_a_gap() {
    let mut bench = Bench::new(Plan::fast());
    bench.command(&ToBoard::Start);
    let before = bench.frames(500);
    bench.board.front_mut().now += 10_000;
    let after = bench.frames(500);
    let last = before.last().unwrap().sequence;
    assert_eq!(after[0].sequence, last + 2);
    assert_eq!(bench.board.counters().overruns, 1);
    assert!(after.windows(2).all(|w| w[1].sequence == w[0].sequence + 1));
    for frame in &after {
        assert_eq!(frame.values.len(), 208);
    }
}

#[test]
fn any_other_fault_stops_the_scan_and_is_reported() {
    for (kind, fault) in [
        (ErrorKind::Route, FrontEndFault::Route),
        (ErrorKind::Timeout, FrontEndFault::Timeout),
        (ErrorKind::Other, FrontEndFault::Other),
    ] {
        let mut bench = Bench::new(Plan::fast());
        bench.command(&ToBoard::Start);
        bench.frames(100);
        bench.board.front_mut().fault = Some(kind);
        let said = bench.run(100);
        let error = FromBoard::Error(BoardError::FrontEnd(fault));
        assert!(said.contains(&error), "{said:?}");
        assert!(!bench.board.running() && !bench.board.front_mut().on);
        assert!(bench.frames(300).is_empty());
        // And it can be started again.
        bench.command(&ToBoard::Start);
        assert!(!bench.frames(300).is_empty());
    }
}

#[test]
fn a_front_end_that_falls_silent_is_a_fault_after_a_window_and_two_periods() {
    let mut bench = Bench::new(Plan::fast());
    let clock = bench.board.front_mut().clock.clone();
    bench.board.support_mut().clock = clock;
    bench.command(&ToBoard::Start);
    assert!(!bench.frames(2000).is_empty());
    let before = bench.board.front_mut().now;
    bench.board.front_mut().flaw = Some(Flaw::Mute);
    let mut said = Vec::new();
    while bench.board.running() {
        said.extend(bench.run(1));
        assert!(bench.board.front_mut().now < before + 16 * 10);
    }
    said.extend(bench.run(5));
    assert!(
        said.contains(&FromBoard::Error(BoardError::FrontEnd(FrontEndFault::Timeout))),
        "{said:?}"
    );
    assert!(!bench.board.front_mut().on);
    // A long window is not silence.
    let mut bench = Bench::new(Plan {
        integrate_periods: 3000,
        ..Plan::fast()
    });
    let clock = bench.board.front_mut().clock.clone();
    bench.board.support_mut().clock = clock;
    bench.command(&ToBoard::Start);
    bench.frames(20_000);
    assert!(bench.board.running());
}

#[test]
fn the_watchdog_is_fed_in_every_poll_and_nowhere_else() {
    let mut bench = Bench::new(Plan::fast());
    bench.command(&ToBoard::Start);
    let fed = bench.board.support_mut().fed;
    bench.run(123);
    assert_eq!(bench.board.support_mut().fed, fed + 123);
}

#[test]
fn a_frame_is_as_good_as_its_source() {
    let mut bench = Bench::new(Plan::fast());
    bench.board.front_mut().source = 0.85;
    bench.command(&ToBoard::Start);
    let said = bench.run(2000);
    let fault = FromBoard::Error(BoardError::FrontEnd(FrontEndFault::Source));
    assert_eq!(said, [FromBoard::Ack(Command::Start), fault]);
    bench.board.front_mut().source = 0.95;
    bench.command(&ToBoard::Start);
    assert!(!bench.frames(2000).is_empty());
}

/// A DAC whose table is one step off gives the right amplitude 22.5 degrees late, and every value 8 % too small.
#[test]
fn a_source_that_is_a_step_late_is_noticed() {
    let mut bench = Bench::new(Plan::fast());
    bench.board.front_mut().source_late = 1.0;
    bench.command(&ToBoard::Start);
    let fault = FromBoard::Error(BoardError::FrontEnd(FrontEndFault::Source));
    assert_eq!(bench.run(2000), [FromBoard::Ack(Command::Start), fault]);
    bench.command(&ToBoard::SelfTest);
    let said = bench.run(20_000);
    let found = |m: &FromBoard| match m {
        FromBoard::SelfTest(r) => Some((r.passed(Check::Source), r.passed(Check::Phase))),
        _ => None,
    };
    assert_eq!(said.iter().find_map(found), Some((true, false)), "{said:?}");
    // 6.75 degrees are within what parts may make.
    bench.board.front_mut().source_late = 0.3;
    bench.command(&ToBoard::Start);
    assert!(!bench.frames(2000).is_empty());
}

#[test]
fn tests_and_periods_come_between_frames_without_a_gap() {
    let mut bench = Bench::new(Plan::fast());
    bench.command(&ToBoard::Start);
    let mut all = bench.run(3000);
    bench.command(&ToBoard::SelfTest);
    all.extend(bench.run(6000));
    let pair = Pair { plus: 5, minus: 4 };
    let request = PeriodRequest {
        drive: Pair { plus: 0, minus: 1 },
        sense: pair,
        gain: 0,
        settle_quarters: 3,
        periods: 10,
    };
    bench.command(&ToBoard::GetPeriod(request));
    all.extend(bench.run(3000));
    let sequences: Vec<u32> = all
        .iter()
        .filter_map(|m| match m {
            FromBoard::Frame(f) => Some(f.sequence),
            _ => None,
        })
        .collect();
    assert!(sequences.windows(2).all(|w| w[1] == w[0] + 1), "{sequences:?}");
    let place = |what: fn(&FromBoard) -> bool| all.iter().position(what).unwrap();
    let tested = place(|m| matches!(m, FromBoard::SelfTest(_)));
    let period = place(|m| matches!(m, FromBoard::Period(_)));
    assert!(tested < period && period < all.len() - 1);
    let FromBoard::Period(p) = &all[period] else { panic!() };
    // Ten periods of the sine, each sample rounded.
    for (k, bin) in p.bins.iter().enumerate() {
        let sine = (std::f64::consts::TAU * k as f64 / 16.0).sin();
        let expected = 2047.5 + amplitude(request.drive, pair) * sine;
        assert!((f64::from(*bin) / 10.0 - expected).abs() <= 0.5 + 1e-9, "{k}");
    }
    let FromBoard::SelfTest(report) = &all[tested] else {
        panic!()
    };
    assert!(report.passed(Check::Source) && report.passed(Check::Store) && report.passed(Check::Noise));
    // The fake's drive pairs show less than half of its source: neither open nor shorted.
    assert_eq!((report.suspect, report.drive_pairs.len()), (0, 16));
    bench.board.support_mut().broken = true;
    bench.command(&ToBoard::SelfTest);
    let said = bench.run(6000);
    assert!(
        said.iter()
            .any(|m| matches!(m, FromBoard::SelfTest(r) if r.failed == Check::Store.bit())),
        "{said:?}"
    );
}

#[test]
fn a_store_that_does_not_work_is_said_and_changes_nothing() {
    let mut bench = Bench::new(Plan::fast());
    bench.board.support_mut().broken = true;
    for command in [ToBoard::SaveSettings, ToBoard::ForgetSettings] {
        bench.command(&command);
        let refused = FromBoard::Error(BoardError::Refused(Refusal::Store));
        assert_eq!(bench.run(5), [refused]);
    }
    bench.command(&ToBoard::Start);
    assert!(!bench.frames(2000).is_empty());
}

#[test]
fn the_introduction_says_what_the_board_is() {
    let hello = INFO.hello();
    assert_eq!(
        (hello.git.as_str(), hello.reset, hello.schema),
        ("0123456", ResetCause::PowerOn, SCHEMA)
    );
    assert_eq!((hello.skew_ticks, hello.gains_milli.len()), (SKEW_TICKS, 1));
    // The same board after a panic is the same board; with another firmware it is not.
    let mut other = hello.clone();
    (other.reset, other.last_panic) = (ResetCause::Panic, text("index out of bounds"));
    assert!(hello.is_same_board(&other));
    other.firmware = text("9.9.9");
    assert!(!hello.is_same_board(&other));
}

#[test]
fn a_rail_is_flagged_at_the_value_that_touched_it() {
    let mut bench = Bench::new(Plan {
        sampling: Sampling::Sequential,
        ..Plan::fast()
    });
    // The largest amplitude, 800 + 50 * 15 - 7 * n, then reaches full scale for the last drive's first values only.
    bench.board.front_mut().offset = 4095.0 - 1500.0;
    bench.command(&ToBoard::Start);
    let frame = bench.frames(6000).remove(0);
    for (k, (drive, sense)) in Plan::fast().measurements(ELECTRODES).enumerate() {
        let reaches = (2595.0 + amplitude(drive, sense)).round() >= 4095.0;
        assert_eq!(frame.clipped.get(k), reaches, "{k}");
    }
    assert!(frame.clipped.count() > 0);
}

#[test]
fn a_slow_link_costs_whole_frames_and_never_the_scan() {
    let mut bench = Bench::new(Plan::fast());
    bench.command(&ToBoard::Start);
    bench.frames(10);
    // The link stops in the middle of a frame.
    bench.wire.room.set(1000);
    let mut got = bench.frames(60_000);
    let measured = bench.board.counters().frames;
    assert!(measured > 200, "the scan went on: {measured}");
    bench.wire.room.set(usize::MAX);
    got.extend(bench.frames(2));
    // What came is whole (the decoder found no error), in order, and the newest is among it.
    assert!(got.windows(2).all(|w| w[0].sequence < w[1].sequence));
    assert_eq!(got.last().unwrap().sequence, measured - 1);
    let dropped = bench.board.counters().dropped;
    let gaps: u32 = got.windows(2).map(|w| w[1].sequence - w[0].sequence - 1).sum();
    assert_eq!(dropped, gaps);
    assert!(dropped > 150);
}

#[test]
fn answers_outlive_frames_in_the_queue() {
    // Room for two frames of 200 values and as many answers as can wait.
    let mut outbox = Outbox::<1160>::new();
    let frame = |sequence| {
        FromBoard::Frame(Frame {
            sequence,
            values: (0..200).map(|k| Value::new(k * 77)).collect(),
            ..Frame::default()
        })
    };
    let push = |outbox: &mut Outbox<1160>, message: FromBoard| outbox.push(&Outgoing::from(&message));
    let mut dropped = push(&mut outbox, frame(0));
    dropped += push(&mut outbox, FromBoard::Ack(Command::Start));
    dropped += push(&mut outbox, frame(1));
    assert_eq!(dropped, 0);
    // One byte of frame 0 goes out after the delimiter: it must be finished.
    let mut wire = Wire::default();
    wire.room.set(2);
    assert_eq!(outbox.pump(&mut wire), Ok(2));
    assert_eq!(push(&mut outbox, frame(2)), 1);
    assert_eq!(push(&mut outbox, FromBoard::Ack(Command::Stop)), 0);
    let refusal = || FromBoard::Error(BoardError::Command(FrameError::Crc));
    for _ in 0..12 {
        assert_eq!(push(&mut outbox, refusal()), 0);
    }
    // As many messages as it can count: the newest frame has to go, then the oldest answer.
    assert_eq!(push(&mut outbox, refusal()), 1);
    assert_eq!(push(&mut outbox, FromBoard::Ack(Command::ResetCounters)), 1);
    wire.room.set(usize::MAX);
    outbox.pump(&mut wire).unwrap();
    assert!(outbox.is_empty());
    let mut out: Vec<FromBoard> = Vec::new();
    let mut decoder = Decoder::<MAX_FROM_BOARD_LEN>::new();
    decoder.push(&wire.from_board.borrow(), |m| out.push(m.unwrap()));
    let mut kept = vec![frame(0), FromBoard::Ack(Command::Stop)];
    kept.extend((0..13).map(|_| refusal()));
    kept.push(FromBoard::Ack(Command::ResetCounters));
    assert_eq!(out, kept);
}

#[test]
fn what_does_not_fit_beside_the_frame_on_the_wire_is_dropped_itself() {
    let mut outbox = Outbox::<1160>::new();
    let frame = |sequence| {
        FromBoard::Frame(Frame {
            sequence,
            values: (0..256).map(|k| Value::new(k * 77)).collect(),
            quadrature: (0..160).map(|k| Value::new(k * 78)).collect(),
            ..Frame::default()
        })
    };
    assert_eq!(outbox.push(&Outgoing::from(&frame(0))), 0);
    let mut wire = Wire::default();
    wire.room.set(500);
    outbox.pump(&mut wire).unwrap();
    assert_eq!(outbox.push(&Outgoing::from(&frame(1))), 1);
    wire.room.set(usize::MAX);
    outbox.pump(&mut wire).unwrap();
    assert_eq!(outbox.push(&Outgoing::from(&frame(2))), 0);
    outbox.pump(&mut wire).unwrap();
    let mut out: Vec<FromBoard> = Vec::new();
    Decoder::<MAX_FROM_BOARD_LEN>::new().push(&wire.from_board.borrow(), |m| out.push(m.unwrap()));
    assert_eq!(out, [frame(0), frame(2)]);
}

#[test]
fn a_new_plan_in_the_middle_of_a_frame_takes_over_at_once_without_a_gap() {
    let mut bench = Bench::new(Plan::paper());
    bench.command(&ToBoard::Start);
    bench.frames(100);
    bench.command(&ToBoard::SetPlan(Plan::fast()));
    let frames = bench.frames(300);
    assert_eq!((frames[0].sequence, frames[0].plan), (0, 2));
    assert_eq!(frames[0].values.len(), 208);
    bench.command(&ToBoard::Stop);
    bench.run(5);
    assert!(bench.frames(200).is_empty());
    bench.command(&ToBoard::Start);
    let again = bench.frames(200);
    assert_eq!(again[0].sequence, frames.last().unwrap().sequence + 1);
}

#[test]
fn all_that_is_large_fits_a_small_memory_beside_samples_and_stack() {
    // On a machine of 64 bits it is a little larger than on a Cortex-M.
    let size = size_of::<Memory>();
    assert!(size <= 5632, "{size}");
}

/// Any command, most of them possible.
fn commands() -> impl Strategy<Value = ToBoard> {
    let pair = || (0..17u8, 0..17u8).prop_map(|(plus, minus)| Pair { plus, minus });
    let period =
        (pair(), pair(), 0..2u8, 0..9u16, 0..9u16).prop_map(|(drive, sense, gain, settle_quarters, periods)| {
            ToBoard::GetPeriod(PeriodRequest {
                drive,
                sense,
                gain,
                settle_quarters,
                periods,
            })
        });
    let watch =
        (0..4u16, 0..3u16, 0..3u16, 0..5u16).prop_map(|(learn_scans, frames_between, quiet_scans, rest_quarters)| {
            ToBoard::SetWatch(Some(Watch {
                learn_scans,
                frames_between,
                quiet_scans,
                rest_quarters,
                ..Watch::paper()
            }))
        });
    let plan = (0..3u16, 0..4u16, any::<bool>(), any::<bool>()).prop_map(|(settle, integrate, one, quadrature)| {
        ToBoard::SetPlan(Plan {
            settle_quarters: settle,
            integrate_periods: integrate,
            sampling: if one {
                Sampling::Sequential
            } else {
                Sampling::Simultaneous
            },
            quadrature,
            ..Plan::fast()
        })
    });
    prop_oneof![
        Just(ToBoard::Hello),
        Just(ToBoard::Start),
        Just(ToBoard::Start),
        Just(ToBoard::Stop),
        Just(ToBoard::GetPlan),
        Just(ToBoard::GetCounters),
        Just(ToBoard::ResetCounters),
        Just(ToBoard::SetWatch(None)),
        Just(ToBoard::GetWatch),
        Just(ToBoard::TakeBaseline),
        Just(ToBoard::GetBaseline),
        Just(ToBoard::SelfTest),
        Just(ToBoard::SaveSettings),
        Just(ToBoard::ForgetSettings),
        any::<bool>().prop_map(ToBoard::SetAutostart),
        (0..1100u16).prop_map(ToBoard::SetExcitation),
        period,
        watch,
        plan,
    ]
}

proptest! {
    #[test]
    fn every_command_is_answered_once_whatever_is_under_way(
        list in proptest::collection::vec((commands(), 0..900usize), 1..25),
    ) {
        let mut bench = Bench::new(Plan::fast());
        let count = list.len();
        let mut said = Vec::new();
        for (command, polls) in list {
            bench.command(&command);
            said.extend(bench.run(polls));
        }
        said.extend(bench.run(3000));
        // What the board says by itself is no answer: the source of this bench gives nothing.
        let unasked = |m: &&FromBoard| matches!(m, FromBoard::Frame(_) | FromBoard::Heartbeat(_) | FromBoard::Notice(_));
        let answers = said.iter().filter(|m| !unasked(m)).count();
        prop_assert_eq!(answers, count, "{:?}", said);
        // What was measured is in order, and nothing is measured after a stop.
        bench.command(&ToBoard::Stop);
        bench.run(3000);
        prop_assert!(!bench.board.front_mut().on && bench.board.is_quiet());
    }
}

proptest! {
    #[test]
    fn no_bytes_can_stop_the_board(
        noise in proptest::collection::vec(prop_oneof![Just(0u8), any::<u8>()], 0..600),
        started: bool,
    ) {
        let mut bench = Bench::new(Plan::fast());
        if started {
            bench.command(&ToBoard::Start);
        }
        bench.wire.to_board.borrow_mut().extend(&noise);
        bench.wire.to_board.borrow_mut().push_back(0);
        bench.command(&ToBoard::Hello);
        let said = bench.run(200);
        prop_assert!(said.iter().any(|m| matches!(m, FromBoard::Hello(_))));
    }
}
