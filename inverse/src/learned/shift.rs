//! Whether a list tells places one press off: where a press was skipped, or made twice, all after it have the place of another line.
//!
//! Each of some ways to read the list is tried: as it is, or from a press on one line earlier or later. Maps of the others say what part of
//! each press's change is left, at the place of its line and at that of the line beside. From that follows from which press on the list is
//! best read otherwise. Maps are learned anew of the list so read, until nothing changes (Viterbi training; Juang and Rabiner 1990).

use super::choice::{Choice, Setting};
use super::learn::{alive, check, gather};
use super::maps::Presses;
use super::rest::Residuals;
use super::search::{QUICK_FOLDS, choose, first_choices, left_of, rests};
use super::validation::folds;
use super::{LearnError, Press};
use crate::stats::{chance_of_gain, median};
use forward::Measurement;

/// Parts of the list at which a shift is first supposed to begin: then less than an eighth of it is read wrong.
const STARTS: usize = 4;
/// How often a list is read anew.
const READ: usize = 4;
/// Chance that a list that fits as well is taken for a shifted one. A right list fits better than all others.
const BY_CHANCE: f64 = 0.01;

/// From some press on the list tells the places of others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift {
    /// The first press, from 0, whose place is in another line.
    pub from: usize,
    /// Where its line is: 1 for the next one, -1 for the one before.
    pub by: isize,
    /// Parts of the change that maps of the others leave, by the list as it is, and as it is read; of [`shifted_by_places`] the distances.
    /// Geometric means.
    pub left: [f64; 2],
}

/// A way to read a list of so many presses.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Reading {
    count: usize,
    from: usize,
    by: isize,
}

impl Reading {
    /// The line of a press; none where the list does not have it.
    fn line(&self, press: usize) -> Option<usize> {
        if press < self.from {
            return Some(press);
        }
        // The press that was skipped is in no line: the one before it is that of another press.
        let skipped = self.by < 0 && press == self.from && press > 0;
        let there = press.checked_add_signed(self.by).filter(|line| *line < self.count);
        there.filter(|_| !skipped)
    }

    /// Of some presses those with a line, at its place.
    fn of(&self, all: &Presses, presses: impl Iterator<Item = usize>) -> (Vec<usize>, Presses) {
        let (numbers, lines): (Vec<usize>, Vec<usize>) = presses.filter_map(|k| Some((k, self.line(k)?))).unzip();
        let before = |k: &usize| Some(all.places_mm[self.line(k.checked_sub(1)?)?]);
        let read = Presses {
            places_mm: lines.iter().map(|line| all.places_mm[*line]).collect(),
            before_mm: numbers.iter().map(before).collect(),
            changes: all.changes.select_rows(&numbers),
        };
        (numbers, read)
    }
}

/// What maps of the others, learned of a list as it is read, leave of each press: at the place of its own line, and at that of the line
/// beside, where there is one.
fn left(choice: &Choice, all: &Presses, reading: Reading) -> Option<Vec<(f64, Option<f64>)>> {
    let mut list = vec![(0.0, None); all.len()];
    for (out, others) in folds(all.len(), QUICK_FOLDS) {
        let maps = choice.maps(&reading.of(all, others.into_iter()).1)?;
        let own = all.select(&out);
        let of_own = left_of(&Residuals::of(&maps, &own), &maps.scale);
        // As if the whole list were shifted.
        let shifted = Reading { from: 0, ..reading };
        let (numbers, beside) = shifted.of(all, out.iter().copied());
        let of_beside = if numbers.is_empty() {
            Vec::new()
        } else {
            left_of(&Residuals::of(&maps, &beside), &maps.scale)
        };
        for (k, left) in out.iter().zip(of_own) {
            list[*k].0 = left;
        }
        for (k, left) in numbers.iter().zip(of_beside) {
            list[*k].1 = Some(left);
        }
    }
    Some(list)
}

/// The press from which on the lines beside tell more, with the sum of what is left then. A press without a line there counts as it is.
fn best_from(left: &[(f64, Option<f64>)]) -> (usize, f64) {
    let mut sum: f64 = left.iter().map(|(own, _)| own).sum();
    let mut best = (left.len(), sum);
    for (k, (own, beside)) in left.iter().enumerate().rev() {
        sum += beside.unwrap_or(*own) - own;
        if sum < best.1 {
            best = (k, sum);
        }
    }
    best
}

/// The best reading of one way round from a start, with the sum of what it leaves.
fn read(choice: &Choice, all: &Presses, start: Reading) -> Option<(Reading, f64)> {
    let (mut reading, mut sum) = (start, f64::INFINITY);
    for _ in 0..READ {
        let (from, least) = best_from(&left(choice, all, reading)?);
        if least >= sum {
            break;
        }
        let same = from == reading.from;
        (reading.from, sum) = (from, least);
        if same {
            break;
        }
    }
    Some((reading, sum))
}

/// Whether the places of presses in order of time are those of the next lines, or of the lines before, from some press on. `None` where the
/// list as it is fits as well, beyond a chance of one in a hundred.
///
/// # Errors
/// [`LearnError`] says what is missing.
pub fn shifted(presses: &[Press], setting: &Setting<'_>) -> Result<Option<Shift>, LearnError> {
    check(presses, setting)?;
    let used = alive(presses, setting.measurements.len());
    let measurements: Vec<Measurement> = used.iter().map(|k| setting.measurements[*k]).collect();
    let count = presses.len();
    let all = gather(presses, &used, &(0..count).collect::<Vec<_>>());
    let found = || -> Option<Shift> {
        let as_it_is = Reading {
            count,
            from: count,
            by: 1,
        };
        let mut own = f64::INFINITY;
        let mut best: Option<(Reading, f64)> = None;
        for choice in first_choices(&all, setting, &measurements) {
            own = own.min(left(&choice, &all, as_it_is)?.iter().map(|l| l.0).sum());
            for by in [1, -1] {
                for start in 0..=STARTS {
                    let from = start * count / STARTS;
                    let tried = read(&choice, &all, Reading { count, from, by })?;
                    if best.is_none_or(|best| tried.1 < best.1) {
                        best = Some(tried);
                    }
                }
            }
        }
        let (reading, least) = best?;
        if reading.from == count || least >= own {
            return None;
        }
        // Both with the maps that fit them best.
        let (numbers, read) = reading.of(&all, 0..count);
        let way = |list: &Presses| rests(&choose(list, setting, &measurements, &mut |_, _| ())?, list);
        let (own, read) = (way(&all)?, way(&read)?);
        let both = numbers.iter().zip(&read).map(|(k, read)| (*k, own[*k], *read));
        surely(reading, both)
    };
    Ok(found())
}

/// The same from where something that did not learn from the list puts each press, mm: none where it finds nothing. Distances below
/// `least_mm` are alike.
pub fn shifted_by_places(found: &[Option<[f64; 2]>], places_mm: &[[f64; 2]], least_mm: f64) -> Option<Shift> {
    let count = places_mm.len();
    let line = |k: usize, by: isize| k.checked_add_signed(by).filter(|line| *line < count);
    let apart = |k: usize, by: isize| {
        let (found, place) = (found[k]?, places_mm[line(k, by)?]);
        Some([found[0] - place[0], found[1] - place[1]])
    };
    // A list whose origin is off is right all the same: on a raster, its neighbours' places may be nearer. Most presses agree then by
    // how much it is off.
    let displaced = |by: isize| {
        let all: Vec<[f64; 2]> = (0..count).filter_map(|k| apart(k, by)).collect();
        let middle = [0, 1].map(|axis| median(all.iter().map(|off| off[axis])));
        let far = |from: [f64; 2]| median(all.iter().map(|off| (off[0] - from[0]).hypot(off[1] - from[1])));
        if 2.0 * far(middle) < far([0.0; 2]) {
            middle
        } else {
            [0.0; 2]
        }
    };
    let [own, next, before] = [0, 1, -1].map(displaced);
    let off = |k: usize, by: isize| {
        let middle = match by {
            0 => own,
            1 => next,
            _ => before,
        };
        let [x, y] = apart(k, by).map(|off| [off[0] - middle[0], off[1] - middle[1]])?;
        Some(0.5 * (x * x + y * y + least_mm * least_mm).ln())
    };
    let way = |by: isize| {
        let left = (0..count).map(|k| off(k, 0).map_or((0.0, None), |own| (own, off(k, by))));
        let (from, sum) = best_from(&left.collect::<Vec<_>>());
        (Reading { count, from, by }, sum)
    };
    let (reading, _) = [1, -1].map(way).into_iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    if reading.from == count {
        return None;
    }
    let both = (0..count).filter_map(|k| {
        reading.line(k)?;
        let read = off(k, if k < reading.from { 0 } else { reading.by })?;
        Some((k, off(k, 0)?, read))
    });
    surely(reading, both)
}

/// Whether a reading surely leaves less than the list as it is: numbers of presses with both logarithms. They are compared press by press,
/// those that are read otherwise, and all: maps of a list that is read right leave less of the others, too.
fn surely(reading: Reading, both: impl Iterator<Item = (usize, f64, f64)>) -> Option<Shift> {
    let all: Vec<(usize, f64, f64)> = both.collect();
    let otherwise: Vec<(usize, f64, f64)> = all.iter().copied().filter(|(k, ..)| *k >= reading.from).collect();
    let gains = |list: &[(usize, f64, f64)]| list.iter().map(|(_, own, read)| own - read).collect::<Vec<_>>();
    let chances = [&all, &otherwise].map(|list| chance_of_gain(&gains(list)));
    let chance = chances
        .into_iter()
        .flatten()
        .map(|(chance, _)| chance)
        .reduce(f64::min)?;
    // Each of both ways from each press on is a reading, compared twice.
    let compared = (4 * reading.count) as f64;
    let mean =
        |of: fn(&(usize, f64, f64)) -> f64| (otherwise.iter().map(of).sum::<f64>() / otherwise.len() as f64).exp();
    (chance < BY_CHANCE / compared).then(|| Shift {
        from: reading.from,
        by: reading.by,
        left: [mean(|(_, own, _)| *own), mean(|(.., read)| *read)],
    })
}
