//! A baseline of its own for every frame: which column was taken just before it.

use super::columns::{self, Columns};
use super::malformed::FileError;
use std::collections::HashMap;
use std::path::Path;

/// A frame and the one before it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Before {
    /// Line of the file, from 1.
    pub line: u64,
    /// The frame.
    pub frame: String,
    /// The frame that it is compared with; none where the file says nothing.
    pub before: Option<String>,
}

/// Reads a CSV with the columns `frame` and `before`; others are passed over.
///
/// # Errors
/// [`FileError`] with line and column: a column that is not there, a frame twice, a frame that is its own baseline.
pub(crate) fn read(path: &Path) -> Result<Vec<Before>, FileError> {
    columns::read(path, parse)
}

/// The same from text; `file` is its name in messages.
///
/// # Errors
/// As for [`read`].
pub(crate) fn parse(file: &str, text: &str) -> Result<Vec<Before>, FileError> {
    let columns = Columns::parse(file, text)?;
    let (frame, before) = (columns.column("frame")?, columns.column("before")?);
    let mut seen = HashMap::new();
    let mut list = Vec::new();
    for line in columns.lines() {
        let name = line.text(frame);
        if name.is_empty() {
            return Err(line.malformed("frame", "the name of a frame", "nothing"));
        }
        if let Some(first) = seen.insert(name, line.number()) {
            return Err(line.malformed("frame", "every frame once", &format!("the frame of line {first} again")));
        }
        let own = Some(line.text(before)).filter(|b| !b.is_empty());
        if own == Some(name) {
            return Err(line.malformed("before", "another frame", &format!("'{name}'")));
        }
        list.push(Before {
            line: line.number(),
            frame: name.to_owned(),
            before: own.map(str::to_owned),
        });
    }
    if list.is_empty() {
        return Err(FileError::malformed(
            file,
            2,
            "frame",
            "at least one frame",
            "the end of the file",
        ));
    }
    Ok(list)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_columns_are_passed_over_and_nothing_is_none() {
        let list = parse("b", "# presses\nx_mm,frame,before\n1.5,p0,u0\n2,p1,\n").unwrap();
        let of = |k: usize| (list[k].line, list[k].frame.as_str(), list[k].before.as_deref());
        assert_eq!((of(0), of(1)), ((3, "p0", Some("u0")), (4, "p1", None)));
    }

    #[test]
    fn what_is_wrong_has_its_place() {
        for (text, words) in [
            ("frame,x\np,1\n", ["b:1", "before", "frame,x"]),
            ("frame,before\np,u\np,u\n", ["b:3", "once", "line 2"]),
            ("frame,before\np,p\n", ["b:2", "another frame", "'p'"]),
            ("frame,before\n,u\n", ["b:2", "name of a frame", "nothing"]),
            ("frame,before\n", ["b:2", "at least one", "end"]),
            ("frame,before\np\n", ["b:2", "as many fields", "2 fields"]),
        ] {
            let message = parse("b", text).unwrap_err().to_string();
            assert!(words.iter().all(|w| message.contains(w)), "{text:?}: {message}");
        }
    }
}
