//! Numbers that a scene's file may hold: read with their limits, so that an error points at the number.

use serde::de::Error;
use serde::{Deserialize, Deserializer};

/// Largest number of a scene, in any unit: sums and squares of such numbers are far from overflow.
const MOST: f64 = 1e12;

macro_rules! number {
    ($name:ident, $allowed:literal, $test:expr) => {
        #[doc = concat!("A number that is ", $allowed, ".")]
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub(super) struct $name(pub(super) f64);

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
                let value = f64::deserialize(from)?;
                let test: fn(f64) -> bool = $test;
                if value.is_finite() && value.abs() > MOST {
                    return Err(D::Error::custom(format_args!(
                        "{value:e} is not possible here; it must be {MOST:e} at most"
                    )));
                }
                if value.is_finite() && test(value) {
                    Ok(Self(value))
                } else {
                    Err(D::Error::custom(format_args!(
                        concat!("{} is not possible here; it must be ", $allowed),
                        value
                    )))
                }
            }
        }
    };
}

number!(Finite, "a finite number", |_| true);
number!(NotNegative, "0 or more", |v| v >= 0.0);
number!(Positive, "greater than 0", |v| v > 0.0);
number!(OneOrMore, "1 or more", |v| v >= 1.0);
number!(Share, "between 0 and 100", |v| (0.0..=100.0).contains(&v));
number!(Change, "greater than -100", |v| v > -100.0);

impl Default for NotNegative {
    fn default() -> Self {
        Self(0.0)
    }
}

impl Default for Finite {
    fn default() -> Self {
        Self(0.0)
    }
}

impl Default for Change {
    fn default() -> Self {
        Self(0.0)
    }
}
