//! Writes arrays of `f64` in NumPy's format (version 1.0, little endian), for the peers' script.

use nalgebra::DMatrix;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Writes a matrix; the file holds it column by column (`fortran_order`).
pub(crate) fn write(path: &Path, matrix: &DMatrix<f64>) -> io::Result<()> {
    let mut header = format!(
        "{{'descr': '<f8', 'fortran_order': True, 'shape': ({}, {}), }}",
        matrix.nrows(),
        matrix.ncols()
    );
    // Magic, version, length and header fill a multiple of 64 bytes, the last one a new line.
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let length = u16::try_from(header.len()).map_err(io::Error::other)?;
    let mut file = BufWriter::new(File::create(path)?);
    file.write_all(b"\x93NUMPY\x01\x00")?;
    file.write_all(&length.to_le_bytes())?;
    file.write_all(header.as_bytes())?;
    for value in matrix.as_slice() {
        file.write_all(&value.to_le_bytes())?;
    }
    file.flush()
}
