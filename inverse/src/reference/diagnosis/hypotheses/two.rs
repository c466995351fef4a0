//! A search for one fault, and for two at once where one does not explain a frame well.
//!
//! Of two faults one is taken out of the frame: what it changes of all values is subtracted, or the values that it spoils are left out. What
//! is left is searched like any frame. Once that tells the other, the other is taken out, and the first looked at once more: an amplifier
//! that may give anything is perhaps one of another gain. The two are told where they cost less than one.

use super::search::{PREDICTION, PREDICTIONS, Search};
use super::{Diagnosis, FAULT, RESISTANCE, SWITCH, Told, readdressed, spoilt_by};
use crate::reference::Difference;
use crate::reference::diagnosis::fault::{Fault, Faults};
use crate::stats::is_of_noise;
use nalgebra::DVector;

/// A search for one fault or two, in parts.
pub(crate) struct SearchOfTwo {
    one: Search,
    /// What is named already, and whether touches explain what it leaves.
    known: Option<(Faults, bool)>,
    /// Faults beside which another is looked for, the last first.
    may_have: Vec<Fault>,
    beside: Option<Beside>,
    /// What explains the frame best, and its cost.
    told: Told,
    cost: f64,
    /// Whether two leave no more than noise.
    enough: bool,
}

/// A search in what a fault leaves of a frame.
struct Beside {
    taken_out: Fault,
    search: Search,
    /// Whether this one was told where the other one was taken out.
    again: bool,
}

impl SearchOfTwo {
    /// Parts that are left of what was begun.
    pub(crate) fn left(&self) -> usize {
        self.beside.as_ref().map_or(&self.one, |beside| &beside.search).left()
    }

    /// What it told, at its end.
    pub(crate) fn told(&self) -> Told {
        self.told
    }

    /// Whether two are named already.
    fn are_known(&self) -> bool {
        self.known.is_some_and(|(known, _)| known.single().is_none())
    }

    /// Whether two are named, this is one of them, and nothing that was told is two.
    fn may_be_known(&self, fault: Fault) -> bool {
        let of_two = |(known, _): (Faults, bool)| known.iter().any(|of| of.is_same(&fault));
        let told_one = self.told.faults().is_none_or(|told| told.single().is_some());
        self.are_known() && told_one && self.known.is_some_and(of_two)
    }

    /// Whether they are the best now.
    fn offer(&mut self, faults: Faults, cost: f64) -> bool {
        let better = cost < self.cost;
        if better {
            let alone = self.one.best.touches > self.one.used();
            (self.told, self.cost) = (Told::Faults { faults, alone }, cost);
        }
        better
    }
}

impl Diagnosis {
    /// Begins a search for one fault or two. `sigma_v`: noise of one value, V of the model. `known`: what is named already, and whether
    /// touches explain what it leaves.
    pub(crate) fn begin_two(
        &mut self,
        d: &Difference,
        sigma_v: Option<f64>,
        known: Option<(Faults, bool)>,
    ) -> Option<SearchOfTwo> {
        let one = self.begin(d, sigma_v)?;
        let faults = known.into_iter().flat_map(|(faults, _)| faults.iter());
        Some(SearchOfTwo {
            known,
            may_have: faults.collect(),
            one,
            beside: None,
            told: Told::Nothing,
            cost: f64::INFINITY,
            enough: false,
        })
    }

    /// Goes on with the next part; whether it was the last.
    pub(crate) fn go_on_two(&mut self, search: &mut SearchOfTwo) -> bool {
        let Some(beside) = &mut search.beside else {
            if !self.go_on(&mut search.one) {
                return false;
            }
            (search.told, search.cost) = (self.told(&search.one), search.one.best.cost);
            if !self.may_be_two(search) {
                return true;
            }
            for fault in search.one.may_be_one_of_two(search.told.faults().is_some()) {
                if !search.may_have.iter().any(|of| of.is_same(&fault)) {
                    search.may_have.push(fault);
                }
            }
            search.may_have.reverse();
            return self.begin_beside(search);
        };
        if !self.go_on(&mut beside.search) {
            return false;
        }
        let Some(Beside {
            taken_out,
            search: of_rest,
            again,
        }) = search.beside.take()
        else {
            return true;
        };
        let is_open = |fault: Fault| matches!(fault, Fault::Open(_));
        let pair_of = |fault: Fault| match fault {
            Fault::Short { electrodes, .. } | Fault::Leak { electrodes, .. } => Some(electrodes),
            _ => None,
        };
        // Two sets of open electrodes are one, and so is what is left of a leak.
        let is_one = |other: Fault| {
            let pair = pair_of(other);
            (is_open(other) && is_open(taken_out)) || (pair.is_some() && pair == pair_of(taken_out))
        };
        let told = self.told(&of_rest);
        if told == Told::Perhaps && (search.told == Told::Nothing || search.may_be_known(taken_out)) {
            // It does not speak against what is known.
            search.told = told;
        }
        let Some(other) = told.fault().filter(|other| !is_one(*other)) else {
            return self.begin_beside(search);
        };
        let cost = self.cost_of_two(&search.one, taken_out, &of_rest);
        let both = Faults::two(self.of_its_size(taken_out), other);
        let better = search.offer(both, cost);
        let is_apart = |a: Fault, b: Fault| a.electrodes().list().iter().all(|l| !b.electrodes().list().contains(l));
        if let Told::Faults { faults, .. } = &mut search.told
            && again
            && faults.is_same(both)
            && is_apart(taken_out, other)
        {
            // The size that was told first holds some of what the other one changes.
            *faults = both;
        }
        search.enough |= better && is_of_noise(2.0 * of_rest.best.left, of_rest.used());
        if better && !again && self.take_out(search, other, true) {
            return false;
        }
        self.begin_beside(search)
    }

    /// Begins the search beside the next fault that may be one of two; true where there is none, or no need.
    fn begin_beside(&mut self, search: &mut SearchOfTwo) -> bool {
        if search.enough {
            return true;
        }
        while let Some(first) = search.may_have.pop() {
            if self.take_out(search, first, false) {
                return false;
            }
        }
        true
    }

    /// Whether two faults are looked for: one does not explain what was searched, or one is known and leaves more, or two are known.
    fn may_be_two(&self, search: &SearchOfTwo) -> bool {
        // In a table every frame is searched at once, and that takes as long as some searches.
        if !self.is_of_sequence || search.told == Told::Perhaps {
            return false;
        }
        let (one, values) = (&search.one, search.one.used());
        let Some(told) = search.told.faults() else {
            return search.are_known() || (one.best.left > values && one.strong > values);
        };
        // Beside what leaves no touches nothing else tells whether there is more.
        let is_enough = |known: Faults| !known.leaves_touches() && is_of_noise(2.0 * one.best.left, values);
        let leaves_more = |(known, explained): (Faults, bool)| !explained && !is_enough(known);
        // What sets so many values free may explain what it is not.
        search.are_known()
            || search
                .known
                .is_some_and(|known| leaves_more(known) || told.are_many_open())
    }

    /// Cost of two faults, of which one was taken out, and the other found in the rest.
    fn cost_of_two(&self, one: &Search, taken_out: Fault, of_rest: &Search) -> f64 {
        let cost = match self.predicted(taken_out) {
            Some(_) => of_rest.best.cost + of_rest.evidence.wider_than(&one.evidence),
            None => {
                let saved = of_rest.best.touches - of_rest.best.cost;
                one.evidence.free(&self.seen_of(taken_out)).0 - saved
            }
        };
        FAULT + self.cost_of_choice(taken_out) + cost
    }

    /// Cost of its being this fault and no other of its kind.
    fn cost_of_choice(&self, fault: Fault) -> f64 {
        let n = self.electrodes() as f64;
        match fault {
            Fault::Open(electrodes) => electrodes.list().len() as f64 * n.ln(),
            Fault::Contacts(electrodes) => electrodes.list().len() as f64 * (RESISTANCE + n.ln()),
            Fault::Short { .. } | Fault::Leak { .. } => RESISTANCE + (self.pairs().count() as f64).ln(),
            Fault::Exchanged(_) => (self.pairs().count() as f64).ln(),
            Fault::Multiplexer { .. } | Fault::Address { .. } => (4.0 * n).ln(),
            Fault::Gain(..) | Fault::Offset(_) | Fault::Channel(_) => (3.0 * self.channels.len() as f64).ln(),
            Fault::Drive(..) => SWITCH + (self.drives.len() as f64).ln(),
            Fault::Value(..) => (self.imager.pattern.len() as f64).ln(),
            _ => 0.0,
        }
    }

    /// Begins a search in a frame without a fault; false where that cannot be.
    fn take_out(&mut self, search: &mut SearchOfTwo, fault: Fault, again: bool) -> bool {
        let one = &search.one;
        let (mut d, mut own) = (one.d.clone(), one.own.clone());
        if let Some(predicted) = self.predicted(fault) {
            d.y -= &predicted;
            let changed = own.iter_mut().zip(&predicted);
            changed.for_each(|(own, change)| *own = own.hypot(PREDICTION * change));
        } else {
            let spoilt = self.seen_of(fault);
            if spoilt.is_empty() {
                return false;
            }
            spoilt.iter().for_each(|k| own[*k] = f64::NAN);
            d.leave_out(spoilt);
        }
        search.beside = Search::new(self, d, own, &PREDICTIONS).map(|search| Beside {
            taken_out: fault,
            search,
            again,
        });
        search.beside.is_some()
    }

    /// What a fault changes of all values, V; none where it leaves values free.
    fn predicted(&self, fault: Fault) -> Option<DVector<f64>> {
        match fault {
            Fault::Short { electrodes, ohm } | Fault::Leak { electrodes, ohm } => Some(self.short(electrodes, ohm)),
            Fault::Exchanged(pair) => Some(self.exchanged(pair)),
            Fault::Multiplexer { drive, plus, electrode } => Some(self.misrouted((drive, plus), |_| electrode)),
            Fault::Address { drive, plus, lines } => Some(self.misrouted((drive, plus), |l| readdressed(l, lines))),
            _ => None,
        }
    }

    /// Values of what is looked at that a fault spoils.
    fn seen_of(&self, fault: Fault) -> Vec<usize> {
        match (fault, &self.looked_at) {
            (Fault::Value(of_all, _), Some(looked_at)) => {
                looked_at.iter().position(|k| *k == of_all).into_iter().collect()
            }
            _ => spoilt_by(&self.imager, fault),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::diagnosis::Electrodes;
    use crate::reference::diagnosis::hypotheses::{values_of_channel, values_of_drive};
    use crate::reference::imager::Imager;
    use forward::{Drive, Pattern, Sheet};
    use nalgebra::DVector;
    use rand::{Rng, SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, Normal};
    use std::sync::Arc;

    /// The paper's sheet, with the noise of a value, V.
    fn rig() -> (Arc<Imager>, Diagnosis, f64) {
        let pattern = Pattern::adjacent(16).unwrap();
        let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 10.0).unwrap());
        let diagnosis = Diagnosis::of_sequence(&imager).unwrap();
        let sigma_v = 1e-3 * diagnosis.mean_v;
        (imager, diagnosis, sigma_v)
    }

    /// What a change (V) tells.
    fn tell(diagnosis: &mut Diagnosis, sigma_v: f64, y: DVector<f64>, known: Option<(Faults, bool)>) -> Told {
        let d = Difference {
            spread: vec![1.0; y.len()],
            used: vec![true; y.len()],
            y,
        };
        let mut search = diagnosis.begin_two(&d, Some(sigma_v), known).unwrap();
        while !diagnosis.go_on_two(&mut search) {}
        search.told()
    }

    /// Two faults at once are told as what they are, once something is known.
    #[test]
    fn two_faults_at_once_are_told() {
        let (imager, mut diagnosis, sigma_v) = rig();
        let mut rng = StdRng::seed_from_u64(8);
        let noise = Normal::new(0.0, sigma_v).unwrap();
        let open = Fault::Open(Electrodes::of(&[2]));
        let pair = [8, 9];
        let short = |pair, ohm| (Fault::Short { electrodes: pair, ohm }, diagnosis.short(pair, ohm));
        let gain_of = |values: Vec<usize>, factor: f64| {
            let mut change = DVector::zeros(imager.pattern.len());
            values
                .iter()
                .for_each(|k| change[*k] = (factor - 1.0) * imager.model_v[*k]);
            change
        };
        let (leak, stuck) = (
            Fault::Leak {
                electrodes: pair,
                ohm: 2e4,
            },
            Fault::Multiplexer {
                drive: true,
                plus: true,
                electrode: 8,
            },
        );
        let others = [
            short(pair, 30.0),
            short([5, 11], 200.0),
            (leak, diagnosis.short(pair, 2e4)),
            (Fault::Exchanged([7, 8]), diagnosis.exchanged([7, 8])),
            (stuck, diagnosis.misrouted((true, true), |_| 8)),
            (Fault::Gain(pair, 1.1), gain_of(values_of_channel(&imager, pair), 1.1)),
            (Fault::Drive(pair, 0.9), gain_of(values_of_drive(&imager, pair), 0.9)),
        ];
        for (other, change) in others {
            let both = Faults::two(open, other);
            let many = Fault::Open(Electrodes::of(&[2, pair[0], pair[1]]));
            let finger = 0.5 * imager.sensitivity.column((imager.grid.len() - 1) / 2);
            let known = [
                None,
                Some(open.into()),
                Some(other.into()),
                Some(many.into()),
                Some(both),
            ];
            for known in known {
                let mut y = change.map(|v| v + noise.sample(&mut rng));
                if known == Some(both) {
                    // They are told beside a finger, too.
                    y += &finger;
                }
                for k in spoilt_by(&imager, open) {
                    y[k] = rng.random_range(-1.1..-0.9) * imager.model_v[k];
                }
                // What is known of both leaves nothing unexplained.
                let known = known.map(|faults: Faults| (faults, faults == both));
                let told = tell(&mut diagnosis, sigma_v, y, known).faults();
                // Before anything is known the open electrode may be named by itself, and those of a short beside it.
                let is_first = |told: Faults| told.iter().all(|told| told.is_same(&open)) || told.are_many_open();
                assert!(
                    told.map_or(known.is_none(), |told| told.is_same(both)
                        || (known.is_none() && is_first(told))),
                    "{other:?} known {known:?}: {told:?}"
                );
            }
        }
    }

    /// A leak that is told first holds some of what a contact changes. Beside the contact its resistance is its own.
    #[test]
    fn a_leak_beside_a_contact_has_its_own_size() {
        let (_, mut diagnosis, sigma_v) = rig();
        let noise = Normal::new(0.0, sigma_v).unwrap();
        let mut rng = StdRng::seed_from_u64(12);
        let contact = Fault::Contacts(Electrodes::of(&[2]));
        for (pair, ohm) in [([8, 9], 1e4), ([5, 6], 1.2e4), ([12, 13], 1.5e4)] {
            for raised_ohm in [500.0, 1000.0] {
                let y = diagnosis.contacts(&[(2, raised_ohm)]) + diagnosis.short(pair, ohm);
                let y = y.map(|v| v + noise.sample(&mut rng));
                let told = tell(&mut diagnosis, sigma_v, y, None).faults().unwrap();
                let leak = Fault::Leak { electrodes: pair, ohm };
                assert!(
                    told.is_same(Faults::two(leak, contact)),
                    "{pair:?} {ohm} {raised_ohm}: {told:?}"
                );
                let found = told.iter().find_map(|fault| match fault {
                    Fault::Leak { ohm, .. } => Some(ohm),
                    _ => None,
                });
                let off = found.unwrap() / ohm - 1.0;
                assert!(off.abs() < 0.03, "{pair:?} {ohm} {raised_ohm}: {off}");
            }
        }
    }

    /// A worse contact is like a press on its electrode. Beside another fault that is known no frame speaks against it.
    #[test]
    fn two_that_are_known_are_not_denied() {
        let (imager, mut diagnosis, sigma_v) = rig();
        let noise = Normal::new(0.0, sigma_v).unwrap();
        let [open, contact] = [Fault::Open(Electrodes::of(&[2])), Fault::Contacts(Electrodes::of(&[8]))];
        let both = Faults::two(open, contact);
        for (seed, ohm) in (0..24).zip([200.0, 500.0].into_iter().cycle()) {
            let mut rng = StdRng::seed_from_u64(seed);
            let mut y = diagnosis.contacts(&[(8, ohm)]).map(|v| v + noise.sample(&mut rng));
            for k in spoilt_by(&imager, open) {
                y[k] = rng.random_range(-1.1..-0.9) * imager.model_v[k];
            }
            let told = tell(&mut diagnosis, sigma_v, y, Some((both, true)));
            let is_both = told.faults().is_some_and(|told| told.is_same(both));
            assert!(told == Told::Perhaps || is_both, "{seed}, {ohm} ohm: {told:?}");
        }
    }

    /// One fault is told as one, whatever is named already.
    #[test]
    fn one_fault_is_told_as_one() {
        let (_, mut diagnosis, sigma_v) = rig();
        let mut rng = StdRng::seed_from_u64(9);
        let noise = Normal::new(0.0, sigma_v).unwrap();
        let gone = Fault::Open(Electrodes::of(&[12]));
        let faults = [
            (
                Fault::Short {
                    electrodes: [2, 6],
                    ohm: 30.0,
                },
                diagnosis.short([2, 6], 30.0),
            ),
            (Fault::Exchanged([3, 8]), diagnosis.exchanged([3, 8])),
        ];
        for (fault, change) in faults {
            for known in [
                None,
                Some((Faults::from(gone), false)),
                Some((Faults::two(gone, fault), false)),
            ] {
                let y = change.map(|v| v + noise.sample(&mut rng));
                let told = tell(&mut diagnosis, sigma_v, y, known).faults();
                assert!(
                    told.is_some_and(|told| told.is_same(fault.into())),
                    "{fault:?}, known {known:?}: {told:?}"
                );
            }
        }
    }
}
