//! One touch in place of two.

use crate::touches::fit::disc::{Disc, Discs};
use crate::touches::fit::frame_fit::Fitted;

/// The nearest two of some discs, less than two expected radii apart, that change the resistivity the same way and are taken by `are`.
fn nearest(discs: &[Disc], radius_mm: f64, are: impl Fn(usize, usize) -> bool) -> Option<(usize, usize)> {
    let apart = |(k, i): (usize, usize)| (discs[k].at[0] - discs[i].at[0]).hypot(discs[k].at[1] - discs[i].at[1]);
    (0..discs.len())
        .flat_map(|i| (0..i).map(move |k| (k, i)))
        .filter(|(k, i)| discs[*k].strength * discs[*i].strength > 0.0 && are(*k, *i))
        .filter(|pair| apart(*pair) < 2.0 * radius_mm)
        .min_by(|p, q| apart(*p).total_cmp(&apart(*q)))
}

/// The discs with one of the expected size in place of these two.
fn merged(discs: &Discs, (k, i): (usize, usize), radius_mm: f64) -> Discs {
    let (one, other) = (discs[k], discs[i]);
    let strength = one.strength + other.strength;
    let share = other.strength / strength;
    let mut merged = discs.clone();
    merged[k] = Disc {
        at: std::array::from_fn(|c| one.at[c] + share * (other.at[c] - one.at[c])),
        radius: radius_mm,
        strength,
    };
    merged.remove(i);
    merged
}

/// The discs with one in place of two neighbours; `None` where no disc with a near neighbour has more than the contrast `too_strong`.
/// The linearisation error of one strong touch can look like two touches.
pub(super) fn merged_if_strong(discs: &Discs, radius_mm: f64, too_strong: f64) -> Option<Discs> {
    let is = |k: usize| discs[k].contrast().abs() > too_strong;
    let pair = nearest(discs, radius_mm, |k, i| is(k) || is(i))?;
    Some(merged(discs, pair, radius_mm))
}

/// The discs of a fit with one in place of two neighbours of which neither stands out beside the other: their strengths are below so
/// many of their standard deviations.
pub(super) fn merged_if_unresolved(fitted: &Fitted, radius_mm: f64, least_significance: f64) -> Option<Discs> {
    let weak = |k: usize| fitted.significances[k] < least_significance;
    let pair = nearest(&fitted.discs, radius_mm, |k, i| weak(k) && weak(i))?;
    Some(merged(&fitted.discs, pair, radius_mm))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fitted(list: &[(f64, f64, f64)]) -> Fitted {
        let disc = |(x, strength, _): &(f64, f64, f64)| Disc {
            at: [*x, 5.0],
            radius: 10.0,
            strength: *strength,
        };
        Fitted {
            discs: list.iter().map(disc).collect(),
            significances: list.iter().map(|d| d.2).collect(),
            ..Fitted::default()
        }
    }

    #[test]
    fn neighbours_of_which_neither_stands_out_are_one_where_both_are_in_the_mean() {
        let one = |list: &[(f64, f64, f64)]| merged_if_unresolved(&fitted(list), 12.5, 4.2);
        let found = one(&[(0.0, 3.0, 2.0), (16.0, 1.0, 3.0)]).unwrap();
        assert_eq!(found.len(), 1);
        assert!((found[0].at[0] - 4.0).abs() < 1e-12 && (found[0].strength - 4.0).abs() < 1e-12);
        for apart in [
            // One stands out; they are of opposite signs; they are far from each other; one is alone.
            &[(0.0, 3.0, 5.0), (16.0, 1.0, 3.0)][..],
            &[(0.0, 3.0, 2.0), (16.0, -1.0, 3.0)],
            &[(0.0, 3.0, 2.0), (26.0, 1.0, 3.0)],
            &[(0.0, 3.0, 2.0)],
        ] {
            assert!(one(apart).is_none(), "{apart:?}");
        }
        // Of three the nearest two first, and a far one stays.
        let found = one(&[(0.0, 1.0, 2.0), (20.0, 1.0, 3.0), (30.0, 1.0, 3.0), (80.0, 1.0, 9.0)]).unwrap();
        let places: Vec<f64> = found.iter().map(|d| d.at[0]).collect();
        assert_eq!(places, [0.0, 25.0, 80.0]);
    }
}
