//! Amplifiers at their rails: all values of a sense pair are missing. The frame alone tells it, whatever else is broken.

/// Fewest values of an amplifier that tell it.
const LEAST: usize = 2;

/// Follows them from frame to frame.
pub(crate) struct Rails {
    /// Sense pairs with their values.
    senses: Vec<([usize; 2], Vec<usize>)>,
    /// Frames that have to say the same.
    frames: usize,
    named: Vec<[usize; 2]>,
    /// What the last frames say instead, and how many.
    other: (Vec<[usize; 2]>, usize),
}

impl Rails {
    /// `senses`: all sense pairs of the pattern with their values; `frames`: how many have to say the same.
    pub(crate) fn new(senses: Vec<([usize; 2], Vec<usize>)>, frames: usize) -> Self {
        Self {
            senses,
            frames,
            named: Vec::new(),
            other: (Vec::new(), 0),
        }
    }

    /// Takes which values of a frame are missing, of those that the baseline had. True where others are named now. Where all are missing it
    /// is no amplifier.
    pub(crate) fn take(&mut self, missing: &[bool], had: &[bool]) -> bool {
        if self.named.is_empty() && self.other.1 == 0 && !missing.contains(&true) {
            return false;
        }
        let some_are_there = had.iter().zip(missing).any(|(had, missing)| *had && !missing);
        let mut rails = Vec::new();
        for (pair, values) in self.senses.iter().filter(|_| some_are_there) {
            let mut had = values.iter().filter(|k| had[**k]);
            if had.clone().count() >= LEAST && had.all(|k| missing[*k]) {
                rails.push(*pair);
            }
        }
        rails.sort_unstable();
        if rails == self.named {
            self.other.1 = 0;
            return false;
        }
        let (before, times) = &mut self.other;
        *times = if *before == rails { *times + 1 } else { 1 };
        *before = rails;
        if *times < self.frames {
            return false;
        }
        self.named.clone_from(before);
        *times = 0;
        true
    }

    /// Sense pairs whose amplifiers are named.
    pub(crate) fn named(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        self.named.iter().copied()
    }

    /// Their values.
    pub(crate) fn values(&self) -> impl Iterator<Item = usize> + '_ {
        let named = self.senses.iter().filter(|(pair, _)| self.named.contains(pair));
        named.flat_map(|(_, values)| values.iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VALUES: usize = 12;

    fn rails(frames: usize) -> Rails {
        Rails::new(
            (0..4).map(|k| ([k, k + 1], (3 * k..3 * k + 3).collect())).collect(),
            frames,
        )
    }

    fn missing(values: &[usize]) -> Vec<bool> {
        (0..VALUES).map(|k| values.contains(&k)).collect()
    }

    /// Each is told by its own values, beside values of others that are missing, from the second frame on.
    #[test]
    fn amplifiers_are_named_and_forgotten_by_the_second_frame_that_says_so() {
        // The baseline does not have the first value either.
        let had: Vec<bool> = (0..VALUES).map(|k| k > 0).collect();
        let mut rails = rails(2);
        assert!(!rails.take(&missing(&[5]), &had));
        let (one, both) = (missing(&[1, 2, 5]), missing(&[1, 2, 9, 10, 11]));
        assert!(!rails.take(&one, &had) && rails.take(&missing(&[1, 2]), &had));
        assert!(rails.named().eq([[0, 1]]) && rails.values().eq([0, 1, 2]));
        assert!(!rails.take(&both, &had) && rails.take(&both, &had));
        assert!(rails.named().eq([[0, 1], [3, 4]]));
        // One frame ends nothing.
        assert!(!rails.take(&missing(&[]), &had) && !rails.take(&both, &had));
        assert!(!rails.take(&missing(&[]), &had) && rails.take(&missing(&[]), &had));
        assert_eq!(rails.named().count(), 0);
    }

    /// A frame of a table says nothing of the next one. Nothing at all, or a single value, is no amplifier.
    #[test]
    fn each_frame_of_a_table_stands_alone() {
        let had = vec![true; VALUES];
        let mut rails = rails(1);
        assert!(rails.take(&missing(&[3, 4, 5]), &had) && rails.named().eq([[1, 2]]));
        assert!(rails.take(&missing(&[0, 1, 2]), &had) && rails.named().eq([[0, 1]]));
        assert!(rails.take(&[true; VALUES], &had) && rails.named().count() == 0);
        let mut single = had;
        (single[7], single[8]) = (false, false);
        assert!(!rails.take(&missing(&[6]), &single));
    }
}
