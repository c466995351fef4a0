//! What a board measures on a phantom: one folded period for every drive and sense pair.

use crate::ask::{PATIENCE, insist};
use crate::error::LinkError;
use crate::link::Link;
use protocol::{
    Command, FoldedPeriod, Frame, FromBoard, Hello, PERIOD_BINS, Pair, PeriodRequest, Plan, ToBoard, Watch,
};
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::time::Duration;

/// Periods of each value. Noise of a sample of half a code is 0.04 codes then; more only take longer.
const PERIODS: u16 = 16;
/// Quarter periods before each, two periods: amplifiers come back from a gain at which they were at their rail.
const SETTLE_QUARTERS: u16 = 8;
/// Longest wait for a frame of the plan in force.
const FIRST_FRAME: Duration = Duration::from_secs(10);
/// Values of one period each that the noise of a value is estimated from, in phase and a quarter period ahead: it is known to 5 % then.
const REPEATS: usize = 96;
/// Frames of all channels at once that are averaged. A value of one period has a quarter of a code of noise; of these it is
/// 0.1 in some thousand.
const FRAMES: usize = 8;

/// One pair's folded period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Drive and sense pair, plus and minus, from 0.
    pub drive: [usize; 2],
    /// As the drive.
    pub sense: [usize; 2],
    /// Whether it is the drive pair's own voltage, through the last gain, instead of gain 0.
    pub own: bool,
    /// Amplitude in phase and a quarter period ahead, codes.
    pub in_phase: f64,
    /// A quarter period ahead, codes.
    pub quadrature: f64,
    /// Mean code, less the middle of the range.
    pub offset: f64,
    /// How far the period is from the same upside down, codes.
    pub bent: f64,
    /// Whether a sample touched the converter's rails.
    pub clipped: bool,
}

/// All readings.
#[derive(Clone, Debug, PartialEq)]
pub struct Readings {
    /// For each drive of neighbours its own voltage, then the sense pairs that share no electrode with it.
    pub list: Vec<Reading>,
    /// Of a board that senses all pairs at once: the sense pairs of `list` in its order, each by its own channel, codes in phase.
    pub at_once: Option<Vec<f64>>,
    /// Standard deviation of a value of one period, codes.
    pub sigma: f64,
    /// The source as it is set, in parts of full scale.
    pub excitation: f64,
}

/// Measures all pairs. The board is started for it and stopped afterwards, unless it was running.
///
/// # Errors
/// No answer, a lost port, or a board that refuses or stops by itself, as one whose source is wrong.
pub fn read(link: &Link, hello: &Hello) -> Result<Readings, LinkError> {
    let status = insist(link, "its status", &ToBoard::GetStatus, PATIENCE, |m| match m {
        FromBoard::Status(status) => Some(status),
        _ => None,
    })?;
    insist(link, "the start", &ToBoard::Start, PATIENCE, |m| {
        matches!(m, FromBoard::Ack(Command::Start)).then_some(())
    })?;
    // The source is measured first, and a period asked for meanwhile would be in its place: wait for what comes after it.
    link.ask("the first frame", ToBoard::GetStatus, FIRST_FRAME, |m| {
        matches!(m, FromBoard::Frame(_) | FromBoard::Heartbeat(_)).then_some(())
    })?;
    let readings = all(link, hello, f64::from(status.excitation_permille) / 1000.0).and_then(|readings| {
        let plan = Plan::fast();
        let senses_all = hello.limits.channels >= hello.electrodes && plan.slots.len() == usize::from(hello.electrodes);
        let values = senses_all.then(|| at_once(link, &plan)).transpose()?;
        let at_once = values.and_then(|values| in_order(&readings.list, &plan, &values));
        Ok(Readings { at_once, ..readings })
    });
    if !status.running {
        insist(link, "the stop", &ToBoard::Stop, PATIENCE, |m| {
            matches!(m, FromBoard::Ack(Command::Stop)).then_some(())
        })?;
    }
    readings
}

fn all(link: &Link, hello: &Hello, excitation: f64) -> Result<Readings, LinkError> {
    let n = usize::from(hello.electrodes);
    let last = (hello.gains_milli.len() as u8).saturating_sub(1);
    let mut list = Vec::new();
    for m in 0..n {
        let drive = [m, (m + 1) % n];
        list.push(one(link, hello, drive, drive, last, PERIODS)?);
        for k in 2..n - 1 {
            let minus = (m + k) % n;
            list.push(one(link, hello, drive, [(minus + 1) % n, minus], 0, PERIODS)?);
        }
    }
    let far = [(n / 2 + 1) % n, n / 2];
    let mut values = Vec::new();
    for _ in 0..REPEATS {
        let value = one(link, hello, [0, 1], far, 0, 1)?;
        values.push([value.in_phase, value.quadrature]);
    }
    let variance = |part: usize| {
        let mean = values.iter().map(|v| v[part]).sum::<f64>() / REPEATS as f64;
        values.iter().map(|v| (v[part] - mean).powi(2)).sum::<f64>() / (REPEATS - 1) as f64
    };
    Ok(Readings {
        list,
        at_once: None,
        sigma: ((variance(0) + variance(1)) / 2.0).sqrt(),
        excitation,
    })
}

/// The mean of some frames of all pairs at once. Plan and watch are afterwards what they were.
fn at_once(link: &Link, plan: &Plan) -> Result<Vec<f64>, LinkError> {
    let before = insist(link, "its plan", &ToBoard::GetPlan, PATIENCE, |m| match m {
        FromBoard::Plan(plan) => Some(plan),
        _ => None,
    })?;
    let watch = insist(link, "its watch", &ToBoard::GetWatch, PATIENCE, |m| match m {
        FromBoard::Watch(watch) => Some(watch),
        _ => None,
    })?;
    if watch.is_some() {
        set_watch(link, None)?;
    }
    if *plan != before {
        set_plan(link, plan)?;
    }
    let mean = mean_of_frames(link, plan);
    if *plan != before {
        set_plan(link, &before)?;
    }
    if watch.is_some() {
        set_watch(link, watch)?;
    }
    mean
}

/// A plan's values in the order of the readings' sense pairs; nothing where it has not all of these.
fn in_order(list: &[Reading], plan: &Plan, values: &[f64]) -> Option<Vec<f64>> {
    let pairs = plan.slots.iter().flat_map(|slot| {
        let drive = [slot.drive.plus, slot.drive.minus].map(usize::from);
        let sensed = (0..u32::BITS as usize).filter(|n| slot.sense >> n & 1 == 1);
        sensed.map(move |minus| (drive, minus))
    });
    let measured: HashMap<_, f64> = pairs.zip(values.iter().copied()).collect();
    let sense = list.iter().filter(|r| !r.own);
    sense.map(|r| measured.get(&(r.drive, r.sense[1])).copied()).collect()
}

fn set_plan(link: &Link, plan: &Plan) -> Result<(), LinkError> {
    insist(link, "its plan", &ToBoard::SetPlan(plan.clone()), PATIENCE, |m| {
        matches!(m, FromBoard::Plan(set) if set == *plan).then_some(())
    })
}

fn set_watch(link: &Link, watch: Option<Watch>) -> Result<(), LinkError> {
    insist(link, "its watch", &ToBoard::SetWatch(watch.clone()), PATIENCE, |m| {
        matches!(m, FromBoard::Watch(set) if set == watch).then_some(())
    })
}

fn mean_of_frames(link: &Link, plan: &Plan) -> Result<Vec<f64>, LinkError> {
    let mut sum = vec![0.0; plan.value_count()];
    for _ in 0..FRAMES {
        let frame: Frame = link.ask("a frame", ToBoard::GetStatus, FIRST_FRAME, |m| match m {
            FromBoard::Frame(frame) if frame.plan == plan.id && frame.values.len() == sum.len() => Some(frame),
            _ => None,
        })?;
        for (sum, value) in sum.iter_mut().zip(&frame.values) {
            *sum += value.codes() / FRAMES as f64;
        }
    }
    Ok(sum)
}

fn one(
    link: &Link,
    hello: &Hello,
    drive: [usize; 2],
    sense: [usize; 2],
    gain: u8,
    periods: u16,
) -> Result<Reading, LinkError> {
    let pair = |[plus, minus]: [usize; 2]| Pair {
        plus: plus as u8,
        minus: minus as u8,
    };
    let request = PeriodRequest {
        drive: pair(drive),
        sense: pair(sense),
        gain,
        settle_quarters: SETTLE_QUARTERS,
        periods,
    };
    let period = insist(
        link,
        "a folded period",
        &ToBoard::GetPeriod(request),
        PATIENCE,
        |m| match m {
            FromBoard::Period(period) if period.request == request => Some(period),
            _ => None,
        },
    )?;
    Ok(reading(hello, &period, drive, sense, drive == sense))
}

fn reading(hello: &Hello, period: &FoldedPeriod, drive: [usize; 2], sense: [usize; 2], own: bool) -> Reading {
    let bins = period
        .bins
        .map(|sum| f64::from(sum) / f64::from(period.request.periods.max(1)) / hello.codes_in_one());
    let count = PERIOD_BINS as f64;
    let mean = bins.iter().sum::<f64>() / count;
    let correlate = |f: fn(f64) -> f64| {
        let product = |(k, bin): (usize, &f64)| bin * f(TAU * k as f64 / count);
        bins.iter().enumerate().map(product).sum::<f64>() * 2.0 / count
    };
    let (first, second) = bins.split_at(PERIOD_BINS / 2);
    let apart = first.iter().zip(second).map(|(a, b)| (a + b - 2.0 * mean).abs());
    Reading {
        drive,
        sense,
        own,
        in_phase: correlate(f64::sin),
        quadrature: correlate(f64::cos),
        offset: mean - 0.5 * hello.range_codes(),
        bent: apart.fold(0.0, f64::max),
        clipped: period.clipped,
    }
}
