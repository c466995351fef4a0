//! The simulated front end: the laws of every front end, and the physics of this one.

use crate::common::{Bench, disc};
use firmware::{Blocking, Excitation, Folded, Route, Router, Sense, Window, laws};
use forward::{Drive, Measurement};
use hil_sim::{Clock, Electronics, FixedSheet, SimConfig, SimFrontEnd};
use protocol::{Pair, Plan, Sampling, Value};

const NEIGHBOUR: Pair = Pair { plus: 3, minus: 2 };

fn route(sense: Sense) -> Route {
    Route {
        drive: Pair { plus: 0, minus: 1 },
        sense,
        gain: 0,
    }
}

fn front(electronics: Electronics) -> (Clock, SimFrontEnd<FixedSheet>) {
    let clock = Clock::new();
    let sheet = FixedSheet(disc(16));
    let front = SimFrontEnd::new(electronics, sheet, clock.clone()).unwrap();
    (clock, front.self_clocked())
}

fn quiet() -> Electronics {
    Electronics {
        noise_codes: 0.0,
        ..Electronics::default()
    }
}

/// Amplitude in codes that the circuit's equation gives for a drive and a sense pair.
fn expected(electronics: &Electronics, drive: Pair, sense: Pair, gain: u8) -> f64 {
    let pair = |p: Pair| forward::Pair::new(p.plus.into(), p.minus.into());
    let m = Measurement {
        drive: pair(drive),
        sense: pair(sense),
    };
    let gain = f64::from(electronics.gains_milli[usize::from(gain)]) / 1000.0;
    Drive::PAPER.voltage_v(&disc(16), m) * gain / electronics.adc_span_v * 4095.0
}

#[test]
fn the_front_end_keeps_the_laws() {
    // Sense the drive pair the way round that is in phase; every other channel may be anything.
    let own = Route {
        gain: 1,
        ..route(Sense::One(Pair { plus: 0, minus: 1 }))
    };
    let (clock, mut one) = front(Electronics::default());
    assert_eq!(laws::check(&mut one, &own, 16, 12, |_| clock.advance(1000)), Ok(()));
    let all = Route {
        drive: Pair { plus: 1, minus: 0 },
        gain: 1,
        ..route(Sense::All { step: 1 })
    };
    let (clock, mut many) = front(Electronics::default());
    assert_eq!(laws::check(&mut many, &all, 16, 12, |_| clock.advance(1000)), Ok(()));
}

#[test]
fn values_are_what_the_circuit_says() {
    for sampling in [Sampling::Sequential, Sampling::Simultaneous] {
        // A thousandth of a code of noise dithers nothing: 64 periods and the real noise do.
        let electronics = Electronics::default();
        let mut plan = Plan {
            sampling,
            integrate_periods: 64,
            settle_quarters: 4,
            ..Plan::fast()
        };
        plan.slots.truncate(3);
        let config = SimConfig {
            electronics: electronics.clone(),
            plan: Some(plan.clone()),
            ..SimConfig::default()
        };
        let frame = Bench::new(config, FixedSheet(disc(16))).measured(1.0).remove(0);
        assert_eq!(frame.clipped.count(), 0);
        for (value, (drive, sense)) in frame.values.iter().zip(plan.measurements(16)) {
            let e = expected(&electronics, drive, sense, 0);
            // Half a step, and five times the noise of a mean over 1024 samples with the converter's own rounding.
            let noise = (electronics.noise_codes.powi(2) + 1.0 / 12.0).sqrt() * (2.0f64 / 1024.0).sqrt();
            let bound = 0.5 / f64::from(Value::PER_CODE) + 5.0 * noise + 2e-5 * e.abs();
            assert!(
                (value.codes() - e).abs() < bound,
                "{drive:?} {sense:?} {}",
                value.codes() - e
            );
        }
    }
}

#[test]
fn the_drive_pairs_own_voltage_fits_the_second_gain() {
    let mut plan = Plan::fast();
    for (m, slot) in plan.slots.iter_mut().enumerate() {
        (slot.sense, slot.gain) = (1 << m, 1);
    }
    let config = SimConfig {
        plan: Some(plan.clone()),
        ..SimConfig::default()
    };
    let frame = Bench::new(config, FixedSheet(disc(16))).measured(0.1).remove(0);
    assert_eq!(frame.clipped.count(), 0);
    for (value, (drive, sense)) in frame.values.iter().zip(plan.measurements(16)) {
        let e = expected(&Electronics::default(), drive, sense, 1);
        assert!(e < -1000.0);
        assert!((value.codes() - e).abs() < 1.0);
    }
}

#[test]
fn what_is_too_large_clips_and_is_flagged() {
    let config = SimConfig {
        electronics: Electronics {
            gains_milli: vec![60_000],
            ..Electronics::default()
        },
        ..SimConfig::default()
    };
    let frame = Bench::new(config.clone(), FixedSheet(disc(16))).measured(0.1).remove(0);
    let mut flagged = 0;
    for (k, (drive, sense)) in Plan::fast().measurements(16).enumerate() {
        let e = expected(&config.electronics, drive, sense, 0);
        if e > 2050.0 {
            assert!(frame.clipped.get(k), "{k}: {e}");
            assert!(frame.values[k].codes() < e);
        } else if e < 2040.0 {
            assert!(!frame.clipped.get(k), "{k}: {e}");
        }
        flagged += u32::from(frame.clipped.get(k));
    }
    assert!((32..208).contains(&flagged), "{flagged}");
}

#[test]
fn a_channel_settles_with_its_time_constant() {
    // With a slow channel, the error of a window opened n periods after the switch falls by exp(-T / tau) for each
    // period: T = 16 * 1425 / 84 MHz = 271.4 us.
    let tau = 150e-6;
    let slow = Electronics {
        settling_s: tau,
        injection_v: 0.2,
        ..quiet()
    };
    let period_s = 16.0 * 1425.0 / 84e6;
    let offset = |settle_quarters| {
        let (_, mut front) = front(slow.clone());
        front.switch_on().unwrap();
        front.select(&route(Sense::One(NEIGHBOUR))).unwrap();
        let window = Window {
            settle_quarters,
            periods: 1,
            channels: 1,
        };
        let mut folded = Folded::new();
        Blocking(&mut front)
            .capture(window, |b| folded.add(b).unwrap())
            .unwrap();
        let mean = folded.period(0).iter().sum::<u32>() as f64 / 16.0;
        mean - 2047.5
    };
    let (first, second) = (offset(0), offset(4));
    let ratio = second / first;
    assert!(first > 20.0, "{first}");
    let theory = (-period_s / tau).exp();
    assert!((ratio / theory - 1.0).abs() < 0.05, "{ratio} {theory}");
}

#[test]
fn the_default_settling_is_over_within_a_period() {
    let (a, b) = (measure_after(1), measure_after(20));
    assert_eq!(a, b);
}

fn measure_after(settle_quarters: u16) -> [u32; 16] {
    let (_, mut front) = front(quiet());
    front.switch_on().unwrap();
    front.select(&route(Sense::One(NEIGHBOUR))).unwrap();
    let window = Window {
        settle_quarters,
        periods: 1,
        channels: 1,
    };
    let mut folded = Folded::new();
    Blocking(&mut front)
        .capture(window, |b| folded.add(b).unwrap())
        .unwrap();
    folded.period(0)
}

#[test]
fn without_excitation_there_is_no_signal() {
    let (_, mut front) = front(Electronics::default());
    front.switch_on().unwrap();
    front.select(&route(Sense::One(NEIGHBOUR))).unwrap();
    front.switch_off().unwrap();
    let window = Window {
        settle_quarters: 4,
        periods: 100,
        channels: 1,
    };
    let mut folded = Folded::new();
    Blocking(&mut front)
        .capture(window, |b| folded.add(b).unwrap())
        .unwrap();
    assert!(folded.correlate(0).0.in_phase_value(100).0.codes().abs() < 0.2);
}

#[test]
fn a_route_that_is_not_wired_is_refused() {
    let (_, mut front) = front(Electronics::default());
    let far = Pair { plus: 16, minus: 0 };
    assert!(front.select(&route(Sense::One(far))).is_err());
    let no_gain = Route {
        gain: 2,
        ..route(Sense::One(NEIGHBOUR))
    };
    front.switch_on().unwrap();
    assert!(front.select(&no_gain).is_err());
}
