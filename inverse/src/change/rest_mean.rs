//! The mean of frames at rest.

/// Frames one after another in which nothing changed. Nothing is allocated once it is as large as a frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct RestMean {
    /// Mean of those that the result is of, and how many.
    mean: Vec<f64>,
    frames: usize,
    /// Sums of those since then, whole and reduced, and how many.
    sum: Vec<f64>,
    reduced: Vec<f64>,
    since: usize,
    grown: bool,
    /// Whether the mean is to be reconstructed once more, and how often it was.
    again: bool,
    rounds: usize,
}

impl RestMean {
    /// The mean of the frames that the result is, or is to be, of.
    pub(crate) fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// How many there are.
    pub(crate) fn frames(&self) -> usize {
        self.frames
    }

    /// Whether frames of the result before are among them.
    pub(crate) fn has_grown(&self) -> bool {
        self.grown
    }

    /// Frames since then.
    pub(super) fn since(&self) -> usize {
        self.since
    }

    /// The sum of those, reduced.
    pub(super) fn reduced_sum(&self) -> &[f64] {
        &self.reduced
    }

    /// Begins with a frame.
    pub(super) fn begin(&mut self, frame: &[f64]) {
        self.mean.clear();
        self.mean.extend_from_slice(frame);
        (self.frames, self.grown) = (1, false);
        self.clear();
    }

    /// Has no frames any more.
    pub(super) fn end(&mut self) {
        if self.frames > 0 {
            self.frames = 0;
            self.clear();
        }
    }

    /// Forgets the frames since the result.
    fn clear(&mut self) {
        self.sum.clear();
        self.sum.resize(self.mean.len(), 0.0);
        self.reduced.fill(0.0);
        self.since = 0;
        (self.again, self.rounds) = (false, 0);
    }

    /// Takes a frame.
    pub(super) fn add(&mut self, frame: &[f64], reduced: &[f64]) {
        self.sum.iter_mut().zip(frame).for_each(|(s, v)| *s += v);
        self.reduced.resize(reduced.len(), 0.0);
        self.reduced.iter_mut().zip(reduced).for_each(|(s, v)| *s += v);
        self.since += 1;
    }

    /// Makes the mean that of the frames since the result, and where `all` of those before as well.
    pub(super) fn renew(&mut self, all: bool) {
        let before = if all { self.frames } else { 0 };
        let count = before + self.since;
        for (mean, sum) in self.mean.iter_mut().zip(&self.sum) {
            *mean = (*mean * before as f64 + sum) / count as f64;
        }
        (self.frames, self.grown) = (count, all);
        self.clear();
    }

    /// Asks for the mean to be reconstructed once more, so often at most.
    pub(super) fn once_more(&mut self, most_rounds: usize) {
        self.again = self.rounds < most_rounds;
        self.rounds += 1;
        self.grown = true;
    }

    /// Whether that was asked for; it is not any more.
    pub(super) fn take_again(&mut self) -> bool {
        std::mem::take(&mut self.again)
    }
}
