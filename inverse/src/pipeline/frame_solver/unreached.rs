//! What a frame tells by the directions that touches hardly reach: its noise and its wild values, where reciprocity tells neither.

use super::FrameSolver;
use crate::quality::faults::leave_out;
use crate::reference::Difference;
use crate::reference::drift::Drifting;
use crate::reference::noise::{NoiseEstimate, NoiseSource};

/// One in so many directions tells the noise where nothing else does: the response to a touch is there a hundredth of its
/// largest part, or less.
const LEAST_REACHED: usize = 8;
/// Least noise that is found so, over the root mean square of the frame: exact frames have none.
const LEAST_NOISE: f64 = 1e-4;

/// Whether the noise is known well enough without these directions: a few pairs that happen to be reciprocal do not tell it.
pub(super) fn tells_noise(noise: Option<NoiseEstimate>, difference: &Difference) -> bool {
    let used = difference.used.iter().filter(|used| **used).count();
    noise.is_some_and(|noise| noise.source.freedom() >= (used / LEAST_REACHED) as f64)
}

impl FrameSolver {
    /// Leaves out the values of a frame that have nothing to do with the others, where reciprocity does not tell them. What lies outside
    /// of the directions that touches reach does. Frames that follow one another are held against faults instead.
    pub(crate) fn leave_out_wild(&mut self, noise: Option<NoiseEstimate>, difference: &mut Difference) {
        if self.options.sequence || tells_noise(noise, difference) {
            return;
        }
        self.weigh(difference, (Drifting::Common, &[]));
        self.reduce(difference);
        let rank = self.reduced.len();
        let Some(weighted) = self.weightings.current_mut() else {
            return;
        };
        let wild = weighted
            .unreached(rank - rank / LEAST_REACHED)
            .wild(&self.values, self.options.false_alarm);
        if !wild.is_empty() {
            let mut used = difference.used.clone();
            wild.iter().for_each(|k| used[*k] = false);
            leave_out(difference, used);
        }
    }

    /// The noise by the part of the frame that touches hardly reach: the directions of the least singular values. What the model
    /// gets wrong there counts as noise.
    pub(super) fn residual_noise(&self) -> Option<NoiseEstimate> {
        let rank = self.reduced.len();
        let freedom = (rank / LEAST_REACHED).max(1).min(rank);
        let square = self.reduced[rank - freedom..].iter().map(|v| v * v).sum::<f64>() / freedom.max(1) as f64;
        let least = LEAST_NOISE * self.power().sqrt();
        (rank > 0).then(|| NoiseEstimate {
            sigma: square.sqrt().max(least),
            source: NoiseSource::Residual { freedom },
        })
    }
}
