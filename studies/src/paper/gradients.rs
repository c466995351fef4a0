//! Sensitivity of pairs of electrodes (the paper's Fig. 4): the product of the potential gradients of a drive and a
//! sense pair.

use crate::paper::PaperError;
use crate::paper::map::Map;
use forward::{CellGrid, Geometry, Model, ModelOptions, Pair, Sensitivity, Sheet, Solver};
use serde::Serialize;
use std::sync::Arc;
use view::palette;

/// Sense pairs drawn against the drive pair of the first two electrodes.
const SENSES: [usize; 6] = [2, 4, 6, 8, 11, 13];
/// Cells of the picture, mm.
const CELL_MM: f64 = 1.5;

/// One pair of pairs.
#[derive(Clone, Debug, Serialize)]
pub struct Gradient {
    /// First electrode of the sense pair, counted from 1; the drive pair is 1-2.
    pub sense: usize,
    /// Largest product over the sheet: change of the transfer resistance for a relative rise of 1 over 1 mm², ohm/mm².
    pub largest_ohm_per_mm2: f64,
    /// Part of the sheet where a rise of the resistivity lowers the voltage.
    pub negative_part: f64,
    /// Sum over the sheet, ohm: by theory the transfer resistance, less the part of the contacts.
    pub sum_ohm: f64,
    /// The transfer resistance, ohm.
    pub transfer_ohm: f64,
    /// The picture.
    #[serde(skip)]
    pub map: Map,
}

pub(super) fn run() -> Result<Vec<Gradient>, PaperError> {
    let sheet = Sheet::paper();
    let geometry = Geometry::new(&sheet)?;
    let solver = Solver::new(Arc::new(Model::new(&sheet, &ModelOptions::default())?))?;
    let grid = CellGrid::new(&geometry, CELL_MM)?;
    let sensitivity = Sensitivity::by_cell(&solver, &grid);
    let electrodes = geometry.electrode_centres();
    let outline = geometry.outline().polyline().to_vec();
    let pair = |k: usize| Pair::new(k, (k + 1) % electrodes.len());
    let colours = palette::Palette::Diverging.table();
    let low = grid.low_mm();
    SENSES
        .into_iter()
        .map(|n| {
            // The sense pair is reversed, which makes the value of the homogeneous sheet positive.
            let sense = pair(n).reversed();
            let values: Vec<f64> = (0..grid.len())
                .map(|c| sensitivity.transfer_ohm(c, pair(0), sense))
                .collect();
            let most = values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            let at = |p: [f64; 2]| {
                let index = |k: usize| ((p[k] - low[k]) / CELL_MM).max(0.0) as usize;
                // The values span four decades; the fourth root shows them all. Zero is the middle of the palette.
                let value = grid.at(index(0), index(1)).map_or(0.0, |c| values[c]);
                let t = 0.5 + 0.5 * value.signum() * (value.abs() / most).powf(0.25);
                colours[palette::index(t as f32)]
            };
            let active = [0, 1, n, (n + 1) % electrodes.len()];
            Ok(Gradient {
                sense: n + 1,
                largest_ohm_per_mm2: most / (CELL_MM * CELL_MM),
                negative_part: values.iter().filter(|v| **v < 0.0).count() as f64 / values.len() as f64,
                sum_ohm: values.iter().sum(),
                transfer_ohm: solver.electrode_matrix().transfer_ohm(pair(0), sense),
                map: Map::of_colours(&outline, &electrodes, at)?.with_active(&active),
            })
        })
        .collect()
}
