//! The calibration of each board, stored where its baselines are: `skin run` loads it by itself.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use view::replace::try_out;

/// The file of a board in a folder, by its serial number. Letters, digits and hyphens are in its name, all else as its code.
pub(crate) fn path(folder: &Path, serial: &str) -> PathBuf {
    let mut name = "calibration-".to_owned();
    for byte in serial.bytes() {
        if byte.is_ascii_alphanumeric() || byte == b'-' {
            name.push(byte.into());
        } else {
            // Writing to a text cannot fail.
            let _ = write!(name, "_{byte:02x}");
        }
    }
    folder.join(name + ".toml")
}

/// The same, in a folder that is there from now on.
///
/// # Errors
/// It cannot be made.
pub(crate) fn place(folder: &Path, serial: &str) -> std::io::Result<PathBuf> {
    std::fs::create_dir_all(folder)?;
    Ok(path(folder, serial))
}

/// Sees before something is measured whether what comes of it can be stored in a folder, which is there from now on.
///
/// # Errors
/// It cannot be made, or nothing can be written there.
pub(crate) fn try_folder(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    try_out(&folder.join("trial"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_serial_leaves_the_folder() {
        let path = path(Path::new("/state"), "../x y");
        assert_eq!(path, Path::new("/state/calibration-_2e_2e_2fx_20y.toml"));
    }
}
