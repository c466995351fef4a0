//! How a skin is best described: symmetric or not, which way round, around what; chosen by cross-validation.

use super::choice::{Choice, Setting};
use super::frame::{Frame, MOST_DISPLACED, MOST_STRETCHED};
use super::locator::Evidence;
use super::maps::{Presses, Prior};
use super::orbits::Orbits;
use super::rest::{FREEDOM, Residuals};
use super::validation::{FIRST_TEMPERING, Validation, cross_validate, locators};
use forward::Measurement;
use nalgebra::{Complex, Matrix2, Vector2};

/// Parts where only a choice is to be made.
pub(super) const QUICK_FOLDS: usize = 5;
/// Steps of the grid there, from the middle to the reach of the presses.
const QUICK_STEPS: f64 = 10.0;
/// Parts of the work, about equally long.
pub(super) const PARTS: usize = 9;

pub(super) const PRIOR: Prior = Prior {
    shared: 0.5,
    grain: 0.0,
    own: 0.06,
    memory: 0.0,
    displaced: 0.0,
};
/// Of a sheet that turns: one that is even, one with a grain, and one that is uneven besides.
const SHARED: [Prior; 3] = [
    PRIOR,
    Prior { grain: 0.05, ..PRIOR },
    Prior {
        grain: 0.1,
        own: 0.25,
        ..PRIOR
    },
];
/// For whether the sheet turns, and which way: of many presses what measurements have of their own would tell all.
const TURNED: Prior = Prior { own: 1e-4, ..PRIOR };
/// Of a sheet that does not turn.
const ALONE: Prior = Prior { own: 0.5, ..PRIOR };
/// Radii of the sheet over the reach of the presses that are tried: mostly nobody presses on the rim.
const RADII: [f64; 3] = [1.25, 1.12, 1.05];
/// Standard deviation of a coordinate of the stretch, before anything is known of it: a sheet that conducts twice as well along as across
/// has one of 0.17.
const STRETCH_SD: f64 = 0.2;
/// First and last step by which it is looked for. The last one is a sheet that conducts 1.2 times as well along as across.
const STRETCH_STEPS: [f64; 2] = [0.2, 0.05];
/// Parts of what the press before did that are tried as left.
const MEMORIES: [f64; 6] = [0.07, 0.14, 0.2, 0.3, 0.4, 0.5];
/// Standard errors by which presses have to be drawn to the one before, and be located better by a memory.
const LIKELY: f64 = 1.0;
/// Standard deviation of the part by which the press before displaces the middle of a sheet, before anything is known of it.
const DISPLACED_SD: f64 = 0.1;
/// How often it is estimated, each time from what is left.
const DISPLACED_REPETITIONS: usize = 2;
/// Chance that the mean of presses all over a sheet is taken for another middle than the origin. A coordinate of each has a quarter of
/// the squared radius as its variance, and the squared distance of their mean is distributed exponentially.
const MIDDLE_BY_CHANCE: f64 = 0.01;
/// Standard errors by which a symmetry has to be refuted.
const SURELY: f64 = 3.0;
/// Residuals beyond this many scales are drawn in.
const LARGEST: f64 = 3.0;
/// Presses located within this part of the reach tell what draws them.
const NEARLY: f64 = 0.4;

/// A way to describe the skin, with all presses located by maps of the others.
struct Tried {
    choice: Choice,
    found: Validation,
}

impl Tried {
    fn new(choice: Choice, presses: &Presses) -> Option<Self> {
        let (locators, ..) = locators(&choice, presses, QUICK_FOLDS, QUICK_STEPS)?;
        let found = Validation::of(&locators, presses, Evidence::of_one_press(FIRST_TEMPERING));
        Some(Self { choice, found })
    }

    /// Logarithms of the squared distances, for each press. One that is not found counts as a guess: it is off by the reach.
    fn losses(&self) -> Vec<f64> {
        let reach = self.choice.frame.reach_mm;
        let step = reach / QUICK_STEPS;
        let errors = self.found.errors_mm(reach);
        errors.iter().map(|e| (e * e + step * step).ln()).collect()
    }

    /// By what part of some ways presses are located beside their places, with its standard error: by least squares, beside what draws
    /// them to the middle. `ways` tells them from the place of a press and that of the one before, mm. `None` where too few are found
    /// near their places.
    fn drawn(&self, presses: &Presses, ways: impl Fn([f64; 2], [f64; 2]) -> [f64; 2]) -> Option<(f64, f64)> {
        let frame = self.choice.frame;
        let (mut square, mut product) = (Matrix2::zeros(), Vector2::zeros());
        let mut list = Vec::new();
        for ((place, before), offset) in (presses.places_mm.iter().zip(&presses.before_mm)).zip(&self.found.offsets) {
            let near = offset[0].hypot(offset[1]) < NEARLY * frame.reach_mm;
            let Some(before) = before.filter(|_| near) else {
                continue;
            };
            let way = ways(*place, before);
            for axis in 0..2 {
                let both = Vector2::new(way[axis], place[axis] - frame.centre_mm[axis]);
                square += both * both.transpose();
                product += both * offset[axis];
                list.push((both, offset[axis]));
            }
        }
        let inverse = square.try_inverse()?;
        let parts = inverse * product;
        let left = list.iter().map(|(both, offset)| (offset - both.dot(&parts)).powi(2));
        let free = list.len().checked_sub(2)? as f64;
        let error = (left.sum::<f64>() / free * inverse[(0, 0)]).sqrt();
        (parts.x.is_finite() && error > 0.0).then_some((parts.x, error))
    }

    /// 1 where presses are likely located towards the one before, -1 where away from it.
    fn towards(&self, presses: &Presses) -> Option<f64> {
        let (part, error) = self.drawn(presses, |place, before| [0, 1].map(|k| before[k] - place[k]))?;
        (part.abs() > LIKELY * error).then(|| part.signum())
    }
}

/// Logarithms of the mean square of what maps of the others leave of each press, over the scales of the measurements.
pub(super) fn rests(choice: &Choice, presses: &Presses) -> Option<Vec<f64>> {
    let (maps, residuals) = cross_validate(choice, presses, QUICK_FOLDS)?;
    Some(left_of(&residuals, &maps.first()?.of_others.scale))
}

/// The same of residuals.
pub(super) fn left_of(residuals: &Residuals, scale: &[f64]) -> Vec<f64> {
    let rest = |k: usize| {
        let over = scale.iter().enumerate().map(|(c, s)| residuals.values[(k, c)] / s);
        let there: Vec<f64> = over
            .filter(|v| v.is_finite())
            .map(|v| v.clamp(-LARGEST, LARGEST).powi(2))
            .collect();
        let mean = there.iter().sum::<f64>() / there.len().max(1) as f64;
        mean.max(f64::MIN_POSITIVE).ln()
    };
    (0..residuals.values.nrows()).map(rest).collect()
}

/// Ways to describe a sheet before anything is tried: those that differ in what no list of presses may get wrong unseen, which way round
/// the electrodes are.
pub(super) fn first_choices(presses: &Presses, setting: &Setting<'_>, measurements: &[Measurement]) -> Vec<Choice> {
    if setting.turn < setting.electrodes {
        [false, true]
            .map(|clockwise| {
                first_choice(
                    presses,
                    setting,
                    measurements,
                    ([0.0; 2], setting.turn, clockwise, TURNED),
                )
            })
            .to_vec()
    } else {
        vec![first_choice(
            presses,
            setting,
            measurements,
            ([0.0; 2], setting.turn, false, ALONE),
        )]
    }
}

/// One around a centre, mm, with a turn, a way round and a prior.
fn first_choice(
    presses: &Presses,
    setting: &Setting<'_>,
    measurements: &[Measurement],
    (centre_mm, turn, clockwise, prior): ([f64; 2], usize, bool, Prior),
) -> Choice {
    // Later presses may be anywhere on the sheet.
    let of_sheet = setting.extent.map_or(0.0, |sheet| {
        let off = [0, 1].map(|k| sheet.middle_mm[k] - centre_mm[k]);
        sheet.reach_mm + off[0].hypot(off[1])
    });
    let reach_mm = reach(presses, centre_mm).max(of_sheet);
    Choice {
        frame: Frame {
            centre_mm,
            reach_mm,
            radius_mm: RADII[0] * reach_mm,
            electrodes: setting.electrodes,
            clockwise,
            stretch: Complex::ZERO,
        },
        prior,
        turn,
        orbits: Orbits::new(measurements, setting.electrodes, turn),
    }
}

/// Whether some losses are less than others by more than so many standard errors of the difference.
fn are_less(losses: &[f64], others: &[f64], errors: f64) -> bool {
    let count = losses.len() as f64;
    let differences = || losses.iter().zip(others).map(|(a, b)| a - b);
    let mean = differences().sum::<f64>() / count;
    let variance = differences().map(|d| (d - mean).powi(2)).sum::<f64>() / (count * (count - 1.0));
    mean < -errors * variance.sqrt()
}

/// Of some ways the one with the least losses; an earlier one unless a later one is better by more than so many standard errors.
fn least<T>(ways: impl IntoIterator<Item = T>, losses: impl Fn(&T) -> Vec<f64>, errors: f64) -> Option<T> {
    let better = |taken: T, other: T| {
        if are_less(&losses(&other), &losses(&taken), errors) {
            other
        } else {
            taken
        }
    };
    ways.into_iter().reduce(better)
}

/// The way by which presses are located best.
fn best(ways: impl IntoIterator<Item = Option<Tried>>, errors: f64) -> Option<Tried> {
    least(ways.into_iter().flatten(), Tried::losses, errors)
}

fn reach(presses: &Presses, centre: [f64; 2]) -> f64 {
    let farthest = presses
        .places_mm
        .iter()
        .map(|p| (p[0] - centre[0]).hypot(p[1] - centre[1]))
        .fold(0.0, f64::max);
    // Of K places in a disc the farthest is expected at 2 K / (2 K + 1) of its radius.
    farthest * (1.05 + 0.5 / presses.len() as f64)
}

/// How the sheet is best described: symmetric or not, which way round, around what.
pub(super) fn choose(
    presses: &Presses,
    setting: &Setting<'_>,
    measurements: &[Measurement],
    progress: &mut impl FnMut(usize, usize),
) -> Option<Choice> {
    let along = |axis: usize| presses.places_mm.iter().map(move |p| p[axis]);
    let of_presses = [0, 1].map(|axis| {
        let (low, high) = along(axis).fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        0.5 * (low + high)
    });
    let middle = setting.extent.map_or(of_presses, |sheet| sheet.middle_mm);
    let make = |centre_mm: [f64; 2], turn: usize, clockwise: bool, prior: Prior| {
        first_choice(presses, setting, measurements, (centre_mm, turn, clockwise, prior))
    };
    let with = |choice: &Choice, prior: Prior| Choice {
        prior,
        ..choice.clone()
    };
    // The origin is where the sheet's middle should be. Few presses cannot tell another one: those of a disc around the origin lie
    // beside it by chance.
    let mut middles = vec![[0.0; 2]];
    let mean = [0, 1].map(|axis| along(axis).sum::<f64>() / presses.len() as f64);
    let by_chance = reach(presses, middle) * (-MIDDLE_BY_CHANCE.ln() / (2.0 * presses.len() as f64)).sqrt();
    // What turns a sheet that is known turns it around the origin.
    if setting.extent.is_none()
        && middle[0].hypot(middle[1]) > 0.2 * reach(presses, middle)
        && mean[0].hypot(mean[1]) > by_chance
    {
        middles.push(middle);
    }
    let ways = middles.iter().flat_map(|m| [(*m, false), (*m, true)]);
    let ways = ways.map(|(middle, clockwise)| make(middle, setting.turn, clockwise, TURNED));
    let turns = setting.turn < setting.electrodes;
    let turned = best(ways.filter(|_| turns).map(|way| Tried::new(way, presses)), 0.0);
    let symmetric = turned.map(|turned| with_radius(turned.choice, presses));
    progress(2, PARTS);
    let alone = make(middle, setting.electrodes, false, ALONE);
    let alone = Tried::new(with_radius(alone, presses), presses);
    let taken = match symmetric {
        Some(symmetric) => {
            // A half turn leaves every direction as it was.
            let grained = 2 * symmetric.turn % setting.electrodes != 0;
            let ways = SHARED.map(|prior| {
                let grain = if grained { prior.grain } else { 0.0 };
                Tried::new(with(&symmetric, Prior { grain, ..prior }), presses)
            });
            let shared = best(ways, LIKELY);
            // Of few presses maps without symmetry promise more than they keep.
            best([shared, alone], SURELY)
        }
        None => alone,
    };
    progress(5, PARTS);
    let taken = taken?;
    let choice = stretched(taken.choice.clone(), presses);
    let grained = (choice.frame.stretch != Complex::ZERO).then(|| Tried::new(choice, presses));
    Some(remember(grained.flatten().unwrap_or(taken), presses).choice)
}

/// With the stretch by which maps of the others tell presses best, beside what is expected of it: the posterior's mode, by a search of the
/// pattern of four neighbours (Hooke and Jeeves 1961). The same choice where they are not told better by a standard error.
fn stretched(choice: Choice, presses: &Presses) -> Choice {
    let at = |stretch: Complex<f64>| {
        let mut choice = choice.clone();
        choice.frame.stretch = stretch;
        let rests = rests(&choice, presses)?;
        let mean = rests.iter().sum::<f64>() / rests.len() as f64;
        let unexpected = (stretch.norm() / STRETCH_SD).powi(2) / (FREEDOM * presses.len() as f64);
        Some((mean + unexpected, rests, choice))
    };
    let Some(even) = at(Complex::ZERO) else {
        return choice;
    };
    let (mut best, mut step) = (even.clone(), STRETCH_STEPS[0]);
    while step >= STRETCH_STEPS[1] {
        let here = best.2.frame.stretch;
        let neighbours = [Complex::ONE, -Complex::ONE, Complex::I, -Complex::I].map(|way| here + way * step);
        let allowed = neighbours.into_iter().filter(|q| q.norm() <= MOST_STRETCHED);
        let least = allowed.filter_map(at).min_by(|a, b| a.0.total_cmp(&b.0));
        match least.filter(|tried| tried.0 < best.0) {
            Some(tried) => best = tried,
            None => step *= 0.5,
        }
    }
    if are_less(&best.1, &even.1, LIKELY) {
        best.2
    } else {
        choice
    }
}

/// With the radius by which maps of the others tell presses best.
fn with_radius(choice: Choice, presses: &Presses) -> Choice {
    let ways = RADII.map(|over| {
        let mut choice = choice.clone();
        choice.frame.radius_mm = over * choice.frame.reach_mm;
        Some((rests(&choice, presses)?, choice))
    });
    let taken = least(ways.into_iter().flatten(), |way| way.0.clone(), LIKELY);
    taken.map_or(choice, |(_, choice)| choice)
}

/// What the press before left: a sheet that is displaced, or a part of what it did where presses are located better by that.
fn remember(taken: Tried, presses: &Presses) -> Tried {
    let sign = taken.towards(presses);
    let displaced = displaced(&taken, presses);
    let remains = displaced.as_ref().is_none_or(|tried| tried.towards(presses).is_some());
    let remembered = sign
        .filter(|_| remains)
        .and_then(|sign| remembered(&taken, presses, sign));
    best([displaced, remembered], SURELY).unwrap_or(taken)
}

/// The sheet displaced by the press before: the part by which presses are located beside their places, and what that leaves.
fn displaced(taken: &Tried, presses: &Presses) -> Option<Tried> {
    let mut displaced: Option<Tried> = None;
    for _ in 0..DISPLACED_REPETITIONS {
        let last = displaced.as_ref().unwrap_or(taken);
        let frame = last.choice.frame;
        let (part, error) = last.drawn(presses, |place, before| {
            let loose = frame.loose(place).0;
            [0, 1].map(|k| loose * (before[k] - frame.centre_mm[k]))
        })?;
        let known = DISPLACED_SD * DISPLACED_SD / (DISPLACED_SD * DISPLACED_SD + error * error);
        let mut choice = last.choice.clone();
        choice.prior.displaced = (known * (choice.prior.displaced + part)).clamp(-MOST_DISPLACED, MOST_DISPLACED);
        displaced = Some(Tried::new(choice, presses)?);
    }
    displaced
}

/// A part of what the press before did is in the change of the next. Presses then are located towards the one before, or away from it
/// where the frame before has more of it than the press. As much more is taken as they are located better by it.
fn remembered(taken: &Tried, presses: &Presses, sign: f64) -> Option<Tried> {
    let mut best: Option<Tried> = None;
    for more in MEMORIES {
        let mut choice = taken.choice.clone();
        choice.prior.memory = sign * more;
        let other = Tried::new(choice, presses)?;
        let (last, errors) = best.as_ref().map_or((taken, LIKELY), |last| (last, 0.0));
        if !are_less(&other.losses(), &last.losses(), errors) {
            break;
        }
        best = Some(other);
    }
    best
}
