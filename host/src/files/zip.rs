//! Zip archives, not compressed, written file by file as their bytes come: no file is in memory as a whole.

use flate2::Crc;
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};

/// An archive that is written.
pub(crate) struct Zip<W: Write + Seek> {
    out: W,
    /// Name, sum, size and place of every file.
    entries: Vec<(String, u32, u32, u32)>,
    open: Option<(String, u32, Crc)>,
}

/// Version of zip that is needed, no flags, not compressed, 1980-01-01.
const ZIP: [u8; 10] = [20, 0, 0, 0, 0, 0, 0, 0, 0x21, 0];
/// Where the sum stands in a local header.
const SUM_AT: u64 = 14;

fn short(n: u64) -> io::Result<u32> {
    u32::try_from(n).map_err(|_| io::Error::new(ErrorKind::FileTooLarge, "the archive is larger than 4 GB"))
}

impl<W: Write + Seek> Zip<W> {
    /// Begins an archive.
    pub(crate) fn new(out: W) -> Self {
        Self {
            out,
            entries: Vec::new(),
            open: None,
        }
    }

    /// What it is written to.
    #[cfg(test)]
    pub(crate) fn out(&self) -> &W {
        &self.out
    }

    /// Begins a file of this name, in ASCII.
    ///
    /// # Errors
    /// The archive is too large, or what the system said.
    pub(crate) fn begin(&mut self, name: &str) -> io::Result<()> {
        self.end()?;
        let place = short(self.out.stream_position()?)?;
        self.out.write_all(b"PK\x03\x04")?;
        self.out.write_all(&ZIP)?;
        self.out.write_all(&[0; 12])?;
        self.out.write_all(&(name.len() as u16).to_le_bytes())?;
        self.out.write_all(&[0; 2])?;
        self.out.write_all(name.as_bytes())?;
        self.open = Some((name.to_owned(), place, Crc::new()));
        Ok(())
    }

    /// The next bytes of the file.
    ///
    /// # Errors
    /// What the system said.
    pub(crate) fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        if let Some((.., sum)) = &mut self.open {
            sum.update(bytes);
        }
        self.out.write_all(bytes)
    }

    /// Ends the file, if one is open.
    ///
    /// # Errors
    /// It is too large, or what the system said.
    pub(crate) fn end(&mut self) -> io::Result<()> {
        let Some((name, place, sum)) = self.open.take() else {
            return Ok(());
        };
        let end = self.out.stream_position()?;
        let size = short(end - u64::from(place) - 30 - name.len() as u64)?;
        self.out.seek(SeekFrom::Start(u64::from(place) + SUM_AT))?;
        self.out.write_all(&sum.sum().to_le_bytes())?;
        self.out.write_all(&[size.to_le_bytes(), size.to_le_bytes()].concat())?;
        self.out.seek(SeekFrom::Start(end))?;
        self.entries.push((name, sum.sum(), size, place));
        Ok(())
    }

    /// Ends the archive.
    ///
    /// # Errors
    /// As for [`Zip::end`].
    pub(crate) fn finish(&mut self) -> io::Result<()> {
        self.end()?;
        let start = short(self.out.stream_position()?)?;
        for (name, sum, size, place) in &self.entries {
            self.out.write_all(b"PK\x01\x02\x14\x00")?;
            self.out.write_all(&ZIP)?;
            for word in [*sum, *size, *size] {
                self.out.write_all(&word.to_le_bytes())?;
            }
            self.out.write_all(&(name.len() as u16).to_le_bytes())?;
            self.out.write_all(&[0; 12])?;
            self.out.write_all(&place.to_le_bytes())?;
            self.out.write_all(name.as_bytes())?;
        }
        let size = short(self.out.stream_position()?)? - start;
        let count = (self.entries.len() as u16).to_le_bytes();
        self.out.write_all(b"PK\x05\x06\0\0\0\0")?;
        self.out.write_all(&[count, count].concat())?;
        self.out
            .write_all(&[size.to_le_bytes(), start.to_le_bytes(), [0; 4]].concat()[..10])?;
        self.out.flush()
    }
}
