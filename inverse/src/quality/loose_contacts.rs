//! Contacts that come and go.
//!
//! A contact that fails in a frame or two leaves the scene as it was. Such a frame is searched for what is broken once the scene has come
//! back, in the time of the frames that follow. Where two of them tell the same electrode, it has a loose contact.

use crate::quality::flickers::is_alike;
use crate::reference::Difference;
use crate::reference::diagnosis::{Diagnosis, Electrodes, Fault, MOST_ELECTRODES, Search};

/// Frames at rest, alike in the values that are left out, after which a contact holds.
const HOLDS: usize = 512;

/// Frames that have to tell the same electrode.
const TELL: usize = 2;

/// Names loose contacts.
#[derive(Default)]
pub(crate) struct LooseContacts {
    named: Electrodes,
    /// The electrodes that the last searches have in common, and how many these were.
    candidate: (Vec<usize>, usize),
    /// The first frame that was unlike the others since, and its noise, V of the model.
    seen: Option<(Difference, f64)>,
    /// The search in the last frame that came and went.
    begun: Option<Search>,
    /// The last frame at rest, V, and how many before it were alike.
    rest: Vec<f64>,
    alike: usize,
}

impl LooseContacts {
    /// The electrodes that are named.
    pub(crate) fn named(&self) -> Electrodes {
        self.named
    }

    /// Forgets what it saw, not what it named.
    pub(crate) fn forget(&mut self) {
        (self.candidate, self.seen, self.begun) = ((Vec::new(), 0), None, None);
    }

    /// Takes a frame that is unlike the ones before: it may be gone with the next. Of some one after another it is the first.
    pub(crate) fn take(&mut self, d: Difference, sigma_v: f64) {
        if self.seen.is_none() && self.begun.is_none() {
            self.seen = Some((d, sigma_v));
        }
    }

    /// What was unlike the others stays, or what it was is known.
    pub(crate) fn stays(&mut self) {
        self.seen = None;
    }

    /// The scene is as it was before what was unlike it: that is searched.
    pub(crate) fn came_back(&mut self, diagnosis: &mut Diagnosis) {
        if let Some((d, sigma_v)) = self.seen.take()
            && self.begun.is_none()
        {
            self.begun = diagnosis.begin(&d, Some(sigma_v));
        }
    }

    /// Whether there is a search to go on with.
    pub(crate) fn searches(&self) -> bool {
        self.begun.is_some()
    }

    /// Goes on with the search for one part. `known`: electrodes of which it is known already that their contacts changed. True where
    /// others are named now.
    pub(crate) fn go_on(&mut self, diagnosis: &mut Diagnosis, known: &[usize]) -> bool {
        let Some(mut search) = self.begun.take() else {
            return false;
        };
        if !diagnosis.go_on(&mut search) {
            self.begun = Some(search);
            return false;
        }
        let told = match diagnosis.told(&search).fault() {
            // Several at once leave values enough free for a tap in the middle of a frame. Of several loose ones each is told in its turn.
            Some(Fault::Open(told) | Fault::Contacts(told)) if told.list().len() == 1 => told.list().to_vec(),
            // Either of the two.
            Some(Fault::Drive(pair, _) | Fault::Channel(pair)) => pair.to_vec(),
            _ => return false,
        };
        if told.iter().any(|l| known.contains(l) || self.named.list().contains(l)) {
            return false;
        }
        let (before, times) = &self.candidate;
        let both: Vec<usize> = told.iter().copied().filter(|l| before.contains(l)).collect();
        self.candidate = if both.is_empty() { (told, 1) } else { (both, times + 1) };
        let (left, times) = &self.candidate;
        let electrode = match *left.as_slice() {
            [electrode] if *times >= TELL => electrode,
            // It is the pair that fails: without one of them its values are left out.
            [electrode, _] if *times > TELL => electrode,
            _ => return false,
        };
        self.candidate = (Vec::new(), 0);
        let all = [self.named.list(), &[electrode]].concat();
        if all.len() > MOST_ELECTRODES {
            return false;
        }
        (self.named, self.alike) = (Electrodes::of(&all), 0);
        self.rest.clear();
        true
    }

    /// Takes a frame at rest (V), the values that are left out, and the noise of every value, V. True where the contacts have held for
    /// long: they are loose no more.
    pub(crate) fn rests(&mut self, values: &[f64], left_out: &[usize], noise: &[f64]) -> bool {
        if self.named.list().is_empty() {
            return false;
        }
        let mut of_them = vec![false; values.len()];
        left_out.iter().for_each(|k| of_them[*k] = true);
        self.alike = if is_alike(&self.rest, values, &of_them, noise) {
            self.alike + 1
        } else {
            0
        };
        self.rest.clear();
        self.rest.extend_from_slice(values);
        let holds = self.alike >= HOLDS;
        if holds {
            *self = Self::default();
        }
        holds
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng, rngs::StdRng};
    use rand_distr::StandardNormal;

    /// A contact holds after so many frames at rest that are alike, wherever its values are then; and not where it fails now and then.
    #[test]
    fn a_contact_that_stays_holds_again() {
        let mut rng = StdRng::seed_from_u64(3);
        let left_out: Vec<usize> = (0..20).collect();
        for (every, holds) in [(usize::MAX, true), (400, false)] {
            let mut loose = LooseContacts {
                named: Electrodes::of(&[5]),
                ..LooseContacts::default()
            };
            let mut held = None;
            for frame in 1..=3000 {
                let failed = if frame % every == 0 { 40.0 } else { 7.0 };
                let values: Vec<f64> = (0..60)
                    .map(|k| if k < 20 { failed } else { 0.0 } + rng.sample::<f64, _>(StandardNormal))
                    .collect();
                if loose.rests(&values, &left_out, &[1.0; 60]) {
                    held = Some(frame);
                    break;
                }
            }
            assert_eq!(held.is_some(), holds);
            assert!(held.is_none_or(|frame| (HOLDS..3 * HOLDS).contains(&frame)), "{held:?}");
            assert_eq!(loose.named().list().is_empty(), holds);
        }
    }
}
