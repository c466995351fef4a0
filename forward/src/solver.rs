//! The state of a sheet under some resistivity, and its solution.

use crate::cholesky::{BLOCK, CholeskyError, Factor};
use crate::error::ForwardError;
use crate::field::{DiscTouch, UNPRESSED, conductivity_of_discs};
use crate::fit;
use crate::impedance::ElectrodeMatrix;
use crate::mesh::Mesh;
use crate::model::Model;
use crate::options::ModelOptions;
use crate::precision;
use crate::system::Tensor;
use crate::update::Update;
use nalgebra::DMatrix;
use std::sync::Arc;

/// A mesh fitted to touches, with its elements' integrals.
struct Shape {
    mesh: Mesh,
    stiffness: Vec<[f64; 3]>,
    changed: Vec<usize>,
}

/// How the last solution came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Nothing: the state asked for was the one already solved.
    Nothing,
    /// A correction to the last factorisation, of this many unknowns.
    LowRank {
        /// Unknowns whose equations differ from the factorised ones.
        unknowns: usize,
    },
    /// A new factorisation.
    Factorisation,
    /// A new mesh that follows strong touches whose edges this one could not be moved onto, made and solved.
    OwnMesh,
}

/// Contrast `|2 rise / (2 + rise)|` of a touch above which a cut element's average costs more accuracy than the model has:
/// such a touch gets a mesh of its own. Less makes more of those meshes, each at the cost of a new model; more costs accuracy.
const STRONG: f64 = 0.3;

/// The state of a sheet under some resistivity, and its solution.
pub struct Solver {
    model: Arc<Model>,
    conductivity: Vec<Tensor>,
    touches: Option<Vec<DiscTouch>>,
    shape: Option<Box<Shape>>,
    values: Vec<f64>,
    /// The values that `factor` belongs to.
    reference: Vec<f64>,
    factor: Factor,
    /// Inverse of the factor's last corner, that of the electrodes.
    corner: DMatrix<f64>,
    update: Option<Update>,
    refine: bool,
    /// Whether to round alike on every machine.
    portable: bool,
    matrix: ElectrodeMatrix,
    work: Work,
    /// The solver of a mesh made for the touches, where this one's could not be fitted to them.
    own: Option<Box<Self>>,
}

impl Solver {
    /// The unpressed sheet, solved.
    ///
    /// # Errors
    /// [`ForwardError::Cholesky`] or [`ForwardError::Precision`] when contacts or conductivities span more than double
    /// precision holds.
    pub fn new(model: Arc<Model>) -> Result<Self, ForwardError> {
        Self::rounding(model, false)
    }

    /// The same whose results are alike to the last bit on every machine, for a little more time: neither vector
    /// instructions nor a library's choice of them change what is rounded where. So are the mesh and the conductivities of
    /// [`crate::field`].
    ///
    /// # Errors
    /// As for [`Solver::new`].
    pub fn portable(model: Arc<Model>) -> Result<Self, ForwardError> {
        Self::rounding(model, true)
    }

    fn rounding(model: Arc<Model>, portable: bool) -> Result<Self, ForwardError> {
        let conductivity = vec![UNPRESSED; model.mesh().triangles.len()];
        let factor = Factor::new(&model.system.symbolic)?;
        let electrodes = model.electrodes();
        let mut this = Self {
            model,
            conductivity,
            touches: None,
            shape: None,
            values: Vec::new(),
            reference: Vec::new(),
            factor,
            corner: DMatrix::zeros(0, 0),
            update: None,
            refine: false,
            portable,
            matrix: ElectrodeMatrix::from_potentials(DMatrix::zeros(electrodes, electrodes)),
            work: Work::Factorisation,
            own: None,
        };
        this.refresh()?;
        Ok(this)
    }

    /// The model solved.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// The mesh of the state solved: the model's, or after [`Solver::solve_touches`] the one fitted to the touches (the
    /// same nodes and elements, some of them moved) or, after [`Work::OwnMesh`], another one.
    pub fn mesh(&self) -> &Mesh {
        match (&self.own, &self.shape) {
            (Some(own), _) => own.mesh(),
            (None, Some(shape)) => &shape.mesh,
            (None, None) => self.model.mesh(),
        }
    }

    /// Conductivity of every element of [`Solver::mesh`], relative to the unpressed sheet.
    pub fn conductivity(&self) -> &[Tensor] {
        self.own.as_ref().map_or(&self.conductivity, |own| &own.conductivity)
    }

    /// What the electrodes see.
    pub fn electrode_matrix(&self) -> &ElectrodeMatrix {
        self.own.as_ref().map_or(&self.matrix, |own| &own.matrix)
    }

    /// How the last solution came about.
    pub fn work(&self) -> Work {
        self.work
    }

    /// Solves for other conductivities (one per element of the model's mesh, relative to the unpressed sheet). Nothing is
    /// computed when they are the ones already solved; few changes cost less than a factorisation.
    ///
    /// # Errors
    /// A count that does not match the mesh, a conductivity that is not positive definite, or a system beyond double
    /// precision. The state is then that of before.
    pub fn solve(&mut self, conductivity: &[Tensor]) -> Result<&ElectrodeMatrix, ForwardError> {
        let elements = self.model.mesh().triangles.len();
        if conductivity.len() != elements {
            return Err(ForwardError::Count {
                given: conductivity.len(),
                elements,
            });
        }
        if self.own.is_none() && self.shape.is_none() && conductivity == self.conductivity {
            self.work = Work::Nothing;
            return Ok(&self.matrix);
        }
        check(conductivity)?;
        self.replace(conductivity.to_vec(), None, None)
    }

    /// Solves for disc touches on the unpressed sheet. Vertices near a disc's edge are moved onto it: the jump then falls
    /// between elements, while the mesh's topology and the elimination order stay. Elements still cut get the laminate's
    /// tensor. More accurate than [`Solver::solve`] with [`conductivity_of_discs`] on a mesh that does not know the touches,
    /// and hardly slower. One or two strong touches in a hundred, all at the rim, still cut elements; they get a mesh of
    /// their own, at the cost of a new model.
    ///
    /// # Errors
    /// A touch without sense, or a system beyond double precision. The state is then that of before.
    pub fn solve_touches(&mut self, touches: &[DiscTouch]) -> Result<&ElectrodeMatrix, ForwardError> {
        self.solve_discs(touches, true)
    }

    /// The same without a mesh of their own for any touches: elements that are still cut get the laminate's tensor. One
    /// solution takes about as long as any other, and is less accurate for strong touches at the rim.
    ///
    /// # Errors
    /// As for [`Solver::solve_touches`].
    pub fn solve_touches_here(&mut self, touches: &[DiscTouch]) -> Result<&ElectrodeMatrix, ForwardError> {
        self.solve_discs(touches, false)
    }

    fn solve_discs(&mut self, touches: &[DiscTouch], remesh: bool) -> Result<&ElectrodeMatrix, ForwardError> {
        if self.touches.as_deref() == Some(touches) {
            self.work = Work::Nothing;
            return Ok(self.electrode_matrix());
        }
        for (touch, t) in touches.iter().enumerate() {
            t.check(touch)?;
        }
        let model = self.model.clone();
        let mut shape = Box::new(Shape {
            mesh: model.mesh().clone(),
            stiffness: Vec::new(),
            changed: Vec::new(),
        });
        let fit = fit::fit(&mut shape.mesh, model.mesh(), model.neighbours(), touches);
        let strong = |t: &DiscTouch| (2.0 * t.rise / (2.0 + t.rise)).abs() > STRONG;
        if remesh
            && !fit.complete
            && touches.iter().any(strong)
            && let Some(options) = model.options()
        {
            let options = ModelOptions {
                touches: touches.to_vec(),
                ..options.clone()
            };
            return self.solve_on_own_mesh(touches, &options);
        }
        shape.changed = fit.changed;
        shape.stiffness = model.system.reshaped(&shape.mesh, &shape.changed);
        let conductivity = conductivity_of_discs(&shape.mesh, touches);
        check(&conductivity)?;
        self.replace(conductivity, Some(shape), Some(touches.to_vec()))
    }

    /// Solves for the untouched sheet on the mesh of the last solution, as touches moved it or made it. What touches change is
    /// best told on one mesh: against the untouched sheet on another, the meshes' own errors do not cancel.
    ///
    /// # Errors
    /// A system beyond double precision.
    pub fn solve_untouched_there(&mut self) -> Result<&ElectrodeMatrix, ForwardError> {
        self.touches = None;
        let Some(own) = &mut self.own else {
            let shape = self.shape.take();
            return self.replace(vec![UNPRESSED; self.conductivity.len()], shape, None);
        };
        let untouched = vec![UNPRESSED; own.conductivity.len()];
        own.solve(&untouched)?;
        self.work = Work::Factorisation;
        Ok(self.electrode_matrix())
    }

    /// Makes the next [`Solver::solve_touches`] or [`Solver::solve_touches_here`] depend on nothing that was solved before, to the last
    /// bit.
    pub fn forget(&mut self) {
        self.touches = None;
        self.reference.clear();
    }

    fn solve_on_own_mesh(
        &mut self,
        touches: &[DiscTouch],
        options: &ModelOptions,
    ) -> Result<&ElectrodeMatrix, ForwardError> {
        let model = Model::new(self.model.sheet(), options)?;
        let conductivity = conductivity_of_discs(model.mesh(), touches);
        let mut own = Self::rounding(Arc::new(model), self.portable)?;
        own.solve(&conductivity)?;
        self.touches = Some(touches.to_vec());
        self.work = Work::OwnMesh;
        Ok(&self.own.insert(Box::new(own)).matrix)
    }

    fn replace(
        &mut self,
        conductivity: Vec<Tensor>,
        shape: Option<Box<Shape>>,
        touches: Option<Vec<DiscTouch>>,
    ) -> Result<&ElectrodeMatrix, ForwardError> {
        let before = std::mem::replace(&mut self.conductivity, conductivity);
        let shape = std::mem::replace(&mut self.shape, shape);
        let touches = std::mem::replace(&mut self.touches, touches);
        if let Err(e) = self.refresh() {
            (self.conductivity, self.shape, self.touches) = (before, shape, touches);
            self.reference.clear();
            self.refresh()?;
            return Err(e);
        }
        self.own = None;
        Ok(&self.matrix)
    }

    fn refresh(&mut self) -> Result<(), ForwardError> {
        let model = self.model.clone();
        let system = &model.system;
        let stiffness = self.shape.as_ref().map_or(&*system.stiffness, |s| &s.stiffness);
        system.assemble(&self.conductivity, stiffness, &mut self.values);
        let symbolic = &system.symbolic;
        let span = precision::span(symbolic, &self.values);
        if span < precision::TRUSTED && !self.refine && !self.portable {
            let update = Update::new(symbolic, &self.factor, &self.corner, &self.reference, &self.values);
            if let Some((update, inverse)) = update {
                self.work = Work::LowRank {
                    unknowns: update.unknowns(),
                };
                self.update = Some(update);
                self.matrix = self.grounded(inverse);
                return Ok(());
            }
        }
        self.update = None;
        self.reference.clear();
        if self.portable {
            self.factor.factorize_portably(symbolic, &self.values)?;
        } else {
            self.factor.factorize(symbolic, &self.values)?;
        }
        let free = system.electrodes - 1;
        let mut inverse = DMatrix::identity(free, free);
        let corner = self.factor.corner(symbolic, free);
        if !corner.solve_lower_triangular_mut(&mut inverse) || !inverse.iter().all(|v| v.is_finite()) {
            let unknown = symbolic.unknowns() - 1;
            return Err(CholeskyError::NotPositiveDefinite { unknown }.into());
        }
        self.reference.clone_from(&self.values);
        self.work = Work::Factorisation;
        self.refine = span >= precision::TRUSTED;
        let product = if self.refine {
            precision::refined(system, &self.factor, &self.values)?
        } else {
            square(&inverse)
        };
        self.corner = inverse;
        self.matrix = self.grounded(product);
        Ok(())
    }

    /// The last electrode is ground: its row and column are zero.
    fn grounded(&self, inverse: DMatrix<f64>) -> ElectrodeMatrix {
        let free = inverse.nrows();
        let mut r = DMatrix::zeros(free + 1, free + 1);
        r.view_mut((0, 0), (free, free))
            .copy_from(&(inverse * self.model.sheet().sheet_resistance_ohm));
        ElectrodeMatrix::from_potentials(r)
    }

    /// Potential of every node of [`Solver::mesh`] for 1 A into each electrode and out of the last (ground), V; `[node, electrode]`. The last
    /// column is zero.
    pub fn potentials_v(&self) -> DMatrix<f64> {
        if let Some(own) = &self.own {
            return own.potentials_v();
        }
        let system = &self.model.system;
        let symbolic = &system.symbolic;
        let free = system.electrodes - 1;
        let mut out = DMatrix::zeros(system.nodes, free + 1);
        let n = symbolic.unknowns();
        let scale = self.model.sheet().sheet_resistance_ohm;
        let mut keep = |first: usize, count: usize, x: &[[f64; BLOCK]]| {
            for node in 0..system.nodes {
                let row = &x[symbolic.position(node)];
                for k in 0..count {
                    out[(node, first + k)] = row[k] * scale;
                }
            }
        };
        if self.refine {
            precision::columns(system, &self.factor, &self.values, |first, count, x, _| {
                keep(first, count, x);
            });
            return out;
        }
        let mut x = vec![[0.0; BLOCK]; n];
        for first in (0..free).step_by(BLOCK) {
            let count = BLOCK.min(free - first);
            x.fill([0.0; BLOCK]);
            for k in 0..count {
                x[symbolic.position(system.nodes + first + k)][k] = 1.0;
            }
            let start = match &self.update {
                Some(update) => {
                    update.load(&mut x, first, count);
                    0
                }
                None => n - free,
            };
            self.factor.forward_substitute(symbolic, &mut x, start);
            self.factor.back_substitute(symbolic, &mut x);
            keep(first, count, &x);
        }
        out
    }
}

/// `A^T A`, in an order of its own.
fn square(a: &DMatrix<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(a.ncols(), a.ncols(), |i, j| {
        let mut sum = 0.0;
        for (x, y) in a.column(i).iter().zip(a.column(j).iter()) {
            sum += x * y;
        }
        sum
    })
}

fn check(conductivity: &[Tensor]) -> Result<(), ForwardError> {
    for (element, [xx, xy, yy]) in conductivity.iter().enumerate() {
        if !(*xx > 0.0 && *yy > 0.0 && xy.abs() < xx.sqrt() * yy.sqrt() && xx.is_finite() && yy.is_finite()) {
            return Err(ForwardError::Conductivity { element });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Drive, ModelOptions, Pattern, Sheet};

    #[test]
    fn a_homogeneous_disc_is_positive_and_reciprocal() {
        let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap());
        let solver = Solver::new(model).unwrap();
        let pattern = Pattern::adjacent(16).unwrap();
        let z = solver.electrode_matrix();
        for (k, (m, other)) in pattern
            .measurements()
            .iter()
            .zip(pattern.reciprocal_indices())
            .enumerate()
        {
            let n = pattern.measurements()[other.unwrap()];
            let (a, b) = (z.transfer_ohm(m.drive, m.sense), z.transfer_ohm(n.drive, n.sense));
            assert!(a > 0.0, "{k}: {a}");
            assert!((a / b - 1.0).abs() < 1e-10, "{k}: {a} {b}");
        }
        assert!(Drive::PAPER.frame_v(z, &pattern).iter().all(|v| *v > 0.0));
    }
}
