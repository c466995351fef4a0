//! Fits frame after frame: keeps what only depends on the sheet, and goes beyond the linear model where it shows.

use crate::reference::imager::Imager;
use crate::reference::noise::{NoiseEstimate, NoiseSource};
use crate::touches::fit::electrode_uncertainty::Placement;
use crate::touches::fit::linearisation_error::Correction;
use crate::touches::fit::model_order::{self, Before, Scratch};
use crate::touches::fit::nonlinear::{self, Beyond};
use crate::touches::fit::responses::TouchTable;
use crate::touches::fit::{Disc, Discs, FitOptions, Fitted, Frame, MOST_TOUCHES, Start, fit};
use std::sync::Arc;

/// Part of the data that the linear model of touches may get wrong before it is corrected.
const LINEAR_ERROR: f64 = 0.02;
/// Most corrections of a frame.
const MOST_ROUNDS: usize = 4;
/// Change of the integrated rises from one correction to the next, relative, that ends them.
const SETTLED: f64 = 0.01;
/// Error of the linear model, in standard deviations of the noise over the whole frame, that is worth two solutions of the
/// nonlinear model. At 27 dB a touch of +20 % alone is below, two of them side by side are above.
const WORTH_A_SOLUTION: f64 = 4.2;
/// The same for a correction that is carried from an earlier frame, before it is solved for anew: all of it may lie along one touch's
/// move.
const CARRIED_ERROR: f64 = 1.5;
/// Part of what is worth a solution from which one goes on being carried.
const STILL_WORTH: f64 = 0.7;
/// A correction was in vain that left more than this misfit, and more than this part of what there was before: the touches are no discs.
const UNEXPLAINED: f64 = 1.5;
const LITTLE_LESS: f64 = 0.8;
/// As long as no more than this many times as much is left, that is so.
const AS_MUCH: f64 = 1.5;
/// By how much a misfit scatters, three standard deviations.
const SCATTER: f64 = 0.4;
/// Where `LINEAR_ERROR` of a frame is more than this, in the same unit, it is taken to show before anything is known of the touches.
const SHOWS: f64 = 9.0;
/// After so many frames one after the other whose search did not come to its end, the next one's has no limit.
const MOST_UNFINISHED: usize = 8;
/// Contrast of a disc above which another explanation is tried: a rise of seven times.
const TOO_STRONG: f64 = 1.55;
/// Mean squared misfit, in noise variances, up to which discs explain a frame.
const MOST_MISFIT: f64 = 4.0;
/// Part of a frame (norm of the residual over that of the data) that fitted touches may leave, whatever the noise: beyond,
/// they are no discs.
const MOST_RESIDUAL: f64 = 0.06;

/// A frame to fit, reduced and weighted.
#[derive(Clone, Copy, Debug)]
pub struct Data<'a> {
    /// The difference, V.
    pub values: &'a [f64],
    /// The noise of one of them, and how it is known.
    pub noise: NoiseEstimate,
    /// How many times as large the variance of one frame's noise is: 1, or more where these are the mean of several. What touches are not
    /// discs, or the model gets wrong, is as large in the mean, so that it takes as much to believe in another one as in a frame.
    pub gain: f64,
}

/// What is the same for all fits of a frame.
#[derive(Clone, Copy)]
struct Job<'a> {
    table: &'a TouchTable,
    options: FitOptions,
    data: Data<'a>,
    drop: f64,
    /// Whether the next frame may go on with it.
    hurried: bool,
    turn: usize,
}

impl Job<'_> {
    fn frame<'a>(&self, values: &'a [f64], error: f64) -> Frame<'a> {
        Frame {
            values,
            sigma: self.data.noise.sigma,
            drop: self.drop,
            error,
            most_work: if self.hurried {
                self.options.most_work
            } else {
                usize::MAX
            },
        }
    }
}

/// Fits touches to the frames of one imager.
pub struct Fitter {
    options: FitOptions,
    imager: Arc<Imager>,
    /// Answers to touches, V of the model.
    volts: TouchTable,
    /// Made when a frame first needs it.
    beyond: Option<Beyond>,
    /// What was left out of the frame before, as it was solved for it or an earlier one.
    correction: Option<Correction>,
    /// How often it was solved for.
    solutions: usize,
    /// Whether no frame leaves its search to the next.
    patient: bool,
    /// What was left unexplained when it was last solved for in vain for a mean, in variances of one frame's noise.
    in_vain: Option<f64>,
    left_out: Vec<f64>,
    corrected: Vec<f64>,
    /// What the electrodes' uncertainty adds to that of touches.
    placement: Option<Placement>,
    /// Degrees of freedom of the noise, and what a touch must bring at them.
    drop: Option<(NoiseSource, f64)>,
    scratch: Scratch,
    fitted: Fitted,
    before: Fitted,
    /// Whether `fitted` is what the next frame is to be followed from, and how many frames there were.
    follows: bool,
    turn: usize,
    /// The least part of a misfit that noise does not explain since the touches were searched for, in variances of one frame's noise, and
    /// the data's gain.
    least_unexplained: (f64, f64),
    /// Frames one after the other in which a search did not come to its end.
    unfinished: usize,
}

impl Fitter {
    /// Tabulates the imager's sheet; `None` when that cannot be done.
    pub fn new(imager: &Arc<Imager>, options: FitOptions) -> Option<Self> {
        Some(Self {
            volts: TouchTable::new(&imager.model, imager.drive, &imager.pattern, options.radius_mm)?,
            placement: Placement::new(imager, options.radius_mm),
            imager: Arc::clone(imager),
            options,
            beyond: None,
            correction: None,
            solutions: 0,
            patient: false,
            in_vain: None,
            left_out: Vec::new(),
            corrected: Vec::new(),
            drop: None,
            scratch: Scratch::default(),
            fitted: Fitted::default(),
            before: Fitted::default(),
            follows: false,
            turn: 0,
            least_unexplained: (f64::INFINITY, 1.0),
            unfinished: 0,
        })
    }

    /// What the last fit came to, also where it does not explain its frame.
    pub fn last(&self) -> &Fitted {
        &self.fitted
    }

    /// Forgets the touches of the frame before: they have gone.
    pub fn forget(&mut self) {
        self.follows = false;
        (self.correction, self.in_vain) = (None, None);
    }

    /// Whether every search is to come to its end in its own frame, however many follow.
    pub fn set_patient(&mut self, patient: bool) {
        self.patient = patient;
    }

    /// Answers to touches, V of the model: to be reduced and weighted as the data are.
    pub fn volts(&self) -> &TouchTable {
        &self.volts
    }

    /// Touches fitted from the places of a picture's peaks, mm; `None` when discs do not explain the frame. `table` and
    /// `reduce` bring volts of the model into the space of the data.
    pub fn fit(
        &mut self,
        table: &TouchTable,
        mut reduce: impl FnMut(&[f64], &mut Vec<f64>),
        data: Data,
        seeds: impl Iterator<Item = [f64; 2]>,
    ) -> Option<&Fitted> {
        let live = data.noise.source == NoiseSource::Known;
        self.turn = self.turn.wrapping_add(1);
        let job = Job {
            table,
            options: self.options,
            data,
            drop: data.gain * self.drop(table, data.noise.source),
            hurried: live && !self.patient && self.unfinished < MOST_UNFINISHED,
            turn: self.turn,
        };
        let seeds: Discs = seeds.take(MOST_TOUCHES).map(|at| job.options.seed(at)).collect();
        self.find(&job, &mut reduce, &seeds)?;
        let fitted = &mut self.fitted;
        if let Some(placement) = &self.placement {
            for t in &mut fitted.touches {
                let [x, y] = placement.variance(&self.imager, [t.x_mm, t.y_mm]);
                t.x_sd_mm = t.x_sd_mm.map(|sd| sd.hypot(x.sqrt()));
                t.y_sd_mm = t.y_sd_mm.map(|sd| sd.hypot(y.sqrt()));
            }
        }
        let unexplained = (fitted.misfit - 1.0) / data.gain;
        if !(fitted.followed && self.least_unexplained.0 <= unexplained) {
            self.least_unexplained = (unexplained, data.gain);
        }
        let explained = fitted.misfit <= data.gain * MOST_MISFIT || fitted.residual <= MOST_RESIDUAL;
        self.unfinished = if fitted.finished { 0 } else { self.unfinished + 1 };
        self.follows = explained || !fitted.finished;
        self.follows.then_some(&self.fitted)
    }

    /// Fits by the linear model, without what that leaves out as far as it is known from the frame before or worth a solution.
    fn find(&mut self, job: &Job, reduce: &mut impl FnMut(&[f64], &mut Vec<f64>), seeds: &[Disc]) -> Option<()> {
        std::mem::swap(&mut self.before, &mut self.fitted);
        let follows = std::mem::replace(&mut self.follows, false);
        if job.data.gain <= 1.0 {
            self.in_vain = None;
        }
        self.correction = self.correction.take().filter(|_| follows);
        let scale = self.correction.as_ref().map(|c| c.scale(&self.before.discs));
        let carried = scale.map(|scale| (scale, self.take_off(job, reduce, scale)));
        // Where the linear model's error shows, no touch may be added for it before it is corrected.
        let norm = job.data.values.iter().map(|v| v * v).sum::<f64>().sqrt() / job.data.noise.sigma;
        let shows = carried.is_none() && LINEAR_ERROR * norm > SHOWS;
        let model_error = job.options.model_error;
        let frame = match carried {
            Some(_) => job.frame(&self.corrected, model_error),
            None => job.frame(job.data.values, if shows { LINEAR_ERROR } else { model_error }),
        };
        let first = start(seeds, &self.before, follows.then_some(self.least_misfit(job)), job.turn);
        fit(
            job.table,
            &job.options,
            frame,
            first,
            &mut self.scratch,
            &mut self.fitted,
        )?;
        if let Some((scale, size)) = carried
            && self.fitted.followed
        {
            return self.renew(job, reduce, scale, size);
        }
        if self.expected_error() > WORTH_A_SOLUTION {
            self.correct(job, reduce)?;
            // That was asked in the first of several frames.
            let merged = merged(&self.fitted.discs, job.options.radius_mm).filter(|_| job.data.gain <= 1.0);
            if let Some(discs) = merged {
                // One or two is told by what both come to in the end.
                let job = &Job { hurried: false, ..*job };
                if !self.fitted.settled {
                    self.correct(job, reduce)?;
                }
                let (two, correction) = (self.fitted.clone(), self.correction.clone());
                self.fitted = Fitted { discs, ..two.clone() };
                self.fitted.followed = false;
                let better = self.correct(job, reduce).is_some() && self.fitted.misfit < two.misfit;
                if !better {
                    (self.fitted, self.correction) = (two, correction);
                }
            }
        } else if shows || carried.is_some() {
            self.correction = None;
            self.again(job, job.frame(job.data.values, model_error))?;
        }
        Some(())
    }

    /// Takes what is left out, so many times, off the data: `corrected`. Returns its norm over the noise.
    fn take_off(&mut self, job: &Job, reduce: &mut impl FnMut(&[f64], &mut Vec<f64>), scale: f64) -> f64 {
        self.left_out.clear();
        if let Some(correction) = &self.correction {
            reduce(correction.volts(), &mut self.left_out);
        }
        self.left_out.resize(job.data.values.len(), 0.0);
        self.corrected.clear();
        let corrected = job.data.values.iter().zip(&self.left_out).map(|(v, m)| v - scale * m);
        self.corrected.extend(corrected);
        scale * self.left_out.iter().map(|v| v * v).sum::<f64>().sqrt() / job.data.noise.sigma
    }

    /// Solves anew for touches that were followed where what was taken off is not theirs any more.
    fn renew(
        &mut self,
        job: &Job,
        reduce: &mut impl FnMut(&[f64], &mut Vec<f64>),
        scale: f64,
        size: f64,
    ) -> Option<()> {
        // What no correction explains hides errors as noise does.
        let serves = |c: &Correction, fitted: &Fitted, scale, size| {
            size * c.error(&fitted.discs, scale) <= CARRIED_ERROR * fitted.misfit.max(1.0).sqrt()
        };
        self.fitted.settled = serves(self.correction.as_ref()?, &self.fitted, scale, size);
        // Once a solution has brought nothing, none does for the mean of more frames of the same.
        let mean = job.data.gain > 1.0;
        let unexplained = (self.fitted.misfit - 1.0) / job.data.gain;
        self.fitted.settled |= self.in_vain.is_some_and(|then| unexplained <= AS_MUCH * then);
        if !self.fitted.settled {
            let before = self.fitted.misfit;
            let Some(correction) = self.solve() else {
                return Some(());
            };
            self.correction = Some(correction);
            let size = self.take_off(job, reduce, 1.0);
            let corrected = std::mem::take(&mut self.corrected);
            let again = self.again(job, job.frame(&corrected, job.options.model_error));
            self.corrected = corrected;
            again?;
            self.fitted.settled = serves(self.correction.as_ref()?, &self.fitted, 1.0, size);
            let unexplained = (self.fitted.misfit - 1.0) / job.data.gain;
            let in_vain = mean && self.fitted.misfit > UNEXPLAINED.max(LITTLE_LESS * before);
            self.in_vain = in_vain.then_some(unexplained);
        }
        if self.expected_error() <= STILL_WORTH * WORTH_A_SOLUTION {
            self.correction = None;
        }
        Some(())
    }

    /// The misfit that these data would have if they were explained as well as the best before.
    fn least_misfit(&self, job: &Job) -> f64 {
        let (least, gain) = self.least_unexplained;
        // What was told of one frame is told less well than the mean's.
        let scatter = if job.data.gain > gain { SCATTER / gain } else { 0.0 };
        1.0 + job.data.gain * (least + scatter)
    }

    /// What the linear model leaves out of what was fitted last.
    fn solve(&mut self) -> Option<Correction> {
        if self.beyond.is_none() {
            self.beyond = Beyond::new(&self.imager.model, self.imager.drive, &self.imager.pattern);
        }
        self.solutions += 1;
        Correction::solve(self.beyond.as_mut()?, &self.volts, &self.fitted.discs)
    }

    /// About what the linear model leaves out of what was fitted last, in standard deviations of the noise.
    fn expected_error(&self) -> f64 {
        nonlinear::expected(&self.fitted.discs, &self.fitted.norms, &self.imager.outline_mm)
    }

    /// Takes what the touches fitted last leave out off the data and fits again, until that changes nothing any more.
    fn correct(&mut self, job: &Job, reduce: &mut impl FnMut(&[f64], &mut Vec<f64>)) -> Option<()> {
        // The next frame goes on with what is left out.
        for round in 0..if job.hurried { 1 } else { MOST_ROUNDS } {
            if round > 0 && self.expected_error() <= WORTH_A_SOLUTION {
                self.fitted.settled = true;
                break;
            }
            self.correction = Some(self.solve()?);
            self.take_off(job, reduce, 1.0);
            let corrected = std::mem::take(&mut self.corrected);
            let again = self.again(job, job.frame(&corrected, job.options.model_error));
            self.corrected = corrected;
            again?;
            self.fitted.settled = settled(&self.before, &self.fitted);
            if self.fitted.settled {
                break;
            }
        }
        Some(())
    }

    /// Fits from what was fitted last.
    fn again(&mut self, job: &Job, frame: Frame) -> Option<()> {
        std::mem::swap(&mut self.before, &mut self.fitted);
        let before = &self.before;
        let follow = before.followed.then_some(self.least_misfit(job));
        let start = start(&before.discs, before, follow, job.turn);
        fit(
            job.table,
            &job.options,
            frame,
            start,
            &mut self.scratch,
            &mut self.fitted,
        )
    }

    /// What a touch must bring, kept for as long as the noise is told as well.
    fn drop(&mut self, table: &TouchTable, source: NoiseSource) -> f64 {
        match self.drop {
            Some((known, drop)) if known == source => drop,
            _ => {
                let drop = model_order::drop(table, &self.options, source.freedom());
                self.drop = Some((source, drop));
                drop
            }
        }
    }
}

/// The discs with one of the expected size in place of the two nearest to each other, where one of these is too strong to be
/// believed: a strong touch takes much of the data with it, and what the linear model gets wrong of it can look like two.
fn merged(discs: &Discs, radius_mm: f64) -> Option<Discs> {
    let apart = |p: &Disc, q: &Disc| (p.at[0] - q.at[0]).hypot(p.at[1] - q.at[1]);
    let pairs = (0..discs.len()).flat_map(|i| (0..i).map(move |k| (k, i)));
    let (k, i) = pairs
        .filter(|(k, i)| discs[*k].contrast().max(discs[*i].contrast()) > TOO_STRONG)
        .filter(|(k, i)| apart(&discs[*k], &discs[*i]) < 2.0 * radius_mm)
        .min_by(|p, q| apart(&discs[p.0], &discs[p.1]).total_cmp(&apart(&discs[q.0], &discs[q.1])))?;
    let (one, other) = (discs[k], discs[i]);
    let strength = one.strength + other.strength;
    let share = other.strength / strength;
    let mut merged = discs.clone();
    merged[k] = Disc {
        at: std::array::from_fn(|c| one.at[c] + share * (other.at[c] - one.at[c])),
        radius: radius_mm,
        strength,
    };
    merged.remove(i);
    Some(merged)
}

/// Where a fit begins: at these places, or following an earlier one.
fn start<'a>(seeds: &'a [Disc], from: &'a Fitted, least_misfit: Option<f64>, turn: usize) -> Start<'a> {
    let before = |misfit| Before {
        discs: &from.all,
        misfit,
        finished: from.finished,
        turn,
    };
    Start {
        seeds,
        before: least_misfit.map(before),
    }
}

/// Whether a correction changed nothing that matters.
fn settled(before: &Fitted, after: &Fitted) -> bool {
    before.touches.len() == after.touches.len()
        && before
            .touches
            .iter()
            .zip(&after.touches)
            .all(|(a, b)| (a.total_mm2 - b.total_mm2).abs() <= SETTLED * b.total_mm2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Drive, Pattern, Sheet};
    use nalgebra::DVector;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    fn fitter() -> Fitter {
        let pattern = Pattern::adjacent(16).unwrap();
        let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 5.0).unwrap());
        Fitter::new(&imager, FitOptions::for_extent(97.5)).unwrap()
    }

    #[test]
    fn two_of_which_one_is_too_strong_are_merged_where_they_weigh() {
        let disc = |x: f64, radius: f64, strength| Disc {
            at: [x, 3.0],
            radius,
            strength,
        };
        // 1.7 and 0.2 of their areas.
        let (strong, weak) = (
            disc(0.0, 5.0, 1.7 * std::f64::consts::PI * 25.0),
            disc(18.0, 12.0, 0.2 * std::f64::consts::PI * 144.0),
        );
        let far = disc(-70.0, 12.0, 100.0);
        let discs: Discs = [strong, far, weak].into_iter().collect();
        let found = merged(&discs, 12.5).unwrap();
        assert_eq!(found.len(), 2);
        assert!(found.contains(&far));
        let one = found.iter().find(|d| **d != far).unwrap();
        let strength = strong.strength + weak.strength;
        assert!((one.strength - strength).abs() < 1e-9 && one.radius == 12.5);
        assert!((one.at[0] * strength - 18.0 * weak.strength).abs() < 1e-9 && (one.at[1] - 3.0).abs() < 1e-12);
        // Nobody near, or none too strong.
        assert!(merged(&[strong, far].into_iter().collect(), 12.5).is_none());
        assert!(merged(&[weak, disc(10.0, 12.0, 100.0)].into_iter().collect(), 12.5).is_none());
    }

    /// Discs of the linear model itself, with noise of one part in ten thousand of their answer.
    fn data(table: &TouchTable, discs: &[Disc], seed: u64) -> (DVector<f64>, f64) {
        let n = table.length();
        let mut sum = DVector::zeros(n);
        for d in discs {
            let mut out: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
            let [a, b, c, e] = &mut out;
            table.at(d.at, d.radius, [a, b, c, e]);
            sum += DVector::from_column_slice(&out[0][..n]) * d.strength;
        }
        let sigma = if discs.is_empty() {
            1e-6
        } else {
            1e-4 * sum.norm() / (n as f64).sqrt()
        };
        let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
        (sum.map(|v| v + sigma * rng.sample::<f64, _>(StandardNormal)), sigma)
    }

    fn fitted(f: &Fitter, values: &DVector<f64>, sigma: f64, drop: f64, seeds: &[Disc]) -> Option<Fitted> {
        let frame = Frame {
            values: values.as_slice(),
            sigma,
            drop,
            error: 0.0,
            most_work: usize::MAX,
        };
        let mut found = Fitted::default();
        let start = Start { seeds, before: None };
        fit(f.volts(), &f.options, frame, start, &mut Scratch::default(), &mut found)?;
        Some(found)
    }

    #[test]
    fn discs_of_the_model_come_back() {
        let f = fitter();
        let truth = [
            Disc {
                at: [-30.0, 22.0],
                radius: 11.0,
                strength: 60.0,
            },
            Disc {
                at: [25.0, -41.0],
                radius: 14.0,
                strength: 90.0,
            },
        ];
        let (values, sigma) = data(f.volts(), &truth, 1);
        let options = f.options;
        let drop = model_order::drop(f.volts(), &options, 89.0);
        // From a wrong number of touches in wrong places.
        for seeds in [
            vec![],
            vec![[0.0, 0.0]],
            vec![[-25.0, 25.0], [30.0, -30.0], [60.0, 60.0]],
        ] {
            let seeds: Vec<Disc> = seeds.into_iter().map(|at| options.seed(at)).collect();
            let found = fitted(&f, &values, sigma, drop, &seeds).unwrap();
            assert_eq!(found.discs.len(), 2, "{seeds:?} {found:?}");
            for t in &truth {
                let near = found
                    .discs
                    .iter()
                    .map(|d| (d.at[0] - t.at[0]).hypot(d.at[1] - t.at[1]))
                    .fold(f64::INFINITY, f64::min);
                assert!(near < 0.02, "{seeds:?}: {near}");
            }
            assert!((0.5..1.5).contains(&found.misfit), "{}", found.misfit);
        }
    }

    /// Two strong touches side by side that move and grow a little from frame to frame: what the linear model leaves out is solved for now
    /// and then, and the touches are where they would be without the frames before.
    #[test]
    fn what_is_left_out_is_carried_from_frame_to_frame() {
        let (mut f, mut alone) = (fitter(), fitter());
        alone.set_patient(true);
        let table = f.volts.clone();
        let mut beyond = Beyond::new(&f.imager.model, f.imager.drive, &f.imager.pattern).unwrap();
        let at = |frame: usize| {
            let k = frame as f64;
            let disc = |x: f64, y, rise: f64| Disc {
                at: [x, y],
                radius: 12.5,
                strength: 2.0 * rise / (2.0 + rise) * std::f64::consts::PI * 12.5 * 12.5,
            };
            [
                disc(-20.0 + 0.2 * k, 30.0, 0.8 + 0.01 * k),
                disc(22.0, 30.0 - 0.1 * k, 0.8),
            ]
        };
        let mut rng = rand::rngs::StdRng::seed_from_u64(6);
        let reduce = |volts: &[f64], out: &mut Vec<f64>| out.extend_from_slice(volts);
        let (mut sigma, mut first) = (0.0, 0);
        for frame in 0..40 {
            let truth = at(frame);
            let mut values = beyond.table_v(&table, &truth).unwrap();
            let (linear, _) = data(&table, &truth, 0);
            if frame == 0 {
                // What is left out comes to ten standard deviations.
                sigma = values.iter().map(|v| v * v).sum::<f64>().sqrt() / 10.0;
            }
            for (v, l) in values.iter_mut().zip(linear.iter()) {
                *v += l + sigma * rng.sample::<f64, _>(StandardNormal);
            }
            let noise = NoiseEstimate {
                sigma,
                source: NoiseSource::Known,
            };
            let data = Data {
                values: &values,
                noise,
                gain: 1.0,
            };
            let found = f.fit(&table, reduce, data, truth.iter().map(|d| d.at)).unwrap().clone();
            if frame == 1 {
                first = f.solutions;
            }
            assert_eq!(found.discs.len(), 2, "{frame}");
            alone.forget();
            let seeds = truth.iter().map(|d| d.at);
            let without = alone.fit(&table, reduce, data, seeds).unwrap();
            for t in &found.touches {
                let near = without.touches.iter().map(|o| (t.x_mm - o.x_mm).hypot(t.y_mm - o.y_mm));
                let (off, sd) = (
                    near.fold(f64::INFINITY, f64::min),
                    t.x_sd_mm.unwrap().hypot(t.y_sd_mm.unwrap()),
                );
                assert!(frame == 0 || off < 0.7 * sd, "{frame}: {off} mm, {sd}");
            }
            assert!(frame == 0 || found.misfit < 1.5, "{frame}: {}", found.misfit);
        }
        let later = f.solutions - first;
        assert!(first <= 2 && (2..=33).contains(&later), "{first} and {later} solutions");
        assert!(
            alone.solutions > 2 * f.solutions,
            "{} without the frames before",
            alone.solutions
        );
        assert!(f.correction.is_some());
        f.forget();
        assert!(f.correction.is_none());
    }

    #[test]
    fn noise_grows_no_touch() {
        let f = fitter();
        let drop = model_order::drop(f.volts(), &f.options, 89.0);
        for seed in 0..200 {
            let (values, sigma) = data(f.volts(), &[], seed);
            let seeds = [f.options.seed([10.0, 20.0])];
            let found = fitted(&f, &values, sigma, drop, &seeds).unwrap();
            assert!(found.touches.is_empty(), "{seed}: {:?}", found.touches);
        }
    }

    #[test]
    fn numbers_that_are_none_end_without_a_fit() {
        let f = fitter();
        let values = DVector::from_element(f.volts().length(), f64::NAN);
        assert_eq!(fitted(&f, &values, 1.0, 30.0, &[]), None);
        assert_eq!(fitted(&f, &DVector::zeros(3), 1.0, 30.0, &[]), None);
    }
}
