//! The forward model: from a sheet and its resistivity to what the electrodes see.

use crate::cholesky::{BLOCK, CholeskyError, Factor};
use crate::curve::Point;
use crate::field::UNPRESSED;
use crate::geometry::{Geometry, GeometryError, Sheet};
use crate::impedance::ElectrodeMatrix;
use crate::mesh::{Mesh, MeshError, MeshSizes, Order};
use crate::system::{System, Tensor};
use nalgebra::DMatrix;
use std::sync::Arc;
use thiserror::Error;

/// What can go wrong on the way from a sheet to its voltages.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ForwardError {
    /// The sheet makes no sense.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// No mesh could be made of it.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The equations could not be solved.
    #[error(transparent)]
    Cholesky(#[from] CholeskyError),
    /// An accuracy that is no accuracy.
    #[error("the accuracy is {value}; give a relative error between 1e-5 and 0.1")]
    Accuracy {
        /// What was given.
        value: f64,
    },
    /// A conductivity that is not positive, or too many or too few of them.
    #[error(
        "the conductivity of element {element} is not positive and finite; a relative rise must be greater than -1"
    )]
    Conductivity {
        /// Which element.
        element: usize,
    },
    /// One value for every element was expected.
    #[error("{given} conductivities given for {elements} elements; give one for each")]
    Count {
        /// How many were given.
        given: usize,
        /// How many there are.
        elements: usize,
    },
    /// A curved element whose edges cross.
    #[error(
        "the mesh is tangled at element {element}; ask for more accuracy, or straighten the outline there"
    )]
    Tangled {
        /// Which element.
        element: usize,
    },
}

/// How a model is made.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelOptions {
    /// Largest relative error wanted of any voltage, 1e-5 to 0.1. Calibrated on the paper's disc; see docs/benchmarks.md.
    pub accuracy: f64,
    /// Degree of the elements.
    pub order: Order,
    /// Circles to resolve (centre, radius, edge length along them, all mm).
    pub circles: Vec<(Point, f64, f64)>,
}

impl Default for ModelOptions {
    fn default() -> Self {
        Self {
            accuracy: 1e-3,
            order: Order::Quadratic,
            circles: Vec::new(),
        }
    }
}

/// A sheet made ready: mesh, matrix pattern, elimination order. Immutable; share it between solvers.
#[derive(Debug)]
pub struct Model {
    sheet: Sheet,
    geometry: Geometry,
    mesh: Mesh,
    pub(crate) system: System,
}

impl Model {
    /// Meshes a sheet for the accuracy wanted.
    ///
    /// # Errors
    /// [`ForwardError`] names what is wrong with the sheet and says what to do.
    pub fn new(sheet: &Sheet, options: &ModelOptions) -> Result<Self, ForwardError> {
        let geometry = Geometry::new(sheet)?;
        let sizes = crate::accuracy::sizes(sheet, &geometry, options)?;
        Self::with_sizes(sheet, &sizes, options.order)
    }

    /// Meshes a sheet by lengths: for studies of convergence.
    ///
    /// # Errors
    /// As for [`Model::new`].
    pub fn with_sizes(
        sheet: &Sheet,
        sizes: &MeshSizes,
        order: Order,
    ) -> Result<Self, ForwardError> {
        let geometry = Geometry::new(sheet)?;
        let mesh = Mesh::new(&geometry, sizes, order)?;
        let contact: Vec<f64> = sheet.electrodes.iter().map(|e| e.contact_mm).collect();
        let system = System::new(&mesh, &contact)?;
        if let Some(element) = system.tangled() {
            return Err(ForwardError::Tangled { element });
        }
        Ok(Self {
            sheet: sheet.clone(),
            geometry,
            mesh,
            system,
        })
    }

    /// The sheet.
    pub fn sheet(&self) -> &Sheet {
        &self.sheet
    }

    /// The checked geometry.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// How many electrodes.
    pub fn electrodes(&self) -> usize {
        self.system.electrodes
    }
}

/// The state of a sheet under some resistivity, and its solution.
pub struct Solver {
    model: Arc<Model>,
    conductivity: Vec<Tensor>,
    values: Vec<f64>,
    factor: Factor,
    matrix: ElectrodeMatrix,
}

impl Solver {
    /// The unpressed sheet, solved.
    ///
    /// # Errors
    /// [`ForwardError::Cholesky`] when contacts or conductivities span more than double precision holds.
    pub fn new(model: Arc<Model>) -> Result<Self, ForwardError> {
        let conductivity = vec![UNPRESSED; model.mesh.triangles.len()];
        let factor = Factor::new(&model.system.symbolic)?;
        let electrodes = model.electrodes();
        let mut this = Self {
            model,
            conductivity,
            values: Vec::new(),
            factor,
            matrix: ElectrodeMatrix::from_potentials(DMatrix::zeros(electrodes, electrodes)),
        };
        this.refactor()?;
        Ok(this)
    }

    /// The model solved.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Conductivity of every element, relative to the unpressed sheet.
    pub fn conductivity(&self) -> &[Tensor] {
        &self.conductivity
    }

    /// What the electrodes see.
    pub fn electrode_matrix(&self) -> &ElectrodeMatrix {
        &self.matrix
    }

    /// Solves for other conductivities (one per element, relative to the unpressed sheet). Nothing is computed when they
    /// are the ones already solved.
    ///
    /// # Errors
    /// A count that does not match the mesh, a conductivity that is not positive definite, or a system beyond double
    /// precision. The state is then that of before.
    pub fn solve(&mut self, conductivity: &[Tensor]) -> Result<&ElectrodeMatrix, ForwardError> {
        let elements = self.conductivity.len();
        if conductivity.len() != elements {
            return Err(ForwardError::Count {
                given: conductivity.len(),
                elements,
            });
        }
        if conductivity == self.conductivity {
            return Ok(&self.matrix);
        }
        for (element, [xx, xy, yy]) in conductivity.iter().enumerate() {
            if !(*xx > 0.0 && *yy > 0.0 && xx * yy > xy * xy && xx.is_finite() && yy.is_finite()) {
                return Err(ForwardError::Conductivity { element });
            }
        }
        let before = std::mem::replace(&mut self.conductivity, conductivity.to_vec());
        if let Err(e) = self.refactor() {
            self.conductivity = before;
            self.refactor()?;
            return Err(e);
        }
        Ok(&self.matrix)
    }

    fn refactor(&mut self) -> Result<(), ForwardError> {
        let system = &self.model.system;
        system.assemble(&self.conductivity, &mut self.values);
        self.factor.factorize(&system.symbolic, &self.values)?;
        let free = system.electrodes - 1;
        let corner = self.factor.corner(&system.symbolic, free);
        let mut inverse = DMatrix::identity(free, free);
        if !corner.solve_lower_triangular_mut(&mut inverse)
            || !inverse.iter().all(|v| v.is_finite())
        {
            return Err(CholeskyError::NotPositiveDefinite {
                unknown: system.symbolic.unknowns() - 1,
            }
            .into());
        }
        // The last electrode is ground: its row and column are zero.
        let mut r = DMatrix::zeros(free + 1, free + 1);
        let product = inverse.transpose() * &inverse * self.model.sheet.sheet_resistance_ohm;
        r.view_mut((0, 0), (free, free)).copy_from(&product);
        self.matrix = ElectrodeMatrix::from_potentials(r);
        Ok(())
    }

    /// Potential of every node for 1 A into each electrode and out of the last (ground), V; `[node, electrode]`. The last
    /// column is zero.
    pub fn potentials_v(&self) -> DMatrix<f64> {
        let system = &self.model.system;
        let symbolic = &system.symbolic;
        let free = system.electrodes - 1;
        let mut out = DMatrix::zeros(system.nodes, free + 1);
        let n = symbolic.unknowns();
        let scale = self.model.sheet.sheet_resistance_ohm;
        let mut x = vec![[0.0; BLOCK]; n];
        for first in (0..free).step_by(BLOCK) {
            let count = BLOCK.min(free - first);
            x.fill([0.0; BLOCK]);
            for k in 0..count {
                x[symbolic.position(system.nodes + first + k)][k] = 1.0;
            }
            self.factor.forward_substitute(symbolic, &mut x, n - free);
            self.factor.back_substitute(symbolic, &mut x);
            for node in 0..system.nodes {
                let row = &x[symbolic.position(node)];
                for k in 0..count {
                    out[(node, first + k)] = row[k] * scale;
                }
            }
        }
        out
    }
}
