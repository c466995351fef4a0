//! `skin calibrate marks`: where to press, as a list and as a drawing to print at true scale.

use crate::files::replace::replace;
use crate::{number, sheet};
use ::forward::{Geometry, Sheet};
use anyhow::{Context, Result, bail};
use clap::Args;
use clap::builder::RangedU64ValueParser;
use inverse::learned::Marks;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Room around the sheet in the drawing, mm: electrodes and their numbers.
const ROOM_MM: f64 = 14.0;
/// Room below for the ruler and what is said, mm.
const FOOT_MM: f64 = 16.0;
/// Length of the ruler by which a print is checked, mm: the longest of these that fits.
const RULERS_MM: [f64; 4] = [100.0, 50.0, 20.0, 10.0];

/// What a list of marks is asked for, here and for G-code.
#[derive(Debug, Args)]
pub(crate) struct Which {
    /// The sheet, a TOML file as for `skin forward` [default: the paper's disc].
    #[arg(long, value_name = "FILE")]
    pub(crate) sheet: Option<PathBuf>,
    /// How many marks.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = RangedU64ValueParser::<usize>::new().range(1..=2000))]
    pub(crate) count: usize,
    /// Radius of what presses, mm: marks are at least that far from the rim.
    #[arg(long, value_name = "MM", default_value_t = 6.0, value_parser = number::positive("a radius in millimetres above 0"))]
    pub(crate) tip_mm: f64,
}

impl Which {
    /// The sheet and its marks.
    ///
    /// # Errors
    /// The sheet makes no sense, or is smaller than the tip.
    pub(crate) fn marks(&self) -> Result<(Sheet, Vec<[f64; 2]>)> {
        let (sheet, _) = sheet::load(self.sheet.as_deref())?;
        let tenths = |p: [f64; 2]| p.map(|v| (10.0 * v).round() / 10.0 + 0.0);
        let list: Vec<[f64; 2]> = Marks::new(&sheet, self.tip_mm)?
            .list(self.count)
            .into_iter()
            .map(tenths)
            .collect();
        if list.is_empty() {
            bail!(
                "nothing of {} mm radius fits on the sheet; give a smaller one with --tip-mm",
                self.tip_mm
            );
        }
        if list.len() < self.count {
            eprintln!(
                "notice: the sheet has {} different marks, not {}",
                list.len(),
                self.count
            );
        }
        Ok((sheet, list))
    }
}

/// Arguments of `skin calibrate marks`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    which: Which,
    /// Writes a drawing at true scale, in millimetres, with electrode 1 marked: print it at 100 %.
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Writes the list into a file, for skin calibrate presses --marks [default: stdout].
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// The sheet cannot be read, or a file not be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    if let Some(path) = arguments.svg.as_ref().filter(|svg| arguments.csv.as_ref() == Some(svg)) {
        bail!("{}: the drawing and the list need two files", path.display());
    }
    let (sheet, marks) = arguments.which.marks()?;
    let geometry = Geometry::new(&sheet)?;
    let mut list = "mark,x_mm,y_mm,where\n".to_owned();
    for (k, mark) in marks.iter().enumerate() {
        let [x, y] = mark;
        // Writing to a text cannot fail.
        let _ = writeln!(list, "{},{x:.1},{y:.1},\"{}\"", k + 1, words(&geometry, *mark));
    }
    if let Some(path) = &arguments.svg {
        write(path, &svg(&geometry, &marks, arguments.which.tip_mm))?;
        eprintln!("{}: written; print it at 100 %, and check the ruler", path.display());
    }
    match &arguments.csv {
        Some(path) => write(path, &list)?,
        None => crate::say::stdout().write_all(list.as_bytes())?,
    }
    Ok(())
}

/// A place in words: how far from the middle, towards which electrode, how far from the rim.
pub(crate) fn words(geometry: &Geometry, place_mm: [f64; 2]) -> String {
    let (low, high) = geometry.bounding_box();
    let middle = [0, 1].map(|k| 0.5 * (low[k] + high[k]));
    let [x, y] = [0, 1].map(|k| place_mm[k] - middle[k]);
    let from_middle = x.hypot(y);
    let rim = geometry.outline().nearest(place_mm).1;
    let centres = geometry.electrode_centres();
    // Of the electrodes that whose way from the middle turns least from that to the place.
    let towards = |c: &[f64; 2]| {
        let [u, v] = [0, 1].map(|k| c[k] - middle[k]);
        (x * u + y * v) / u.hypot(v).max(f64::MIN_POSITIVE)
    };
    let electrode = (0..centres.len()).max_by(|a, b| towards(&centres[*a]).total_cmp(&towards(&centres[*b])));
    let at = format!("x {:.1}, y {:.1} mm", place_mm[0] + 0.0, place_mm[1] + 0.0);
    match electrode {
        Some(k) if from_middle >= 1.0 => format!(
            "{at}: {from_middle:.0} mm from the middle towards electrode {}, {rim:.0} mm from the rim",
            k + 1
        ),
        _ => format!("{at}: the middle"),
    }
}

/// Writes a text in place of what was there, as a whole or not at all.
///
/// # Errors
/// It cannot be written.
pub(crate) fn write(path: &Path, text: &str) -> Result<()> {
    replace(path, |file| file.write_all(text.as_bytes()))
        .with_context(|| format!("{}: cannot be written", path.display()))
}

/// The drawing. Its y goes down, that of the sheet up.
fn svg(geometry: &Geometry, marks: &[[f64; 2]], tip_mm: f64) -> String {
    let (low, high) = geometry.bounding_box();
    let (left, top) = (low[0] - ROOM_MM, -high[1] - ROOM_MM);
    let width = high[0] - low[0] + 2.0 * ROOM_MM;
    let height = high[1] - low[1] + 2.0 * ROOM_MM + FOOT_MM;
    let ruler = RULERS_MM
        .into_iter()
        .find(|r| *r <= 0.8 * (high[0] - low[0]))
        .unwrap_or(10.0);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.2}mm\" height=\"{height:.2}mm\" \
         viewBox=\"{left:.2} {top:.2} {width:.2} {height:.2}\" font-family=\"sans-serif\">\n\
         <title>Marks to press, true scale: print at 100 %</title>\n"
    );
    let points = |ring: &[[f64; 2]]| -> String { ring.iter().map(|p| format!("{:.2},{:.2} ", p[0], -p[1])).collect() };
    let _ = writeln!(
        out,
        "<polygon points=\"{}\" fill=\"none\" stroke=\"black\" stroke-width=\"0.4\"/>",
        points(geometry.outline().polyline()).trim_end()
    );
    let centres = geometry.electrode_centres();
    let middle = [0, 1].map(|k| 0.5 * (low[k] + high[k]));
    for (k, c) in centres.iter().enumerate() {
        let [u, v] = [0, 1].map(|k| c[k] - middle[k]);
        let length = u.hypot(v).max(f64::MIN_POSITIVE);
        let [nx, ny] = [u / length, v / length];
        let (x, y) = (c[0], -c[1]);
        let first = k == 0;
        let (colour, radius) = (if first { "#c00000" } else { "black" }, dot_mm(k));
        let _ = writeln!(
            out,
            "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius}\" fill=\"{colour}\"/>"
        );
        let weight = if first { " font-weight=\"bold\"" } else { "" };
        let _ = writeln!(
            out,
            "<text x=\"{:.2}\" y=\"{:.2}\" font-size=\"{}\" fill=\"{colour}\"{weight} text-anchor=\"middle\" dominant-baseline=\"central\">{}</text>",
            x + 7.5 * nx,
            y - 7.5 * ny,
            if first { 6.0 } else { 4.0 },
            k + 1
        );
    }
    let arm = (0.8 * tip_mm).clamp(1.5, 4.0);
    let numbers = numbers(geometry, marks, arm);
    for (k, ([x, y], number)) in marks.iter().zip(&numbers).enumerate() {
        let y = -y;
        let _ = writeln!(
            out,
            "<g class=\"mark\" stroke=\"#0050a0\" stroke-width=\"0.25\" fill=\"none\"><circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{arm:.2}\"/>\
             <path d=\"M{:.2} {y:.2}H{:.2}M{x:.2} {:.2}V{:.2}\"/></g>\
             <text x=\"{:.2}\" y=\"{:.2}\" font-size=\"3.2\" fill=\"#0050a0\">{}</text>",
            x - arm,
            x + arm,
            y - arm,
            y + arm,
            number.low[0],
            -number.low[1],
            k + 1
        );
    }
    let foot = -low[1] + ROOM_MM + 2.0;
    let from = middle[0] - 0.5 * ruler;
    let _ = writeln!(
        out,
        "<path d=\"M{from:.2} {:.2}v3M{from:.2} {:.2}h{ruler}m0 -1.5v3\" stroke=\"black\" stroke-width=\"0.3\" fill=\"none\"/>\n\
         <text x=\"{:.2}\" y=\"{:.2}\" font-size=\"3.5\" text-anchor=\"middle\">{ruler:.0} mm: print at 100 % and check. Seen from the touched \
         side; electrode 1 is red.</text>\n</svg>",
        foot - 1.5,
        foot,
        middle[0],
        foot + 6.0
    );
    out
}

/// Radius of an electrode's dot, mm.
fn dot_mm(electrode: usize) -> f64 {
    if electrode == 0 { 2.2 } else { 1.2 }
}

/// What a mark's number covers, mm of the sheet.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Number {
    low: [f64; 2],
    high: [f64; 2],
}

impl Number {
    /// Width and height of a digit, with what is around it.
    const DIGIT_MM: [f64; 2] = [1.9, 2.6];

    /// That of a mark, right or left of it and above or below.
    fn beside([x, y]: [f64; 2], mark: usize, arm: f64, [right, up]: [bool; 2]) -> Self {
        let digits = (mark + 1).to_string().len() as f64;
        let size = [Self::DIGIT_MM[0] * digits, Self::DIGIT_MM[1]];
        let off = 0.75 * arm + 0.3;
        let low = |at: f64, after: bool, size: f64| if after { at + off } else { at - off - size };
        let low = [low(x, right, size[0]), low(y, up, size[1])];
        Self {
            low,
            high: [0, 1].map(|k| low[k] + size[k]),
        }
    }

    fn meets(&self, other: &Self) -> bool {
        (0..2).all(|k| self.low[k] < other.high[k] && other.low[k] < self.high[k])
    }

    fn meets_disc(&self, centre: [f64; 2], radius: f64) -> bool {
        let off = [0, 1].map(|k| centre[k] - centre[k].clamp(self.low[k], self.high[k]));
        off[0].hypot(off[1]) < radius
    }

    fn corners(&self) -> [[f64; 2]; 4] {
        let ([x0, y0], [x1, y1]) = (self.low, self.high);
        [[x0, y0], [x1, y0], [x0, y1], [x1, y1]]
    }

    /// On how much it lies: rim, electrodes, other marks, other numbers.
    fn lies_on(&self, geometry: &Geometry, marks: &[[f64; 2]], own: usize, arm: f64, others: &[Self]) -> usize {
        let outside = self
            .corners()
            .iter()
            .filter(|corner| !geometry.contains(**corner))
            .count();
        let electrodes = geometry.electrode_centres().into_iter().enumerate();
        let on_electrodes = electrodes
            .filter(|(k, at)| self.meets_disc(*at, dot_mm(*k) + 0.3))
            .count();
        let on_marks = marks
            .iter()
            .enumerate()
            .filter(|(k, at)| *k != own && self.meets_disc(**at, arm))
            .count();
        outside + on_electrodes + on_marks + others.iter().filter(|other| self.meets(other)).count()
    }
}

/// Where the marks' numbers go: beside the mark, where they lie on least else.
fn numbers(geometry: &Geometry, marks: &[[f64; 2]], arm: f64) -> Vec<Number> {
    let mut placed: Vec<Number> = Vec::with_capacity(marks.len());
    for (k, at) in marks.iter().enumerate() {
        let sides = [[true, true], [false, true], [true, false], [false, false]];
        let places = sides.map(|side| Number::beside(*at, k, arm, side));
        let best = places
            .into_iter()
            .min_by_key(|number| number.lies_on(geometry, marks, k, arm, &placed));
        placed.extend(best);
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The number of the mark before electrode 1 was on that.
    #[test]
    fn numbers_of_marks_lie_on_nothing() {
        let sheet = |name: &str| {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../sheets").join(name);
            sheet::load(Some(&path)).unwrap().0
        };
        for (sheet, count) in [
            (Sheet::paper(), 20),
            (Sheet::paper(), 50),
            (sheet("square.toml"), 20),
            (sheet("forearm.toml"), 20),
        ] {
            let geometry = Geometry::new(&sheet).unwrap();
            let marks: Vec<[f64; 2]> = Marks::new(&sheet, 6.0).unwrap().list(count);
            assert_eq!(marks.len(), count);
            let numbers = numbers(&geometry, &marks, 4.0);
            for (k, number) in numbers.iter().enumerate() {
                let on = number.lies_on(&geometry, &marks, k, 4.0, &numbers[..k]);
                assert_eq!(on, 0, "mark {} of {count}: {number:?}", k + 1);
            }
        }
    }

    #[test]
    fn a_drawing_is_as_large_as_the_sheet_and_its_marks_are_where_the_list_has_them() {
        let geometry = Geometry::new(&Sheet::paper()).unwrap();
        let marks = [[10.0, 20.0], [-91.5, 0.0]];
        let text = svg(&geometry, &marks, 6.0);
        // A user's unit is a millimetre.
        let head = text.lines().next().unwrap();
        let number = |name: &str| -> Vec<f64> {
            let at = head.find(&format!("{name}=\"")).unwrap() + name.len() + 2;
            let value = &head[at..at + head[at..].find('"').unwrap()];
            value
                .trim_end_matches("mm")
                .split(' ')
                .map(|v| v.parse().unwrap())
                .collect()
        };
        let (width, height, view) = (number(" width"), number(" height"), number("viewBox"));
        assert_eq!((width[0], height[0]), (view[2], view[3]));
        assert!((width[0] - 195.0 - 2.0 * ROOM_MM).abs() < 0.1);
        for [x, y] in marks {
            assert!(
                text.contains(&format!("<circle cx=\"{x:.2}\" cy=\"{:.2}\" r=\"4.00\"", -y)),
                "{text}"
            );
        }
        assert_eq!(text.matches("class=\"mark\"").count(), 2);
        // One electrode is red, at its place.
        assert_eq!(text.matches("#c00000\"/>").count(), 1);
        assert!(
            text.contains("<circle cx=\"97.50\" cy=\"-0.00\" r=\"2.2\"")
                || text.contains("<circle cx=\"97.50\" cy=\"0.00\" r=\"2.2\"")
        );
    }
}
