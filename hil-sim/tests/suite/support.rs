//! Clock, watchdog, self-test and diagnosis of the simulated board.

use crate::common::{Bench, disc};
use firmware::laws;
use forward::ElectrodeMatrix;
use hil_sim::{Chip, Clock, Electronics, FixedSheet, Flash, SimConfig, SimFrontEnd, seconds};
use nalgebra::DMatrix;
use protocol::{
    BoardError, Check, Command, FoldedPeriod, FromBoard, FrontEndFault, Notice, Pair, PeriodRequest, PlanError,
    ResetCause, SelfTest, ToBoard,
};

#[test]
fn the_clock_keeps_the_laws() {
    let clock = Clock::new();
    let sheet = FixedSheet(disc(16));
    let front = SimFrontEnd::new(Electronics::default(), sheet, clock.clone()).unwrap();
    let mut both = (front.self_clocked(), Chip::new(clock, Flash::new(0)));
    assert_eq!(laws::clock(&mut both, |b| &mut b.0, |b| &mut b.1), Ok(()));
}

#[test]
fn a_clock_of_another_rate_is_found_out() {
    struct Slow(Clock);
    impl firmware::Clock for Slow {
        fn now(&mut self) -> u64 {
            self.0.now() / 2
        }
    }
    let clock = Clock::new();
    let front = SimFrontEnd::new(Electronics::default(), FixedSheet(disc(16)), clock.clone()).unwrap();
    let mut both = (front.self_clocked(), Slow(clock));
    let found = laws::clock(&mut both, |b| &mut b.0, |b| &mut b.1);
    assert!(matches!(found, Err(laws::SupportViolation::Rate { .. })), "{found:?}");
}

#[test]
fn the_watchdog_keeps_the_laws() {
    let clock = Clock::new();
    let mut chip = Chip::new(clock.clone(), Flash::new(0));
    let half = chip.time_out() / 2;
    let wait = |_: &mut Chip| clock.advance(half);
    assert_eq!(laws::watchdog(&mut chip, wait, |c| c.bitten()), Ok(()));
}

#[test]
fn a_board_that_hangs_is_bitten_and_one_that_runs_is_not() {
    let mut bench = Bench::new(SimConfig::default(), FixedSheet(disc(16)));
    bench.measured(6.0);
    assert!(!bench.board.bitten());
    bench.board.hang(2.5);
    assert!(bench.board.bitten());
    // It starts anew and says why.
    let config = SimConfig {
        reset: ResetCause::Watchdog,
        ..SimConfig::default()
    };
    let said = Bench::new(config, FixedSheet(disc(16))).run(0.02);
    let careful = Notice::Careful {
        resets: 1,
        settings: true,
    };
    let [FromBoard::Hello(hello), FromBoard::Notice(notice)] = &said[..] else {
        panic!("{said:?}")
    };
    assert_eq!((hello.reset, *notice), (ResetCause::Watchdog, careful));
}

fn tested(config: SimConfig, matrix: ElectrodeMatrix) -> SelfTest {
    let mut bench = Bench::new(config, FixedSheet(matrix));
    bench.run(0.02);
    bench.send(&ToBoard::SelfTest);
    let said = bench.run(0.2);
    let [FromBoard::SelfTest(report)] = &said[..] else {
        panic!("{said:?}")
    };
    assert!(bench.board.is_idle());
    report.clone()
}

#[test]
fn a_healthy_board_passes_its_self_test() {
    let report = tested(SimConfig::default(), disc(16));
    assert_eq!((report.failed, report.suspect), (0, 0), "{report:?}");
    assert!(report.source_permille.abs_diff(1000) < 5, "{report:?}");
    assert_eq!(report.drive_pairs.len(), 16);
    // Noise and rounding of the simulated converter; the largest of sixteen with seven degrees of freedom each.
    let noise = Electronics::default().noise_codes.powi(2) + 1.0 / 12.0;
    assert!((0.8..3.5).contains(&(report.noise.codes2() / noise)), "{report:?}");
    assert!(report.offset.codes().abs() < 1.0);
}

#[test]
fn the_self_test_names_what_is_wrong() {
    // Electrode 5 has lost its contact: a hundred kilohm more.
    let broken = ElectrodeMatrix::from_potentials(DMatrix::from_fn(16, 16, |i, j| {
        if i != j {
            let half = std::f64::consts::PI * (i as f64 - j as f64) / 16.0;
            return -1000.0 / std::f64::consts::PI * (195.0 * half.sin().abs()).ln();
        }
        let contact = if i == 5 { 100_000.0 } else { 100.0 };
        -1000.0 / std::f64::consts::PI * 2.5f64.ln() + contact
    }));
    let report = tested(SimConfig::default(), broken);
    assert_eq!(report.suspect, 0b11_0000, "{report:?}");
    assert_eq!(report.failed, Check::Electrodes.bit());

    let noisy = Electronics {
        noise_codes: 8.0,
        ..Electronics::default()
    };
    let config = |electronics| SimConfig {
        electronics,
        ..SimConfig::default()
    };
    assert_eq!(tested(config(noisy), disc(16)).failed, Check::Noise.bit());
    // The source gives a fifth less than it should: the gain that it is measured with tells.
    let weak = Electronics {
        source_gain_milli: 0,
        ..Electronics::default()
    };
    assert!(!tested(config(weak), disc(16)).passed(Check::Source));
}

#[test]
fn a_folded_period_is_what_the_lock_in_sees() {
    let mut bench = Bench::new(SimConfig::default(), FixedSheet(disc(16)));
    bench.measured(0.1);
    let request = PeriodRequest {
        drive: Pair { plus: 0, minus: 1 },
        sense: Pair { plus: 3, minus: 2 },
        gain: 0,
        settle_quarters: 5,
        periods: 100,
    };
    bench.send(&ToBoard::GetPeriod(request));
    let said = bench.run(0.2);
    let period = said.iter().find_map(|m| match m {
        FromBoard::Period(p) => Some(p),
        _ => None,
    });
    let FoldedPeriod {
        bins, clipped, time, ..
    } = period.unwrap();
    assert!(!clipped && time.is_multiple_of(4));
    // Its fundamental is the value that frames carry, and frames go on after it.
    let sine: f64 = (0..16)
        .map(|k| f64::from(bins[k]) * (std::f64::consts::TAU * k as f64 / 16.0).sin())
        .sum();
    let list: Vec<f64> = crate::common::frames(said.clone())
        .iter()
        .map(|f| f.values[0].codes())
        .collect();
    let mean = list.iter().sum::<f64>() / list.len() as f64;
    assert!(list.len() > 10 && (sine / 800.0 - mean).abs() < 0.2, "{sine} {mean}");
    let far = PeriodRequest {
        sense: Pair { plus: 16, minus: 2 },
        ..request
    };
    bench.send(&ToBoard::GetPeriod(far));
    let refusal = PlanError::Electrode {
        slot: 0,
        electrode: 16,
        count: 16,
    };
    assert!(bench.run(0.02).contains(&FromBoard::Error(BoardError::Period(refusal))));
}

#[test]
fn the_source_is_set_and_watched() {
    let mut bench = Bench::new(SimConfig::default(), FixedSheet(disc(16)));
    let full = bench.measured(0.1);
    bench.send(&ToBoard::SetExcitation(500));
    let said = bench.run(0.1);
    assert!(said.contains(&FromBoard::Ack(Command::SetExcitation)));
    let half = crate::common::frames(said).pop().unwrap();
    for (a, b) in full[0].values.iter().zip(&half.values) {
        assert!((a.codes() / 2.0 - b.codes()).abs() < 2.0);
    }
    for given in [0, 1001] {
        bench.send(&ToBoard::SetExcitation(given));
        let said = bench.run(0.02);
        assert!(
            said.iter()
                .any(|m| matches!(m, FromBoard::Error(BoardError::Refused(_)))),
            "{said:?}"
        );
    }
    // A source that is not what it should be is reported instead of frames.
    let config = SimConfig {
        electronics: Electronics {
            settling_s: 0.0,
            source_gain_milli: 0,
            ..Electronics::default()
        },
        ..SimConfig::default()
    };
    let mut bench = Bench::new(config, FixedSheet(disc(16)));
    bench.send(&ToBoard::Start);
    let said = bench.run(0.1);
    let fault = FromBoard::Error(BoardError::FrontEnd(FrontEndFault::Source));
    assert!(said.contains(&fault), "{said:?}");
    assert!(seconds(bench.board.now()) > 0.09);
}
