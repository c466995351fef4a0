//! Numbers that begin on a line of the cache.

/// Bytes of a line of the cache, and of the widest vector register.
const LINE: usize = 64;

/// A fixed number of numbers, `f64` unless said, of which the first lies on a line's boundary: no vector load straddles two
/// lines.
#[derive(Debug)]
pub(crate) struct Aligned<T = f64> {
    values: Vec<T>,
    start: usize,
    length: usize,
}

impl<T: Copy + Default> Aligned<T> {
    /// All zero.
    pub(crate) fn zeros(length: usize) -> Self {
        let numbers = LINE / size_of::<T>();
        let values = vec![T::default(); length + numbers - 1];
        // Where the pointer's alignment cannot be told the numbers are right all the same, only slower to load.
        let start = values.as_ptr().align_offset(LINE);
        let start = if start < numbers { start } else { 0 };
        Self { values, start, length }
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
