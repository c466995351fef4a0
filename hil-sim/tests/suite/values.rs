//! The front end at the level of values against the one of samples, and against the firmware's laws.

use crate::common::disc;
use firmware::{Route, Sense, laws};
use hil_sim::{Electronics, FaultKind, Level, Line, Meter, MeterError, Multiplexer, ValueFrontEnd};
use protocol::{Frame, Pair, Plan};

/// Frames of each board. Of 208 values and so many frames the variance of all is known to 1.2 %.
const FRAMES: usize = 64;

fn meter(e: &Electronics, level: Level, plan: &Plan) -> Meter {
    Meter::new(e.clone(), &disc(16), level, |_| Ok(plan.clone())).unwrap()
}

fn codes(frame: &Frame) -> Vec<f64> {
    frame.values.iter().map(|v| v.codes()).collect()
}

/// Mean of every value, and how the values and the means of slots scatter about theirs.
struct Statistics {
    mean: Vec<f64>,
    variance: f64,
    of_slots: f64,
    stated: f64,
}

fn statistics(meter: &mut Meter) -> Statistics {
    let sheet = disc(16);
    let frames: Vec<Frame> = (0..FRAMES).map(|_| meter.frame(&sheet, &[]).unwrap()).collect();
    let values: Vec<Vec<f64>> = frames.iter().map(codes).collect();
    let n = FRAMES as f64;
    let mean: Vec<f64> = (0..208).map(|k| values.iter().map(|v| v[k]).sum::<f64>() / n).collect();
    let (mut variance, mut of_slots) = (0.0, 0.0);
    for frame in &values {
        let off: Vec<f64> = frame.iter().zip(&mean).map(|(v, m)| v - m).collect();
        variance += off.iter().map(|d| d * d).sum::<f64>() / 208.0 / (n - 1.0);
        let slots = off.chunks(13).map(|slot| (slot.iter().sum::<f64>() / 13.0).powi(2));
        of_slots += slots.sum::<f64>() / 16.0 / (n - 1.0);
    }
    let stated = frames.iter().map(|f| meter.noise_v(f)).sum::<f64>() / n;
    let volts = meter.hello().volts_per_code(0).unwrap();
    Statistics {
        mean,
        variance,
        of_slots,
        stated: (stated / volts).powi(2),
    }
}

/// Both levels give the same means, the same scatter, and the same scatter of what a slot's values have in common.
fn agree(name: &str, e: &Electronics, plan: &Plan) {
    let mut by_values = meter(e, Level::Values, plan);
    let (a, b) = (
        statistics(&mut by_values),
        statistics(&mut meter(e, Level::Samples, plan)),
    );
    assert_eq!(by_values.sampled_windows(), 0, "{name}: no law was found");
    // Squares of 208 differences of means, each in its own variance: 208 with a deviation of 20.4. Rounding to a sixteenth of a
    // code may not be noise where there is little: it counts as an error of its own.
    let error = (a.variance + b.variance) / FRAMES as f64 + 2.0 * 0.0625_f64.powi(2) / 12.0;
    let square: f64 = a.mean.iter().zip(&b.mean).map(|(a, b)| (a - b).powi(2) / error).sum();
    assert!(square < 208.0 + 5.0 * 20.4, "{name}: {square}");
    // A ratio of two variances of 208 x 63 and of 16 x 63 degrees of freedom; slots are correlated by nothing else.
    let ratio = a.variance / b.variance;
    assert!((ratio - 1.0).abs() < 0.09, "{name}: variance {ratio}");
    let ratio = a.of_slots / b.of_slots;
    assert!((ratio - 1.0).abs() < 0.32, "{name}: variance of slots {ratio}");
    // What the board says of its noise: cut by 6 % in the mean, and the scatter of single slots. Samples also show transients.
    let ratio = b.stated / a.stated;
    let settled = plan.settle_quarters >= 4;
    assert!(!settled || (0.8..1.2).contains(&ratio), "{name}: stated {ratio}");
}

#[test]
fn values_have_the_law_of_samples() {
    let fast = Plan::fast();
    let default = Electronics::default();
    agree("default", &default, &fast);
    agree(
        "gains, offsets, crosstalk, another crystal, no settling",
        &Electronics {
            gain_error: (0..16).map(|n| 0.01 * f64::from(n % 5) - 0.02).collect(),
            offset_v: (0..16).map(|n| 0.02 * f64::from(n % 3)).collect(),
            crosstalk: 0.01,
            crystal_ppm: 400.0,
            ..default.clone()
        },
        &Plan {
            settle_quarters: 0,
            ..fast.clone()
        },
    );
    agree(
        "jitter",
        &Electronics {
            jitter_s: 4e-7,
            ..default.clone()
        },
        &fast,
    );
    agree(
        "noise of the drive and of the supply",
        &Electronics {
            drive_noise_v: 5e-3,
            supply_noise_v: 5e-3,
            supply_to_drive: 0.3,
            supply_to_channels: 0.1,
            ..default.clone()
        },
        &fast,
    );
    agree("sixteen drawn channels", &Electronics::drawn_sixteen(), &fast);
    agree("the drawn board", &Electronics::drawn_board(), &Plan::sequential_fast());
}

/// 1/f noise is one channel's own, and one window's hardly the next one's: it is held for longer than a window in its lower octaves
/// only, which whole periods do not show.
#[test]
fn flicker_is_noise_of_its_density() {
    let e = Electronics {
        flicker_codes: 2.0,
        ..Electronics::default()
    };
    let plan = Plan::fast();
    let (a, b) = (
        statistics(&mut meter(&e, Level::Values, &plan)),
        statistics(&mut meter(&e, Level::Samples, &plan)),
    );
    let without = statistics(&mut meter(&Electronics::default(), Level::Values, &plan)).variance;
    assert!(a.variance > 2.0 * without);
    let ratio = a.variance / b.variance;
    assert!((ratio - 1.0).abs() < 0.09, "{ratio}");
}

/// A line is no noise: every value differs by no more than noise, in the same frame.
#[test]
fn interference_is_the_same_line_at_the_same_time() {
    let e = Electronics {
        interference: vec![Line {
            modulation: 0.5,
            modulation_hz: 7.0,
            harmonics: vec![0.3],
            ..Line::new(3650.0, 0.02)
        }],
        ..Electronics::default()
    };
    let (sheet, plan) = (disc(16), Plan::fast());
    let mut meters = [Level::Values, Level::Samples].map(|level| meter(&e, level, &plan));
    let quiet = codes(
        &meter(&Electronics::default(), Level::Values, &plan)
            .frame(&sheet, &[])
            .unwrap(),
    );
    // White noise of 0.365 codes and rounding, in two frames; a mean of 2,080 squares.
    let noise = 2.0 * (2.0 * (0.365_f64.powi(2) + 1.0 / 12.0) / 16.0 + 0.0625_f64.powi(2) / 12.0);
    let (mut square, mut line) = (0.0, 0.0);
    for _ in 0..10 {
        let [a, b] = meters.each_mut().map(|m| m.frame(&sheet, &[]).unwrap());
        assert_eq!(a.time, b.time);
        let (a, b) = (codes(&a), codes(&b));
        square += a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / 2080.0;
        line += a.iter().zip(&quiet).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / 2080.0;
    }
    assert!(line > 10.0 * noise, "{line}");
    assert!((square / noise - 1.0).abs() < 0.2, "{square} {noise}");
}

/// Faults, also those that clip and stick: the same values within noise, and the same flags.
#[test]
fn faults_do_the_same() {
    let (sheet, plan) = (disc(16), Plan::fast());
    for fault in [
        FaultKind::ElectrodeOpen { electrode: 4 },
        FaultKind::ContactRaised {
            electrode: 9,
            ohm: 300.0,
        },
        FaultKind::ElectrodesShort {
            electrodes: [3, 4],
            ohm: 20.0,
        },
        FaultKind::SourceSags { part: 0.4 },
        FaultKind::SourceLost,
        FaultKind::ChannelDead { channel: 7 },
        FaultKind::MultiplexerStuck {
            multiplexer: Multiplexer::DrivePlus,
            electrode: 2,
        },
        FaultKind::AdcStuck { code: 700 },
        FaultKind::Saturation { channel: None },
    ] {
        let mut meters = [Level::Values, Level::Samples].map(|level| meter(&Electronics::default(), level, &plan));
        let mut square = 0.0;
        for _ in 0..4 {
            let [a, b] = meters
                .each_mut()
                .map(|m| m.frame(&sheet, std::slice::from_ref(&fault)).unwrap());
            let agree = (0..208).filter(|k| a.clipped.get(*k) == b.clipped.get(*k)).count();
            // Noise decides where a value is just at a rail.
            assert!(agree >= 206, "{fault:?}: {agree}");
            let clean = (0..208).filter(|k| !a.clipped.get(*k) && !b.clipped.get(*k));
            let off = clean.map(|k| a.values[k].codes() - b.values[k].codes());
            square += off.map(|d| d * d).sum::<f64>() / 832.0;
        }
        let noise = 2.0 * (2.0 * (0.365_f64.powi(2) + 1.0 / 12.0) / 16.0 + 0.0625_f64.powi(2) / 12.0);
        assert!(square < 1.3 * noise, "{fault:?}: {square} {noise}");
    }
}

/// Where no law tells a value, its samples do; and by other means than that nothing is cheaper.
#[test]
fn samples_are_made_where_only_they_tell() {
    let (sheet, plan) = (disc(16), Plan::fast());
    let windows = |e: Electronics, fault: &[FaultKind]| {
        let mut meter = meter(&e, Level::Values, &plan);
        meter.frame(&sheet, fault).unwrap();
        meter.sampled_windows()
    };
    assert_eq!(windows(Electronics::default(), &[]), 0);
    assert_eq!(windows(Electronics::ideal(), &[]), 16);
    let bent = Electronics {
        inl_codes: 1.0,
        ..Electronics::default()
    };
    assert_eq!(windows(bent, &[]), 16);
    assert_eq!(
        windows(Electronics::default(), &[FaultKind::Saturation { channel: None }]),
        16
    );
}

#[test]
fn the_front_end_keeps_the_laws() {
    for e in [
        Electronics::default(),
        Electronics::drawn_sixteen(),
        Electronics::ideal(),
    ] {
        let mut front = ValueFrontEnd::new(e, disc(16)).unwrap();
        // Channel 0 is on the drive pair.
        let route = Route {
            drive: Pair { plus: 1, minus: 0 },
            sense: Sense::All { step: 1 },
            gain: 1,
        };
        assert_eq!(laws::detect(&mut front, &route, 16, |front| front.now()), Ok(()));
    }
}

#[test]
fn what_is_no_fault_of_values_is_refused() {
    let mut meter = meter(&Electronics::default(), Level::Values, &Plan::fast());
    let sheet = disc(16);
    let refused = meter.frame(&sheet, &[FaultKind::CablePulled]);
    assert_eq!(refused, Err(MeterError::NoValues(FaultKind::CablePulled)));
    let refused = meter.frame(&sheet, &[FaultKind::ElectrodeOpen { electrode: 16 }]);
    assert!(matches!(refused, Err(MeterError::Fault(_))));
    let refused = meter.frame(&disc(8), &[]);
    assert_eq!(refused, Err(MeterError::Electrodes { given: 8, wired: 16 }));
}
