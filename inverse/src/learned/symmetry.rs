//! By what turns a sheet is mapped onto itself.

use forward::{Geometry, GeometryError, Sheet};
use std::f64::consts::TAU;

/// Places that are closer than this part of the sheet's size are the same.
const SAME: f64 = 0.005;

/// The fewest electrodes by which a turn around the origin maps the sheet and its electrodes onto themselves; the number of
/// electrodes where none does.
///
/// # Errors
/// A sheet that makes no sense.
pub fn turn(sheet: &Sheet) -> Result<usize, GeometryError> {
    let geometry = Geometry::new(sheet)?;
    let centres = geometry.electrode_centres();
    let count = centres.len();
    let outline = geometry.outline().polyline();
    let size = centres.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
    let turned = |p: [f64; 2], angle: f64| {
        let (sin, cos) = angle.sin_cos();
        [cos * p[0] - sin * p[1], sin * p[0] + cos * p[1]]
    };
    let maps = |step: usize, angle: f64| {
        let electrodes = (0..count).all(|k| {
            let (there, other) = (turned(centres[k], angle), centres[(k + step) % count]);
            (there[0] - other[0]).hypot(there[1] - other[1]) < SAME * size
        });
        let rim = outline.iter().all(|p| {
            let inside = turned(p.map(|v| v * (1.0 - SAME)), angle);
            let outside = turned(p.map(|v| v * (1.0 + SAME)), angle);
            geometry.contains(inside) && !geometry.contains(outside)
        });
        electrodes && rim
    };
    let fits = |step: &usize| {
        let angle = TAU * *step as f64 / count as f64;
        count % step == 0 && (maps(*step, angle) || maps(*step, -angle))
    };
    Ok((1..count).find(fits).unwrap_or(count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::file::parse_sheet;

    fn ring(outline: &str, count: usize) -> Sheet {
        let text = format!(
            "sheet_resistance_ohm = 1000.0\noutline = {outline}\n[electrode_ring]\ncount = {count}\nwidth_mm = 5.0\ncontact_mm = 1.0\n"
        );
        parse_sheet(&text).unwrap().0
    }

    #[test]
    fn a_disc_turns_by_every_electrode_a_square_by_a_quarter_and_a_strip_by_a_half() {
        assert_eq!(turn(&Sheet::paper()), Ok(1));
        let rectangle = |w: f64, h: f64| format!("{{ kind = \"rectangle\", width_mm = {w:?}, height_mm = {h:?} }}");
        assert_eq!(turn(&ring(&rectangle(120.0, 120.0), 16)), Ok(4));
        assert_eq!(turn(&ring(&rectangle(200.0, 80.0), 16)), Ok(8));
    }

    #[test]
    fn one_electrode_that_is_elsewhere_ends_every_symmetry() {
        let mut sheet = Sheet::paper();
        let moved = ring("{ kind = \"disc\", diameter_mm = 195.0 }", 50);
        sheet.electrodes[3] = moved.electrodes[11];
        assert_eq!(turn(&sheet), Ok(16));
    }
}
