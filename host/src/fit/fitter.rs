//! Fits frame after frame: keeps what only depends on the sheet, and goes beyond the linear model where it shows.

use super::beyond::{self, Beyond};
use super::order::{self, Before, Scratch};
use super::placement::Placement;
use super::table::TouchTable;
use super::{Disc, Discs, FitOptions, Fitted, Frame, MOST_TOUCHES, Start, fit};
use crate::imager::Imager;
use crate::noise::NoiseEstimate;
use nalgebra::DVector;
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
    /// Standard deviation of one of them, V.
    pub sigma: f64,
    /// What that was told from; none where it is a guess.
    pub noise: Option<NoiseEstimate>,
}

/// Fits touches to the frames of one imager.
pub struct Fitter {
    options: FitOptions,
    imager: Arc<Imager>,
    /// Answers to touches, V of the model.
    volts: TouchTable,
    /// Made when a frame first needs it.
    beyond: Option<Beyond>,
    /// What the electrodes' uncertainty adds to that of touches.
    placement: Option<Placement>,
    /// Degrees of freedom of the noise, and what a touch must bring at them.
    drop: Option<(usize, f64)>,
    scratch: Scratch,
    fitted: Fitted,
    before: Fitted,
    /// Whether `fitted` is what the next frame is to be followed from, and how many frames there were.
    follows: bool,
    turn: usize,
    /// The least misfit since the touches were searched for.
    least_misfit: f64,
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
            drop: None,
            scratch: Scratch::default(),
            fitted: Fitted::default(),
            before: Fitted::default(),
            follows: false,
            turn: 0,
            least_misfit: f64::INFINITY,
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
        reduce: impl Fn(&DVector<f64>) -> DVector<f64>,
        data: Data,
        seeds: impl Iterator<Item = [f64; 2]>,
    ) -> Option<&Fitted> {
        let options = self.options;
        let drop = self.drop(table, data.noise.map_or(1, |n| n.freedom));
        let live = data.noise.is_some_and(|n| n.freedom == usize::MAX);
        let limited = live && self.unfinished < MOST_UNFINISHED;
        let frame = |error| Frame {
            values: data.values,
            sigma: data.sigma,
            drop,
            error,
            most_work: if limited { options.most_work } else { usize::MAX },
        };
        self.turn = self.turn.wrapping_add(1);
        let follows = std::mem::replace(&mut self.follows, false);
        let Self {
            scratch,
            fitted,
            before,
            beyond,
            imager,
            volts,
            turn,
            least_misfit,
            ..
        } = self;
        let seeds: Discs = seeds.take(MOST_TOUCHES).map(|at| options.seed(at)).collect();
        // Where the linear model's error shows, no touch may be added for it before it is corrected.
        let norm = data.values.iter().map(|v| v * v).sum::<f64>().sqrt() / data.sigma;
        let shows = LINEAR_ERROR * norm > SHOWS;
        let first = if shows { LINEAR_ERROR } else { options.model_error };
        std::mem::swap(before, fitted);
        fit(
            table,
            &options,
            frame(first),
            start(&seeds, before, follows.then_some(*least_misfit), *turn),
            scratch,
            fitted,
        )?;
        let wrong = |f: &Fitted| beyond::expected(&f.discs, &f.norms, &imager.outline_mm) > WORTH_A_SOLUTION;
        let follow = |before: &Fitted| before.followed.then_some(*least_misfit);
        if wrong(fitted) {
            if beyond.is_none() {
                *beyond = Beyond::new(&imager.model, imager.drive, &imager.pattern);
            }
            let beyond = beyond.as_mut()?;
            let mut correct = |before: &mut Fitted, fitted: &mut Fitted| {
                for round in 0..MOST_ROUNDS {
                    if round > 0 && !wrong(fitted) {
                        break;
                    }
                    let more = reduce(&DVector::from_vec(beyond.table_v(volts, &fitted.discs)?));
                    let corrected: Vec<f64> = data.values.iter().zip(&more).map(|(v, m)| v - m).collect();
                    std::mem::swap(before, fitted);
                    let frame = Frame {
                        values: &corrected,
                        ..frame(options.model_error)
                    };
                    let start = start(&before.discs, before, follow(before), *turn);
                    fit(table, &options, frame, start, scratch, fitted)?;
                    if settled(before, fitted) {
                        break;
                    }
                }
                Some(())
            };
            correct(before, fitted)?;
            if let Some(discs) = merged(&fitted.discs, options.radius_mm) {
                let two = fitted.clone();
                *fitted = Fitted { discs, ..two.clone() };
                fitted.followed = false;
                let better = correct(before, fitted).is_some() && fitted.misfit < two.misfit;
                if !better {
                    *fitted = two;
                }
            }
        } else if shows {
            std::mem::swap(before, fitted);
            let start = start(&before.discs, before, follow(before), *turn);
            fit(table, &options, frame(options.model_error), start, scratch, fitted)?;
        }
        if let Some(placement) = &self.placement {
            for t in &mut fitted.touches {
                let [x, y] = placement.variance(imager, [t.x_mm, t.y_mm]);
                t.x_sd_mm = t.x_sd_mm.map(|sd| sd.hypot(x.sqrt()));
                t.y_sd_mm = t.y_sd_mm.map(|sd| sd.hypot(y.sqrt()));
            }
        }
        let least = if fitted.followed { *least_misfit } else { f64::INFINITY };
        *least_misfit = fitted.misfit.min(least);
        let explained = fitted.misfit <= MOST_MISFIT || fitted.residual <= MOST_RESIDUAL;
        self.unfinished = if fitted.finished { 0 } else { self.unfinished + 1 };
        self.follows = explained || !fitted.finished;
        self.follows.then_some(&self.fitted)
    }

    /// What a touch must bring, kept for as long as the noise is told as well.
    fn drop(&mut self, table: &TouchTable, freedom: usize) -> f64 {
        match self.drop {
            Some((known, drop)) if known == freedom => drop,
            _ => {
                let drop = order::drop(table, &self.options, freedom);
                self.drop = Some((freedom, drop));
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
        let drop = order::drop(f.volts(), &options, 89);
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

    #[test]
    fn noise_grows_no_touch() {
        let f = fitter();
        let drop = order::drop(f.volts(), &f.options, 89);
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
