//! What went wrong, as a Python exception with the program's own words.

use pyo3::PyErr;

mod classes {
    #![allow(missing_docs)]
    pyo3::create_exception!(
        skin,
        SkinError,
        pyo3::exceptions::PyException,
        "What went wrong, and what to do about it, in the program's own words."
    );
    pyo3::create_exception!(
        skin,
        SkinWarning,
        pyo3::exceptions::PyUserWarning,
        "What there is to say beside the frames: of the baseline, of the line to the board."
    );
}

pub(crate) use classes::{SkinError, SkinWarning};

/// An error with its causes.
pub(crate) fn raised(error: impl Into<anyhow::Error>) -> PyErr {
    said(format!("{:#}", error.into()))
}

/// An error in these words.
pub(crate) fn said(text: impl Into<String>) -> PyErr {
    SkinError::new_err(text.into())
}
