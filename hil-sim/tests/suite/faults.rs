//! Faults at work: what they make of the frames and of the bytes.

use crate::common::{Bench, disc, framed};
use hil_sim::{Electronics, Fault, FaultKind, FixedSheet, Pace, SimBoard, SimConfig, SimPort, seconds};
use protocol::{
    BoardError, Counters, Decoder, Frame, FrameError, FromBoard, FrontEndFault, MAX_FROM_BOARD_LEN, Plan, ResetCause,
    ToBoard,
};
use std::io::{ErrorKind, Read, Write};

fn config(faults: &[&str]) -> SimConfig {
    SimConfig {
        electronics: Electronics {
            noise_codes: 0.0,
            ..Electronics::default()
        },
        faults: faults.iter().map(|text| text.parse().unwrap()).collect(),
        ..SimConfig::default()
    }
}

fn bench(faults: &[&str]) -> Bench<FixedSheet> {
    Bench::new(config(faults), FixedSheet(disc(16)))
}

/// Most that rounding does to a value without noise: half a code with every sample's sign, and the value's own rounding.
const ROUNDING: f64 = 0.7;

/// A frame before a fault, and one with it: it comes while the board measures.
fn pair(fault: &str) -> (Frame, Frame) {
    let mut frames = bench(&[&format!("{fault}@0.1")]).measured(0.2);
    (frames.remove(1), frames.pop().unwrap())
}

/// Number of a pair of neighbours.
fn number(p: protocol::Pair) -> usize {
    let first = if p.plus.abs_diff(p.minus) == 1 {
        p.plus.min(p.minus)
    } else {
        15
    };
    first.into()
}

/// Values of two frames by the numbers of drive and sense pair, codes.
fn values(good: &Frame, faulty: &Frame) -> Vec<(usize, usize, f64, f64)> {
    let both = good.values.iter().zip(&faulty.values);
    Plan::fast()
        .measurements(16)
        .zip(both)
        .map(|((drive, sense), (a, b))| (number(drive), number(sense), a.codes(), b.codes()))
        .collect()
}

#[test]
fn an_open_electrode_carries_no_current_and_its_amplifiers_see_the_middle() {
    let (good, faulty) = pair("electrode_open:6");
    for (drive, sense, a, b) in values(&good, &faulty) {
        if drive == 4 || drive == 5 {
            assert!(b.abs() < ROUNDING, "{drive} {sense}: {b}");
        } else if sense != 4 && sense != 5 {
            // The rubber conducts as before.
            assert!((a - b).abs() < ROUNDING, "{drive} {sense}: {a} {b}");
        }
    }
    // The two pairs on it see nothing of each other: their sum is what the electrodes next to it are apart.
    let list = values(&good, &faulty);
    let of = |drive, sense| list.iter().find(|v| v.0 == drive && v.1 == sense).unwrap();
    let mut inside = 0;
    for drive in (0..16).filter(|drive| !(3..=6).contains(drive)) {
        let (below, above) = (of(drive, 4), of(drive, 5));
        // Near the drive they see so much of the source that they clip.
        if below.3.abs().max(above.3.abs()) < 2000.0 {
            inside += 1;
            assert!(
                (below.3 + above.3 - below.2 - above.2).abs() < 4.0 * ROUNDING,
                "{drive}"
            );
        }
        assert!((below.3 - below.2).abs() > 5.0, "{drive}: {} {}", below.3, below.2);
    }
    assert!(inside >= 6, "{inside}");
}

#[test]
fn a_short_and_a_worse_contact_are_what_the_circuit_says() {
    let (good, faulty) = pair("electrodes_short:6,7");
    let list = values(&good, &faulty);
    assert!(
        list.iter()
            .all(|(drive, sense, _, b)| (*drive != 5 && *sense != 5) || b.abs() < ROUNDING)
    );
    assert!(
        list.iter()
            .any(|(drive, sense, a, b)| *drive == 0 && *sense == 4 && (a - b).abs() > 1.0)
    );
    // A short is as reciprocal as the sheet (each drive takes its own current from the source, which divides out).
    let of = |drive, sense| list.iter().find(|v| v.0 == drive && v.1 == sense).unwrap().3;
    assert!((of(1, 9) / of(9, 1) * of(9, 3) / of(3, 9) * of(3, 1) / of(1, 3) - 1.0).abs() < 2e-2);

    let ohm = 500.0;
    let (good, faulty) = pair("contact_raised:6,500");
    let sheet = disc(16);
    let own = |n: usize| sheet.transfer_ohm(forward::Pair::new(n, n + 1), forward::Pair::new(n, n + 1)) + 140.0;
    for (drive, sense, a, b) in values(&good, &faulty) {
        let expected = if drive == 4 || drive == 5 {
            a * own(drive) / (own(drive) + ohm)
        } else {
            a
        };
        assert!((b - expected).abs() < 1.5 * ROUNDING, "{drive} {sense}: {b} {expected}");
    }
}

#[test]
fn a_stuck_converter_gives_nothing_but_its_code_and_a_saturated_amplifier_clips() {
    let (_, faulty) = pair("adc_stuck:1234");
    assert!(faulty.values.iter().all(|v| v.codes() == 0.0) && faulty.clipped.count() == 0);
    let (_, faulty) = pair("adc_stuck:4095");
    assert_eq!(faulty.clipped.count(), 208);
    let (good, faulty) = pair("saturation:6");
    for (k, (_, sense, a, b)) in values(&good, &faulty).into_iter().enumerate() {
        assert_eq!(faulty.clipped.get(k), sense == 6, "{k}");
        assert!(sense == 6 || (a - b).abs() < ROUNDING);
    }
}

#[test]
fn a_stuck_drive_multiplexer_drives_what_it_is_stuck_on() {
    let (good, faulty) = pair("multiplexer_stuck:drive_minus,1");
    let mut changed = 0;
    for (drive, sense, a, b) in values(&good, &faulty) {
        // One drive pair of the sixteen has its minus there; the pair that has its plus there drives nothing.
        changed += u32::from((a - b).abs() > 5.0);
        assert!(
            drive != 0 || (a - b).abs() < ROUNDING || b.abs() < ROUNDING,
            "{drive} {sense}"
        );
    }
    assert!(changed > 150, "{changed}");
    // Measured all at once, no sense multiplexer is in the way; one after the other it is.
    let (good, faulty) = pair("multiplexer_stuck:sense_plus,4");
    assert_eq!(good.values, faulty.values);
    let sequential = |faults: &[&str]| {
        let plan = Some(Plan::sequential());
        let mut bench = Bench::new(SimConfig { plan, ..config(faults) }, FixedSheet(disc(16)));
        bench.measured(0.3).remove(1)
    };
    let (good, faulty) = (sequential(&[]), sequential(&["multiplexer_stuck:sense_plus,4@0"]));
    let same = good.values.iter().zip(&faulty.values).filter(|(a, b)| a == b).count();
    assert!((10..40).contains(&same), "{same}");
}

#[test]
fn the_board_itself_finds_a_lost_source_and_counts_overruns() {
    // The source is measured at every start, and a converter that is stuck shows none.
    for fault in ["source_lost@0", "adc_stuck:2000@0"] {
        let mut bench = bench(&[fault]);
        bench.send(&ToBoard::Start);
        let said = bench.run(0.5);
        let fault = FromBoard::Error(BoardError::FrontEnd(FrontEndFault::Source));
        assert!(said.contains(&fault) && crate::common::frames(said).is_empty());
    }
    let mut bench = Bench::new(config(&["converter_overrun:0.01@0"]), FixedSheet(disc(16)));
    bench.send(&ToBoard::Start);
    let said = bench.run(2.0);
    bench.send(&ToBoard::GetCounters);
    let counters: Vec<Counters> = bench
        .run(0.05)
        .into_iter()
        .filter_map(|m| match m {
            FromBoard::Counters(c) => Some(c),
            _ => None,
        })
        .collect();
    // 115 frames a second of 16 windows, one in a hundred lost: about a sixth of the frames.
    let overruns = counters[0].overruns;
    assert!((15..80).contains(&overruns), "{overruns}");
    let frames = crate::common::frames(said);
    assert!((150..226).contains(&frames.len()), "{}", frames.len());
}

#[test]
fn a_fault_comes_and_goes_at_its_times() {
    let mut bench = bench(&["adc_stuck:2000@0.5+0.25"]);
    let frames = bench.measured(1.0);
    for frame in &frames {
        let end_s = seconds(frame.time) + 8.7e-3;
        let stuck = frame.values.iter().all(|v| v.codes() == 0.0);
        if end_s < 0.5 || seconds(frame.time) > 0.75 + 3e-4 {
            assert!(!stuck, "{end_s}");
        } else if seconds(frame.time) > 0.5 && end_s < 0.75 {
            assert!(stuck, "{end_s}");
        }
    }
    assert!(frames.len() > 100);
}

/// Bytes from the board in a time, and what a decoder makes of them: messages and damaged ones.
fn decoded(faults: &[&str], seed: u64, duration_s: f64) -> (Vec<u8>, Vec<FromBoard>, Vec<FrameError>) {
    let mut config = config(faults);
    config.electronics.seed = seed;
    let mut board = SimBoard::new(config, FixedSheet(disc(16))).unwrap();
    board.receive(&framed(&ToBoard::Start));
    let bytes = board.run(duration_s);
    let (mut messages, mut errors) = (Vec::new(), Vec::new());
    Decoder::<MAX_FROM_BOARD_LEN>::new().push(&bytes, |m| match m {
        Ok(m) => messages.push(m),
        Err(e) => errors.push(e),
    });
    (bytes, messages, errors)
}

#[test]
fn bytes_are_lost_flipped_and_doubled_at_their_rate_and_by_the_seed() {
    let (good, ..) = decoded(&[], 1, 2.0);
    for (fault, change) in [
        (FaultKind::BytesLost { rate: 0.002 }, -1.0),
        (FaultKind::BytesDoubled { rate: 0.002 }, 1.0),
        (FaultKind::BytesFlipped { rate: 0.002 }, 0.0),
    ] {
        let name = match fault {
            FaultKind::BytesLost { .. } => "bytes_lost:0.002@0.1",
            FaultKind::BytesDoubled { .. } => "bytes_doubled:0.002@0.1",
            _ => "bytes_flipped:0.002@0.1",
        };
        let (bytes, messages, errors) = decoded(&[name], 1, 2.0);
        // 97,000 bytes, 195 of them hit: 14 is one standard deviation.
        let expected = 0.002 * good.len() as f64 * 0.95;
        let more = bytes.len() as f64 - good.len() as f64;
        assert!(
            (more - change * expected).abs() < 5.0 * expected.sqrt(),
            "{fault:?}: {more}"
        );
        if change == 0.0 {
            let hit: Vec<u32> = good
                .iter()
                .zip(&bytes)
                .map(|(a, b)| (a ^ b).count_ones())
                .filter(|n| *n > 0)
                .collect();
            assert!(hit.iter().all(|n| *n == 1));
            assert!(
                (hit.len() as f64 - expected).abs() < 5.0 * expected.sqrt(),
                "{}",
                hit.len()
            );
        }
        // Every hit costs a message, or two where it hits the delimiter; none is wrong.
        assert!(!errors.is_empty());
        let frames = crate::common::frames(messages);
        assert!((60..200).contains(&frames.len()), "{}", frames.len());
        assert_eq!(decoded(&[name], 1, 2.0).0, bytes);
        assert_ne!(decoded(&[name], 2, 2.0).0, bytes);
    }
}

#[test]
fn a_break_is_one_zero_and_costs_what_was_under_way() {
    let (good, all, _) = decoded(&[], 1, 1.0);
    let (bytes, messages, errors) = decoded(&["line_break@0.5+0.1"], 1, 1.0);
    // A tenth of a second of 52 kB/s, but for one byte.
    let lost = good.len() - bytes.len();
    assert!((4_700..5_700).contains(&lost), "{lost}");
    assert!(errors.len() <= 2, "{errors:?}");
    let (a, b) = (crate::common::frames(all).len(), crate::common::frames(messages).len());
    assert!((11..=14).contains(&(a - b)), "{a} {b}");
}

/// What a board counted by 0.7 s that got half a command, and then a whole one, with something between them or not.
fn after_half_a_command(faults: &[&str]) -> Option<Counters> {
    let mut board = SimBoard::new(config(faults), FixedSheet(disc(16))).unwrap();
    let command = framed(&ToBoard::GetCounters);
    board.run(0.4);
    board.receive(&command[..command.len() / 2]);
    board.run(0.105);
    board.receive(&framed(&ToBoard::Start));
    board.run(0.095);
    board.receive(&command);
    let bytes = board.run(0.1);
    let mut counters = None;
    Decoder::<MAX_FROM_BOARD_LEN>::new().push(&bytes, |m| match m {
        Ok(FromBoard::Counters(c)) => counters = Some(c),
        other => assert!(!matches!(other, Ok(FromBoard::Frame(_))), "it was not started"),
    });
    counters
}

/// A break ends half a command, as a delimiter does, and is counted; what is sent while it lasts is lost. (The Start in the
/// midst of it ends the half command too, where there is no break, and is lost with it.)
#[test]
fn a_break_to_the_board_ends_half_a_command_and_is_counted() {
    let with = after_half_a_command(&["break_to_board@0.5+0.01"]).unwrap();
    assert_eq!((with.receive_errors, with.refused, with.commands), (1, 1, 1));
    let without = after_half_a_command(&[]).unwrap();
    assert_eq!((without.receive_errors, without.refused, without.commands), (0, 1, 1));
    let idle = {
        let mut board = SimBoard::new(config(&["break_to_board@0.5+0.01"]), FixedSheet(disc(16))).unwrap();
        board.run(0.7);
        board.counters().clone()
    };
    // Between commands it does nothing but be counted.
    assert_eq!((idle.receive_errors, idle.refused), (1, 0));
}

#[test]
fn a_reset_in_mid_frame_cuts_the_frame_and_begins_with_an_introduction() {
    for length in ["", "+0.2"] {
        let (bytes, messages, errors) = decoded(&[&format!("board_reset@0.5{length}")], 1, 1.0);
        let hellos: Vec<ResetCause> = messages
            .iter()
            .filter_map(|m| match m {
                FromBoard::Hello(h) => Some(h.reset),
                _ => None,
            })
            .collect();
        // The introduction after the reset is glued to the half frame before it, as on a real line; it is what was hit.
        assert_eq!(hellos[0], ResetCause::Unknown);
        assert!(
            errors.len() == 1 || hellos.get(1) == Some(&ResetCause::Pin),
            "{errors:?} {hellos:?}"
        );
        assert!(bytes.len() < 30_000, "it does not start by itself");
    }
    // Time goes on for the sheet and the faults, and begins anew for the board.
    let mut board = SimBoard::new(config(&["board_reset@0.3+0.1"]), FixedSheet(disc(16))).unwrap();
    board.receive(&framed(&ToBoard::Start));
    board.run(0.6);
    assert!((board.now_s() - 0.6).abs() < 1e-3);
    board.receive(&framed(&ToBoard::Start));
    let bytes = board.run(0.3);
    let mut frames = Vec::new();
    Decoder::<MAX_FROM_BOARD_LEN>::new().push(&bytes, |m| frames.extend(m));
    let frames = crate::common::frames(frames);
    assert!(
        frames[0].sequence == 0 && seconds(frames[0].time) < 0.25,
        "{:?}",
        frames[0].time
    );
}

#[test]
fn a_port_whose_cable_is_pulled_is_dead_until_it_is_opened_anew() {
    for pace in [Pace::Unpaced, Pace::RealTime] {
        let faults = [Fault::lasting(0.3, 0.4, FaultKind::CablePulled)];
        let config = SimConfig {
            faults: faults.to_vec(),
            ..SimConfig::default()
        };
        let board = SimBoard::new(config, FixedSheet(disc(16))).unwrap();
        let mut port = SimPort::new(board, pace).unwrap();
        port.write_all(&framed(&ToBoard::Start)).unwrap();
        let mut buffer = [0; 4096];
        let mut received = 0;
        let error = loop {
            match port.read(&mut buffer) {
                Ok(n) => received += n,
                Err(e) if e.kind() == ErrorKind::TimedOut => {}
                Err(e) => break e,
            }
        };
        assert_eq!(error.kind(), ErrorKind::BrokenPipe);
        assert!(received > 5_000, "{received}");
        assert_eq!(port.write(&[0]).unwrap_err().kind(), ErrorKind::BrokenPipe);
        let mut again = loop {
            match port.reopen() {
                Ok(port) => break port,
                Err(e) => assert_eq!(e.kind(), ErrorKind::NotFound),
            }
        };
        // The board went on; the old handle stays dead.
        let n = loop {
            match again.read(&mut buffer) {
                Ok(n) => break n,
                Err(e) => assert_eq!(e.kind(), ErrorKind::TimedOut),
            }
        };
        assert!(n > 0);
        assert_eq!(port.read(&mut buffer).unwrap_err().kind(), ErrorKind::BrokenPipe);
    }
}
