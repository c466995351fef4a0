//! Which measurements are the same one, turned with the sheet.

use forward::{Measurement, Pair};
use nalgebra::DMatrix;
use std::collections::HashMap;

/// One measurement as a turned copy of the first of its orbit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Member {
    /// Number of the orbit.
    pub(super) orbit: usize,
    /// By how many electrodes it is turned against the first of the orbit.
    pub(super) turned: usize,
    /// Whether it has the opposite sign.
    pub(super) negative: bool,
}

/// The orbits of a list of measurements under turns by multiples of `step` electrodes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Orbits {
    pub(super) members: Vec<Member>,
    pub(super) count: usize,
    /// Electrodes once around.
    around: usize,
    /// Turns by which the first of an orbit makes the others.
    pub(super) turns: usize,
    /// For every orbit and turn the measurements that are there, with whether they have the opposite sign: none where one is missing, and
    /// the same at two turns where a turn makes a measurement of itself.
    pub(super) slots: Vec<Vec<Vec<(usize, bool)>>>,
}

impl Orbits {
    /// Orbits under turns by `step`, `2 step` and so on of `electrodes`. With `step = electrodes` every measurement is alone.
    /// A turned measurement whose pairs are reversed is the same with the other sign, unless the list has both.
    pub(super) fn new(measurements: &[Measurement], electrodes: usize, step: usize) -> Self {
        let places: HashMap<Measurement, usize> = measurements.iter().enumerate().map(|(k, m)| (*m, k)).collect();
        let mut members: Vec<Option<Member>> = vec![None; measurements.len()];
        let step = step.max(1);
        let turns = electrodes.div_ceil(step).max(1);
        let mut slots: Vec<Vec<Vec<(usize, bool)>>> = Vec::new();
        for (first, measurement) in measurements.iter().enumerate() {
            if members[first].is_some() {
                continue;
            }
            let count = slots.len();
            let mut there_are = vec![Vec::new(); turns];
            for (slot, turned) in (0..electrodes).step_by(step).enumerate() {
                let there = turn(*measurement, turned, electrodes);
                let candidates = [
                    (there, false),
                    (of(there.drive, there.sense.reversed()), true),
                    (of(there.drive.reversed(), there.sense), true),
                    (of(there.drive.reversed(), there.sense.reversed()), false),
                ];
                let found = candidates
                    .iter()
                    .find_map(|(m, negative)| places.get(m).map(|k| (*k, *negative)));
                if let Some((place, negative)) = found {
                    let member = members[place].get_or_insert(Member {
                        orbit: count,
                        turned,
                        negative,
                    });
                    if member.orbit == count {
                        there_are[slot].push((place, negative));
                    }
                }
            }
            // The same measurement twice: each is its own copy.
            if members[first].is_none() {
                members[first] = Some(Member {
                    orbit: count,
                    turned: 0,
                    negative: false,
                });
                there_are[0].push((first, false));
            }
            slots.push(there_are);
        }
        Self {
            members: members.into_iter().flatten().collect(),
            count: slots.len(),
            around: electrodes,
            turns,
            slots,
        }
    }

    /// The mean of a matrix over all turns: of every two measurements the mean over those that are the same two, turned. What one that
    /// is missing has counts as nothing, so that a covariance stays one.
    pub(super) fn turned_mean(&self, matrix: &DMatrix<f64>) -> DMatrix<f64> {
        let mut turns: Vec<usize> = self.members.iter().map(|m| m.turned).collect();
        turns.sort_unstable();
        turns.dedup();
        // Of every orbit and turn the measurement with its sign.
        let mut places: HashMap<(usize, usize), (usize, f64)> = HashMap::new();
        for (k, m) in self.members.iter().enumerate() {
            places.insert((m.orbit, m.turned), (k, if m.negative { -1.0 } else { 1.0 }));
        }
        let around = self.around;
        let turned = |k: usize, by: usize| {
            let m = self.members[k];
            places.get(&(m.orbit, (m.turned + by) % around)).copied()
        };
        let signs: Vec<f64> = self
            .members
            .iter()
            .map(|m| if m.negative { -1.0 } else { 1.0 })
            .collect();
        let mut mean = DMatrix::zeros(matrix.nrows(), matrix.ncols());
        for by in turns.iter().copied() {
            let list: Vec<Option<(usize, f64)>> = (0..self.members.len()).map(|k| turned(k, by)).collect();
            for (j, to) in list.iter().enumerate() {
                let Some((column, sign)) = to else { continue };
                for (i, from) in list.iter().enumerate() {
                    if let Some((row, other)) = from {
                        mean[(i, j)] += sign * other * signs[i] * signs[j] * matrix[(*row, *column)];
                    }
                }
            }
        }
        mean / turns.len() as f64
    }

    /// Number of a member's slot among those of all orbits.
    pub(super) fn slot(&self, member: &Member) -> usize {
        member.orbit * self.turns + member.turned * self.turns / self.around.max(1)
    }

    /// The measurements of every orbit.
    pub(super) fn lists(&self) -> Vec<Vec<usize>> {
        let mut lists = vec![Vec::new(); self.count];
        for (k, member) in self.members.iter().enumerate() {
            lists[member.orbit].push(k);
        }
        lists
    }
}

const fn of(drive: Pair, sense: Pair) -> Measurement {
    Measurement { drive, sense }
}

fn turn(m: Measurement, by: usize, electrodes: usize) -> Measurement {
    let turned = |p: Pair| Pair::new((p.plus + by) % electrodes, (p.minus + by) % electrodes);
    Measurement {
        drive: turned(m.drive),
        sense: turned(m.sense),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::Pattern;

    #[test]
    fn a_rotating_pattern_has_one_orbit_for_every_offset_of_its_sense_pairs() {
        let adjacent = Pattern::adjacent(16).unwrap();
        let orbits = Orbits::new(adjacent.measurements(), 16, 1);
        assert_eq!(orbits.count, 13);
        assert!(orbits.lists().iter().all(|l| l.len() == 16));
        assert!(orbits.members.iter().all(|m| !m.negative));
        // Turned by four electrodes, as a square may be, four of them take the place of one.
        assert_eq!(Orbits::new(adjacent.measurements(), 16, 4).count, 52);
        assert_eq!(Orbits::new(adjacent.measurements(), 16, 16).count, 208);
    }

    #[test]
    fn a_measurement_that_is_there_twice_is_twice_in_its_orbit() {
        let adjacent = Pattern::adjacent(8).unwrap();
        let list = [adjacent.measurements(), &adjacent.measurements()[..3]].concat();
        let orbits = Orbits::new(&list, 8, 1);
        assert_eq!((orbits.members.len(), orbits.count), (list.len(), 5));
        assert_eq!(orbits.members[1], orbits.members[list.len() - 2]);
        assert_eq!(orbits.slots.iter().flatten().flatten().count(), list.len());
    }

    #[test]
    fn a_measurement_driven_both_ways_is_two_and_one_turned_round_has_the_other_sign() {
        let of = |d: [usize; 2], s: [usize; 2]| Measurement {
            drive: Pair::new(d[0], d[1]),
            sense: Pair::new(s[0], s[1]),
        };
        let both = [of([0, 4], [2, 1]), of([4, 0], [2, 1])];
        assert_eq!(Orbits::new(&both, 8, 8).count, 2);
        let round = [of([0, 1], [3, 2]), of([1, 2], [3, 4])];
        let orbits = Orbits::new(&round, 8, 1);
        assert_eq!(orbits.count, 1);
        assert_eq!((orbits.members[1].turned, orbits.members[1].negative), (1, true));
        // Half a turn makes of it itself, with the other sign of the drive.
        let half = Orbits::new(&both[..1], 8, 4);
        assert_eq!(half.slots, [vec![vec![(0, false)], vec![]]]);
        let across = Orbits::new(&[of([0, 4], [2, 6])], 8, 4);
        assert_eq!(across.slots, [vec![vec![(0, false)], vec![(0, false)]]]);
    }
}
