//! Which fault is named, frame after frame.
//!
//! A touch that comes down while two frames are measured fits nothing either, but the next frame tells another story. What is broken
//! stays broken. In frames that follow one another a fault is therefore looked for from the third on, and named when two tell the same.

use crate::quality::contact::Cause;
use crate::quality::flickers::Flicker;
use crate::quality::loose_contacts::LooseContacts;
use crate::quality::rails::Rails;
use crate::reference::Difference;
use crate::reference::diagnosis::{
    Diagnosis, Electrodes, Fault, Faults, MOST_ELECTRODES, PARTS, SearchOfTwo, Told, sense_pairs, spoilt_by, values_of,
};
use crate::reference::imager::Imager;
use crate::stats::is_of_noise;
use nalgebra::DVector;
use std::borrow::Cow;
use std::sync::Arc;

/// Frames one after another that touches do not explain before a fault is looked for: it takes as long as some frames.
const SUSPICIOUS: usize = 3;
/// Frames that have to tell the same fault.
const NAMES: usize = 2;
/// Frames until a fault that was named is looked for again: one that leaves touches; and one that leaves none, or contacts and leaks, which
/// come and go. Then times that speak against it before it is over.
const AGAIN: [usize; 2] = [64, 16];
const AGAINST: usize = 2;
/// Values of frames at rest that end a fault: a single value may be as in the baseline by chance.
const WELL: usize = 8;
/// Frames for which a fault that took no touch's place is not named again.
const REJECTED: usize = 32;
/// Most frames between two looks that find nothing.
const LONGEST_WAIT: usize = 64;

/// Frames from which a fault that may be one is none: their mean would have told.
const MOST_OPEN: usize = 64;
/// Frames until these faults are looked for again.
fn next_look(faults: Faults) -> usize {
    let soon = |fault: Fault| !fault.leaves_touches() || matches!(fault, Fault::Contacts(_) | Fault::Leak { .. });
    AGAIN[usize::from(faults.iter().any(soon))]
}

/// The mean of frames one after another that differ by nothing but noise. A contact and a finger on it tell different stories, but a
/// frame by itself may be too noisy to tell which.
struct Mean {
    /// The mean difference to the baseline.
    difference: Difference,
    /// Of how many frames, at most [`MOST_OPEN`]: of more it follows the last.
    frames: f64,
}

impl Mean {
    /// Takes a frame; begins anew where it is another. `sigma_v`: noise of one value, V of the model.
    fn take(mean: &mut Option<Self>, d: &Difference, sigma_v: f64) {
        if let Some(mean) = mean.as_mut().filter(|mean| mean.is_alike(d, sigma_v)) {
            mean.frames = (mean.frames + 1.0).min(MOST_OPEN as f64);
            let part = 1.0 / mean.frames;
            (mean.difference.y)
                .iter_mut()
                .zip(&d.y)
                .for_each(|(mean, y)| *mean += part * (y - *mean));
            return;
        }
        *mean = Some(Self {
            difference: d.clone(),
            frames: 1.0,
        });
    }

    fn is_alike(&self, d: &Difference, sigma_v: f64) -> bool {
        let before = &self.difference;
        if before.used != d.used || before.spread != d.spread {
            return false;
        }
        let variance = sigma_v * sigma_v * (1.0 + 1.0 / self.frames);
        let values = (0..d.used.len()).filter(|k| d.used[*k]);
        let (mut square, mut count) = (0.0, 0.0_f64);
        for k in values {
            square += ((d.y[k] - before.y[k]) / d.spread[k]).powi(2) / variance;
            count += 1.0;
        }
        is_of_noise(square, count)
    }
}

/// What is known of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Seen {
    /// Touches do not explain it, or values contradict each other.
    pub(crate) unexplained: bool,
    /// Touches explain it, but a fault would, too.
    pub(crate) suspected: bool,
    /// What [`FaultMonitor::begin`] said.
    pub(crate) due: bool,
    /// Parts of a search that it has time for; others are put off.
    pub(crate) parts: usize,
    /// What it shows came not long ago, from one frame to the next.
    pub(crate) sudden: bool,
}

/// Why a fault is searched for.
#[derive(Clone, Copy, Debug)]
struct Reason {
    /// The one that is named was to be looked for.
    due: bool,
    /// Something came beside it.
    beside: bool,
    /// See [`Seen`].
    suspected: bool,
    unexplained: bool,
}

/// A search that goes on in the next frame.
struct Begun {
    search: SearchOfTwo,
    reason: Reason,
}

/// Names faults.
pub(crate) struct FaultMonitor {
    imager: Arc<Imager>,
    sequence: bool,
    /// Made when it is first needed; none inside where the sheet cannot be solved.
    diagnosis: Option<Option<Diagnosis>>,
    named: Option<Faults>,
    /// What leaks among them change of all values, V of the model.
    leaked: Option<DVector<f64>>,
    /// Whether touches cannot take their place.
    alone: bool,
    /// Whether it was searched for in a frame that touches explain.
    suspected: bool,
    /// Electrodes whose contact is known to have changed, and weak leaks that are known.
    contacts: Vec<usize>,
    leaks: Vec<[usize; 2]>,
    /// Whether the last look left open whether there is a fault.
    open: bool,
    /// What the last looks told, and how many.
    candidate: Option<(Faults, usize)>,
    /// Suspicious frames one after another.
    suspicious: usize,
    /// The mean of the last of them.
    mean: Option<Mean>,
    /// Frames until the next look.
    until: usize,
    wait: usize,
    longest_wait: usize,
    against: usize,
    /// Values of frames at rest one after another that speak against it.
    well: usize,
    /// A fault that took no touch's place, and for how many frames it is none.
    rejected: Option<(Faults, usize)>,
    /// Parts of searches so far, and the search that was begun.
    parts: usize,
    begun: Option<Begun>,
    found_nothing: bool,
    loose: LooseContacts,
    rails: Rails,
}

impl FaultMonitor {
    pub(crate) fn new(imager: &Arc<Imager>, sequence: bool) -> Self {
        Self {
            imager: Arc::clone(imager),
            sequence,
            diagnosis: None,
            named: None,
            leaked: None,
            alone: false,
            suspected: false,
            contacts: Vec::new(),
            leaks: Vec::new(),
            open: false,
            candidate: None,
            suspicious: 0,
            mean: None,
            until: 0,
            wait: 1,
            longest_wait: LONGEST_WAIT,
            against: 0,
            well: 0,
            rejected: None,
            parts: 0,
            begun: None,
            found_nothing: false,
            loose: LooseContacts::default(),
            rails: Rails::new(sense_pairs(imager), if sequence { NAMES } else { 1 }),
        }
    }

    /// Takes which values of a frame are missing that the baseline has. True where other amplifiers are named as at their rails now.
    pub(crate) fn take_missing(&mut self, missing: &[bool], had: &[bool]) -> bool {
        self.rails.take(missing, had)
    }

    /// Amplifiers at their rails.
    pub(crate) fn rails(&self) -> impl Iterator<Item = Fault> + '_ {
        self.rails.named().map(Fault::Rail)
    }

    /// Makes ready to compare frames of this noise (V of the model) with every fault, which takes as long as many frames.
    pub(crate) fn prepare(&mut self, sigma_v: f64, unchanged: &Difference) {
        if !self.imager.is_searched() {
            return;
        }
        self.diagnosis = Some(self.made());
        if let Some(Some(diagnosis)) = &mut self.diagnosis {
            diagnosis.prepare(sigma_v, unchanged);
        }
    }

    fn made(&self) -> Option<Diagnosis> {
        if self.sequence {
            Diagnosis::of_sequence(&self.imager)
        } else {
            Diagnosis::new(&self.imager)
        }
    }

    /// Whether a frame whose touches explain it would be as well explained by a fault: its touches may be phantoms.
    /// `stretch`: the variance of its noise over that of the frames that this was made ready for.
    pub(crate) fn suspects(&self, d: &Difference, stretch: f64) -> bool {
        let diagnosis = self.diagnosis.as_ref().and_then(Option::as_ref);
        self.named.is_none() && diagnosis.is_some_and(|diagnosis| diagnosis.suspects(d, stretch))
    }

    /// Whether the fault that was named last was searched for in a frame that touches explain.
    pub(crate) fn is_suspected(&self) -> bool {
        self.suspected
    }

    /// Whether nothing but the fault that was named last explains the frame.
    pub(crate) fn is_alone(&self) -> bool {
        self.alone
    }

    /// Whether a look that was at its end in the last frame that was taken found nothing.
    pub(crate) fn found_nothing(&self) -> bool {
        self.found_nothing
    }

    /// Names contacts that are known to have changed; false where another fault is named, or too many.
    pub(crate) fn name_contacts(&mut self, electrodes: &[usize]) -> bool {
        let known = match self.named.map(Faults::single) {
            Some(Some(Fault::Contacts(known))) => known,
            Some(_) => return false,
            None => Electrodes::default(),
        };
        let mut all = [known.list(), electrodes].concat();
        all.sort_unstable();
        all.dedup();
        if all.len() > MOST_ELECTRODES {
            return false;
        }
        let contacts = Faults::from(Fault::Contacts(Electrodes::of(&all)));
        self.name(Some(contacts));
        (self.candidate, self.open) = (None, false);
        (self.until, self.against) = (next_look(contacts), 0);
        self.wait = 1;
        self.begun = None;
        true
    }

    /// Whether the values that are left out because of the fault that is named are those of the baseline again, in a frame that shows
    /// nothing beside a gain that all values have in common. `sigma_v`: noise of one value, V of the model.
    pub(crate) fn is_over(&mut self, d: &Difference, unchanged: &Difference, sigma_v: f64) -> bool {
        let values = self.spoilt();
        // What the fault did to the gain is over with it.
        let gain = common_gain(&self.imager.model_v, d, &values);
        let values: Vec<usize> = values.into_iter().filter(|k| unchanged.used[*k]).collect();
        let left = |k: usize| (d.y[k] - gain * self.imager.model_v[k]) / (sigma_v * d.spread[k]);
        let square: f64 = values.iter().map(|k| left(*k).powi(2)).sum();
        let count = values.len() as f64;
        let well = count > 0.0 && values.iter().all(|k| d.used[*k]) && is_of_noise(square, count);
        self.well = if well { self.well + values.len() } else { 0 };
        self.well >= WELL
    }

    /// The faults that were named took no touch's place: they are none for a while.
    pub(crate) fn reject(&mut self, fault: Faults) {
        self.name(None);
        (self.candidate, self.begun) = (None, None);
        self.rejected = Some((fault, REJECTED));
    }

    fn name(&mut self, faults: Option<Faults>) {
        self.named = faults;
        let diagnosis = self.diagnosis.as_ref().and_then(Option::as_ref);
        let leaked = faults
            .into_iter()
            .flat_map(Faults::iter)
            .filter_map(|fault| match fault {
                Fault::Leak { electrodes, ohm } => Some(diagnosis?.leaked(&self.imager, electrodes, ohm)),
                _ => None,
            });
        self.leaked = leaked.reduce(|a, b| a + b);
    }

    /// Takes what the leak that is named changes out of a frame of the baseline's unit.
    pub(crate) fn without_leak(&self, values: &mut [f64], baseline: &[f64]) {
        let leaked = self.leaked.iter().flat_map(|leaked| leaked.iter());
        let model = leaked.zip(&self.imager.model_v).zip(baseline);
        let measured = values
            .iter_mut()
            .zip(model)
            .filter(|(_, ((_, model), _))| **model != 0.0);
        measured.for_each(|(value, ((leaked, model), baseline))| *value -= leaked / model * baseline);
    }

    /// Whether a weak leak is named.
    pub(crate) fn leaks(&self) -> bool {
        self.leaked.is_some()
    }

    /// Adds what the leak that is named changes to a difference, so many times.
    pub(crate) fn add_leak(&self, d: &mut Difference, times: f64) {
        let leaked = self.leaked.iter().flat_map(|leaked| leaked.iter());
        let values = d.y.iter_mut().zip(&d.used).zip(leaked.zip(&self.imager.model_v));
        let measured = values.filter(|((_, used), (_, model))| **used && **model != 0.0);
        measured.for_each(|((y, _), (leaked, _))| *y += times * leaked);
    }

    /// The faults that are named.
    pub(crate) fn named(&self) -> Option<Faults> {
        self.named
    }

    /// Whether a fault is a candidate, or may be one: then every frame counts.
    pub(crate) fn is_open(&self) -> bool {
        self.candidate.is_some() || (self.open && self.suspicious < MOST_OPEN)
    }

    /// Whether a frame that touches do not explain is searched still.
    pub(crate) fn is_searching(&self) -> bool {
        self.begun.as_ref().is_some_and(|begun| begun.reason.unexplained)
    }

    /// Parts of a search that the next frame is to leave time for.
    pub(crate) fn owed(&self) -> usize {
        match &self.begun {
            Some(begun) => begun.search.left(),
            None if self.candidate.is_some() && self.suspicious > 0 => PARTS,
            None => 0,
        }
    }

    /// What was put off is not asked any more.
    pub(crate) fn put_nothing_off(&mut self) {
        self.begun = None;
    }

    /// Forgets all that earlier frames said.
    pub(crate) fn clear(&mut self) {
        self.name(None);
        self.candidate = None;
        (self.suspicious, self.until, self.wait, self.against) = (0, 0, 1, 0);
        (self.open, self.mean, self.begun, self.well) = (false, None, None, 0);
    }

    /// The same but for what it is made ready with.
    pub(crate) fn stand_alone(&mut self) {
        let new = Self::new(&self.imager, self.sequence);
        let before = std::mem::replace(self, new);
        (self.diagnosis, self.parts) = (before.diagnosis, before.parts);
    }

    /// Begins a frame, with what is known to have changed at the rim: whether the fault that was named is to be looked for again.
    pub(crate) fn begin(&mut self, known: &[Cause]) -> bool {
        self.contacts.clear();
        self.contacts.extend(known.iter().filter_map(|cause| cause.contact()));
        self.leaks.clear();
        self.leaks.extend(known.iter().filter_map(|cause| cause.leak()));
        self.until = self.until.saturating_sub(1);
        self.rejected = self
            .rejected
            .and_then(|(fault, frames)| Some((fault, frames.checked_sub(1)?)));
        self.named.is_some() && (self.until == 0 || !self.sequence)
    }

    /// Leaves the values out that the named fault and loose contacts spoil, in a difference.
    pub(crate) fn leave_out(&self, d: &mut Difference) {
        d.leave_out(
            self.spoilt()
                .into_iter()
                .chain(self.of_loose())
                .chain(self.rails.values()),
        );
    }

    /// Electrodes whose values are left out.
    pub(crate) fn electrodes_left_out(&self) -> Vec<usize> {
        let mut all = self.loose.named().list().to_vec();
        for fault in self.named.into_iter().flat_map(Faults::iter) {
            if let Fault::Open(_) | Fault::Contacts(_) | Fault::Leak { .. } = fault {
                all.extend_from_slice(fault.electrodes().list());
            }
        }
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Contacts that come and go, if there are any.
    pub(crate) fn loose(&self) -> Option<Fault> {
        let electrodes = self.loose.named();
        (!electrodes.list().is_empty()).then_some(Fault::Loose(electrodes))
    }

    /// Values that loose contacts spoil.
    fn of_loose(&self) -> Vec<usize> {
        // A frame at rest is not to look at every value for nothing.
        self.loose()
            .map_or_else(Vec::new, |fault| values_of(&self.imager, fault.electrodes().list()))
    }

    /// Takes a frame that was reconstructed, what it is after the ones before, and its noise, V of the model. Where frames come and go often,
    /// what came and went is searched: one part, if the frame has time for it. True where loose contacts are named.
    pub(crate) fn take_flicker(
        &mut self,
        (flicker, often): (Flicker, bool),
        (d, sigma_v): (&Difference, f64),
        has_time: bool,
    ) -> bool {
        match flicker {
            // What is known to be broken may be what comes and goes.
            Flicker::Unlike if self.named.is_none() => {
                let d = self.without_loose(d).into_owned();
                self.loose.take(d, sigma_v);
                return false;
            }
            Flicker::Gone if often && self.imager.is_searched() => {
                if self.diagnosis.is_none() {
                    self.diagnosis = Some(self.made());
                }
                if let Some(Some(diagnosis)) = &mut self.diagnosis {
                    self.loose.came_back(diagnosis);
                }
            }
            _ => self.loose.stays(),
        }
        if !often {
            self.loose.forget();
        }
        let Some(Some(diagnosis)) = self.diagnosis.as_mut().filter(|_| has_time && self.loose.searches()) else {
            return false;
        };
        self.parts += 1;
        self.loose.go_on(diagnosis, &self.contacts)
    }

    /// Takes a frame in which nothing touches (V), with the noise of every value. True where loose contacts have held for so long that they
    /// are loose no more.
    pub(crate) fn rests(&mut self, values: &[f64], noise: &[f64]) -> bool {
        let left_out = self.of_loose();
        self.loose.rests(values, &left_out, noise)
    }

    /// A difference without the values of loose contacts.
    fn without_loose<'a>(&self, d: &'a Difference) -> Cow<'a, Difference> {
        let values = self.of_loose();
        if values.is_empty() {
            return Cow::Borrowed(d);
        }
        let mut without = d.clone();
        without.leave_out(values);
        Cow::Owned(without)
    }

    /// Values that the named faults spoil.
    fn spoilt(&self) -> Vec<usize> {
        let faults = self.named.into_iter().flat_map(Faults::iter);
        let mut spoilt: Vec<usize> = faults.flat_map(|fault| spoilt_by(&self.imager, fault)).collect();
        spoilt.sort_unstable();
        spoilt.dedup();
        spoilt
    }

    /// Takes a frame as it was measured (V) and its difference. True when another fault is named now, or none any more.
    pub(crate) fn take(
        &mut self,
        (values, d, unchanged): (&[f64], &Difference, &Difference),
        sigma_v: Option<f64>,
        seen: Seen,
    ) -> bool {
        let Seen { suspected, due, .. } = seen;
        self.found_nothing = false;
        self.longest_wait = if seen.sudden { LONGEST_WAIT / 8 } else { LONGEST_WAIT };
        if self.named.is_none() {
            self.until = self.until.min(self.longest_wait);
        }
        let known = of_values(values, d, unchanged);
        let without = self.without_loose(d);
        let d = &*without;
        let unexplained = seen.unexplained || suspected || known.is_some();
        self.suspicious = if unexplained { self.suspicious + 1 } else { 0 };
        match sigma_v.filter(|_| unexplained && self.sequence) {
            Some(sigma_v) => Mean::take(&mut self.mean, d, sigma_v),
            None => self.mean = None,
        }
        if !unexplained && self.named.is_none() {
            (self.candidate, self.wait, self.open, self.begun) = (None, 1, false, None);
            return false;
        }
        // What comes beside a fault that is named is asked for as it comes.
        let beside = self.named.is_some() && self.suspicious == SUSPICIOUS;
        let asked = known.is_some() || due || beside || (unexplained && self.until == 0 && self.named.is_none());
        let early = self.sequence && self.suspicious < SUSPICIOUS && known.is_none() && !due;
        let again = self.candidate.is_some();
        if beside && self.begun.as_ref().is_some_and(|begun| !begun.reason.unexplained) {
            // It looks at a frame before this came.
            self.begun = None;
        }
        if self.begun.is_none() && (early || !(asked || again)) {
            return false;
        }
        let reason = Reason {
            due,
            beside,
            suspected,
            unexplained: seen.unexplained,
        };
        let (told, reason) = match known {
            Some(fault) => {
                self.begun = None;
                let faults = fault.into();
                (Told::Faults { faults, alone: true }, reason)
            }
            None if !self.imager.is_searched() => (Told::Nothing, reason),
            None => match self.search(d, sigma_v, reason, seen.parts) {
                Some(told) => told,
                None => return false,
            },
        };
        self.suspected = reason.suspected;
        let known_contacts = |faults: Faults, known: &[usize]| match faults.single() {
            Some(Fault::Contacts(electrodes)) => electrodes.list().iter().all(|l| known.contains(l)),
            Some(Fault::Leak { electrodes, .. }) => self.leaks.contains(&electrodes),
            _ => false,
        };
        self.open = told == Told::Perhaps && self.named.is_none();
        if told == Told::Perhaps && self.named.is_some() {
            // It does not speak against the fault.
            self.until = self.named.map_or(0, next_look);
            return false;
        }
        self.alone = matches!(told, Told::Faults { alone: true, .. });
        let is_rejected = |told: Faults| self.rejected.is_some_and(|(rejected, _)| rejected.is_same(told));
        let told = told.faults();
        let told = told.filter(|told| !known_contacts(*told, &self.contacts) && !is_rejected(*told));
        if told.is_none() && reason.beside && !reason.due {
            // What is there besides may be a touch. It does not speak against the fault.
            return false;
        }
        self.judge(told)
    }

    fn judge(&mut self, told: Option<Faults>) -> bool {
        let names = if self.sequence { NAMES } else { 1 };
        let Some(told) = told else {
            self.candidate = None;
            self.until = self.wait;
            self.wait = (2 * self.wait).min(self.longest_wait);
            self.against += 1;
            self.found_nothing = true;
            let over = self.named.is_some() && (self.against >= AGAINST || !self.sequence);
            if over {
                self.clear();
            }
            return over;
        };
        (self.against, self.wait) = (0, 1);
        if let Some(named) = self.named.filter(|named| named.is_same(told)) {
            self.candidate = None;
            self.until = next_look(told);
            // Its size may be another.
            let told = told.in_order_of(named);
            if named != told {
                self.name(Some(told));
            }
            return false;
        }
        let count = match self.candidate {
            Some((before, count)) if before.is_same(told) => count + 1,
            _ => 1,
        };
        self.candidate = Some((told, count));
        if count < names {
            return false;
        }
        tracing::debug!(?told, "a fault");
        self.name(Some(told));
        // Many open electrodes may be others: that is looked at once they are named.
        (self.candidate, self.until) = (None, if told.are_many_open() { 1 } else { next_look(told) });
        true
    }

    /// Parts of searches for what is broken so far.
    pub(crate) fn parts(&self) -> usize {
        self.parts
    }

    /// Goes on with a search, or begins one, for so many parts; one that was begun before for one part at least. What it told, and why it
    /// was asked; none where it is not at its end.
    fn search(&mut self, d: &Difference, sigma_v: Option<f64>, reason: Reason, parts: usize) -> Option<(Told, Reason)> {
        if self.diagnosis.is_none() {
            self.diagnosis = Some(self.made());
        }
        let Some(Some(diagnosis)) = &mut self.diagnosis else {
            return Some((Told::Nothing, reason));
        };
        let (mut begun, parts) = match self.begun.take() {
            Some(begun) => (begun, parts.max(1)),
            None => {
                let known = self.named.map(|faults| (faults, !reason.unexplained));
                let search = match &self.mean {
                    Some(mean) => {
                        let sigma_v = sigma_v.map(|sigma| sigma / mean.frames.sqrt());
                        diagnosis.begin_two(&mean.difference, sigma_v, known)
                    }
                    None => diagnosis.begin_two(d, sigma_v, known),
                };
                let Some(search) = search else {
                    return Some((Told::Nothing, reason));
                };
                (Begun { search, reason }, parts)
            }
        };
        for _ in 0..parts {
            self.parts += 1;
            if diagnosis.go_on_two(&mut begun.search) {
                return Some((begun.search.told(), begun.reason));
            }
        }
        self.begun = Some(begun);
        None
    }
}

/// What the values say without a model: the same everywhere, or all missing.
fn of_values(values: &[f64], d: &Difference, unchanged: &Difference) -> Option<Fault> {
    let first = values.first()?;
    if first.is_finite() && values.iter().all(|v| v == first) {
        return Some(Fault::Converter);
    }
    let had = unchanged.used.contains(&true);
    (had && !d.used.contains(&true)).then_some(Fault::Range)
}

/// By how much a gain that all values have in common is more than 1: of all but some of them, with the least absolute deviation.
fn common_gain(model_v: &[f64], d: &Difference, without: &[usize]) -> f64 {
    let values = (0..d.used.len()).filter(|k| d.used[*k] && model_v[*k] != 0.0 && !without.contains(k));
    let mut ratios: Vec<[f64; 2]> = values
        .map(|k| [d.y[k] / model_v[k], (model_v[k] / d.spread[k]).abs()])
        .collect();
    ratios.sort_by(|[a, _], [b, _]| a.total_cmp(b));
    let half = 0.5 * ratios.iter().map(|[_, weight]| weight).sum::<f64>();
    let mut sum = 0.0;
    let median = ratios.iter().find(|[_, weight]| {
        sum += weight;
        sum >= half
    });
    median.map_or(0.0, |[gain, _]| *gain)
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Drive, Pattern, Sheet};

    /// The gain that was found while a contact was worse may be wrong by some per cent.
    #[test]
    fn a_fault_ends_whatever_the_common_gain_is() {
        let pattern = Pattern::adjacent(16).unwrap();
        let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 10.0).unwrap());
        let sigma_v = 1e-3 * imager.model_v.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let unchanged = Difference {
            y: DVector::zeros(imager.pattern.len()),
            spread: vec![1.0; imager.pattern.len()],
            used: vec![true; imager.pattern.len()],
        };
        for gain in [0.0, 0.07, -0.2] {
            let mut d = unchanged.clone();
            d.y.iter_mut().zip(&imager.model_v).for_each(|(y, v)| *y = gain * v);
            let mut monitor = FaultMonitor::new(&imager, true);
            assert!(monitor.name_contacts(&[11]));
            assert!(monitor.is_over(&d, &unchanged, sigma_v), "{gain}");
            for k in values_of(&imager, &[11]) {
                d.y[k] += 0.1 * imager.model_v[k];
            }
            assert!(!monitor.is_over(&d, &unchanged, sigma_v), "{gain}");
        }
    }

    /// The texts of two faults do not change places when a size is known better.
    #[test]
    fn two_faults_keep_their_order() {
        let leak = |ohm| Fault::Leak {
            electrodes: [9, 10],
            ohm,
        };
        let open = Fault::Open(Electrodes::of(&[3]));
        let named = Faults::two(open, leak(2e4));
        for told in [Faults::two(leak(3e4), open), Faults::two(open, leak(3e4))] {
            let both: Vec<Fault> = told.in_order_of(named).iter().collect();
            assert_eq!(both, [open, leak(3e4)]);
        }
        assert_eq!(Faults::from(open).in_order_of(open.into()), open.into());
    }

    /// What comes beside a fault that is named, and is none, does not end it before it is looked for again; and the search for it takes
    /// one part of each frame, of those that have time for no more.
    #[test]
    fn what_is_nothing_beside_a_fault_does_not_end_it() {
        let pattern = Pattern::adjacent(16).unwrap();
        let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 10.0).unwrap());
        let mut monitor = FaultMonitor::new(&imager, true);
        assert!(monitor.name_contacts(&[3]));
        let named = monitor.named();
        // A finger in the middle.
        let cell = (imager.grid.len() - 1) / 2;
        let pressed = Difference {
            y: DVector::from_column_slice(imager.sensitivity.column(cell).as_slice()),
            spread: vec![1.0; imager.pattern.len()],
            used: vec![true; imager.pattern.len()],
        };
        let mut unchanged = pressed.clone();
        unchanged.y.fill(0.0);
        let values: Vec<f64> = imager.model_v.iter().zip(&pressed.y).map(|(v, y)| v + y).collect();
        let mut parts = Vec::new();
        for frame in 1..AGAIN[1] {
            assert!(!monitor.begin(&[]), "frame {frame}");
            let seen = Seen {
                unexplained: true,
                parts: 0,
                ..Seen::default()
            };
            let before = monitor.parts();
            assert!(!monitor.take((&values, &pressed, &unchanged), Some(1e-6), seen));
            parts.push(monitor.parts() - before);
            assert_eq!(monitor.named(), named, "frame {frame}");
        }
        // It is begun in the third frame.
        assert_eq!(parts[..7], [0, 0, 0, 1, 1, 1, 0]);
        assert!(parts[7..].iter().all(|p| *p == 0), "{parts:?}");
        assert!(monitor.begin(&[]));
    }
}
