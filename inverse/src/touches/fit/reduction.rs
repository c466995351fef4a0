//! The way of a frame of the model into the space of the data.

use crate::solvers::Projector;

/// Brings frames of the model into the space of the data, the way that the measurement took.
pub trait Reduce {
    /// Appends a frame of the model (V, in the pattern's order) to `reduced`, as data.
    fn reduce(&mut self, volts: &[f64], reduced: &mut Vec<f64>);
}

/// Weights by the values' noise, then projects onto the rows of the weighted problem.
#[derive(Debug)]
pub struct WeightedProjection<'a> {
    /// Which values take part.
    pub used: &'a [bool],
    /// Noise of every value over that of the others.
    pub spread: &'a [f64],
    /// Onto the rows of the problem that was weighted so.
    pub projector: &'a mut Projector,
}

impl Reduce for WeightedProjection<'_> {
    fn reduce(&mut self, volts: &[f64], reduced: &mut Vec<f64>) {
        let (used, spread) = (self.used, self.spread);
        let weight = |k: usize| if used[k] { 1.0 / spread[k] } else { 0.0 };
        let fill = |to: &mut [f64]| {
            to.iter_mut()
                .zip(volts)
                .enumerate()
                .for_each(|(k, (to, v))| *to = v * weight(k))
        };
        reduced.extend_from_slice(self.projector.project(fill));
    }
}
