//! Names of files for frames whose names somebody else has chosen.

use std::collections::HashSet;

/// A file for every frame: its name with whatever may trouble a file system replaced, numbered where two become the same.
pub(crate) fn file_names<'a>(frames: impl Iterator<Item = &'a str>, kind: &str) -> Vec<String> {
    let mut files: Vec<String> = Vec::new();
    let mut taken = HashSet::new();
    for frame in frames {
        let mut safe: String = frame
            .chars()
            .map(|c| {
                if c.is_alphanumeric() || "-_.".contains(c) {
                    c
                } else {
                    '_'
                }
            })
            .collect();
        if is_device(&safe) {
            safe.insert(0, '_');
        }
        let mut file = format!("{safe}.{kind}");
        let mut number = 2;
        while !taken.insert(file.to_lowercase()) {
            file = format!("{safe}-{number}.{kind}");
            number += 1;
        }
        files.push(file);
    }
    files
}

/// Whether Windows takes a file of this name for a device, whatever follows the first dot.
fn is_device(name: &str) -> bool {
    let stem = name.split('.').next().unwrap_or_default().to_ascii_lowercase();
    let numbered = |name: &str| {
        stem.strip_prefix(name)
            .is_some_and(|n| n.len() == 1 && n.bytes().all(|b| b.is_ascii_digit()))
    };
    ["con", "prn", "aux", "nul"].contains(&stem.as_str()) || numbered("com") || numbered("lpt")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_frames_share_a_file() {
        let files = file_names(["a b", "a_b", "A/b", "a_b-2", "../x"].into_iter(), "png");
        assert_eq!(files, ["a_b.png", "a_b-2.png", "A_b-3.png", "a_b-2-2.png", ".._x.png"]);
    }

    #[test]
    fn no_file_is_a_device_of_windows() {
        let files = file_names(["nul", "Com1.a", "com10", "console", "3:4"].into_iter(), "png");
        assert_eq!(
            files,
            ["_nul.png", "_Com1.a.png", "com10.png", "console.png", "3_4.png"]
        );
    }
}
