//! How many touches there are: the data decide, one change at a time.
//!
//! A touch more must lower the misfit by more than noise would by chance anywhere on the sheet: the quantile of Fisher's
//! distribution for the four parameters of a touch, at the wanted probability divided by the number of places (sheet's area
//! over a touch's) where chance could have put it; and by more than the model may be wrong by. Where a fit still explains
//! the data less well than the noise allows, a touch must have taken away more than is left: what a wrong model leaves
//! can be lessened by touches that are not there, but not made to go.

use super::solve::{Fit, PARAMETERS, dot, fit};
use super::table::TouchTable;
use super::{Disc, FitOptions};
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
/// Half distance between the halves of a touch that is split, over the expected radius.
const HALF_SPLIT: f64 = 1.1;

/// A search in one frame.
pub struct Search<'a> {
    table: &'a TouchTable,
    options: &'a FitOptions,
    data: &'a [f64],
    /// Drop of chi-square that a touch must bring: by chance, and by the model's error.
    drop: f64,
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
    /// Prepares for whitened data; `drop` is what a touch must bring. `None` when the lengths do not match.
    pub fn new(table: &'a TouchTable, options: &'a FitOptions, data: &'a [f64], drop: f64) -> Option<Self> {
        (data.len() == table.length()).then_some(Self {
            table,
            options,
            data,
            drop,
        })
    }

    /// Part of a fit's misfit that noise does not explain.
    fn unexplained(&self, fit: &Fit) -> f64 {
        let freedom = (self.data.len() as f64 - 3.0 * fit.discs.len() as f64).max(1.0);
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

    /// Finds the touches, from a picture's peaks or an earlier fit.
    pub fn run(&self, seeds: &[Disc]) -> Option<Fit> {
        let start = seeds.iter().copied().take(self.options.most_touches).collect();
        let mut best = fit(self.table, self.options, self.data, &self.with_strengths(start))?;
        for _ in 0..MOST_CHANGES {
            let Some(next) = self.fewer(&best).or_else(|| self.more(&best)) else {
                break;
            };
            best = next;
        }
        Some(best)
    }

    /// First strengths of the touches that have none, one after the other by what is left of the data.
    fn with_strengths(&self, mut discs: Vec<Disc>) -> Vec<Disc> {
        let mut left = self.data.to_vec();
        let n = self.table.length();
        let mut scratch = vec![0.0; 4 * n];
        for d in &mut discs {
            let (value, rest) = scratch.split_at_mut(n);
            let (a, rest) = rest.split_at_mut(n);
            let (b, c) = rest.split_at_mut(n);
            self.table.at(d.at, d.radius, [&mut *value, a, b, c]);
            let power = dot(value, value).max(f64::MIN_POSITIVE);
            if d.strength <= 0.0 {
                d.strength = (dot(value, &left) / power).max(1.0 / power.sqrt());
            }
            for (l, v) in left.iter_mut().zip(value.iter()) {
                *l -= d.strength * v;
            }
        }
        discs
    }

    /// A fit without a touch that is not worth it, or with one in place of two.
    fn fewer(&self, best: &Fit) -> Option<Fit> {
        let need = self.need(best);
        let covariance = best.covariance()?;
        let mut candidates: Vec<(f64, Vec<Disc>)> = Vec::new();
        for (k, d) in best.discs.iter().enumerate() {
            let at = PARAMETERS * k + 3;
            let significance = d.strength.powi(2) / covariance[(at, at)].max(f64::MIN_POSITIVE);
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
        candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
        candidates.into_iter().find_map(|(_, discs)| {
            let fewer = fit(self.table, self.options, self.data, &discs)?;
            (!self.earns(&fewer, best)).then_some(fewer)
        })
    }

    /// A fit with a further touch where that is worth it. Where several are missing one alone explains too little of what
    /// is left, so the next ones are tried with it.
    fn more(&self, best: &Fit) -> Option<Fit> {
        let mut reached = self.one_more(best)?;
        for ahead in 1..=MOST_AHEAD {
            if self.earns(best, &reached) {
                return Some(reached);
            }
            let gain = best.objective - reached.objective;
            if ahead == MOST_AHEAD || gain < ahead as f64 * self.drop || self.unexplained(&reached) <= 0.0 {
                break;
            }
            reached = self.one_more(&reached)?;
        }
        None
    }

    /// The best fit with a further touch, or with a touch split in two.
    fn one_more(&self, best: &Fit) -> Option<Fit> {
        if best.discs.len() >= self.options.most_touches {
            return None;
        }
        let mut candidates = self.further(best);
        candidates.extend(
            best.discs
                .iter()
                .enumerate()
                .filter_map(|(k, d)| self.split(best, k, d)),
        );
        candidates
            .into_iter()
            .filter_map(|discs| fit(self.table, self.options, self.data, &discs))
            .filter(|more| !overlap(&more.discs))
            .min_by(|a, b| a.objective.total_cmp(&b.objective))
    }

    /// The touches with one more where the residual asks for it most.
    fn further(&self, best: &Fit) -> Vec<Vec<Disc>> {
        let apart = 0.8 * self.options.radius_mm;
        let far = |at: [f64; 2], others: &[Disc], least: f64| {
            others.iter().all(|o| (o.at[0] - at[0]).hypot(o.at[1] - at[1]) > least)
        };
        let mut gains: Vec<(f64, Disc)> = Vec::new();
        for ((at, values), norm) in self.table.coarse().zip(self.table.coarse_norms()) {
            let along = dot(values, &best.residual) / norm.max(f64::MIN_POSITIVE);
            if along > 0.0 && along * along > WORTH_A_TRY * self.drop {
                gains.push((
                    along,
                    Disc {
                        strength: along / norm,
                        ..self.options.seed(at)
                    },
                ));
            }
        }
        gains.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut chosen: Vec<Disc> = Vec::new();
        for (_, d) in gains {
            if chosen.len() == PLACES {
                break;
            }
            if far(d.at, &best.discs, apart) && far(d.at, &chosen, 2.0 * self.options.radius_mm) {
                chosen.push(d);
            }
        }
        chosen
            .into_iter()
            .map(|d| best.discs.iter().copied().chain([d]).collect())
            .collect()
    }

    /// The touches with one split along the direction in which the residual says it is long.
    fn split(&self, best: &Fit, k: usize, d: &Disc) -> Option<Vec<Disc>> {
        let n = self.table.length();
        let reach = HALF_SPLIT * self.options.radius_mm;
        let mut scratch = vec![0.0; 6 * n];
        let (sum, scratch) = scratch.split_at_mut(n);
        let (middle, scratch) = scratch.split_at_mut(n);
        let (value, scratch) = scratch.split_at_mut(n);
        let (a, scratch) = scratch.split_at_mut(n);
        let (b, c) = scratch.split_at_mut(n);
        self.table
            .at(d.at, self.options.radius_mm, [&mut *middle, &mut *a, &mut *b, &mut *c]);
        let mut chosen: Option<(f64, [[f64; 2]; 2])> = None;
        for eighth in 0..4 {
            let (sin, cos) = (f64::from(eighth) * std::f64::consts::FRAC_PI_4).sin_cos();
            let ends = [1.0, -1.0].map(|s| [d.at[0] + s * reach * cos, d.at[1] + s * reach * sin]);
            if !ends.iter().all(|e| self.table.holds(*e)) {
                continue;
            }
            for (s, m) in sum.iter_mut().zip(middle.iter()) {
                *s = -2.0 * m;
            }
            for end in ends {
                self.table
                    .at(end, self.options.radius_mm, [&mut *value, &mut *a, &mut *b, &mut *c]);
                for (s, v) in sum.iter_mut().zip(value.iter()) {
                    *s += v;
                }
            }
            let gain = dot(sum, &best.residual) / dot(sum, sum).sqrt().max(f64::MIN_POSITIVE);
            if chosen.is_none_or(|(g, _)| gain > g) {
                chosen = Some((gain, ends));
            }
        }
        let (gain, ends) = chosen?;
        if gain <= 0.0 || gain * gain < 0.3 * WORTH_A_TRY * self.drop {
            return None;
        }
        let mut discs = best.discs.clone();
        let half = |at| Disc {
            strength: 0.5 * d.strength,
            ..self.options.seed(at)
        };
        discs[k] = half(ends[0]);
        discs.push(half(ends[1]));
        Some(discs)
    }
}
