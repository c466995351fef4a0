//! `skin calibrate gcode`: a 3D printer as the robot that presses.

use super::marks::{Which, write};
use crate::number;
use ::forward::Geometry;
use anyhow::{Result, bail};
use clap::Args;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// How its lists of positions begin.
const OWN: &str = "# skin calibrate gcode:";

/// Arguments of `skin calibrate gcode`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    which: Which,
    /// Where the middle of the sheet is on the printer's bed, mm.
    #[arg(long, value_name = "X,Y", value_parser = place, default_value = "110,110")]
    origin_mm: [f64; 2],
    /// By how much the sheet's x axis is turned on the bed, degrees counter-clockwise as seen from above.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, default_value_t = 0.0, value_parser = number::allowed("an angle in degrees", |_| true))]
    turn_deg: f64,
    /// Height of the printer's Z at which the tip just touches the sheet, mm.
    #[arg(long, value_name = "MM", default_value_t = 20.0, value_parser = number::positive("a height in millimetres above 0"))]
    touch_z_mm: f64,
    /// How deep to press, mm.
    #[arg(long, value_name = "MM", default_value_t = 1.5, value_parser = number::positive("a depth in millimetres above 0"))]
    depth_mm: f64,
    /// Height above the sheet between presses, mm: more than anything that stands on it.
    #[arg(long, value_name = "MM", default_value_t = 10.0, value_parser = number::positive("a height in millimetres above 0"))]
    lift_mm: f64,
    /// How long a press is held, s.
    #[arg(long, value_name = "S", default_value_t = 1.5, value_parser = number::positive("a time in seconds above 0"))]
    dwell_s: f64,
    /// How long the sheet rests before each press, s.
    #[arg(long, value_name = "S", default_value_t = 1.5, value_parser = number::positive("a time in seconds above 0"))]
    pause_s: f64,
    /// Speed from mark to mark, mm/s.
    #[arg(long, value_name = "MM/S", default_value_t = 60.0, value_parser = number::positive("a speed above 0"))]
    travel_mm_s: f64,
    /// Speed down and up, mm/s.
    #[arg(long, value_name = "MM/S", default_value_t = 10.0, value_parser = number::positive("a speed above 0"))]
    press_mm_s: f64,
    /// Size of the bed, mm: no position may leave it.
    #[arg(long, value_name = "X,Y", value_parser = place, default_value = "220,220")]
    bed_mm: [f64; 2],
    /// Writes the G-code into this file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Writes when and where it presses, for skin calibrate presses --positions [default: the same name with .csv].
    #[arg(long, value_name = "FILE")]
    positions: Option<PathBuf>,
}

fn place(text: &str) -> Result<[f64; 2], String> {
    let parsed = text.split_once(',').and_then(|(x, y)| {
        let [x, y]: [f64; 2] = [x.trim().parse().ok()?, y.trim().parse().ok()?];
        (x.is_finite() && y.is_finite()).then_some([x, y])
    });
    parsed.ok_or_else(|| "give two numbers in millimetres, such as 110,110".to_owned())
}

/// Runs the command.
///
/// # Errors
/// A position that is not on the bed, a file that cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let positions = arguments
        .positions
        .clone()
        .unwrap_or_else(|| arguments.out.with_extension("csv"));
    if positions == arguments.out {
        bail!(
            "{}: the G-code and the list of positions need two files",
            positions.display()
        );
    }
    // Nobody named it: a list of this command may be made again, anything else is kept.
    if arguments.positions.is_none() && positions.exists() && !is_own(&positions) {
        bail!(
            "{}: there already, and no list of skin calibrate gcode; name the list of positions with --positions",
            positions.display()
        );
    }
    let (sheet, marks) = arguments.which.marks()?;
    let (low, high) = Geometry::new(&sheet)?.bounding_box();
    let middle = [0, 1].map(|k| 0.5 * (low[k] + high[k]));
    let (code, list) = program(arguments, middle, &marks)?;
    write(&arguments.out, &code)?;
    write(&positions, &list)?;
    eprintln!(
        "{}: written, {} presses; {}: when and where, for skin calibrate presses --positions",
        arguments.out.display(),
        marks.len(),
        positions.display()
    );
    Ok(())
}

/// Whether a list of positions is one that this command wrote.
fn is_own(path: &Path) -> bool {
    std::fs::read(path).is_ok_and(|bytes| bytes.starts_with(OWN.as_bytes()))
}

/// The G-code and the list of positions. Times count from the first command; those of the printer's accelerations are not in them.
fn program(a: &Arguments, middle: [f64; 2], marks: &[[f64; 2]]) -> Result<(String, String)> {
    let (sin, cos) = a.turn_deg.to_radians().sin_cos();
    let on_bed = |[x, y]: [f64; 2]| {
        let [x, y] = [x - middle[0], y - middle[1]];
        [a.origin_mm[0] + cos * x - sin * y, a.origin_mm[1] + sin * x + cos * y]
    };
    let (safe, down) = (a.touch_z_mm + a.lift_mm, a.touch_z_mm - a.depth_mm);
    if down < 0.0 {
        bail!(
            "--touch-z-mm {} less --depth-mm {} is below the bed; measure the height at which the tip touches the sheet",
            a.touch_z_mm,
            a.depth_mm
        );
    }
    let feed = |mm_s: f64| 60.0 * mm_s;
    // Writing to a text cannot fail.
    let mut code = String::new();
    let _ = write!(
        code,
        "; skin calibrate gcode: {} presses of {} mm for {} s\n\
         ; The tip (radius {} mm) is on the tool. The sheet's middle is at X{:.2} Y{:.2}, its x axis turned by {} degrees.\n\
         ; The tip touches the sheet at Z{:.2}. Between presses it is at Z{safe:.2}.\n\
         ; BEFORE: home the printer with no sheet on the bed, fix the sheet, drive the tip by hand to its middle and check Z.\n\
         ; Heaters stay off. Keep a hand at the switch at the first press.\n\
         ; Start skin calibrate presses --positions with the list of this run before, this program then.\n",
        marks.len(),
        a.depth_mm,
        a.dwell_s,
        a.which.tip_mm,
        a.origin_mm[0],
        a.origin_mm[1],
        a.turn_deg,
        a.touch_z_mm,
    );
    let _ = write!(
        code,
        "G21 ; millimetres\nG90 ; absolute positions\nM104 S0\nM140 S0\nG0 Z{safe:.2} F{:.0}\nG4 P{:.0}\n",
        feed(a.press_mm_s),
        1000.0 * a.pause_s
    );
    let mut list = format!(
        "{OWN} when each press is down, by the printer's clock from its first command, and where\n# depth {} mm, held for {} s\nt_s,x_mm,y_mm\n",
        a.depth_mm, a.dwell_s
    );
    let (mut time_s, mut at) = (a.pause_s, a.origin_mm);
    for (k, mark) in marks.iter().enumerate() {
        let [x, y] = on_bed(*mark);
        if !(0.0..=a.bed_mm[0]).contains(&x) || !(0.0..=a.bed_mm[1]).contains(&y) {
            bail!(
                "mark {} at {:.1}, {:.1} mm would be at X{x:.1} Y{y:.1}, off the bed of {} x {} mm; say where the sheet is with --origin-mm, and how large the \
                 bed is with --bed-mm",
                k + 1,
                mark[0],
                mark[1],
                a.bed_mm[0],
                a.bed_mm[1]
            );
        }
        let _ = write!(
            code,
            "; press {} of {}: x {:.1}, y {:.1} mm on the sheet\nM117 press {} of {}\nG0 X{x:.2} Y{y:.2} F{:.0}\nM400\nG4 P{:.0}\n\
             G1 Z{down:.2} F{:.0}\nM400\nG4 P{:.0}\nG1 Z{safe:.2} F{:.0}\nM400\n",
            k + 1,
            marks.len(),
            mark[0],
            mark[1],
            k + 1,
            marks.len(),
            feed(a.travel_mm_s),
            1000.0 * a.pause_s,
            feed(a.press_mm_s),
            1000.0 * a.dwell_s,
            feed(a.press_mm_s),
        );
        let way_s = (safe - down) / a.press_mm_s;
        time_s += (x - at[0]).hypot(y - at[1]) / a.travel_mm_s + a.pause_s + way_s;
        let _ = writeln!(list, "{time_s:.3},{:.3},{:.3}", mark[0], mark[1]);
        time_s += a.dwell_s + way_s;
        at = [x, y];
    }
    let _ = writeln!(
        code,
        "G0 Z{:.2} F{:.0}\nM117 done\nM84",
        safe + a.lift_mm,
        feed(a.press_mm_s)
    );
    Ok((code, list))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn arguments(more: &[&str]) -> Arguments {
        Line::parse_from(["gcode", "--out", "x.gcode"].iter().chain(more)).arguments
    }

    /// Follows G-code as a printer does: where it is down, and when, s.
    fn followed(code: &str, touch_z: f64) -> Vec<([f64; 3], f64)> {
        let (mut at, mut time_s, mut feed) = ([f64::NAN; 3], 0.0, f64::NAN);
        let mut down = Vec::new();
        for line in code.lines().map(|l| l.split(';').next().unwrap().trim()) {
            let words: Vec<&str> = line.split_whitespace().collect();
            let number = |letter: char| words.iter().find_map(|w| w.strip_prefix(letter)?.parse::<f64>().ok());
            match words.first() {
                Some(&"G0" | &"G1") => {
                    feed = number('F').unwrap_or(feed);
                    let before = at;
                    for (axis, letter) in ['X', 'Y', 'Z'].into_iter().enumerate() {
                        at[axis] = number(letter).unwrap_or(at[axis]);
                    }
                    // Nothing moves sideways while it is down.
                    assert!(
                        before[2].is_nan() || before[2] > touch_z || before[..2] == at[..2],
                        "{line}"
                    );
                    let way: f64 = (0..3)
                        .map(|k| (at[k] - before[k]).powi(2))
                        .filter(|d| d.is_finite())
                        .sum();
                    time_s += way.sqrt() / (feed / 60.0);
                    if at[2] < touch_z {
                        down.push((at, time_s));
                    }
                }
                Some(&"G4") => time_s += number('P').unwrap() / 1000.0,
                _ => {}
            }
        }
        down
    }

    #[test]
    fn what_a_printer_presses_are_the_marks_at_the_times_of_the_list() {
        for turn_deg in [0.0, 30.0] {
            let a = arguments(&[
                "--turn-deg",
                &turn_deg.to_string(),
                "--count",
                "12",
                "--bed-mm",
                "250,250",
                "--origin-mm",
                "120,125",
            ]);
            let (_, marks) = a.which.marks().unwrap();
            let (code, list) = program(&a, [0.0; 2], &marks).unwrap();
            let down = followed(&code, a.touch_z_mm);
            let row = |line: &str| line.split(',').map(|v| v.parse().unwrap()).collect::<Vec<f64>>();
            let listed: Vec<Vec<f64>> = list.lines().filter(|l| !l.starts_with('#')).skip(1).map(row).collect();
            assert_eq!((down.len(), listed.len()), (12, 12));
            let (sin, cos) = f64::to_radians(-turn_deg).sin_cos();
            // The way to the first mark begins somewhere that the list takes for the middle.
            let shift_s = listed[0][0] - down[0].1;
            for (((place, time_s), listed), mark) in down.iter().zip(&listed).zip(&marks) {
                let [x, y] = [place[0] - 120.0, place[1] - 125.0];
                let back = [cos * x - sin * y, sin * x + cos * y];
                assert!((back[0] - mark[0]).hypot(back[1] - mark[1]) < 0.02, "{back:?} {mark:?}");
                assert!((place[2] - (a.touch_z_mm - a.depth_mm)).abs() < 1e-9);
                assert_eq!(listed[1..], *mark);
                assert!((time_s + shift_s - listed[0]).abs() < 0.02, "{time_s} {listed:?}");
            }
        }
    }

    #[test]
    fn what_leaves_the_bed_is_refused() {
        let (_, marks) = arguments(&[]).which.marks().unwrap();
        let said = |more: &[&str]| program(&arguments(more), [0.0; 2], &marks).unwrap_err().to_string();
        let off = said(&["--origin-mm", "50,110"]);
        assert!(off.contains("off the bed") && off.contains("--origin-mm"), "{off}");
        let below = said(&["--touch-z-mm", "1", "--depth-mm", "2"]);
        assert!(below.contains("below the bed"), "{below}");
    }
}
