//! Files that are replaced as a whole or not at all.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// Writes a file beside and gives it the name of the old one. The old one stays whole, whatever fails: a full disk, a program
/// that is ended, two programs at once. What is no file, such as `/dev/stdout`, is written as it is.
///
/// # Errors
/// What the system said. What was written beside is removed.
pub fn replace(path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> io::Result<()> {
    // A link goes on to lead to the file.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let old = fs::metadata(&target).ok();
    if old.as_ref().is_some_and(|old| !old.is_file()) {
        return fill(&mut File::options().write(true).open(path)?);
    }
    let beside = beside(&target);
    let write = || {
        let mut file = File::create(&beside)?;
        if let Some(old) = old {
            file.set_permissions(old.permissions())?;
        }
        fill(&mut file)?;
        // A full disk may say so only here.
        file.sync_all()?;
        fs::rename(&beside, &target)
    };
    let written = write();
    if written.is_err() {
        // Perhaps it was never made.
        let _ = fs::remove_file(&beside);
    }
    written
}

/// Tries whether [`replace`] can write there; what is there stays as it is.
///
/// # Errors
/// What the system said.
pub fn try_out(path: &Path) -> io::Result<()> {
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    match fs::metadata(&target) {
        Ok(old) if old.is_dir() => File::options().write(true).open(path).map(drop),
        Ok(old) if !old.is_file() => Ok(()),
        _ => {
            let beside = beside(&target);
            File::create(&beside)?;
            fs::remove_file(&beside)
        }
    }
}

/// A name beside a file, for what is to become it.
pub fn beside(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.new", std::process::id()));
    path.with_file_name(name)
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
        // Nor does a folder that cannot be written to, or anything that is no file.
        assert!(replace(folder.path(), |_| Ok(())).is_err());
        let names = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name());
        assert_eq!(names.collect::<Vec<_>>(), ["baseline.toml"]);
    }

    #[test]
    fn what_is_tried_out_is_told_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("skin.cal");
        try_out(&path).unwrap();
        assert!(!path.exists());
        fs::write(&path, "old").unwrap();
        try_out(&path).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert!(try_out(folder.path()).is_err());
        assert!(try_out(&folder.path().join("none").join("skin.cal")).is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn links_lead_to_the_new_file_and_devices_stay_devices() {
        use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("a"), folder.path().join("link"));
        fs::write(&path, "old").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        symlink(&path, &link).unwrap();
        replace(&link, |file| file.write_all(b"new")).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        replace(Path::new("/dev/null"), |file| file.write_all(b"gone")).unwrap();
        assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
        if Path::new("/dev/full").exists() {
            let full = replace(Path::new("/dev/full"), |file| file.write_all(b"no place"));
            assert_eq!(full.unwrap_err().kind(), io::ErrorKind::StorageFull);
        }
    }
}
