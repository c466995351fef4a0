//! Whether the electrodes are wired in the order that is said, asked of the baseline.
//!
//! Another order of the wires gives the values of other measurements: those of the same electrode matrix with its rows exchanged.
//! Every order is therefore compared with exact values of the model, and none needs another solve. Magnitudes are compared by
//! their logarithms; the deviation of a value is bounded, so that a dead electrode does not decide. Signs are the matter of
//! [`crate::reference::screening`].
//!
//! Turns and mirrors of an even disc give the same values. Only a touch at a known place tells them apart ([`by_touch`]).

use crate::reference::imager::Imager;
use crate::reference::screening::consensus;
use crate::stats::median;
use forward::{DiscTouch, Drive, ElectrodeMatrix, ForwardError, Measurement, Pair, Pattern, PatternError, Solver};
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// How orders of the wires are compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WiringOptions {
    /// Largest deviation of a value's logarithm that counts: a factor of two. More lets a dead electrode hide two exchanged wires.
    pub most_deviation: f64,
    /// Added to every magnitude before its logarithm, over their median: values near zero have no logarithm to compare.
    pub floor: f64,
    /// The best order must have less than this part of the given order's misfit to be clearly better. Turned orders of a disc whose
    /// electrodes are off by 3 mm differ by less.
    pub clear: f64,
    /// The least by which it must be better. Electrodes off by 1 mm give a misfit of 0.04.
    pub least: f64,
    /// Most exchanges of two wires.
    pub most_exchanges: usize,
}

impl Default for WiringOptions {
    fn default() -> Self {
        Self {
            most_deviation: std::f64::consts::LN_2,
            floor: 0.01,
            clear: 0.75,
            least: 0.05,
            most_exchanges: 4,
        }
    }
}

/// An order of the wires, and how it fits.
#[derive(Clone, Debug, PartialEq)]
pub struct Wiring {
    /// For every wire, as the measurements number it, the electrode of the sheet that it leads to; from 0.
    pub order: Vec<usize>,
    /// Mean deviation of the logarithms of the magnitudes, each bounded.
    pub misfit: f64,
    /// Correlation of the logarithms of the magnitudes with the model.
    pub correlation: f64,
}

/// What a baseline says of the order of the wires.
#[derive(Clone, Debug, PartialEq)]
pub struct WiringCheck {
    /// The order that was said: every wire at its electrode.
    pub given: Wiring,
    /// The order that fits best. The given one where no other is clearly better.
    pub best: Wiring,
    /// Orders that fit as well, with the best one: turns and mirrors.
    pub equal: Vec<Vec<usize>>,
}

impl WiringCheck {
    /// Whether another order fits clearly better than the given one.
    pub fn is_wrong(&self) -> bool {
        self.best.order != self.given.order
    }

    /// Wires that lead elsewhere in the best order, from 0.
    pub fn moved(&self) -> Vec<usize> {
        let order = self.best.order.iter().enumerate();
        order
            .filter(|(wire, electrode)| wire != *electrode)
            .map(|(wire, _)| wire)
            .collect()
    }
}

/// An order as `--wires` takes it: electrodes counted from 1, separated by commas.
pub fn order_text(order: &[usize]) -> String {
    let numbers: Vec<String> = order.iter().map(|l| (l + 1).to_string()).collect();
    numbers.join(",")
}

/// A measurement whose wires lead to the electrodes of an order.
fn rewired(m: Measurement, order: &[usize]) -> Measurement {
    let electrode = |l: usize| order.get(l).copied().unwrap_or(l);
    let pair = |p: Pair| Pair::new(electrode(p.plus), electrode(p.minus));
    Measurement {
        drive: pair(m.drive),
        sense: pair(m.sense),
    }
}

/// The pattern of measurements whose wires lead to the electrodes of an order (from 0; wires beyond it lead to their own).
///
/// # Errors
/// [`PatternError`] for an order that is not one: two wires at one electrode, or an electrode that there is not.
pub fn rewire(pattern: &Pattern, order: &[usize]) -> Result<Pattern, PatternError> {
    let list = pattern.measurements().iter().map(|m| rewired(*m, order)).collect();
    Pattern::from_list(pattern.electrodes(), list)
}

/// The logarithms of a baseline, ready to be compared with orders.
struct Comparison<'a> {
    options: &'a WiringOptions,
    matrix: &'a ElectrodeMatrix,
    pattern: &'a Pattern,
    drive: Drive,
    /// Index in the pattern and logarithm of every value that is there.
    measured: Vec<(usize, f64)>,
    floor_v: f64,
}

impl Comparison<'_> {
    fn wiring(&self, order: Vec<usize>) -> Wiring {
        let pairs: Vec<(f64, f64)> = self
            .measured
            .iter()
            .map(|(k, measured)| {
                let m = rewired(self.pattern.measurements()[*k], &order);
                let model = self.drive.voltage_v(self.matrix, m).abs() + self.floor_v;
                (*measured, model.ln())
            })
            .collect();
        // Half of the largest deviation to either side: the gain on which the orders are compared is theirs, not the given one's.
        let reach = 0.5 * self.options.most_deviation;
        let gain = consensus(pairs.iter().map(|(b, m)| b - m), reach).map_or(0.0, |c| c.0);
        let count = pairs.len().max(1) as f64;
        let deviation = |(b, m): &(f64, f64)| (b - m - gain).abs().min(self.options.most_deviation);
        Wiring {
            misfit: pairs.iter().map(deviation).sum::<f64>() / count,
            correlation: correlation(pairs.iter().copied()),
            order,
        }
    }

    fn is_clearly_better(&self, one: &Wiring, than: &Wiring) -> bool {
        one.misfit < self.options.clear * than.misfit && one.misfit + self.options.least < than.misfit
    }

    /// Exchanges two wires as long as that helps.
    fn exchanged(&self, mut best: Wiring) -> Wiring {
        let n = best.order.len();
        for _ in 0..self.options.most_exchanges {
            let mut next = best.clone();
            for a in 0..n {
                for b in 0..a {
                    let mut order = best.order.clone();
                    order.swap(a, b);
                    let wiring = self.wiring(order);
                    if wiring.misfit < next.misfit {
                        next = wiring;
                    }
                }
            }
            // What does not help clearly fits the noise.
            if next.misfit + 0.1 * self.options.least >= best.misfit {
                break;
            }
            best = next;
        }
        best
    }
}

/// Correlation of pairs of numbers about their means; 0 where one does not vary.
fn correlation(pairs: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let count = pairs.clone().count().max(1) as f64;
    let (a0, b0) = pairs
        .clone()
        .fold((0.0, 0.0), |s, (a, b)| (s.0 + a / count, s.1 + b / count));
    let (ab, aa, bb) = pairs.fold((0.0, 0.0, 0.0), |s, (a, b)| {
        let (a, b) = (a - a0, b - b0);
        (s.0 + a * b, s.1 + a * a, s.2 + b * b)
    });
    let size = (aa * bb).sqrt();
    if size > 0.0 { ab / size } else { 0.0 }
}

/// Turn `turn` of an order, mirrored or not.
fn turned(order: &[usize], turn: usize, mirrored: bool) -> Vec<usize> {
    let n = order.len();
    let at = |l: &usize| if mirrored { (turn + n - l) % n } else { (turn + l) % n };
    order.iter().map(at).collect()
}

fn turns(n: usize) -> impl Iterator<Item = (usize, bool)> {
    [false, true]
        .into_iter()
        .flat_map(move |mirrored| (0..n).map(move |turn| (turn, mirrored)))
}

/// Compares orders of the wires with a baseline (any unit, in the pattern's order; not a number where a value is missing): the
/// given one, turns, mirrors, and exchanges of two wires one after the other.
///
/// With `briefly` nothing else is tried where the given order fits to [`WiringOptions::least`].
///
/// # Errors
/// [`ForwardError`] where the sheet's model has no solution.
pub fn check(
    imager: &Imager,
    baseline: &[f64],
    briefly: bool,
    options: &WiringOptions,
) -> Result<WiringCheck, ForwardError> {
    let solver = Solver::new(imager.model.clone())?;
    let present = |v: &f64| v.is_finite();
    let floor = options.floor * median(baseline.iter().copied().filter(present).map(f64::abs));
    let comparison = Comparison {
        options,
        matrix: solver.electrode_matrix(),
        pattern: &imager.pattern,
        drive: imager.drive,
        measured: (0..imager.pattern.len().min(baseline.len()))
            .filter(|k| baseline[*k].is_finite())
            .map(|k| (k, (baseline[k].abs() + floor).max(f64::MIN_POSITIVE).ln()))
            .collect(),
        floor_v: options.floor * median(imager.model_v.iter().map(|v| v.abs())),
    };
    let n = imager.pattern.electrodes();
    let given = comparison.wiring((0..n).collect());
    if briefly && given.misfit <= options.least {
        return Ok(WiringCheck {
            equal: vec![given.order.clone()],
            best: given.clone(),
            given,
        });
    }
    let mut starts = vec![given.clone()];
    let around = turns(n).map(|(turn, mirrored)| comparison.wiring(turned(&given.order, turn, mirrored)));
    starts.extend(
        around
            .min_by(|a, b| a.misfit.total_cmp(&b.misfit))
            .filter(|turned| comparison.is_clearly_better(turned, &given)),
    );
    // Of equal ones the first, which is nearest to what was said.
    let best = starts
        .into_iter()
        .map(|start| comparison.exchanged(start))
        .reduce(|a, b| if comparison.is_clearly_better(&b, &a) { b } else { a })
        .filter(|best| comparison.is_clearly_better(best, &given))
        .unwrap_or_else(|| given.clone());
    let mut equal = vec![best.order.clone()];
    for (turn, mirrored) in turns(n) {
        let other = comparison.wiring(turned(&best.order, turn, mirrored));
        if !comparison.is_clearly_better(&best, &other) && !equal.contains(&other.order) {
            equal.push(other.order);
        }
    }
    Ok(WiringCheck { given, best, equal })
}

/// How well the change of a frame agrees with a touch at a known place, for every order given: correlations in the order of
/// `orders`, 1 for a perfect agreement. The touch is a disc of this radius (mm); its rise hardly matters.
///
/// # Errors
/// [`ForwardError`] where the touched sheet has no solution, as for a touch without a radius.
pub fn by_touch(
    imager: &Imager,
    orders: &[Vec<usize>],
    baseline: &[f64],
    frame: &[f64],
    touch: DiscTouch,
) -> Result<Vec<f64>, ForwardError> {
    let mut solver = Solver::new(imager.model.clone())?;
    let touched = solver.solve_touches(&[touch])?.clone();
    let untouched = solver.solve_untouched_there()?;
    let used: Vec<usize> = (0..imager.pattern.len().min(baseline.len()).min(frame.len()))
        .filter(|k| baseline[*k].is_finite() && frame[*k].is_finite() && baseline[*k] != 0.0)
        .collect();
    Ok(orders
        .iter()
        .map(|order| {
            let pairs = used.iter().map(|k| {
                let m = rewired(imager.pattern.measurements()[*k], order);
                let before = imager.drive.voltage_v(untouched, m);
                let change = imager.drive.voltage_v(&touched, m) - before;
                (before * (frame[*k] / baseline[*k] - 1.0), change)
            });
            correlation(pairs)
        })
        .collect())
}

/// What values deviate by from reciprocity, relative, median over the pairs of values with drive and sense exchanged: by noise,
/// by crosstalk, by channels of different gain. The order of the wires does not matter. With a voltage drive the currents of the
/// drive pairs are taken out first. `None` where the pattern has no such pairs.
pub fn reciprocity(pattern: &Pattern, drive: Drive, baseline: &[f64]) -> Option<f64> {
    let drive_of = |k: usize| {
        pattern
            .drives()
            .iter()
            .position(|d| *d == pattern.measurements()[k].drive)
    };
    let reciprocal = pattern.reciprocal_indices();
    let pairs: Vec<([usize; 2], f64)> = reciprocal
        .iter()
        .enumerate()
        .filter_map(|(k, other)| {
            let other = other.filter(|o| k < *o)?;
            let ratio = (baseline.get(k)? / baseline.get(other)?).abs().ln();
            ratio.is_finite().then_some(([drive_of(k)?, drive_of(other)?], ratio))
        })
        .collect();
    let mut current = vec![0.0; pattern.drives().len()];
    if matches!(drive, Drive::Voltage { .. }) {
        for _ in 0..CURRENT_SWEEPS {
            for d in 0..current.len() {
                let of = pairs.iter().filter_map(|([a, b], ratio)| match (*a == d, *b == d) {
                    (true, false) => Some(ratio + current[*b]),
                    (false, true) => Some(current[*a] - ratio),
                    _ => None,
                });
                current[d] = median(of);
            }
        }
    }
    let residuals = pairs
        .iter()
        .map(|([a, b], ratio)| (ratio - current[*a] + current[*b]).abs());
    (!pairs.is_empty()).then(|| median(residuals))
}

/// Sweeps over the currents of the drives, each the median of what its pairs say: they settle within a few.
const CURRENT_SWEEPS: usize = 20;

/// What values of the same two pairs deviate by where a pair is driven or sensed both ways round, relative, median. `None` where
/// the pattern has no such values.
pub fn twins(pattern: &Pattern, baseline: &[f64]) -> Option<f64> {
    let key = |p: Pair| [p.plus.min(p.minus), p.plus.max(p.minus)];
    let mut first = HashMap::new();
    let mut off = Vec::new();
    for (m, v) in pattern.measurements().iter().zip(baseline) {
        match first.entry((key(m.drive), key(m.sense))) {
            Entry::Vacant(entry) => {
                entry.insert(*v);
            }
            Entry::Occupied(before) => off.push((before.get() / v).abs().ln().abs()),
        }
    }
    off.retain(|d| d.is_finite());
    (!off.is_empty()).then(|| median(off.into_iter()))
}
