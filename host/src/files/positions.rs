//! What a robot, a printer or a gauge wrote down: times with positions, forces, or both; a line a press, or many lines a second.

use crate::files::columns::{self, Columns};
use crate::files::malformed::FileError;
use std::path::Path;

/// Names of the columns. Robots and gauges name them in many ways.
const TIME: [&str; 3] = ["t_s", "time_s", "t"];
const X: [&str; 2] = ["x_mm", "x"];
const Y: [&str; 2] = ["y_mm", "y"];
const FORCE: [&str; 2] = ["force_n", "force"];
/// Part of the largest force from which a line of a dense list is one of a press.
const PRESSED: f64 = 0.2;
/// Part of a press's largest force from which its lines tell its force: the rest is its way down and up.
const HELD: f64 = 0.8;

/// A line.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    line: u64,
    time_s: f64,
    place_mm: Option<[f64; 2]>,
    force_n: Option<f64>,
}

/// A press as such a list tells it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Listed {
    /// Line of the file where it begins, from 1.
    pub line: u64,
    /// When it begins and ends, by the list's clock, s; the same where there is one line for it.
    pub from_s: f64,
    pub to_s: f64,
    /// Its place, mm.
    pub place_mm: Option<[f64; 2]>,
    /// Its force, N.
    pub force_n: Option<f64>,
}

/// Reads a CSV with a time (`t_s`, `time_s` or `t`), and a position (`x_mm`, `y_mm` or `x`, `y`), a force (`force_n` or `force`) or both. Where forces
/// come and go it has many lines a press, and presses are where a force is; else every line is a press.
///
/// # Errors
/// [`FileError`] with line and column.
pub(crate) fn read(path: &Path) -> Result<Vec<Listed>, FileError> {
    columns::read(path, parse)
}

/// The same from text; `file` is its name in messages.
///
/// # Errors
/// As for [`read`].
pub(crate) fn parse(file: &str, text: &str) -> Result<Vec<Listed>, FileError> {
    Ok(presses(&rows(&Columns::parse(file, text)?)?))
}

/// Reads what a force gauge wrote: a time and a force in every line, whatever else is beside them. Every line is a reading: time (s)
/// and force (N).
///
/// # Errors
/// [`FileError`] with line and column.
pub(crate) fn readings(path: &Path) -> Result<Vec<[f64; 2]>, FileError> {
    columns::read(path, parse_readings)
}

fn parse_readings(file: &str, text: &str) -> Result<Vec<[f64; 2]>, FileError> {
    let list = gauge_rows(&Columns::parse(file, text)?)?;
    Ok(list.iter().filter_map(|row| Some([row.time_s, row.force_n?])).collect())
}

/// The presses in what a force gauge wrote, read as by [`readings`].
///
/// # Errors
/// As for [`readings`].
pub(crate) fn gauge_presses(path: &Path) -> Result<Vec<Listed>, FileError> {
    columns::read(path, |file, text| {
        Ok(presses(&gauge_rows(&Columns::parse(file, text)?)?))
    })
}

/// Lines that all have a force.
fn gauge_rows(columns: &Columns) -> Result<Vec<Row>, FileError> {
    if columns.find(&FORCE).is_none() {
        return Err(columns.missing(FORCE[0], "a column force_n or force"));
    }
    rows(columns)
}

fn rows(columns: &Columns) -> Result<Vec<Row>, FileError> {
    let missing = |name, what| columns.missing(name, what);
    let time = columns
        .find(&TIME)
        .ok_or_else(|| missing(TIME[0], "a column t_s, time_s or t"))?;
    let place = match (columns.find(&X), columns.find(&Y)) {
        (Some(x), Some(y)) => Some([x, y]),
        (None, None) => None,
        (Some(_), None) => return Err(missing(Y[0], "a column y_mm or y beside that of x")),
        (None, Some(_)) => return Err(missing(X[0], "a column x_mm or x beside that of y")),
    };
    let force = columns.find(&FORCE);
    if place.is_none() && force.is_none() {
        return Err(missing(X[0], "positions (x_mm, y_mm), forces (force_n) or both"));
    }
    let mut list: Vec<Row> = Vec::new();
    for line in columns.lines() {
        let number = |column: usize, name: &str| line.value(column, name, "a finite number");
        let time_s = number(time, TIME[0])?;
        if list.last().is_some_and(|before| time_s < before.time_s) {
            let wanted = "a time that is not before the last";
            return Err(line.malformed(TIME[0], wanted, &time_s.to_string()));
        }
        list.push(Row {
            line: line.number(),
            time_s,
            place_mm: match place {
                Some([x, y]) => Some([number(x, X[0])?, number(y, Y[0])?]),
                None => None,
            },
            force_n: force.map(|c| number(c, FORCE[0])).transpose()?,
        });
    }
    Ok(list)
}

/// The presses of lines in order of time.
fn presses(rows: &[Row]) -> Vec<Listed> {
    let forces = || rows.iter().filter_map(|r| r.force_n);
    let largest = forces().fold(0.0, f64::max);
    let dense = forces().any(|f| f < PRESSED * largest);
    if !dense {
        let one = |r: &Row| Listed {
            line: r.line,
            from_s: r.time_s,
            to_s: r.time_s,
            place_mm: r.place_mm,
            force_n: r.force_n,
        };
        return rows.iter().map(one).collect();
    }
    let pressed = |r: &Row| r.force_n.is_some_and(|f| f >= PRESSED * largest);
    let groups = rows.chunk_by(|a, b| pressed(a) == pressed(b));
    groups.filter(|group| pressed(&group[0])).map(of_group).collect()
}

/// A press that is many lines.
fn of_group(group: &[Row]) -> Listed {
    let peak = group.iter().filter_map(|r| r.force_n).fold(0.0, f64::max);
    let held: Vec<&Row> = group
        .iter()
        .filter(|r| r.force_n.is_some_and(|f| f >= HELD * peak))
        .collect();
    let mean = |of: &dyn Fn(&Row) -> Option<f64>| {
        let values: Vec<f64> = held.iter().filter_map(|r| of(r)).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    let at = |axis: usize| mean(&|r| r.place_mm.map(|p| p[axis]));
    Listed {
        line: group[0].line,
        from_s: group[0].time_s,
        to_s: group[group.len() - 1].time_s,
        place_mm: at(0).zip(at(1)).map(|(x, y)| [x, y]),
        force_n: mean(&|r| r.force_n),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_a_press_and_many_lines_a_press_say_the_same() {
        let sparse = parse("l", "# robot\nt,x,y,force\n10,1.5,-2,8\n14,30,4,9\n").unwrap();
        assert_eq!(sparse[1].place_mm, Some([30.0, 4.0]));
        let mut dense = "time_s,x_mm,y_mm,force_n\n".to_owned();
        for k in 0..200 {
            let t = 8.0 + 0.05 * f64::from(k);
            let (place, force) = match t {
                t if (10.0..11.0).contains(&t) => ("1.5,-2", 8.0),
                t if (14.0..15.0).contains(&t) => ("30,4", 9.0),
                _ => ("0,0", 0.0),
            };
            dense += &format!("{t},{place},{force}\n");
        }
        let dense = parse("l", &dense).unwrap();
        assert_eq!(dense.len(), 2);
        for (a, b) in sparse.iter().zip(&dense) {
            assert_eq!((a.place_mm, a.force_n), (b.place_mm, b.force_n));
            assert!(
                (a.from_s - b.from_s).abs() < 0.06 && (b.to_s - b.from_s - 0.95).abs() < 0.06,
                "{b:?}"
            );
        }
    }

    #[test]
    fn a_gauge_alone_has_forces_and_no_places() {
        let list = parse("g", "t_s,force_n\n0,0.01\n1,5\n1.1,5\n2,-0.02\n").unwrap();
        assert_eq!(list.len(), 1);
        assert_eq!((list[0].place_mm, list[0].force_n, list[0].line), (None, Some(5.0), 3));
    }

    /// A gauge that writes faster than its clock ticks has the same time in lines one after another.
    #[test]
    fn readings_of_a_gauge_may_share_a_time_and_never_go_back() {
        let text = "# bench\nforce_n,time_s,note\n0,0.5,a\n2.5,1,b\n3,1,c\n0,2,d\n";
        assert_eq!(
            parse_readings("g", text).unwrap(),
            [[0.5, 0.0], [1.0, 2.5], [1.0, 3.0], [2.0, 0.0]]
        );
        assert_eq!(parse("g", text).unwrap().len(), 1);
        for (text, words) in [
            ("time_s\n1\n", ["g:1", "force_n"]),
            ("t,x,y\n1,2,3\n", ["g:1", "force_n"]),
            ("time_s,force_n\n1,x\n", ["g:2", "force_n"]),
            ("time_s,force_n\n1,0\n0.5,0\n", ["g:3", "not before"]),
        ] {
            let why = parse_readings("g", text).unwrap_err().to_string();
            assert!(words.iter().all(|w| why.contains(w)), "{why}");
        }
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        for (text, words) in [
            ("x,y\n1,2\n", ["l:1", "t_s"]),
            ("t,x\n1,2\n", ["l:1", "y_mm"]),
            ("t\n1\n", ["l:1", "force_n"]),
            ("t,x,y\n1,2,3\n0,2,3\n", ["l:3", "not before"]),
            ("t,x,y\n1,far,3\n", ["l:2", "'far'"]),
            ("t,x,y\n1,2\n", ["l:2", "header"]),
        ] {
            let said = parse("l", text).unwrap_err().to_string();
            assert!(words.iter().all(|w| said.contains(w)), "{said}");
        }
    }
}
