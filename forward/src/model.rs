//! The forward model: from a sheet and its resistivity to what the electrodes see.

use crate::cholesky::CholeskyError;
use crate::curve::Point;
use crate::field::DiscTouch;
use crate::fit::Neighbours;
use crate::geometry::{Geometry, GeometryError, Sheet};
use crate::mesh::{Mesh, MeshError, MeshSizes, Order};
use crate::system::System;
use std::sync::{Arc, OnceLock};
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
    /// A touch without a place, a size or a possible rise.
    #[error("touch {touch} needs a finite centre, a radius greater than 0 and a relative rise greater than -1")]
    Touch {
        /// Which touch, from 0.
        touch: usize,
    },
    /// Numbers too far apart for double precision.
    #[error(
        "conductivities or contacts span so much that double precision leaves an error of {relative:.1e} in some \
         voltage; bring the largest and the smallest nearer to each other"
    )]
    Precision {
        /// Relative error left in the worst voltage.
        relative: f64,
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
    /// One contact impedance for every electrode was expected.
    #[error("{given} contact impedances given for {electrodes} electrodes; give one for each")]
    Contacts {
        /// How many were given.
        given: usize,
        /// How many there are.
        electrodes: usize,
    },
    /// A curved element whose edges cross.
    #[error("the mesh is tangled at element {element}; ask for more accuracy, or straighten the outline there")]
    Tangled {
        /// Which element.
        element: usize,
    },
}

/// How a model is made.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelOptions {
    /// Largest relative error wanted of any voltage, 1e-5 to 0.1. Calibrated on the paper's disc; see docs/forward.md.
    pub accuracy: f64,
    /// Degree of the elements.
    pub order: Order,
    /// Circles to resolve (centre, radius, edge length along them, all mm).
    pub circles: Vec<(Point, f64, f64)>,
    /// Touches whose edges the mesh follows, so that their jump costs no accuracy; see [`ModelOptions::for_touches`].
    pub touches: Vec<DiscTouch>,
}

impl ModelOptions {
    /// The default accuracy for these touches, however strong: the mesh follows the edge of every disc that keeps clear of
    /// the rim and of the others, and is fine along the edges of those that do not.
    pub fn for_touches(touches: &[DiscTouch]) -> Self {
        Self {
            touches: touches.to_vec(),
            ..Self::default()
        }
    }
}

impl Default for ModelOptions {
    fn default() -> Self {
        Self {
            accuracy: 1e-3,
            order: Order::Quadratic,
            circles: Vec::new(),
            touches: Vec::new(),
        }
    }
}

/// A sheet made ready: mesh, matrix pattern, elimination order. Immutable; share it between solvers.
#[derive(Debug)]
pub struct Model {
    sheet: Sheet,
    geometry: Geometry,
    mesh: Arc<Mesh>,
    pub(crate) system: System,
    neighbours: OnceLock<Neighbours>,
    /// None where the mesh was asked for by lengths.
    options: Option<ModelOptions>,
}

impl Model {
    /// Meshes a sheet for the accuracy wanted.
    ///
    /// # Errors
    /// [`ForwardError`] names what is wrong with the sheet and says what to do.
    pub fn new(sheet: &Sheet, options: &ModelOptions) -> Result<Self, ForwardError> {
        Ok(Self {
            options: Some(options.clone()),
            ..Self::with_sizes(sheet, &Self::sizes(sheet, options)?, options.order)?
        })
    }

    /// The lengths that [`Model::new`] chooses.
    ///
    /// # Errors
    /// A sheet that makes no sense, or an accuracy that is none.
    pub fn sizes(sheet: &Sheet, options: &ModelOptions) -> Result<MeshSizes, ForwardError> {
        let contact: Vec<f64> = sheet.electrodes.iter().map(|e| e.contact_mm).collect();
        crate::accuracy::sizes(&Geometry::new(sheet)?, &contact, options)
    }

    /// Meshes a sheet by lengths: for studies of convergence.
    ///
    /// # Errors
    /// As for [`Model::new`].
    pub fn with_sizes(sheet: &Sheet, sizes: &MeshSizes, order: Order) -> Result<Self, ForwardError> {
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
            mesh: Arc::new(mesh),
            system,
            neighbours: OnceLock::new(),
            options: None,
        })
    }

    /// The same sheet on the same mesh with other contact impedances (mm of sheet), one for each electrode: what changes
    /// between the two is the contacts' doing alone.
    ///
    /// # Errors
    /// A contact impedance that is none, or too many or too few.
    pub fn with_contacts(&self, contact_mm: &[f64]) -> Result<Self, ForwardError> {
        let mut sheet = self.sheet.clone();
        let given = contact_mm.len();
        if given != sheet.electrodes.len() {
            let electrodes = sheet.electrodes.len();
            return Err(ForwardError::Contacts { given, electrodes });
        }
        for (electrode, contact) in sheet.electrodes.iter_mut().zip(contact_mm) {
            electrode.contact_mm = *contact;
        }
        Ok(Self {
            geometry: Geometry::new(&sheet)?,
            sheet,
            mesh: Arc::clone(&self.mesh),
            system: self.system.with_contacts(&self.mesh, contact_mm),
            neighbours: OnceLock::new(),
            options: self.options.clone(),
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

    /// What the model was made for; none when it was meshed by lengths.
    pub fn options(&self) -> Option<&ModelOptions> {
        self.options.as_ref()
    }

    pub(crate) fn neighbours(&self) -> &Neighbours {
        self.neighbours.get_or_init(|| Neighbours::new(&self.mesh))
    }

    /// How many electrodes.
    pub fn electrodes(&self) -> usize {
        self.system.electrodes
    }
}
