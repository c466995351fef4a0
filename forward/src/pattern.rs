//! Which electrodes drive and which sense: patterns are data.

use std::collections::HashSet;
use thiserror::Error;

/// Two electrodes, by index from 0. As a drive pair the current flows into `plus` and out of `minus`; as a sense pair
/// the value is the potential of `plus` less that of `minus`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Pair {
    /// Where the drive current enters, or the positive sense input.
    pub plus: usize,
    /// Where the drive current leaves, or the negative sense input.
    pub minus: usize,
}

impl Pair {
    /// A pair from its two electrodes.
    pub const fn new(plus: usize, minus: usize) -> Self {
        Self { plus, minus }
    }

    /// The same two electrodes, the other way round.
    pub const fn reversed(self) -> Self {
        Self {
            plus: self.minus,
            minus: self.plus,
        }
    }

    /// Whether the two pairs share an electrode.
    pub const fn touches(self, other: Self) -> bool {
        self.plus == other.plus || self.plus == other.minus || self.minus == other.plus || self.minus == other.minus
    }
}

/// One value of a frame: who drives, who senses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Measurement {
    /// The drive pair.
    pub drive: Pair,
    /// The sense pair.
    pub sense: Pair,
}

impl Measurement {
    /// The measurement with drive and sense exchanged, both turned round; by reciprocity its transfer impedance is the
    /// same.
    pub const fn reciprocal(self) -> Self {
        Self {
            drive: self.sense.reversed(),
            sense: self.drive.reversed(),
        }
    }
}

/// What is wrong with a pattern. People count measurements and electrodes from 1, and so do the messages.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum PatternError {
    /// An electrode that the sheet does not have.
    #[error(
        "measurement {} names electrode {}, but the sheet has {count} electrodes (1 to {count}); use one of those",
        index + 1,
        electrode + 1
    )]
    NoSuchElectrode {
        /// Which measurement of the pattern, from 0.
        index: usize,
        /// The electrode named, from 0.
        electrode: usize,
        /// How many the sheet has.
        count: usize,
    },
    /// A pair of an electrode with itself.
    #[error("measurement {} pairs electrode {} with itself; name two different electrodes", index + 1, electrode + 1)]
    SameElectrode {
        /// Which measurement of the pattern, from 0.
        index: usize,
        /// The electrode named twice, from 0.
        electrode: usize,
    },
    /// No measurement at all.
    #[error("the pattern has no measurement; give at least one")]
    Empty,
    /// Too few electrodes for the pattern asked for.
    #[error(
        "a step of {step} electrodes is not possible with {count} of them; give a step from 1 to less than their number"
    )]
    TooFewElectrodes {
        /// Electrodes given.
        count: usize,
        /// Distance between the two electrodes of a pair.
        step: usize,
    },
}

/// An ordered list of measurements on a sheet of a given number of electrodes.
///
/// The order is the order of every vector and every matrix row that belongs to the pattern.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    electrodes: usize,
    measurements: Vec<Measurement>,
    drives: Vec<Pair>,
}

impl Pattern {
    /// Checks a list of drive and sense pairs, each `[plus, minus]`, electrodes counted from 0: the order of all vectors.
    ///
    /// # Errors
    /// As for [`Pattern::from_list`].
    pub fn from_pairs(
        electrodes: usize,
        pairs: impl IntoIterator<Item = [[usize; 2]; 2]>,
    ) -> Result<Self, PatternError> {
        let pair = |[plus, minus]: [usize; 2]| Pair::new(plus, minus);
        let measurement = |[drive, sense]: [[usize; 2]; 2]| Measurement {
            drive: pair(drive),
            sense: pair(sense),
        };
        Self::from_list(electrodes, pairs.into_iter().map(measurement).collect())
    }

    /// Any list of measurements.
    ///
    /// # Errors
    /// A measurement that names an electrode outside `0..electrodes`, or one electrode twice in a pair; an empty list.
    pub fn from_list(electrodes: usize, measurements: Vec<Measurement>) -> Result<Self, PatternError> {
        if measurements.is_empty() {
            return Err(PatternError::Empty);
        }
        let mut drives = Vec::new();
        let mut known = HashSet::new();
        for (index, m) in measurements.iter().enumerate() {
            for pair in [m.drive, m.sense] {
                for electrode in [pair.plus, pair.minus] {
                    if electrode >= electrodes {
                        return Err(PatternError::NoSuchElectrode {
                            index,
                            electrode,
                            count: electrodes,
                        });
                    }
                }
                if pair.plus == pair.minus {
                    return Err(PatternError::SameElectrode {
                        index,
                        electrode: pair.plus,
                    });
                }
            }
            if known.insert(m.drive) {
                drives.push(m.drive);
            }
        }
        Ok(Self {
            electrodes,
            measurements,
            drives,
        })
    }

    /// Drive pairs `(m, m + drive_step)` for every m in order; for each, sense pairs `(n, n + sense_step)` for every n in
    /// order, leaving out those that touch the drive pair. Steps of 1 and 1 on 16 electrodes give the 208 values of
    /// the field's adjacent pattern.
    ///
    /// The current enters at m; the sense pair's positive input is `n + sense_step`, so that a homogeneous disc gives
    /// positive values for the adjacent pattern.
    ///
    /// # Errors
    /// [`PatternError::TooFewElectrodes`] when a step is 0 or not smaller than `electrodes`, or nothing is left to
    /// measure.
    pub fn rotating(electrodes: usize, drive_step: usize, sense_step: usize) -> Result<Self, PatternError> {
        for step in [drive_step, sense_step] {
            if step == 0 || step >= electrodes {
                return Err(PatternError::TooFewElectrodes {
                    count: electrodes,
                    step,
                });
            }
        }
        let pair = |k: usize, step: usize| Pair::new(k, (k + step) % electrodes);
        let mut list = Vec::new();
        for m in 0..electrodes {
            let drive = pair(m, drive_step);
            for n in 0..electrodes {
                let sense = pair(n, sense_step).reversed();
                if !drive.touches(sense) {
                    list.push(Measurement { drive, sense });
                }
            }
        }
        if list.is_empty() {
            return Err(PatternError::TooFewElectrodes {
                count: electrodes,
                step: drive_step,
            });
        }
        Self::from_list(electrodes, list)
    }

    /// Neighbouring electrodes drive, neighbouring electrodes sense: the paper's 208 values on 16 electrodes.
    ///
    /// # Errors
    /// Fewer than 4 electrodes.
    pub fn adjacent(electrodes: usize) -> Result<Self, PatternError> {
        Self::rotating(electrodes, 1, 1)
    }

    /// Opposite electrodes drive, neighbouring electrodes sense.
    ///
    /// # Errors
    /// Fewer than 5 electrodes.
    pub fn opposite(electrodes: usize) -> Result<Self, PatternError> {
        Self::rotating(electrodes, electrodes / 2, 1)
    }

    /// How many electrodes the pattern is for.
    pub fn electrodes(&self) -> usize {
        self.electrodes
    }

    /// The measurements in order.
    pub fn measurements(&self) -> &[Measurement] {
        &self.measurements
    }

    /// The distinct drive pairs in order of first use.
    pub fn drives(&self) -> &[Pair] {
        &self.drives
    }

    /// How many measurements a frame has.
    pub fn len(&self) -> usize {
        self.measurements.len()
    }

    /// Whether there is nothing to measure (never, for a pattern that was accepted).
    pub fn is_empty(&self) -> bool {
        self.measurements.is_empty()
    }

    /// For every measurement the index of its reciprocal, where the pattern has it.
    pub fn reciprocal_indices(&self) -> Vec<Option<usize>> {
        let index: std::collections::HashMap<Measurement, usize> =
            self.measurements.iter().enumerate().map(|(k, m)| (*m, k)).collect();
        self.measurements
            .iter()
            .map(|m| index.get(&m.reciprocal()).copied())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adjacent_sixteen_is_the_208_values_in_the_documented_order() {
        let p = Pattern::adjacent(16).unwrap();
        assert_eq!(p.len(), 208);
        assert_eq!(p.drives().len(), 16);
        let first = p.measurements()[0];
        assert_eq!((first.drive, first.sense), (Pair::new(0, 1), Pair::new(3, 2)));
        let second_drive = p.measurements()[13];
        assert_eq!(
            (second_drive.drive, second_drive.sense),
            (Pair::new(1, 2), Pair::new(4, 3))
        );
        let last = p.measurements()[207];
        assert_eq!((last.drive, last.sense), (Pair::new(15, 0), Pair::new(14, 13)));
    }

    #[test]
    fn reciprocity_pairs_every_value_with_another() {
        let p = Pattern::adjacent(16).unwrap();
        let r = p.reciprocal_indices();
        for (k, other) in r.iter().enumerate() {
            let other = other.unwrap();
            assert_ne!(other, k);
            assert_eq!(r[other], Some(k));
        }
    }

    #[test]
    fn nonsense_is_refused_by_name() {
        let m = |a, b, c, d| Measurement {
            drive: Pair::new(a, b),
            sense: Pair::new(c, d),
        };
        assert_eq!(
            Pattern::from_list(8, vec![m(0, 1, 2, 3), m(0, 1, 2, 8)]),
            Err(PatternError::NoSuchElectrode {
                index: 1,
                electrode: 8,
                count: 8
            })
        );
        assert_eq!(
            Pattern::from_list(8, vec![m(3, 3, 2, 1)]),
            Err(PatternError::SameElectrode { index: 0, electrode: 3 })
        );
        assert!(Pattern::adjacent(3).is_err());
        assert!(Pattern::rotating(8, 0, 1).is_err());
    }
}
