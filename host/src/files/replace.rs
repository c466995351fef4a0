//! A file that is replaced as a whole or not at all.

use std::fs::{self, File};
use std::io;
use std::path::Path;

/// Writes a file beside and gives it the name of the old one. The old one stays whole, whatever fails: a full disk, a program
/// that is ended, two programs at once.
///
/// # Errors
/// What the system said. What was written beside is removed.
pub(crate) fn replace(path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> io::Result<()> {
    let beside = path.with_extension(format!("{}.new", std::process::id()));
    let write = || {
        let mut file = File::create(&beside)?;
        fill(&mut file)?;
        // A full disk may say so only here.
        file.sync_all()?;
        fs::rename(&beside, path)
    };
    let written = write();
    if written.is_err() {
        // Perhaps it was never made.
        let _ = fs::remove_file(&beside);
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn the_old_file_is_replaced_as_a_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("baseline.toml");
        replace(&path, |file| file.write_all(b"first")).unwrap();
        replace(&path, |file| file.write_all(b"second")).unwrap();
        let full = replace(&path, |file| {
            file.write_all(b"half of the th")?;
            Err(io::ErrorKind::StorageFull.into())
        });
        assert_eq!(full.unwrap_err().kind(), io::ErrorKind::StorageFull);
        assert_eq!(fs::read_to_string(&path).unwrap(), "second");
        let names = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name());
        assert_eq!(names.collect::<Vec<_>>(), ["baseline.toml"]);
    }
}
