//! Run time against error: all methods, cell sizes and ranks on the same frames.

use crate::error::StudyError;
use crate::scene::{Kind, Scene, rng};
use crate::score::{Score, quantile};
use crate::test_sheet::{TestSheet, imager, imager_for};
use forward::Drive;
use inverse::pipeline::{Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::imager::Imager;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// One way from a frame to touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// The method of the picture.
    pub method: Method,
    /// Side of its cells, mm.
    pub cell_mm: f64,
    /// Rank tolerance: singular values below this fraction of the largest are left out.
    pub drop: f64,
    /// Whether the touches are fitted to the measurements; otherwise they are the picture's peaks.
    pub fit: bool,
}

/// Cell sizes compared, mm.
pub const CELLS_MM: [f64; 4] = [20.0, 10.0, 5.0, 3.0];
/// Rank tolerances compared, for 5 mm cells.
pub const DROPS: [f64; 4] = [1e-4, 1e-3, 1e-2, 3e-2];

/// Every method with every cell size at full rank, and with 5 mm cells at lower ranks; ours with the fit.
pub fn ways() -> Vec<Way> {
    let mut ways = Vec::new();
    for method in Method::ALL {
        let way = |cell_mm: f64, drop: f64, fit: bool| Way {
            method,
            cell_mm,
            drop,
            fit,
        };
        ways.extend(CELLS_MM.map(|c| way(c, 0.0, false)));
        ways.extend(DROPS.map(|d| way(5.0, d, false)));
        if method == Method::Nnls {
            ways.extend(CELLS_MM.map(|c| way(c, 0.0, true)));
        }
    }
    ways
}

/// Time and errors of a way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Entry {
    /// The method; `nnls+fit` where the touches are fitted.
    pub method: String,
    /// Side of the cells, mm.
    pub cell_mm: f64,
    /// Number of cells.
    pub cells: usize,
    /// Rank of the sensitivity in use.
    pub rank: usize,
    /// Number of frames; fewer than for the others where the way is slow.
    pub frames: usize,
    /// From voltages to touches, median over the frames, us.
    pub frame_us: f64,
    /// The picture's solve alone, median, us.
    pub solve_us: f64,
    /// Part of the frames with the right count of touches.
    pub counted: f64,
    /// Position error of a touch, median, mm; 50 mm for a touch that is not found.
    pub median_mm: f64,
    /// The same, 95th percentile, mm.
    pub p95_mm: f64,
    /// Whether no other way is both faster and more accurate (in the median).
    pub on_front: bool,
}

/// Number of runs through the frames. The time of a frame is its least, which leaves out other programs.
const RUNS: usize = 3;
/// A way gets no more frames after this time, to limit slow ways.
const MOST: Duration = Duration::from_secs(2);

/// Runs every way on the same frames: 1 to 4 discs of 25 mm and +20 %, 50 mm apart or more, at 27 dB. The noise is
/// estimated from the frame. `progress` is called with every way before its run, its number and how many there
/// are.
///
/// # Errors
/// [`StudyError`] where the sheet cannot be modelled.
pub fn compare(
    drive: Drive,
    frames: usize,
    seed: u64,
    mut progress: impl FnMut(&str, usize, usize),
) -> Result<Vec<Entry>, StudyError> {
    let mut rng = rng(seed);
    let first = imager(drive, CELLS_MM[0])?;
    let mut sheet = TestSheet::new(&first, drive, 0.0, 0.0, &mut rng)?;
    let mut imagers: Vec<(Method, Arc<Imager>)> = Vec::new();
    let mut measured = Vec::new();
    for k in 0..frames {
        let scene = Kind::Equal(1 + k % 4).scene(&mut rng, 27.0);
        let frame = sheet.frame(&scene, &mut rng)?;
        measured.push((scene, frame));
    }
    let mut entries = Vec::new();
    let ways = ways();
    for (k, way) in ways.iter().copied().enumerate() {
        progress(&format!("{} on {} mm cells", name(way), way.cell_mm), k, ways.len());
        let known = |(m, i): &&(Method, Arc<Imager>)| *m == way.method && i.grid.cell_mm() == way.cell_mm;
        let imager = match imagers.iter().find(known) {
            Some((_, imager)) => Arc::clone(imager),
            None => {
                let imager = imager_for(way.method, drive, way.cell_mm)?;
                imagers.push((way.method, Arc::clone(&imager)));
                imager
            }
        };
        entries.push(run(way, &imager, &sheet.baseline, &measured)?);
    }
    mark_front(&mut entries);
    Ok(entries)
}

fn name(way: Way) -> String {
    let suffix = if way.fit { "+fit" } else { "" };
    format!("{}{suffix}", way.method)
}

fn run(way: Way, imager: &Arc<Imager>, baseline: &[f64], frames: &[(Scene, Vec<f64>)]) -> Result<Entry, StudyError> {
    let usual = ReconstructorOptions::for_imager(imager, way.method);
    let options = ReconstructorOptions {
        drop: way.drop,
        fit: usual.fit.filter(|_| way.fit),
        ..usual
    };
    let reference = Reference::new(Arc::clone(imager), baseline.to_vec(), FrameNoise::Unknown)?;
    let mut r = Reconstructor::new(reference, options);
    // The first frame also prepares the problem; its time does not count.
    let begin = Instant::now();
    if let Some((_, frame)) = frames.first() {
        r.frame(frame)?;
    }
    let mut score = Score::default();
    let (mut times, mut solves) = (Vec::new(), Vec::new());
    for run in 0..RUNS {
        let done = if run == 0 { frames.len() } else { score.scenes };
        for (k, (scene, frame)) in frames.iter().take(done).enumerate() {
            let start = Instant::now();
            let found = r.frame(frame)?;
            let us = start.elapsed().as_secs_f64() * 1e6;
            if run == 0 {
                score.add(scene, &found.touches);
                times.push(us);
                solves.push(found.solve_us);
            } else {
                times[k] = us.min(times[k]);
                solves[k] = found.solve_us.min(solves[k]);
            }
            if begin.elapsed() > MOST {
                break;
            }
        }
    }
    Ok(Entry {
        method: name(way),
        cell_mm: way.cell_mm,
        cells: imager.grid.len(),
        rank: r.rank().unwrap_or(0),
        frames: score.scenes,
        frame_us: quantile(&times, 0.5),
        solve_us: quantile(&solves, 0.5),
        counted: score.counted_part(),
        median_mm: score.error_mm(0.5),
        p95_mm: score.error_mm(0.95),
        on_front: false,
    })
}

/// Marks the Pareto front: entries that no other beats in both time and median error.
fn mark_front(entries: &mut [Entry]) {
    let points: Vec<[f64; 2]> = entries.iter().map(|e| [e.frame_us, e.median_mm]).collect();
    for (k, entry) in entries.iter_mut().enumerate() {
        let beats = |q: &[f64; 2]| q[0] <= points[k][0] && q[1] <= points[k][1] && *q != points[k];
        entry.on_front = points[k].iter().all(|v| v.is_finite()) && !points.iter().any(beats);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(frame_us: f64, median_mm: f64) -> Entry {
        Entry {
            method: String::new(),
            cell_mm: 5.0,
            cells: 0,
            rank: 0,
            frames: 1,
            frame_us,
            solve_us: 0.0,
            counted: 1.0,
            median_mm,
            p95_mm: 0.0,
            on_front: false,
        }
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let mut entries = [
            entry(1.0, 9.0),
            entry(2.0, 3.0),
            entry(3.0, 3.0),
            entry(2.5, 4.0),
            entry(9.0, 1.0),
            entry(f64::NAN, 0.0),
        ];
        mark_front(&mut entries);
        let front: Vec<bool> = entries.iter().map(|e| e.on_front).collect();
        assert_eq!(front, [true, true, false, false, true, false]);
    }

    #[test]
    fn every_method_is_compared_at_every_size() {
        for method in Method::ALL {
            for cell_mm in CELLS_MM {
                assert!(
                    ways()
                        .iter()
                        .any(|w| w.method == method && w.cell_mm == cell_mm && w.drop == 0.0)
                );
            }
        }
    }

    /// On the same frames: the failure of the generalised inverse as in the paper, and the gain of the fit.
    #[test]
    fn the_generalised_inverse_fails_where_nnls_works_and_the_fit_is_better_still() {
        let entries = compare(Drive::PAPER, 6, 31, |_, _, _| ()).unwrap();
        let of = |method: &str| {
            let full = entries.iter().find(|e| e.method == method && e.cell_mm == 5.0);
            full.map(|e| e.median_mm).unwrap()
        };
        assert!(of("pseudo-inverse") > 10.0 * of("nnls"), "{entries:#?}");
        assert!(of("nnls+fit") < of("nnls"), "{entries:#?}");
        assert!(entries.iter().any(|e| e.on_front));
    }
}
