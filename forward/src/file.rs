//! Sheets as TOML files.
//!
//! ```toml
//! sheet_resistance_ohm = 1000.0              # of one square
//! outline = { kind = "disc", diameter_mm = 195.0 }   # or rectangle, polygon, smooth
//! holes = [{ kind = "disc", diameter_mm = 20.0, centre_mm = [30.0, 0.0] }]
//!
//! [electrode_ring]                           # evenly spaced by angle on the outline, or...
//! count = 16
//! width_mm = 10.0
//! contact_mm = 1.0                           # contact impedance as a length of sheet
//! first_deg = 0.0
//! clockwise = false
//!
//! [[electrodes]]                             # ...one by one: angle_deg, arc_mm or point_mm with width_mm,
//! centre_mm = [0.0, 0.0]                     # or centre_mm with radius_mm for a disc inside the sheet
//! radius_mm = 3.0
//! contact_mm = 1.0
//!
//! [pattern]                                  # optional: steps, or a list of measurements, each the electrode the
//! drive_step = 1                             # current enters at, the one it leaves by, and the two sensed: the value
//! sense_step = 1                             # is the last one's potential less that of the one before it;
//! # measurements = [[1, 2, 3, 4], [1, 2, 4, 5]]   # electrodes count from 1
//! ```

use crate::curve::Point;
use crate::geometry::{Electrode, Outline, Place, Sheet};
use crate::pattern::{Measurement, Pair, Pattern, PatternError};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// What is wrong with a sheet's file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SheetFileError {
    /// Not the TOML expected; the message names line and column.
    #[error(transparent)]
    Toml(#[from] toml::de::Error),
    /// An electrode that says too little or too much about its place.
    #[error(
        "electrode {} of the list must have one of angle_deg, arc_mm or point_mm with width_mm, or centre_mm with radius_mm",
        electrode + 1
    )]
    Place {
        /// Which one of the list, from 0.
        electrode: usize,
    },
    /// The pattern does not fit the electrodes.
    #[error(transparent)]
    Pattern(#[from] PatternError),
    /// More electrodes than can be modelled.
    #[error("{count} electrodes are asked for; at most {MOST_ELECTRODES} can be modelled")]
    TooMany {
        /// How many.
        count: usize,
    },
    /// A measurement of electrode 0.
    #[error("measurement {} names electrode 0; electrodes count from 1", measurement + 1)]
    Zero {
        /// Which one of the list, from 0.
        measurement: usize,
    },
    /// Steps and a list at once.
    #[error("the pattern has both steps and a list of measurements; give one of them")]
    TwoPatterns,
}

/// Most electrodes of a sheet. Potentials are held for every electrode and node: four times as many would take 20 s of
/// processor and 0.7 GB for the voltages alone.
pub const MOST_ELECTRODES: usize = 256;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    sheet_resistance_ohm: f64,
    outline: Outline,
    #[serde(default)]
    holes: Vec<Outline>,
    electrode_ring: Option<Ring>,
    #[serde(default)]
    electrodes: Vec<One>,
    #[serde(default)]
    pattern: Measurements,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Ring {
    count: usize,
    width_mm: f64,
    contact_mm: f64,
    #[serde(default)]
    first_deg: f64,
    #[serde(default)]
    clockwise: bool,
}

#[derive(Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct One {
    #[serde(skip_serializing_if = "Option::is_none")]
    angle_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    arc_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    point_mm: Option<Point>,
    #[serde(skip_serializing_if = "Option::is_none")]
    centre_mm: Option<Point>,
    #[serde(skip_serializing_if = "Option::is_none")]
    width_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    radius_mm: Option<f64>,
    contact_mm: f64,
}

/// What is written: every electrode by itself.
#[derive(Serialize)]
struct Written<'a> {
    sheet_resistance_ohm: f64,
    outline: &'a Outline,
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    holes: &'a [Outline],
    electrodes: Vec<One>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Measurements {
    drive_step: Option<usize>,
    sense_step: Option<usize>,
    measurements: Option<Vec<[usize; 4]>>,
}

impl Measurements {
    fn pattern(self, electrodes: usize) -> Result<Pattern, SheetFileError> {
        let Some(list) = self.measurements else {
            return Ok(Pattern::rotating(
                electrodes,
                self.drive_step.unwrap_or(1),
                self.sense_step.unwrap_or(1),
            )?);
        };
        if self.drive_step.is_some() || self.sense_step.is_some() {
            return Err(SheetFileError::TwoPatterns);
        }
        if let Some(measurement) = list.iter().position(|m| m.contains(&0)) {
            return Err(SheetFileError::Zero { measurement });
        }
        let list = list.into_iter().map(|m| {
            let [a, b, c, d] = m.map(|e| e - 1);
            Measurement {
                drive: Pair::new(a, b),
                sense: Pair::new(d, c),
            }
        });
        Ok(Pattern::from_list(electrodes, list.collect())?)
    }
}

impl One {
    fn of(electrode: &Electrode) -> Self {
        let contact_mm = electrode.contact_mm;
        let none = Self::default();
        match electrode.place {
            Place::Angle { angle_deg, width_mm } => Self {
                angle_deg: Some(angle_deg),
                width_mm: Some(width_mm),
                contact_mm,
                ..none
            },
            Place::Arc { arc_mm, width_mm } => Self {
                arc_mm: Some(arc_mm),
                width_mm: Some(width_mm),
                contact_mm,
                ..none
            },
            Place::Point { point_mm, width_mm } => Self {
                point_mm: Some(point_mm),
                width_mm: Some(width_mm),
                contact_mm,
                ..none
            },
            Place::Inside { centre_mm, radius_mm } => Self {
                centre_mm: Some(centre_mm),
                radius_mm: Some(radius_mm),
                contact_mm,
                ..none
            },
        }
    }

    fn place(&self) -> Option<Place> {
        match (
            self.angle_deg,
            self.arc_mm,
            self.point_mm,
            self.centre_mm,
            self.width_mm,
            self.radius_mm,
        ) {
            (Some(angle_deg), None, None, None, Some(width_mm), None) => Some(Place::Angle { angle_deg, width_mm }),
            (None, Some(arc_mm), None, None, Some(width_mm), None) => Some(Place::Arc { arc_mm, width_mm }),
            (None, None, Some(point_mm), None, Some(width_mm), None) => Some(Place::Point { point_mm, width_mm }),
            (None, None, None, Some(centre_mm), None, Some(radius_mm)) => Some(Place::Inside { centre_mm, radius_mm }),
            _ => None,
        }
    }
}

/// Reads a sheet and its measurements from TOML; electrodes of the ring come first.
///
/// # Errors
/// [`SheetFileError`]; whether the geometry makes sense is checked when a model is made of it.
pub fn parse_sheet(text: &str) -> Result<(Sheet, Pattern), SheetFileError> {
    let file: File = toml::from_str(text)?;
    let mut electrodes = Vec::new();
    let count = file
        .electrode_ring
        .as_ref()
        .map_or(0, |r| r.count)
        .saturating_add(file.electrodes.len());
    if count > MOST_ELECTRODES {
        return Err(SheetFileError::TooMany { count });
    }
    if let Some(ring) = &file.electrode_ring {
        let turn = if ring.clockwise { -360.0 } else { 360.0 };
        electrodes.extend((0..ring.count).map(|l| Electrode {
            place: Place::Angle {
                angle_deg: ring.first_deg + turn * l as f64 / ring.count as f64,
                width_mm: ring.width_mm,
            },
            contact_mm: ring.contact_mm,
        }));
    }
    for (electrode, one) in file.electrodes.iter().enumerate() {
        electrodes.push(Electrode {
            place: one.place().ok_or(SheetFileError::Place { electrode })?,
            contact_mm: one.contact_mm,
        });
    }
    let pattern = file.pattern.pattern(electrodes.len())?;
    let sheet = Sheet {
        sheet_resistance_ohm: file.sheet_resistance_ohm,
        outline: file.outline,
        holes: file.holes,
        electrodes,
    };
    Ok((sheet, pattern))
}

/// The text of a sheet, from which [`parse_sheet`] reads the same to the last bit. Every electrode stands by itself.
///
/// # Errors
/// What the format cannot hold, which no sheet has.
pub fn sheet_text(sheet: &Sheet) -> Result<String, toml::ser::Error> {
    toml::to_string(&Written {
        sheet_resistance_ohm: sheet.sheet_resistance_ohm,
        outline: &sheet.outline,
        holes: &sheet.holes,
        electrodes: sheet.electrodes.iter().map(One::of).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_is_written_and_read_to_the_last_bit() {
        let contact_mm = 1.0 / 3.0;
        let places = [
            Place::Arc {
                arc_mm: 0.1 + 0.2,
                width_mm: 10.0,
            },
            Place::Point {
                point_mm: [97.5, -1e-17],
                width_mm: 3.0,
            },
            Place::Inside {
                centre_mm: [0.0, 1.1],
                radius_mm: 3.3,
            },
        ];
        let mut sheet = Sheet::paper();
        sheet
            .electrodes
            .extend(places.map(|place| Electrode { place, contact_mm }));
        sheet.holes.push(Outline::Polygon {
            points_mm: vec![[0.1, 0.2], [3.0, 0.7], [1.0, 9.0]],
        });
        assert_eq!(parse_sheet(&sheet_text(&sheet).unwrap()).unwrap().0, sheet);
        assert_eq!(
            parse_sheet(&sheet_text(&Sheet::paper()).unwrap()).unwrap().0,
            Sheet::paper()
        );
    }

    const PAPER: &str = "sheet_resistance_ohm = 1000.0
outline = { kind = \"disc\", diameter_mm = 195.0 }
[electrode_ring]
count = 16
width_mm = 10.0
contact_mm = 1.0
";

    #[test]
    fn the_papers_sheet() {
        let (sheet, pattern) = parse_sheet(PAPER).unwrap();
        assert_eq!(sheet, Sheet::paper());
        assert_eq!(pattern.len(), 208);
    }

    #[test]
    fn electrodes_one_by_one() {
        let text = format!("{PAPER}[[electrodes]]\ncentre_mm = [0.0, 1.0]\nradius_mm = 3.0\ncontact_mm = 2.0\n");
        let (sheet, _) = parse_sheet(&text).unwrap();
        assert_eq!(sheet.electrodes.len(), 17);
        assert_eq!(
            sheet.electrodes[16].place,
            Place::Inside {
                centre_mm: [0.0, 1.0],
                radius_mm: 3.0
            }
        );
    }

    #[test]
    fn a_list_of_measurements() {
        let text = format!("{PAPER}[pattern]\nmeasurements = [[1, 2, 3, 4], [1, 2, 15, 16]]\n");
        let (_, pattern) = parse_sheet(&text).unwrap();
        let adjacent = Pattern::adjacent(16).unwrap();
        assert_eq!(
            pattern.measurements(),
            [adjacent.measurements()[0], adjacent.measurements()[12]]
        );
    }

    #[test]
    fn errors_say_where() {
        let unknown = parse_sheet(&format!("colour = 3\n{PAPER}")).unwrap_err().to_string();
        assert!(unknown.contains("line 1") && unknown.contains("colour"), "{unknown}");
        let many = parse_sheet(&PAPER.replace("16", "1000000000000000")).unwrap_err();
        assert!(matches!(many, SheetFileError::TooMany { .. }), "{many}");
        let both = format!("{PAPER}[pattern]\ndrive_step = 2\nmeasurements = [[1, 2, 3, 4]]\n");
        assert!(matches!(parse_sheet(&both), Err(SheetFileError::TwoPatterns)));
        // Electrodes and measurements count from 1, in the file and in what is said of it.
        let listed = |list| {
            let text = format!("{PAPER}[pattern]\nmeasurements = {list}\n");
            parse_sheet(&text).unwrap_err().to_string()
        };
        let zero = listed("[[1, 2, 3, 4], [0, 1, 2, 3]]");
        assert!(
            zero.starts_with("measurement 2 names electrode 0; electrodes count from 1"),
            "{zero}"
        );
        let beyond = listed("[[1, 2, 3, 4], [1, 2, 16, 17]]");
        assert!(
            beyond.contains("measurement 2 names electrode 17") && beyond.contains("(1 to 16)"),
            "{beyond}"
        );
        let itself = listed("[[1, 2, 5, 5]]");
        assert!(
            itself.contains("measurement 1 pairs electrode 5 with itself"),
            "{itself}"
        );
        let vague = parse_sheet(&format!("{PAPER}[[electrodes]]\nwidth_mm = 3.0\ncontact_mm = 2.0\n"));
        assert!(matches!(vague, Err(SheetFileError::Place { electrode: 0 })));
    }
}
