//! Values of other measurements in the order of those that something was learned from.

use forward::Measurement;
use std::collections::HashMap;

/// Where the measurements that something was learned from are among others.
#[derive(Clone, Debug)]
pub struct Order {
    /// For each its place among the others and its sign; none where it is not there.
    places: Vec<Option<(usize, f64)>>,
    turned_round: usize,
}

impl Order {
    /// Finds measurements among others, each of which is one of them at most. One with its drive or its sense pair turned round has the
    /// other sign. One of the same drive comes first: on real skins a drive and the same turned round do not measure alike.
    pub fn new(measurements: &[Measurement], among: &[Measurement]) -> Self {
        let mut left: HashMap<_, _> = among.iter().enumerate().map(|(k, m)| (*m, k)).collect();
        let mut places = vec![None; measurements.len()];
        let mut turned_round = 0;
        for (drive, sense, sign) in [
            (false, false, 1.0),
            (false, true, -1.0),
            (true, false, -1.0),
            (true, true, 1.0),
        ] {
            for (m, place) in measurements
                .iter()
                .zip(&mut places)
                .filter(|(_, place)| place.is_none())
            {
                let there = left.remove(&Measurement {
                    drive: if drive { m.drive.reversed() } else { m.drive },
                    sense: if sense { m.sense.reversed() } else { m.sense },
                });
                *place = there.map(|k| (k, sign));
                turned_round += usize::from(drive && there.is_some());
            }
        }
        Self { places, turned_round }
    }

    /// How many measurements there are.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// How many are not among the others.
    pub fn missing(&self) -> usize {
        self.places.iter().filter(|p| p.is_none()).count()
    }

    /// How many are there with their drive turned round.
    pub fn turned_round(&self) -> usize {
        self.turned_round
    }

    /// Where some of the measurements, by their numbers, are among the others.
    pub fn among(&self, measurements: &[usize]) -> Vec<usize> {
        let places = measurements.iter().filter_map(|k| *self.places.get(*k)?);
        places.map(|(place, _)| place).collect()
    }

    /// Values of the others in the order of the measurements; not a number where there is none.
    pub fn ordered(&self, values: &[f64]) -> Vec<f64> {
        let value = |place: &Option<(usize, f64)>| {
            let there = place.and_then(|(k, sign)| Some(sign * values.get(k)?));
            there.unwrap_or(f64::NAN)
        };
        self.places.iter().map(value).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Pair, Pattern};

    #[test]
    fn a_row_is_one_measurement_and_its_own_drive_comes_first() {
        let pattern = Pattern::opposite(8).unwrap();
        let of: Vec<Measurement> = pattern.measurements().to_vec();
        let turned = |m: &Measurement| Measurement {
            drive: m.drive.reversed(),
            sense: m.sense,
        };
        let half: Vec<Measurement> = of.iter().copied().filter(|m| m.drive.plus < 4).collect();
        let both: Vec<Measurement> = half.iter().copied().chain(half.iter().map(turned)).collect();
        // Rows that are not there are not those of the drive that is turned round.
        let order = Order::new(&both, &half);
        assert_eq!((order.missing(), order.turned_round()), (half.len(), 0));
        let values: Vec<f64> = (0..half.len()).map(|k| k as f64).collect();
        let ordered = order.ordered(&values);
        assert_eq!(&ordered[..half.len()], values.as_slice());
        assert!(ordered[half.len()..].iter().all(|v| v.is_nan()));
        // Where only those are there, they are taken with the other sign.
        let round: Vec<Measurement> = half.iter().map(turned).collect();
        let order = Order::new(&half, &round);
        assert_eq!((order.missing(), order.turned_round()), (0, half.len()));
        assert!(order.ordered(&values).iter().zip(&values).all(|(a, b)| *a == -b));
        // A sense pair turned round is nothing that has to be said.
        let senses = half.iter().map(|m| Measurement {
            drive: m.drive,
            sense: Pair::new(m.sense.minus, m.sense.plus),
        });
        let order = Order::new(&half, &senses.collect::<Vec<_>>());
        assert_eq!((order.missing(), order.turned_round()), (0, 0));
        assert_eq!(order.ordered(&values)[3], -3.0);
        assert_eq!(order.among(&[3, 5]), [3, 5]);
    }
}
