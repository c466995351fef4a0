//! What contacts and leaks do to a frame.

use super::cause::Cause;
use crate::linalg::basis::Basis;
use crate::linalg::vector::dot;
use crate::reference::Difference;
use crate::reference::diagnosis::{LEAK_OHM, across, leaked};
use crate::reference::drift::DriftShapes;
use crate::reference::imager::Imager;
use forward::{Drive, Electrode, Place, Solver};
use nalgebra::{DMatrix, DMatrixView};
use std::sync::Arc;

/// Factors of a contact impedance whose shapes are left out with the derivative: what lies between lies in their span, to one
/// standard deviation of the noise at 27 dB.
const FACTORS: [f64; 2] = [2.5, 8.0];
/// A scale of a drive below this is no contact: it is lost.
const LEAST_SCALE: f64 = 0.05;

/// What contacts do to the frames of an imager.
#[derive(Clone, Debug)]
pub(crate) struct Contacts {
    /// Measurements of every drive.
    drives: Vec<Vec<usize>>,
    /// Drives of every electrode whose current goes with its contact: none where the current is given.
    driven: Vec<Vec<usize>>,
    /// Change of every voltage (V) by a unit relative rise of every contact.
    slopes: DMatrix<f64>,
    /// The same by a slip of every electrode along the rim, V for 1 mm.
    slips: DMatrix<f64>,
    /// Centre and width of every electrode, mm; 0 wide inside the sheet, where none slips along a rim.
    places: Vec<([f64; 2], f64)>,
    /// What any change of a contact does, made when first needed: see [`Contacts::shapes`].
    shapes: Vec<Option<DMatrix<f64>>>,
    /// Leaks that are much like touches; none where contacts are not looked for.
    leaks: Vec<Leak>,
}

/// A leak between the wires of two electrodes.
#[derive(Clone, Debug)]
struct Leak {
    electrodes: [usize; 2],
    /// What the sheet has between them, ohm.
    across_ohm: f64,
    /// What one of [`LEAK_OHM`] does to a frame, V: a column.
    shape: DMatrix<f64>,
}

/// Part of the electrodes, in their order, by which two are apart at most whose leak is much like touches. A search tells leaks further
/// across the sheet.
const NEAR: usize = 8;

impl Leak {
    /// Between all electrodes near one another.
    fn all(imager: &Imager, potentials_ohm: &DMatrix<f64>) -> Vec<Self> {
        let n = imager.pattern.electrodes();
        let by = 1..=n.div_ceil(NEAR).min(n.saturating_sub(1) / 2);
        let pairs = by.flat_map(|by| (0..n).map(move |l| [l, (l + by) % n]));
        let of = |[a, b]: [usize; 2]| {
            let electrodes = [a.min(b), a.max(b)];
            let shape = leaked(imager, potentials_ohm, electrodes, LEAK_OHM);
            Self {
                electrodes,
                across_ohm: across(potentials_ohm, electrodes),
                shape: DMatrix::from_column_slice(shape.len(), 1, shape.as_slice()),
            }
        };
        pairs.map(of).collect()
    }
}

impl Contacts {
    /// For the frames of an imager that drift so.
    pub(crate) fn new(imager: &Imager, drift: &DriftShapes) -> Self {
        let (pattern, n) = (&imager.pattern, imager.pattern.electrodes());
        let of = |drive| (0..pattern.len()).filter(move |k| pattern.measurements()[*k].drive == drive);
        let through = |l: usize| {
            let drives = pattern.drives().iter().enumerate();
            let own = drives.filter(|(_, p)| p.plus == l || p.minus == l).map(|(m, _)| m);
            match imager.drive {
                Drive::Voltage { .. } => own.collect(),
                Drive::Current { .. } => Vec::new(),
            }
        };
        Self {
            drives: pattern.drives().iter().map(|p| of(*p).collect()).collect(),
            driven: (0..n).map(through).collect(),
            slopes: drift.of_contacts(),
            slips: drift.of_slips(),
            places: places(imager),
            shapes: vec![None; n],
            leaks: match imager.is_searched() {
                true => Leak::all(imager, drift.potentials_ohm()),
                false => Vec::new(),
            },
        }
    }

    /// How many directions of a frame it takes.
    pub(crate) fn directions(&self, cause: Cause) -> usize {
        let Cause::Contact(electrode) = cause else { return 1 };
        let slips = usize::from(self.places[electrode].1 > 0.0);
        self.driven[electrode].len() + 1 + slips + FACTORS.len()
    }

    /// Whether a point lies where touches are much like it. That is within two widths of an electrode, or as near to one that leaks as the
    /// two are to one another.
    pub(crate) fn is_at(&self, cause: Cause, at: [f64; 2]) -> bool {
        let place = |l: usize| self.places.get(l).map_or([f64::NAN; 2], |(centre, _)| *centre);
        let apart = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        match cause {
            Cause::Contact(electrode) => {
                let width = self.places.get(electrode).map_or(0.0, |(_, width)| *width);
                apart(at, place(electrode)) < 2.0 * width
            }
            Cause::Leak([a, b]) => {
                let most = apart(place(a), place(b));
                [a, b].iter().any(|l| apart(at, place(*l)) < most)
            }
        }
    }

    /// Resistance of a leak of this size over that of [`LEAK_OHM`], ohm; none where that conducts nothing.
    pub(crate) fn leak_ohm(&self, electrodes: [usize; 2], size: f64) -> Option<f64> {
        let across = self.leaks.iter().find(|leak| leak.electrodes == electrodes)?.across_ohm;
        Some((LEAK_OHM + across) / size - across).filter(|ohm| *ohm > 0.0 && ohm.is_finite())
    }

    /// What slips and leaks do to reduced frames; `reduction` reduces a frame of V.
    pub(crate) fn rim_shapes(&self, imager: &Imager, reduction: &DMatrix<f64>) -> Vec<RimShape> {
        let slips = (0..self.driven.len()).map(|l| (Cause::Contact(l), self.small(imager, l)));
        let leaks = (self.leaks.iter()).map(|leak| (Cause::Leak(leak.electrodes), leak.shape.clone()));
        let all: Vec<(Cause, DMatrix<f64>)> = slips.chain(leaks).collect();
        let columns: Vec<_> = all.iter().flat_map(|(_, small)| small.column_iter()).collect();
        if columns.is_empty() {
            return Vec::new();
        }
        let reduced = reduction * DMatrix::from_columns(&columns);
        let mut first = 0;
        let shapes = all.iter().map(|(cause, small)| {
            first += small.ncols();
            let reduced = reduced.columns(first - small.ncols(), small.ncols());
            RimShape::new(*cause, small, reduced)
        });
        shapes.filter(RimShape::is_told).collect()
    }

    /// What a small change of a contact does to a frame, V: its drives' scales and the shunt. Last comes its slip, for 1 mm along the rim.
    /// A column each.
    fn small(&self, imager: &Imager, electrode: usize) -> DMatrix<f64> {
        let driven = &self.driven[electrode];
        let mut out = DMatrix::zeros(imager.pattern.len(), driven.len() + 2);
        for (mut column, drive) in out.column_iter_mut().zip(driven) {
            self.drives[*drive].iter().for_each(|k| column[*k] = imager.model_v[*k]);
        }
        out.column_mut(driven.len()).copy_from(&self.slopes.column(electrode));
        out.column_mut(driven.len() + 1)
            .copy_from(&self.slips.column(electrode));
        out
    }

    /// What it does to a frame, V, whatever its size, a column each. `None` when a sheet with such a contact cannot be solved.
    pub(crate) fn shapes(&mut self, imager: &Imager, cause: Cause) -> Option<&DMatrix<f64>> {
        match cause {
            Cause::Contact(electrode) => self.shapes_of_contact(imager, electrode),
            Cause::Leak(electrodes) => {
                let leak = self.leaks.iter().find(|leak| leak.electrodes == electrodes)?;
                Some(&leak.shape)
            }
        }
    }

    fn shapes_of_contact(&mut self, imager: &Imager, electrode: usize) -> Option<&DMatrix<f64>> {
        if self.shapes.get(electrode)?.is_none() {
            let small = self.small(imager, electrode);
            let mut out = small.clone().resize_horizontally(small.ncols() + FACTORS.len(), 0.0);
            let contacts: Vec<f64> = imager.model.sheet().electrodes.iter().map(|e| e.contact_mm).collect();
            for (k, factor) in FACTORS.into_iter().enumerate() {
                let mut changed = contacts.clone();
                changed[electrode] *= factor;
                let model = imager.model.with_contacts(&changed).ok()?;
                let solver = Solver::new(Arc::new(model)).ok()?;
                let volts = imager.drive.frame_v(solver.electrode_matrix(), &imager.pattern);
                let change = volts.iter().zip(&imager.model_v).map(|(v, m)| v - m);
                out.column_mut(small.ncols() + k)
                    .iter_mut()
                    .zip(change)
                    .for_each(|(o, c)| *o = c);
            }
            self.shapes[electrode] = Some(out);
        }
        self.shapes[electrode].as_ref()
    }

    /// Undoes the scales of the drives through electrodes whose contacts changed.
    pub(crate) fn even_out(&self, changed: &[Cause], model_v: &[f64], d: &mut Difference) {
        for (drive, measurements) in self.drives.iter().enumerate() {
            let mut contacts = changed.iter().filter_map(|cause| cause.contact());
            if !contacts.any(|l| self.driven[l].contains(&drive)) {
                continue;
            }
            let (mut along, mut all) = (0.0, 0.0);
            for k in measurements.iter().copied().filter(|k| d.used[*k]) {
                along += d.y[k] * model_v[k] / d.spread[k].powi(2);
                all += (model_v[k] / d.spread[k]).powi(2);
            }
            // What touches change of this sum is small against the voltages, and their share in the scale is a
            // hundredth of a hundredth.
            let scale = 1.0 + along / all;
            if scale.is_finite() && scale > LEAST_SCALE {
                for k in measurements.iter().copied().filter(|k| d.used[*k]) {
                    d.y[k] = (d.y[k] - (scale - 1.0) * model_v[k]) / scale;
                }
            }
        }
    }
}

/// What the slip of an electrode along its rim does to a reduced frame, or a leak.
#[derive(Clone, Debug)]
pub(crate) struct RimShape {
    /// What it is the shape of.
    pub(crate) cause: Cause,
    /// What the contact of an electrode does that slips.
    pub(crate) contact: Basis,
    /// The slip beside that, or the leak, of unit length; 0 where a frame does not tell it.
    pub(crate) beside: Vec<f64>,
}

/// Part of a shape's length that has to be left of it in a reduced frame: less is not told from drift and from other shapes.
const LEAST_LEFT: f64 = 0.01;

impl RimShape {
    /// From a frame's shapes, V, of which the last is the slip or the leak, and from the same in a reduced frame.
    fn new(cause: Cause, small: &DMatrix<f64>, reduced: DMatrixView<f64>) -> Self {
        let mut contact = Basis::default();
        let mut beside = vec![0.0; reduced.nrows()];
        for (k, (shape, reduced)) in small.column_iter().zip(reduced.column_iter()).enumerate() {
            beside.copy_from_slice(reduced.as_slice());
            let left = contact.outside(&mut beside);
            if left <= LEAST_LEFT * LEAST_LEFT * shape.norm_squared() {
                beside.fill(0.0);
            } else if k + 1 < small.ncols() {
                contact.add(&beside);
            } else {
                beside.iter_mut().for_each(|v| *v /= left.sqrt());
            }
        }
        Self { cause, contact, beside }
    }

    /// How many directions it takes, with those of the contact.
    pub(crate) fn directions(&self) -> usize {
        self.contact.columns().len() / self.beside.len().max(1) + 1
    }

    /// How much of the square of a vector lies along what the contact does, and along the shape beside that. Nothing where it cannot have
    /// that size.
    pub(crate) fn along(&self, v: &[f64]) -> [f64; 2] {
        let v = &v[..self.beside.len().min(v.len())];
        let own = dot(&self.beside[..v.len()], v);
        if !self.may_be(own) {
            return [0.0, 0.0];
        }
        let of_contact = self.contact.columns().chunks_exact(self.beside.len().max(1));
        let of_contact: f64 = of_contact.map(|c| dot(&c[..v.len()], v).powi(2)).sum();
        [of_contact, own * own]
    }

    /// Whether it may have this size, of any unit: between wires nothing but a conductance comes.
    pub(crate) fn may_be(&self, size: f64) -> bool {
        matches!(self.cause, Cause::Contact(_)) || size > 0.0
    }

    /// Whether a frame tells it.
    fn is_told(&self) -> bool {
        self.beside.iter().any(|v| *v != 0.0)
    }
}

fn places(imager: &Imager) -> Vec<([f64; 2], f64)> {
    let centres = imager.model.geometry().electrode_centres();
    let width = |e: &Electrode| match e.place {
        Place::Angle { width_mm, .. } | Place::Arc { width_mm, .. } | Place::Point { width_mm, .. } => width_mm,
        Place::Inside { .. } => 0.0,
    };
    centres
        .into_iter()
        .zip(imager.model.sheet().electrodes.iter().map(width))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{ElectrodeMatrix, Pattern, Sheet};

    fn imager(drive: Drive) -> Imager {
        Imager::new(&Sheet::paper(), drive, Pattern::adjacent(16).unwrap(), 10.0).unwrap()
    }

    fn contacts(imager: &Imager) -> Contacts {
        Contacts::new(imager, &DriftShapes::new(imager).unwrap())
    }

    /// A resistance in an electrode's wire scales its two drives and does no more.
    #[test]
    fn what_a_wire_does_is_undone() {
        let imager = imager(Drive::PAPER);
        let contacts = contacts(&imager);
        let solver = Solver::new(Arc::clone(&imager.model)).unwrap();
        for ohm in [20.0, 500.0] {
            let mut potentials = solver.electrode_matrix().potentials_ohm().clone();
            potentials[(11, 11)] += ohm;
            let frame = imager
                .drive
                .frame_v(&ElectrodeMatrix::from_potentials(potentials), &imager.pattern);
            let mut d = imager.difference(&imager.model_v, &frame).unwrap();
            let before = d.y.norm();
            contacts.even_out(&[Cause::Contact(11)], &imager.model_v, &mut d);
            assert!(d.y.norm() < 1e-9 * before, "{ohm}");
        }
    }

    /// What a contact's impedance does, whatever its size, lies along its shapes.
    #[test]
    fn any_change_of_a_contact_lies_along_its_shapes() {
        for drive in [Drive::PAPER, Drive::Current { amplitude_a: 1e-3 }] {
            let imager = imager(drive);
            let mut contacts = contacts(&imager);
            let mut basis = Basis::default();
            for column in contacts.shapes(&imager, Cause::Contact(4)).unwrap().column_iter() {
                basis.add(column.as_slice());
            }
            for factor in [1.1, 1.6, 4.0, 6.0] {
                let mut contact: Vec<f64> = imager.model.sheet().electrodes.iter().map(|e| e.contact_mm).collect();
                contact[4] *= factor;
                let solver = Solver::new(Arc::new(imager.model.with_contacts(&contact).unwrap())).unwrap();
                let frame = drive.frame_v(solver.electrode_matrix(), &imager.pattern);
                let mut y: Vec<f64> = frame.iter().zip(&imager.model_v).map(|(v, m)| v - m).collect();
                let before: f64 = y.iter().map(|v| v * v).sum();
                assert!(basis.outside(&mut y) < 1e-4 * before, "{drive:?} {factor}");
            }
        }
    }
}
