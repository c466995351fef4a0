//! What changes of a frame without a touch: nuisance parameters that are fitted with the touches.
//!
//! Sources, amplifiers and rubber drift by tenths of a percent within minutes, and touches weaker than that are to be seen.
//! Three kinds of drift are linear and known from the model alone: the gain that all values have in common, the resistance of
//! the whole sheet (temperature), and the impedance of every contact. Touches are looked for and fitted outside these
//! directions, as if nothing were known of the sizes (marginalised nuisance parameters; Kaipio and Somersalo 2005, 5.8). What
//! is known of them is then told by the frame itself ([`crate::touches::fit`], nuisances).
//!
//! The gain is more than linear: it scales what touches change as well. What is found of it is therefore divided out of the
//! frame, and the frame is solved once more.
//!
//! How right touches are after drift: `cargo run --release -p studies --example drift` (docs/reliability.md).

use crate::linalg::basis::Basis;
use crate::reference::imager::Imager;
use forward::{Sensitivity, Solver};
use nalgebra::{DMatrix, DMatrixView};
use serde::{Serialize, Serializer};
use std::fmt;
use std::sync::Arc;

/// Standard deviation of the logarithms of gain and resistance where they drift: a source that loses a tenth, 20 K.
const COMMON: f64 = 0.1;
/// The same of the contacts' impedances: none, warm contacts, those of an hour, and some that were clamped anew.
const CONTACTS: [f64; 6] = [0.0, 0.003, 0.01, 0.03, 0.1, 0.3];

/// The same of a contact that changed for itself.
pub(crate) const CHANGED: f64 = 3.0;

/// Least change of the common gain that a person is told of. Sheets that warm by 4 K change as much.
const NOTABLE: f64 = 0.02;
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
    /// Whether the frame is more probable with contacts that drifted than without.
    #[serde(skip)]
    pub(crate) by_contacts: bool,
    /// What contacts that drift add to the cost of the touches, in units of chi-square.
    #[serde(skip)]
    pub(crate) cost: f64,
    /// How much more probable the frame is with contacts that drift than without, as a logarithm.
    #[serde(skip)]
    pub(crate) evidence: f64,
    /// The contact that changed more than the others do, where the frame shows one.
    #[serde(skip)]
    pub contact: Option<ContactChange>,
}

fn rounded<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64((value * DIGITS).round() / DIGITS)
}

fn all_rounded<S: Serializer>(values: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(values.iter().map(|v| (v * DIGITS).round() / DIGITS))
}

/// What a person is told of a drift.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriftNotice {
    /// The voltages changed all together, by this factor.
    Gain(f64),
}

impl fmt::Display for DriftNotice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self::Gain(gain) = self;
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
        Self {
            gain: 1.0,
            contacts: Vec::new(),
            by_contacts: false,
            cost: 0.0,
            evidence: 0.0,
            contact: None,
        }
    }

    /// What a person is told of it.
    pub fn notice(&self) -> Option<DriftNotice> {
        ((self.gain - 1.0).abs() > NOTABLE).then_some(DriftNotice::Gain(self.gain))
    }

    /// Whether anything is known to have drifted.
    pub fn is_none(&self) -> bool {
        self.gain == 1.0 && self.contacts.is_empty()
    }

    /// No drift, with room for so many electrodes.
    pub(crate) fn with_room(electrodes: usize) -> Self {
        Self {
            gain: 1.0,
            contacts: Vec::with_capacity(electrodes),
            by_contacts: false,
            cost: 0.0,
            evidence: 0.0,
            contact: None,
        }
    }

    /// Makes it another, without allocation where that is no larger.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.gain = other.gain;
        self.contacts.clone_from(&other.contacts);
        (self.by_contacts, self.contact) = (other.by_contacts, other.contact);
        (self.cost, self.evidence) = (other.cost, other.evidence);
    }

    /// Makes it no drift.
    pub(crate) fn clear(&mut self) {
        self.gain = 1.0;
        self.contacts.clear();
        (self.by_contacts, self.contact) = (false, None);
        (self.cost, self.evidence) = (0.0, 0.0);
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
}

/// The change of a frame by every kind of drift, for a unit relative change. Immutable.
#[derive(Clone, Debug)]
pub(crate) struct DriftShapes {
    /// V, values by kinds: the common gain, the sheet's resistance, then every contact's impedance.
    columns: DMatrix<f64>,
}

impl DriftShapes {
    /// For the frames of an imager; none where its sheet cannot be solved.
    pub(crate) fn new(imager: &Imager) -> Option<Self> {
        let electrodes = imager.pattern.electrodes();
        let solver = Solver::new(Arc::clone(&imager.model)).ok()?;
        let by_electrode =
            Sensitivity::by_electrode(&solver).matrix_v(imager.drive, solver.electrode_matrix(), &imager.pattern);
        let mut columns = DMatrix::zeros(imager.pattern.len(), 2 + electrodes);
        columns.column_mut(0).copy_from_slice(&imager.model_v);
        columns.set_column(1, &imager.sensitivity.column_sum());
        columns
            .columns_mut(2, electrodes)
            .copy_from(&by_electrode.columns(0, electrodes));
        Some(Self { columns })
    }

    /// What a relative rise of every contact's impedance does, V: values by electrodes.
    pub(crate) fn of_contacts(&self) -> DMatrix<f64> {
        self.columns.columns(2, self.columns.ncols() - 2).into_owned()
    }

    /// V, values by kinds; those that `drifting` takes.
    pub(crate) fn columns(&self, drifting: Drifting) -> DMatrixView<'_, f64> {
        match drifting {
            Drifting::Nothing => self.columns.columns(0, 0),
            _ => self.columns.columns(0, 2 + self.electrodes(drifting)),
        }
    }

    fn electrodes(&self, drifting: Drifting) -> usize {
        match drifting {
            Drifting::Nothing | Drifting::Common => 0,
            Drifting::Contacts => self.columns.ncols() - 2,
        }
    }

    /// Standard deviations of every kind's size before a frame, from nothing that drifted to more than is likely. Nothing is
    /// known of the contacts that `changed`.
    pub(crate) fn widths(&self, drifting: Drifting, changed: &[usize]) -> impl Iterator<Item = Vec<f64>> {
        let electrodes = self.electrodes(drifting);
        let of = move |common: f64, contact: f64| {
            let contacts = (0..electrodes).map(|l| if changed.contains(&l) { CHANGED } else { contact });
            [common, common].into_iter().chain(contacts).collect()
        };
        let widths = if electrodes == 0 { &CONTACTS[..1] } else { &CONTACTS };
        let drifting = widths.iter().map(move |contact| of(COMMON, *contact));
        std::iter::once(of(0.0, 0.0)).chain(drifting)
    }

    /// Adds the directions of all kinds that drift, with these weights of the values (0 where one takes no part).
    pub(crate) fn add_to(&self, drifting: Drifting, basis: &mut Basis, weight: impl Fn(usize) -> f64) {
        let mut weighed = vec![0.0; self.columns.nrows()];
        for column in self.columns(drifting).column_iter() {
            for (k, (to, v)) in weighed.iter_mut().zip(column.iter()).enumerate() {
                *to = v * weight(k);
            }
            basis.add(&weighed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Drive, ElectrodeMatrix, Pattern, Sheet};

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
