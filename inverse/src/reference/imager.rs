//! The model side of a picture: what the unpressed sheet gives, how it answers to every cell, and the normalised
//! difference that connects a measured frame to both.

use crate::reference::difference::Difference;
use crate::reference::told_sheet::ToldSheet;
use crate::solvers::Method;
use forward::{
    CellError, CellGrid, Drive, ForwardError, Geometry, Model, ModelOptions, Pattern, Sensitivity, Sheet, Solver,
};
use nalgebra::DMatrix;
use std::sync::Arc;
use thiserror::Error;

/// Why no imager could be made.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ImagerError {
    /// The sheet or its model.
    #[error(transparent)]
    Forward(#[from] ForwardError),
    /// The cells.
    #[error(transparent)]
    Cells(#[from] CellError),
    /// Pattern and sheet do not belong together.
    #[error(
        "the measurements are of {pattern} electrodes, but the sheet has {sheet}; describe the sheet that was measured"
    )]
    Electrodes {
        /// Of the pattern.
        pattern: usize,
        /// Of the sheet.
        sheet: usize,
    },
    /// Cells times values: more numbers than memory should hold.
    #[error(
        "{cells} cells and {values} values would make a sensitivity of {} numbers, more than {MOST_ENTRIES}; take larger cells \
         (here {needed_mm:.2} mm or more), or a pattern of fewer values",
        cells.saturating_mul(*values)
    )]
    TooLarge {
        /// Cells of the picture.
        cells: usize,
        /// Values of a frame, or pairs of electrodes where those are more.
        values: usize,
        /// Side of cells that are few enough, mm.
        needed_mm: f64,
    },
    /// More values than the tables of responses should hold.
    #[error(
        "a frame has {0} values, more than {MOST_VALUES}; use a pattern of fewer, or a table without those drive pairs that \
         others repeat"
    )]
    TooManyValues(usize),
    /// A frame or a baseline that does not belong to the pattern.
    #[error("{given} values were given for {expected} measurements; give a value for each, in the pattern's order")]
    Baseline {
        /// Values given.
        given: usize,
        /// Values expected.
        expected: usize,
    },
}

/// Most numbers of a sensitivity. Its factors and copies take about 150 bytes for each: together less than 1 GB.
pub(crate) const MOST_ENTRIES: usize = 6_000_000;

/// Most values of a frame: those of 64 electrodes in the adjacent pattern, and some. The cells that the responses to touches are summed
/// up from are 52,000 bytes for each.
const MOST_VALUES: usize = 4096;

/// Most values of a frame in which rare things are looked for: what is broken, and what drifts seldom. 32 electrodes in the adjacent pattern
/// have 928. Of more every search takes seconds.
pub(crate) const MOST_SEARCHED: usize = 2048;

/// Refuses a picture whose sensitivity memory should not hold.
fn check_size(grid: &CellGrid, pattern: &Pattern) -> Result<(), ImagerError> {
    if pattern.len() > MOST_VALUES {
        return Err(ImagerError::TooManyValues(pattern.len()));
    }
    let (cells, n) = (grid.len(), pattern.electrodes());
    // The gradients of all electrodes are multiplied with one another first.
    let values = pattern.len().max(n * n);
    if cells.saturating_mul(values) <= MOST_ENTRIES {
        return Ok(());
    }
    let allowed = (MOST_ENTRIES / values).max(1);
    Err(ImagerError::TooLarge {
        cells,
        values,
        needed_mm: grid.cell_mm() * (cells as f64 / allowed as f64).sqrt(),
    })
}

/// The unpressed sheet as the model sees it, and its sensitivity. Immutable.
#[derive(Clone, Debug)]
pub struct Imager {
    /// The sheet made ready to solve.
    pub model: Arc<Model>,
    /// The measurements, in the order of all vectors.
    pub pattern: Pattern,
    /// The drive.
    pub drive: Drive,
    /// The cells of the picture.
    pub grid: CellGrid,
    /// Voltages of the unpressed sheet, V.
    pub model_v: Vec<f64>,
    /// Change of every voltage (V) for a unit relative rise of every cell.
    pub sensitivity: DMatrix<f64>,
    /// Rim of the sheet, mm.
    pub outline_mm: Vec<[f64; 2]>,
    /// Centres of the electrodes, mm.
    pub electrodes_mm: Vec<[f64; 2]>,
    /// Covariance of what is uncertain of the electrodes: the logarithms of their contact impedances, then their places
    /// along the rim (mm). None where they are taken as certain.
    pub electrode_covariance: Option<DMatrix<f64>>,
    /// What presses told of the sheet: it takes the place of what the electrodes' uncertainty says. Of an imager whose electrodes are not
    /// looked for it is of no effect. None where no presses told anything.
    pub told: Option<Arc<ToldSheet>>,
}

/// Places that are compared with all others; the cosine of the angle between the changes at two that are alike, but for the mesh; and how far
/// apart these are, over the sheet's reach.
const AMBIGUOUS_LOOKED_AT: usize = 64;
const AMBIGUOUS: f64 = 0.9999;
const AMBIGUOUS_PART: f64 = 0.4;

impl Imager {
    /// Models a sheet.
    ///
    /// # Errors
    /// [`ImagerError`] names what does not fit.
    pub fn new(sheet: &Sheet, drive: Drive, pattern: Pattern, cell_mm: f64) -> Result<Self, ImagerError> {
        if pattern.electrodes() != sheet.electrodes.len() {
            return Err(ImagerError::Electrodes {
                pattern: pattern.electrodes(),
                sheet: sheet.electrodes.len(),
            });
        }
        let grid = CellGrid::new(&Geometry::new(sheet).map_err(ForwardError::from)?, cell_mm)?;
        check_size(&grid, &pattern)?;
        let model = Arc::new(Model::new(sheet, &ModelOptions::default())?);
        let solver = Solver::new(model.clone())?;
        let matrix = solver.electrode_matrix();
        let sensitivity = Sensitivity::by_cell(&solver, &grid).matrix_v(drive, matrix, &pattern);
        Ok(Self {
            model_v: drive.frame_v(matrix, &pattern),
            sensitivity,
            outline_mm: model.geometry().outline().polyline().to_vec(),
            electrodes_mm: model.geometry().electrode_centres(),
            model,
            pattern,
            drive,
            grid,
            electrode_covariance: None,
            told: None,
        })
    }

    /// What a rise over so many mm² changes where the sheet tells little, V (2-norm of the values times their `weights`): in one cell of
    /// twenty it is less.
    pub(crate) fn least_change_v(&self, weights: &[f64], total_mm2: f64) -> f64 {
        let of_cell = |cell: nalgebra::DVectorView<'_, f64>| {
            let squares = cell.iter().zip(weights).map(|(v, weight)| (weight * v).powi(2));
            squares.sum::<f64>().sqrt()
        };
        let mut all: Vec<f64> = self.sensitivity.column_iter().map(of_cell).collect();
        all.sort_by(f64::total_cmp);
        let least = all.get(all.len() / 20).copied().unwrap_or(0.0);
        total_mm2 / self.grid.cell_mm().powi(2) * least
    }

    /// Whether frames are searched for what is broken, and for what drifts seldom: not where they have more than 2,048 values.
    pub fn is_searched(&self) -> bool {
        self.pattern.len() <= MOST_SEARCHED
    }

    /// How far the sheet reaches from the origin, mm.
    pub fn reach_mm(&self) -> f64 {
        self.outline_mm.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max)
    }

    /// Models a sheet as a method wants it: for the paper's, [`Method::LawsonHanson`], the sensitivity is that of a constant
    /// current (the paper's eq. 3), which leaves out that a voltage source gives a touched sheet less current. With what it
    /// leaves out there are x > 0 with S x = 0, and without a ridge positivity constrains nothing.
    ///
    /// # Errors
    /// See [`Imager::new`].
    pub fn for_method(
        method: Method,
        sheet: &Sheet,
        drive: Drive,
        pattern: Pattern,
        cell_mm: f64,
    ) -> Result<Self, ImagerError> {
        if method != Method::LawsonHanson {
            return Self::new(sheet, drive, pattern, cell_mm);
        }
        let constant = Self::new(sheet, Drive::Current { amplitude_a: 1.0 }, pattern.clone(), cell_mm)?;
        let mut imager = Self::new(sheet, drive, pattern, cell_mm)?;
        imager.sensitivity = constant.sensitivity;
        let volts = imager.model_v.iter().zip(&constant.model_v);
        for (mut row, (v, constant)) in imager.sensitivity.row_iter_mut().zip(volts) {
            row *= v / constant;
        }
        Ok(imager)
    }

    /// The normalised difference of a frame (any unit) to its baseline (the same unit).
    ///
    /// Values that are not finite, in either, and values whose baseline is too small to divide by are left out.
    ///
    /// # Errors
    /// [`ImagerError::Baseline`] when the lengths do not match the pattern.
    pub fn difference(&self, baseline: &[f64], frame: &[f64]) -> Result<Difference, ImagerError> {
        self.fits(baseline, frame)?;
        Ok(Difference::new(&self.model_v, baseline, frame))
    }

    /// Whether a baseline and a frame have a value for every measurement.
    pub(crate) fn fits(&self, baseline: &[f64], frame: &[f64]) -> Result<(), ImagerError> {
        match [baseline.len(), frame.len()]
            .into_iter()
            .find(|n| *n != self.pattern.len())
        {
            Some(given) => Err(ImagerError::Baseline {
                given,
                expected: self.pattern.len(),
            }),
            None => Ok(()),
        }
    }

    /// Volts of the model for one volt of a baseline: the median over its values.
    pub fn gain(&self, baseline: &[f64]) -> f64 {
        let mut gains: Vec<f64> = self
            .model_v
            .iter()
            .zip(baseline)
            .map(|(m, b)| (m / b).abs())
            .filter(|g| g.is_finite())
            .collect();
        gains.sort_by(f64::total_cmp);
        gains.get(gains.len() / 2).copied().unwrap_or(1.0)
    }

    /// Correlation of a baseline with the unpressed model over the values in use: above 0.95 when electrode order, sense
    /// of turn and sign are right.
    pub fn correlation(&self, baseline: &[f64]) -> f64 {
        let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
        for (a, b) in baseline.iter().zip(&self.model_v) {
            if a.is_finite() {
                ab += a * b;
                aa += a * a;
                bb += b * b;
            }
        }
        if aa > 0.0 && bb > 0.0 {
            ab / (aa * bb).sqrt()
        } else {
            0.0
        }
    }

    /// Whether most places have another that is further off than a touch is wide, where a touch changes all values alike: no frame tells one
    /// from the other then. With opposite electrodes that drive and sense it is the one mirrored through the middle.
    pub fn is_ambiguous(&self) -> bool {
        let used = (self.difference(&self.model_v, &self.model_v)).map_or_else(|_| Vec::new(), |d| d.used);
        let used: Vec<usize> = (0..used.len()).filter(|k| used[*k]).collect();
        let mut cells = self.sensitivity.select_rows(&used);
        cells.column_iter_mut().for_each(|mut cell| _ = cell.normalize_mut());
        let looked_at: Vec<usize> = (0..cells.ncols())
            .step_by((cells.ncols() / AMBIGUOUS_LOOKED_AT).max(1))
            .collect();
        let alike = cells.select_columns(&looked_at).tr_mul(&cells);
        let has_another = |(row, cell): (usize, &usize)| {
            let at = self.grid.centre(*cell);
            let far = |other: usize| {
                let [x, y] = self.grid.centre(other);
                (x - at[0]).hypot(y - at[1]) > AMBIGUOUS_PART * self.reach_mm()
            };
            (0..cells.ncols()).any(|other| alike[(row, other)] > AMBIGUOUS && far(other))
        };
        let ambiguous = looked_at.iter().enumerate().filter(|one| has_another(*one)).count();
        2 * ambiguous > looked_at.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where opposite electrodes drive and sense, places across the middle answer alike. With neighbours, or where one of both is another
    /// pair, none do.
    #[test]
    fn a_pattern_that_does_not_tell_places_apart_is_known() {
        let is_ambiguous = |drive_step: usize, sense_step: usize| {
            let all =
                (0..16).flat_map(|d| (0..16).map(move |s| [[d, (d + drive_step) % 16], [s, (s + sense_step) % 16]]));
            let apart = all.filter(|[d, s]| !d.iter().any(|l| s.contains(l)));
            let pattern = Pattern::from_pairs(16, apart).unwrap();
            let imager = Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 10.0).unwrap();
            imager.is_ambiguous()
        };
        assert!(is_ambiguous(8, 8));
        for (drive_step, sense_step) in [(1, 1), (8, 1), (1, 8), (2, 8), (3, 3)] {
            assert!(!is_ambiguous(drive_step, sense_step), "{drive_step} {sense_step}");
        }
    }

    #[test]
    fn a_picture_too_large_for_memory_is_refused_with_cells_that_are_not() {
        let pattern = Pattern::adjacent(16).unwrap();
        let error = Imager::new(&Sheet::paper(), Drive::PAPER, pattern.clone(), 0.5).unwrap_err();
        let ImagerError::TooLarge { values, needed_mm, .. } = error else {
            panic!("{error}");
        };
        assert_eq!(values, 256);
        let geometry = Geometry::new(&Sheet::paper()).unwrap();
        let fits = |cell_mm| check_size(&CellGrid::new(&geometry, cell_mm).unwrap(), &pattern).is_ok();
        // A circle has a few cells more or less than its area says.
        assert!(fits(1.01 * needed_mm) && !fits(0.99 * needed_mm));
    }

    #[test]
    fn frames_of_64_electrodes_are_taken_and_much_larger_ones_refused() {
        let coarse = CellGrid::new(&Geometry::new(&Sheet::paper()).unwrap(), 20.0).unwrap();
        let of = |electrodes| check_size(&coarse, &Pattern::adjacent(electrodes).unwrap());
        assert_eq!(of(64), Ok(()));
        assert_eq!(of(128), Err(ImagerError::TooManyValues(128 * 125)));
    }
}
