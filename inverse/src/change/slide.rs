//! Touches that slide: whether they came to rest.

/// Frames of touches that slide, in blocks of which each is compared with the one before. Nothing is allocated once it is as large as
/// three reduced frames.
///
/// A slide may take n frames to make a frame new, or a mean drift. Blocks of 2 n frames then differ by twice as much. Their noise
/// is smaller. What is slower is seen as a slide later.
#[derive(Clone, Debug, Default)]
pub(crate) struct Slide {
    /// Frames since touches at rest moved last; none before they did. And by what they moved then, reduced.
    moved: Option<usize>,
    way: Vec<f64>,
    /// Frames of a block, where touches slide; else 0.
    length: usize,
    /// Sum of the block's reduced frames so far, and how many.
    sum: Vec<f64>,
    frames: usize,
    /// The sum over the block before; empty where there is none.
    before: Vec<f64>,
}

impl Slide {
    /// Touches at rest have moved `by` so much. Noise alone does that now and then, and the next frames go back. The touches slide where
    /// they `go_on`, told of the move before and of this one, no more than `most` frames later. A block has no more frames, either.
    pub(super) fn note_move(
        &mut self,
        most: usize,
        by: impl Iterator<Item = f64>,
        go_on: impl FnOnce(&[f64], &[f64]) -> bool,
    ) {
        let since = self.moved.replace(0).filter(|since| *since <= most);
        self.sum.clear();
        self.sum.extend(by);
        if let Some(since) = since.filter(|_| go_on(&self.way, &self.sum)) {
            self.length = (2 * since.max(1)).min(most);
            self.before.clear();
        }
        self.frames = 0;
        std::mem::swap(&mut self.sum, &mut self.way);
    }

    /// Whether the touches slide.
    pub(super) fn is_on(&self) -> bool {
        self.length > 0
    }

    /// Takes a reduced frame. A complete block ends the slide if it is the `same` as the one before. That is told of their difference,
    /// and of the variance of its noise over that of one frame.
    pub(super) fn take(&mut self, reduced: &[f64], same: impl FnOnce(&[f64], f64) -> bool) {
        self.moved = self.moved.map(|since| since + 1);
        if !self.is_on() {
            return;
        }
        if self.frames == 0 {
            self.sum.clear();
            self.sum.resize(reduced.len(), 0.0);
        }
        self.sum.iter_mut().zip(reduced).for_each(|(s, v)| *s += v);
        self.frames += 1;
        if self.frames < self.length {
            return;
        }
        let share = 1.0 / self.frames as f64;
        self.frames = 0;
        std::mem::swap(&mut self.sum, &mut self.before);
        if self.sum.len() == self.before.len() {
            self.sum
                .iter_mut()
                .zip(&self.before)
                .for_each(|(s, b)| *s = share * (b - *s));
            if same(&self.sum, 2.0 * share) {
                self.length = 0;
            }
        }
    }

    /// Forgets all: nothing touches.
    pub(super) fn end(&mut self) {
        self.moved = None;
        self.length = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Takes a frame of one direction, without noise.
    fn take(slide: &mut Slide, at: f64) {
        slide.take(&[at, 1.0], |difference, noise| {
            assert_eq!(difference.len(), 2);
            assert!(noise > 0.0);
            difference[0].abs() <= noise.sqrt()
        });
    }

    fn note(slide: &mut Slide, by: f64) {
        slide.note_move(16, [by, 0.0].into_iter(), |before, now| before[0] * now[0] > 0.0);
    }

    /// Moved by one, and after so many frames by so much more.
    fn moved(after: usize, on: f64) -> Slide {
        let mut slide = Slide::default();
        note(&mut slide, 1.0);
        (0..after).for_each(|_| take(&mut slide, 0.0));
        note(&mut slide, on);
        slide
    }

    #[test]
    fn a_slide_takes_two_moves_one_soon_after_the_other_and_onwards() {
        assert!(moved(1, 1.0).is_on() && moved(16, 0.1).is_on());
        assert!(!moved(17, 1.0).is_on());
        assert!(!moved(1, -1.0).is_on());
        let mut slide = Slide::default();
        note(&mut slide, 1.0);
        assert!(!slide.is_on());
        slide.end();
        note(&mut slide, 1.0);
        assert!(!slide.is_on());
    }

    /// It goes on as long as the blocks differ, and ends after two that are the same: 12 frames where frames move three apart.
    #[test]
    fn a_slide_ends_at_rest() {
        let mut slide = moved(3, 1.0);
        for k in 0..600 {
            take(&mut slide, 0.5 * f64::from(k));
            assert!(slide.is_on(), "{k}");
        }
        for k in 0..12 {
            assert!(slide.is_on(), "{k}");
            take(&mut slide, 300.0);
        }
        assert!(!slide.is_on());
        take(&mut slide, 900.0);
        assert!(!slide.is_on());
    }
}
