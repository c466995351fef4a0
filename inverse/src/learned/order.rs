//! Values of other measurements in the order of those that something was learned from.

use forward::Measurement;
use std::collections::HashMap;

/// Where the measurements that something was learned from are among others.
#[derive(Clone, Debug)]
pub struct Order {
    /// For each its place among the others and its sign; none where it is not there.
    places: Vec<Option<(usize, f64)>>,
}

impl Order {
    /// Finds measurements among others. One with its drive or its sense pair turned round has the other sign.
    pub fn new(measurements: &[Measurement], among: &[Measurement]) -> Self {
        let places: HashMap<_, _> = among.iter().enumerate().map(|(k, m)| (*m, k)).collect();
        let find = |m: &Measurement| {
            let turned = |drive: bool, sense: bool| Measurement {
                drive: if drive { m.drive.reversed() } else { m.drive },
                sense: if sense { m.sense.reversed() } else { m.sense },
            };
            [
                (false, false, 1.0),
                (false, true, -1.0),
                (true, false, -1.0),
                (true, true, 1.0),
            ]
            .iter()
            .find_map(|(d, s, sign)| places.get(&turned(*d, *s)).map(|k| (*k, *sign)))
        };
        Self {
            places: measurements.iter().map(find).collect(),
        }
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

    /// Values of the others in the order of the measurements; not a number where there is none.
    pub fn ordered(&self, values: &[f64]) -> Vec<f64> {
        let value = |place: &Option<(usize, f64)>| {
            let there = place.and_then(|(k, sign)| Some(sign * values.get(k)?));
            there.unwrap_or(f64::NAN)
        };
        self.places.iter().map(value).collect()
    }
}
