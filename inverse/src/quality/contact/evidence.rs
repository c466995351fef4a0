//! What a frame comes to with or without a contact.

use crate::quality::contact::options::ContactOptions;

/// The cost of one explanation of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Evidence {
    /// Chi-square and the number of parameters: of touches, and of directions left out.
    pub(crate) cost: f64,
    /// What touches leave open, beside the number of their parameters: see [`Fitted::open`](crate::touches::fit::frame_fit::Fitted::open).
    pub(crate) open: f64,
    /// Mean square of the residual, in variances of the noise.
    pub(crate) misfit: f64,
    /// Chi-square that the model of touches may be wrong by.
    pub(crate) model: f64,
}

impl std::ops::Add for Evidence {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            cost: self.cost + other.cost,
            open: self.open + other.open,
            misfit: self.misfit + other.misfit,
            model: self.model + other.model,
        }
    }
}

impl Evidence {
    /// Of a sum over frames, the mean.
    pub(crate) fn mean_of(self, frames: usize) -> Self {
        let part = 1.0 / frames as f64;
        Self {
            cost: part * self.cost,
            open: part * self.open,
            misfit: part * self.misfit,
            model: part * self.model,
        }
    }

    /// Whether this explains a frame better by a margin, and by more than the model of touches may be wrong.
    pub(crate) fn cheaper_than(self, other: Self, margin: f64) -> bool {
        self.cost + margin + self.model < other.cost
    }

    /// Whether this is more probable than another explanation with touches of its own, by a margin of minus twice the logarithm, and by
    /// more than the model of touches may be wrong.
    pub(crate) fn more_probable_than(self, other: Self, margin: f64) -> bool {
        self.cost + self.open + margin + self.model < other.cost + other.open
    }

    /// Whether a contact that was accepted stays so: this is with it.
    pub(crate) fn stays(self, without: Self, options: &ContactOptions) -> bool {
        self.cost + options.margin + self.model < without.cost
    }

    /// Whether this, with a contact, is accepted rather than that without. What it takes away may be the error of the model of either's
    /// touches.
    pub(crate) fn instead_of(self, without: Self, options: &ContactOptions) -> bool {
        let model = self.model.max(without.model);
        self.cost + options.margin_accepted + model < without.cost && self.explains_of(without, options)
    }

    /// Whether this leaves little of what another leaves unexplained. What only lessens it fits the error of the model of touches.
    pub(crate) fn explains_of(self, without: Self, options: &ContactOptions) -> bool {
        let unexplained = |evidence: Self| (evidence.misfit - options.explained).max(0.0);
        unexplained(self) <= options.of_unexplained * unexplained(without)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A contact takes away what the model of touches without it may be wrong by: that makes it none.
    #[test]
    fn the_error_of_the_model_of_touches_is_no_contact() {
        let options = ContactOptions::default();
        let of = |cost, misfit, model| Evidence {
            cost,
            open: 0.0,
            misfit,
            model,
        };
        let with = of(100.0, 1.0, 5.0);
        for (model, accepted) in [(5.0, true), (180.0, true), (200.0, false)] {
            assert_eq!(with.instead_of(of(300.0, 2.5, model), &options), accepted, "{model}");
        }
    }
}
