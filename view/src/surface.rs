//! Where the cells, the rim and the electrodes are: what all pictures of a sheet share.

use crate::fitted;
use crate::picture::{Grid, Picture, PictureError, Stats};
use inverse::pipeline::FrameResult;
use inverse::reference::imager::Imager;
use std::sync::Arc;

/// Where the cells, the rim and the electrodes are, for a viewer.
#[derive(Clone, Debug)]
pub struct Surface {
    grid: Arc<Grid>,
    outline_mm: Arc<Vec<[f64; 2]>>,
    electrodes_mm: Arc<Vec<[f64; 2]>>,
}

impl Surface {
    /// That of an imager's sheet.
    ///
    /// # Errors
    /// [`PictureError`] when the cells are too many to show.
    pub fn of(imager: &Imager) -> Result<Self, PictureError> {
        Ok(Self {
            grid: grid_of(imager)?,
            outline_mm: Arc::new(imager.outline_mm.clone()),
            electrodes_mm: Arc::new(imager.electrodes_mm.clone()),
        })
    }

    /// Whether the reconstruction itself is drawn of a result, and not its fitted touches.
    pub fn is_smoothed(result: &FrameResult) -> bool {
        // What is doubted and has no touch would not be seen at all.
        let fitted = result.misfit.is_some() && (result.doubt.is_none() || !result.touches.is_empty());
        result.changed && !fitted
    }

    /// The picture of a result: its fitted touches where these explain the frame, so that colours and labels say the same; else the
    /// reconstruction, which [`Stats::smoothed`] says.
    pub fn picture(&self, result: &FrameResult, sequence: u64, time_s: f64, mut stats: Stats) -> Picture {
        stats.smoothed = Self::is_smoothed(result);
        let values = if stats.smoothed {
            result.x.iter().map(|x| x.abs() as f32).collect()
        } else {
            fitted::values(&self.grid, &result.touches)
        };
        Picture {
            sequence,
            time_s,
            grid: Arc::clone(&self.grid),
            outline_mm: Arc::clone(&self.outline_mm),
            electrodes_mm: Arc::clone(&self.electrodes_mm),
            values,
            touches: result.touches.clone(),
            stats,
        }
    }
}

/// The cells of an imager as a viewer wants them.
///
/// # Errors
/// [`PictureError`] when they are too many to show.
pub fn grid_of(imager: &Imager) -> Result<Arc<Grid>, PictureError> {
    let (columns, rows) = imager.grid.shape();
    let [left, bottom] = imager.grid.low_mm();
    // More columns than fit 16 bits are refused by the grid itself.
    let cells = imager
        .grid
        .cells()
        .iter()
        .map(|[c, r]| (*c as u16, *r as u16))
        .collect();
    Grid::new(columns, rows, imager.grid.cell_mm(), left, bottom, cells).map(Arc::new)
}
