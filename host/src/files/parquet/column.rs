//! The values of a column, and how the file describes it.

use super::thrift::{Struct, varint};
use super::{Cell, Column, Kind};
use std::io;

/// Numbers of the format.
const BOOLEAN: i32 = 0;
const INT64: i32 = 2;
const DOUBLE: i32 = 5;
const REQUIRED: i32 = 0;
const OPTIONAL: i32 = 1;
const REPEATED: i32 = 2;
const LIST: i32 = 3;
const TIMESTAMP_MICROS: i32 = 10;

impl Kind {
    /// The type of its values in the file.
    pub(super) fn physical(self) -> i32 {
        match self {
            Self::Bool => BOOLEAN,
            Self::Long | Self::Time => INT64,
            Self::Double | Self::Doubles => DOUBLE,
        }
    }
}

impl Column {
    /// The names that lead to its values.
    pub(super) fn path(&self) -> Vec<&str> {
        match self.kind {
            Kind::Doubles => vec![self.name, "list", "element"],
            _ => vec![self.name],
        }
    }
}

/// An element of the file's schema: name, type, repetition, children, meaning.
pub(super) type Element = (&'static str, Option<i32>, Option<i32>, Option<i32>, Option<i32>);

/// The schema, root first.
pub(super) fn schema(columns: &[Column]) -> Vec<Element> {
    let mut out: Vec<Element> = vec![("skin", None, None, Some(columns.len() as i32), None)];
    for column in columns {
        let repetition = Some(if column.optional { OPTIONAL } else { REQUIRED });
        match column.kind {
            Kind::Doubles => out.extend([
                (column.name, None, Some(REQUIRED), Some(1), Some(LIST)),
                ("list", None, Some(REPEATED), Some(1), None),
                ("element", Some(DOUBLE), Some(REQUIRED), None, None),
            ]),
            kind => {
                let meaning = (kind == Kind::Time).then_some(TIMESTAMP_MICROS);
                out.push((column.name, Some(kind.physical()), repetition, None, meaning));
            }
        }
    }
    out
}

/// Writes an element of the schema.
pub(super) fn element((name, kind, repetition, children, meaning): &Element, of: &mut Struct<'_>) {
    if let Some(kind) = kind {
        of.i32(1, *kind);
    }
    if let Some(repetition) = repetition {
        of.i32(3, *repetition);
    }
    of.text(4, name);
    if let Some(children) = children {
        of.i32(5, *children);
    }
    if let Some(meaning) = meaning {
        of.i32(6, *meaning);
    }
}

/// Levels of 0 and 1 in runs of the same.
#[derive(Default)]
struct Levels(Vec<(bool, u64)>);

impl Levels {
    fn add(&mut self, level: bool, times: u64) {
        match self.0.last_mut() {
            _ if times == 0 => {}
            Some((last, run)) if *last == level => *run += times,
            _ => self.0.push((level, times)),
        }
    }

    fn write(&self, out: &mut Vec<u8>) {
        let mut runs = Vec::new();
        for (level, run) in &self.0 {
            varint(&mut runs, run << 1);
            runs.push(u8::from(*level));
        }
        out.extend((runs.len() as u32).to_le_bytes());
        out.extend(runs);
    }
}

/// Values of a column that are not written yet.
#[derive(Default)]
pub(super) struct Buffer {
    plain: Vec<u8>,
    /// Bits of the last byte of true and false.
    bits: usize,
    /// Values and missing ones.
    count: i32,
    /// Whether a value is there.
    there: Levels,
    /// Whether a value goes on with the list of the one before.
    goes_on: Levels,
}

impl Buffer {
    /// Memory that it takes, about.
    pub(super) fn bytes(&self) -> usize {
        self.plain.len() + 16 * (self.there.0.len() + self.goes_on.0.len())
    }

    pub(super) fn add(&mut self, column: &Column, cell: &Cell<'_>) -> io::Result<()> {
        self.count += 1;
        match (column.kind, cell) {
            (Kind::Long | Kind::Time, Cell::Long(n)) => self.plain.extend(n.to_le_bytes()),
            (Kind::Double, Cell::Double(x)) => self.plain.extend(x.to_le_bytes()),
            (Kind::Bool, Cell::Bool(yes)) => {
                if self.bits == 0 {
                    self.plain.push(0);
                }
                if let Some(last) = self.plain.last_mut() {
                    *last |= u8::from(*yes) << self.bits;
                }
                self.bits = (self.bits + 1) % 8;
            }
            (Kind::Doubles, Cell::Doubles(list)) => {
                let more = list.len().saturating_sub(1);
                self.count += more as i32;
                self.goes_on.add(false, 1);
                self.goes_on.add(true, more as u64);
                self.there.add(!list.is_empty(), list.len().max(1) as u64);
                list.iter().for_each(|x| self.plain.extend(x.to_le_bytes()));
                return Ok(());
            }
            (_, Cell::Missing) if column.optional => {
                self.there.add(false, 1);
                return Ok(());
            }
            _ => {
                return Err(io::Error::other(format!(
                    "{}: {cell:?} is no value of this column",
                    column.name
                )));
            }
        }
        self.there.add(true, 1);
        Ok(())
    }

    /// Number of values, and a page of them: levels where the column has them, then the values.
    pub(super) fn page(&self, column: &Column) -> (i32, Vec<u8>) {
        let mut out = Vec::with_capacity(self.plain.len() + 64);
        let is_list = column.kind == Kind::Doubles;
        if is_list {
            self.goes_on.write(&mut out);
        }
        if is_list || column.optional {
            self.there.write(&mut out);
        }
        out.extend_from_slice(&self.plain);
        (self.count, out)
    }
}
