//! Which way touches change the resistivity.

use std::str::FromStr;
use thiserror::Error;

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

/// A name of no polarity.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{given:?} is no polarity: up, down and either are")]
pub struct UnknownPolarity {
    given: String,
}

impl Polarity {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Up, Self::Down, Self::Either];

    /// Its name, as it is read.
    pub fn name(self) -> &'static str {
        match self {
            Self::Up => "up",
            Self::Down => "down",
            Self::Either => "either",
        }
    }

    /// What it says, in a line.
    pub fn about(self) -> &'static str {
        match self {
            Self::Up => "touches raise the resistance, as on sensor rubber",
            Self::Down => "touches lower the resistance, as on foam",
            Self::Either => "each touch may raise or lower it, as things in a tank do",
        }
    }

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

impl FromStr for Polarity {
    type Err = UnknownPolarity;

    fn from_str(name: &str) -> Result<Self, UnknownPolarity> {
        let found = Self::ALL.into_iter().find(|p| p.name() == name);
        found.ok_or_else(|| UnknownPolarity { given: name.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back_and_others_are_refused() {
        for polarity in Polarity::ALL {
            assert_eq!(polarity.name().parse(), Ok(polarity));
        }
        assert!("rise".parse::<Polarity>().is_err());
    }

    #[test]
    fn a_strength_keeps_an_allowed_sign_and_at_least_its_size() {
        for (polarity, strength, kept) in [
            (Polarity::Up, -3.0, 1.0),
            (Polarity::Up, 3.0, 3.0),
            (Polarity::Down, 3.0, -1.0),
            (Polarity::Down, -3.0, -3.0),
            (Polarity::Either, -3.0, -3.0),
            (Polarity::Either, 0.5, 1.0),
        ] {
            assert_eq!(polarity.at_least(strength, 1.0), kept);
            assert!(polarity.allows(kept));
        }
    }
}
