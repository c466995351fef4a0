//! How many touches there are: the data decide, one change at a time.
//!
//! A touch more must lower the misfit by more than noise would by chance anywhere on the sheet: the quantile of Fisher's
//! distribution for the four parameters of a touch, at the wanted probability divided by the number of places (sheet's area
//! over a touch's) where chance could have put it; and by more than the model may be wrong by. Where a fit still explains
//! the data less well than the noise allows, a touch must have taken away more than is left: what a wrong model leaves
//! can be lessened by touches that are not there, but not made to go.
//!
//! Touches that move a little from frame to frame are followed: a few steps from where they were, a look at the residual for what is new,
//! and one of the changes that would make them fewer, in turn. Only where that does not explain the frame as well as the one
//! before, the search begins again. A search has a limit; one that reaches it goes on in the next frame.

use crate::touches::fit::interpolation::{add_scaled, dot};
use crate::touches::fit::levenberg_marquardt::{FEW_STEPS, Fit, MOST_STEPS, PARAMETERS, Workspace, fit};
use crate::touches::fit::responses::TouchTable;
use crate::touches::fit::{Disc, Discs, FitOptions};
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
/// A touch that is followed moves at most this part of its expected radius from one frame to the next.
const LONGEST_MOVE: f64 = 0.6;
/// A frame is explained as well as those before when its misfit is no more than this many times theirs.
const AS_WELL: f64 = 1.3;
/// Part of what makes a touch believed that is enough for one that was there in the frame before: touches stay far longer than a
/// frame.
const TO_STAY: f64 = 0.35;

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
    /// What fits may still cost, in evaluations of a touch.
    left: usize,
}

/// Where a search begins besides the picture's peaks.
#[derive(Clone, Copy, Debug)]
pub struct Before<'a> {
    /// The touches of the frame before.
    pub discs: &'a [Disc],
    /// The least misfit (mean square of the residual per degree of freedom) since they were searched for.
    pub misfit: f64,
    /// Whether that search came to its end.
    pub finished: bool,
    /// Counts the frames: says which of the changes is tried.
    pub turn: usize,
}

/// What a search ends with.
pub struct Found {
    /// The touches.
    pub fit: Fit,
    /// Whether they are those of the frame before.
    pub followed: bool,
    /// Whether the search came to its end.
    pub finished: bool,
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
pub fn drop(table: &TouchTable, options: &FitOptions, freedom: f64) -> f64 {
    let places = 4.0 * table.coarse_norms().len() as f64 * table.step_mm().powi(2)
        / (std::f64::consts::PI * options.radius_mm.powi(2));
    let level = 1.0 - options.false_touch / places.max(1.0);
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
            left: usize::MAX,
        })
    }

    fn freedom(&self, fit: &Fit) -> f64 {
        (self.table.length() as f64 - 3.0 * fit.discs.len() as f64).max(1.0)
    }

    /// Part of a fit's misfit that noise does not explain.
    fn unexplained(&self, fit: &Fit) -> f64 {
        let freedom = self.freedom(fit);
        // The misfit scatters by chance; only what is above three of its standard deviations counts.
        (fit.square - freedom - 3.0 * (2.0 * freedom).sqrt()).max(0.0)
    }

    /// What a further touch must bring, so that this fit is the better one.
    fn need(&self, more: &Fit) -> f64 {
        self.drop + OF_UNEXPLAINED * self.unexplained(more)
    }

    /// Whether a fit with more touches is worth them.
    fn earns(&self, fewer: &Fit, more: &Fit) -> bool {
        self.earns_part(fewer, more, 1.0)
    }

    /// Whether it brings this part of what makes its touches believed.
    fn earns_part(&self, fewer: &Fit, more: &Fit, part: f64) -> bool {
        let touches = more.discs.len().saturating_sub(fewer.discs.len()) as f64;
        !overlap(&more.discs) && fewer.objective - more.objective > part * touches * self.need(more)
    }

    /// A fit from a start; none beyond what the search may cost.
    fn fit(&mut self, start: &[Disc]) -> Option<Fit> {
        if self.left == 0 {
            return None;
        }
        self.fit_in(start, MOST_STEPS)
    }

    fn fit_in(&mut self, start: &[Disc], most_steps: usize) -> Option<Fit> {
        let work = &mut self.scratch.work;
        let fit = fit(self.table, self.options, self.data, start, most_steps, work)?;
        self.left = self.left.saturating_sub(fit.work);
        Some(fit)
    }

    /// Limits what the search may cost, in evaluations of the answer to a touch.
    pub fn within(self, most_work: usize) -> Self {
        Self {
            left: most_work,
            ..self
        }
    }

    /// Finds the touches, from a picture's peaks and the touches of the frame before.
    pub fn run(mut self, seeds: &[Disc], before: Option<Before>) -> Option<Found> {
        let mut rival = None;
        if let Some(before) = before.filter(|b| !b.discs.is_empty()) {
            let fit = self.fit_in(before.discs, FEW_STEPS)?;
            if self.are_those(&before, &fit) {
                let (fit, followed) = self.followed(fit, before.turn);
                return Some(self.found(fit, followed));
            }
            rival = Some(fit);
        }
        let most = self.options.most_touches.min(Discs::new_const().capacity());
        let mut start: Discs = seeds.iter().copied().take(most).collect();
        self.strengthen(&mut start);
        let mut best = self.fit_in(&start, MOST_STEPS)?;
        // Whatever has changed, most of it may have stayed.
        if let Some(mut rival) = rival {
            let cost = |fit: &Fit| fit.objective + self.drop * fit.discs.len() as f64;
            if cost(&rival) < cost(&best) {
                std::mem::swap(&mut best, &mut rival);
            }
            self.scratch.work.put(rival);
        }
        let fit = self.improved(best);
        Some(self.found(fit, false))
    }

    fn found(&self, fit: Fit, followed: bool) -> Found {
        Found {
            fit,
            followed,
            finished: self.left > 0,
        }
    }

    /// Changes the number of touches until no change is worth it.
    fn improved(&mut self, mut best: Fit) -> Fit {
        for _ in 0..MOST_CHANGES {
            let fewer = self.fewer(&best, None);
            let Some(next) = fewer.or_else(|| self.more(&best)) else {
                break;
            };
            self.scratch.work.put(std::mem::replace(&mut best, next));
        }
        best
    }

    /// Whether a fit from the touches of the frame before is of the same ones: none went far, and they explain as much.
    fn are_those(&self, before: &Before, fit: &Fit) -> bool {
        let far = LONGEST_MOVE * self.options.radius_mm;
        let near = |(a, b): (&Disc, &Disc)| (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1]) <= far;
        let freedom = self.freedom(fit);
        // By chance the misfit of either scatters.
        let most = (AS_WELL * before.misfit).max(1.0) * freedom + 3.0 * (2.0 * freedom).sqrt();
        before.finished && before.discs.iter().zip(&fit.discs).all(near) && !overlap(&fit.discs) && fit.square <= most
    }

    /// Looks whether touches that were followed have become more or fewer.
    fn followed(&mut self, fit: Fit, turn: usize) -> (Fit, bool) {
        let change = if self.news(&fit) {
            self.more(&fit)
        } else {
            self.fewer(&fit, Some(turn))
        };
        match change {
            Some(changed) => {
                self.scratch.work.put(fit);
                (self.improved(changed), false)
            }
            None => (fit, true),
        }
    }

    /// Whether the residual asks for a touch more, or for one to be split.
    fn news(&mut self, fit: &Fit) -> bool {
        let worth = WORTH_A_TRY * self.drop;
        let apart = LONGEST_MOVE * self.options.radius_mm;
        let Scratch { products, .. } = &mut *self.scratch;
        self.table.coarse_products(&fit.residual, products);
        let far = |at: &[f64; 2]| {
            fit.discs
                .iter()
                .all(|d| (d.at[0] - at[0]).hypot(d.at[1] - at[1]) > apart)
        };
        let mut places = self.table.coarse().iter().zip(products).zip(self.table.coarse_norms());
        let further = places.any(|((at, product), norm)| {
            let along = *product / norm.max(f64::MIN_POSITIVE);
            along > 0.0 && along * along > worth && far(at)
        });
        let long = |d: &Disc| {
            let split = self.table.best_split(&fit.residual, d.at);
            split.is_some_and(|(gain, _)| gain > 0.0 && gain * gain > worth)
        };
        further || fit.discs.iter().any(long)
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

    /// A fit without a touch that is not worth it, or with one in place of two. With a turn, only one of the changes is tried.
    fn fewer(&mut self, best: &Fit, turn: Option<usize>) -> Option<Fit> {
        let part = if turn.is_some() { TO_STAY } else { 1.0 };
        let need = part * self.need(best);
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
        if let Some(turn) = turn
            && !candidates.is_empty()
        {
            let one = turn % candidates.len();
            candidates.swap(0, one);
            candidates.truncate(1);
        }
        let mut chosen = None;
        for (_, discs) in &candidates {
            let Some(fewer) = self.fit(discs) else { continue };
            if self.earns_part(&fewer, best, part) {
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
