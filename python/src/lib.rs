//! The extension module `skin._skin` of the Python package: boards, recordings and other people's frames as Python objects and
//! NumPy arrays. What a user reads of it is in `skin/_skin.pyi` and docs/python.md.
//!
//! Whatever takes long runs without the interpreter's lock. A [`stream::Skin`] may be asked by several threads; after a fork it
//! says so instead of waiting for a thread that is not there.

mod arrays;
mod error;
mod frame;
mod presses;
mod reconstruct;
mod recording;
mod sheet;
mod stream;
mod touch;

use pyo3::prelude::*;

/// The program `skin` with a command line, its own name first; its exit code.
#[pyfunction]
fn program(py: Python<'_>, arguments: Vec<std::ffi::OsString>) -> u8 {
    py.detach(|| host::run(arguments))
}

/// Touches of a tactile skin read by electrical impedance tomography.
#[pymodule(name = "_skin")]
mod module {
    #[pymodule_export]
    use crate::error::{SkinError, SkinWarning};
    #[pymodule_export]
    use crate::frame::Frame;
    #[pymodule_export]
    use crate::presses::{Press, PressCalibration, Presses, calibrate_presses};
    #[pymodule_export]
    use crate::program;
    #[pymodule_export]
    use crate::reconstruct::{Reconstructor, reconstruct};
    #[pymodule_export]
    use crate::recording::{Recording, load};
    #[pymodule_export]
    use crate::sheet::{Sheet, forward};
    #[pymodule_export]
    use crate::stream::{Skin, open};
    #[pymodule_export]
    use crate::touch::Touch;
}
