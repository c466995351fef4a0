//! Scenes with a known truth: frames of touched sheets from a finer mesh than the imager's and the nonlinear model, with
//! noise, and the judgement of what was found in them. Everything is drawn from a seed.

use crate::StudyError;
use forward::field::conductivity_of;
use forward::{DiscTouch, Drive, ElectrodeMatrix, ForwardError, Model, ModelOptions, Pattern, Place, Sheet, Solver};
use inverse::pipeline::{FrameResult, Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::electrode_fit;
use inverse::reference::imager::Imager;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use inverse::touches::touch::Touch;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use std::sync::Arc;
use std::time::Instant;

/// Touches on a sheet, and what is wrong with the frame.
#[derive(Clone, Debug)]
pub struct Scene {
    /// What is pressed.
    pub touches: Vec<DiscTouch>,
    /// Smooth bumps of the same peak and second moment instead of discs.
    pub smooth: bool,
    /// Ratio of the change to its noise, 2-norms over the frame, dB.
    pub snr_db: f64,
    /// What is broken.
    pub fault: Fault,
}

/// What is broken, at an electrode drawn from the seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// Nothing.
    None,
    /// Every value that touches an electrode is rubbish.
    Electrode,
    /// Every value that touches an electrode is not a number.
    Missing,
    /// Every value of a sense pair is the same.
    Stuck,
}

/// A contact that is worse than when the baseline was taken, by so many ohm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Worse {
    /// In the wire, a plug or a switch: the sheet does not know of it.
    Wire(f64),
    /// Between metal and sheet, evenly over the electrode: it shunts the sheet less as well.
    Face(f64),
}

/// A kind of scene, made from a seed.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// Discs of 25 mm and +20 %, at least 50 mm apart.
    Equal(usize),
    /// Smooth fingers in their place.
    Fingers(usize),
    /// Two discs of 25 mm this far apart.
    Pair(f64),
    /// 1 to 4 discs of 16 to 32 mm, +8 to +40 %, at least 40 mm apart.
    Unequal,
    /// 1 to 4 discs of 25 mm with this rise.
    Strong(f64),
    /// 1 or 2 discs, and a fault.
    Broken(Fault),
}

const RIM_MM: f64 = 97.5;

impl Kind {
    /// Draws a scene.
    pub fn scene(self, rng: &mut StdRng, snr_db: f64) -> Scene {
        let disc = |at: [f64; 2], radius_mm: f64, rise: f64| DiscTouch {
            centre_mm: at,
            radius_mm,
            rise,
        };
        let mut fault = Fault::None;
        let touches: Vec<DiscTouch> = match self {
            Self::Equal(n) | Self::Fingers(n) => places(rng, n, 50.0).into_iter().map(|p| disc(p, 12.5, 0.2)).collect(),
            Self::Strong(rise) => {
                let n = rng.random_range(1..=4);
                places(rng, n, 50.0).into_iter().map(|p| disc(p, 12.5, rise)).collect()
            }
            Self::Pair(apart) => loop {
                let a = places(rng, 1, 0.0)[0];
                let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
                let b = [a[0] + apart * angle.cos(), a[1] + apart * angle.sin()];
                if b[0].hypot(b[1]) < RIM_MM - 20.0 {
                    break vec![disc(a, 12.5, 0.2), disc(b, 12.5, 0.2)];
                }
            },
            Self::Unequal => {
                let n = rng.random_range(1..=4);
                places(rng, n, 40.0)
                    .into_iter()
                    .map(|p| disc(p, rng.random_range(8.0..16.0), rng.random_range(0.08..0.4)))
                    .collect()
            }
            Self::Broken(f) => {
                fault = f;
                let n = rng.random_range(1..=2);
                places(rng, n, 50.0).into_iter().map(|p| disc(p, 12.5, 0.2)).collect()
            }
        };
        Scene {
            touches,
            smooth: matches!(self, Self::Fingers(_)),
            snr_db,
            fault,
        }
    }
}

fn places(rng: &mut StdRng, n: usize, apart: f64) -> Vec<[f64; 2]> {
    loop {
        let mut out: Vec<[f64; 2]> = Vec::new();
        for _ in 0..1000 {
            let p: [f64; 2] = [0; 2].map(|_| rng.random_range(-RIM_MM..RIM_MM));
            let free = out.iter().all(|q| (p[0] - q[0]).hypot(p[1] - q[1]) >= apart);
            if p[0].hypot(p[1]) < RIM_MM - 20.0 && free {
                out.push(p);
            }
            if out.len() == n {
                return out;
            }
        }
    }
}

/// A sheet that is measured: the imager does not know more of it than its baseline.
pub struct Bench {
    /// What the frames are reconstructed with.
    pub imager: Arc<Imager>,
    /// The drive.
    pub drive: Drive,
    /// Voltages of the untouched sheet, V, without noise.
    pub baseline: Vec<f64>,
    solver: Solver,
}

impl Bench {
    /// The paper's sheet, with electrodes off by `off_mm` (standard deviation) and contacts off by up to `contact` of
    /// their resistance.
    ///
    /// # Errors
    /// [`ForwardError`] where the electrodes end up on one another.
    pub fn new(
        imager: &Arc<Imager>,
        drive: Drive,
        off_mm: f64,
        contact: f64,
        rng: &mut StdRng,
    ) -> Result<Self, ForwardError> {
        let sheet = misplaced(off_mm, contact, rng);
        let options = ModelOptions {
            accuracy: 5e-5,
            ..ModelOptions::default()
        };
        let solver = Solver::new(Arc::new(Model::new(&sheet, &options)?))?;
        Ok(Self {
            baseline: drive.frame_v(solver.electrode_matrix(), &imager.pattern),
            imager: Arc::clone(imager),
            drive,
            solver,
        })
    }

    /// The frame of a scene, V, with its noise.
    ///
    /// # Errors
    /// [`ForwardError`] where the model has no solution: a touch with a rise of -1 or less.
    pub fn frame(&mut self, scene: &Scene, rng: &mut StdRng) -> Result<Vec<f64>, ForwardError> {
        let (drive, pattern) = (self.drive, &self.imager.pattern);
        let frame_v = |matrix: &ElectrodeMatrix| drive.frame_v(matrix, pattern);
        let mut v = if scene.smooth {
            let conductivity = conductivity_of(self.solver.model().mesh(), |p| {
                scene
                    .touches
                    .iter()
                    .map(|t| {
                        let (dx, dy) = (p[0] - t.centre_mm[0], p[1] - t.centre_mm[1]);
                        t.rise * (-0.5 * (dx * dx + dy * dy) / (0.5 * t.radius_mm).powi(2)).exp()
                    })
                    .sum()
            });
            frame_v(self.solver.solve(&conductivity)?)
        } else {
            self.clean_frame(&scene.touches)?
        };
        let sigma = noise_v(&v, &self.baseline, scene.snr_db);
        add_noise(&mut v, sigma, rng);
        self.spoil(&mut v, scene.fault, rng);
        Ok(v)
    }

    /// The frame of discs without noise, V.
    ///
    /// # Errors
    /// [`ForwardError`] where the model has no solution.
    pub fn clean_frame(&mut self, touches: &[DiscTouch]) -> Result<Vec<f64>, ForwardError> {
        let (drive, pattern) = (self.drive, &self.imager.pattern);
        // The mesh follows the discs' edges, and the change is that on one mesh.
        let touched = drive.frame_v(self.solver.solve_touches(touches)?, pattern);
        let untouched = drive.frame_v(self.solver.solve_untouched_there()?, pattern);
        let change = touched.iter().zip(&untouched).map(|(t, u)| t - u);
        Ok(self.baseline.iter().zip(change).map(|(b, c)| b + c).collect())
    }

    /// The frame of discs on a sheet some of whose contacts are worse than at the baseline, V, without noise.
    ///
    /// # Errors
    /// [`ForwardError`] where the model has no solution.
    pub fn worse_frame(&mut self, touches: &[DiscTouch], worse: &[(usize, Worse)]) -> Result<Vec<f64>, ForwardError> {
        let model = Arc::clone(self.solver.model());
        let sheet = model.sheet();
        let mut contacts: Vec<f64> = sheet.electrodes.iter().map(|e| e.contact_mm).collect();
        for (l, worse) in worse {
            if let Worse::Face(ohm) = worse {
                // All of it: its impedance (mm of sheet) over its length, mm.
                let length = match sheet.electrodes[*l].place {
                    Place::Angle { width_mm, .. } | Place::Arc { width_mm, .. } | Place::Point { width_mm, .. } => {
                        width_mm
                    }
                    Place::Inside { radius_mm, .. } => std::f64::consts::TAU * radius_mm,
                };
                contacts[*l] += ohm * length / sheet.sheet_resistance_ohm;
            }
        }
        let mut solver = Solver::new(Arc::new(model.with_contacts(&contacts)?))?;
        let mut potentials = solver.solve_touches(touches)?.potentials_ohm().clone();
        for (l, worse) in worse {
            if let Worse::Wire(ohm) = worse {
                potentials[(*l, *l)] += ohm;
            }
        }
        let (drive, pattern) = (self.drive, &self.imager.pattern);
        let touched = drive.frame_v(&ElectrodeMatrix::from_potentials(potentials), pattern);
        self.solver.solve_touches(touches)?;
        let untouched = drive.frame_v(self.solver.solve_untouched_there()?, pattern);
        let change = touched.iter().zip(&untouched).map(|(t, u)| t - u);
        Ok(self.baseline.iter().zip(change).map(|(b, c)| b + c).collect())
    }

    fn spoil(&self, v: &mut [f64], fault: Fault, rng: &mut StdRng) {
        let l = rng.random_range(0..16);
        let largest = self.baseline.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let stuck = rng.random_range(-1.0..1.0) * largest;
        for (v, m) in v.iter_mut().zip(self.imager.pattern.measurements()) {
            let touches = [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus].contains(&l);
            match fault {
                Fault::Electrode if touches => *v = rng.random_range(-1.0..1.0) * largest,
                Fault::Missing if touches => *v = f64::NAN,
                Fault::Stuck if m.sense.plus == l => *v = stuck,
                _ => {}
            }
        }
    }

    /// The way from this sheet's frames to touches: the electrodes are looked for in its baseline.
    ///
    /// # Errors
    /// [`StudyError`] where the imager is not this sheet's.
    pub fn reconstructor(&self) -> Result<Reconstructor, StudyError> {
        reconstructor(&self.seen(), &self.baseline)
    }

    /// The same for frames measured one after another.
    ///
    /// # Errors
    /// As for [`Bench::reconstructor`].
    pub fn live_reconstructor(&self, noise: FrameNoise) -> Result<Reconstructor, StudyError> {
        live_reconstructor(&self.seen(), &self.baseline, noise)
    }

    /// The imager with the electrodes where the baseline shows them to be.
    pub fn seen(&self) -> Arc<Imager> {
        electrode_fit::find(&self.imager, &self.baseline)
            .map_or_else(|| Arc::clone(&self.imager), |f| Arc::new(f.imager))
    }

    /// The sheet as it is.
    pub fn sheet(&self) -> &Sheet {
        self.solver.model().sheet()
    }

    /// A frame of the untouched sheet with noise of this standard deviation, V.
    pub fn empty(&self, sigma: f64, rng: &mut StdRng) -> Vec<f64> {
        noisy(self.baseline.clone(), sigma, rng)
    }
}

/// The paper's sheet with electrodes off by `off_mm` (standard deviation) and contacts off by up to `contact` of their
/// resistance.
pub fn misplaced(off_mm: f64, contact: f64, rng: &mut StdRng) -> Sheet {
    let mut sheet = Sheet::paper();
    for e in &mut sheet.electrodes {
        if let Place::Angle { angle_deg, .. } = &mut e.place {
            let off: f64 = rng.sample(StandardNormal);
            *angle_deg += (off_mm * off / RIM_MM).to_degrees();
        }
        e.contact_mm *= 1.0 + contact * rng.random_range(-1.0..=1.0);
    }
    sheet
}

/// A frame with noise of this standard deviation, V, added.
pub fn noisy(mut frame: Vec<f64>, sigma: f64, rng: &mut StdRng) -> Vec<f64> {
    add_noise(&mut frame, sigma, rng);
    frame
}

fn add_noise(v: &mut [f64], sigma: f64, rng: &mut StdRng) {
    for v in v {
        *v += sigma * rng.sample::<f64, _>(StandardNormal);
    }
}

/// The imager of the paper's sheet with the adjacent pattern and cells of this size.
///
/// # Errors
/// [`StudyError`] for a size that gives no cells or too many.
pub fn imager(drive: Drive, cell_mm: f64) -> Result<Arc<Imager>, StudyError> {
    let pattern = Pattern::adjacent(16)?;
    Ok(Arc::new(Imager::new(&Sheet::paper(), drive, pattern, cell_mm)?))
}

/// The imager of a method: see [`Imager::for_method`].
///
/// # Errors
/// [`StudyError`] for a size that gives no cells or too many.
pub fn imager_for(method: Method, drive: Drive, cell_mm: f64) -> Result<Arc<Imager>, StudyError> {
    let pattern = Pattern::adjacent(16)?;
    Ok(Arc::new(Imager::for_method(
        method,
        &Sheet::paper(),
        drive,
        pattern,
        cell_mm,
    )?))
}

/// The usual way from a frame to touches, with the electrodes taken to be where the imager has them. The noise is estimated
/// from every frame.
///
/// # Errors
/// [`StudyError`] where the baseline is not of the imager's pattern.
pub fn reconstructor(imager: &Arc<Imager>, baseline: &[f64]) -> Result<Reconstructor, StudyError> {
    let options = ReconstructorOptions::for_imager(imager, Method::Nnls);
    let reference = Reference::new(Arc::clone(imager), baseline.to_vec(), FrameNoise::Unknown)?;
    Ok(Reconstructor::new(reference, options))
}

/// The same for frames measured one after another, with what is known of their noise.
///
/// # Errors
/// As for [`reconstructor`].
pub fn live_reconstructor(
    imager: &Arc<Imager>,
    baseline: &[f64],
    noise: FrameNoise,
) -> Result<Reconstructor, StudyError> {
    let options = ReconstructorOptions::for_imager(imager, Method::Nnls);
    let reference = Reference::new(Arc::clone(imager), baseline.to_vec(), noise)?;
    Ok(Reconstructor::new(reference, options.of_sequence()))
}

/// Noise at which a frame has this ratio of its change to the noise, 2-norms over the frame: standard deviation of a value, V.
pub fn noise_v(clean: &[f64], baseline: &[f64], snr_db: f64) -> f64 {
    let change: f64 = clean.iter().zip(baseline).map(|(a, b)| (a - b).powi(2)).sum();
    (change / clean.len() as f64).sqrt() * 10.0_f64.powf(-snr_db / 20.0)
}

/// The source of all that is drawn.
pub fn rng(seed: u64) -> StdRng {
    StdRng::seed_from_u64(seed)
}

/// What was found in scenes of one kind.
#[derive(Clone, Debug, Default)]
pub struct Score {
    /// How many there were.
    pub scenes: usize,
    /// Scenes with the right count.
    pub counted: usize,
    /// Scenes with the right count and every touch within 8 mm.
    pub resolved: usize,
    /// Scenes with more touches than there are.
    pub over: usize,
    /// Distance of every true touch to the one found for it, mm; [`MISSED_MM`] where there is none.
    pub errors_mm: Vec<f64>,
    /// Error of x and of y over its stated uncertainty.
    pub over_sd: Vec<f64>,
    /// Integrated rise over the true one.
    pub totals: Vec<f64>,
    /// Error of the integrated rise over its stated uncertainty.
    pub total_over_sd: Vec<f64>,
    /// Time of every frame from its voltages to its touches, us.
    pub times_us: Vec<f64>,
    /// Scenes whose touches are the picture's, not fitted ones.
    pub unfitted: usize,
}

/// Error of a touch that was not found.
pub const MISSED_MM: f64 = 50.0;

impl Score {
    /// Matches touches, nearest pairs first.
    pub fn add(&mut self, truth: &Scene, found: &[Touch]) {
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (k, t) in truth.touches.iter().enumerate() {
            for (j, f) in found.iter().enumerate() {
                pairs.push(((f.x_mm - t.centre_mm[0]).hypot(f.y_mm - t.centre_mm[1]), k, j));
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut of = vec![None; truth.touches.len()];
        let mut taken = vec![false; found.len()];
        for (d, k, j) in pairs {
            if of[k].is_none() && !taken[j] && d < MISSED_MM {
                of[k] = Some((d, j));
                taken[j] = true;
            }
        }
        let mut worst = 0.0_f64;
        for (t, o) in truth.touches.iter().zip(&of) {
            let error = o.map_or(MISSED_MM, |o: (f64, usize)| o.0);
            worst = worst.max(error);
            self.errors_mm.push(error);
            if let Some((_, j)) = o {
                let f = &found[*j];
                let peak = t.rise * std::f64::consts::PI * t.radius_mm * t.radius_mm;
                let total = if truth.smooth { 0.5 * peak } else { peak };
                self.totals.push(f.total_mm2 / total);
                self.total_over_sd
                    .extend(f.total_sd_mm2.map(|sd| (f.total_mm2 - total).abs() / sd));
                if let (Some(sx), Some(sy)) = (f.x_sd_mm, f.y_sd_mm) {
                    self.over_sd.push((f.x_mm - t.centre_mm[0]).abs() / sx);
                    self.over_sd.push((f.y_mm - t.centre_mm[1]).abs() / sy);
                }
            }
        }
        self.scenes += 1;
        let right = found.len() == truth.touches.len();
        self.counted += usize::from(right);
        self.over += usize::from(found.len() > truth.touches.len());
        self.resolved += usize::from(right && worst < 8.0);
    }

    /// Part of the scenes with the right count.
    pub fn counted_part(&self) -> f64 {
        self.counted as f64 / self.scenes as f64
    }

    /// Part of the scenes with the right count and every touch within 8 mm.
    pub fn resolved_part(&self) -> f64 {
        self.resolved as f64 / self.scenes as f64
    }

    /// Quantile of the position error, mm.
    pub fn error_mm(&self, part: f64) -> f64 {
        quantile(&self.errors_mm, part)
    }

    /// Part of the coordinates that lie within two of their standard uncertainties.
    pub fn honest_part(&self) -> f64 {
        within_two(&self.over_sd)
    }

    /// Part of the integrated rises that lie within two of their standard uncertainties.
    pub fn honest_total_part(&self) -> f64 {
        within_two(&self.total_over_sd)
    }
}

fn within_two(over_sd: &[f64]) -> f64 {
    over_sd.iter().filter(|v| **v <= 2.0).count() as f64 / over_sd.len().max(1) as f64
}

/// The value below which this part of the values lies; not a number for none.
pub fn quantile(values: &[f64], part: f64) -> f64 {
    let mut v = values.to_vec();
    v.sort_by(f64::total_cmp);
    let k = (part * v.len() as f64) as usize;
    v.get(k.min(v.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
}

/// Runs scenes of a kind on a bench.
///
/// # Errors
/// See [`run`].
pub fn score(
    bench: &mut Bench,
    r: &mut Reconstructor,
    kind: Kind,
    snr_db: f64,
    scenes: usize,
    rng: &mut StdRng,
) -> Result<Score, StudyError> {
    let mut score = Score::default();
    run(bench, r, kind, snr_db, scenes, rng, &mut score)?;
    Ok(score)
}

/// Runs scenes of a kind on a bench and adds them to a score.
///
/// # Errors
/// [`StudyError`] where the frame has no solution or does not belong to the reconstructor.
pub fn run(
    bench: &mut Bench,
    r: &mut Reconstructor,
    kind: Kind,
    snr_db: f64,
    scenes: usize,
    rng: &mut StdRng,
    score: &mut Score,
) -> Result<(), StudyError> {
    for _ in 0..scenes {
        let scene = kind.scene(rng, snr_db);
        let frame = bench.frame(&scene, rng)?;
        let start = Instant::now();
        let found = r.frame(&frame)?;
        score.times_us.push(start.elapsed().as_secs_f64() * 1e6);
        let before = score.counted;
        score.add(&scene, &found.touches);
        score.unfitted += usize::from(found.misfit.is_none());
        if score.counted == before {
            log(&scene, found);
        }
    }
    Ok(())
}

/// Says what went wrong; shown with `RUST_LOG=debug`.
fn log(scene: &Scene, found: &FrameResult) {
    let is: Vec<String> = scene
        .touches
        .iter()
        .map(|t| {
            let [x, y] = t.centre_mm;
            format!("{x:.1} {y:.1} r {:.1} rise {:.2}", t.radius_mm, t.rise)
        })
        .collect();
    let was: Vec<String> = found
        .touches
        .iter()
        .map(|t| {
            let r = (t.area_mm2 / std::f64::consts::PI).sqrt();
            format!(
                "{:.1} {:.1} r {r:.1} rise {:.2} sd {:?}",
                t.x_mm, t.y_mm, t.rise, t.x_sd_mm
            )
        })
        .collect();
    tracing::debug!(?is, ?was, used = found.used, misfit = ?found.misfit, residual = found.residual, "wrong count");
}
