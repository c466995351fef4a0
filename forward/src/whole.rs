//! Files that are read as a whole, up to a size: whatever a name leads to, memory is not filled.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

/// Largest file of text that [`text`] reads, bytes. The largest that this program writes are calibrations, some megabytes.
pub const MOST_TEXT: u64 = 64 << 20;

/// The bytes of a file, at most so many.
///
/// # Errors
/// What the system says; a file that is larger ([`ErrorKind::FileTooLarge`]).
pub fn bytes(path: &Path, most: u64) -> Result<Vec<u8>> {
    let file = File::open(path)?;
    let said = file.metadata().map_or(0, |data| data.len());
    let too_large = || {
        let most = most >> 20;
        let text = format!("it is larger than the {most} MB that are read of such a file; is it the right one?");
        Error::new(ErrorKind::FileTooLarge, text)
    };
    if said > most {
        return Err(too_large());
    }
    let mut bytes = Vec::with_capacity(said as usize + 1);
    // What is no file, such as /dev/zero, has no length of its own.
    file.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        Err(too_large())
    } else {
        Ok(bytes)
    }
}

/// The text of a file in UTF-8, at most [`MOST_TEXT`] bytes.
///
/// # Errors
/// As for [`bytes`]; other bytes than text in UTF-8 ([`ErrorKind::InvalidData`]), with what to do.
pub fn text(path: &Path) -> Result<String> {
    let bytes = bytes(path, MOST_TEXT)?;
    String::from_utf8(bytes).map_err(|error| {
        let text = format!("it is not text in UTF-8 but {}", encoding(error.as_bytes()));
        Error::new(ErrorKind::InvalidData, text)
    })
}

/// What bytes that are not text in UTF-8 seem to be, with what to do.
pub fn encoding(bytes: &[u8]) -> &'static str {
    if is_utf16(bytes) {
        "in UTF-16; save it as UTF-8"
    } else if bytes.contains(&0) {
        "bytes of another kind of file"
    } else {
        "in another encoding; save it as UTF-8"
    }
}

/// Whether a file begins as text in UTF-16 does: with its mark, or with a letter of two bytes one of which is 0.
pub fn is_utf16(bytes: &[u8]) -> bool {
    match bytes {
        [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..] => true,
        [a, b, c, d, ..] => (*a == 0) != (*b == 0) && (*a == 0, *b == 0) == (*c == 0, *d == 0),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_read_and_what_is_none_is_named() {
        let folder = std::env::temp_dir().join(format!("skin-whole-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("a");
        let tried = |content: &[u8]| {
            std::fs::write(&path, content).unwrap();
            text(&path).map_err(|e| e.to_string())
        };
        assert_eq!(tried("grüß".as_bytes()).unwrap(), "grüß");
        let utf16 = |text: &str| text.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>();
        assert!(
            tried(&utf16("\u{feff}ä"))
                .unwrap_err()
                .contains("in UTF-16; save it as UTF-8")
        );
        assert!(is_utf16(&utf16("drive_a")) && !is_utf16(b"drive_a") && !is_utf16(&[0, 0, 1, 0]));
        assert!(tried(b"gr\xfc\xdf").unwrap_err().contains("another encoding"));
        assert!(tried(b"\xff\0\0\0").unwrap_err().contains("another kind of file"));
        assert_eq!(bytes(&path, 4).unwrap().len(), 4);
        assert_eq!(bytes(&path, 3).unwrap_err().kind(), ErrorKind::FileTooLarge);
        let long = File::create(&path).unwrap();
        long.set_len(MOST_TEXT + 1).unwrap();
        assert_eq!(text(&path).unwrap_err().kind(), ErrorKind::FileTooLarge);
        std::fs::remove_dir_all(&folder).unwrap();
        if Path::new("/dev/zero").exists() {
            let endless = bytes(Path::new("/dev/zero"), 1 << 20);
            assert_eq!(endless.unwrap_err().kind(), ErrorKind::FileTooLarge);
        }
    }
}
