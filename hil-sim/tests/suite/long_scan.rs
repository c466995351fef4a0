//! A scan that goes on and on: nothing piles up, and every frame is accounted for.

use crate::common::{Bench, disc, framed};
use hil_sim::{Electronics, Fault, FixedSheet, Preset, SimConfig};
use protocol::{FromBoard, Notice, Plan, ToBoard};

/// Memory of this process, KiB, as the system has it; 0 where it does not tell.
fn resident_kib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"));
    let number = line.and_then(|l| l.trim().trim_end_matches(" kB").parse().ok());
    number.unwrap_or(0)
}

/// Scans for so long, s of the board's time, while samples are overrun and commands come, whole and damaged. Returns the memory of
/// the process after a tenth of the time and at the end, KiB.
fn scan(seconds: u32, electronics: Electronics) -> (u64, u64) {
    // One channel takes the same 208 values one after the other.
    let plan = match electronics.one_channel {
        true => Plan::sequential_fast(),
        false => Plan::fast(),
    };
    let periods = f64::from(plan.quarters()) / 4.0;
    let faults: Vec<Fault> = ["converter_overrun:0.0001@0.5"].map(|f| f.parse().unwrap()).into();
    let config = SimConfig {
        electronics,
        faults,
        ..SimConfig::default()
    };
    let mut bench = Bench::new(config, FixedSheet(disc(16)));
    bench.send(&ToBoard::SetPlan(plan));
    bench.send(&ToBoard::Start);
    let (mut frames, mut gaps, mut answers, mut unread) = (0u64, 0u64, 0u32, 0u32);
    let (mut last, mut early) = (None::<(u32, u64)>, 0);
    for second in 0..seconds {
        if second == seconds / 10 {
            early = resident_kib();
        }
        if second % 3600 == 0 && second > 0 {
            let (hours, counters) = (second / 3600, bench.board.counters());
            let overruns = counters.overruns;
            println!(
                "{hours} h: {frames} frames, {gaps} given up, {overruns} counted; {} KiB",
                resident_kib()
            );
            assert!(u64::from(counters.frames).abs_diff(frames) <= 2 && gaps <= u64::from(overruns));
        }
        // Once a second a question, a damaged one and some noise.
        let question = framed(&ToBoard::GetStatus);
        bench.board.receive(&question);
        let mut damaged = question.clone();
        damaged[1] ^= 0x40;
        bench.board.receive(&damaged);
        bench.board.receive(&[1, 0].repeat(20));
        for message in bench.run(1.0) {
            match message {
                FromBoard::Frame(frame) => {
                    if let Some((sequence, time)) = last {
                        assert!(
                            frame.sequence > sequence && frame.time > time,
                            "{sequence} {}",
                            frame.sequence
                        );
                        gaps += u64::from(frame.sequence - sequence - 1);
                    } else {
                        gaps += u64::from(frame.sequence);
                    }
                    assert_eq!((frame.values.len(), frame.clipped.count()), (208, 0));
                    last = Some((frame.sequence, frame.time));
                    frames += 1;
                }
                FromBoard::Status(status) => {
                    assert!(status.running);
                    answers += 1;
                }
                FromBoard::Error(_) => unread += 1,
                FromBoard::Notice(Notice::PassedOver { count }) => unread += count,
                FromBoard::Notice(other) => panic!("{other:?}"),
                _ => {}
            }
        }
    }
    bench.send(&ToBoard::Stop);
    for message in bench.run(2.0) {
        match message {
            FromBoard::Frame(frame) => {
                gaps += u64::from(frame.sequence - last.map_or(0, |(s, _)| s + 1));
                last = Some((frame.sequence, frame.time));
                frames += 1;
            }
            FromBoard::Notice(Notice::PassedOver { count }) => unread += count,
            FromBoard::Error(_) => unread += 1,
            _ => {}
        }
    }
    let counters = bench.board.counters();
    let resident = resident_kib();
    println!(
        "{seconds} s of scan: {frames} frames, {gaps} given up, {} counted, {} of {} questions answered, {unread} messages not read; {early} KiB of memory after a tenth, {resident} KiB at the end",
        counters.overruns, answers, seconds
    );
    assert_eq!(u64::from(counters.frames), frames);
    // An overrun costs the frame under way, or the measurement of the source between two frames.
    let overruns = u64::from(counters.overruns);
    assert!(
        gaps <= overruns && overruns - gaps <= 1 + overruns / 10,
        "{gaps} {overruns}"
    );
    assert_eq!(
        (counters.dropped, counters.clipped, counters.front_end_faults),
        (0, 0, 0)
    );
    assert_eq!((answers, counters.refused), (seconds, unread));
    assert_eq!(unread, 21 * seconds);
    // So many periods a frame, and four a second. An overrun costs a part of a frame.
    let expected = 84e6 / 16.0 / 1425.0 * f64::from(seconds) / periods;
    assert!((frames + gaps) as f64 > 0.99 * expected, "{frames} {gaps} {expected}");
    (early, resident)
}

#[test]
fn every_frame_of_a_long_scan_is_accounted_for() {
    for board in [Preset::SixteenChannels, Preset::Ideal] {
        scan(20, one_channel(board));
    }
}

/// The ideal board has one channel here: what takes time in a long scan are the samples.
fn one_channel(board: Preset) -> Electronics {
    Electronics {
        one_channel: board != Preset::SixteenChannels && board != Preset::DrawnSixteen,
        ..board.electronics()
    }
}

/// As long as SKIN_SCAN_SECONDS says, on the board that SKIN_SCAN_BOARD names, alone in its process: its memory does not grow.
#[test]
#[ignore = "as long as SKIN_SCAN_SECONDS says"]
fn a_scan_as_long_as_one_likes_takes_no_more_memory() {
    let seconds = std::env::var("SKIN_SCAN_SECONDS").map_or(600, |s| s.parse().unwrap());
    let board = std::env::var("SKIN_SCAN_BOARD").map_or(Preset::default(), |b| b.parse().unwrap());
    let (early, end) = scan(seconds, one_channel(board));
    assert!(end <= early + 256, "{early} {end} KiB");
}
