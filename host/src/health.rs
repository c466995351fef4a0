//! Which values of a frame cannot be believed: a lost electrode, a stuck channel, a glitch, told from the frame itself.
//!
//! Where values are wrong, reciprocal pairs disagree by more than all the others do. Suspects are every electrode, every
//! pair of electrodes and every single pair of values; one is left out when the rest then agrees so much better that chance
//! would not do it (Fisher's test), and the search goes on with the rest.

use crate::imager::Difference;
use crate::noise::{Disagreement, Reciprocity};
use forward::Pattern;
use statrs::distribution::{ContinuousCDF, FisherSnedecor};

/// Probability that chance alone leaves a suspect out.
const FALSE_ALARM: f64 = 1e-6;
/// Most suspects left out of a frame.
const MOST_FAULTS: usize = 4;
/// A smaller suspect is preferred when it explains as much of the disagreement, up to this factor of the noise.
const AS_GOOD: f64 = 1.2;
/// Suspects whose mean square is below this many times that of the others are not looked at.
const WORTH_A_LOOK: f64 = 2.5;

/// Finds faults in frames of one pattern.
#[derive(Clone, Debug)]
pub struct Health {
    /// Measurements of every suspect, the smaller suspects first: pairs of electrodes, then electrodes.
    suspects: Vec<Vec<bool>>,
}

impl Health {
    /// Lists the suspects of a pattern.
    pub fn new(pattern: &Pattern) -> Self {
        let measurements = pattern.measurements();
        let same = |a: forward::Pair, b: forward::Pair| a == b || a == b.reversed();
        let pairs = pattern.drives().iter().map(|p| {
            measurements
                .iter()
                .map(|m| same(m.drive, *p) || same(m.sense, *p))
                .collect()
        });
        let electrodes = (0..pattern.electrodes()).map(|l| {
            let touches = |p: forward::Pair| p.plus == l || p.minus == l;
            measurements
                .iter()
                .map(|m| touches(m.drive) || touches(m.sense))
                .collect()
        });
        Self {
            suspects: pairs.chain(electrodes).collect(),
        }
    }

    /// Takes the values that cannot be believed out of a difference (their `used` becomes false). Returns what the rest
    /// disagrees by, `None` where the pattern has no reciprocal pairs.
    pub fn judge(&self, reciprocity: &Reciprocity, model_v: &[f64], d: &mut Difference) -> Option<Disagreement> {
        let look = |d: &Difference, used: &[bool]| reciprocity.disagreement(&d.y, model_v, &d.spread, used);
        let mut now = look(d, &d.used)?;
        for _ in 0..MOST_FAULTS {
            let Some((used, better)) = self.worst(&now, &d.used, |used| look(d, used)) else {
                break;
            };
            for (y, used) in d.y.iter_mut().zip(&used) {
                if !used {
                    *y = 0.0;
                }
            }
            d.used = used;
            now = better;
        }
        Some(now)
    }

    /// The suspect without which the rest agrees best, if that is more than chance.
    fn worst(
        &self,
        now: &Disagreement,
        used: &[bool],
        look: impl Fn(&[bool]) -> Option<Disagreement>,
    ) -> Option<(Vec<bool>, Disagreement)> {
        let mut chosen: Option<(f64, Vec<bool>, Disagreement)> = None;
        let mut consider = |without: Vec<bool>| {
            let Some(rest) = look(&without) else { return };
            let Some(noise) = rest.noise() else { return };
            let gone = now.freedom.saturating_sub(rest.freedom);
            if gone == 0 {
                return;
            }
            let ratio = (now.square - rest.square) / gone as f64 / noise.sigma.powi(2).max(f64::MIN_POSITIVE);
            let tries = (self.suspects.len() + now.pairs.len()) as f64;
            let limit = FisherSnedecor::new(gone as f64, rest.freedom as f64)
                .map_or(f64::INFINITY, |f| f.inverse_cdf(1.0 - FALSE_ALARM / tries));
            if ratio > limit && chosen.as_ref().is_none_or(|(sigma, ..)| noise.sigma * AS_GOOD < *sigma) {
                chosen = Some((noise.sigma, without, rest));
            }
        };
        // One pair of values: the one that disagrees most.
        if let Some((k, _)) = now
            .left
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
        {
            let mut without = used.to_vec();
            now.pairs[k].iter().for_each(|m| without[*m] = false);
            consider(without);
        }
        for suspect in &self.suspects {
            let (mut inside, mut outside, mut count) = (0.0, 0.0, 0);
            for (pair, left) in now.pairs.iter().zip(&now.left) {
                if suspect[pair[0]] || suspect[pair[1]] {
                    inside += left * left;
                    count += 1;
                } else {
                    outside += left * left;
                }
            }
            let others = now.pairs.len() - count;
            if count > 0 && others > 0 && inside / count as f64 > WORTH_A_LOOK * outside / others as f64 {
                consider(used.iter().zip(suspect).map(|(u, s)| *u && !s).collect());
            }
        }
        chosen.map(|(_, used, rest)| (used, rest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::Drive;
    use nalgebra::DVector;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    struct Frames {
        pattern: Pattern,
        model_v: Vec<f64>,
        rng: rand::rngs::StdRng,
    }

    impl Frames {
        fn new() -> Self {
            let pattern = Pattern::adjacent(16).unwrap();
            let model_v = vec![1.0; pattern.len()];
            Self {
                pattern,
                model_v,
                rng: rand::rngs::StdRng::seed_from_u64(5),
            }
        }

        fn quiet(&mut self) -> Difference {
            let n = self.pattern.len();
            let y = DVector::from_fn(n, |_, _| 1e-4 * self.rng.sample::<f64, _>(StandardNormal));
            Difference {
                y,
                used: vec![true; n],
                spread: vec![1.0; n],
            }
        }

        fn judge(&self, d: &mut Difference) -> f64 {
            let reciprocity = Reciprocity::new(&self.pattern, Drive::PAPER);
            let rest = Health::new(&self.pattern)
                .judge(&reciprocity, &self.model_v, d)
                .unwrap();
            rest.noise().unwrap().sigma
        }
    }

    #[test]
    fn sound_frames_are_left_alone() {
        let mut frames = Frames::new();
        for _ in 0..300 {
            let mut d = frames.quiet();
            frames.judge(&mut d);
            assert!(d.used.iter().all(|u| *u));
        }
    }

    #[test]
    fn a_lost_electrode_is_left_out_and_no_more() {
        let mut frames = Frames::new();
        for l in 0..16 {
            let mut d = frames.quiet();
            let touches: Vec<bool> = frames
                .pattern
                .measurements()
                .iter()
                .map(|m| [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus].contains(&l))
                .collect();
            for (y, _) in d.y.iter_mut().zip(&touches).filter(|(_, t)| **t) {
                *y = frames.rng.random_range(-2.0..2.0);
            }
            let sigma = frames.judge(&mut d);
            assert!((sigma / 1e-4 - 1.0).abs() < 0.35, "{l}: {sigma}");
            assert!(d.used.iter().zip(&touches).all(|(u, t)| *u != *t), "{l}");
        }
    }

    #[test]
    fn a_glitch_takes_its_pair_only() {
        let mut frames = Frames::new();
        let mut d = frames.quiet();
        d.y[77] = 0.5;
        let sigma = frames.judge(&mut d);
        assert!((sigma / 1e-4 - 1.0).abs() < 0.35, "{sigma}");
        assert!(!d.used[77] && d.used.iter().filter(|u| !**u).count() == 2);
    }
}
