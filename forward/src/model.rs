//! The forward model: from a sheet and its resistivity to what the electrodes see.

use crate::error::ForwardError;
use crate::fit::Neighbours;
use crate::geometry::{Geometry, Sheet};
use crate::mesh::{Mesh, MeshSizes, Order};
use crate::options::ModelOptions;
use crate::system::System;
use std::sync::{Arc, OnceLock};

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

    /// The same sheet on the same mesh with other contact impedances (mm of sheet), one for each electrode. A difference
    /// between the two models' voltages comes from the contacts alone.
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
