//! Which way touches change the resistivity.

/// Which way the discs of a frame may change the resistivity.
///
/// Most sensor rubbers conduct worse under pressure, most foams better. Things in a tank may do either.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Polarity {
    /// It rises.
    #[default]
    Up,
    /// It falls.
    Down,
    /// Each of them as it will.
    Either,
}

impl Polarity {
    /// Whether a disc of this strength, or a projection of this sign, may be one. 0 may not.
    pub fn allows(self, strength: f64) -> bool {
        match self {
            Self::Up => strength > 0.0,
            Self::Down => strength < 0.0,
            Self::Either => strength != 0.0,
        }
    }

    /// The strength, at least of the size `least`, with a sign that is allowed.
    pub(crate) fn at_least(self, strength: f64, least: f64) -> f64 {
        match self {
            Self::Up => strength.max(least),
            Self::Down => strength.min(-least),
            Self::Either => strength.abs().max(least).copysign(strength),
        }
    }
}
