//! Model order selection: the data decide how many touches there are, one change at a time.
//!
//! An additional touch must lower chi-square by the sum of three parts:
//!
//! - [`chi_square_threshold`]: more than noise would by chance anywhere on the sheet;
//! - what the model may be wrong by;
//! - a multiple of what stays unexplained. A wrong model leaves a residual that touches can lessen and cannot remove.
//!
//! Touches that move a little from frame to frame are followed. A few steps lead from where they were to where they
//! are. The residual is searched for new touches, and one of the changes that would make them fewer is tried, in turn.
//! The search begins again only where that does not explain the frame as well as the frame before. A search has a
//! limit; one that reaches the limit goes on in the next frame.

use crate::stats::fisher_quantile;
use crate::touches::fit::disc::{Disc, Discs};
use crate::touches::fit::frame_fit::Seeds;
use crate::touches::fit::interpolation::{add_scaled, dot};
use crate::touches::fit::levenberg_marquardt::{Fit, LevenbergMarquardtOptions, PARAMETERS, Workspace, fit};
use crate::touches::fit::prior::FitOptions;
use crate::touches::fit::responses::ResponseTable;
use crate::touches::polarity::Polarity;

/// When touches are added, split, merged, removed and followed.
///
/// No experiment is on record for a single field: the values were chosen by hand, on the seeds that docs/results.md
/// names. What they give together is the column "count right" of `cargo run --release -p studies --example
/// touch_accuracy`; what following costs is the column `median` of `skin bench cost`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelOrderOptions {
    /// Most changes of the number of touches in one frame. Fewer end the search for many touches early.
    pub most_changes: usize,
    /// Part of the chi-square threshold that a place alone must promise before a touch there is fitted. More saves fits
    /// and misses touches that only show once the others have moved.
    pub worth_a_try: f64,
    /// The same for a split, as a part of `worth_a_try`: a split gains most of what it brings only when both halves
    /// move.
    pub split_worth: f64,
    /// Part of the unexplained chi-square that an additional touch must bring besides the threshold. More adds fewer
    /// touches where touches are no discs, and finds fewer where several are missing.
    pub of_unexplained: f64,
    /// Most touches added at once, where one alone explains too little. More costs time in frames that no touches
    /// explain.
    pub most_ahead: usize,
    /// Places tried for an additional touch. More costs time.
    pub places: usize,
    /// Least distance of an additional touch from the others, in expected radii.
    pub apart: f64,
    /// Two touches nearer than this many expected radii may be one: a fit with one is tried. More costs time.
    pub near: f64,
    /// A touch is tried to be removed where its significance is below this many times what it must bring.
    pub removal_worth: f64,
    /// Two touches overlap, and are rejected, when nearer than this part of the sum of their radii. Fingers do not
    /// overlap. A fall and a rise may, away from the rim.
    pub overlap: f64,
    /// Longest move of a followed touch from one frame to the next, in expected radii. More follows faster touches, and
    /// may take another touch for the same.
    pub longest_move: f64,
    /// A frame is explained as well as those before when its misfit is at most this many times theirs. Less searches
    /// anew more often, which costs time.
    pub as_well: f64,
    /// Part of what an additional touch must bring that is enough for a followed touch to stay. Less keeps touches that
    /// have gone; more lets weak touches come and go. Touches stay far longer than a frame.
    pub to_stay: f64,
    /// Of the fits.
    pub steps: LevenbergMarquardtOptions,
}

impl Default for ModelOrderOptions {
    fn default() -> Self {
        Self {
            most_changes: 24,
            worth_a_try: 0.3,
            split_worth: 0.3,
            of_unexplained: 1.5,
            most_ahead: 3,
            places: 2,
            apart: 0.8,
            near: 2.6,
            removal_worth: 3.0,
            overlap: 0.5,
            longest_move: 0.6,
            as_well: 1.3,
            to_stay: 0.35,
            steps: LevenbergMarquardtOptions::default(),
        }
    }
}

/// What touches are fitted with.
#[derive(Clone, Copy, Debug)]
pub struct DiscModel<'a> {
    /// Responses in the space of the data.
    pub table: &'a ResponseTable,
    /// What is known of touches before.
    pub prior: &'a FitOptions,
    /// How their number is chosen.
    pub order: &'a ModelOrderOptions,
}

/// Expected radii from the rim from which a fall and a rise may lie in one another.
const FROM_RIM: f64 = 2.0;

/// Standard deviation of chi-square with so many degrees of freedom.
fn scatter(freedom: f64) -> f64 {
    (2.0 * freedom).sqrt()
}

/// Sets of touches to try, best first.
type Candidates = Vec<(f64, Discs)>;

/// Room for a search. Nothing is allocated once it is as large as it gets.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// For the fits.
    pub(super) work: Workspace,
    /// The data over their noise.
    pub(super) whitened: Vec<f64>,
    /// A residual, then the response to a touch and its derivatives.
    responses: Vec<f64>,
    products: Vec<f64>,
    gains: Vec<(f64, Disc)>,
    /// Lists of sets that are not in use.
    spare: Vec<Candidates>,
}

/// A search in one frame.
pub struct Search<'a> {
    model: DiscModel<'a>,
    /// The data over their noise, as long as the table's columns.
    data: &'a [f64],
    /// Fall of chi-square that a touch must bring: by chance, and by the model's error.
    chi_square_threshold: f64,
    scratch: &'a mut Scratch,
    polarity: Polarity,
    /// What the search may cost, in evaluations of the response to one touch.
    most_work: usize,
    /// What its fits have cost.
    fits: usize,
    /// What the table had taken before.
    summing: f64,
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
    /// Number of the frame: it says which of the changes is tried.
    pub turn: usize,
}

/// What a search ends with.
pub struct Found {
    /// The touches.
    pub fit: Fit,
    /// Whether they are those of the frame before.
    pub followed: bool,
    /// Whether the search came to its end, or there was none.
    pub finished: bool,
    /// Whether there was no search, since no touches would explain the frame: none are found.
    pub hopeless: bool,
    /// What it cost, in evaluations of the response to one touch.
    pub work: usize,
}

/// Fall of chi-square that an additional touch must bring not to be noise: the quantile of Fisher's distribution for
/// the four parameters of a touch. The probability is that of a false touch over the number of places (sheet's area
/// over a touch's) where chance could have put it. `freedom` is the noise's number of degrees of freedom.
pub fn chi_square_threshold(table: &ResponseTable, options: &FitOptions, freedom: f64) -> f64 {
    let places = table.area_mm2() / (std::f64::consts::PI * options.radius_mm.powi(2));
    let level = 1.0 - options.false_touch / places.max(1.0);
    fisher_quantile(PARAMETERS as f64, freedom, level).map_or(f64::INFINITY, |f| PARAMETERS as f64 * f)
}

impl<'a> Search<'a> {
    /// Prepares for whitened data of [`ResponseTable::stride`] entries. `chi_square_threshold` is what a touch must
    /// bring. `None` when the lengths do not match.
    pub fn new(
        model: DiscModel<'a>,
        data: &'a [f64],
        chi_square_threshold: f64,
        scratch: &'a mut Scratch,
    ) -> Option<Self> {
        (data.len() == model.table.stride() && !data.is_empty()).then_some(Self {
            model,
            data,
            chi_square_threshold,
            scratch,
            polarity: Polarity::Up,
            most_work: usize::MAX,
            fits: 0,
            summing: model.table.summing(),
        })
    }

    /// Whether any two touches lie in one another. A fall and a rise may overlap: a finger that rested on the sheet has slid. At the rim
    /// what a contact does looks like that. Where one lies wholly in the other, near its middle, both are a ring.
    fn overlap(&self, discs: &[Disc]) -> bool {
        let part = self.model.order.overlap;
        let DiscModel { table, prior, .. } = self.model;
        let inside = |d: &Disc| table.is_inside(d.at, FROM_RIM * prior.radius_mm);
        discs.iter().enumerate().any(|(k, a)| {
            let apart = |b: &Disc| (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1]);
            let within = |b: &Disc| apart(b) < (a.radius - b.radius).abs();
            let slid = |b: &Disc| a.strength * b.strength < 0.0 && !within(b) && [a, b].iter().all(|d| inside(d));
            let near = |b: &Disc| apart(b) < part * (a.radius + b.radius);
            discs[..k].iter().any(|b| near(b) && !slid(b))
        })
    }

    fn freedom(&self, fit: &Fit) -> f64 {
        (self.model.table.length() as f64 - 3.0 * fit.discs.len() as f64).max(1.0)
    }

    /// Part of a fit's misfit that noise does not explain.
    fn unexplained(&self, fit: &Fit) -> f64 {
        let freedom = self.freedom(fit);
        // The misfit scatters by chance. Only what is above three of its standard deviations counts.
        (fit.square - freedom - 3.0 * scatter(freedom)).max(0.0)
    }

    /// Fall of chi-square that an additional touch must bring for this fit to be the better one.
    fn need(&self, more: &Fit) -> f64 {
        self.chi_square_threshold + self.model.order.of_unexplained * self.unexplained(more)
    }

    /// Whether a fit with more touches is worth them.
    fn earns(&self, fewer: &Fit, more: &Fit) -> bool {
        self.earns_part(fewer, more, 1.0)
    }

    /// Whether a fit with more touches brings this part of what it must bring.
    fn earns_part(&self, fewer: &Fit, more: &Fit, part: f64) -> bool {
        let touches = more.discs.len().saturating_sub(fewer.discs.len()) as f64;
        !self.overlap(&more.discs) && fewer.objective - more.objective > part * touches * self.need(more)
    }

    /// A fit from a start; `None` once the search has cost what it may.
    fn fit(&mut self, start: &[Disc]) -> Option<Fit> {
        if self.is_over() {
            return None;
        }
        self.fit_in(start, self.model.order.steps.most_steps)
    }

    /// What the search has cost, in evaluations of the response to one touch.
    fn work(&self) -> usize {
        self.fits + (self.model.table.summing() - self.summing) as usize
    }

    /// Whether that is what it may.
    fn is_over(&self) -> bool {
        self.work() >= self.most_work
    }

    fn fit_in(&mut self, start: &[Disc], most_steps: usize) -> Option<Fit> {
        let DiscModel { table, prior, order } = self.model;
        let work = &mut self.scratch.work;
        let fit = fit(table, prior, &order.steps, self.data, start, most_steps, work)?;
        self.fits += fit.work;
        Some(fit)
    }

    /// Limits what the search may cost, in evaluations of the response to one touch.
    pub fn within(self, most_work: usize) -> Self {
        Self { most_work, ..self }
    }

    /// Limits touches to those that change the resistivity this way.
    pub fn of(self, polarity: Polarity) -> Self {
        Self { polarity, ..self }
    }

    /// Finds the touches: those of the frame before, or else from a picture's peaks. Without peaks there is no search.
    pub fn run(mut self, seeds: Seeds, before: Option<Before>) -> Option<Found> {
        let mut rival = None;
        if let Some(before) = before.filter(|b| !b.discs.is_empty()) {
            let fit = self.fit_in(before.discs, self.model.order.steps.few_steps)?;
            if self.are_those(&before, &fit) {
                let (fit, followed) = self.followed(fit, before.turn);
                return Some(self.found(fit, followed));
            }
            rival = Some(fit);
        }
        let most = self.model.prior.most_touches.min(Discs::new_const().capacity());
        let Some(mut start) = seeds() else {
            rival.into_iter().for_each(|rival| self.scratch.work.put(rival));
            let nothing = self.fit_in(&[], self.model.order.steps.most_steps)?;
            return Some(Found {
                finished: true,
                hopeless: true,
                ..self.found(nothing, false)
            });
        };
        start.truncate(most);
        self.strengthen(&mut start);
        let mut best = self.fit_in(&start, self.model.order.steps.most_steps)?;
        // Whatever has changed, most of it may have stayed.
        if let Some(mut rival) = rival {
            let cost = |fit: &Fit| fit.objective + self.chi_square_threshold * fit.discs.len() as f64;
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
            finished: !self.is_over(),
            hopeless: false,
            work: self.work(),
        }
    }

    /// Changes the number of touches until no change is worth it.
    fn improved(&mut self, mut best: Fit) -> Fit {
        for _ in 0..self.model.order.most_changes {
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
        let DiscModel { prior, order, .. } = self.model;
        let far = order.longest_move * prior.radius_mm;
        let near = |(a, b): (&Disc, &Disc)| (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1]) <= far;
        let freedom = self.freedom(fit);
        // By chance the misfit of either scatters.
        let most = (order.as_well * before.misfit).max(1.0) * freedom + 3.0 * scatter(freedom);
        before.finished
            && before.discs.iter().zip(&fit.discs).all(near)
            && !self.overlap(&fit.discs)
            && fit.square <= most
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
        let (DiscModel { table, prior, order }, polarity) = (self.model, self.polarity);
        let worth = order.worth_a_try * self.chi_square_threshold;
        let apart = order.longest_move * prior.radius_mm;
        let Scratch { products, .. } = &mut *self.scratch;
        table.coarse_products(&fit.residual, products);
        let far = |at: &[f64; 2]| {
            fit.discs
                .iter()
                .all(|d| (d.at[0] - at[0]).hypot(d.at[1] - at[1]) > apart)
        };
        let mut places = table.coarse().iter().zip(products).zip(table.coarse_norms());
        let further = places.any(|((at, product), norm)| {
            let along = *product / norm.max(f64::MIN_POSITIVE);
            polarity.allows(along) && along * along > worth && far(at)
        });
        let long = |d: &Disc| {
            let split = table.best_split(&fit.residual, d.at, d.strength);
            split.is_some_and(|(gain, _)| gain > 0.0 && gain * gain > worth)
        };
        further || fit.discs.iter().any(long)
    }

    /// First strengths of the touches that have none: each from the residual of those before.
    fn strengthen(&mut self, discs: &mut [Disc]) {
        let (table, polarity) = (self.model.table, self.polarity);
        let (n, arch) = (table.stride(), table.arch());
        let responses = &mut self.scratch.responses;
        responses.clear();
        responses.resize(5 * n, 0.0);
        let (residual, rest) = responses.split_at_mut(n);
        residual.copy_from_slice(self.data);
        let mut parts = rest.chunks_exact_mut(n);
        let [Some(value), Some(a), Some(b), Some(c)] = [parts.next(), parts.next(), parts.next(), parts.next()] else {
            return;
        };
        for d in discs {
            table.at(d.at, d.radius, [&mut *value, &mut *a, &mut *b, &mut *c]);
            let power = dot(arch, value, value).max(f64::MIN_POSITIVE);
            if d.strength == 0.0 {
                d.strength = polarity.at_least(dot(arch, value, residual) / power, 1.0 / power.sqrt());
            }
            add_scaled(arch, value, -d.strength, residual);
        }
    }

    /// A fit without a touch that is not worth it, or with one in place of two. With a turn, only one of these changes
    /// is tried.
    fn fewer(&mut self, best: &Fit, turn: Option<usize>) -> Option<Fit> {
        let DiscModel { table, prior, order } = self.model;
        let part = if turn.is_some() { order.to_stay } else { 1.0 };
        let need = part * self.need(best);
        let mut candidates = self.scratch.spare.pop().unwrap_or_default();
        let covariance = self.scratch.work.covariance(table.arch(), best)?;
        for (k, d) in best.discs.iter().enumerate() {
            let at = PARAMETERS * k + 3;
            let significance = d.strength.powi(2) / covariance.of(at, at).max(f64::MIN_POSITIVE);
            if significance < order.removal_worth * need {
                let mut discs = best.discs.clone();
                discs.remove(k);
                candidates.push((significance, discs));
            }
        }
        for (k, a) in best.discs.iter().enumerate() {
            for (other, b) in best.discs.iter().enumerate().take(k) {
                let apart = (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1]);
                if apart < order.near * prior.radius_mm && a.strength * b.strength > 0.0 {
                    let strength = a.strength + b.strength;
                    let share = a.strength / strength;
                    let mut discs = best.discs.clone();
                    discs[other] = Disc {
                        at: [0, 1].map(|i| share * a.at[i] + (1.0 - share) * b.at[i]),
                        radius: prior.radius_mm.max(0.5 * apart),
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

    /// A fit with additional touches where they are worth it. Where several are missing, one alone explains too little
    /// of the residual: the next ones are tried with it.
    fn more(&mut self, best: &Fit) -> Option<Fit> {
        let most_ahead = self.model.order.most_ahead;
        let mut reached = self.one_more(best)?;
        for ahead in 1..=most_ahead {
            if self.earns(best, &reached) {
                return Some(reached);
            }
            let gain = best.objective - reached.objective;
            if ahead == most_ahead
                || gain < ahead as f64 * self.chi_square_threshold
                || self.unexplained(&reached) <= 0.0
            {
                break;
            }
            let Some(next) = self.one_more(&reached) else { break };
            self.scratch.work.put(std::mem::replace(&mut reached, next));
        }
        self.scratch.work.put(reached);
        None
    }

    /// The best fit with one touch more, or with a touch split in two.
    fn one_more(&mut self, best: &Fit) -> Option<Fit> {
        if best.discs.len() >= self.model.prior.most_touches.min(best.discs.capacity()) {
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
            let better = !self.overlap(&more.discs) && chosen.as_ref().is_none_or(|c| more.objective < c.objective);
            let other = if better { chosen.replace(more) } else { Some(more) };
            other.into_iter().for_each(|fit| self.scratch.work.put(fit));
        }
        self.give_back(candidates);
        chosen
    }

    /// The touches with one more where the residual asks for it most.
    fn further(&mut self, best: &Fit, candidates: &mut Candidates) {
        let (DiscModel { table, prior, order }, polarity) = (self.model, self.polarity);
        let apart = order.apart * prior.radius_mm;
        let worth = order.worth_a_try * self.chi_square_threshold;
        let far = |at: [f64; 2], others: &[Disc], least: f64| {
            others.iter().all(|o| (o.at[0] - at[0]).hypot(o.at[1] - at[1]) > least)
        };
        let Scratch { products, gains, .. } = &mut *self.scratch;
        table.coarse_products(&best.residual, products);
        gains.clear();
        for ((at, product), norm) in table.coarse().iter().zip(products).zip(table.coarse_norms()) {
            let along = *product / norm.max(f64::MIN_POSITIVE);
            if polarity.allows(along) && along * along > worth {
                let strength = along / norm;
                gains.push((
                    along,
                    Disc {
                        strength,
                        ..prior.seed(*at)
                    },
                ));
            }
        }
        gains.sort_unstable_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
        let mut chosen = Discs::new();
        for (_, d) in gains {
            if chosen.len() == order.places {
                break;
            }
            if far(d.at, &best.discs, apart) && far(d.at, &chosen, 2.0 * prior.radius_mm) {
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

    /// The touches with one split along the direction in which the residual says that the touch is long.
    fn split(&self, best: &Fit, k: usize, d: &Disc) -> Option<Discs> {
        let DiscModel { table, prior, order } = self.model;
        let (gain, direction) = table.best_split(&best.residual, d.at, d.strength)?;
        if gain <= 0.0 || gain * gain < order.split_worth * order.worth_a_try * self.chi_square_threshold {
            return None;
        }
        let mut discs = best.discs.clone();
        let [a, b] = table.split(d.at, direction).map(|at| Disc {
            strength: 0.5 * d.strength,
            ..prior.seed(at)
        });
        discs[k] = a;
        discs.try_push(b).ok()?;
        Some(discs)
    }
}
