//! What is wrong with a scene's file, and where.

use forward::file::SheetFileError;
use std::fmt;
use std::ops::Range;
use std::path::PathBuf;
use thiserror::Error;

/// What is wrong with a scene's file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SceneFileError {
    /// It cannot be read.
    #[error("{path}: cannot be read")]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Something in it, with its place.
    #[error("{0}")]
    At(Box<Located>),
    /// There is neither a file nor a scene of the library with this name.
    #[error("{name}: no such file, and no scene of the library, which has {known}")]
    Unknown {
        /// What was asked for.
        name: String,
        /// The library's names.
        known: String,
    },
}

/// A mistake with its place in the text.
#[derive(Debug)]
pub struct Located {
    /// Which file; `None`: it was only a text.
    pub file: Option<PathBuf>,
    /// From 1.
    pub line: usize,
    /// From 1.
    pub column: usize,
    /// The line.
    pub text: String,
    /// What is wrong, and what is allowed.
    pub message: String,
}

impl fmt::Display for Located {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line, column, text, .. } = self;
        if let Some(file) = &self.file {
            write!(f, "{}, ", file.display())?;
        }
        let gutter = " ".repeat(line.to_string().len());
        let caret = " ".repeat(column - 1);
        write!(
            f,
            "line {line}, column {column}: {}\n {gutter} |\n {line} | {text}\n {gutter} | {caret}^",
            self.message.trim_end()
        )
    }
}

/// A mistake before its place is looked up.
pub(super) struct Mistake {
    pub(super) span: Range<usize>,
    pub(super) message: String,
}

impl Mistake {
    pub(super) fn new(span: Range<usize>, message: impl fmt::Display) -> Self {
        Self {
            span,
            message: message.to_string(),
        }
    }

    pub(super) fn located(self, text: &str) -> SceneFileError {
        let start = (0..=self.span.start.min(text.len()))
            .rev()
            .find(|k| text.is_char_boundary(*k))
            .unwrap_or(0);
        let before = &text[..start];
        let begin = before.rfind('\n').map_or(0, |k| k + 1);
        SceneFileError::At(Box::new(Located {
            file: None,
            line: before.matches('\n').count() + 1,
            column: before[begin..].chars().count() + 1,
            text: text[begin..].lines().next().unwrap_or("").to_owned(),
            message: self.message,
        }))
    }
}

impl From<toml::de::Error> for Mistake {
    fn from(error: toml::de::Error) -> Self {
        Self::new(error.span().unwrap_or(0..0), error.message())
    }
}

impl Mistake {
    /// What is wrong with the sheet's own file.
    pub(super) fn of_sheet(span: Range<usize>, path: &std::path::Path, error: &SheetFileError) -> Self {
        Self::new(span, format_args!("{}: {error}", path.display()))
    }
}
