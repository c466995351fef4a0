//! The methods by which a picture can be computed.

use forward::{Geometry, GeometryError, Sheet};
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// The method by which the picture is computed. Every parameter follows from the noise of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Method {
    /// Non-negative least squares with a ridge, by semismooth Newton steps in measurement space. The ridge is the noise
    /// over the rise that a cell is expected to take.
    Nnls,
    /// Plain non-negative least squares by the active set method of Lawson and Hanson (1974): the paper's method, on
    /// its elements of 20 mm and with the sensitivity of a constant current. No parameter.
    LawsonHanson,
    /// Ridge regression without a sign. The ridge makes the residual the noise (Morozov's discrepancy principle), and
    /// is no less than the noise over the expected rise.
    Tikhonov,
    /// The plain generalised inverse: the paper's example of a method that fails. No parameter.
    PseudoInverse,
}

/// A name that no method has.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("there is no method '{given}'; choose nnls, lawson-hanson, tikhonov or pseudo-inverse")]
pub struct UnknownMethod {
    /// The name given.
    pub given: String,
}

impl Method {
    /// All methods.
    pub const ALL: [Self; 4] = [Self::Nnls, Self::LawsonHanson, Self::Tikhonov, Self::PseudoInverse];

    /// The name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nnls => "nnls",
            Self::LawsonHanson => "lawson-hanson",
            Self::Tikhonov => "tikhonov",
            Self::PseudoInverse => "pseudo-inverse",
        }
    }

    /// A description of one line.
    pub const fn about(self) -> &'static str {
        match self {
            Self::Nnls => "non-negative least squares with a ridge chosen from the noise",
            Self::LawsonHanson => {
                "plain non-negative least squares by Lawson's and Hanson's active set, on 20 mm cells"
            }
            Self::Tikhonov => "ridge regression without a sign, the ridge by the discrepancy principle",
            Self::PseudoInverse => "the plain generalised inverse: shows why the others are needed",
        }
    }

    /// Side of the method's cells on a sheet as large as the paper's, mm.
    pub const fn cell_mm(self) -> f64 {
        match self {
            Self::LawsonHanson => 20.0,
            _ => 5.0,
        }
    }

    /// Side of the method's cells on a sheet, mm: of those of 5 mm on the paper's disc 39 across.
    ///
    /// # Errors
    /// A sheet that makes no sense.
    pub fn cell_mm_on(self, sheet: &Sheet) -> Result<f64, GeometryError> {
        let (low, high) = Geometry::new(sheet)?.bounding_box();
        Ok((high[0] - low[0]).min(high[1] - low[1]) / 39.0 * self.cell_mm() / Self::Nnls.cell_mm())
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Method {
    type Err = UnknownMethod;

    fn from_str(name: &str) -> Result<Self, UnknownMethod> {
        let found = Self::ALL.into_iter().find(|m| m.name() == name);
        found.ok_or_else(|| UnknownMethod { given: name.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back_and_others_are_refused_with_a_list() {
        for method in Method::ALL {
            assert_eq!(method.to_string().parse(), Ok(method));
        }
        let error = "NNLS".parse::<Method>().unwrap_err().to_string();
        assert!(Method::ALL.iter().all(|m| error.contains(m.name())), "{error}");
    }
}
