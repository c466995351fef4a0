//! CDR, the encoding of ROS 2's messages, little-endian (OMG's DDS-XTypes, "plain CDR"): writing.

/// A message that is encoded.
pub(crate) struct Cdr(Vec<u8>);

impl Cdr {
    /// What says that CDR follows, and that it is little-endian. Places count from behind it.
    pub(crate) const HEAD: [u8; 4] = [0, 1, 0, 0];

    /// An empty message.
    pub(crate) fn new() -> Self {
        Self(Self::HEAD.to_vec())
    }

    /// A number at a place that its size divides.
    fn number<const N: usize>(&mut self, bytes: [u8; N]) -> &mut Self {
        let place = self.0.len() - Self::HEAD.len();
        self.0.resize(self.0.len() + place.next_multiple_of(N) - place, 0);
        self.0.extend(bytes);
        self
    }

    pub(crate) fn bool(&mut self, value: bool) -> &mut Self {
        self.u8(u8::from(value))
    }

    pub(crate) fn u8(&mut self, value: u8) -> &mut Self {
        self.number([value])
    }

    pub(crate) fn u32(&mut self, value: u32) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    pub(crate) fn f64(&mut self, value: f64) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    /// Numbers in a row of a fixed length.
    pub(crate) fn array(&mut self, values: &[f64]) -> &mut Self {
        values.iter().fold(self, |cdr, value| cdr.f64(*value))
    }

    /// A text, with the zero that ends it.
    pub(crate) fn text(&mut self, value: &str) -> &mut Self {
        self.u32(value.len() as u32 + 1);
        self.0.extend_from_slice(value.as_bytes());
        self.0.push(0);
        self
    }

    pub(crate) fn bytes(&mut self, value: &[u8]) -> &mut Self {
        self.u32(value.len() as u32).octets(value)
    }

    /// Octets in a row of a fixed length.
    pub(crate) fn octets(&mut self, value: &[u8]) -> &mut Self {
        self.0.extend_from_slice(value);
        self
    }

    pub(crate) fn f64s(&mut self, values: &[f64]) -> &mut Self {
        self.u32(values.len() as u32).array(values)
    }

    /// `std_msgs/Header`: a time, ns since 1970, and where places are given in.
    pub(crate) fn header(&mut self, unix_ns: u64, frame_id: &str) -> &mut Self {
        self.u32((unix_ns / 1_000_000_000) as u32)
            .u32((unix_ns % 1_000_000_000) as u32)
            .text(frame_id)
    }

    /// Its bytes, with the head of the encoding.
    pub(crate) fn into_bytes(self) -> Vec<u8> {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_where_their_size_divides_the_place() {
        let mut cdr = Cdr::new();
        cdr.bool(true).u32(2).text("a").f64(0.5).f64s(&[]).bytes(&[7]);
        let mut expected = vec![0, 1, 0, 0];
        // A byte, the next number at 4, the text with its length at 8, and the double at 16.
        expected.extend([1, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0, b'a', 0, 0, 0]);
        expected.extend(0.5_f64.to_le_bytes());
        expected.extend([0, 0, 0, 0, 1, 0, 0, 0, 7]);
        assert_eq!(cdr.into_bytes(), expected);
    }
}
