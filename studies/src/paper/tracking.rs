//! A tip pressed with a varying force (the paper's Fig. 10) and repeatedly (Fig. 11). The reading of the picture is
//! compared with the gauge, with and without compensation of the creep.

use crate::paper::methods::Reader;
use crate::paper::rig::{Press, Recording, Rig};
use crate::paper::{Options, PaperError, noise};
use crate::score::quantile;
use inverse::force::calibration::{self, Fit};
use inverse::force::meter::Calibration;
use inverse::force::press::Recorder;
use inverse::force::recording::Sample;
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::touches::touch::Touch;
use serde::Serialize;

/// Where the tip is, mm: near the centre.
const AT: [f64; 2] = [6.0, -4.0];
/// Frames of the unpressed sheet at the start.
const BASELINE: usize = 24;
/// The gauge's full scale: the largest force, N.
pub const FULL_SCALE_N: f64 = 25.0;
/// Distance from the tip within which a touch of the picture is the tip's, mm.
const NEAR_MM: f64 = 30.0;

/// One moment.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Moment {
    /// Time, s.
    pub time_s: f64,
    /// Reading of the gauge, N.
    pub gauge_n: f64,
    /// The paper's method: integrated rise of the picture at the tip in newtons, by the gain that fits the gauge best.
    pub theirs_n: f64,
    /// Integrated rise of the fitted touch in newtons by its instant gain: with the creep.
    pub before_n: f64,
    /// The force with the creep taken out.
    pub after_n: f64,
}

/// Difference of a reading from the gauge, parts of the full scale of 25 N.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ForceError {
    /// Root of the mean square.
    pub rms: f64,
    /// 99th percentile.
    pub p99: f64,
    /// The largest.
    pub largest: f64,
}

/// An experiment.
#[derive(Clone, Debug, Serialize)]
pub struct Experiment {
    /// The readings.
    pub moments: Vec<Moment>,
    /// By the paper's method.
    pub theirs: ForceError,
    /// By the fitted touch with its instant gain.
    pub before: ForceError,
    /// By the fitted touch with the gain that fits the gauge best. The residual is the shape of the creep alone.
    pub before_best_gain: ForceError,
    /// With the creep taken out.
    pub after: ForceError,
    /// Correlation of the uncorrected reading with the gauge.
    pub correlation: f64,
    /// Largest reading from half a second after each release to the next press, N: by the paper's method, uncorrected
    /// and corrected.
    pub residual_n: [f64; 3],
}

/// A press-and-hold of its own, and the calibration from it.
#[derive(Clone, Debug, Serialize)]
pub struct Hold {
    /// Time (s), the gauge (N), the integrated rise and the fit (mm²).
    pub moments: Vec<[f64; 4]>,
    /// Delayed ratio, time constant (s), unit rise (MPa).
    pub fitted: [f64; 3],
    /// Their standard errors.
    pub standard_errors: [f64; 3],
    /// The true values of the rubber.
    pub truth: Option<[f64; 3]>,
    /// Standard deviation of a force estimated from one frame, N.
    pub force_sd_n: f64,
}

/// Figs. 10 and 11, and the calibration for them.
#[derive(Clone, Debug, Serialize)]
pub struct Tracking {
    /// A press-and-hold at another place and with other noise.
    pub hold: Hold,
    /// A force that goes up and down.
    pub varying: Experiment,
    /// The same load again and again.
    pub repeated: Experiment,
}

pub(super) fn run(rig: &dyn Rig, options: Options, progress: &dyn Fn(&str)) -> Result<Tracking, PaperError> {
    let seed = options.seed;
    progress("press-and-hold for the calibration");
    // A hold of four time constants determines the delayed part; a quick run is shorter.
    let (hold_s, after_s) = if options.quick { (12.0, 6.0) } else { (20.0, 12.0) };
    let (hold, calibration) = hold(rig, [-20.0, 25.0], hold_s, after_s, seed + 100)?;
    progress("a force that goes up and down");
    let varying = experiment(rig, &varying(options), calibration, seed + 101)?;
    progress("the same load again and again");
    let repeated = experiment(rig, &repeated(options), calibration, seed + 102)?;
    Ok(Tracking {
        hold,
        varying,
        repeated,
    })
}

/// Time of the baseline, s.
const START_S: f64 = 1.5;
/// A tip on a stand comes down and lifts in this time, s.
const RAMP_S: f64 = 0.5;

/// A force that goes up and down between levels, like that of a hand.
fn varying(options: Options) -> Vec<[f64; 2]> {
    let levels = [10.0, 4.0, 18.0, 8.0, 25.0, 12.0, 20.0];
    let each = if options.quick { 1.2 } else { 4.0 };
    let mut path = vec![[START_S, 0.0]];
    for (k, level) in levels.into_iter().enumerate() {
        let from = START_S + each * k as f64;
        path.push([from + 0.5 * each, level]);
        path.push([from + each, level]);
    }
    let end = START_S + each * levels.len() as f64;
    path.extend([[end + 0.5 * each, 0.0], [end + 2.0 * each, 0.0]]);
    path
}

/// Loads of 25 N with pauses.
fn repeated(options: Options) -> Vec<[f64; 2]> {
    let (loads, held, pause) = if options.quick { (3, 2.5, 1.5) } else { (6, 6.0, 3.0) };
    let mut path = Vec::new();
    for k in 0..loads {
        let from = START_S + f64::from(k) * (held + pause + 2.0 * RAMP_S);
        path.extend([[from, 0.0], [from + RAMP_S, FULL_SCALE_N]]);
        path.extend([[from + RAMP_S + held, FULL_SCALE_N], [from + 2.0 * RAMP_S + held, 0.0]]);
    }
    let end = path[path.len() - 1][0];
    path.push([end + 4.0 * pause, 0.0]);
    path
}

/// Records a press-and-hold of 25 N and fits the rubber.
fn hold(rig: &dyn Rig, at: [f64; 2], hold_s: f64, after_s: f64, seed: u64) -> Result<(Hold, Calibration), PaperError> {
    let release = START_S + RAMP_S + hold_s;
    let path = [
        [START_S, 0.0],
        [START_S + RAMP_S, FULL_SCALE_N],
        [release, FULL_SCALE_N],
        [release + RAMP_S, 0.0],
        [release + RAMP_S + after_s, 0.0],
    ];
    let r = Recording::make(
        rig.mount(&[Press::tip(at, &path)], true, seed)?,
        &noise::ours()?,
        path[4][0],
    )?;
    let samples = samples(&r, at)?;
    let Fit {
        calibration,
        errors,
        fitted_mm2,
        ..
    } = calibration::fit(&samples, false)?;
    let solid = calibration.solid;
    let moments = samples
        .iter()
        .zip(fitted_mm2)
        .map(|(s, m)| [s.time_s, s.force_n, s.total_mm2, m])
        .collect();
    let hold = Hold {
        moments,
        fitted: [solid.delayed_ratio, solid.tau_s, solid.unit_rise_mpa],
        standard_errors: [errors.delayed_ratio, errors.tau_s, errors.unit_rise_mpa],
        truth: rig.creep(),
        force_sd_n: calibration.force_sd_n,
    };
    Ok((hold, calibration))
}

/// The tip's integrated rise in every frame of a recording, with the gauge's force.
fn samples(r: &Recording, at: [f64; 2]) -> Result<Vec<Sample>, PaperError> {
    let imager = Reader::our_imager()?;
    let mut recorder = Recorder::new(imager, BASELINE, r.interval_s, Some(at));
    for frame in &r.frames {
        recorder.take(frame.time_s, &frame.values_v, (r.gauge)(r.middle_s(frame)))?;
    }
    Ok(recorder.into_samples())
}

fn experiment(rig: &dyn Rig, path: &[[f64; 2]], calibration: Calibration, seed: u64) -> Result<Experiment, PaperError> {
    let until = path[path.len() - 1][0];
    let r = Recording::make(rig.mount(&[Press::tip(AT, path)], true, seed)?, &noise::ours()?, until)?;
    let mut live = Live::new(
        Reader::our_imager()?,
        LiveOptions {
            baseline_frames: BASELINE,
            calibration: Some(calibration),
            ..LiveOptions::default()
        },
    );
    let (baseline, _) = r.mean(0.0, r.frames[0].time_s + (BASELINE as f64 + 0.5) * r.interval_s);
    let mut theirs = Reader::theirs(&baseline)?;
    let near = |t: &&Touch| (t.x_mm - AT[0]).hypot(t.y_mm - AT[1]) < NEAR_MM;
    let mut moments = Vec::new();
    for frame in &r.frames {
        let LiveFrame::Picture(result) = live.frame(frame.time_s, &frame.values_v)? else {
            continue;
        };
        let ours: Vec<&Touch> = result.touches.iter().filter(near).collect();
        // The picture of the paper's method at the tip: the sum of its elements there.
        let image = theirs.read(&frame.values_v)?.x.clone();
        let grid = &theirs.imager.grid;
        let there = (0..grid.len()).filter(|k| {
            let [x, y] = grid.centre(*k);
            (x - AT[0]).hypot(y - AT[1]) < NEAR_MM
        });
        moments.push(Moment {
            time_s: r.middle_s(frame),
            gauge_n: (r.gauge)(r.middle_s(frame)),
            theirs_n: there.map(|k| image[k]).sum::<f64>() * grid.cell_mm().powi(2),
            before_n: ours.iter().map(|t| t.total_mm2).sum::<f64>() * calibration.solid.unit_rise_mpa,
            after_n: ours.iter().filter_map(|t| t.force_n).sum(),
        });
    }
    let gain = best_gain(&moments, |m| m.theirs_n);
    for m in &mut moments {
        m.theirs_n *= gain;
    }
    let best = best_gain(&moments, |m| m.before_n);
    // From half a second after a release to one frame before the next press, because that frame is partly pressed.
    let released = |m: &Moment| {
        let before = path.iter().rev().find(|p| p[0] <= m.time_s);
        let after = path.iter().find(|p| p[0] > m.time_s + r.interval_s);
        let rested = before.is_some_and(|p| p[1] == 0.0 && m.time_s - p[0] > 0.5 && p[0] > START_S);
        rested && after.is_none_or(|p| p[1] == 0.0 || p[0] > m.time_s + RAMP_S) && m.gauge_n == 0.0
    };
    let left = |read: fn(&Moment) -> f64| moments.iter().filter(|m| released(m)).map(read).fold(0.0, f64::max);
    Ok(Experiment {
        theirs: error(&moments, |m| m.theirs_n),
        before: error(&moments, |m| m.before_n),
        before_best_gain: error(&moments, |m| best * m.before_n),
        after: error(&moments, |m| m.after_n),
        correlation: correlation(&moments),
        residual_n: [left(|m| m.theirs_n), left(|m| m.before_n), left(|m| m.after_n)],
        moments,
    })
}

fn best_gain(moments: &[Moment], read: impl Fn(&Moment) -> f64) -> f64 {
    let (mut rg, mut rr) = (0.0, 0.0);
    for m in moments {
        rg += read(m) * m.gauge_n;
        rr += read(m) * read(m);
    }
    if rr > 0.0 { rg / rr } else { 0.0 }
}

impl ForceError {
    /// Of differences, parts of the full scale, none below 0.
    pub(super) fn of(off: &[f64]) -> Self {
        let square: f64 = off.iter().map(|v| v * v).sum();
        Self {
            rms: (square / off.len().max(1) as f64).sqrt(),
            p99: quantile(off, 0.99),
            largest: off.iter().copied().fold(0.0, f64::max),
        }
    }
}

fn error(moments: &[Moment], read: impl Fn(&Moment) -> f64) -> ForceError {
    let off = moments.iter().map(|m| (read(m) - m.gauge_n).abs() / FULL_SCALE_N);
    ForceError::of(&off.collect::<Vec<_>>())
}

fn correlation(moments: &[Moment]) -> f64 {
    let n = moments.len().max(1) as f64;
    let mean = |read: fn(&Moment) -> f64| moments.iter().map(read).sum::<f64>() / n;
    let (a, b) = (mean(|m| m.gauge_n), mean(|m| m.before_n));
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for m in moments {
        ab += (m.gauge_n - a) * (m.before_n - b);
        aa += (m.gauge_n - a).powi(2);
        bb += (m.before_n - b).powi(2);
    }
    ab / (aa * bb).sqrt().max(f64::MIN_POSITIVE)
}
