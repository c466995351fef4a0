//! What can go wrong in the forward model.

use crate::cholesky::CholeskyError;
use crate::geometry::GeometryError;
use crate::mesh::MeshError;
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
