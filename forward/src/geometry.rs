//! The sheet as data: its outline, its holes, its electrodes.

use crate::curve::{Curve, Point, cross, distance};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A closed outline, mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Outline {
    /// A disc. Arc length runs counter-clockwise from the point at angle 0.
    Disc {
        /// Diameter, mm.
        diameter_mm: f64,
        /// Centre, mm.
        #[serde(default)]
        centre_mm: Point,
    },
    /// A rectangle with sides along the axes. Arc length runs counter-clockwise from the lower left corner.
    Rectangle {
        /// Extent in x, mm.
        width_mm: f64,
        /// Extent in y, mm.
        height_mm: f64,
        /// Centre, mm.
        #[serde(default)]
        centre_mm: Point,
    },
    /// A polygon, in either sense of turn. Arc length runs counter-clockwise from the first vertex.
    Polygon {
        /// Vertices, mm; the last joins the first.
        points_mm: Vec<Point>,
    },
    /// A smooth closed curve through points. Arc length runs counter-clockwise from the first point.
    Smooth {
        /// Points on the curve, mm, three or more.
        points_mm: Vec<Point>,
    },
}

/// Where an electrode sits, and its size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// On the rim where the ray from the outline's centre at this angle (degrees, counter-clockwise from +x) meets the
    /// outline last.
    Angle {
        /// Degrees counter-clockwise from +x.
        angle_deg: f64,
        /// Length along the rim, mm.
        width_mm: f64,
    },
    /// On the rim at this arc length along the outline.
    Arc {
        /// Centre of the electrode, mm from the outline's first point.
        arc_mm: f64,
        /// Length along the rim, mm.
        width_mm: f64,
    },
    /// On the rim (of the outline or of a hole) at this point.
    Point {
        /// Centre of the electrode, mm; must lie on the rim to 1 % of the width.
        point_mm: Point,
        /// Length along the rim, mm.
        width_mm: f64,
    },
    /// A small disc inside the sheet. Its metal shorts the sheet beneath; the current passes its circumference.
    Inside {
        /// Centre, mm.
        centre_mm: Point,
        /// Radius, mm.
        radius_mm: f64,
    },
}

/// An electrode: where it is and how well it makes contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Electrode {
    /// Position and size.
    pub place: Place,
    /// Contact impedance as the length of sheet that has the same resistance: z times the sheet's conductance of one
    /// square, mm. Greater than 0.
    pub contact_mm: f64,
}

/// A conductive sheet with its electrodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// Resistance of one square of the unpressed sheet, ohm.
    pub sheet_resistance_ohm: f64,
    /// The outer rim.
    pub outline: Outline,
    /// Rims of holes.
    pub holes: Vec<Outline>,
    /// Electrodes in order.
    pub electrodes: Vec<Electrode>,
}

/// What is wrong with a sheet.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum GeometryError {
    /// A number that has to be positive and finite.
    #[error("{what} is {value}; give a positive number")]
    NotPositive {
        /// What the number is.
        what: String,
        /// The number.
        value: f64,
    },
    /// A number that no sheet has.
    #[error("{what} is {value:e}; give a number from {least:e} to {most:e}")]
    OutOfRange {
        /// What the number is.
        what: String,
        /// The number.
        value: f64,
        /// The least that is possible.
        least: f64,
        /// The most.
        most: f64,
    },
    /// Rims of more segments than can be held against one another.
    #[error("the rims have {segments} segments, more than {MOST_SEGMENTS}; leave out holes or points of the outlines")]
    TooManySegments {
        /// Straight segments of all rims; 256 for a circle, 32 for every point of a smooth curve.
        segments: usize,
    },
    /// A coordinate or an angle that is not a number.
    #[error("{what} is {value}; give a finite number")]
    NotFinite {
        /// What the number is.
        what: String,
        /// The number.
        value: f64,
    },
    /// A curve with too few points.
    #[error("{ring} has {count} points; give at least {least}")]
    TooFewPoints {
        /// Which curve.
        ring: String,
        /// How many it has.
        count: usize,
        /// How many it needs.
        least: usize,
    },
    /// A curve with two equal points in a row, or with no area.
    #[error("{ring}: segment {segment} has no length; leave out the repeated point")]
    EmptySegment {
        /// Which curve.
        ring: String,
        /// Which segment, from 0.
        segment: usize,
    },
    /// A curve that crosses itself or another.
    #[error("segment {segment} of {ring} crosses segment {other_segment} of {other}; move one of them")]
    Crossing {
        /// Which curve.
        ring: String,
        /// Which of its segments, from 0.
        segment: usize,
        /// The other curve (the same name when a curve crosses itself).
        other: String,
        /// The other segment, from 0.
        other_segment: usize,
    },
    /// A curve that encloses nothing: all of its points lie on a line.
    #[error("{ring} encloses no area; give points that do not all lie on one line")]
    Flat {
        /// Which curve.
        ring: String,
    },
    /// A hole that is not inside the outline, or inside another hole.
    #[error("{ring} does not lie inside the sheet; a hole must be within the outline and outside other holes")]
    HoleOutside {
        /// Which curve.
        ring: String,
    },
    /// Fewer than two electrodes.
    #[error("the sheet has {count} electrode(s); give at least 2")]
    TooFewElectrodes {
        /// How many it has.
        count: usize,
    },
    /// An electrode that is not on a rim.
    #[error(
        "electrode {} is {distance_mm:.3} mm off the rim; place it on the outline or on a hole's rim",
        electrode + 1
    )]
    OffTheRim {
        /// Which electrode, from 0.
        electrode: usize,
        /// How far the nearest rim is, mm.
        distance_mm: f64,
    },
    /// An electrode longer than its rim.
    #[error(
        "electrode {} is {width_mm} mm wide, but its rim is only {rim_mm:.3} mm long; make it narrower",
        electrode + 1
    )]
    TooWide {
        /// Which electrode, from 0.
        electrode: usize,
        /// Its width, mm.
        width_mm: f64,
        /// Length of the rim, mm.
        rim_mm: f64,
    },
    /// Two electrodes that touch.
    #[error("electrodes {} and {} overlap; narrow one or move it", first + 1, second + 1)]
    Overlap {
        /// One of them, from 0.
        first: usize,
        /// The other.
        second: usize,
    },
    /// An electrode inside the sheet that crosses a rim.
    #[error("electrode {} does not lie wholly inside the sheet; move it or make it smaller", electrode + 1)]
    NotInside {
        /// Which electrode, from 0.
        electrode: usize,
    },
}

impl Sheet {
    /// A disc with evenly spaced rim electrodes, number l at `first_deg + 360 l / count` degrees, counter-clockwise.
    pub fn disc(diameter_mm: f64, count: usize, electrode_mm: f64, contact_mm: f64, sheet_resistance_ohm: f64) -> Self {
        Self {
            sheet_resistance_ohm,
            outline: Outline::Disc {
                diameter_mm,
                centre_mm: [0.0, 0.0],
            },
            holes: Vec::new(),
            electrodes: (0..count)
                .map(|l| Electrode {
                    place: Place::Angle {
                        angle_deg: 360.0 * l as f64 / count as f64,
                        width_mm: electrode_mm,
                    },
                    contact_mm,
                })
                .collect(),
        }
    }

    /// The paper's sheet: 195 mm disc, 16 electrodes. Electrode width 10 mm, contact 1 mm and 1 kilohm per square are
    /// assumptions where the paper is silent.
    pub fn paper() -> Self {
        Self::disc(195.0, 16, 10.0, 1.0, 1000.0)
    }
}

/// An electrode's stretch of a ring, by arc length; all of it for an electrode inside the sheet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    pub(crate) ring: usize,
    pub(crate) start: f64,
    pub(crate) length: f64,
    pub(crate) whole: bool,
}

/// A checked sheet: its rings (the outline, the holes, then one ring for every electrode inside the sheet) and where on
/// them the electrodes are.
#[derive(Clone, Debug)]
pub struct Geometry {
    pub(crate) rings: Vec<Curve>,
    pub(crate) spans: Vec<Span>,
    /// Rings that bound the material: outline and holes, without the electrodes inside.
    rims: usize,
}

/// Least area of a curve over the square of its length: a strip ten thousand times as long as wide has more.
const LEAST_AREA: f64 = 1e-6;

/// Shortest and longest length of a sheet, mm: a micrometre and a kilometre. Squares and quotients of such numbers, and of
/// those below, are far from overflow.
const LENGTHS_MM: [f64; 2] = [1e-3, 1e6];
/// Places on a sheet, mm.
const PLACES_MM: [f64; 2] = [-1e6, 1e6];
/// Contact impedances as lengths of sheet, mm: from a short to a broken wire.
const CONTACTS_MM: [f64; 2] = [1e-9, 1e9];
/// Resistance of a square, ohm: from thick copper to an insulator.
const RESISTANCES_OHM: [f64; 2] = [1e-6, 1e12];
/// Straight segments of all rims together. Every one is held against every other, and every cell against all.
const MOST_SEGMENTS: usize = 16_384;

fn positive(what: impl Fn() -> String, value: f64) -> Result<f64, GeometryError> {
    if value > 0.0 && value.is_finite() {
        Ok(value)
    } else {
        Err(GeometryError::NotPositive { what: what(), value })
    }
}

fn within(what: impl Fn() -> String, value: f64, [least, most]: [f64; 2]) -> Result<f64, GeometryError> {
    if (least..=most).contains(&value) {
        Ok(value)
    } else {
        let what = what();
        Err(GeometryError::OutOfRange {
            what,
            value,
            least,
            most,
        })
    }
}

/// A length of the sheet, mm.
fn length(what: impl Fn() -> String, value: f64) -> Result<f64, GeometryError> {
    within(&what, positive(&what, value)?, LENGTHS_MM)
}

/// A coordinate of the sheet, mm.
fn coordinate(what: impl Fn() -> String, value: f64) -> Result<f64, GeometryError> {
    within(&what, finite(&what, value)?, PLACES_MM)
}

fn finite(what: impl Fn() -> String, value: f64) -> Result<f64, GeometryError> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(GeometryError::NotFinite { what: what(), value })
    }
}

fn few_enough(segments: usize) -> Result<(), GeometryError> {
    if segments > MOST_SEGMENTS {
        return Err(GeometryError::TooManySegments { segments });
    }
    Ok(())
}

impl Outline {
    fn curve(&self, ring: &str) -> Result<Curve, GeometryError> {
        let points = |points: &[Point]| -> Result<(), GeometryError> {
            few_enough(points.len())?;
            if points.len() < 3 {
                return Err(GeometryError::TooFewPoints {
                    ring: ring.to_owned(),
                    count: points.len(),
                    least: 3,
                });
            }
            for (k, p) in points.iter().enumerate() {
                for value in p {
                    coordinate(|| format!("point {k} of {ring} (mm)"), *value)?;
                }
                if *p == points[(k + 1) % points.len()] {
                    return Err(GeometryError::EmptySegment {
                        ring: ring.to_owned(),
                        segment: k,
                    });
                }
            }
            Ok(())
        };
        let centre_ok = |c: &Point| -> Result<(), GeometryError> {
            coordinate(|| format!("the centre of {ring} (mm)"), c[0])?;
            coordinate(|| format!("the centre of {ring} (mm)"), c[1])?;
            Ok(())
        };
        Ok(match self {
            Self::Disc { diameter_mm, centre_mm } => {
                centre_ok(centre_mm)?;
                let d = length(|| format!("the diameter of {ring} (mm)"), *diameter_mm)?;
                Curve::circle(*centre_mm, 0.5 * d)
            }
            Self::Rectangle {
                width_mm,
                height_mm,
                centre_mm,
            } => {
                centre_ok(centre_mm)?;
                let w = 0.5 * length(|| format!("the width of {ring} (mm)"), *width_mm)?;
                let h = 0.5 * length(|| format!("the height of {ring} (mm)"), *height_mm)?;
                let [x, y] = *centre_mm;
                Curve::polygon(&[[x - w, y - h], [x + w, y - h], [x + w, y + h], [x - w, y + h]])
            }
            Self::Polygon { points_mm } => {
                points(points_mm)?;
                Curve::polygon(points_mm)
            }
            Self::Smooth { points_mm } => {
                points(points_mm)?;
                Curve::smooth(points_mm)
            }
        })
    }
}

/// Whether the open segments cross or touch. Neighbours that share an end are the caller's to leave out.
fn segments_cross(a: Point, b: Point, c: Point, d: Point) -> bool {
    let (d1, d2) = (cross(c, d, a), cross(c, d, b));
    let (d3, d4) = (cross(a, b, c), cross(a, b, d));
    if d1 * d2 < 0.0 && d3 * d4 < 0.0 {
        return true;
    }
    let on = |p: Point, q: Point, r: Point, area: f64| {
        area == 0.0
            && r[0] >= p[0].min(q[0])
            && r[0] <= p[0].max(q[0])
            && r[1] >= p[1].min(q[1])
            && r[1] <= p[1].max(q[1])
    };
    on(c, d, a, d1) || on(c, d, b, d2) || on(a, b, c, d3) || on(a, b, d, d4)
}

/// The first pair of polyline segments of the two rings that cross; `same` when they are one ring.
fn first_crossing(a: &Curve, b: &Curve, same: bool) -> Option<(usize, usize)> {
    let (p, q) = (a.polyline(), b.polyline());
    let (n, m) = (p.len(), q.len());
    for i in 0..n {
        let (p0, p1) = (p[i], p[(i + 1) % n]);
        let (low_x, high_x) = (p0[0].min(p1[0]), p0[0].max(p1[0]));
        let first = if same { i + 1 } else { 0 };
        for j in first..m {
            if same && (j == i + 1 || (i == 0 && j == n - 1)) {
                continue;
            }
            let (q0, q1) = (q[j], q[(j + 1) % m]);
            if q0[0].max(q1[0]) < low_x || q0[0].min(q1[0]) > high_x {
                continue;
            }
            if segments_cross(p0, p1, q0, q1) {
                return Some((a.piece_of_segment(i), b.piece_of_segment(j)));
            }
        }
    }
    None
}

impl Geometry {
    /// Checks a sheet and lays out its rings.
    ///
    /// # Errors
    /// [`GeometryError`] names the electrode or the segment and says what to do.
    pub fn new(sheet: &Sheet) -> Result<Self, GeometryError> {
        let resistance = || "the sheet resistance (ohm per square)".to_owned();
        within(
            resistance,
            positive(resistance, sheet.sheet_resistance_ohm)?,
            RESISTANCES_OHM,
        )?;
        let name = |k: usize| {
            if k == 0 {
                "the outline".to_owned()
            } else {
                format!("hole {}", k - 1)
            }
        };
        let mut rings = Vec::new();
        for (k, outline) in std::iter::once(&sheet.outline).chain(&sheet.holes).enumerate() {
            rings.push(outline.curve(&name(k))?);
            few_enough(rings.iter().map(|r: &Curve| r.polyline().len()).sum())?;
        }
        for i in 0..rings.len() {
            for j in i..rings.len() {
                // A circle cannot cross itself.
                if i == j && rings[i].is_circle() {
                    continue;
                }
                if let Some((segment, other_segment)) = first_crossing(&rings[i], &rings[j], i == j) {
                    return Err(GeometryError::Crossing {
                        ring: name(i),
                        segment,
                        other: name(j),
                        other_segment,
                    });
                }
            }
        }
        for (k, ring) in rings.iter().enumerate() {
            if ring.area() < LEAST_AREA * ring.length() * ring.length() {
                return Err(GeometryError::Flat { ring: name(k) });
            }
        }
        for i in 1..rings.len() {
            let p = rings[i].point(0.0);
            let in_other_hole = (1..rings.len()).any(|j| j != i && rings[j].contains(p));
            if !rings[0].contains(p) || in_other_hole {
                return Err(GeometryError::HoleOutside { ring: name(i) });
            }
        }
        let rims = rings.len();
        let mut geometry = Self {
            rings,
            spans: Vec::new(),
            rims,
        };
        if sheet.electrodes.len() < 2 {
            return Err(GeometryError::TooFewElectrodes {
                count: sheet.electrodes.len(),
            });
        }
        for (l, electrode) in sheet.electrodes.iter().enumerate() {
            let contact = || format!("the contact of electrode {} (mm of sheet)", l + 1);
            within(contact, positive(contact, electrode.contact_mm)?, CONTACTS_MM)?;
            geometry.place(l, electrode.place)?;
        }
        geometry.check_overlaps()?;
        Ok(geometry)
    }

    fn place(&mut self, electrode: usize, place: Place) -> Result<(), GeometryError> {
        let width = |w: f64| length(|| format!("the width of electrode {} (mm)", electrode + 1), w);
        let (ring, centre, width_mm) = match place {
            Place::Angle { angle_deg, width_mm } => {
                finite(
                    || format!("the angle of electrode {} (degrees)", electrode + 1),
                    angle_deg,
                )?;
                (0, self.arc_at_angle(angle_deg), width(width_mm)?)
            }
            Place::Arc { arc_mm, width_mm } => {
                coordinate(
                    || format!("the arc position of electrode {} (mm)", electrode + 1),
                    arc_mm,
                )?;
                (0, arc_mm, width(width_mm)?)
            }
            Place::Point { point_mm, width_mm } => {
                let width_mm = width(width_mm)?;
                for value in point_mm {
                    coordinate(|| format!("the place of electrode {} (mm)", electrode + 1), value)?;
                }
                let (ring, (s, off)) = self.rings[..self.rims]
                    .iter()
                    .map(|r| r.nearest(point_mm))
                    .enumerate()
                    .min_by(|a, b| a.1.1.total_cmp(&b.1.1))
                    .unwrap_or((0, (0.0, f64::INFINITY)));
                if off > 0.01 * width_mm {
                    return Err(GeometryError::OffTheRim {
                        electrode,
                        distance_mm: off,
                    });
                }
                (ring, s, width_mm)
            }
            Place::Inside { centre_mm, radius_mm } => {
                length(|| format!("the radius of electrode {} (mm)", electrode + 1), radius_mm)?;
                for value in centre_mm {
                    coordinate(|| format!("the place of electrode {} (mm)", electrode + 1), value)?;
                }
                let clear = self.rings[..self.rims]
                    .iter()
                    .all(|r| r.nearest(centre_mm).1 > radius_mm);
                let inside = self.rings[0].contains(centre_mm)
                    && !self.rings[1..self.rims].iter().any(|r| r.contains(centre_mm));
                if !(clear && inside) {
                    return Err(GeometryError::NotInside { electrode });
                }
                let ring = Curve::circle(centre_mm, radius_mm);
                self.spans.push(Span {
                    ring: self.rings.len(),
                    start: 0.0,
                    length: ring.length(),
                    whole: true,
                });
                self.rings.push(ring);
                return Ok(());
            }
        };
        let rim_mm = self.rings[ring].length();
        if width_mm >= rim_mm {
            return Err(GeometryError::TooWide {
                electrode,
                width_mm,
                rim_mm,
            });
        }
        self.spans.push(Span {
            ring,
            start: (centre - 0.5 * width_mm).rem_euclid(rim_mm),
            length: width_mm,
            whole: false,
        });
        Ok(())
    }

    /// Arc length of the outline where the ray from the centre of its bounding box leaves it for the last time.
    fn arc_at_angle(&self, angle_deg: f64) -> f64 {
        let rim = &self.rings[0];
        if rim.is_circle() {
            // The arc length in units of the radius is the angle.
            return angle_deg.to_radians().rem_euclid(std::f64::consts::TAU) * rim.length() / std::f64::consts::TAU;
        }
        let (low, high) = self.bounding_box();
        let c = [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])];
        let direction = [libm::cos(angle_deg.to_radians()), libm::sin(angle_deg.to_radians())];
        let points = rim.polyline();
        let far = distance(low, high);
        let mut best: Option<(f64, Point)> = None;
        for k in 0..points.len() {
            let (a, b) = (points[k], points[(k + 1) % points.len()]);
            let (ax, ay) = (a[0] - c[0], a[1] - c[1]);
            let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
            let det = dx * direction[1] - dy * direction[0];
            if det.abs() <= f64::EPSILON * far {
                continue;
            }
            let along = (dx * ay - dy * ax) / det;
            let t = (direction[0] * ay - direction[1] * ax) / det;
            if (-1e-12..=1.0 + 1e-12).contains(&t) && along > 0.0 && best.is_none_or(|(r, _)| along > r) {
                best = Some((along, [c[0] + along * direction[0], c[1] + along * direction[1]]));
            }
        }
        // The nearest point of the curve to where the ray meets the polyline.
        let p = best.map_or([c[0] + far * direction[0], c[1] + far * direction[1]], |(_, p)| p);
        rim.nearest(p).0
    }

    fn check_overlaps(&self) -> Result<(), GeometryError> {
        for (first, a) in self.spans.iter().enumerate() {
            for (second, b) in self.spans.iter().enumerate().skip(first + 1) {
                let overlap = if a.whole && b.whole {
                    let (ca, cb) = (self.ring_centre(a.ring), self.ring_centre(b.ring));
                    distance(ca.0, cb.0) <= ca.1 + cb.1
                } else if a.ring == b.ring {
                    let length = self.rings[a.ring].length();
                    (b.start - a.start).rem_euclid(length) <= a.length
                        || (a.start - b.start).rem_euclid(length) <= b.length
                } else {
                    false
                };
                if overlap {
                    return Err(GeometryError::Overlap { first, second });
                }
            }
        }
        Ok(())
    }

    fn ring_centre(&self, ring: usize) -> (Point, f64) {
        let c = &self.rings[ring];
        let (a, b) = (c.point(0.0), c.point(0.5 * c.length()));
        ([0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])], 0.5 * distance(a, b))
    }

    /// Lower left and upper right corner of the outline's bounding box, mm.
    pub fn bounding_box(&self) -> (Point, Point) {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for p in self.rings[0].polyline() {
            for k in 0..2 {
                low[k] = low[k].min(p[k]);
                high[k] = high[k].max(p[k]);
            }
        }
        (low, high)
    }

    /// Whether a point (mm) is on the sheet: inside the outline, in no hole and under no electrode inside.
    pub fn contains(&self, p: Point) -> bool {
        self.rings[0].contains(p) && !self.rings[1..].iter().any(|r| r.contains(p))
    }

    /// Whether any of a disc (mm) is on the sheet.
    pub fn reaches(&self, centre: Point, radius_mm: f64) -> bool {
        self.contains(centre) || self.rings.iter().any(|r| r.nearest(centre).1 < radius_mm)
    }

    /// Whether a circle lies on the sheet and reaches no rim.
    pub fn is_clear(&self, centre: Point, radius_mm: f64) -> bool {
        self.contains(centre) && self.rings.iter().all(|r| r.nearest(centre).1 > radius_mm)
    }

    /// The outer rim.
    pub fn outline(&self) -> &Curve {
        &self.rings[0]
    }

    /// Centre of every electrode, mm: the middle of its stretch of rim, or the centre of its disc.
    pub fn electrode_centres(&self) -> Vec<Point> {
        self.spans
            .iter()
            .map(|s| {
                if s.whole {
                    self.ring_centre(s.ring).0
                } else {
                    self.rings[s.ring].point(s.start + 0.5 * s.length)
                }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests;
