//! What the electronics need to know of a sheet.

use forward::{ElectrodeMatrix, ForwardError};

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

impl SheetModel for FixedSheet {
    fn electrode_matrix(&mut self, _t_s: f64) -> Result<&ElectrodeMatrix, ForwardError> {
        Ok(&self.0)
    }
}
