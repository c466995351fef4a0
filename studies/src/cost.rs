//! Time of a frame from voltages to touches, for different events on the sheet.

mod frames;

use crate::error::StudyError;
use crate::scene::{Fault, Scene, rng};
use crate::score::quantile;
use crate::test_sheet::{TestSheet, imager, noise_v, noisy, reconstructor};
use forward::{DiscTouch, Drive, Pattern, Sheet};
pub use frames::Frames;
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::pipeline::{FrameResult, Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::imager::Imager;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use protocol::Plan;
use rand::rngs::StdRng;
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What happens on the sheet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Happening {
    /// Nothing; the noise is known from a recording of the unpressed sheet.
    Idle,
    /// Nothing, and the noise has to be estimated from every frame.
    IdleUnknownNoise,
    /// Four fingers at rest, with fresh noise.
    Still,
    /// One finger that moves 1 mm a frame.
    One,
    /// Four fingers that move 1 mm a frame.
    Four,
    /// Five finger tips and a palm that move 1 mm a frame.
    Hand,
}

impl Happening {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Idle,
        Self::IdleUnknownNoise,
        Self::Still,
        Self::One,
        Self::Four,
        Self::Hand,
    ];

    /// Its name, for tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::IdleUnknownNoise => "idle, noise unknown",
            Self::Still => "four still",
            Self::One => "one moving",
            Self::Four => "four moving",
            Self::Hand => "whole hand moving",
        }
    }

    /// Touches of the k-th frame.
    pub fn touches(self, frame: usize) -> Vec<DiscTouch> {
        // 1 mm on a circle of 48 mm.
        let turn = frame as f64 / 48.0;
        match self {
            Self::Idle | Self::IdleUnknownNoise => Vec::new(),
            Self::Still => fingers(4, 0.0),
            Self::One => fingers(1, turn),
            Self::Four => fingers(4, turn),
            Self::Hand => hand(turn),
        }
    }
}

fn disc(at: [f64; 2], radius_mm: f64, rise: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: at,
        radius_mm,
        rise,
    }
}

fn fingers(count: usize, turn: f64) -> Vec<DiscTouch> {
    (0..count)
        .map(|k| {
            let angle = turn + k as f64 * std::f64::consts::FRAC_PI_2;
            let radius = 48.0 + 12.0 * (0.37 * turn + k as f64).sin();
            disc([radius * angle.cos(), radius * angle.sin()], 12.5, 0.2)
        })
        .collect()
}

/// A palm low on the sheet and five tips above it, all moving together.
fn hand(turn: f64) -> Vec<DiscTouch> {
    let (dx, dy) = (12.0 * (4.0 * turn).sin(), 12.0 * (4.0 * turn).cos());
    let mut touches = vec![disc([dx, dy - 38.0], 26.0, 0.12)];
    for (x, y) in [(-58.0, -8.0), (-32.0, 34.0), (-2.0, 48.0), (28.0, 38.0), (54.0, 8.0)] {
        touches.push(disc([x + dx, y + dy], 9.0, 0.25));
    }
    touches
}

/// Times of the frames of one kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// What happens.
    pub happening: String,
    /// Frames measured; fewer than asked for where they take long.
    pub frames: usize,
    /// Time of a frame over the frames of the sequence, us: median, 99th percentile and the longest.
    pub median_us: f64,
    /// See `median_us`.
    pub p99_us: f64,
    /// See `median_us`.
    pub worst_us: f64,
    /// The picture alone, median of the frames that have one, us.
    pub solve_us: f64,
    /// Touches found, mean over the frames.
    pub touches: f64,
    /// Part of the frames with as many touches as there are; none where what is there is no touch.
    pub counted: Option<f64>,
}

/// Number of runs through the sequence. The time of a frame is its least, which leaves out other programs.
const RUNS: usize = 5;
/// After this time a kind gets no more runs, and at most [`FEW`] frames.
const MOST: Duration = Duration::from_secs(4);
const FEW: usize = 24;
/// What is also measured as frames of a table.
const IN_TABLES: [&str; 5] = [
    "four moving",
    "whole hand moving",
    "one moving, an electrode lost",
    "a rod",
    "random frames, 30 %",
];
/// Time from a frame to the next, s.
const INTERVAL_S: f64 = 1.0 / 210.0;

/// Measures the times of frames with the noise at which four fingers have 27 dB: of the paper's sheet, and of one with 32 electrodes, as a
/// board measures it and with all neighbouring pairs.
/// `told` is told the name of every kind before it is measured.
///
/// # Errors
/// [`StudyError`] where the sheet cannot be modelled.
pub fn costs(drive: Drive, frames: usize, seed: u64, mut told: impl FnMut(&str)) -> Result<Vec<Cost>, StudyError> {
    let mut costs = of_paper(drive, frames, seed, &mut told)?;
    let all = Pattern::adjacent(32)?;
    for pattern in [as_boards_measure(32)?, all] {
        costs.extend(of_many_electrodes(drive, pattern, frames, seed, &mut told)?);
    }
    Ok(costs)
}

/// The same of the paper's sheet alone.
fn of_paper(drive: Drive, frames: usize, seed: u64, mut told: impl FnMut(&str)) -> Result<Vec<Cost>, StudyError> {
    let mut rng = rng(seed);
    let imager = imager(drive, 5.0)?;
    let mut sheet = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng)?;
    let sigma = noise(&mut sheet, &mut rng)?;
    let idle = Frames::of_happening(&mut sheet, Happening::Idle, frames, &mut rng)?;
    let noisy = idle.noisy(sigma, &mut rng);
    told(Happening::IdleUnknownNoise.name());
    let way = || {
        let mut r = reconstructor(&imager, &sheet.baseline)?;
        // The first frame prepares the problem.
        r.frame(&noisy[0]).map(drop)?;
        Ok(move |_: f64, frame: &[f64], see: &mut dyn FnMut(&FrameResult)| {
            see(r.frame(frame)?);
            Ok(())
        })
    };
    let unknown = time(Happening::IdleUnknownNoise.name(), &idle, &noisy, way)?;
    let mut costs = vec![unknown];
    let kinds = Frames::of_paper(&mut sheet, frames, &mut rng)?;
    for kind in &kinds {
        told(&kind.name);
        costs.push(live(&imager, &sheet, kind, sigma, &mut rng)?);
    }
    for kind in kinds.iter().filter(|k| IN_TABLES.contains(&k.name.as_str())) {
        costs.push(in_a_table(&imager, &sheet, kind, sigma, &mut rng, &mut told)?);
    }
    Ok(costs)
}

/// Measures the first frames each by itself, as those of a table are.
fn in_a_table(
    imager: &Arc<Imager>,
    sheet: &TestSheet,
    kind: &Frames,
    sigma: f64,
    rng: &mut StdRng,
    mut told: impl FnMut(&str),
) -> Result<Cost, StudyError> {
    let name = format!("in a table: {}", kind.name);
    told(&name);
    let mut noisy = kind.noisy(sigma, rng);
    noisy.truncate(FEW);
    let way = || {
        let options = ReconstructorOptions::for_imager(imager, Method::Nnls);
        let reference = Reference::new(Arc::clone(imager), sheet.baseline.clone(), FrameNoise::of_frames(sigma))?;
        let mut r = Reconstructor::new(reference, options);
        // Whatever the first frame prepares is set-up.
        r.frame(&noisy[0]).map(drop)?;
        Ok(move |_: f64, frame: &[f64], see: &mut dyn FnMut(&FrameResult)| {
            see(r.frame(frame)?);
            Ok(())
        })
    };
    time(&name, kind, &noisy, way)
}

/// The values that a board of so many electrodes sends.
fn as_boards_measure(electrodes: u8) -> Result<Pattern, StudyError> {
    let plan = Plan::sparse(electrodes)?;
    let pair = |p: protocol::Pair| [usize::from(p.plus), usize::from(p.minus)];
    let pairs = plan
        .measurements(electrodes)
        .map(|(drive, sense)| [pair(drive), pair(sense)]);
    Ok(Pattern::from_pairs(usize::from(electrodes), pairs)?)
}

/// The same of a disc with so many electrodes as a pattern has.
fn of_many_electrodes(
    drive: Drive,
    pattern: Pattern,
    frames: usize,
    seed: u64,
    mut told: impl FnMut(&str),
) -> Result<Vec<Cost>, StudyError> {
    let (mut rng, electrodes) = (rng(seed), pattern.electrodes());
    let paper = Sheet::paper();
    let contact_mm = paper.electrodes.first().map_or(0.0, |e| e.contact_mm);
    let disc = Sheet::disc(195.0, electrodes, 7.0, contact_mm, paper.sheet_resistance_ohm);
    let imager = Arc::new(Imager::new(&disc, drive, pattern, 5.0)?);
    let mut sheet = TestSheet::of_sheet(&imager, drive, &disc)?;
    let sigma = noise(&mut sheet, &mut rng)?;
    let mut costs = Vec::new();
    for kind in Frames::of_many_electrodes(&mut sheet, frames, &mut rng)? {
        told(&kind.name);
        costs.push(live(&imager, &sheet, &kind, sigma, &mut rng)?);
    }
    Ok(costs)
}

/// Measures frames on their way from the link to numbered touches.
fn live(
    imager: &Arc<Imager>,
    sheet: &TestSheet,
    kind: &Frames,
    sigma: f64,
    rng: &mut StdRng,
) -> Result<Cost, StudyError> {
    let options = LiveOptions {
        find_electrodes: false,
        ..LiveOptions::default()
    };
    let baseline: Vec<Vec<f64>> = (0..options.baseline_frames + 8)
        .map(|_| sheet.empty(sigma, rng))
        .collect();
    let noisy = kind.noisy(sigma, rng);
    let way = || {
        let mut live = Live::new(Arc::clone(imager), options);
        for (k, frame) in baseline.iter().enumerate() {
            live.frame(k as f64 * INTERVAL_S, frame)?;
        }
        let begin_s = baseline.len() as f64 * INTERVAL_S;
        Ok(move |time_s: f64, frame: &[f64], see: &mut dyn FnMut(&FrameResult)| {
            if let LiveFrame::Picture(result) = live.frame(begin_s + time_s, frame)? {
                see(result);
            }
            Ok(())
        })
    };
    time(&kind.name, kind, &noisy, way)
}

/// Runs frames through a way that is begun anew for every run.
fn time<W>(
    name: &str,
    kind: &Frames,
    noisy: &[Vec<f64>],
    mut begin: impl FnMut() -> Result<W, StudyError>,
) -> Result<Cost, StudyError>
where
    W: FnMut(f64, &[f64], &mut dyn FnMut(&FrameResult)) -> Result<(), StudyError>,
{
    let mut best = vec![f64::INFINITY; noisy.len()];
    let mut solves = best.clone();
    let (mut measured, mut touches, mut counted) = (0, 0.0, 0.0);
    let start = Instant::now();
    for run in 0..RUNS {
        if run > 0 && start.elapsed() > MOST {
            break;
        }
        let mut way = begin()?;
        for (k, frame) in noisy.iter().enumerate() {
            if k >= FEW && start.elapsed() > MOST {
                break;
            }
            let (mut found, mut solve_us) = (0, 0.0);
            let begin = Instant::now();
            way(k as f64 * INTERVAL_S, frame, &mut |result| {
                (found, solve_us) = (result.touches.len(), result.solve_us);
            })?;
            best[k] = best[k].min(begin.elapsed().as_secs_f64() * 1e6);
            solves[k] = solves[k].min(solve_us);
            if run == 0 {
                measured += 1;
                touches += found as f64;
                counted += f64::from(kind.touches.get(k) == Some(&found));
            }
        }
    }
    best.truncate(measured);
    solves.truncate(measured);
    solves.retain(|us| *us > 0.0);
    let frames = measured as f64;
    Ok(Cost {
        happening: name.to_owned(),
        frames: measured,
        median_us: quantile(&best, 0.5),
        p99_us: quantile(&best, 0.99),
        worst_us: quantile(&best, 1.0),
        solve_us: if solves.is_empty() { 0.0 } else { quantile(&solves, 0.5) },
        touches: touches / frames,
        counted: (!kind.touches.is_empty()).then_some(counted / frames),
    })
}

/// Noise at which four fingers have 27 dB, V.
fn noise(sheet: &mut TestSheet, rng: &mut StdRng) -> Result<f64, StudyError> {
    let clean = sheet.frame(&scene(Happening::Four, 0, f64::INFINITY), rng)?;
    Ok(noise_v(&clean, &sheet.baseline, 27.0))
}

fn scene(happening: Happening, frame: usize, snr_db: f64) -> Scene {
    Scene {
        touches: happening.touches(frame),
        smooth: false,
        snr_db,
        fault: Fault::None,
    }
}

/// Frames of a happening with noise of a known size.
pub(super) fn sequence(
    sheet: &mut TestSheet,
    happening: Happening,
    frames: usize,
    sigma: f64,
    rng: &mut StdRng,
) -> Result<Vec<Vec<f64>>, StudyError> {
    let mut still: Option<Vec<f64>> = None;
    (0..frames)
        .map(|k| {
            let same = matches!(
                happening,
                Happening::Idle | Happening::IdleUnknownNoise | Happening::Still
            );
            let clean = match (&still, same) {
                (Some(frame), true) => frame.clone(),
                _ => sheet.frame(&scene(happening, k, f64::INFINITY), rng)?,
            };
            still = Some(clean.clone());
            Ok(noisy(clean, sigma, rng))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_sheet::live_reconstructor;
    use inverse::quality::doubt::Doubt;

    #[test]
    fn nothing_touches_overlaps_or_leaves_the_sheet() {
        for happening in Happening::ALL {
            for frame in 0..300 {
                let touches = happening.touches(frame);
                for (k, t) in touches.iter().enumerate() {
                    let [x, y] = t.centre_mm;
                    assert!(x.hypot(y) + t.radius_mm < 97.5, "{happening:?} {frame}: {t:?}");
                    for other in &touches[..k] {
                        let apart = (x - other.centre_mm[0]).hypot(y - other.centre_mm[1]);
                        assert!(apart > t.radius_mm + other.radius_mm, "{happening:?} {frame}");
                    }
                }
            }
        }
    }

    /// Longest frame of a sequence, ms on the machine that the steps were measured on.
    const MOST_MS: f64 = 45.0;

    /// Whatever is on the sheet, and whatever is broken, no frame of a sequence takes more work than this.
    #[test]
    fn no_frame_takes_more_than_so_much_work() {
        let mut rng = rng(11);
        let imager = imager(Drive::PAPER, 10.0).unwrap();
        let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
        let sigma = noise(&mut sheet, &mut rng).unwrap();
        let kinds = Frames::of_paper(&mut sheet, 12, &mut rng).unwrap();
        assert!({ IN_TABLES }.iter().all(|name| kinds.iter().any(|k| k.name == *name)));
        for kind in kinds {
            let mut r = live_reconstructor(&imager, &sheet.baseline, FrameNoise::of_frames(sigma)).unwrap();
            for (k, frame) in kind.noisy(sigma, &mut rng).iter().enumerate() {
                r.frame_after(frame, Some(INTERVAL_S)).unwrap();
                let work = r.work();
                assert!(
                    work.fits <= 16 && work.solutions <= 2,
                    "{}, frame {k}: {work:?}",
                    kind.name
                );
                assert!(
                    work.problems <= 6 && work.search_parts <= 5,
                    "{}, frame {k}: {work:?}",
                    kind.name
                );
                assert!(
                    r.nominal_ms() <= MOST_MS,
                    "{}, frame {k}: {:.0} ms, {work:?}",
                    kind.name,
                    r.nominal_ms()
                );
            }
        }
    }

    /// Of many values a problem, and its tables, take a frame of their own. Two at most follow one another, and the finger is found again.
    #[test]
    fn what_many_values_are_solved_with_is_made_in_frames_of_its_own() {
        const LONGEST_MS: f64 = 100.0;
        let mut rng = rng(11);
        let disc = Sheet::disc(195.0, 32, 7.0, 15.0, 1000.0);
        let pattern = Pattern::adjacent(32).unwrap();
        let imager = Arc::new(Imager::new(&disc, Drive::PAPER, pattern, 10.0).unwrap());
        let mut sheet = TestSheet::of_sheet(&imager, Drive::PAPER, &disc).unwrap();
        let sigma = noise(&mut sheet, &mut rng).unwrap();
        let kinds = Frames::of_many_electrodes(&mut sheet, 16, &mut rng).unwrap();
        let kind = kinds.iter().find(|k| k.name.ends_with("an electrode lost")).unwrap();
        let mut r = live_reconstructor(&imager, &sheet.baseline, FrameNoise::of_frames(sigma)).unwrap();
        let (mut making, mut made, mut found, mut not_solved) = (0, 0, 0, 0);
        for (k, frame) in kind.noisy(sigma, &mut rng).iter().enumerate() {
            let result = r.frame_after(frame, Some(INTERVAL_S)).unwrap();
            let unsolved = result.doubt == Some(Doubt::NotSolved);
            let (anew, doubted, faults, at) = (
                result.anew,
                unsolved || matches!(result.doubt, Some(Doubt::Fault(_))),
                result.faults.len(),
                result.touches.iter().map(|t| [t.x_mm, t.y_mm]).collect::<Vec<_>>(),
            );
            let work = r.work();
            assert!(r.nominal_ms() <= LONGEST_MS, "{k}: {:.0} ms, {work:?}", r.nominal_ms());
            assert!(work.problems + work.tables <= 1, "{k}: {work:?}");
            making = if work.fits == 0 && work.problems + work.tables > 0 {
                making + 1
            } else {
                0
            };
            assert!(making <= 2 && (making == 0 || (doubted && !anew)), "{k}: {work:?}");
            assert!(!(unsolved && (anew || making == 0)), "{k}: {work:?}");
            not_solved += usize::from(unsolved);
            made += work.problems + work.tables;
            if faults > 0 && anew {
                let [x, y] = Happening::One.touches(k)[0].centre_mm;
                assert!(at.len() == 1 && (at[0][0] - x).hypot(at[0][1] - y) < 3.0, "{k}: {at:?}");
                found += 1;
            }
        }
        assert!(made >= 2 && found > 4 && not_solved > 0, "{made} {found} {not_solved}");
    }

    /// The frame that names electrodes that are lost is doubted, and from the next one on the finger is at its place.
    #[test]
    fn the_frame_after_a_fault_was_named_is_right() {
        let mut rng = rng(11);
        let imager = imager(Drive::PAPER, 10.0).unwrap();
        let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
        let sigma = noise(&mut sheet, &mut rng).unwrap();
        let kinds = Frames::of_paper(&mut sheet, 12, &mut rng).unwrap();
        for name in ["one moving, an electrode lost", "one moving, two electrodes lost"] {
            let kind = kinds.iter().find(|k| k.name == name).unwrap();
            let mut r = live_reconstructor(&imager, &sheet.baseline, FrameNoise::of_frames(sigma)).unwrap();
            let mut named = None;
            for (k, frame) in kind.noisy(sigma, &mut rng).iter().enumerate() {
                let result = r.frame_after(frame, Some(INTERVAL_S)).unwrap();
                if result.faults.is_empty() {
                    continue;
                }
                if *named.get_or_insert(k) == k {
                    assert!(result.doubt.is_some(), "{name}, frame {k}");
                    continue;
                }
                let [x, y] = Happening::One.touches(k)[0].centre_mm;
                let at: Vec<[f64; 2]> = result.touches.iter().map(|t| [t.x_mm, t.y_mm]).collect();
                let off = |at: &[f64; 2]| (at[0] - x).hypot(at[1] - y);
                assert!(at.len() == 1 && off(&at[0]) < 3.0, "{name}, frame {k}: {at:?}");
                assert_eq!(result.doubt, None, "{name}, frame {k}");
            }
            assert!(named.is_some_and(|k| k < 6), "{name}: {named:?}");
        }
    }

    #[test]
    fn costs_are_told_for_what_happens() {
        let mut rng = rng(5);
        let imager = imager(Drive::PAPER, 10.0).unwrap();
        let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
        let sigma = noise(&mut sheet, &mut rng).unwrap();
        for happening in [Happening::Idle, Happening::One] {
            let kind = Frames::of_happening(&mut sheet, happening, 4, &mut rng).unwrap();
            let cost = live(&imager, &sheet, &kind, sigma, &mut rng).unwrap();
            assert_eq!(
                (cost.happening.as_str(), cost.frames, cost.counted),
                (happening.name(), 4, Some(1.0))
            );
            assert!(
                cost.median_us <= cost.p99_us && cost.p99_us <= cost.worst_us,
                "{cost:?}"
            );
            assert_eq!(cost.solve_us > 0.0, happening == Happening::One, "{cost:?}");
            let in_a_table = in_a_table(&imager, &sheet, &kind, sigma, &mut rng, |_| {}).unwrap();
            assert_eq!((in_a_table.frames, in_a_table.counted), (4, Some(1.0)));
        }
    }
}
