//! Touches that slide: whether they came to rest.

/// Least cosine of the angle between two moves that go the same way.
const SAME_WAY: f64 = 0.5;

/// Frames of touches that slide, in blocks of which each is compared with the one before. Nothing is allocated once it is as large as
/// three reduced frames.
///
/// A slide may take n frames to make a frame new, or a mean drift. Blocks of 2 n frames then differ by twice as much. Their noise
/// is smaller. What is slower is seen as a slide later.
#[derive(Clone, Debug, Default)]
pub(crate) struct Slide {
    /// Frames since touches at rest moved last; none before they did. And by what they moved then, reduced.
    moved: Option<usize>,
    last_move: Vec<f64>,
    /// Frames of a block, where touches slide; else 0.
    length: usize,
    /// Sum of the block's reduced frames so far, and how many.
    sum: Vec<f64>,
    frames: usize,
    /// The sum over the block before; empty where there is none.
    sum_before: Vec<f64>,
}

impl Slide {
    /// Touches at rest have changed `by` so much. `product` multiplies what two differences do to places. Where that of the difference
    /// with itself is within the `limit`, places have not moved. The touches slide where they go on the same way, within `2 most`
    /// frames after the move before: the mean of `most` frames, and as many to compare. A block has `most` frames at most.
    pub(super) fn note(
        &mut self,
        most: usize,
        by: impl Iterator<Item = f64>,
        limit: f64,
        product: impl Fn(&[f64], &[f64]) -> f64,
    ) {
        self.sum.clear();
        self.sum.extend(by);
        self.frames = 0;
        if product(&self.sum, &self.sum) <= limit {
            return;
        }
        let since = self.moved.replace(0).filter(|since| *since <= 2 * most);
        let goes_on = |before: &[f64], now: &[f64]| {
            product(before, now) > SAME_WAY * (product(before, before) * product(now, now)).sqrt()
        };
        if let Some(since) = since.filter(|_| goes_on(&self.last_move, &self.sum)) {
            self.length = (2 * since.max(1)).min(most);
            self.sum_before.clear();
        }
        std::mem::swap(&mut self.sum, &mut self.last_move);
    }

    /// Whether the touches slide.
    pub(super) fn is_on(&self) -> bool {
        self.length > 0
    }

    /// Takes a reduced frame. A complete block ends the slide where places have not moved since the one before. `product` is that of
    /// [`Self::note`], and `limit` that of a difference with the noise of one frame.
    pub(super) fn take(&mut self, reduced: &[f64], limit: f64, product: impl Fn(&[f64], &[f64]) -> f64) {
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
        std::mem::swap(&mut self.sum, &mut self.sum_before);
        if self.sum.len() == self.sum_before.len() {
            let both = self.sum.iter_mut().zip(&self.sum_before);
            both.for_each(|(s, b)| *s = share * (b - *s));
            if product(&self.sum, &self.sum) <= 2.0 * share * limit {
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

    /// The first two of three entries are those of places.
    fn product(a: &[f64], b: &[f64]) -> f64 {
        assert_eq!((a.len(), b.len()), (3, 3));
        a[0] * b[0] + a[1] * b[1]
    }

    fn take(slide: &mut Slide, at: f64) {
        slide.take(&[at, 0.0, 1.0], 1.0, product);
    }

    fn note(slide: &mut Slide, [x, y]: [f64; 2]) {
        slide.note(16, [x, y, 5.0].into_iter(), 0.005, product);
    }

    /// Moved by one, and after so many frames by so much more.
    fn moved(after: usize, on: [f64; 2]) -> Slide {
        let mut slide = Slide::default();
        note(&mut slide, [1.0, 0.0]);
        (0..after).for_each(|_| take(&mut slide, 0.0));
        note(&mut slide, on);
        slide
    }

    #[test]
    fn a_slide_takes_two_moves_one_soon_after_the_other_the_same_way() {
        assert!(moved(1, [1.0, 0.0]).is_on() && moved(32, [0.1, 0.0]).is_on());
        assert!(!moved(33, [1.0, 0.0]).is_on());
        assert!(!moved(1, [0.05, 0.0]).is_on());
        for (degrees, on) in [(0.0, true), (55.0, true), (-65.0, false), (180.0, false)] {
            let angle = f64::to_radians(degrees);
            assert_eq!(moved(1, [angle.cos(), angle.sin()]).is_on(), on, "{degrees}");
        }
        let mut slide = Slide::default();
        note(&mut slide, [1.0, 0.0]);
        assert!(!slide.is_on());
        slide.end();
        note(&mut slide, [1.0, 0.0]);
        assert!(!slide.is_on());
    }

    /// It goes on as long as the blocks differ, and ends after two that are the same: 12 frames where the two moves were three frames apart.
    #[test]
    fn a_slide_ends_at_rest() {
        let mut slide = moved(3, [1.0, 0.0]);
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
