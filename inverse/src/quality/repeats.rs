//! The same frame again and again: a buffer that nobody fills any more.

use crate::quality::doubt::Doubt;
use crate::reference::baseline::Baseline;

/// So many frames one after another that are the same to the last bit are no measurement.
const MOST: usize = 8;

/// Counts frames that are the same.
#[derive(Clone, Debug, Default)]
pub(crate) struct Repeats {
    /// Whether frames at rest may be the same: noise is less than a step of the converter, or there is none.
    may_be: bool,
    last: Vec<u64>,
    count: usize,
    /// What was doubted of the last frame beside this.
    covered: Option<Option<Doubt>>,
}

impl Repeats {
    /// For frames after a baseline that was taken before.
    pub(crate) fn after(baseline: &Baseline) -> Self {
        Self {
            may_be: baseline.noise_v == 0.0,
            ..Self::default()
        }
    }

    /// Takes a frame of a baseline. Where one is as the one before, later ones may be as well.
    pub(crate) fn rest(&mut self, values_v: &[f64]) {
        self.may_be |= self.is_same(values_v);
    }

    /// What is doubted of a last frame without this.
    pub(crate) fn uncover(&mut self, doubt: &mut Option<Doubt>) {
        if let Some(covered) = self.covered.take() {
            *doubt = covered;
        }
    }

    /// Takes a frame, and doubts it where it is one of many that are the same. What is known to be broken says more.
    pub(crate) fn take(&mut self, values_v: &[f64], doubt: &mut Option<Doubt>) {
        self.count = if self.is_same(values_v) { self.count + 1 } else { 0 };
        let says_less = matches!(
            doubt,
            None | Some(Doubt::NotTouches | Doubt::Unplaced | Doubt::NotReciprocal | Doubt::Gone { .. })
        );
        if !self.may_be && self.count >= MOST && says_less {
            self.covered = Some(doubt.replace(Doubt::Repeated));
        }
    }

    fn is_same(&mut self, values_v: &[f64]) -> bool {
        let same = self.last.iter().copied().eq(values_v.iter().map(|v| v.to_bits()));
        if !same {
            self.last.clear();
            self.last.extend(values_v.iter().map(|v| v.to_bits()));
        }
        same
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: [f64; 4] = [1.0, 2.0, f64::NAN, 4.0];

    /// After how many frames that are all the same the doubt is there.
    fn doubted_after(repeats: &mut Repeats) -> Option<usize> {
        (0..40).find(|_| {
            let mut doubt = None;
            repeats.take(&FRAME, &mut doubt);
            doubt == Some(Doubt::Repeated)
        })
    }

    #[test]
    fn the_same_frame_again_and_again_is_doubted_until_another_comes() {
        let mut repeats = Repeats::default();
        repeats.rest(&[1.0, 2.1, 3.0, 4.0]);
        repeats.rest(&[1.0, 2.0, 3.1, 4.0]);
        assert_eq!(doubted_after(&mut repeats), Some(MOST));
        let mut doubt = Some(Doubt::Repeated);
        repeats.uncover(&mut doubt);
        assert_eq!(doubt, None);
        let mut doubt = Some(Doubt::NotTouches);
        repeats.take(&[1.0, 2.0, f64::NAN, 4.1], &mut doubt);
        repeats.uncover(&mut doubt);
        assert_eq!(doubt, Some(Doubt::NotTouches));
    }

    #[test]
    fn what_is_broken_is_not_hidden() {
        let mut repeats = Repeats::default();
        for _ in 0..40 {
            let mut doubt = Some(Doubt::FewValues { used: 0, of: 4 });
            repeats.take(&[f64::NAN; 4], &mut doubt);
            assert_eq!(doubt, Some(Doubt::FewValues { used: 0, of: 4 }));
        }
    }

    #[test]
    fn frames_may_be_the_same_where_those_of_the_baseline_were() {
        let mut repeats = Repeats::default();
        repeats.rest(&FRAME);
        repeats.rest(&FRAME);
        assert_eq!(doubted_after(&mut repeats), None);
        let frames = [[1.0, 2.0, 3.0, 4.0].as_slice(); 8];
        assert_eq!(
            doubted_after(&mut Repeats::after(&Baseline::of_frames(4, &frames))),
            None
        );
    }
}
