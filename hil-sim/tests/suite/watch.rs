//! The watch in the whole board: asleep while nothing touches, awake with the next drive when something does.

use crate::common::{framed, messages};
use forward::field::conductivity_of_discs;
use forward::{DiscTouch, ElectrodeMatrix, ForwardError, Model, ModelOptions, Sheet, Solver};
use hil_sim::{Electronics, PERIOD_SAMPLES, SheetModel, SimBoard, SimConfig, TICKS_PER_SAMPLE, TIMER_HZ, seconds};
use protocol::{
    BoardError, Decoder, FromBoard, MAX_FROM_BOARD_LEN, Plan, PlanError, Refusal, Slot, ToBoard, Watch, WatchNumber,
    Watching,
};
use std::sync::{Arc, OnceLock};

/// A sheet on which the least visible touch is pressed in some stretches of time, at once.
struct Pressed {
    rest: ElectrodeMatrix,
    touched: ElectrodeMatrix,
    /// From when to when, s.
    stretches: Vec<(f64, f64)>,
}

impl SheetModel for Pressed {
    fn electrode_matrix(&mut self, t_s: f64) -> Result<&ElectrodeMatrix, ForwardError> {
        let touched = self.stretches.iter().any(|(from, to)| (*from..*to).contains(&t_s));
        Ok(if touched { &self.touched } else { &self.rest })
    }
}

/// The sheet untouched, and under a tip of 25 mm in its middle with this force.
fn pressed(force_n: f64, stretches: Vec<(f64, f64)>) -> Pressed {
    static MODEL: OnceLock<Arc<Model>> = OnceLock::new();
    let model = MODEL.get_or_init(|| Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap()));
    let touch = DiscTouch {
        centre_mm: [3.0, 2.0],
        radius_mm: 12.5,
        rise: 0.2 * force_n / 25.0,
    };
    let mut solver = Solver::new(Arc::clone(model)).unwrap();
    let rest = solver.electrode_matrix().clone();
    solver.solve(&conductivity_of_discs(model.mesh(), &[touch])).unwrap();
    Pressed {
        rest,
        touched: solver.electrode_matrix().clone(),
        stretches,
    }
}

struct Bench {
    board: SimBoard<Pressed>,
    decoder: Decoder<MAX_FROM_BOARD_LEN>,
    bytes: u64,
}

impl Bench {
    /// The drawn board with sixteen channels, which watches, after it was told to start.
    fn new(sheet: Pressed, seed: u64) -> Self {
        let electronics = Electronics::drawn_sixteen();
        Self::watching(electronics, Watch::paper(), Plan::fastest(), sheet, seed)
    }

    /// The same of the one with a single channel.
    fn sequential(sheet: Pressed, seed: u64) -> Self {
        let electronics = Electronics::drawn_board();
        Self::watching(electronics, Watch::sequential(), Plan::sequential_fast(), sheet, seed)
    }

    fn watching(electronics: Electronics, watch: Watch, plan: Plan, sheet: Pressed, seed: u64) -> Self {
        let config = SimConfig {
            electronics: Electronics { seed, ..electronics },
            plan: Some(plan),
            look_samples: Some(4),
            ..SimConfig::default()
        };
        let mut board = SimBoard::new(config, sheet).unwrap();
        board.receive(&framed(&ToBoard::SetWatch(Some(watch))));
        board.receive(&framed(&ToBoard::Start));
        Self {
            board,
            decoder: Decoder::new(),
            bytes: 0,
        }
    }

    /// What it says up to a time, each with the time when it was there, s.
    fn until(&mut self, end_s: f64) -> Vec<(f64, FromBoard)> {
        let mut out = Vec::new();
        while self.board.now_s() < end_s {
            let mut bytes = Vec::new();
            self.board.step(|b| bytes.push(b));
            self.bytes += bytes.len() as u64;
            let now = self.board.now_s();
            self.decoder.push(&bytes, |m| out.push((now, m.unwrap())));
        }
        out
    }
}

fn states(said: &[(f64, FromBoard)]) -> Vec<Watching> {
    let mut list: Vec<Watching> = said
        .iter()
        .filter_map(|(_, m)| match m {
            FromBoard::Heartbeat(h) => Some(h.state),
            _ => None,
        })
        .collect();
    list.dedup();
    list
}

fn frames(said: &[(f64, FromBoard)]) -> Vec<(f64, u64)> {
    said.iter()
        .filter_map(|(t, m)| match m {
            FromBoard::Frame(f) => Some((*t, f.time)),
            _ => None,
        })
        .collect()
}

#[test]
fn it_learns_sleeps_wakes_and_falls_asleep_again() {
    let mut bench = Bench::new(pressed(25.0, vec![(1.0, 1.5)]), 1);
    let said = bench.until(3.0);
    use Watching::{Asleep, Awake, Learning};
    assert_eq!(states(&said), [Learning, Asleep, Awake, Asleep]);
    let list = frames(&said);
    assert!(list.iter().all(|(t, _)| (1.0..1.9).contains(t)), "{list:?}");
    // 184 frames/s less the scans of the watch between them.
    let during = list.iter().filter(|(t, _)| *t < 1.5).count();
    assert!((80..=92).contains(&during), "{during}");
    assert_eq!(bench.board.counters().wakes, 1);
}

#[test]
fn a_touch_brings_the_first_whole_frame_within_fifteen_milliseconds() {
    let mut latencies: Vec<(f64, f64)> = Vec::new();
    for seed in 0..60 {
        // At all phases of the watch: 12.5 periods are 3.4 ms.
        let contact = 0.5 + 0.000_057 * seed as f64;
        let mut bench = Bench::new(pressed(25.0, vec![(contact, 9.0)]), seed);
        let said = bench.until(contact + 0.04);
        let list = frames(&said);
        let (there, begun) = list[0];
        // Measured with the touch on the sheet, from its first sample to its last.
        assert!(seconds(begun) > contact, "{contact} {list:?}");
        let measured = seconds(begun) + seconds(20 * PERIOD_SAMPLES);
        latencies.push((measured - contact, there - contact));
    }
    let worst = |which: fn(&(f64, f64)) -> f64| latencies.iter().map(which).fold(0.0, f64::max);
    let mean = |which: fn(&(f64, f64)) -> f64| latencies.iter().map(which).sum::<f64>() / latencies.len() as f64;
    println!(
        "contact to the first frame measured: mean {:.1} ms, worst {:.1} ms; received: mean {:.1} ms, worst {:.1} ms",
        1e3 * mean(|l| l.0),
        1e3 * worst(|l| l.0),
        1e3 * mean(|l| l.1),
        1e3 * worst(|l| l.1),
    );
    // At worst the touch comes in the middle of the second drive: rest, first drive, frame. 10 + 2 * 1.25 + 1.25 + 20.
    let period = seconds(PERIOD_SAMPLES);
    assert!(worst(|l| l.0) < 33.75 * period + 1e-4, "{latencies:?}");
    // And 460 bytes of 10 us behind a heartbeat of 20.
    assert!(worst(|l| l.1) < 33.75 * period + 0.0052, "{latencies:?}");
}

#[test]
fn a_single_channel_wakes_with_the_next_value() {
    let period = seconds(PERIOD_SAMPLES);
    let (mut first, mut whole) = (Vec::new(), Vec::new());
    for seed in 0..40 {
        // At all phases of the watch: 30 periods are 8.1 ms. It has learned by 0.4 s.
        let contact = 0.6 + 0.000_205 * seed as f64;
        let mut bench = Bench::sequential(pressed(25.0, vec![(contact, 9.0)]), seed);
        let said = bench.until(contact + 0.12);
        assert_eq!(bench.board.counters().wakes, 1);
        let (there, begun) = frames(&said)[0];
        // Measured with the touch on the sheet from its first sample on.
        assert!(seconds(begun) > contact, "{contact} {begun}");
        first.push(seconds(begun) - contact);
        whole.push(there - contact);
    }
    let worst = |list: &[f64]| list.iter().copied().fold(0.0, f64::max);
    let mean = |list: &[f64]| list.iter().sum::<f64>() / list.len() as f64;
    println!(
        "contact to the first frame's first sample: mean {:.1} ms, worst {:.1} ms; to that frame received: mean {:.1} ms, worst {:.1} ms",
        1e3 * mean(&first),
        1e3 * worst(&first),
        1e3 * mean(&whole),
        1e3 * worst(&whole),
    );
    // At worst the touch comes in the middle of the value that would have shown it: that one, the rest, and all eight; and the
    // frame's own settling.
    assert!(worst(&first) < (1.25 + 20.0 + 10.0 + 0.25) * period + 1e-4, "{first:?}");
    // A frame of 260 periods, and 460 bytes of 10 us behind a heartbeat of 20.
    assert!(worst(&whole) < worst(&first) + 260.0 * period + 0.0052, "{whole:?}");
}

#[test]
fn a_single_channel_at_rest_sends_heartbeats_and_saves_conversions() {
    // For a minute: 7,400 scans.
    let mut bench = Bench::sequential(pressed(25.0, vec![]), 3);
    bench.until(1.0);
    let (bytes, conversions) = (bench.bytes, bench.board.conversions());
    let said = bench.until(61.0);
    let asleep = |m: &FromBoard| matches!(m, FromBoard::Heartbeat(h) if h.state == Watching::Asleep);
    assert!(said.iter().all(|(_, m)| asleep(m)), "{said:?}");
    assert_eq!(bench.board.counters().wakes, 0);
    let idle = (bench.bytes - bytes) as f64 / 60.0;
    let converted = (bench.board.conversions() - conversions) as f64 / 60.0;

    let mut busy = Bench::sequential(pressed(25.0, vec![(0.9, 99.0)]), 3);
    busy.until(2.0);
    let (bytes, conversions) = (busy.bytes, busy.board.conversions());
    let frames = busy.until(12.0).len();
    let awake = (busy.bytes - bytes) as f64 / 10.0;
    let awake_converted = (busy.board.conversions() - conversions) as f64 / 10.0;
    println!("one channel: bytes a second: {idle:.0} asleep, {awake:.0} awake");
    println!("conversions a second: {converted:.0} asleep, {awake_converted:.0} awake");
    println!(
        "frames in ten seconds: {frames}; scans of the watch in a minute without a wake: {}",
        bench.board.counters().watch_scans
    );
    assert!((0.9..1.2).contains(&(said.len() as f64 / 60.0)));
    assert!(idle < 30.0 && awake > 5_000.0);
    // Eight windows of one period in 30 periods, against one in 1.25.
    let theory = f64::from(TIMER_HZ) / f64::from(TICKS_PER_SAMPLE) * 8.0 / 30.0;
    assert!((converted / theory - 1.0).abs() < 0.02, "{converted} {theory}");
}

#[test]
fn a_single_channel_feels_a_light_touch_and_a_release() {
    for force_n in [5.0, 2.5] {
        let touches: Vec<(f64, f64)> = (0..4)
            .map(|k| (1.0 + 1.5 * f64::from(k), 1.7 + 1.5 * f64::from(k)))
            .collect();
        let mut bench = Bench::sequential(pressed(force_n, touches), 5);
        let said = bench.until(7.5);
        use Watching::{Asleep, Awake, Learning};
        let wakes = [Awake, Asleep].repeat(4);
        assert_eq!(states(&said), [vec![Learning, Asleep], wakes].concat(), "{force_n} N");
        assert_eq!(bench.board.counters().wakes, 4);
    }
}

#[test]
fn no_host_is_needed_and_idle_traffic_is_a_heartbeat() {
    // A board that nobody talks to after the start, for a minute: 17,700 scans.
    let mut bench = Bench::new(pressed(25.0, vec![]), 3);
    bench.until(1.0);
    let (bytes, conversions) = (bench.bytes, bench.board.conversions());
    let said = bench.until(61.0);
    assert!(
        said.iter()
            .all(|(_, m)| matches!(m, FromBoard::Heartbeat(h) if h.state == Watching::Asleep)),
        "{said:?}"
    );
    let idle = (bench.bytes - bytes) as f64 / 60.0;
    let converted = (bench.board.conversions() - conversions) as f64 / 60.0;
    assert_eq!(bench.board.counters().wakes, 0);

    let mut busy = Bench::new(pressed(25.0, vec![(0.9, 99.0)]), 3);
    busy.until(2.0);
    let (bytes, conversions) = (busy.bytes, busy.board.conversions());
    busy.until(12.0);
    let awake = (busy.bytes - bytes) as f64 / 10.0;
    let awake_converted = (busy.board.conversions() - conversions) as f64 / 10.0;
    println!("bytes a second: {idle:.0} asleep, {awake:.0} awake");
    println!("conversions a second: {converted:.0} asleep, {awake_converted:.0} awake");
    println!(
        "scans of the watch in a minute without a wake: {}",
        bench.board.counters().watch_scans
    );
    assert!((0.9..1.2).contains(&(said.len() as f64 / 60.0)));
    assert!(idle < 30.0 && awake > 80_000.0);
    // Two windows of one period of 16 channels in 12.5 periods, against one in 1.25.
    let theory = 16.0 * f64::from(TIMER_HZ) / f64::from(TICKS_PER_SAMPLE) * 2.0 / 12.5;
    assert!((converted / theory - 1.0).abs() < 0.02, "{converted} {theory}");
}

#[test]
fn a_light_touch_wakes_it_too_and_a_release_does_not_keep_it_awake() {
    for force_n in [5.0, 2.5] {
        let touches: Vec<(f64, f64)> = (0..8)
            .map(|k| (0.5 + 0.5 * f64::from(k), 0.7 + 0.5 * f64::from(k)))
            .collect();
        let mut bench = Bench::new(pressed(force_n, touches), 5);
        bench.until(5.0);
        let counters = bench.board.counters();
        assert_eq!(counters.wakes, 8, "{force_n} N: {counters:?}");
    }
}

#[test]
fn a_baseline_taken_under_a_touch_is_taken_anew_on_command() {
    let mut bench = Bench::new(pressed(25.0, vec![(0.0, 0.5)]), 7);
    let said = bench.until(1.0);
    // What it took for untouched is gone: that is a change.
    assert_eq!(bench.board.counters().wakes, 1, "{said:?}");
    bench.board.receive(&framed(&ToBoard::TakeBaseline));
    bench.board.receive(&framed(&ToBoard::GetBaseline));
    let said = bench.until(1.5);
    assert_eq!(states(&said), [Watching::Learning, Watching::Asleep]);
    bench.board.receive(&framed(&ToBoard::GetBaseline));
    let said = bench.until(1.6);
    let baseline = said.iter().find_map(|(_, m)| match m {
        FromBoard::Baseline(b) => Some(b),
        _ => None,
    });
    let baseline = baseline.unwrap();
    assert_eq!((baseline.scans, baseline.values.len()), (64, 12));
    // White noise and rounding to 16 bits of 16 samples, in sixteenths of squared sixteenths of a code.
    let noise = (0.4f64.powi(2) + 1.0 / 256.0 / 12.0) * 2.0 / 16.0 * 256.0 * 16.0 + 16.0 / 12.0;
    for v in &baseline.variance {
        assert!((0.6..1.8).contains(&(f64::from(*v) / noise)), "{v} {noise}");
    }
}

#[test]
fn a_watch_that_cannot_be_done_is_refused_with_its_reason() {
    let mut board = SimBoard::new(SimConfig::default(), pressed(25.0, vec![])).unwrap();
    board.run(0.02);
    let mut refused = |change: fn(&mut Watch)| {
        let mut watch = Watch::paper();
        change(&mut watch);
        board.receive(&framed(&ToBoard::SetWatch(Some(watch))));
        let said = messages(&board.run(0.05));
        let [FromBoard::Error(e)] = &said[..] else {
            panic!("{said:?}")
        };
        e.clone()
    };
    assert_eq!(refused(|w| w.slots.clear()), BoardError::Watch(PlanError::Empty));
    assert_eq!(
        refused(|w| w.slots[1].drive.minus = 77),
        BoardError::Watch(PlanError::Electrode {
            slot: 1,
            electrode: 77,
            count: 16
        })
    );
    let all = |w: &mut Watch| {
        let slot = Slot {
            sense: 0xFFFF,
            ..w.slots[0]
        };
        w.slots = (0..4).map(|_| slot).collect();
    };
    assert_eq!(
        refused(all),
        BoardError::Watch(PlanError::Values { given: 64, most: 48 })
    );
    let least = |what, least| BoardError::Refused(Refusal::Watch { what, least });
    assert_eq!(refused(|w| w.learn_scans = 1), least(WatchNumber::LearnScans, 2));
    assert_eq!(refused(|w| w.threshold = 0), least(WatchNumber::Threshold, 1));
    assert_eq!(refused(|w| w.quiet_scans = 0), least(WatchNumber::QuietScans, 1));
    board.receive(&framed(&ToBoard::TakeBaseline));
    let said = messages(&board.run(0.05));
    assert_eq!(said, [FromBoard::Error(BoardError::Refused(Refusal::NoWatch))]);
}
