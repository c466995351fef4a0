//! Thrift's compact protocol, as far as the headers of Parquet need it: writing.

/// A struct that is written, field by field, with rising numbers.
pub(super) struct Struct<'a> {
    out: &'a mut Vec<u8>,
    last: u8,
}

const I32: u8 = 5;
const I64: u8 = 6;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const STRUCT: u8 = 12;

/// An unsigned number, 7 bits a byte, the low ones first.
pub(super) fn varint(out: &mut Vec<u8>, mut n: u64) {
    while n >= 0x80 {
        out.push(n as u8 | 0x80);
        n >>= 7;
    }
    out.push(n as u8);
}

fn zigzag(out: &mut Vec<u8>, n: i64) {
    varint(out, ((n << 1) ^ (n >> 63)) as u64);
}

fn text(out: &mut Vec<u8>, text: &str) {
    varint(out, text.len() as u64);
    out.extend_from_slice(text.as_bytes());
}

fn list_head(out: &mut Vec<u8>, kind: u8, len: usize) {
    match len {
        0..15 => out.push((len as u8) << 4 | kind),
        _ => {
            out.push(0xf0 | kind);
            varint(out, len as u64);
        }
    }
}

/// A struct by itself.
pub(super) fn write(out: &mut Vec<u8>, fields: impl FnOnce(&mut Struct<'_>)) {
    let mut of = Struct { out, last: 0 };
    fields(&mut of);
    of.out.push(0);
}

impl Struct<'_> {
    /// Begins a field. Numbers rise by less than 16.
    fn field(&mut self, number: u8, kind: u8) {
        self.out.push((number - self.last) << 4 | kind);
        self.last = number;
    }

    pub(super) fn i32(&mut self, number: u8, value: i32) {
        self.field(number, I32);
        zigzag(self.out, value.into());
    }

    pub(super) fn i64(&mut self, number: u8, value: i64) {
        self.field(number, I64);
        zigzag(self.out, value);
    }

    pub(super) fn text(&mut self, number: u8, value: &str) {
        self.field(number, BINARY);
        text(self.out, value);
    }

    pub(super) fn of(&mut self, number: u8, fields: impl FnOnce(&mut Struct<'_>)) {
        self.field(number, STRUCT);
        write(self.out, fields);
    }

    pub(super) fn i32_list(&mut self, number: u8, values: &[i32]) {
        self.field(number, LIST);
        list_head(self.out, I32, values.len());
        values.iter().for_each(|v| zigzag(self.out, (*v).into()));
    }

    pub(super) fn text_list(&mut self, number: u8, values: &[&str]) {
        self.field(number, LIST);
        list_head(self.out, BINARY, values.len());
        values.iter().for_each(|v| text(self.out, v));
    }

    /// A list of structs.
    pub(super) fn list<T>(&mut self, number: u8, items: &[T], mut fields: impl FnMut(&T, &mut Struct<'_>)) {
        self.field(number, LIST);
        list_head(self.out, STRUCT, items.len());
        for item in items {
            write(self.out, |of| fields(item, of));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The examples of the protocol's specification and of its base-128 numbers.
    #[test]
    fn numbers_and_fields_are_those_of_the_specification() {
        let bytes = |n| {
            let mut out = Vec::new();
            varint(&mut out, n);
            out
        };
        assert_eq!(bytes(0), [0]);
        assert_eq!(bytes(50_399), [0xdf, 0x89, 0x03]);
        let mut out = Vec::new();
        write(&mut out, |of| {
            of.i32(1, -1);
            of.i64(3, 1);
            of.text(4, "a");
            of.i32_list(5, &[0, 2]);
        });
        assert_eq!(out, [0x15, 1, 0x26, 2, 0x18, 1, b'a', 0x19, 0x25, 0, 4, 0]);
        let mut out = Vec::new();
        write(&mut out, |of| of.text_list(2, &["x"; 16]));
        assert_eq!(out[..3], [0x29, 0xf8, 16]);
    }
}
