//! Whether presses can be on a sheet. What cannot is in another unit, or of another sheet.

use crate::files::sheet_line::SheetLine;
use ::forward::{Geometry, GeometryError, Sheet};
use anyhow::{Result, bail};

/// Places are known to some millimetres, and a fingertip is as wide: over the reach of the sheet.
const BEYOND: f64 = 0.05;
/// Presses that span no more of the reach tell nothing of the rest.
const TINY: f64 = 0.1;
/// A radius that presses tell is at most 1.25 of their reach. Beyond so many of the sheet's they are not on it.
const LARGE: f64 = 1.5;

/// How far a sheet extends.
pub(crate) struct Extent {
    /// None where only a table's header tells the sheet.
    geometry: Option<Geometry>,
    line: SheetLine,
    /// From the middle to the farthest point of the outline, mm.
    reach_mm: f64,
}

impl Extent {
    /// Of a sheet.
    ///
    /// # Errors
    /// It makes no sense.
    pub(crate) fn of(sheet: &Sheet) -> Result<Self, GeometryError> {
        let geometry = Geometry::new(sheet)?;
        let (low, high) = geometry.bounding_box();
        let reach_mm = reach(geometry.outline().polyline(), low, high);
        Ok(Self {
            geometry: Some(geometry),
            line: SheetLine::of(sheet)?,
            reach_mm,
        })
    }

    /// Of the sheet that a table's header names; none where it says no more than the electrodes.
    pub(super) fn named(line: &SheetLine) -> Option<Self> {
        let [w, h] = line.size_mm;
        let reach_mm = if line.outline == "disc" {
            0.5 * w
        } else {
            0.5 * w.hypot(h)
        };
        (reach_mm > 0.0 && !line.first_mm.is_empty()).then(|| Self {
            geometry: None,
            line: line.clone(),
            reach_mm,
        })
    }

    /// For those that learn. Of a header's sheet only where it is a disc around the origin, as its first electrodes tell: the middle of
    /// others is not known.
    pub(crate) fn of_sheet(&self) -> Option<inverse::learned::Extent> {
        let middle_mm = match &self.geometry {
            Some(geometry) => {
                let (low, high) = geometry.bounding_box();
                [0, 1].map(|k| 0.5 * (low[k] + high[k]))
            }
            None => {
                let off = |[x, y]: &[f64; 2]| (x.hypot(*y) - self.reach_mm).abs();
                let around = (self.line.first_mm.iter()).all(|first| off(first) <= BEYOND * self.reach_mm);
                (around && self.is_disc()).then_some([0.0; 2])?
            }
        };
        Some(inverse::learned::Extent {
            middle_mm,
            reach_mm: self.reach_mm,
        })
    }

    /// Whether the outline is said to be a disc.
    pub(super) fn is_disc(&self) -> bool {
        self.line.outline == "disc"
    }

    /// Whether a fingertip there touches the sheet. A header does not say where its middle is: but nothing is farther from an electrode
    /// than the sheet is long.
    fn reaches(&self, place_mm: [f64; 2]) -> bool {
        let beyond_mm = BEYOND * self.reach_mm;
        let near = |electrode: &[f64; 2]| {
            let off = [0, 1].map(|k| (place_mm[k] - electrode[k]).abs() - beyond_mm);
            (0..2).all(|k| off[k] <= self.line.size_mm[k])
        };
        match &self.geometry {
            Some(geometry) => geometry.reaches(place_mm, beyond_mm),
            None => self.line.first_mm.iter().all(near),
        }
    }

    /// Places with the lines of a file.
    ///
    /// # Errors
    /// One is not on the sheet; the error names its line.
    pub(super) fn check(&self, file: &str, places: impl IntoIterator<Item = (u64, [f64; 2])>) -> Result<()> {
        for (line, place_mm) in places {
            if self.reaches(place_mm) {
                continue;
            }
            let [x, y] = place_mm;
            let lies = match &self.geometry {
                Some(geometry) => {
                    let (low, high) = geometry.bounding_box();
                    format!(
                        "lies within x {:.1} to {:.1} mm and y {:.1} to {:.1} mm",
                        low[0], high[0], low[1], high[1]
                    )
                }
                None => format!(
                    "is {:.1} x {:.1} mm by the table's header",
                    self.line.size_mm[0], self.line.size_mm[1]
                ),
            };
            bail!(
                "{file}:{line}: x {x:.1}, y {y:.1} mm is not on the sheet, which {lies}; give places in millimetres, or correct the line or the sheet"
            );
        }
        Ok(())
    }

    /// What is strange about places that are all on the sheet.
    pub(super) fn doubt(&self, places: impl IntoIterator<Item = [f64; 2]>) -> Option<String> {
        let places: Vec<[f64; 2]> = places.into_iter().collect();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for (place, k) in places.iter().flat_map(|place| [(place, 0), (place, 1)]) {
            low[k] = low[k].min(place[k]);
            high[k] = high[k].max(place[k]);
        }
        let spread_mm = reach(&places, low, high);
        (spread_mm <= TINY * self.reach_mm).then(|| {
            format!(
                "all places are within {spread_mm:.1} mm of their middle, and the sheet reaches {:.1} mm from its own; are they in millimetres?",
                self.reach_mm
            )
        })
    }

    /// What is strange about the radius that presses tell.
    pub(super) fn doubt_radius(&self, radius_mm: f64) -> Option<String> {
        (radius_mm > LARGE * self.reach_mm).then(|| {
            format!(
                "the presses tell a sheet of {radius_mm:.0} mm radius, and it reaches {:.1} mm from its middle; are their places in millimetres?",
                self.reach_mm
            )
        })
    }
}

/// The farthest of some points from the middle of a box, mm.
fn reach(points: &[[f64; 2]], low: [f64; 2], high: [f64; 2]) -> f64 {
    let middle = [0, 1].map(|k| 0.5 * (low[k] + high[k]));
    let distance = |p: &[f64; 2]| (p[0] - middle[0]).hypot(p[1] - middle[1]);
    points.iter().map(distance).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_on_the_sheet_is_named_and_what_is_nearly_is_not() {
        let sheet = Extent::of(&Sheet::paper()).unwrap();
        let line = SheetLine::of(&Sheet::paper()).unwrap();
        let header = Extent::named(&line).unwrap();
        assert!((sheet.reach_mm - 97.5).abs() < 0.1 && (header.reach_mm - 97.5).abs() < 0.1);
        for extent in [&sheet, &header] {
            let on = [(2, [0.0; 2]), (3, [-97.0, 3.0]), (4, [0.0, 99.0])];
            extent.check("t", on).unwrap();
            let said = extent
                .check("t", [(2, [0.0; 2]), (7, [-970.0, 30.0])])
                .unwrap_err()
                .to_string();
            assert!(
                said.contains("t:7: x -970.0, y 30.0 mm") && said.contains("millimetres"),
                "{said}"
            );
            let spread = [[0.0, 0.0], [-60.0, 10.0], [5.0, 50.0]];
            assert_eq!(extent.doubt(spread), None);
            let centimetres = spread.map(|p| p.map(|v| 0.1 * v));
            assert!(extent.doubt(centimetres).unwrap().contains("in millimetres?"));
            assert_eq!(extent.doubt_radius(122.0), None);
            assert!(extent.doubt_radius(300.0).unwrap().contains("300 mm radius"));
        }
        // A sheet beside its origin; a header of electrodes alone tells no extent.
        assert!(sheet.check("t", [(2, [120.0, 0.0])]).is_err());
        let bare = SheetLine::parse("# simulated: complete electrode model, 32 electrodes").unwrap();
        assert!(Extent::named(&bare).is_none());
    }
}
