//! A search for the fault that explains a frame best. It has parts, so that a frame of a sequence need not have time for all of it.

use super::{
    Diagnosis, GAIN, LEAST_NOISE, OFFSET, RISE, STRONG_RISE, Told, own_noise, values_of_channel, values_of_drive,
};
use crate::reference::Difference;
use crate::reference::diagnosis::evidence::Evidence;
use crate::reference::diagnosis::fault::{Electrodes, Fault};
use crate::reference::diagnosis::press::Press;

/// Parts of a search. With 32 electrodes they take about as long as one another.
pub(crate) const PARTS: usize = 3;
/// Relative error of what a fault is predicted to change: the model's electrodes are not quite the sheet's. Of a sheet that is as its
/// model it is less, which tells a fault from a press.
pub(super) const PREDICTION: f64 = 0.02;
pub(super) const PREDICTIONS: [f64; 3] = [PREDICTION, PREDICTION / 4.0, PREDICTION / 16.0];

/// The best explanation so far, its cost and that of touches alone.
pub(super) struct Best {
    pub(super) fault: Option<Fault>,
    pub(super) cost: f64,
    /// Resistances of the contacts that explain the frame best, ohm.
    pub(super) worse: Vec<(usize, f64)>,
    /// The part of the cost that values have which are not free.
    pub(super) left: f64,
    pub(super) touches: f64,
    /// The most probable fault that changes all values, open electrodes, and the amplifier whose values are free, with their costs.
    of_all: Option<(f64, Fault)>,
    open: Option<(f64, Electrodes)>,
    channel: Option<(f64, [usize; 2])>,
    /// Whether the frame by itself rather speaks for a fault than for the press that it may be.
    perhaps: bool,
}

impl Best {
    /// Whether it is the best now.
    pub(super) fn offer(&mut self, cost: f64, fault: impl FnOnce() -> Fault) -> bool {
        self.offer_free(cost, cost, || Some(fault()))
    }

    /// The same of what leaves values free, and may be nothing that is named.
    pub(super) fn offer_free(&mut self, cost: f64, left: f64, fault: impl FnOnce() -> Option<Fault>) -> bool {
        let better = cost < self.cost;
        if better {
            (self.cost, self.left, self.fault) = (cost, left, fault());
        }
        better
    }

    /// A fault that changes all values may be one of two.
    pub(super) fn offer_of_all(&mut self, cost: f64, fault: Fault) {
        if self.of_all.is_none_or(|(least, _)| cost < least) {
            self.of_all = Some((cost, fault));
        }
        self.offer(cost, || fault);
    }

    /// So may open electrodes.
    pub(super) fn offer_open(&mut self, (cost, left): (f64, f64), electrodes: Electrodes) {
        if self.open.is_none_or(|(least, _)| cost < least) {
            self.open = Some((cost, electrodes));
        }
        self.offer_free(cost, left, || Some(Fault::Open(electrodes)));
    }

    /// So may an amplifier.
    pub(super) fn offer_channel(&mut self, (cost, left): (f64, f64), pair: [usize; 2]) {
        if self.channel.is_none_or(|(least, _)| cost < least) {
            self.channel = Some((cost, pair));
        }
        self.offer_free(cost, left, || Some(Fault::Channel(pair)));
    }
}

/// A search that was begun.
pub(crate) struct Search {
    /// What is looked at.
    pub(super) d: Difference,
    /// Standard deviation of every value's own noise, V of the model; not finite for a value that takes no part.
    pub(super) own: Vec<f64>,
    /// Relative errors of what is predicted: the one that is searched with, and smaller ones that may be the case.
    predictions: &'static [f64],
    pub(super) evidence: Evidence,
    pub(super) best: Best,
    /// Cost of touches alone, however strong; infinite before the last part.
    pub(super) strong: f64,
    /// Parts that are done.
    done: usize,
}

impl Search {
    /// Of a difference. None where its covariance is none.
    pub(super) fn new(
        diagnosis: &mut Diagnosis,
        d: Difference,
        own: Vec<f64>,
        predictions: &'static [f64],
    ) -> Option<Self> {
        let errors = errors(&d, &own, *predictions.first()?);
        let evidence = Evidence::new(&d.y, (&mut diagnosis.covariance, 1.0), &errors, diagnosis.largest_v)?;
        let touches = evidence.of_touches();
        let best = Best {
            fault: None,
            cost: touches,
            worse: Vec::new(),
            left: touches,
            touches,
            of_all: None,
            open: None,
            channel: None,
            perhaps: false,
        };
        Some(Self {
            d,
            own,
            predictions,
            evidence,
            best,
            strong: f64::INFINITY,
            done: 0,
        })
    }

    /// Parts that are left.
    pub(crate) fn left(&self) -> usize {
        PARTS - self.done.min(PARTS)
    }

    /// How many values take part.
    pub(super) fn used(&self) -> f64 {
        self.d.used.iter().filter(|used| **used).count() as f64
    }

    /// The most probable faults that may be one of two: open electrodes; and where one fault explains nothing, one that changes all
    /// values, open electrodes together, and an amplifier.
    pub(super) fn may_be_one_of_two(&self, explains: bool) -> Vec<Fault> {
        let best = &self.best;
        let open = best.open.iter().map(|(_, open)| *open);
        let each = best.open.iter().flat_map(|(_, open)| open.list());
        let each = each.map(|l| Fault::Open(Electrodes::of(&[*l])));
        if explains {
            return each.collect();
        }
        let of_all = best.of_all.iter().map(|(_, fault)| *fault);
        let together = open.filter(|open| open.list().len() > 1).map(Fault::Open);
        let channel = best.channel.iter().map(|(_, pair)| Fault::Channel(*pair));
        of_all.chain(each).chain(together).chain(channel).collect()
    }

    /// Whether what is looked at is a baseline, compared with the model.
    fn is_of_baseline(&self) -> bool {
        self.predictions.len() == 1
    }

    /// The best explanation, after all parts.
    pub(super) fn end(mut self, diagnosis: &mut Diagnosis) -> Best {
        while !diagnosis.go_on(&mut self) {}
        self.best
    }
}

/// Standard deviation of what every value is off by with its noise and a relative error of what is predicted.
fn errors(d: &Difference, own: &[f64], prediction: f64) -> Vec<f64> {
    own.iter().zip(&d.y).map(|(own, y)| own.hypot(prediction * y)).collect()
}

impl Diagnosis {
    /// Begins a search for what explains a difference. `sigma_v`: noise of one value, V of the model.
    pub(crate) fn begin(&mut self, d: &Difference, sigma_v: Option<f64>) -> Option<Search> {
        let d = self.seen(d).into_owned();
        let sigma_v = sigma_v.unwrap_or(LEAST_NOISE * self.mean_v);
        let own = own_noise(&d, sigma_v);
        Search::new(self, d, own, &PREDICTIONS)
    }

    /// Goes on with the next part of a search; whether it was the last.
    pub(crate) fn go_on(&mut self, search: &mut Search) -> bool {
        let of_frame = !search.is_of_baseline();
        let Search { d, evidence, best, .. } = search;
        match search.done {
            0 => {
                self.offer_source(evidence, of_frame.then_some(&*d), best);
                self.offer_multiplexers(evidence, best);
                self.offer_shorts(evidence, best);
            }
            1 => {
                self.offer_contacts(evidence, best);
                self.offer_channels(evidence, d, of_frame, best);
                self.offer_saturation(evidence, best);
                self.offer_values(evidence, best);
                self.offer_open(evidence, best);
            }
            _ => self.offer_presses(search),
        }
        search.done += 1;
        search.done >= PARTS
    }

    /// What a search that is at its end told: the fault that explains the difference best; none where touches and drift do, or where it
    /// leaves more than twice the square that is expected.
    pub(crate) fn told(&self, search: &Search) -> Told {
        let (best, values) = (&search.best, search.used());
        match best.fault {
            // Otherwise it is nothing that is known.
            Some(fault) if best.left <= values => Told::Faults {
                faults: self.of_its_size(self.of_all_values(fault)).into(),
                alone: best.touches > values,
            },
            None if best.perhaps => Told::Perhaps,
            _ => Told::Nothing,
        }
    }

    /// Holds the best fault against strong touches anywhere, and against a press on its electrodes.
    fn offer_presses(&mut self, search: &mut Search) {
        let errors_of_all = errors(&search.d, &search.own, search.predictions[0]);
        let covariance = (&mut self.covariance, STRONG_RISE / RISE);
        let strong = Evidence::new(&search.d.y, covariance, &errors_of_all, self.largest_v);
        let best = &mut search.best;
        let Some(strong) = strong.map(|strong| strong.of_touches_beside(&search.evidence)) else {
            (best.fault, best.cost, best.left) = (None, best.touches, best.touches);
            return;
        };
        search.strong = strong;
        if best.fault.is_some() && strong < best.cost {
            (best.fault, best.cost, best.left) = (None, strong, strong);
        }
        let Search {
            d,
            own,
            predictions,
            evidence,
            best,
            ..
        } = search;
        // A baseline is not held against presses: what is found in it leaves no touches.
        let exact = &predictions[1..];
        let may_press = best.fault.filter(|_| !exact.is_empty());
        if let Some(press) = may_press.and_then(|fault| Press::instead_of(fault, &self.imager)) {
            let prior = best.cost - self.cost_of(best, d, evidence);
            let place = press.places() * (self.electrodes() as f64).ln();
            let (mut broken, mut touched) = (best.cost, place + evidence.beside(&press.columns));
            for prediction in exact {
                let errors = errors(d, own, *prediction);
                let other = Evidence::new(&d.y, (&mut self.covariance, 1.0), &errors, self.largest_v);
                let Some(other) = other else { continue };
                let wider = other.wider_than(evidence);
                broken = broken.min(prior + self.cost_of(best, d, &other) + wider);
                touched = touched.min(place + other.beside(&press.columns) + wider);
            }
            tracing::debug!(?best.fault, broken, touched, prior, "a press instead");
            if touched < broken {
                (best.fault, best.cost, best.left) = (None, touched, touched);
                // Nothing but how seldom it is speaks against the fault.
                best.perhaps = broken - prior < touched - place;
            }
        }
        tracing::debug!(?best.fault, best.touches, best.cost, "looked for a fault");
    }

    /// Cost of the best fault, without that of its being there, in a frame seen otherwise; infinite for faults that no press looks like.
    fn cost_of(&self, best: &Best, d: &Difference, evidence: &Evidence) -> f64 {
        let of_channel = |pair: [usize; 2]| self.channel_columns(&values_of_channel(&self.imager, pair), d);
        match best.fault {
            Some(Fault::Short { electrodes, ohm }) => self.refine_short((electrodes, ohm), evidence).1,
            Some(Fault::Contacts(_)) => self.refine_contacts(&mut best.worse.clone(), evidence),
            Some(Fault::Open(electrodes)) => evidence.free(&self.values_of(electrodes.list())).0,
            Some(Fault::Gain(pair, _)) => evidence.along(&of_channel(pair)[0], GAIN).0,
            Some(Fault::Drive(pair, _)) => {
                let values = values_of_drive(&self.imager, pair);
                evidence.along(&self.gain_column(&values, d), GAIN).0
            }
            Some(Fault::Offset(pair)) => evidence.along(&of_channel(pair)[1], OFFSET * self.mean_v).0,
            Some(Fault::Channel(pair)) => evidence.free(&values_of_channel(&self.imager, pair)).0,
            Some(Fault::Value(k, _)) => evidence.free(&[k]).0,
            _ => f64::INFINITY,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::imager::Imager;
    use forward::{Drive, Pattern, Sheet};
    use nalgebra::DVector;
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, Normal};
    use std::sync::Arc;

    /// A search tells the same in one go, and in parts between which other frames are searched; and it tells the fault.
    #[test]
    fn a_search_in_parts_tells_the_same() {
        let pattern = Pattern::adjacent(16).unwrap();
        let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 10.0).unwrap());
        let mut diagnosis = Diagnosis::new(&imager).unwrap();
        let sigma_v = 1e-3 * diagnosis.mean_v;
        let of = |change: DVector<f64>| Difference {
            spread: vec![1.0; change.len()],
            used: vec![true; change.len()],
            y: change,
        };
        let short = of(diagnosis.short([2, 6], 30.0));
        let exchanged = of(diagnosis.exchanged([3, 8]));
        let contact = of(diagnosis.contacts(&[(4, 300.0)]));
        let nothing = of(DVector::zeros(imager.pattern.len()));
        let mut whole = |d: &Difference| {
            let mut search = diagnosis.begin(d, Some(sigma_v)).unwrap();
            while !diagnosis.go_on(&mut search) {}
            diagnosis.told(&search)
        };
        let in_one = [&short, &exchanged, &contact, &nothing].map(&mut whole);
        let mut cut = [&short, &exchanged, &contact, &nothing].map(|d| diagnosis.begin(d, Some(sigma_v)).unwrap());
        for part in 0..PARTS {
            for search in &mut cut {
                assert_eq!(search.left(), PARTS - part);
                assert_eq!(diagnosis.go_on(search), part + 1 == PARTS);
            }
        }
        assert_eq!(cut.each_ref().map(|search| diagnosis.told(search)), in_one);
        let faults = in_one.map(Told::fault);
        assert!(
            matches!(faults[0], Some(Fault::Short { electrodes: [2, 6], .. })),
            "{faults:?}"
        );
        assert!(matches!(faults[1], Some(Fault::Exchanged([3, 8]))), "{faults:?}");
        assert_eq!(faults[3], None);
    }

    /// A leak between two wires is told with its resistance, however large, until noise hides it. What a finger leaves that is lifted from
    /// the rim, between any electrodes, is none.
    #[test]
    fn leaks_are_told_by_their_resistance_and_lifted_fingers_are_none() {
        let pattern = Pattern::adjacent(16).unwrap();
        let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 5.0).unwrap());
        let mut diagnosis = Diagnosis::new(&imager).unwrap();
        let sigma_v = 1e-3 * diagnosis.mean_v;
        let mut rng = StdRng::seed_from_u64(4);
        let mut tell = |change: &DVector<f64>| {
            let noise = Normal::new(0.0, sigma_v).unwrap();
            let d = Difference {
                spread: vec![1.0; change.len()],
                used: vec![true; change.len()],
                y: change.map(|v| v + noise.sample(&mut rng)),
            };
            let mut search = diagnosis.begin(&d, Some(sigma_v)).unwrap();
            while !diagnosis.go_on(&mut search) {}
            diagnosis.told(&search).fault()
        };
        let of = Diagnosis::new(&imager).unwrap();
        for pair in [[2, 3], [0, 15], [2, 6], [1, 9]] {
            for ohm in [1e3, 4e3, 1e4, 3e4, 1e5] {
                let fault = tell(&of.short(pair, ohm));
                let Some(Fault::Short { electrodes, ohm: told } | Fault::Leak { electrodes, ohm: told }) = fault else {
                    panic!("{pair:?} over {ohm} ohm: {fault:?}");
                };
                assert_eq!(electrodes, pair, "{ohm} ohm");
                let near = pair[1] - pair[0] == 1 || pair == [0, 15];
                let (weak, strong) = (near && ohm >= 1e4, ohm <= 4e3 || (!near && ohm <= 3e4));
                let told_weak = matches!(fault, Some(Fault::Leak { .. }));
                assert!(
                    if weak { told_weak } else { !strong || !told_weak },
                    "{pair:?} over {ohm} ohm: {fault:?}"
                );
                // What noise hides is a part of the leak that grows with its resistance.
                assert!((told / ohm - 1.0).abs() < 0.02 + ohm / 5e5, "{ohm} ohm: {told}");
            }
        }
        for turn in 0..32 {
            let turn = f64::from(turn) * std::f64::consts::PI / 16.0;
            for from_rim in [4.0, 9.0, 20.0] {
                let out = imager.electrodes_mm[0][0].hypot(imager.electrodes_mm[0][1]) - from_rim;
                let at = [out * turn.cos(), out * turn.sin()];
                let mut fall = DVector::zeros(imager.pattern.len());
                for cell in 0..imager.grid.len() {
                    let c = imager.grid.centre(cell);
                    let apart = (c[0] - at[0]).hypot(c[1] - at[1]) / 8.0;
                    fall -= 0.3 * (-0.5 * apart * apart).exp() * imager.sensitivity.column(cell);
                }
                let fault = tell(&fall);
                let leaks = matches!(fault, Some(Fault::Short { .. } | Fault::Leak { .. }));
                assert!(!leaks, "{at:?}: {fault:?}");
            }
        }
    }
}
