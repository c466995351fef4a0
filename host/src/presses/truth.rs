//! Where presses were: a CSV that names the frame of each, the frame before it, and its place.

use crate::files::before;
use crate::files::columns::{self, Columns};
use crate::files::malformed::FileError;
use std::path::Path;

/// A press in a table.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct KnownPress {
    /// Line of the file, from 1.
    pub line: u64,
    /// Its frame.
    pub frame: String,
    /// The frame just before it; none where the columns hold changes.
    pub before: Option<String>,
    /// Its place, mm.
    pub place_mm: [f64; 2],
    /// Its force, N, where it is known.
    pub force_n: Option<f64>,
}

/// Reads a CSV with the columns `frame`, `before`, `x_mm` and `y_mm`, a line a press in order of time, and perhaps `force_n`, which may be empty;
/// others are passed over.
///
/// # Errors
/// [`FileError`] with line and column.
pub(crate) fn read(path: &Path) -> Result<Vec<KnownPress>, FileError> {
    columns::read(path, parse)
}

/// Reads the text of such a list; `file` is its name in messages.
///
/// # Errors
/// As for [`read`].
pub(crate) fn parse(file: &str, text: &str) -> Result<Vec<KnownPress>, FileError> {
    let frames = before::parse(file, text)?;
    let columns = Columns::parse(file, text)?;
    let force = columns.find(&["force_n"]);
    let (x, y) = (columns.column("x_mm")?, columns.column("y_mm")?);
    let mut list = Vec::with_capacity(frames.len());
    for (frame, line) in frames.into_iter().zip(columns.lines()) {
        let place = |column, name| line.value(column, name, "a place in millimetres");
        let force_n = match force.map(|c| line.text(c)).unwrap_or_default() {
            "" => None,
            text => {
                let force = text.parse::<f64>().ok().filter(|f| f.is_finite() && *f > 0.0);
                let wanted = "a force in newtons above 0, or nothing";
                Some(force.ok_or_else(|| line.malformed("force_n", wanted, &format!("'{text}'")))?)
            }
        };
        list.push(KnownPress {
            force_n,
            line: frame.line,
            place_mm: [place(x, "x_mm")?, place(y, "y_mm")?],
            frame: frame.frame,
            before: frame.before,
        });
    }
    Ok(list)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_belong_to_their_frames_and_errors_have_theirs() {
        let list = parse(
            "t",
            "# a robot's\nframe,before,x_mm,y_mm,force_n\np0,u0,1.5,-2,3\np1,,0,4,\n",
        )
        .unwrap();
        assert_eq!((list[0].place_mm, list[0].before.as_deref()), ([1.5, -2.0], Some("u0")));
        assert_eq!((list[0].force_n, list[1].force_n), (Some(3.0), None));
        assert_eq!(
            (list[1].frame.as_str(), &list[1].before, list[1].line),
            ("p1", &None, 4)
        );
        for (text, words) in [
            ("frame,before,x_mm\np0,,1\n", ["t:1", "y_mm"]),
            ("frame,before,x_mm,y_mm\np0,,1,far\n", ["t:2", "'far'"]),
            ("frame,before,x_mm,y_mm\np0,,inf,1\n", ["t:2", "x_mm"]),
            ("frame,before,x_mm,y_mm,force_n\np0,,1,1,-2\n", ["t:2", "force_n"]),
        ] {
            let message = parse("t", text).unwrap_err().to_string();
            assert!(words.iter().all(|w| message.contains(w)), "{message}");
        }
    }
}
