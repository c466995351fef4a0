//! Parquet files, written row by row: plain values, one page for a column of a row group, compressed by gzip.
//!
//! Every reader knows these parts of the format (<https://parquet.apache.org/docs/file-format/>). What makes it large, dictionaries,
//! other encodings, statistics and reading, is not needed here.

mod column;
mod thrift;

use column::Buffer;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::{self, Write};

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Whole numbers.
    Long,
    /// Numbers; not a number is one.
    Double,
    /// True or false.
    Bool,
    /// Microseconds since 1970 (UTC).
    Time,
    /// A list of numbers, none of them missing.
    Doubles,
}

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Column {
    pub(crate) name: &'static str,
    pub(crate) kind: Kind,
    /// Whether a value may be missing.
    pub(crate) optional: bool,
}

impl Column {
    /// A column that has a value in every row.
    pub(crate) const fn of(name: &'static str, kind: Kind) -> Self {
        Self {
            name,
            kind,
            optional: false,
        }
    }

    /// A column whose values may be missing.
    pub(crate) const fn optional(name: &'static str, kind: Kind) -> Self {
        Self {
            name,
            kind,
            optional: true,
        }
    }
}

/// A value of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Cell<'a> {
    Missing,
    Long(i64),
    Double(f64),
    Bool(bool),
    Doubles(&'a [f64]),
}

/// Where a column of a row group is, and how large.
struct Chunk {
    values: i64,
    plain_bytes: i64,
    packed_bytes: i64,
    place: i64,
}

struct RowGroup {
    rows: i64,
    chunks: Vec<Chunk>,
}

/// A file that is written.
pub(crate) struct Parquet<W: Write> {
    out: W,
    place: i64,
    columns: &'static [Column],
    buffers: Vec<Buffer>,
    /// Rows that are not in a group yet.
    rows: i64,
    groups: Vec<RowGroup>,
}

const MAGIC: &[u8] = b"PAR1";
/// A row group is written once it holds so many bytes. So much memory a writer needs, and a reader at least.
const GROUP_BYTES: usize = 16 << 20;

/// Numbers of the format.
const PLAIN: i32 = 0;
const RLE: i32 = 3;
const GZIP: i32 = 2;
const DATA_PAGE: i32 = 0;

impl<W: Write> Parquet<W> {
    /// Begins a file of these columns.
    ///
    /// # Errors
    /// What the system said.
    pub(crate) fn new(out: W, columns: &'static [Column]) -> io::Result<Self> {
        let mut file = Self {
            out,
            place: 0,
            columns,
            buffers: columns.iter().map(|_| Buffer::default()).collect(),
            rows: 0,
            groups: Vec::new(),
        };
        file.put(MAGIC)?;
        Ok(file)
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.place += bytes.len() as i64;
        self.out.write_all(bytes)
    }

    /// Adds a row, a value for every column.
    ///
    /// # Errors
    /// A value that its column cannot hold, or what the system said.
    pub(crate) fn row(&mut self, cells: &[Cell<'_>]) -> io::Result<()> {
        if cells.len() != self.columns.len() {
            return Err(io::Error::other("a row of another table"));
        }
        for ((column, buffer), cell) in self.columns.iter().zip(&mut self.buffers).zip(cells) {
            buffer.add(column, cell)?;
        }
        self.rows += 1;
        if self.buffers.iter().map(Buffer::bytes).sum::<usize>() >= GROUP_BYTES {
            self.end_group()?;
        }
        Ok(())
    }

    /// Writes the rows so far as a group.
    fn end_group(&mut self) -> io::Result<()> {
        let mut chunks = Vec::new();
        for k in 0..self.columns.len() {
            let (values, plain) = self.buffers[k].page(&self.columns[k]);
            self.buffers[k] = Buffer::default();
            let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
            packed.write_all(&plain)?;
            let packed = packed.finish()?;
            let mut header = Vec::new();
            thrift::write(&mut header, |page| {
                page.i32(1, DATA_PAGE);
                page.i32(2, plain.len() as i32);
                page.i32(3, packed.len() as i32);
                page.of(5, |data| {
                    data.i32(1, values);
                    data.i32(2, PLAIN);
                    data.i32(3, RLE);
                    data.i32(4, RLE);
                });
            });
            chunks.push(Chunk {
                values: values.into(),
                plain_bytes: (header.len() + plain.len()) as i64,
                packed_bytes: (header.len() + packed.len()) as i64,
                place: self.place,
            });
            self.put(&header)?;
            self.put(&packed)?;
        }
        let rows = std::mem::take(&mut self.rows);
        self.groups.push(RowGroup { rows, chunks });
        Ok(())
    }

    /// Writes the end, with what is said of the file: names and texts.
    ///
    /// # Errors
    /// What the system said.
    pub(crate) fn finish(mut self, said: &[(&str, &str)]) -> io::Result<W> {
        if self.rows > 0 {
            self.end_group()?;
        }
        let mut end = Vec::new();
        thrift::write(&mut end, |file| {
            file.i32(1, 1);
            file.list(2, &column::schema(self.columns), column::element);
            file.i64(3, self.groups.iter().map(|g| g.rows).sum());
            file.list(4, &self.groups, |group, of| {
                let pairs: Vec<(&Column, &Chunk)> = self.columns.iter().zip(&group.chunks).collect();
                of.list(1, &pairs, |(column, chunk), of| {
                    of.i64(2, chunk.place);
                    of.of(3, |of| {
                        of.i32(1, column.kind.physical());
                        of.i32_list(2, &[PLAIN, RLE]);
                        of.text_list(3, &column.path());
                        of.i32(4, GZIP);
                        of.i64(5, chunk.values);
                        of.i64(6, chunk.plain_bytes);
                        of.i64(7, chunk.packed_bytes);
                        of.i64(9, chunk.place);
                    });
                });
                of.i64(2, group.chunks.iter().map(|c| c.plain_bytes).sum());
                of.i64(3, group.rows);
            });
            file.list(5, said, |(name, text), of| {
                of.text(1, name);
                of.text(2, text);
            });
            file.text(6, concat!("skin ", env!("CARGO_PKG_VERSION")));
        });
        let length = (end.len() as u32).to_le_bytes();
        self.put(&end)?;
        self.put(&length)?;
        self.put(MAGIC)?;
        self.out.flush()?;
        Ok(self.out)
    }
}
