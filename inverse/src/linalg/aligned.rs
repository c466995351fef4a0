//! Arrays that begin on a line of the cache.

/// Bytes of a line of the cache, and of the widest vector register.
const LINE: usize = 64;

/// An array, of `f64` unless said, that begins on a line of the cache. No vector load then straddles two lines.
#[derive(Debug, Default)]
pub(crate) struct Aligned<T = f64> {
    values: Vec<T>,
    start: usize,
    length: usize,
}

impl<T: Copy + Default> Aligned<T> {
    /// All zero.
    pub(crate) fn zeros(length: usize) -> Self {
        let values = vec![T::default(); length + Self::NUMBERS - 1];
        let start = Self::start(&values);
        Self { values, start, length }
    }

    /// Makes it longer, by zeros.
    pub(crate) fn grow(&mut self, length: usize) {
        let (before, old) = (self.start, self.length);
        self.values.resize(length.max(old) + Self::NUMBERS - 1, T::default());
        self.start = Self::start(&self.values);
        self.length = length.max(old);
        if self.start != before {
            self.values.copy_within(before..before + old, self.start);
            // What was there before.
            self.values[self.start + old..].fill(T::default());
        }
    }

    /// Makes it empty, and keeps its room.
    pub(crate) fn clear(&mut self) {
        self.values.clear();
        (self.start, self.length) = (0, 0);
    }

    /// Numbers of a line.
    const NUMBERS: usize = LINE / size_of::<T>();

    /// Where the pointer's alignment is unknown, the array is right all the same, only slower to load.
    fn start(values: &[T]) -> usize {
        let start = values.as_ptr().align_offset(LINE);
        if start < Self::NUMBERS { start } else { 0 }
    }
}

impl<T: Copy + Default> Clone for Aligned<T> {
    fn clone(&self) -> Self {
        let mut copy = Self::zeros(self.length);
        copy.copy_from_slice(self);
        copy
    }
}

impl<T> std::ops::Deref for Aligned<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.values[self.start..self.start + self.length]
    }
}

impl<T> std::ops::DerefMut for Aligned<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.values[self.start..self.start + self.length]
    }
}

impl<'a, T> IntoIterator for &'a Aligned<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<'a, T> IntoIterator for &'a mut Aligned<T> {
    type Item = &'a mut T;
    type IntoIter = std::slice::IterMut<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter_mut()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever it was moved by, it begins on a line, keeps its values, and goes on with zeros.
    #[test]
    fn it_grows_by_zeros_and_begins_on_a_line() {
        let mut values = Aligned::default();
        let mut others = Vec::new();
        for length in 1..300 {
            values.grow(length);
            assert_eq!(values.len(), length);
            assert_eq!(values[length - 1], 0.0);
            values[length - 1] = length as f64;
            assert!(values.iter().enumerate().all(|(k, v)| *v == (k + 1) as f64));
            assert_eq!(values.as_ptr() as usize % LINE, 0);
            // It does not always find room where it is.
            others.push(vec![0_u8; length]);
        }
        values.grow(10);
        assert_eq!(values.len(), 299);
        values.clear();
        values.grow(20);
        assert!(values.len() == 20 && values.iter().all(|v| *v == 0.0));
    }
}
