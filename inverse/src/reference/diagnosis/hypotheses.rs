//! The faults that a frame is compared with, and what each predicts.

mod predictions;
mod search;
mod two;

pub(crate) use self::predictions::{across, leaked};
pub(crate) use self::search::{PARTS, Search};
pub(crate) use self::two::SearchOfTwo;

use self::search::Best;
use super::covariance::Covariance;
use super::evidence::{Evidence, Products};
use super::fault::{Electrodes, Fault, Faults, MOST_ELECTRODES};
use super::freed::{Cost, Freed};
use crate::reference::Difference;
use crate::reference::drift::{DriftShapes, Drifting, LEAST_GAIN, MOST_OFFSET};
use crate::reference::golden_sections::least;
use crate::reference::imager::Imager;
use crate::reference::screening::consensus;
use forward::{Drive, Measurement, Pair, Pattern, Solver};
use nalgebra::{DMatrix, DVector};
use std::borrow::Cow;
use std::sync::Arc;

/// Standard deviation of a cell's rise: fingers and hands.
const RISE: f64 = 0.15;
/// The same of things in a tank, which may insulate or conduct.
const STRONG_RISE: f64 = 1.0;
/// How the expected rise falls with a cell's sensitivity.
const DEPTH: f64 = 0.7;
/// Standard deviations of what drifts: the gain and the sheet's resistance, and every contact.
const COMMON: f64 = 0.1;
const CONTACT: f64 = 0.01;
/// Relative error of the values of a sheet as it is built, and how much more probable a baseline must be with a fault, as a logarithm.
const BUILT: f64 = 0.1;
const CLEAR: f64 = 50.0;
/// Noise of a value over the frame's mean value where nothing tells it.
const LEAST_NOISE: f64 = 3e-4;
/// Standard deviations of an amplifier's gain, and of its offset over the frame's mean value.
const GAIN: f64 = 0.1;
const OFFSET: f64 = 0.1;
/// What a source that gives nothing is seen to give: what is coupled over.
const LOST: f64 = 0.02;
/// Resistances that are tried, ohm: of shorts, and of contacts.
const SHORTS_OHM: [f64; 4] = [0.0, 30.0, 200.0, 1000.0];
/// A leak over so much or more changes a frame in proportion to what it conducts: the frame tells its size.
pub(crate) const LEAK_OHM: f64 = 10_000.0;
/// Where the first stage of amplifiers may end, over the largest voltage of an electrode from the middle of the source, and its gain.
pub(crate) const LIMITS: [f64; 6] = [0.05, 0.12, 0.25, 0.45, 0.75, 1.2];
const FIRST_GAINS: [f64; 4] = [1.0, 4.0, 12.0, 40.0];
const CONTACTS_OHM: [f64; 7] = [10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10_000.0];
/// A contact worse by this is small.
const SCORED_OHM: f64 = 20.0;
/// Steps of the search for a resistance between two of these.
const REFINEMENTS: usize = 10;
/// Most numbers that are predicted at once: it bounds the memory that a search takes.
const PREDICTED_AT_ONCE: usize = 1_000_000;
/// Of so many values one may be wild by itself: half of what a pair of neighbours drives or senses, and a fraction of those of an electrode.
const FEW_VALUES: usize = 32;
/// Of so many sets of open electrodes larger ones are tried.
const MOST_TRIED: usize = 3;
/// Cost of a fault before a frame: as the chance of one in 10⁵. The same of the choice of a resistance.
const FAULT: f64 = 12.0;
const RESISTANCE: f64 = 2.0;
/// What a drive's gain costs more than an amplifier's: switches change more seldom, and small gains of both look alike.
const SWITCH: f64 = 5.0;

/// Of more values a part tells what is broken in frames that follow one another: a search takes a power of their number.
const MOST_LOOKED_AT: usize = 256;

/// Tells faults from frames. What earlier frames have left changes no result.
pub(crate) struct Diagnosis {
    /// With those of the values that are looked at.
    imager: Arc<Imager>,
    /// Which ones these are; none where all are.
    looked_at: Option<Vec<usize>>,
    /// Of the unpressed sheet.
    potentials_ohm: DMatrix<f64>,
    /// What touches and drift do to a frame.
    covariance: Covariance,
    /// Root mean square of the unpressed frame, and its largest value, V.
    mean_v: f64,
    largest_v: f64,
    /// Sense pairs, and drive pairs, each with its values.
    channels: Vec<([usize; 2], Vec<usize>)>,
    drives: Vec<([usize; 2], Vec<usize>)>,
    /// Whether its frames follow one another: then a search may take the time of several.
    is_of_sequence: bool,
    /// What linear faults are told by in a frame of known noise; see [`Diagnosis::suspects`].
    scores: Option<Scores>,
}

/// Scores of faults of unknown size: for each a vector along which a frame is looked at, and the variance of that with touches alone
/// over that with the fault.
struct Scores {
    along: DMatrix<f64>,
    gain: Vec<f64>,
}

/// What a frame tells of faults.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Told {
    /// Touches and drift explain it, or nothing that is known.
    Nothing,
    /// A press on an electrode, or a fault of it: more frames tell.
    Perhaps,
    /// A fault, or two.
    Faults {
        /// Which ones.
        faults: Faults,
        /// Whether nothing else comes into question: touches alone leave more than is expected.
        alone: bool,
    },
}

impl Told {
    /// The faults, if there are any.
    pub(crate) fn faults(self) -> Option<Faults> {
        match self {
            Self::Faults { faults, .. } => Some(faults),
            Self::Nothing | Self::Perhaps => None,
        }
    }

    /// The fault, if it is one.
    pub(crate) fn fault(self) -> Option<Fault> {
        self.faults().and_then(Faults::single)
    }
}

impl Diagnosis {
    /// For the frames of an imager. None where its sheet cannot be solved.
    pub(crate) fn new(imager: &Arc<Imager>) -> Option<Self> {
        let solver = Solver::new(Arc::clone(&imager.model)).ok()?;
        let drift = DriftShapes::new(imager)?;
        let shapes = drift.columns(Drifting::Contacts, |_| 1.0);
        let sd = |kind: usize| if kind < 2 { COMMON } else { CONTACT };
        let shapes = DMatrix::from_fn(shapes.nrows(), shapes.ncols(), |k, c| sd(c) * shapes[(k, c)]);
        let v = &imager.model_v;
        Some(Self {
            potentials_ohm: solver.electrode_matrix().potentials_ohm().clone(),
            covariance: Covariance::new(rises(imager), shapes),
            mean_v: (v.iter().map(|v| v * v).sum::<f64>() / v.len().max(1) as f64).sqrt(),
            largest_v: v.iter().fold(0.0, |m, v| m.max(v.abs())),
            channels: by_pair(imager, |m| m.sense),
            drives: by_pair(imager, |m| m.drive),
            scores: None,
            is_of_sequence: false,
            looked_at: None,
            imager: Arc::clone(imager),
        })
    }

    /// The same for frames that follow one another: a part of many values is looked at. Any electrode, drive and amplifier has its share.
    pub(crate) fn of_sequence(imager: &Arc<Imager>) -> Option<Self> {
        let part = MOST_LOOKED_AT as f64 / imager.pattern.len().max(1) as f64;
        if part >= 1.0 {
            let all = Self::new(imager)?;
            return Some(Self {
                is_of_sequence: true,
                ..all
            });
        }
        let looked_at = spread_evenly(imager.pattern.measurements(), part);
        let measurements = looked_at.iter().map(|k| imager.pattern.measurements()[*k]).collect();
        let seen = Imager {
            pattern: Pattern::from_list(imager.pattern.electrodes(), measurements).ok()?,
            model_v: looked_at.iter().map(|k| imager.model_v[*k]).collect(),
            sensitivity: imager.sensitivity.select_rows(&looked_at),
            ..Imager::clone(imager)
        };
        Some(Self {
            looked_at: Some(looked_at),
            is_of_sequence: true,
            ..Self::new(&Arc::new(seen))?
        })
    }

    /// What is looked at of a difference.
    fn seen<'a>(&self, d: &'a Difference) -> Cow<'a, Difference> {
        let Some(looked_at) = &self.looked_at else {
            return Cow::Borrowed(d);
        };
        Cow::Owned(Difference {
            y: DVector::from_iterator(looked_at.len(), looked_at.iter().map(|k| d.y[*k])),
            spread: looked_at.iter().map(|k| d.spread[*k]).collect(),
            used: looked_at.iter().map(|k| d.used[*k]).collect(),
        })
    }

    fn electrodes(&self) -> usize {
        self.imager.pattern.electrodes()
    }

    /// All pairs of electrodes.
    fn pairs(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let n = self.electrodes();
        (0..n).flat_map(move |a| (a + 1..n).map(move |b| [a, b]))
    }

    /// Values of an electrode.
    fn values_of(&self, electrodes: &[usize]) -> Vec<usize> {
        values_of(&self.imager, electrodes)
    }

    /// Makes ready for [`Diagnosis::suspects`]: frames of this noise, V of the model.
    pub(crate) fn prepare(&mut self, sigma_v: f64, unchanged: &Difference) {
        let unchanged = &*self.seen(unchanged);
        let own = own_noise(unchanged, sigma_v);
        let contacts = (0..self.electrodes()).map(|l| (self.contacts(&[(l, SCORED_OHM)]), 1.0));
        let channels = self.channels.iter().flat_map(|(_, values)| {
            let [gain, offset] = self.channel_columns(values, unchanged);
            [(gain, GAIN), (offset, OFFSET * self.mean_v)]
        });
        let drives = (self.drives.iter()).map(|(_, values)| (self.gain_column(values, unchanged), GAIN));
        let columns: Vec<(DVector<f64>, f64)> = contacts.chain(channels).chain(drives).collect();
        let Some(evidence) = Evidence::new(&unchanged.y, (&mut self.covariance, 1.0), &own, self.largest_v) else {
            return;
        };
        let scored: Vec<(DVector<f64>, f64)> = columns.iter().map(|(c, sd)| evidence.score(c, *sd)).collect();
        let along: Vec<DVector<f64>> = scored.iter().map(|(along, _)| along.clone()).collect();
        self.scores = Some(Scores {
            along: DMatrix::from_columns(&along),
            gain: scored.iter().map(|(_, gain)| *gain).collect(),
        });
    }

    /// Whether a small fault may take the place of touches in a frame: a worse contact, a pair's gain or offset. It takes a
    /// product with a small matrix; a search decides. `stretch`: the variance of its noise over what was prepared for.
    pub(crate) fn suspects(&self, d: &Difference, stretch: f64) -> bool {
        let Some(Scores { along, gain }) = &self.scores else {
            return false;
        };
        let d = self.seen(d);
        let cost = FAULT + RESISTANCE + (gain.len() as f64).ln();
        (along.column_iter().zip(gain)).any(|(along, gain)| 0.5 * along.dot(&d.y).powi(2) > stretch * (cost + gain))
    }

    /// What a gain and an offset of an amplifier change, of unit size.
    fn channel_columns(&self, values: &[usize], d: &Difference) -> [DVector<f64>; 2] {
        [self.gain_column(values, d), column(values, d, &d.spread)]
    }

    /// What a gain of these values changes, of unit size.
    fn gain_column(&self, values: &[usize], d: &Difference) -> DVector<f64> {
        column(values, d, &self.imager.model_v)
    }

    /// A fault of what is looked at as one of all values.
    fn of_all_values(&self, fault: Fault) -> Fault {
        match (fault, &self.looked_at) {
            (Fault::Value(k, of), Some(looked_at)) => Fault::Value(looked_at[k], of),
            _ => fault,
        }
    }

    /// The fault of a whole baseline (any unit) after which no touches are to be had; none where its values are those of the sheet, or
    /// of nothing that is known.
    pub(crate) fn explain_baseline(&mut self, baseline: &[f64]) -> Option<Fault> {
        let (imager, mean_v) = (Arc::clone(&self.imager), self.mean_v);
        let v = &imager.model_v;
        let ratios = v.iter().zip(baseline).map(|(m, b)| (m / b).abs().ln());
        let common = consensus(ratios, std::f64::consts::LN_2)?.0.exp();
        // The board's own volts are the model's where all values are wrong.
        let mut of = |gain: f64| {
            let used: Vec<bool> = baseline.iter().map(|b| b.is_finite()).collect();
            let y = v
                .iter()
                .zip(baseline)
                .map(|(m, b)| if b.is_finite() { gain * b - m } else { 0.0 });
            let d = Difference {
                y: DVector::from_iterator(v.len(), y),
                spread: vec![1.0; v.len()],
                used,
            };
            let values = d.used.iter().filter(|used| **used).count();
            let error = |k: usize| BUILT * (v[k].abs().hypot(d.y[k])).max(0.1 * mean_v);
            let own = (0..v.len()).map(|k| if d.used[k] { error(k) } else { f64::NAN });
            let search = Search::new(self, d.clone(), own.collect(), &[0.0])?;
            Some(search.end(self)).filter(|best| best.cost < values as f64 && best.touches - best.cost > CLEAR)
        };
        let best = [common, 1.0]
            .into_iter()
            .filter_map(&mut of)
            .min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        best.fault.filter(|fault| !fault.leaves_touches())
    }

    /// A source that is lost; of a frame that is compared with a baseline, one whose voltages changed by one factor that is no drift.
    fn offer_source(&self, evidence: &Evidence, of_frame: Option<&Difference>, best: &mut Best) {
        let v = &self.imager.model_v;
        let factor = of_frame.and_then(|d| factor(v, d)).unwrap_or(0.0);
        if factor >= LEAST_GAIN {
            // What is left is a gain.
            return;
        }
        let changed = DVector::from_iterator(v.len(), v.iter().map(|v| (factor - 1.0) * v));
        let fault = if factor.abs() < LOST {
            Fault::Source
        } else {
            Fault::Scale(factor)
        };
        best.offer(FAULT + evidence.of(&changed), || fault);
    }

    fn offer_multiplexers(&self, evidence: &Evidence, best: &mut Best) {
        let n = self.electrodes();
        let ends = [(true, true), (true, false), (false, true), (false, false)];
        let stuck: Vec<((bool, bool), usize)> = ends.iter().flat_map(|end| (0..n).map(move |l| (*end, l))).collect();
        let cost = FAULT + (stuck.len() as f64).ln();
        if let Some((((drive, plus), electrode), of)) =
            cheapest(evidence, &stuck, |(end, l)| self.misrouted(end, |_| l))
        {
            best.offer_of_all(cost + of, Fault::Multiplexer { drive, plus, electrode });
        }
        let lines = usize::BITS - n.saturating_sub(1).leading_zeros();
        let lines = (0..lines as usize).flat_map(|b| (0..b).map(move |a| [a, b]));
        let exchanged: Vec<((bool, bool), [usize; 2])> = lines.flat_map(|lines| ends.map(|end| (end, lines))).collect();
        let cost = FAULT + (exchanged.len() as f64).ln();
        // Where that is no electrode, nothing is connected.
        let predict = |(end, lines)| self.misrouted(end, |l| readdressed(l, lines));
        if let Some((((drive, plus), lines), of)) = cheapest(evidence, &exchanged, predict) {
            best.offer_of_all(cost + of, Fault::Address { drive, plus, lines });
        }
        let pairs: Vec<[usize; 2]> = self.pairs().collect();
        let cost = FAULT + (pairs.len() as f64).ln();
        if let Some((pair, of)) = cheapest(evidence, &pairs, |pair| self.exchanged(pair)) {
            best.offer_of_all(cost + of, Fault::Exchanged(pair));
        }
    }

    fn offer_shorts(&self, evidence: &Evidence, best: &mut Best) {
        let cost = FAULT + RESISTANCE + (self.pairs().count() as f64).ln();
        let shorts: Vec<([usize; 2], f64)> = self.pairs().flat_map(|p| SHORTS_OHM.map(|ohm| (p, ohm))).collect();
        let short = cheapest(evidence, &shorts, |(pair, ohm)| self.short(pair, ohm)).map(|(short, _)| short);
        for (pair, ohm) in short.into_iter().chain(self.leak(evidence)) {
            let (ohm, refined) = self.refine_short((pair, ohm), evidence);
            best.offer_of_all(cost + refined, Fault::Short { electrodes: pair, ohm });
        }
    }

    /// The pair between which most speaks for a leak, and its resistance; none where nothing does.
    fn leak(&self, evidence: &Evidence) -> Option<([usize; 2], f64)> {
        let pairs: Vec<[usize; 2]> = self.pairs().collect();
        let fitted = fitted(evidence, &pairs, |pair| self.short(pair, LEAK_OHM));
        let leaks = fitted.filter(|(_, size, _)| *size > 0.0);
        let (pair, size, _) = leaks.min_by(|a, b| a.2.total_cmp(&b.2))?;
        let across = self.across(pair);
        Some((pair, ((LEAK_OHM + across) / size - across).max(0.0)))
    }

    /// The resistance of a short near a given one, and its cost.
    fn refine_short(&self, (pair, ohm): ([usize; 2], f64), evidence: &Evidence) -> (f64, f64) {
        // Where a wire's own resistance is nothing, a logarithm is none.
        let of = |ohm: f64| evidence.of(&self.short(pair, ohm));
        least(of, (ohm, of(ohm)), [0.2 * ohm, 6.0 * ohm + 30.0], REFINEMENTS)
    }

    fn offer_contacts(&self, evidence: &Evidence, best: &mut Best) {
        if matches!(self.imager.drive, Drive::Current { .. }) {
            // A given current does not go with the contacts of its wires.
            return;
        }
        let n = self.electrodes();
        let one = RESISTANCE + (n as f64).ln();
        let mut worse: Vec<(usize, f64)> = Vec::new();
        let mut before = f64::INFINITY;
        for count in 1..=MOST_ELECTRODES {
            let all = (0..n).filter(|l| !worse.iter().any(|(other, _)| other == l));
            let each: Vec<(usize, f64)> = all.flat_map(|l| CONTACTS_OHM.map(|ohm| (l, ohm))).collect();
            let with = |one| self.contacts(&[&worse[..], &[one]].concat());
            let Some(((l, ohm), _)) = cheapest(evidence, &each, with) else {
                return;
            };
            worse.push((l, ohm));
            let cost = self.refine_contacts(&mut worse, evidence);
            if cost + one > before {
                return;
            }
            before = cost;
            let electrodes: Vec<usize> = worse.iter().map(|(l, _)| *l).collect();
            if best.offer(FAULT + count as f64 * one + cost, || {
                Fault::Contacts(Electrodes::of(&electrodes))
            }) {
                best.worse.clone_from(&worse);
            }
        }
    }

    /// Looks for the resistances one after the other, twice. Gives the cost.
    fn refine_contacts(&self, worse: &mut [(usize, f64)], evidence: &Evidence) -> f64 {
        let mut cost = f64::INFINITY;
        for k in (0..worse.len()).chain(0..worse.len()) {
            let now = worse[k].1;
            let of = |ohm: f64| {
                let mut with = worse.to_vec();
                with[k].1 = ohm;
                evidence.of(&self.contacts(&with))
            };
            let start = (now, of(now));
            (worse[k].1, cost) = least(of, start, [now / 3.5, 3.5 * now], REFINEMENTS);
        }
        cost
    }

    /// Amplifiers that all end before they should, in the first stage.
    fn offer_saturation(&self, evidence: &Evidence, best: &mut Best) {
        if matches!(self.imager.drive, Drive::Current { .. }) {
            // Nothing tells the middle of a source of current.
            return;
        }
        let values = evidence.weighted().len() as f64;
        if best.touches < values {
            // Touches explain the frame. All amplifiers change all of it.
            return;
        }
        let largest_v = self.largest_from_middle_v();
        let limits = LIMITS
            .iter()
            .flat_map(|part| [false, true].map(|both| (part * largest_v, both)));
        let tried: Vec<(f64, (f64, bool))> = limits.flat_map(|limit| FIRST_GAINS.map(|gain| (gain, limit))).collect();
        let cheapest = cheapest(evidence, &tried, |(gain, (limit_v, both))| {
            self.saturated(gain, limit_v, both)
        });
        let Some(((gain, (limit_v, both)), cost)) = cheapest else {
            return;
        };
        let (mut now, mut of_now) = ([gain, limit_v], cost);
        for which in [1, 0, 1, 0, 1] {
            let of = |size: f64| {
                let mut with = now;
                with[which] = size;
                evidence.of(&self.saturated(with[0], with[1], both))
            };
            (now[which], of_now) = least(
                of,
                (now[which], of_now),
                [now[which] / 3.0, 3.0 * now[which]],
                REFINEMENTS,
            );
        }
        best.offer(FAULT + 2.0 * RESISTANCE + of_now, || Fault::Saturated);
    }

    /// What an amplifier, or a switch of the drive, does to a difference; and, of a frame that is compared with a baseline, an offset of all
    /// values that is no drift. A baseline that has one is compared by its ratios like any other.
    fn offer_channels(&self, evidence: &Evidence, d: &Difference, is_of_frame: bool, best: &mut Best) {
        let cost = FAULT + (3.0 * self.channels.len() as f64).ln();
        for (pair, values) in &self.channels {
            let [gain, offset] = self.channel_columns(values, d);
            let (of_gain, size) = evidence.along(&gain, GAIN);
            best.offer(cost + of_gain, || Fault::Gain(*pair, 1.0 + size));
            let (of_offset, _) = evidence.along(&offset, OFFSET * self.mean_v);
            best.offer(cost + of_offset, || Fault::Offset(*pair));
            // Whatever else it does.
            let (of_any, others) = evidence.free(values);
            best.offer_channel((cost + of_any, others), *pair);
        }
        let cost = FAULT + SWITCH + (self.drives.len() as f64).ln();
        for (pair, values) in &self.drives {
            let (of_gain, size) = evidence.along(&self.gain_column(values, d), GAIN);
            best.offer(cost + of_gain, || Fault::Drive(*pair, 1.0 + size));
        }
        let used = d.spread.iter().zip(&d.used);
        let all = used.map(|(spread, used)| if *used { *spread } else { 0.0 });
        let all = DVector::from_iterator(d.used.len(), all);
        let (of_all, size) = evidence.along(&all, OFFSET * self.mean_v);
        if is_of_frame && size.abs() > MOST_OFFSET * self.mean_v {
            best.offer(FAULT + of_all, || Fault::OffsetOfAll);
        }
    }

    /// Wild values, each the furthest from what the others tell. One is named. Several are no fault that is known, and left out by who
    /// holds the values against one another; but without them a frame that has some would look like one of open electrodes, whose values
    /// may be anything as well.
    fn offer_values(&self, evidence: &Evidence, best: &mut Best) {
        let measurements = self.imager.pattern.measurements();
        let one = (measurements.len() as f64).ln();
        let (mut freed, mut least) = (Freed::none(evidence), f64::INFINITY);
        let Some(first) = freed.wildest() else { return };
        let m = measurements[first];
        let of = [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus];
        for count in 1..=(measurements.len() / FEW_VALUES).max(1) {
            let Some(k) = freed.wildest() else { return };
            let cost = freed.cost(&[k]);
            let named = (count == 1).then_some(Fault::Value(first, of));
            best.offer_free(FAULT + count as f64 * one + cost.all, cost.others, || named);
            let Some(with) = freed.with(&[k]).filter(|_| cost.all + one < least) else {
                return;
            };
            (freed, least) = (with, cost.all);
        }
    }

    fn offer_open(&self, evidence: &Evidence, best: &mut Best) {
        let n = self.electrodes();
        let one = (n as f64).ln();
        let mut sets = vec![(Vec::new(), Freed::none(evidence))];
        let mut least = f64::INFINITY;
        for count in 1..=MOST_ELECTRODES {
            let mut tried: Vec<(Cost, Vec<usize>, (usize, usize))> = Vec::new();
            for (from, (set, freed)) in sets.iter().enumerate() {
                for l in (0..n).filter(|l| !set.contains(l)) {
                    let mut with = set.clone();
                    with.push(l);
                    with.sort_unstable();
                    if !tried.iter().any(|(_, other, _)| *other == with) {
                        tried.push((freed.cost(&self.values_of(&[l])), with, (from, l)));
                    }
                }
            }
            tried.sort_by(|a, b| a.0.all.total_cmp(&b.0.all));
            tried.truncate(MOST_TRIED);
            let Some((cost, set, _)) = tried.first() else {
                return;
            };
            let prior = FAULT + count as f64 * one;
            best.offer_open((prior + cost.all, cost.others), Electrodes::of(set));
            if cost.all + one > least || count == MOST_ELECTRODES {
                return;
            }
            least = cost.all;
            let with = |(_, set, (from, l)): (Cost, Vec<usize>, (usize, usize))| {
                let freed = sets[from].1.with(&self.values_of(&[l]))?;
                Some((set, freed))
            };
            sets = tried.into_iter().filter_map(with).collect();
        }
    }
}

/// What these values of a difference are of `all`; the others are 0.
fn column(values: &[usize], d: &Difference, all: &[f64]) -> DVector<f64> {
    let mut out = DVector::zeros(d.used.len());
    for k in values.iter().copied().filter(|k| d.used[*k]) {
        out[k] = all[k];
    }
    out
}

/// An electrode's number with two of its bits exchanged.
fn readdressed(electrode: usize, [a, b]: [usize; 2]) -> usize {
    let differ = (electrode >> a ^ electrode >> b) & 1;
    electrode ^ (differ << a | differ << b)
}

/// The middle of what values are times those of the baseline.
pub(crate) fn factor(model_v: &[f64], d: &Difference) -> Option<f64> {
    let used = (0..model_v.len()).filter(|k| d.used[*k] && model_v[*k] != 0.0);
    let mut factors: Vec<f64> = used.map(|k| 1.0 + d.y[k] / model_v[k]).collect();
    factors.sort_by(f64::total_cmp);
    factors.get(factors.len() / 2).copied()
}

/// Standard deviation of every value's noise, V; not finite for a value that takes no part.
fn own_noise(d: &Difference, sigma_v: f64) -> Vec<f64> {
    let of = |(spread, used): (&f64, &bool)| if *used { sigma_v * spread } else { f64::NAN };
    d.spread.iter().zip(&d.used).map(of).collect()
}

/// The one of these whose prediction costs least, and that cost.
fn cheapest<T: Copy>(evidence: &Evidence, tried: &[T], predict: impl Fn(T) -> DVector<f64>) -> Option<(T, f64)> {
    let costs = of_each(evidence, tried, predict).map(|(one, of)| (one, evidence.cost(&of)));
    costs.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The predictions of these times the sizes that explain a frame best, with the cost of each.
fn fitted<T: Copy>(
    evidence: &Evidence,
    tried: &[T],
    predict: impl Fn(T) -> DVector<f64>,
) -> impl Iterator<Item = (T, f64, f64)> {
    of_each(evidence, tried, predict).map(|(one, of)| {
        let size = of.linear / of.square;
        (one, size, evidence.of_touches() - 0.5 * size * of.linear)
    })
}

/// What tells the costs of these: products of what each predicts with the frame and with itself.
fn of_each<T: Copy>(
    evidence: &Evidence,
    tried: &[T],
    predict: impl Fn(T) -> DVector<f64>,
) -> impl Iterator<Item = (T, Products)> {
    let values = evidence.weighted().len();
    let at_once = (PREDICTED_AT_ONCE / values.max(1)).max(1);
    let products = tried.chunks(at_once).flat_map(move |tried| {
        let mut predicted = DMatrix::zeros(values, tried.len());
        for (mut column, one) in predicted.column_iter_mut().zip(tried) {
            column.copy_from(&predict(*one));
        }
        evidence.products(&predicted)
    });
    tried.iter().copied().zip(products)
}

/// What every cell changes by one standard deviation of its rise, V. Cells before an electrode are a hundred times as sensitive as
/// others; fingers there are as seldom as elsewhere, and smaller rises are expected of them, as of the picture.
fn rises(imager: &Imager) -> DMatrix<f64> {
    let mut s = imager.sensitivity.clone();
    let norms: Vec<f64> = s.column_iter().map(|c| c.norm()).collect();
    let mut sorted = norms.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted
        .get(sorted.len() / 2)
        .copied()
        .unwrap_or(0.0)
        .max(f64::MIN_POSITIVE);
    for (mut column, norm) in s.column_iter_mut().zip(norms) {
        column *= RISE * (norm / median).max(1.0).powf(-DEPTH);
    }
    s
}

/// Pairs of a pattern, whichever way round, each with its values.
fn by_pair(imager: &Imager, of: impl Fn(&Measurement) -> Pair) -> Vec<([usize; 2], Vec<usize>)> {
    let mut out: Vec<([usize; 2], Vec<usize>)> = Vec::new();
    for (k, m) in imager.pattern.measurements().iter().enumerate() {
        let pair = unordered(of(m));
        match out.iter_mut().find(|(of, _)| *of == pair) {
            Some((_, values)) => values.push(k),
            None => out.push((pair, vec![k])),
        }
    }
    out
}

fn unordered(pair: Pair) -> [usize; 2] {
    [pair.plus.min(pair.minus), pair.plus.max(pair.minus)]
}

/// A part of the values, spread evenly over drives and over the places in each: by multiples of the powers of the plastic number, which are
/// so in two dimensions (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences").
fn spread_evenly(measurements: &[Measurement], part: f64) -> Vec<usize> {
    const BY: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];
    let (mut drive, mut place) = (0.0, 0.0);
    let mut chosen = Vec::new();
    for (k, m) in measurements.iter().enumerate() {
        if k > 0 && measurements[k - 1].drive != m.drive {
            (drive, place) = (drive + 1.0, 0.0);
        }
        if (BY[0] * drive + BY[1] * place).fract() < part {
            chosen.push(k);
        }
        place += 1.0;
    }
    chosen
}

/// Values in which one of these electrodes takes part.
pub(crate) fn values_of(imager: &Imager, electrodes: &[usize]) -> Vec<usize> {
    let measurements = imager.pattern.measurements().iter().enumerate();
    let of = measurements.filter(|(_, m)| {
        let of = [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus];
        of.iter().any(|l| electrodes.contains(l))
    });
    of.map(|(k, _)| k).collect()
}

/// Values that a fault spoils, and that are left out because of it.
pub(crate) fn spoilt_by(imager: &Imager, fault: Fault) -> Vec<usize> {
    match fault {
        Fault::Open(electrodes) | Fault::Contacts(electrodes) | Fault::Loose(electrodes) => {
            values_of(imager, electrodes.list())
        }
        Fault::Leak { electrodes, .. } => values_of(imager, &electrodes),
        // Of a sheet that is reciprocal the one is like the inverse of the other, where it is small.
        Fault::Gain(pair, _) | Fault::Drive(pair, _) => {
            [values_of_channel(imager, pair), values_of_drive(imager, pair)].concat()
        }
        Fault::Offset(pair) | Fault::Rail(pair) | Fault::Channel(pair) => values_of_channel(imager, pair),
        Fault::Value(k, _) => vec![k],
        _ => Vec::new(),
    }
}

/// All sense pairs, each with its values.
pub(crate) fn sense_pairs(imager: &Imager) -> Vec<([usize; 2], Vec<usize>)> {
    by_pair(imager, |m| m.sense)
}

/// Values of one sense pair.
pub(crate) fn values_of_channel(imager: &Imager, pair: [usize; 2]) -> Vec<usize> {
    let own = by_pair(imager, |m| m.sense).into_iter().find(|(of, _)| *of == pair);
    own.map_or_else(Vec::new, |(_, values)| values)
}

/// Values for which a pair of electrodes is driven, whichever way round.
pub(crate) fn values_of_drive(imager: &Imager, pair: [usize; 2]) -> Vec<usize> {
    let own = by_pair(imager, |m| m.drive).into_iter().find(|(of, _)| *of == pair);
    own.map_or_else(Vec::new, |(_, values)| values)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of many values every drive and every amplifier has its share in those that are looked at: a third of it at least.
    #[test]
    fn a_part_of_many_values_has_some_of_every_pair() {
        for electrodes in [18, 24, 32, 46] {
            for pattern in [Pattern::adjacent(electrodes), Pattern::opposite(electrodes)].map(Result::unwrap) {
                let part = MOST_LOOKED_AT as f64 / pattern.len() as f64;
                if part >= 1.0 {
                    continue;
                }
                let looked_at = spread_evenly(pattern.measurements(), part);
                assert!((looked_at.len() as f64 / MOST_LOOKED_AT as f64 - 1.0).abs() < 0.1);
                let least = part * pattern.len() as f64 / electrodes as f64 / 3.0;
                let all = pattern.measurements();
                // Whichever way round.
                let same = |a: Pair, b: Pair| a == b || (a.plus == b.minus && a.minus == b.plus);
                let count =
                    |is: &dyn Fn(&Measurement) -> bool| looked_at.iter().filter(|k| is(&all[**k])).count() as f64;
                for m in all {
                    let drives = count(&|other| same(other.drive, m.drive));
                    let senses = count(&|other| same(other.sense, m.sense));
                    assert!(
                        drives >= least && senses >= least,
                        "{electrodes}, {m:?}: {drives} {senses} {least}"
                    );
                }
            }
        }
    }
}
