//! How many touches there are: the data decide, one change at a time.
//!
//! A touch more must lower the misfit by more than noise would by chance anywhere on the sheet: the quantile of Fisher's
//! distribution for the four parameters of a touch, at the wanted probability divided by the number of places (sheet's area
//! over a touch's) where chance could have put it; and by more than the model may be wrong by. Where a fit still explains
//! the data less well than the noise allows, a touch must have taken away more than is left: what a wrong model leaves
//! can be lessened by touches that are not there, but not made to go.

use super::kernels::{add_scaled, dot};
use super::solve::{Fit, PARAMETERS, Workspace, fit};
use super::table::TouchTable;
use super::{Disc, Discs, FitOptions};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};

/// Most changes of the number of touches in one frame.
const MOST_CHANGES: usize = 24;
/// A candidate is fitted when its place alone promises this part of the drop needed.
const WORTH_A_TRY: f64 = 0.3;
/// Part of what stays unexplained that a further touch must explain.
const OF_UNEXPLAINED: f64 = 1.5;
/// Most touches added at once.
const MOST_AHEAD: usize = 3;
/// Places tried for a further touch.
const PLACES: usize = 2;
/// Two touches nearer than this many expected radii may be one.
const NEAR: f64 = 2.6;

/// Sets of touches to try, best first.
type Candidates = Vec<(f64, Discs)>;

/// What a search needs besides the frame: nothing is allocated once it is as large as it gets.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// For the fits.
    pub(super) work: Workspace,
    /// The data over their noise.
    pub(super) whitened: Vec<f64>,
    /// Values and derivatives of a touch.
    answers: Vec<f64>,
    products: Vec<f64>,
    gains: Vec<(f64, Disc)>,
    /// Lists of candidates that are not in use.
    spare: Vec<Candidates>,
}

/// A search in one frame.
pub struct Search<'a> {
    table: &'a TouchTable,
    options: &'a FitOptions,
    /// As long as the table's columns.
    data: &'a [f64],
    /// Drop of chi-square that a touch must bring: by chance, and by the model's error.
    drop: f64,
    scratch: &'a mut Scratch,
}

/// Whether two touches lie in one another: nearer than half the sum of their radii. Fingers do not.
fn overlap(discs: &[Disc]) -> bool {
    discs.iter().enumerate().any(|(k, a)| {
        discs[..k]
            .iter()
            .any(|b| (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1]) < 0.5 * (a.radius + b.radius))
    })
}

/// The fall of chi-square that a touch must bring not to be noise, where the noise was told with so many degrees of
/// freedom.
pub fn drop(table: &TouchTable, options: &FitOptions, freedom: usize) -> f64 {
    let places = 4.0 * table.coarse_norms().len() as f64 * table.step_mm().powi(2)
        / (std::f64::consts::PI * options.radius_mm.powi(2));
    let level = 1.0 - options.false_touch / places.max(1.0);
    let freedom = (freedom as f64).clamp(1.0, 1e7);
    FisherSnedecor::new(PARAMETERS as f64, freedom).map_or(f64::INFINITY, |f| PARAMETERS as f64 * f.inverse_cdf(level))
}

impl<'a> Search<'a> {
    /// Prepares for whitened data of [`TouchTable::stride`] entries; `drop` is what a touch must bring. `None` when the
    /// lengths do not match.
    pub fn new(
        table: &'a TouchTable,
        options: &'a FitOptions,
        data: &'a [f64],
        drop: f64,
        scratch: &'a mut Scratch,
    ) -> Option<Self> {
        (data.len() == table.stride() && !data.is_empty()).then_some(Self {
            table,
            options,
            data,
            drop,
            scratch,
        })
    }

    /// Part of a fit's misfit that noise does not explain.
    fn unexplained(&self, fit: &Fit) -> f64 {
        let freedom = (self.table.length() as f64 - 3.0 * fit.discs.len() as f64).max(1.0);
        // The misfit scatters by chance; only what is above three of its standard deviations counts.
        (fit.square - freedom - 3.0 * (2.0 * freedom).sqrt()).max(0.0)
    }

    /// What a further touch must bring, so that this fit is the better one.
    fn need(&self, more: &Fit) -> f64 {
        self.drop + OF_UNEXPLAINED * self.unexplained(more)
    }

    /// Whether a fit with more touches is worth them.
    fn earns(&self, fewer: &Fit, more: &Fit) -> bool {
        let touches = more.discs.len().saturating_sub(fewer.discs.len()) as f64;
        !overlap(&more.discs) && fewer.objective - more.objective > touches * self.need(more)
    }

    fn fit(&mut self, start: &[Disc]) -> Option<Fit> {
        fit(self.table, self.options, self.data, start, &mut self.scratch.work)
    }

    /// Finds the touches, from a picture's peaks or an earlier fit.
    pub fn run(&mut self, seeds: &[Disc]) -> Option<Fit> {
        let most = self.options.most_touches.min(Discs::new_const().capacity());
        let mut start: Discs = seeds.iter().copied().take(most).collect();
        self.strengthen(&mut start);
        let mut best = self.fit(&start)?;
        for _ in 0..MOST_CHANGES {
            let fewer = self.fewer(&best);
            let Some(next) = fewer.or_else(|| self.more(&best)) else {
                break;
            };
            self.scratch.work.put(std::mem::replace(&mut best, next));
        }
        Some(best)
    }

    /// First strengths of the touches that have none, one after the other by what is left of the data.
    fn strengthen(&mut self, discs: &mut [Disc]) {
        let (n, arch) = (self.table.stride(), self.table.arch());
        let answers = &mut self.scratch.answers;
        answers.clear();
        answers.resize(5 * n, 0.0);
        let (left, rest) = answers.split_at_mut(n);
        left.copy_from_slice(self.data);
        let mut parts = rest.chunks_exact_mut(n);
        let [Some(value), Some(a), Some(b), Some(c)] = [parts.next(), parts.next(), parts.next(), parts.next()] else {
            return;
        };
        for d in discs {
            self.table.at(d.at, d.radius, [&mut *value, &mut *a, &mut *b, &mut *c]);
            let power = dot(arch, value, value).max(f64::MIN_POSITIVE);
            if d.strength <= 0.0 {
                d.strength = (dot(arch, value, left) / power).max(1.0 / power.sqrt());
            }
            add_scaled(arch, value, -d.strength, left);
        }
    }

    /// A fit without a touch that is not worth it, or with one in place of two.
    fn fewer(&mut self, best: &Fit) -> Option<Fit> {
        let need = self.need(best);
        let mut candidates = self.scratch.spare.pop().unwrap_or_default();
        let covariance = self.scratch.work.covariance(self.table.arch(), best)?;
        for (k, d) in best.discs.iter().enumerate() {
            let at = PARAMETERS * k + 3;
            let significance = d.strength.powi(2) / covariance.of(at, at).max(f64::MIN_POSITIVE);
            if significance < 3.0 * need {
                let mut discs = best.discs.clone();
                discs.remove(k);
                candidates.push((significance, discs));
            }
        }
        for (k, a) in best.discs.iter().enumerate() {
            for (other, b) in best.discs.iter().enumerate().take(k) {
                let apart = (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1]);
                if apart < NEAR * self.options.radius_mm {
                    let strength = a.strength + b.strength;
                    let share = a.strength / strength;
                    let mut discs = best.discs.clone();
                    discs[other] = Disc {
                        at: [0, 1].map(|i| share * a.at[i] + (1.0 - share) * b.at[i]),
                        radius: self.options.radius_mm.max(0.5 * apart),
                        strength,
                    };
                    discs.remove(k);
                    candidates.push((apart, discs));
                }
            }
        }
        candidates.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut chosen = None;
        for (_, discs) in &candidates {
            let Some(fewer) = self.fit(discs) else { continue };
            if self.earns(&fewer, best) {
                self.scratch.work.put(fewer);
            } else {
                chosen = Some(fewer);
                break;
            }
        }
        self.give_back(candidates);
        chosen
    }

    fn give_back(&mut self, mut candidates: Candidates) {
        candidates.clear();
        self.scratch.spare.push(candidates);
    }

    /// A fit with a further touch where that is worth it. Where several are missing one alone explains too little of what
    /// is left, so the next ones are tried with it.
    fn more(&mut self, best: &Fit) -> Option<Fit> {
        let mut reached = self.one_more(best)?;
        for ahead in 1..=MOST_AHEAD {
            if self.earns(best, &reached) {
                return Some(reached);
            }
            let gain = best.objective - reached.objective;
            if ahead == MOST_AHEAD || gain < ahead as f64 * self.drop || self.unexplained(&reached) <= 0.0 {
                break;
            }
            let Some(next) = self.one_more(&reached) else { break };
            self.scratch.work.put(std::mem::replace(&mut reached, next));
        }
        self.scratch.work.put(reached);
        None
    }

    /// The best fit with a further touch, or with a touch split in two.
    fn one_more(&mut self, best: &Fit) -> Option<Fit> {
        if best.discs.len() >= self.options.most_touches.min(best.discs.capacity()) {
            return None;
        }
        let mut candidates = self.scratch.spare.pop().unwrap_or_default();
        self.further(best, &mut candidates);
        for (k, d) in best.discs.iter().enumerate() {
            let split = self.split(best, k, d);
            candidates.extend(split.map(|discs| (0.0, discs)));
        }
        let mut chosen: Option<Fit> = None;
        for (_, discs) in &candidates {
            let Some(more) = self.fit(discs) else { continue };
            let better = !overlap(&more.discs) && chosen.as_ref().is_none_or(|c| more.objective < c.objective);
            let other = if better { chosen.replace(more) } else { Some(more) };
            other.into_iter().for_each(|fit| self.scratch.work.put(fit));
        }
        self.give_back(candidates);
        chosen
    }

    /// The touches with one more where the residual asks for it most.
    fn further(&mut self, best: &Fit, candidates: &mut Candidates) {
        let apart = 0.8 * self.options.radius_mm;
        let far = |at: [f64; 2], others: &[Disc], least: f64| {
            others.iter().all(|o| (o.at[0] - at[0]).hypot(o.at[1] - at[1]) > least)
        };
        let Scratch { products, gains, .. } = &mut *self.scratch;
        self.table.coarse_products(&best.residual, products);
        gains.clear();
        for ((at, product), norm) in self.table.coarse().iter().zip(products).zip(self.table.coarse_norms()) {
            let along = *product / norm.max(f64::MIN_POSITIVE);
            if along > 0.0 && along * along > WORTH_A_TRY * self.drop {
                let strength = along / norm;
                gains.push((
                    along,
                    Disc {
                        strength,
                        ..self.options.seed(*at)
                    },
                ));
            }
        }
        gains.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
        let mut chosen = Discs::new();
        for (_, d) in gains {
            if chosen.len() == PLACES {
                break;
            }
            if far(d.at, &best.discs, apart) && far(d.at, &chosen, 2.0 * self.options.radius_mm) {
                chosen.push(*d);
            }
        }
        for d in chosen {
            let mut discs = best.discs.clone();
            if discs.try_push(d).is_ok() {
                candidates.push((0.0, discs));
            }
        }
    }

    /// The touches with one split along the direction in which the residual says it is long.
    fn split(&self, best: &Fit, k: usize, d: &Disc) -> Option<Discs> {
        let (gain, direction) = self.table.best_split(&best.residual, d.at)?;
        if gain <= 0.0 || gain * gain < 0.3 * WORTH_A_TRY * self.drop {
            return None;
        }
        let mut discs = best.discs.clone();
        let [a, b] = self.table.split(d.at, direction).map(|at| Disc {
            strength: 0.5 * d.strength,
            ..self.options.seed(at)
        });
        discs[k] = a;
        discs.try_push(b).ok()?;
        Some(discs)
    }
}
