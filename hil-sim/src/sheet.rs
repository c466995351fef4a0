//! What the electronics need to know of a sheet.

use forward::{ElectrodeMatrix, ForwardError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A sheet whose resistances may change with time.
pub trait SheetModel: Send {
    /// What the electrodes see at `t_s` seconds after power-up. Times never go back.
    ///
    /// # Errors
    /// The sheet's equations cannot be solved for what is pressed on it.
    fn electrode_matrix(&mut self, t_s: f64) -> Result<&ElectrodeMatrix, ForwardError>;
}

impl<S: SheetModel + ?Sized> SheetModel for Box<S> {
    fn electrode_matrix(&mut self, t_s: f64) -> Result<&ElectrodeMatrix, ForwardError> {
        S::electrode_matrix(self, t_s)
    }
}

/// A sheet that never changes.
#[derive(Clone, Debug)]
pub struct FixedSheet(pub ElectrodeMatrix);

impl FixedSheet {
    /// A ring of equal resistors (ohm) between neighbouring electrodes, in the place of a sheet.
    pub fn ring(electrodes: usize, ohm: f64) -> Self {
        Self(ElectrodeMatrix::ring(electrodes, ohm))
    }
}

impl SheetModel for FixedSheet {
    fn electrode_matrix(&mut self, _t_s: f64) -> Result<&ElectrodeMatrix, ForwardError> {
        Ok(&self.0)
    }
}

/// A sheet that outlives the board that measures it.
#[derive(Debug)]
pub(crate) struct Shared<S> {
    sheet: Arc<Mutex<S>>,
    matrix: Option<ElectrodeMatrix>,
}

impl<S> Shared<S> {
    pub(crate) fn new(sheet: S) -> Self {
        Self {
            sheet: Arc::new(Mutex::new(sheet)),
            matrix: None,
        }
    }

    /// The sheet; whoever holds it keeps the board from looking at it.
    pub(crate) fn lock(&self) -> MutexGuard<'_, S> {
        self.sheet.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<S> Clone for Shared<S> {
    fn clone(&self) -> Self {
        Self {
            sheet: Arc::clone(&self.sheet),
            matrix: None,
        }
    }
}

impl<S: SheetModel> SheetModel for Shared<S> {
    fn electrode_matrix(&mut self, t_s: f64) -> Result<&ElectrodeMatrix, ForwardError> {
        let mut sheet = self.sheet.lock().unwrap_or_else(PoisonError::into_inner);
        let seen = sheet.electrode_matrix(t_s)?;
        Ok(match &mut self.matrix {
            Some(matrix) => {
                if *matrix != *seen {
                    matrix.clone_from(seen);
                }
                matrix
            }
            none => none.insert(seen.clone()),
        })
    }
}
