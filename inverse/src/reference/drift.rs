//! What changes of a frame without a touch: nuisance parameters that are fitted with the touches.
//!
//! Sources, amplifiers and rubber drift by tenths of a percent within minutes, and touches weaker than that are to be seen.
//! Kinds of drift that are linear and known from the model alone: the gain that all values have in common, the resistance of
//! the whole sheet (temperature), the impedance of every contact, the gain of every channel and the offset of all, and a
//! smooth unevenness (a sheet that was bent or stretched, or warmed on one side). Touches are looked for and fitted outside these
//! directions, as if nothing were known of the sizes (marginalised nuisance parameters; Kaipio and Somersalo 2005, 5.8). What
//! is known of them is then told by the frame itself ([`crate::touches::fit`], nuisances).
//!
//! The gain is more than linear: it scales what touches change as well. What is found of it is therefore divided out of the
//! frame, and the frame is solved once more.
//!
//! How right touches are after drift: `cargo run --release -p studies --example drift` (docs/reliability.md).

use crate::linalg::basis::Basis;
use crate::reference::imager::{Imager, MOST_ENTRIES};
use forward::field::points;
use forward::{Sensitivity, Solver};
use nalgebra::{DMatrix, DVector};
use serde::{Serialize, Serializer};
use std::fmt;
use std::sync::Arc;

/// Standard deviation of the logarithms of gain and resistance where they drift: a source that loses a tenth, 20 K.
pub(crate) const COMMON: f64 = 0.1;
/// The same of the contacts' impedances: none, warm contacts, those of an hour, and some that were clamped anew.
const CONTACTS: [f64; 6] = [0.0, 0.003, 0.01, 0.03, 0.1, 0.3];

/// The same of the gains of channels: amplifiers that warm up drift by tenths of a percent.
const CHANNELS: [f64; 5] = [0.0, 0.0003, 0.001, 0.003, 0.01];
/// Standard deviation of an offset of all values over their root mean square, for each of these: most values are smaller than that.
pub(crate) const OFFSET: f64 = 10.0;
/// An offset over the root mean square of the values that is no drift any more.
pub(crate) const MOST_OFFSET: f64 = OFFSET * CHANNELS[CHANNELS.len() - 1];
/// Root mean square of a smooth unevenness: none, a sheet warmed on one side, and one that was bent. More is an object on it.
const UNEVEN: [f64; 4] = [0.0, 0.003, 0.01, 0.03];
/// Three standard deviations of the widest: an unevenness that is larger is none.
pub(crate) const MOST_UNEVEN: f64 = 3.0 * UNEVEN[UNEVEN.len() - 1];
/// Correlation lengths of an unevenness over the sheet's reach: that of parts of the sheet, and of the whole. A palm has a quarter.
/// Less hides touches.
const LENGTHS: [f64; 2] = [0.6, 1.2];
/// The box whose waves make it up, over that around the sheet: slopes of the waves vanish at its sides, and not at those of the sheet.
const BOX: f64 = 1.25;
/// Waves of an unevenness below this part of the strongest are left out.
const LEAST_WAVE: f64 = 0.03;

/// The same of a contact that changed for itself.
pub(crate) const CHANGED: f64 = 3.0;

/// Least change of the common gain that a person is told of. Sheets that warm by 4 K change as much.
const NOTABLE: f64 = 0.02;
/// Least unevenness that a person is told of: a third of a usual touch's change is hidden in it.
const NOTABLY_UNEVEN: f64 = 0.005;
/// A gain below this is no drift: the source is lost, or turned round. Above, touches are right beside it, whatever was set.
pub(crate) const LEAST_GAIN: f64 = 0.2;
/// The same of an offset of all values over their root mean square: a finger in the middle changes as much.
const NOTABLY_OFFSET: f64 = 0.01;
/// Digits of what is written: the estimates are no better.
const DIGITS: f64 = 1e4;

/// What drifted since the baseline, as far as a frame tells.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drift {
    /// By what the voltages were multiplied, all together: the source, an amplifier, the temperature of the sheet. What
    /// contacts do is not in it.
    #[serde(serialize_with = "rounded")]
    pub gain: f64,
    /// By what part every contact impedance grew, to first order; empty where nothing tells.
    #[serde(serialize_with = "all_rounded", skip_serializing_if = "Vec::is_empty")]
    pub contacts: Vec<f64>,
    /// Smooth unevenness of the sheet's resistance since the baseline, root mean square; 0 where nothing tells.
    #[serde(serialize_with = "rounded", skip_serializing_if = "is_zero")]
    pub uneven: f64,
    /// Offset of all values beyond what the baseline has followed, over their root mean square; 0 where nothing tells.
    #[serde(serialize_with = "rounded", skip_serializing_if = "is_zero")]
    pub offset: f64,
    /// Whether the frame is more probable with contacts, channels or an unevenness that drifted than with what all values have in
    /// common alone.
    #[serde(skip)]
    pub(crate) by_own: bool,
    /// What contacts, channels or an unevenness that drift add to the cost of the touches, in units of chi-square.
    #[serde(skip)]
    pub(crate) cost: f64,
    /// How much more probable the frame is with these than without, as a logarithm.
    #[serde(skip)]
    pub(crate) evidence: f64,
    /// The contact that changed more than the others do, where the frame shows one.
    #[serde(skip)]
    pub contact: Option<ContactChange>,
    /// Leaks that are known, and their sizes over that of [`LEAK_OHM`](super::diagnosis::LEAK_OHM), beside touches.
    #[serde(skip)]
    pub(crate) leaks: Vec<([usize; 2], f64)>,
}

fn rounded<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64((value * DIGITS).round() / DIGITS)
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn all_rounded<S: Serializer>(values: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(values.iter().map(|v| (v * DIGITS).round() / DIGITS))
}

/// What a person is told of a drift.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriftNotice {
    /// The voltages changed all together, by this factor.
    Gain(f64),
    /// The sheet's resistance changed unevenly: its root mean square over the sheet, a part of the resistance.
    Uneven(f64),
    /// All values are offset, by this part of their root mean square.
    Offset(f64),
}

impl fmt::Display for DriftNotice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let gain = match self {
            Self::Gain(gain) => gain,
            Self::Offset(part) => {
                return write!(
                    f,
                    "all values are offset since the baseline, by {:.1} % of their root mean square; touches take it into account. Look \
                     at the converter and at what couples into it from the source, or take a new baseline",
                    100.0 * part
                );
            }
            Self::Uneven(rms) => {
                return write!(
                    f,
                    "the sheet's resistance has changed unevenly since the baseline, by {:.1} % (root mean square): bent, stretched, \
                     or warm on one side; touches take it into account. Take a new baseline when nothing touches",
                    100.0 * rms
                );
            }
        };
        let (by, way) = (
            100.0 * (gain - 1.0).abs(),
            if *gain > 1.0 { "larger" } else { "smaller" },
        );
        write!(
            f,
            "the voltages are {by:.1} % {way} than in the baseline; touches take it into account. Look at the source and the supply, \
             or take a new baseline"
        )
    }
}

/// A contact that changed more than the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactChange {
    /// The electrode, from 0.
    pub electrode: usize,
    /// By what part its impedance grew, to first order.
    pub change: f64,
    /// How much more probable the frame is with it than without, as a logarithm.
    pub evidence: f64,
}

impl Drift {
    /// No drift.
    pub fn none() -> Self {
        Self::with_room(0)
    }

    /// What a person is told of it.
    pub fn notice(&self) -> Option<DriftNotice> {
        let gain = ((self.gain - 1.0).abs() > NOTABLE).then_some(DriftNotice::Gain(self.gain));
        gain.or((self.uneven > NOTABLY_UNEVEN).then_some(DriftNotice::Uneven(self.uneven)))
            .or((self.offset.abs() > NOTABLY_OFFSET).then_some(DriftNotice::Offset(self.offset)))
    }

    /// Whether anything is known to have drifted.
    pub fn is_none(&self) -> bool {
        self.gain == 1.0 && self.contacts.is_empty() && self.uneven == 0.0 && self.offset == 0.0
    }

    /// No drift, with room for so many electrodes.
    pub(crate) fn with_room(electrodes: usize) -> Self {
        Self {
            gain: 1.0,
            contacts: Vec::with_capacity(electrodes),
            uneven: 0.0,
            offset: 0.0,
            by_own: false,
            cost: 0.0,
            evidence: 0.0,
            contact: None,
            leaks: Vec::new(),
        }
    }

    /// Makes it another, without allocation where that is no larger.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.gain = other.gain;
        self.contacts.clone_from(&other.contacts);
        (self.uneven, self.offset) = (other.uneven, other.offset);
        (self.by_own, self.contact) = (other.by_own, other.contact);
        (self.cost, self.evidence) = (other.cost, other.evidence);
        self.leaks.clone_from(&other.leaks);
    }

    /// Makes it no drift.
    pub(crate) fn clear(&mut self) {
        self.gain = 1.0;
        self.contacts.clear();
        (self.uneven, self.offset) = (0.0, 0.0);
        (self.by_own, self.contact) = (false, None);
        (self.cost, self.evidence) = (0.0, 0.0);
        self.leaks.clear();
    }
}

impl Default for Drift {
    fn default() -> Self {
        Self::none()
    }
}

/// What is taken to drift.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Drifting {
    /// Nothing: a fall in one place is told from a rise everywhere else.
    Nothing,
    /// What all values have in common: gain and resistance. It hides nothing of touches.
    #[default]
    Common,
    /// Every contact as well. It hides a tenth of what tells the sizes of touches, and a fingertip of a whole hand.
    Contacts,
    /// A smooth unevenness as well. It hides half of a palm.
    Uneven,
    /// The gain of every sense pair, and an offset of all values as well. It hides an eighth of what tells touches.
    Channels,
}

impl Drifting {
    /// All kinds of which something is known of every frame, the simplest first.
    pub(crate) const ALL: [Self; 4] = [Self::Common, Self::Contacts, Self::Uneven, Self::Channels];

    /// Which of [`Drifting::ALL`] it is; nothing counts as the first.
    pub(crate) fn index(self) -> usize {
        Self::ALL.iter().position(|d| *d == self).unwrap_or(0)
    }
}

/// The change of a frame by every kind of drift, for a unit relative change. Immutable.
#[derive(Clone, Debug)]
pub(crate) struct DriftShapes {
    /// V, values by two: the common gain, the sheet's resistance.
    common: DMatrix<f64>,
    /// V, values by electrodes: every contact's impedance.
    contacts: DMatrix<f64>,
    /// V for 1 mm, values by electrodes: every electrode's place along the rim.
    slips: DMatrix<f64>,
    /// V, values by waves: an unevenness whose mean square is 1.
    waves: DMatrix<f64>,
    wave_squares: Vec<f64>,
    /// Standard deviations of the waves for every one of [`LENGTHS`], over those for the first.
    of_lengths: [Vec<f64>; LENGTHS.len()],
    /// V, values by pairs and one: the gain of every sense pair, and an offset of all values.
    channels: DMatrix<f64>,
    /// The electrodes' matrix of the sheet, ohm.
    potentials_ohm: DMatrix<f64>,
}

impl DriftShapes {
    /// For the frames of an imager; none where its sheet cannot be solved.
    pub(crate) fn new(imager: &Imager) -> Option<Self> {
        let electrodes = imager.pattern.electrodes();
        let solver = Solver::new(Arc::clone(&imager.model)).ok()?;
        let by_electrode =
            Sensitivity::by_electrode(&solver).matrix_v(imager.drive, solver.electrode_matrix(), &imager.pattern);
        let mut common = DMatrix::zeros(imager.pattern.len(), 2);
        common.column_mut(0).copy_from_slice(&imager.model_v);
        common.set_column(1, &imager.sensitivity.column_sum());
        let waves = Waves::new(imager);
        let mesh = imager.model.mesh();
        let elements = mesh.triangles.len();
        // Cells are wide near the electrodes, where the sensitivity is largest. Elements are narrow there.
        let of_waves = if elements.saturating_mul(imager.pattern.len()) <= MOST_ENTRIES {
            let by_element =
                Sensitivity::by_element(&solver).matrix_v(imager.drive, solver.electrode_matrix(), &imager.pattern);
            by_element * waves.of_regions(elements, |element| points(mesh, element))
        } else {
            &imager.sensitivity * waves.of_regions(imager.grid.len(), |cell| [imager.grid.centre(cell)])
        };
        Some(Self {
            common,
            contacts: by_electrode.columns(0, electrodes).into_owned(),
            slips: by_electrode.columns(electrodes, electrodes).into_owned(),
            wave_squares: waves.squares,
            of_lengths: waves.of_lengths,
            waves: of_waves,
            channels: channels(imager),
            potentials_ohm: solver.electrode_matrix().potentials_ohm().clone(),
        })
    }

    /// What a relative rise of every contact's impedance does, V: values by electrodes.
    pub(crate) fn of_contacts(&self) -> DMatrix<f64> {
        self.contacts.clone()
    }

    /// What a slip of every electrode along the rim does, V for 1 mm: values by electrodes.
    pub(crate) fn of_slips(&self) -> DMatrix<f64> {
        self.slips.clone()
    }

    /// The electrodes' matrix of the sheet, ohm.
    pub(crate) fn potentials_ohm(&self) -> &DMatrix<f64> {
        &self.potentials_ohm
    }

    /// V, values by kinds; those that `drifting` takes, of which the first two are gain and resistance. The difference of a value is
    /// V_model over V_baseline times what the frame is off by, and so is an offset: the inverse of the value's `weight`.
    pub(crate) fn columns(&self, drifting: Drifting, weight: impl Fn(usize) -> f64) -> DMatrix<f64> {
        let Some(own) = self.own(drifting) else {
            return match drifting {
                Drifting::Nothing => DMatrix::zeros(self.common.nrows(), 0),
                _ => self.common.clone(),
            };
        };
        let mut columns = self.common.clone().resize_horizontally(2 + own.ncols(), 0.0);
        columns.columns_mut(2, own.ncols()).copy_from(own);
        if drifting == Drifting::Channels {
            let last = columns.ncols() - 1;
            for (k, value) in columns.column_mut(last).iter_mut().enumerate() {
                let weight = weight(k);
                *value = if weight == 0.0 { 0.0 } else { *value / weight };
            }
        }
        columns
    }

    /// Mean squares over the sheet of what a unit of every wave is, where an unevenness drifts.
    pub(crate) fn wave_squares(&self, drifting: Drifting) -> &[f64] {
        match drifting {
            Drifting::Uneven => &self.wave_squares,
            _ => &[],
        }
    }

    /// Beside gain and resistance.
    fn own(&self, drifting: Drifting) -> Option<&DMatrix<f64>> {
        match drifting {
            Drifting::Nothing | Drifting::Common => None,
            Drifting::Contacts => Some(&self.contacts),
            Drifting::Uneven => Some(&self.waves),
            Drifting::Channels => Some(&self.channels),
        }
    }

    /// Standard deviations of every kind's size before a frame, from nothing that drifted to more than is likely. Nothing is
    /// known of the contacts that `changed`.
    pub(crate) fn widths(&self, drifting: Drifting, changed: &[usize]) -> impl Iterator<Item = Vec<f64>> {
        let own = self.own(drifting).map_or(0, DMatrix::ncols);
        let widths: &[f64] = match drifting {
            Drifting::Nothing | Drifting::Common => &CONTACTS[..1],
            Drifting::Contacts => &CONTACTS,
            Drifting::Uneven => &UNEVEN,
            Drifting::Channels => &CHANNELS,
        };
        let of = move |common: f64, width: f64, length: usize| {
            let sizes = (0..own).map(move |l| match drifting {
                Drifting::Contacts if changed.contains(&l) => CHANGED,
                Drifting::Uneven => width * self.of_lengths[length][l],
                _ => width,
            });
            [common, common].into_iter().chain(sizes).collect()
        };
        let drifting_by = move |width: &f64| {
            let lengths = if drifting == Drifting::Uneven && *width > 0.0 {
                LENGTHS.len()
            } else {
                1
            };
            let width = *width;
            (0..lengths).map(move |length| of(COMMON, width, length))
        };
        std::iter::once(of(0.0, 0.0, 0)).chain(widths.iter().flat_map(drifting_by))
    }

    /// Adds the directions of all kinds that drift, with these weights of the values (0 where one takes no part).
    pub(crate) fn add_to(&self, drifting: Drifting, basis: &mut Basis, weight: impl Fn(usize) -> f64) {
        let mut weighed = vec![0.0; self.common.nrows()];
        for column in self.columns(drifting, &weight).column_iter() {
            for (k, (to, v)) in weighed.iter_mut().zip(column.iter()).enumerate() {
                *to = v * weight(k);
            }
            basis.add(&weighed);
        }
    }
}

/// The waves of a smooth field, each times its standard deviation in a Gaussian process with the squared exponential covariance of the
/// first of [`LENGTHS`], whose mean square over the sheet is 1. Eigenfunctions of the Laplacian on a box make it up (Solin and Särkkä,
/// Statistics and Computing 30, 2020). The even part belongs to the sheet's resistance.
struct Waves {
    low_mm: [f64; 2],
    per_mm: Vec<[f64; 2]>,
    /// Means over the sheet that are taken off, and the standard deviations.
    means: Vec<f64>,
    sd: Vec<f64>,
    /// Mean squares over the sheet.
    squares: Vec<f64>,
    /// Standard deviations for every length over those for the first.
    of_lengths: [Vec<f64>; LENGTHS.len()],
}

impl Waves {
    fn new(imager: &Imager) -> Self {
        let (low, high) = imager.model.geometry().bounding_box();
        let beyond = [0, 1].map(|k| 0.5 * (BOX - 1.0) * (high[k] - low[k]));
        let lengths = LENGTHS.map(|part| part * imager.reach_mm());
        let highest = (-4.0 * LEAST_WAVE.ln()).sqrt() / lengths[0];
        let per_order = [0, 1].map(|k| std::f64::consts::PI / (high[k] - low[k] + 2.0 * beyond[k]));
        let most = per_order.map(|k| (highest / k).floor() as usize);
        let square = |k: &[f64; 2]| k[0] * k[0] + k[1] * k[1];
        let orders = (0..=most[0]).flat_map(|i| (0..=most[1]).map(move |k| [i, k]));
        let per_mm: Vec<[f64; 2]> = orders
            .map(|order| [0, 1].map(|k| order[k] as f64 * per_order[k]))
            .filter(|k| square(k) > 0.0 && square(k) <= highest * highest)
            .collect();
        let ones = vec![1.0; per_mm.len()];
        let mut waves = Self {
            low_mm: [low[0] - beyond[0], low[1] - beyond[1]],
            means: vec![0.0; per_mm.len()],
            squares: ones.clone(),
            of_lengths: LENGTHS.map(|_| ones.clone()),
            sd: ones,
            per_mm,
        };
        let cells = imager.grid.len().max(1);
        let values = waves.of_regions(imager.grid.len(), |cell| [imager.grid.centre(cell)]);
        waves.means = values.column_iter().map(|wave| wave.mean()).collect();
        let variances: Vec<f64> = values
            .column_iter()
            .map(|wave| wave.norm_squared() / cells as f64 - wave.mean().powi(2))
            .collect();
        // A field of mean square 1 for every length.
        let sds = lengths.map(|length| {
            let sd = waves.per_mm.iter().map(|k| (-0.25 * square(k) * length * length).exp());
            let sd: Vec<f64> = sd.collect();
            let mean: f64 = sd.iter().zip(&variances).map(|(sd, v)| sd * sd * v).sum();
            sd.iter()
                .map(|sd| sd / mean.sqrt().max(f64::MIN_POSITIVE))
                .collect::<Vec<f64>>()
        });
        waves.of_lengths =
            std::array::from_fn(|l| sds[l].iter().zip(&sds[0]).map(|(own, first)| own / first).collect());
        waves.squares = sds[0].iter().zip(&variances).map(|(sd, v)| sd * sd * v).collect();
        let [first, ..] = sds;
        waves.sd = first;
        waves
    }

    /// Means over the points of so many regions: regions by waves.
    fn of_regions<const N: usize>(&self, regions: usize, points: impl Fn(usize) -> [[f64; 2]; N]) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(regions, self.per_mm.len());
        for region in 0..regions {
            for at in points(region) {
                let from = [at[0] - self.low_mm[0], at[1] - self.low_mm[1]];
                for (w, k) in self.per_mm.iter().enumerate() {
                    out[(region, w)] += (k[0] * from[0]).cos() * (k[1] * from[1]).cos() / N as f64;
                }
            }
        }
        for (w, mut column) in out.column_iter_mut().enumerate() {
            column.add_scalar_mut(-self.means[w]);
            column *= self.sd[w];
        }
        out
    }
}

/// What a relative change of the gain does, of every sense pair. Last, an offset of all values of [`OFFSET`] times their root mean
/// square. A drive pair's gain is what its contacts do.
fn channels(imager: &Imager) -> DMatrix<f64> {
    let mut known = Vec::new();
    let mut columns: Vec<DVector<f64>> = Vec::new();
    for (k, m) in imager.pattern.measurements().iter().enumerate() {
        let pair = (m.sense.plus, m.sense.minus);
        let place = known.iter().position(|p| *p == pair).unwrap_or_else(|| {
            known.push(pair);
            columns.push(DVector::zeros(imager.pattern.len()));
            known.len() - 1
        });
        columns[place][k] = imager.model_v[k];
    }
    let values = imager.pattern.len();
    let square: f64 = imager.model_v.iter().map(|v| v * v).sum();
    let rms_v = (square / values.max(1) as f64).sqrt();
    columns.push(DVector::from_element(values, OFFSET * rms_v));
    DMatrix::from_columns(&columns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Drive, ElectrodeMatrix, Pattern, Sheet};

    /// A sheet that was bent, warmed on one side or stretched in parts is explained by the waves, but for 2 % of its change (waves that
    /// are left out) and the second order.
    #[test]
    fn waves_are_what_a_smooth_field_does_to_second_order() {
        let imager = Imager::new(&Sheet::paper(), Drive::PAPER, Pattern::adjacent(16).unwrap(), 5.0).unwrap();
        let shapes = DriftShapes::new(&imager).unwrap();
        let mut basis = Basis::default();
        shapes.add_to(Drifting::Uneven, &mut basis, |_| 1.0);
        let mut solver = Solver::new(Arc::clone(&imager.model)).unwrap();
        let fields: [fn([f64; 2]) -> f64; 3] = [
            |p| (0.8 * p[0] - 0.6 * p[1]) / 97.5,
            |p| (0.031 * p[0] + 0.2).sin() * (0.017 * p[1] - 1.0).cos(),
            |p| (-((p[0] - 40.0).powi(2) + p[1] * p[1]) / (2.0 * 80.0 * 80.0)).exp(),
        ];
        for (k, field) in fields.into_iter().enumerate() {
            let mut frame = |size: f64| -> Vec<f64> {
                let conductivity = forward::field::conductivity_of(imager.model.mesh(), |p| size * field(p));
                let changed = imager
                    .drive
                    .frame_v(solver.solve(&conductivity).unwrap(), &imager.pattern);
                changed.iter().zip(&imager.model_v).map(|(c, v)| c - v).collect()
            };
            for size in [0.01, 0.04] {
                let mut change = frame(size);
                let norm = change.iter().map(|v| v * v).sum::<f64>().sqrt();
                let left = basis.outside(&mut change).sqrt();
                assert!(
                    left < (0.5 * size + 0.02) * norm,
                    "field {k} of {size}: {}",
                    left / norm
                );
            }
        }
    }

    /// Frames of contacts, a sheet and a gain that drifted, by the whole model, are explained by the shapes to second order.
    #[test]
    fn the_shapes_are_what_the_model_does_to_second_order() {
        for drive in [Drive::PAPER, Drive::Current { amplitude_a: 1e-3 }] {
            let imager = Imager::new(&Sheet::paper(), drive, Pattern::adjacent(16).unwrap(), 10.0).unwrap();
            let shapes = DriftShapes::new(&imager).unwrap();
            let mut basis = Basis::default();
            shapes.add_to(Drifting::Contacts, &mut basis, |_| 1.0);
            let frame = |size: f64| -> Vec<f64> {
                let (gain, resistance) = (1.0 + 2.0 * size, 1.0 - size);
                let electrodes = imager.model.sheet().electrodes.iter().enumerate();
                let worse = |l: usize| 1.0 + size * ((5 * l % 16) as f64 / 8.0 - 1.0);
                let contacts: Vec<f64> = electrodes.map(|(l, e)| e.contact_mm * worse(l) / resistance).collect();
                let solver = Solver::new(Arc::new(imager.model.with_contacts(&contacts).unwrap())).unwrap();
                let potentials = solver.electrode_matrix().potentials_ohm() * resistance;
                let drifted = drive.frame_v(&ElectrodeMatrix::from_potentials(potentials), &imager.pattern);
                let change = drifted.iter().zip(&imager.model_v).map(|(d, v)| gain * d - v);
                change.collect()
            };
            let outside = |size: f64| basis.outside(&mut frame(size)).sqrt();
            let norm = frame(0.02).iter().map(|v| v * v).sum::<f64>().sqrt();
            let ratio = outside(0.02) / outside(0.01);
            assert!((3.5..4.5).contains(&ratio), "{drive:?} {ratio}");
            assert!(outside(0.02) < 1e-3 * norm, "{drive:?}");
        }
    }
}
