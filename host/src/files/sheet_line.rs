//! The sheet that a table is of, as a line of its header:
//! `# sheet: disc, 195.0 x 195.0 mm, 298.6 cm2, 16 electrodes, 1 at (97.5, 0.0), 2 at (90.1, 37.3)`.

use ::forward::{Geometry, GeometryError, Outline, Sheet};
use std::fmt;

/// What tells a sheet from another.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SheetLine {
    /// Kind of the outline; empty where the header says no more than the electrodes.
    pub outline: String,
    /// Extents in x and y, mm.
    pub size_mm: [f64; 2],
    /// Area without holes, cm2.
    pub area_cm2: f64,
    /// Number of electrodes.
    pub electrodes: usize,
    /// Centres of the first two electrodes, mm.
    pub first_mm: Vec<[f64; 2]>,
}

/// Lengths and areas may differ by this part: the header has four digits.
const ROUNDING: f64 = 2e-3;

impl SheetLine {
    /// Of a sheet.
    ///
    /// # Errors
    /// A sheet that makes no sense.
    pub(crate) fn of(sheet: &Sheet) -> Result<Self, GeometryError> {
        let geometry = Geometry::new(sheet)?;
        let (low, high) = geometry.bounding_box();
        let outline = match sheet.outline {
            Outline::Disc { .. } => "disc",
            Outline::Rectangle { .. } => "rectangle",
            Outline::Polygon { .. } => "polygon",
            Outline::Smooth { .. } => "smooth",
        };
        Ok(Self {
            outline: outline.to_owned(),
            size_mm: [high[0] - low[0], high[1] - low[1]],
            area_cm2: geometry.outline().area() / 100.0,
            electrodes: sheet.electrodes.len(),
            first_mm: geometry.electrode_centres().into_iter().take(2).collect(),
        })
    }

    /// What a comment line of a table says of its sheet, if it says something.
    pub(crate) fn parse(comment: &str) -> Option<Self> {
        let text = comment.trim_start_matches('#').trim();
        if let Some(list) = text.strip_prefix("sheet:") {
            return Self::fields(list);
        }
        // Other headers name the number at least: "16-electrode adjacent drive", "complete electrode model, 16 electrodes".
        let words: Vec<&str> = text.split([' ', ',', ';']).filter(|word| !word.is_empty()).collect();
        let hyphened = words
            .iter()
            .filter_map(|word| word.strip_suffix("-electrode"))
            .find_map(|number| number.parse().ok());
        let electrodes = hyphened.or_else(|| {
            let simulated = text.starts_with("simulated:");
            let place = words
                .iter()
                .position(|word| *word == "electrodes")
                .filter(|_| simulated)?;
            words.get(place.checked_sub(1)?)?.parse().ok()
        })?;
        Some(Self {
            outline: String::new(),
            size_mm: [0.0; 2],
            area_cm2: 0.0,
            electrodes,
            first_mm: Vec::new(),
        })
    }

    fn fields(list: &str) -> Option<Self> {
        let mut parts = list.splitn(5, ',').map(str::trim);
        let outline = parts.next()?.to_owned();
        let (width, height) = parts.next()?.strip_suffix("mm")?.split_once('x')?;
        let area = parts.next()?.strip_suffix("cm2")?.trim().parse().ok()?;
        let electrodes = parts.next()?.strip_suffix("electrodes")?.trim().parse().ok()?;
        let centres = parts.next().unwrap_or_default().split('(').skip(1).map(|text| {
            let (x, y) = text.split_once(')')?.0.split_once(',')?;
            Some([x.trim().parse().ok()?, y.trim().parse().ok()?])
        });
        Some(Self {
            outline,
            size_mm: [width.trim().parse().ok()?, height.trim().parse().ok()?],
            area_cm2: area,
            electrodes,
            first_mm: centres.collect::<Option<_>>()?,
        })
    }

    /// In what the sheet used differs from this one, which a table names; none where nothing does.
    pub(crate) fn differs(&self, used: &Self) -> Option<String> {
        let apart = |a: f64, b: f64| (a - b).abs() > ROUNDING * a.abs().max(b.abs()) + 0.05;
        if self.electrodes != used.electrodes {
            return Some(format!("{} electrodes, not {}", self.electrodes, used.electrodes));
        }
        if self.outline.is_empty() {
            return None;
        }
        if self.outline != used.outline {
            return Some(format!("a {}, not a {}", self.outline, used.outline));
        }
        let [[w, h], [v, g]] = [self.size_mm, used.size_mm];
        if apart(w, v) || apart(h, g) {
            return Some(format!("{w:.1} x {h:.1} mm, not {v:.1} x {g:.1} mm"));
        }
        if apart(self.area_cm2, used.area_cm2) {
            return Some(format!(
                "an area of {:.1} cm2, not {:.1} cm2",
                self.area_cm2, used.area_cm2
            ));
        }
        // Nearer to its namesake than half way to a neighbour: otherwise the electrodes are numbered in another way.
        let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let reach = match used.first_mm[..] {
            [a, b, ..] => 0.5 * distance(a, b),
            _ => return None,
        };
        let moved = self
            .first_mm
            .iter()
            .zip(&used.first_mm)
            .position(|(a, b)| distance(*a, *b) > reach)?;
        let [[x, y], [u, v]] = [self.first_mm[moved], used.first_mm[moved]];
        Some(format!(
            "electrode {} at ({x:.1}, {y:.1}) mm, not at ({u:.1}, {v:.1}) mm",
            moved + 1
        ))
    }
}

impl fmt::Display for SheetLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [w, h] = self.size_mm;
        let Self {
            outline,
            area_cm2,
            electrodes,
            ..
        } = self;
        if outline.is_empty() {
            return write!(f, "{electrodes} electrodes");
        }
        write!(
            f,
            "{outline}, {w:.1} x {h:.1} mm, {area_cm2:.1} cm2, {electrodes} electrodes"
        )?;
        for (k, [x, y]) in self.first_mm.iter().enumerate() {
            // No -0.0: rounding is what makes it.
            let tidy = |v: f64| (10.0 * v).round() / 10.0 + 0.0;
            write!(f, ", {} at ({:.1}, {:.1})", k + 1, tidy(*x), tidy(*y))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_what_it_was_made_of() {
        let paper = SheetLine::of(&Sheet::paper()).unwrap();
        let read = SheetLine::parse(&format!("# sheet: {paper}")).unwrap();
        assert_eq!(read.differs(&paper), None);
        assert_eq!(paper.differs(&read), None);
        assert_eq!(
            (read.electrodes, read.outline.as_str(), read.first_mm.len()),
            (16, "disc", 2)
        );
    }

    #[test]
    fn every_difference_is_named() {
        let paper = SheetLine::of(&Sheet::paper()).unwrap();
        let mut clockwise = Sheet::paper();
        clockwise.electrodes[1..].reverse();
        for (other, words) in [
            (Sheet::disc(195.0, 32, 5.0, 1.0, 1000.0), "32 electrodes, not 16"),
            (
                Sheet::disc(150.0, 16, 10.0, 1.0, 1000.0),
                "150.0 x 150.0 mm, not 195.0 x 195.0 mm",
            ),
            (clockwise, "electrode 2 at"),
            (
                Sheet {
                    outline: Outline::Rectangle {
                        width_mm: 195.0,
                        height_mm: 195.0,
                        centre_mm: [0.0, 0.0],
                    },
                    ..Sheet::paper()
                },
                "a rectangle, not a disc",
            ),
        ] {
            let said = SheetLine::of(&other).unwrap().differs(&paper).unwrap();
            assert!(said.contains(words), "{said}");
        }
    }

    #[test]
    fn other_headers_name_the_electrodes_at_least() {
        for (line, electrodes) in [
            ("# lct2004 : 208 rows = 16-electrode adjacent drive", Some(16)),
            ("# simulated: complete electrode model, 32 electrodes", Some(32)),
            ("# the wires of 2 electrodes were changed", None),
            ("# sheet: blue rubber", None),
        ] {
            assert_eq!(SheetLine::parse(line).map(|s| s.electrodes), electrodes, "{line}");
        }
    }
}
