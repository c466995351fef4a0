//! Draws where on the sheet a pair of neighbours listens: the inner product of the potential gradients of a drive and a
//! sense pair, cell by cell (the paper's Fig. 4).
//!
//!     cargo run --release -p forward --example maps [file, default docs/img/sensitivity.svg]

mod svg;

use forward::{CellGrid, Geometry, Model, ModelOptions, Pair, Sensitivity, Sheet, Solver};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::Arc;
use svg::{Anchor, Svg};

const CELL_MM: f64 = 2.5;
/// Pixels per mm, panel size, title's height.
const SCALE: f64 = 1.6;
const PANEL: f64 = 360.0;
const TITLE: f64 = 50.0;
/// Shades on either side of nothing.
const SHADES: i32 = 16;

/// Red above nothing, blue below, on a scale of roots: the values span four decades.
fn colour(shade: i32) -> String {
    let t = f64::from(shade.abs()) / f64::from(SHADES);
    let mix = |from: f64, to: f64| (from + t * (to - from)).round() as u8;
    let end = if shade > 0 {
        [178.0, 24.0, 43.0]
    } else {
        [33.0, 102.0, 172.0]
    };
    format!(
        "#{:02x}{:02x}{:02x}",
        mix(247.0, end[0]),
        mix(247.0, end[1]),
        mix(247.0, end[2])
    )
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = std::env::args()
        .nth(1)
        .unwrap_or_else(|| "docs/img/sensitivity.svg".to_owned());
    let sheet = Sheet::paper();
    let geometry = Geometry::new(&sheet)?;
    let solver = Solver::new(Arc::new(Model::new(&sheet, &ModelOptions::default())?))?;
    let grid = CellGrid::new(&geometry, CELL_MM)?;
    let sensitivity = Sensitivity::by_cell(&solver, &grid);
    let senses = [2, 4, 6, 8, 11, 13];
    let mut out = Svg::new(3.0 * PANEL, 2.0 * (PANEL + TITLE));
    let pair = |k: usize| Pair::new(k, (k + 1) % 16);
    for (panel, n) in senses.into_iter().enumerate() {
        let (cx, cy) = (
            (panel % 3) as f64 * PANEL + 0.5 * PANEL,
            (panel / 3) as f64 * (PANEL + TITLE) + TITLE + 0.5 * PANEL,
        );
        // The sense pair the way round that makes the homogeneous sheet's value positive.
        let values: Vec<f64> = (0..grid.len())
            .map(|c| sensitivity.transfer_ohm(c, pair(0), pair(n).reversed()))
            .collect();
        let most = values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let mut shades: BTreeMap<i32, String> = BTreeMap::new();
        let shade = |cell: usize| {
            let v: f64 = values[cell];
            ((v.abs() / most).powf(0.25) * f64::from(SHADES) * v.signum()).round() as i32
        };
        // Cells come row by row; neighbours of one shade are one rectangle.
        let side = SCALE * CELL_MM;
        let mut cell = 0;
        while cell < grid.len() {
            let [column, row] = grid.cells()[cell];
            let run = (cell..grid.len())
                .zip(column..)
                .take_while(|(c, column)| grid.cells()[*c] == [*column, row] && shade(*c) == shade(cell))
                .count();
            let p = grid.centre(cell);
            let (x, y) = (cx + SCALE * (p[0] - 0.5 * CELL_MM), cy - SCALE * (p[1] + 0.5 * CELL_MM));
            let width = side * run as f64;
            write!(
                shades.entry(shade(cell)).or_default(),
                "M{x:.1} {y:.1}h{width}v{side}h-{width}z"
            )?;
            cell += run;
        }
        for (shade, d) in shades {
            out.path(&d, &format!(r#"fill="{}" shape-rendering="crispEdges""#, colour(shade)));
        }
        for (l, p) in geometry.electrode_centres().iter().enumerate() {
            let along = 5.0 / 97.5;
            let angle = p[1].atan2(p[0]);
            let at = |a: f64, r: f64| (cx + SCALE * r * a.cos(), cy - SCALE * r * a.sin());
            let arc: Vec<_> = (0..=6)
                .map(|k| at(angle + along * (f64::from(k) / 3.0 - 1.0), 98.5))
                .collect();
            let active = [0, 1, n, (n + 1) % 16].contains(&l);
            out.line(
                &arc,
                if active { "#000" } else { "#999" },
                if active { 5.0 } else { 3.0 },
            );
            let (x, y) = at(angle, 104.5);
            if active {
                out.text(x, y + 4.0, 12.0, Anchor::Middle, &l.to_string());
            }
        }
        let total: f64 = values.iter().sum();
        let title = format!("drive 0-1, sense {n}-{}", (n + 1) % 16);
        out.text(cx, cy - 0.5 * PANEL - 20.0, 15.0, Anchor::Middle, &title);
        let scale = format!("largest {:.2} mΩ per % and cell, sum {total:.1} Ω", 10.0 * most);
        out.text(cx, cy - 0.5 * PANEL - 4.0, 11.0, Anchor::Middle, &scale);
    }
    std::fs::write(&file, out.finish())?;
    println!("{file}");
    Ok(())
}
