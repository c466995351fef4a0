//! Draws the sensitivity of pairs of neighbours: for every cell the inner product of the potential gradients of a
//! drive and a sense pair (the paper's Fig. 4).
//!
//!     cargo run --release -p studies --example gradients [file, default docs/img/gradients.png]

use forward::{CellGrid, Geometry, Model, ModelOptions, Pair, Sensitivity, Sheet, Solver};
use std::sync::Arc;
use view::canvas::{Align, Canvas};
use view::palette::Palette;

const CELL_MM: f64 = 1.0;
/// Sense pairs, each drawn against the drive pair of the first two electrodes.
const SENSES: [usize; 6] = [2, 4, 6, 8, 11, 13];
const COLUMNS: usize = 3;
/// Pixels per mm, and the width and height of a panel with its title.
const SCALE: f32 = 1.7;
const PANEL: [f32; 2] = [390.0, 450.0];
const TITLE: f32 = 60.0;
const INK: [u8; 3] = [30, 30, 30];
const IDLE: [u8; 3] = [150, 150, 150];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = std::env::args().nth(1).unwrap_or("docs/img/gradients.png".to_owned());
    let sheet = Sheet::paper();
    let geometry = Geometry::new(&sheet)?;
    let solver = Solver::new(Arc::new(Model::new(&sheet, &ModelOptions::default())?))?;
    let grid = CellGrid::new(&geometry, CELL_MM)?;
    let sensitivity = Sensitivity::by_cell(&solver, &grid);
    let electrodes = geometry.electrode_centres();
    let count = electrodes.len();
    let pair = |k: usize| Pair::new(k, (k + 1) % count);
    let rows = SENSES.len().div_ceil(COLUMNS);
    let mut canvas = Canvas::new(
        (COLUMNS as f32 * PANEL[0]) as u32,
        (rows as f32 * PANEL[1]) as u32,
        [255, 255, 255],
    )?;
    let colours = Palette::Diverging.table();
    for (panel, n) in SENSES.into_iter().enumerate() {
        let centre = [
            ((panel % COLUMNS) as f32 + 0.5) * PANEL[0],
            ((panel / COLUMNS) as f32 + 0.5) * PANEL[1] + 0.5 * TITLE,
        ];
        let to_px = |p: [f64; 2]| [centre[0] + SCALE * p[0] as f32, centre[1] - SCALE * p[1] as f32];
        // The sense pair is reversed, which makes the value of the homogeneous sheet positive.
        let values: Vec<f64> = (0..grid.len())
            .map(|c| sensitivity.transfer_ohm(c, pair(0), pair(n).reversed()))
            .collect();
        let most = values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let low = grid.low_mm();
        let colour = |x: f32, y: f32| {
            let mm = [(x - centre[0]) / SCALE, (centre[1] - y) / SCALE];
            let index = |k: usize| ((f64::from(mm[k]) - low[k]) / CELL_MM).max(0.0) as usize;
            // The values span four decades; the fourth root shows them all. Zero is the middle of the palette.
            let value = grid.at(index(0), index(1)).map_or(0.0, |c| values[c]);
            let t = 0.5 + 0.5 * value.signum() * (value.abs() / most).powf(0.25);
            colours[view::palette::index(t as f32)]
        };
        let rim: Vec<[f32; 2]> = geometry.outline().polyline().iter().map(|p| to_px(*p)).collect();
        canvas.shade(&rim, colour);
        canvas.stroke(&rim, true, 1.0, IDLE);
        for (l, p) in electrodes.iter().enumerate() {
            let angle = p[1].atan2(p[0]);
            let at = |angle: f64, radius: f64| to_px([radius * angle.cos(), radius * angle.sin()]);
            let half = 5.0 / 97.5;
            let arc: Vec<[f32; 2]> = (-3..=3).map(|k| at(angle + half * f64::from(k) / 3.0, 98.5)).collect();
            let active = [0, 1, n, (n + 1) % count].contains(&l);
            let (width, ink) = if active { (6.0, INK) } else { (3.0, IDLE) };
            canvas.stroke(&arc, false, width, ink);
            if active {
                let [x, y] = at(angle, 107.0);
                canvas.text(x, y + 5.0, 16.0, Align::Middle, INK, &l.to_string());
            }
        }
        let top = centre[1] - 0.5 * PANEL[1] + 0.5 * TITLE;
        let title = format!("drive 0-1, sense {n}-{}", (n + 1) % count);
        canvas.text(centre[0], top - 24.0, 19.0, Align::Middle, INK, &title);
        let total: f64 = values.iter().sum();
        let scale = format!("largest {:.2} mΩ per % and mm², sum {total:.1} Ω", 10.0 * most);
        canvas.text(centre[0], top - 4.0, 14.0, Align::Middle, INK, &scale);
    }
    canvas.write_png(&file)?;
    println!("{file}");
    Ok(())
}
