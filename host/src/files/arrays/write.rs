//! Arrays of numbers for numpy (.npz) and MATLAB (.mat, level 5), written number by number: no array is in memory as a whole.

use crate::files::zip::Zip;
use std::io::{self, ErrorKind, Seek, Write};

/// Numbers of an array, in a file that holds several.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Of {
    /// 8 bytes.
    Float,
    /// 4 bytes, from 0.
    Unsigned,
}

impl Of {
    fn size(self) -> u64 {
        match self {
            Self::Float => 8,
            Self::Unsigned => 4,
        }
    }
}

/// Bytes that one array may have: neither format goes further without another version of it.
const MOST: u64 = 0x7FFF_0000;

fn too_large(name: &str) -> io::Error {
    let text =
        format!("{name} is larger than 2 GB; take a part with --from-s and --to-s, or fewer frames with --every");
    io::Error::new(ErrorKind::FileTooLarge, text)
}

/// A file of arrays that are written one after the other.
pub(crate) trait ArrayFile {
    /// Begins an array of so many frames of so many values, to be written frame by frame. In .npz frames are rows, in .mat columns.
    ///
    /// # Errors
    /// It is too large, or what the system said.
    fn begin(&mut self, name: &str, frames: usize, values: usize, of: Of) -> io::Result<()>;
    /// The next numbers.
    ///
    /// # Errors
    /// What the system said.
    fn floats(&mut self, numbers: &[f64]) -> io::Result<()>;
    /// The next numbers.
    ///
    /// # Errors
    /// What the system said.
    fn unsigned(&mut self, numbers: &[u32]) -> io::Result<()>;
    /// Ends the array.
    ///
    /// # Errors
    /// What the system said.
    fn end(&mut self) -> io::Result<()>;
    /// Ends the file.
    ///
    /// # Errors
    /// What the system said.
    fn finish(&mut self) -> io::Result<()>;
}

/// Arrays of numpy in a zip archive, not compressed.
pub(crate) struct Npz<W: Write + Seek>(Zip<W>);

impl<W: Write + Seek> Npz<W> {
    pub(crate) fn new(out: W) -> Self {
        Self(Zip::new(out))
    }
}

impl<W: Write + Seek> ArrayFile for Npz<W> {
    fn begin(&mut self, name: &str, frames: usize, values: usize, of: Of) -> io::Result<()> {
        if frames as u64 * values as u64 * of.size() > MOST {
            return Err(too_large(name));
        }
        let kind = match of {
            Of::Float => "<f8",
            Of::Unsigned => "<u4",
        };
        let shape = if values == 1 {
            format!("({frames},)")
        } else {
            format!("({frames}, {values})")
        };
        let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
        // With the ten bytes before it and the line's end a multiple of 64.
        while !(header.len() + 11).is_multiple_of(64) {
            header.push(' ');
        }
        header.push('\n');
        self.0.begin(&format!("{name}.npy")).map_err(advised)?;
        self.0.put(b"\x93NUMPY\x01\x00")?;
        self.0.put(&(header.len() as u16).to_le_bytes())?;
        self.0.put(header.as_bytes())
    }

    fn floats(&mut self, numbers: &[f64]) -> io::Result<()> {
        numbers.iter().try_for_each(|v| self.0.put(&v.to_le_bytes()))
    }

    fn unsigned(&mut self, numbers: &[u32]) -> io::Result<()> {
        numbers.iter().try_for_each(|v| self.0.put(&v.to_le_bytes()))
    }

    fn end(&mut self) -> io::Result<()> {
        self.0.end().map_err(advised)
    }

    fn finish(&mut self) -> io::Result<()> {
        self.0.finish().map_err(advised)
    }
}

/// What to do where an archive is too large.
fn advised(error: io::Error) -> io::Error {
    // The system says it of a file that may not grow, whatever the format can hold.
    match error.kind() {
        ErrorKind::FileTooLarge if error.raw_os_error().is_none() => too_large("the archive"),
        _ => error,
    }
}

/// Variables of MATLAB, level 5.
pub(crate) struct Mat<W: Write> {
    out: W,
    /// Bytes of the open variable's numbers.
    open: u64,
}

impl<W: Write> Mat<W> {
    /// Begins a file; `about` is its description.
    ///
    /// # Errors
    /// What the system said.
    pub(crate) fn new(mut out: W, about: &str) -> io::Result<Self> {
        let mut head = format!("MATLAB 5.0 MAT-file, {about}").into_bytes();
        head.resize(124, b' ');
        head.extend([0x00, 0x01, b'I', b'M']);
        out.write_all(&head)?;
        Ok(Self { out, open: 0 })
    }

    fn words(&mut self, words: &[u32]) -> io::Result<()> {
        words.iter().try_for_each(|w| self.out.write_all(&w.to_le_bytes()))
    }
}

impl<W: Write> ArrayFile for Mat<W> {
    fn begin(&mut self, name: &str, frames: usize, values: usize, of: Of) -> io::Result<()> {
        let bytes = frames as u64 * values as u64 * of.size();
        if bytes > MOST {
            return Err(too_large(name));
        }
        let named = name.len().next_multiple_of(8);
        let data = bytes.next_multiple_of(8) as u32;
        // Classes: 6 double, 13 uint32. Kinds of numbers: 9 double, 6 uint32.
        let (class, kind) = match of {
            Of::Float => (6, 9),
            Of::Unsigned => (13, 6),
        };
        self.words(&[14, 16 + 16 + 8 + named as u32 + 8 + data])?;
        self.words(&[6, 8, class, 0])?;
        self.words(&[5, 8, values as u32, frames as u32])?;
        self.words(&[1, name.len() as u32])?;
        let mut padded = name.as_bytes().to_vec();
        padded.resize(named, 0);
        self.out.write_all(&padded)?;
        self.words(&[kind, bytes as u32])?;
        self.open = bytes;
        Ok(())
    }

    fn floats(&mut self, numbers: &[f64]) -> io::Result<()> {
        numbers.iter().try_for_each(|v| self.out.write_all(&v.to_le_bytes()))
    }

    fn unsigned(&mut self, numbers: &[u32]) -> io::Result<()> {
        self.words(numbers)
    }

    fn end(&mut self) -> io::Result<()> {
        let padding = (self.open.next_multiple_of(8) - self.open) as usize;
        self.open = 0;
        self.out.write_all(&[0; 8][..padding])
    }

    fn finish(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::arrays::{Kind, parse};
    use std::io::Cursor;

    fn fill(file: &mut impl ArrayFile) {
        file.begin("v", 3, 2, Of::Float).unwrap();
        for frame in 0..3 {
            file.floats(&[f64::from(frame), 0.1]).unwrap();
        }
        file.end().unwrap();
        file.begin("n", 3, 1, Of::Unsigned).unwrap();
        file.unsigned(&[7, 8, u32::MAX]).unwrap();
        file.end().unwrap();
        file.finish().unwrap();
    }

    #[test]
    fn what_is_written_is_read() {
        let mut npz = Npz::new(Cursor::new(Vec::new()));
        fill(&mut npz);
        let (kind, arrays) = parse("npz", npz.0.out().get_ref()).unwrap();
        assert_eq!(kind, Kind::Npz);
        assert_eq!(
            (arrays[0].name.as_str(), arrays[0].rows, arrays[0].columns),
            ("v", 3, 2)
        );
        assert_eq!(arrays[0].values, [0.0, 0.1, 1.0, 0.1, 2.0, 0.1]);
        assert_eq!(arrays[1].values, [7.0, 8.0, f64::from(u32::MAX)]);

        let mut mat = Mat::new(Vec::new(), "a test").unwrap();
        fill(&mut mat);
        let (kind, arrays) = parse("mat", &mat.out).unwrap();
        assert_eq!(kind, Kind::Mat);
        assert_eq!(
            (arrays[0].name.as_str(), arrays[0].rows, arrays[0].columns),
            ("v", 2, 3)
        );
        assert_eq!(arrays[0].values, [0.0, 1.0, 2.0, 0.1, 0.1, 0.1]);
        assert_eq!(arrays[1].values, [7.0, 8.0, f64::from(u32::MAX)]);
    }

    #[test]
    fn what_is_too_large_is_refused_before_it_is_written() {
        let mut npz = Npz::new(Cursor::new(Vec::new()));
        let error = npz.begin("v", 10_000_000, 208, Of::Float).unwrap_err();
        assert!(error.to_string().contains("--every"), "{error}");
        assert!(npz.0.out().get_ref().is_empty());
    }
}
