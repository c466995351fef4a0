//! The sheet under a scene, solved by the forward model on a mesh of its own.

use crate::creep::{Creep, Points};
use crate::scene::{Scene, TouchNow};
use crate::sheet::SheetModel;
use crate::variation::{Ageing, Variation};
use forward::field::{POINTS, conductivity_of, conductivity_of_steps};
use forward::{DiscTouch, Electrode, ElectrodeMatrix, ForwardError, Model, ModelOptions, Sheet, Solver, Tensor};
use std::sync::Arc;

/// Relative accuracy of the simulated voltages. Finer than the reconstruction's mesh: the two do not share their errors. Less
/// costs time in every scene that moves.
const ACCURACY: f64 = 5e-4;

/// Largest relative change of an element's conductivity that is not solved for again. Such a change moves no voltage by more
/// than itself, and mostly by far less. Less solves for creep that nobody can measure; more makes creep advance in steps.
const UNCHANGED: f64 = 1e-5;

/// Largest relative change of a contact impedance that gets no new model. Such a change moves the sense voltages by a
/// fraction of itself. Less makes more models, more makes ageing contacts advance in steps.
const SAME_CONTACT: f64 = 1e-4;

/// A sheet of rubber and what happens on it.
pub struct Rubber {
    scene: Scene,
    solver: Solver,
    points: Points,
    creep: Creep,
    /// Conductance of every element by unevenness; empty for an even sheet.
    uneven: Vec<f64>,
    /// Contact impedances of the new sheet, mm.
    contact_mm: Vec<f64>,
    /// What changes from look to look, as it was when the state was last computed.
    seen: Seen,
    /// What the electrodes see of the aged sheet.
    matrix: ElectrodeMatrix,
}

#[derive(Default, PartialEq)]
struct Seen {
    touches: Vec<TouchNow>,
    stretches: Vec<f64>,
    crept: bool,
}

impl Rubber {
    /// Meshes a sheet and solves it untouched.
    ///
    /// # Errors
    /// [`ForwardError`] says what is wrong with the sheet.
    pub fn new(sheet: &Sheet, scene: Scene) -> Result<Self, ForwardError> {
        let options = ModelOptions {
            accuracy: ACCURACY,
            ..ModelOptions::default()
        };
        Self::on_model(Arc::new(Model::new(sheet, &options)?), scene)
    }

    /// The same on a mesh that is there already.
    ///
    /// # Errors
    /// As for [`Solver::new`].
    pub fn on_model(model: Arc<Model>, scene: Scene) -> Result<Self, ForwardError> {
        let points = Points::new(model.mesh());
        let Variation {
            resistivity_sd,
            contact_sd,
            ..
        } = scene.variation;
        let mut uneven = Vec::new();
        if resistivity_sd > 0.0 {
            let resistivity = scene.variation.resistivity();
            let conductivity = conductivity_of(model.mesh(), |p| resistivity(p) - 1.0);
            uneven = conductivity.iter().map(|s| s[0]).collect();
        }
        let mut contact_mm: Vec<f64> = model.sheet().electrodes.iter().map(|e| e.contact_mm).collect();
        let mut model = model;
        if contact_sd > 0.0 {
            let factors = scene.variation.contacts(contact_mm.len());
            contact_mm.iter_mut().zip(factors).for_each(|(c, f)| *c *= f);
            model = Arc::new(model.with_contacts(&contact_mm)?);
        }
        let mut solver = Solver::portable(model)?;
        if !uneven.is_empty() {
            let conductivity: Vec<Tensor> = uneven.iter().map(|s| [*s, 0.0, *s]).collect();
            solver.solve(&conductivity)?;
        }
        Ok(Self {
            creep: Creep::new(&scene, &points),
            seen: Seen {
                stretches: vec![0.0; scene.stretches.len()],
                ..Seen::default()
            },
            scene,
            matrix: solver.electrode_matrix().clone(),
            solver,
            points,
            uneven,
            contact_mm,
        })
    }

    /// What happens on it.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Strain of discs with sharp edges, and of all else at the points of every element.
    fn strain(&self, Seen { touches, stretches, .. }: &Seen) -> (Vec<DiscTouch>, Vec<[f64; POINTS]>) {
        let material = &self.scene.material;
        let mut discs: Vec<DiscTouch> = Vec::new();
        let mut disc = |centre_mm, radius_mm, strain| {
            let same = |d: &&mut DiscTouch| d.centre_mm == centre_mm && d.radius_mm == radius_mm;
            match discs.iter_mut().find(same) {
                Some(d) => d.rise += strain,
                None => discs.push(DiscTouch {
                    centre_mm,
                    radius_mm,
                    rise: strain,
                }),
            }
        };
        let mut smooth = Vec::new();
        if let Some(field) = self.creep.field() {
            let scaled = field.iter().map(|q| q.map(|q| material.delayed_per_mpa * q));
            smooth.extend(scaled);
        }
        for bump in touches.iter().flat_map(TouchNow::bumps) {
            if bump.flat {
                disc(
                    bump.centre_mm,
                    bump.half_axes_mm[0],
                    material.instant_per_mpa * bump.peak_mpa,
                );
                continue;
            }
            smooth.resize(self.points.elements.len(), [0.0; POINTS]);
            self.points.within(&bump, |element| {
                for (s, p) in smooth[element].iter_mut().zip(&self.points.elements[element].points) {
                    *s += material.instant_per_mpa * bump.pressure_mpa(*p);
                }
            });
        }
        for (stretch, strain) in self.scene.stretches.iter().zip(stretches) {
            smooth.resize(self.points.elements.len(), [0.0; POINTS]);
            for (values, element) in smooth.iter_mut().zip(&self.points.elements) {
                for (s, p) in values.iter_mut().zip(&element.points) {
                    *s -= strain * stretch.share(*p);
                }
            }
        }
        for imprint in self.creep.imprints() {
            disc(
                imprint.centre_mm,
                imprint.radius_mm,
                material.delayed_per_mpa * imprint.delayed_mpa,
            );
        }
        (discs, smooth)
    }
}

impl Rubber {
    /// Solves for what presses now, if that is anything new.
    fn press(&mut self, t_s: f64) -> Result<(), ForwardError> {
        self.creep.advance(&self.scene, &self.points, t_s);
        let local_s = self.scene.local_s(t_s);
        let now = Seen {
            touches: self.scene.truth(t_s),
            stretches: self.scene.stretches.iter().map(|s| s.strain(local_s)).collect(),
            crept: self.creep.field().is_some() || !self.creep.imprints().is_empty(),
        };
        if now == self.seen && !now.crept {
            return Ok(());
        }
        let (discs, smooth) = self.strain(&now);
        let material = &self.scene.material;
        let mesh = self.solver.model().mesh();
        let mut conductivity = conductivity_of_steps(mesh, &discs, &smooth, |s| 1.0 + material.rise_of_strain(s));
        for (tensor, even) in conductivity.iter_mut().zip(&self.uneven) {
            tensor.iter_mut().for_each(|s| *s *= even);
        }
        if changed(self.solver.conductivity(), &conductivity) {
            self.solver.solve(&conductivity)?;
        }
        self.seen = now;
        Ok(())
    }

    /// Takes other contacts where those there have aged, relative to a sheet of `resistivity` times the new one's.
    fn age(&mut self, t_s: f64, resistivity: f64) -> Result<(), ForwardError> {
        let aged = self
            .scene
            .ageing
            .contacts(self.contact_mm.len(), self.scene.variation.seed, t_s);
        let contact_mm: Vec<f64> = aged
            .iter()
            .zip(&self.contact_mm)
            .map(|(factor, new)| new * factor / resistivity)
            .collect();
        let there = &self.solver.model().sheet().electrodes;
        let same = |(e, c): (&Electrode, &f64)| (c / e.contact_mm - 1.0).abs() < SAME_CONTACT;
        if !there.iter().zip(&contact_mm).all(same) {
            let model = self.solver.model().with_contacts(&contact_mm)?;
            let mut solver = Solver::portable(Arc::new(model))?;
            solver.solve(self.solver.conductivity())?;
            self.solver = solver;
        }
        Ok(())
    }
}

impl SheetModel for Rubber {
    fn electrode_matrix(&mut self, t_s: f64) -> Result<&ElectrodeMatrix, ForwardError> {
        self.press(t_s)?;
        if self.scene.ageing == Ageing::default() {
            return Ok(self.solver.electrode_matrix());
        }
        let resistivity = self.scene.ageing.resistivity(t_s);
        self.age(t_s, resistivity)?;
        let potentials = self.solver.electrode_matrix().potentials_ohm() * resistivity;
        self.matrix = ElectrodeMatrix::from_potentials(potentials);
        Ok(&self.matrix)
    }
}

/// Whether any conductivity is another.
fn changed(before: &[Tensor], after: &[Tensor]) -> bool {
    before.iter().zip(after).any(|(a, b)| {
        let size = UNCHANGED * a[0].min(a[2]);
        a.iter().zip(b).any(|(a, b)| (a - b).abs() > size)
    })
}
