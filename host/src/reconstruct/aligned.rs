//! Numbers that begin on a line of the cache.

/// Bytes of a line of the cache, and of the widest vector register.
const LINE: usize = 64;
const NUMBERS: usize = LINE / size_of::<f64>();

/// A fixed number of `f64` of which the first lies on a line's boundary: no vector load straddles two lines.
#[derive(Debug)]
pub(crate) struct Aligned {
    values: Vec<f64>,
    start: usize,
    length: usize,
}

impl Aligned {
    /// All zero.
    pub(crate) fn zeros(length: usize) -> Self {
        let values = vec![0.0; length + NUMBERS - 1];
        // Where the pointer's alignment cannot be told the numbers are right all the same, only slower to load.
        let start = values.as_ptr().align_offset(LINE);
        let start = if start < NUMBERS { start } else { 0 };
        Self { values, start, length }
    }
}

impl Clone for Aligned {
    fn clone(&self) -> Self {
        let mut copy = Self::zeros(self.length);
        copy.copy_from_slice(self);
        copy
    }
}

impl std::ops::Deref for Aligned {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        &self.values[self.start..self.start + self.length]
    }
}

impl std::ops::DerefMut for Aligned {
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.values[self.start..self.start + self.length]
    }
}

impl<'a> IntoIterator for &'a Aligned {
    type Item = &'a f64;
    type IntoIter = std::slice::Iter<'a, f64>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<'a> IntoIterator for &'a mut Aligned {
    type Item = &'a mut f64;
    type IntoIter = std::slice::IterMut<'a, f64>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter_mut()
    }
}
