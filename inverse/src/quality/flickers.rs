//! Frames that come and go by themselves: a contact, a supply or a cable that fails now and then.
//!
//! A touch that comes down or lifts leaves another scene behind. Where touches do not explain a frame or two, and the frame after is as the
//! one before, nothing came down; or somebody taps as fast as frames come, and then these frames show no touch as it is either.

use crate::stats::is_of_noise;

/// Most frames one after another that may come and go.
const MOST: usize = 2;
/// So many of them are no chance any more.
const OFTEN: f64 = 2.5;
/// Frames after which one counts half.
const HALF: f64 = 256.0;

/// What a frame is after the ones before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Flicker {
    /// Unlike them: it may come and go.
    Unlike,
    /// What was unlike has come and gone.
    Gone,
    /// Nothing of the kind.
    Nothing,
}

/// Counts frames that come and go.
#[derive(Clone, Debug, Default)]
pub(crate) struct Flickers {
    /// The last frame that was explained.
    before: Vec<f64>,
    /// Frames since that were not.
    run: usize,
    /// How many came and went, each less the longer ago.
    count: f64,
}

impl Flickers {
    /// Whether that is so again and again.
    pub(crate) fn often(&self) -> bool {
        self.count > OFTEN
    }

    /// Takes a frame, of which these values take part, and whether touches leave it unexplained; `noise` is that of every value.
    pub(crate) fn take(&mut self, values: &[f64], used: &[bool], unexplained: bool, noise: &[f64]) -> Flicker {
        self.count *= 0.5_f64.powf(1.0 / HALF);
        if unexplained {
            // A search that came to no end in a scene at rest is no flicker.
            self.run += usize::from(!is_alike(&self.before, values, used, noise));
            return Flicker::Unlike;
        }
        let is_gone = (1..=MOST).contains(&self.run) && is_alike(&self.before, values, used, noise);
        self.count += f64::from(u8::from(is_gone));
        self.run = 0;
        self.before.clear();
        self.before.extend_from_slice(values);
        if is_gone { Flicker::Gone } else { Flicker::Nothing }
    }
}

/// Whether the used values of a frame differ from those of another by nothing but noise, of this standard deviation of each. What is no
/// number says nothing.
pub(crate) fn is_alike(other: &[f64], values: &[f64], used: &[bool], noise: &[f64]) -> bool {
    let both = other.iter().zip(values).zip(noise).zip(used).filter(|(_, used)| **used);
    let changes = both.map(|(((before, now), noise), _)| (now - before) / noise);
    let (mut square, mut count) = (0.0, 0.0_f64);
    for change in changes.filter(|change| change.is_finite()) {
        square += change.powi(2);
        count += 1.0;
    }
    // Two frames differ by twice the variance of one.
    count > 0.0 && is_of_noise(0.5 * square, count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    const VALUES: usize = 208;

    /// Frames of noise beside steps: each frame's step, and whether it is unexplained.
    fn often(frames: impl Iterator<Item = (f64, bool)>) -> bool {
        let mut rng = rand::rngs::StdRng::seed_from_u64(7);
        let mut flickers = Flickers::default();
        for (step, unexplained) in frames {
            let values: Vec<f64> = (0..VALUES)
                .map(|_| step + rng.sample::<f64, _>(StandardNormal))
                .collect();
            flickers.take(&values, &[true; VALUES], unexplained, &[1.0; VALUES]);
        }
        flickers.often()
    }

    #[test]
    fn what_comes_and_goes_three_times_is_no_chance() {
        let flicker = |every: usize| (0..60).map(move |k| if k % every == 7 { (30.0, true) } else { (0.0, false) });
        assert!(often(flicker(15)));
        assert!(!often(flicker(15).take(30)), "twice");
        // One in so many frames is forgotten before the next two.
        let seldom = (0..4000).map(|k| if k % 400 == 7 { (30.0, true) } else { (0.0, false) });
        assert!(!often(seldom));
    }

    /// A touch leaves another scene behind, whatever becomes of it later; so does one that lifts. What stays is no flicker either.
    #[test]
    fn touches_that_come_down_and_lift_do_not_count() {
        let tap = |k: usize| match k % 20 {
            5 => (10.0, true),
            6..15 => (20.0, false),
            15 => (10.0, true),
            _ => (0.0, false),
        };
        assert!(!often((0..400).map(tap)));
        assert!(!often((0..400).map(|k| (30.0, k % 40 > 20))));
        assert!(!often((0..400).map(|_| (0.0, false))));
        // A scene at rest that is explained now and then not.
        assert!(!often((0..400).map(|k| (5.0, k % 15 == 7))));
    }
}
