//! Where to press next: at the place of which the presses so far tell least, by the posterior variance of the maps that are to be
//! learned.
//!
//! The maps are a process that turned measurements share, one that each has of its own, and noise, as those of
//! [`learn`](super::learn()). Here they are as fine in the middle of the sheet as at its rim (Matérn's covariance), since presses are to be
//! located everywhere. The variance of their posterior depends on where the presses are, and not on what they give, so that all marks
//! are known beforehand. The next mark is where the variance, as a mean over the measurements of an orbit, is largest. That is the greedy
//! choice by entropy (MacKay 1992; Krause, Singh and Guestrin 2008). Marks of a list are exchanged after that (Fedorov 1972, "Theory of
//! Optimal Experiments").

use super::harmonics::{HIGHEST, Harmonics, SQUARE};
use super::maps::FIRST_NOISE;
use super::symmetry::turn;
use forward::{Geometry, GeometryError, Sheet};
use nalgebra::{Cholesky, DMatrix};
use std::f64::consts::TAU;

/// Length over which maps change, over the reach of the marks.
const LENGTH: f64 = 0.45;
/// Variances of what an orbit shares and of what a measurement has of its own, over the mean square of their values.
const SHARED: f64 = 1.5;
const OWN: f64 = 0.08;
/// Candidates from one to the next, over the length of the maps: finer than that they tell the same.
const STEP: f64 = 0.25;
/// Exchanges that are tried at most, times the marks: each takes as long as there are marks. Where that is less than one for every mark
/// none is tried; of hundreds of marks each says little.
const EXCHANGES: usize = 12_000;
/// Part of the tip's radius that may be missing at the rim: outlines are polygons.
const ROUNDING: f64 = 1e-3;

/// Part of what is expected of the maps at a place that presses have to tell: half of it.
const TOLD: f64 = 0.5;

/// Where presses tell little of a sheet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaps {
    /// Part of the sheet of whose maps they tell less than half, and less than as many presses do that are spread well; 0 to 1.
    pub part: f64,
    /// Marks, mm, that with the presses reach all of it; those that tell most first.
    pub also_mm: Vec<[f64; 2]>,
}

/// Chooses marks on a sheet, one after the other.
#[derive(Clone)]
pub struct Marks {
    places_mm: Vec<[f64; 2]>,
    /// Features of the maps that a measurement has of its own, harmonics x places, times the root of their prior.
    own: DMatrix<f64>,
    /// The same of the shared maps, for every turn that maps the sheet onto itself; none where only the whole one does.
    shared: Vec<DMatrix<f64>>,
    taken: Vec<usize>,
    /// Places that nobody can press.
    left_out: Vec<bool>,
}

impl Marks {
    /// For a tip of this radius, mm, that is to lie on the sheet as a whole; the rim's marks are that far from the rim.
    ///
    /// # Errors
    /// A sheet that makes no sense.
    pub fn new(sheet: &Sheet, tip_mm: f64) -> Result<Self, GeometryError> {
        let geometry = Geometry::new(sheet)?;
        let (low, high) = geometry.bounding_box();
        let centre = [0, 1].map(|k| 0.5 * (low[k] + high[k]));
        let half = [0, 1].map(|k| 0.5 * (high[k] - low[k]));
        let step = (STEP * LENGTH * 0.5 * (half[0] + half[1])).max(1e-3 * half[0].hypot(half[1]));
        let clear = |p: &[f64; 2]| geometry.is_clear(*p, tip_mm * (1.0 - ROUNDING));
        let mut places: Vec<[f64; 2]> = Vec::new();
        // Along the rim, moved inwards by the tip's radius.
        let outline = geometry.outline();
        let count = (outline.length() / step).round().max(8.0) as usize;
        let stretch = outline.length() / count as f64;
        for k in 0..count {
            let at = |s: f64| outline.point((s + outline.length()) % outline.length());
            let s = k as f64 * stretch;
            let [a, b] = [at(s - 0.01 * stretch), at(s + 0.01 * stretch)];
            let along = [b[0] - a[0], b[1] - a[1]];
            let length = along[0].hypot(along[1]).max(f64::MIN_POSITIVE);
            let here = at(s);
            let inwards = [-along[1] / length, along[0] / length].map(|v| v * tip_mm);
            let both = [1.0, -1.0].map(|way| [here[0] + way * inwards[0], here[1] + way * inwards[1]]);
            places.extend(both.into_iter().find(clear));
        }
        let steps = |k: usize| (half[k] / step).ceil() as i64;
        for j in -steps(1)..=steps(1) {
            for i in -steps(0)..=steps(0) {
                places.push([centre[0] + i as f64 * step, centre[1] + j as f64 * step]);
            }
        }
        places.retain(clear);
        let electrodes = sheet.electrodes.len();
        let by = turn(sheet)?;
        let about = if by < electrodes { [0.0; 2] } else { centre };
        Ok(Self::of(places, about, &turns(electrodes, by)))
    }

    /// On a disc of which no more is known than its middle and radius, mm. `by`: a turn by so many of its electrodes maps it onto itself.
    pub fn on_disc(centre_mm: [f64; 2], radius_mm: f64, (electrodes, by): (usize, usize)) -> Self {
        let step = STEP * LENGTH * radius_mm;
        let count = (radius_mm / step).ceil() as i64;
        let raster = (-count..=count).flat_map(|j| (-count..=count).map(move |i| [step * i as f64, step * j as f64]));
        let rim = (TAU / (STEP * LENGTH)).ceil() as usize;
        let rim = (0..rim).map(|k| (TAU * k as f64 / rim as f64).sin_cos());
        let rim = rim.map(|(sin, cos)| [radius_mm * cos, radius_mm * sin]);
        let inside = raster.filter(|p| p[0].hypot(p[1]) < radius_mm);
        let places = rim.chain(inside).map(|p| [centre_mm[0] + p[0], centre_mm[1] + p[1]]);
        Self::of(places.collect(), centre_mm, &turns(electrodes, by))
    }

    /// The same without symmetry: every measurement has a map of its own.
    pub fn alone(self) -> Self {
        let centre = [0, 1].map(|k| {
            let along = || self.places_mm.iter().map(|p| p[k]);
            0.5 * (along().fold(f64::MAX, f64::min) + along().fold(f64::MIN, f64::max))
        });
        if self.shared.is_empty() {
            self
        } else {
            Self::of(self.places_mm, centre, &[])
        }
    }

    /// Where presses at these places tell little.
    pub fn unreached(mut self, presses_mm: &[[f64; 2]]) -> Gaps {
        let before = self.variances();
        let over = |marks: &Self| -> Vec<f64> { marks.variances().iter().zip(&before).map(|(v, b)| v / b).collect() };
        let mut spread = self.clone();
        for _ in presses_mm {
            if largest(&over(&spread)) <= TOLD {
                break;
            }
            spread.taken.extend(spread.next());
        }
        let limit = largest(&over(&spread)).max(TOLD);
        presses_mm.iter().for_each(|place| self.press(*place));
        // Many near one place tell little more than one.
        self.taken.sort_unstable();
        self.taken.dedup();
        let beyond = |marks: &Self| over(marks).iter().filter(|v| **v > limit * (1.0 + 1e-9)).count();
        let part = beyond(&self) as f64 / self.places_mm.len().max(1) as f64;
        let mut also_mm = Vec::new();
        while also_mm.len() < self.places_mm.len()
            && beyond(&self) > 0
            && let Some(next) = self.next()
        {
            self.taken.push(next);
            also_mm.push(self.places_mm[next]);
        }
        Gaps { part, also_mm }
    }

    /// Among given places on a sheet that these turns (rad) around a place map onto itself.
    fn of(places_mm: Vec<[f64; 2]>, about_mm: [f64; 2], turns: &[f64]) -> Self {
        let distance = |p: &[f64; 2]| (p[0] - about_mm[0]).hypot(p[1] - about_mm[1]);
        // A millimetre where there is one place, or none.
        let reach_mm = places_mm.iter().map(distance).fold(1.0, f64::max);
        let length_mm = LENGTH * reach_mm;
        let harmonics = Harmonics::new(about_mm, SQUARE * reach_mm, HIGHEST / length_mm);
        let roots: Vec<f64> = harmonics.matern(length_mm).iter().map(|v| v.sqrt()).collect();
        let features = |angle: f64, variance: f64| {
            let (sin, cos) = angle.sin_cos();
            let mut out = DMatrix::zeros(harmonics.len(), places_mm.len());
            for (mut column, p) in out.column_iter_mut().zip(&places_mm) {
                let [x, y] = [p[0] - about_mm[0], p[1] - about_mm[1]];
                let there = [about_mm[0] + cos * x - sin * y, about_mm[1] + sin * x + cos * y];
                harmonics.values_at(there, column.as_mut_slice());
                column
                    .iter_mut()
                    .zip(&roots)
                    .for_each(|(v, root)| *v *= root * variance.sqrt());
            }
            out
        };
        let alone = turns.len() < 2;
        // The same whole variance with and without symmetry.
        let own = features(0.0, OWN + if alone { SHARED } else { 0.0 });
        let shared = if alone {
            Vec::new()
        } else {
            turns.iter().map(|t| features(-t, SHARED)).collect()
        };
        Self {
            left_out: vec![false; places_mm.len()],
            places_mm,
            own,
            shared,
            taken: Vec::new(),
        }
    }

    /// Variance of the maps at every place that can be a mark, after the presses so far: a mean over the measurements of an orbit, over the
    /// mean square of their values.
    pub fn variances(&self) -> Vec<f64> {
        let squares = |m: &DMatrix<f64>| -> Vec<f64> { m.column_iter().map(|c| c.norm_squared()).collect() };
        let mut variances = squares(&self.own);
        let own_taken = self.own.select_columns(&self.taken);
        let noise = DMatrix::identity(self.taken.len(), self.taken.len()) * FIRST_NOISE;
        // Of noise and own maps together: positive definite by the noise.
        let Some(factor) = Cholesky::new(own_taken.tr_mul(&own_taken) + noise) else {
            return variances;
        };
        let lower = factor.l();
        let told = lower
            .solve_lower_triangular(&own_taken.tr_mul(&self.own))
            .unwrap_or_else(|| DMatrix::zeros(self.taken.len(), self.own.ncols()));
        for (v, told) in variances.iter_mut().zip(squares(&told)) {
            *v -= told;
        }
        let seen: Vec<DMatrix<f64>> = self
            .shared
            .iter()
            .filter_map(|turned| lower.solve_lower_triangular(&turned.select_columns(&self.taken).transpose()))
            .collect();
        let size = self.own.nrows();
        let mut information = DMatrix::identity(size, size);
        for seen in &seen {
            information.gemm_tr(1.0, seen, seen, 1.0);
        }
        let Some(information) = Cholesky::new(information) else {
            return variances;
        };
        let share = 1.0 / self.shared.len().max(1) as f64;
        for (turned, seen) in self.shared.iter().zip(&seen) {
            let left = turned - seen.tr_mul(&told);
            if let Some(left) = information.l().solve_lower_triangular(&left) {
                for (v, square) in variances.iter_mut().zip(squares(&left)) {
                    *v += share * square;
                }
            }
        }
        variances
    }

    /// The next mark, mm: where the presses so far tell least. `None` where no place is left.
    pub fn next_mm(&self) -> Option<[f64; 2]> {
        self.next().map(|k| self.places_mm[k])
    }

    fn next(&self) -> Option<usize> {
        let free = (0..self.places_mm.len()).filter(|k| !self.left_out[*k]);
        first_largest(&self.variances(), free.map(|k| (k, k)))
    }

    fn nearest(&self, place_mm: [f64; 2]) -> Option<usize> {
        let distance = |k: &usize| {
            let p = self.places_mm[*k];
            (p[0] - place_mm[0]).hypot(p[1] - place_mm[1])
        };
        (0..self.places_mm.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// There was a press at this place, or near it.
    pub fn press(&mut self, place_mm: [f64; 2]) {
        self.taken.extend(self.nearest(place_mm));
    }

    /// This mark cannot be pressed.
    pub fn skip(&mut self, place_mm: [f64; 2]) {
        if let Some(k) = self.nearest(place_mm) {
            self.left_out[k] = true;
        }
    }

    /// So many marks, mm, in an order in which each tells most after those before it; fewer where the sheet has not so many places. After
    /// the greedy choice marks are exchanged, one at a time, for as long as the largest variance falls (Fedorov 1972).
    pub fn list(mut self, count: usize) -> Vec<[f64; 2]> {
        let pressed = self.taken.len();
        while self.taken.len() < pressed + count.min(self.places_mm.len()) {
            let Some(next) = self.next() else { break };
            self.taken.push(next);
        }
        if !self.exchange(pressed) {
            return self.taken[pressed..].iter().map(|k| self.places_mm[*k]).collect();
        }
        // In order: the same choice among the marks alone.
        let mut left = self.taken.split_off(pressed);
        let mut list = Vec::with_capacity(left.len());
        while !left.is_empty() {
            let variances = self.variances();
            let Some(at) = first_largest(&variances, (0..left.len()).map(|i| (i, left[i]))) else {
                break;
            };
            let mark = left.remove(at);
            self.taken.push(mark);
            list.push(self.places_mm[mark]);
        }
        list
    }

    /// Puts each mark but the first ones where it lowers the largest variance most, until none does any more. Whether any was put elsewhere.
    fn exchange(&mut self, fixed: usize) -> bool {
        let marks = self.taken.len() - fixed;
        let tries = EXCHANGES / marks.max(1);
        if tries < marks {
            return false;
        }
        let mut changed = false;
        let mut variances = self.variances();
        let (mut unchanged, mut k) = (0, 0);
        for _ in 0..tries {
            if unchanged >= marks {
                break;
            }
            let before = self.taken.clone();
            self.taken.remove(fixed + k);
            if let Some(place) = self.next() {
                self.taken.insert(fixed + k, place);
            }
            let after = self.variances();
            if self.taken.len() == before.len() && largest(&after) < largest(&variances) * (1.0 - 1e-6) {
                (variances, unchanged, changed) = (after, 0, true);
            } else {
                self.taken = before;
                unchanged += 1;
            }
            k = (k + 1) % marks;
        }
        changed
    }
}

/// Turns by multiples of so many electrodes, rad.
fn turns(electrodes: usize, by: usize) -> Vec<f64> {
    let all = (0..electrodes).step_by(by.max(1));
    all.map(|t| TAU * t as f64 / electrodes as f64).collect()
}

fn largest(variances: &[f64]) -> f64 {
    variances.iter().copied().fold(0.0, f64::max)
}

/// Of pairs of a number and a place the number whose place has the largest variance; the first of several, so that marks are the same
/// every time.
fn first_largest(variances: &[f64], of: impl Iterator<Item = (usize, usize)>) -> Option<usize> {
    let best = of.reduce(|a, b| {
        if variances[b.1] > variances[a.1] * (1.0 + 1e-9) {
            b
        } else {
            a
        }
    });
    best.map(|(number, _)| number)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest and mean variance on a disc of this radius after presses at given places, and after so many of the design, seen on the same
    /// fine raster. `turns` maps the disc onto itself.
    fn compared(others: &[Vec<[f64; 2]>], count: usize, turns: &[f64]) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
        let radius = 90.0;
        let raster: Vec<[f64; 2]> = (-18..=18)
            .flat_map(|j| (-18..=18).map(move |i| [5.0 * f64::from(i), 5.0 * f64::from(j)]))
            .filter(|p| p[0].hypot(p[1]) <= radius)
            .collect();
        let designed = {
            let rim = (0..72).map(|k| (f64::from(k) * TAU / 72.0).sin_cos());
            let rim = rim.map(|(s, c)| [radius * c, radius * s]);
            let coarse = raster.iter().copied().step_by(3);
            Marks::of(rim.chain(coarse).collect(), [0.0; 2], turns).list(count)
        };
        let judged = |list: &[[f64; 2]]| {
            let all = list.iter().chain(&raster).copied().collect();
            let mut marks = Marks::of(all, [0.0; 2], turns);
            marks.taken = (0..list.len()).collect();
            let variances = marks.variances().split_off(list.len());
            let largest = variances.iter().copied().fold(0.0, f64::max);
            [largest, variances.iter().sum::<f64>() / variances.len() as f64]
        };
        let of_others = others.iter().map(|list| judged(list)).collect();
        (vec![judged(&designed)], of_others)
    }

    /// A square raster in a disc, with a place in the middle or around it.
    fn raster(step: f64, radius: f64, middle: bool) -> Vec<[f64; 2]> {
        let n = (radius / step).ceil() as i32;
        let at = |k: i32| step * (f64::from(k) + if middle { 0.0 } else { 0.5 });
        let all = (-n..=n).flat_map(|j| (-n..=n).map(move |i| [at(i), at(j)]));
        all.filter(|p| p[0].hypot(p[1]) <= radius).collect()
    }

    fn random(count: usize, radius: f64, seed: u64) -> Vec<[f64; 2]> {
        let mut state = seed;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..count)
            .map(|_| {
                let (angle, r) = (TAU * uniform(), radius * uniform().sqrt());
                [r * angle.cos(), r * angle.sin()]
            })
            .collect()
    }

    #[test]
    fn designed_marks_leave_less_unknown_anywhere_than_a_raster_or_random_ones() {
        let full: Vec<f64> = (0..16).map(|t| TAU * f64::from(t) / 16.0).collect();
        // More marks of a symmetric sheet take long.
        let rasters = [(36.0, false), (44.0, true), (52.0, false), (30.0, true)];
        for (turns, rasters) in [(&full[..], &rasters[..2]), (&full[..1], &rasters[..])] {
            for &(step, middle) in rasters {
                let mut others = vec![raster(step, 90.0, middle)];
                let count = others[0].len();
                others.extend((1..=4).map(|seed| random(count, 90.0, seed)));
                let (designed, others) = compared(&others, count, turns);
                assert!(
                    others.iter().all(|other| designed[0][0] < other[0]),
                    "{} turns, {count} marks: {designed:?} {others:?}",
                    turns.len()
                );
            }
        }
    }

    #[test]
    fn marks_lie_on_the_sheet_reach_its_rim_and_each_tells_more_than_the_next() {
        let sheet = Sheet::paper();
        let geometry = Geometry::new(&sheet).unwrap();
        let tip_mm = 6.0;
        let mut marks = Marks::new(&sheet, tip_mm).unwrap();
        let mut last = f64::INFINITY;
        let mut list: Vec<[f64; 2]> = Vec::new();
        for _ in 0..24 {
            let largest = marks.variances().into_iter().fold(0.0, f64::max);
            assert!(largest <= last + 1e-9, "{largest} {last}");
            last = largest;
            let mark = marks.next_mm().unwrap();
            assert!(geometry.is_clear(mark, 0.99 * tip_mm), "{mark:?}");
            assert!(
                list.iter().all(|m| (m[0] - mark[0]).hypot(m[1] - mark[1]) > 5.0),
                "{list:?} {mark:?}"
            );
            marks.press(mark);
            list.push(mark);
        }
        let from_middle = |m: &[f64; 2]| m[0].hypot(m[1]);
        assert!(list.iter().any(|m| from_middle(m) > 97.5 - tip_mm - 0.5), "{list:?}");
        assert!(list.iter().any(|m| from_middle(m) < 30.0), "{list:?}");
    }

    #[test]
    fn a_tip_that_is_larger_than_the_sheet_has_no_marks_and_one_as_large_has_few() {
        assert!(Marks::new(&Sheet::paper(), 200.0).unwrap().list(5).is_empty());
        let middle = Marks::new(&Sheet::paper(), 97.4).unwrap().list(5);
        assert!(
            !middle.is_empty() && middle.iter().all(|m| m[0].hypot(m[1]) < 0.5),
            "{middle:?}"
        );
    }

    #[test]
    fn a_mark_that_is_skipped_does_not_come_again_and_the_rest_takes_its_place() {
        let mut marks = Marks::new(&Sheet::paper(), 5.0).unwrap();
        let first = marks.next_mm().unwrap();
        marks.skip(first);
        let second = marks.next_mm().unwrap();
        assert_ne!(first, second);
        marks.press(second);
        assert!(marks.list(30).iter().all(|m| *m != first));
    }

    /// On a disc with 16-fold symmetry and on one with none: presses all over reach all of it, others do not, and the marks that are asked
    /// for mend it.
    #[test]
    fn where_presses_do_not_reach_is_told_with_the_marks_that_mend_it() {
        let disc = |by: usize| Marks::on_disc([0.0; 2], 90.0, (16, by));
        for by in [1, 16] {
            // Those of the design leave nothing by its own measure.
            for count in [5, 10, 20, 50] {
                let marks = disc(by).list(count);
                let found = disc(by).unreached(&marks);
                assert_eq!((found.part, found.also_mm.len()), (0.0, 0), "{by} {count}");
            }
            let spread = raster(30.0, 90.0, false);
            assert_eq!(disc(by).unreached(&spread).part, 0.0, "{by}");
        }
        let rim = |count: i32| (0..count).map(move |k| (TAU * f64::from(k) / f64::from(count)).sin_cos());
        let at_rim: Vec<[f64; 2]> = rim(24).map(|(s, c)| [80.0 * c, 80.0 * s]).collect();
        let in_corner: Vec<[f64; 2]> = (raster(9.0, 90.0, true).into_iter())
            .filter(|p| p[0] > 20.0 && p[1] > 45.0)
            .collect();
        let on_line: Vec<[f64; 2]> = (0..20).map(|k| [9.0 * f64::from(k) - 85.0, 0.0]).collect();
        for (name, presses, by, away) in [
            ("rim", &at_rim, 1, [0.0, 0.0]),
            ("rim", &at_rim, 16, [0.0, 0.0]),
            ("corner", &in_corner, 1, [0.0, 0.0]),
            ("corner", &in_corner, 16, [-60.0, -40.0]),
            ("line", &on_line, 16, [0.0, 80.0]),
        ] {
            let found = disc(by).unreached(presses);
            assert!(found.part > 0.02 && !found.also_mm.is_empty(), "{name} {by}: {found:?}");
            let off = |p: &[f64; 2]| (p[0] - away[0]).hypot(p[1] - away[1]);
            let nearest = found.also_mm.iter().map(off).fold(f64::INFINITY, f64::min);
            assert!(nearest < 45.0, "{name} {by}: {found:?}");
            let with: Vec<[f64; 2]> = presses.iter().chain(&found.also_mm).copied().collect();
            assert_eq!(disc(by).unreached(&with).part, 0.0, "{name} {by}");
        }
        // A line from the middle to the rim tells all of a sheet that turns.
        assert_eq!(disc(1).unreached(&on_line).part, 0.0);
    }
}
