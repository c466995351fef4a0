//! Which press of a stream is which of a list, where both have clocks of their own.
//!
//! One shift between the clocks has to make the most of them meet. It is followed from pair to pair: clocks run at rates that differ a little,
//! and a robot is late by a little more with each way. A list of equal times that is not met as a whole has several such shifts; that is
//! refused.

use anyhow::{Result, bail};

/// Presses of the beginning, of both, one of which has a partner.
const FIRST: usize = 16;
/// Part of the shortest time between two presses by which partners may be apart.
const APART: f64 = 0.35;
/// Most that partners may be apart, s.
const MOST_APART_S: f64 = 2.0;
/// Differences of the shift from pair to pair that say nothing, s: presses begin slowly.
const NOTHING_S: f64 = 0.05;

/// Beginning and end, s.
pub(super) type Span = [f64; 2];

/// How far apart two spans are, s; 0 where they overlap.
fn apart(a: &Span, b: &Span) -> f64 {
    (a[0] - b[1]).max(b[0] - a[1]).max(0.0)
}

/// Pairs in order of time, each of both once, and how much the shift changes from pair to pair, s.
#[derive(Clone, Debug)]
struct Way {
    pairs: Vec<(usize, usize)>,
    unsteady_s: f64,
}

/// From a shift between the clocks on.
fn followed(stream: &[Span], list: &[Span], first_s: f64, within_s: f64) -> Way {
    let (mut i, mut j) = (0, 0);
    let mut shift_s = first_s;
    let mut squares = 0.0;
    let mut pairs = Vec::new();
    while i < stream.len() && j < list.len() {
        let there = list[j].map(|t| t + shift_s);
        // Where in a press the list's time is, the first pair tells.
        let off_s = if pairs.is_empty() {
            apart(&stream[i], &there)
        } else {
            (stream[i][0] - there[0]).abs()
        };
        if off_s <= within_s {
            let now_s = stream[i][0] - list[j][0];
            if !pairs.is_empty() {
                squares += (now_s - shift_s).powi(2);
            }
            shift_s = now_s;
            pairs.push((i, j));
            (i, j) = (i + 1, j + 1);
        } else if there[0] < stream[i][0] {
            j += 1;
        } else {
            i += 1;
        }
    }
    let unsteady_s = (squares / pairs.len().max(1) as f64).sqrt();
    Way { pairs, unsteady_s }
}

/// For presses of a stream their numbers in a list. `shift_s`: the stream's time less the list's at the beginning, where it is known.
///
/// # Errors
/// Nothing meets, or several ways are as good; the error says what to do.
pub(super) fn pair(stream: &[Span], list: &[Span], shift_s: Option<f64>) -> Result<Vec<(usize, usize)>> {
    let shortest = |of: &[Span]| of.windows(2).map(|w| w[1][0] - w[0][0]).fold(f64::INFINITY, f64::min);
    let within_s = (APART * shortest(stream).min(shortest(list))).min(MOST_APART_S);
    let shifts: Vec<f64> = match shift_s {
        Some(shift_s) => vec![shift_s],
        None => (stream.iter().take(FIRST))
            .flat_map(|s| list.iter().take(FIRST).map(move |l| s[0] - l[0]))
            .collect(),
    };
    let mut ways: Vec<Way> = shifts
        .into_iter()
        .map(|shift_s| followed(stream, list, shift_s, within_s))
        .collect();
    ways.sort_by(|a, b| {
        b.pairs
            .len()
            .cmp(&a.pairs.len())
            .then(a.unsteady_s.total_cmp(&b.unsteady_s))
    });
    let Some(best) = ways.first().filter(|best| !best.pairs.is_empty()) else {
        bail!("there is no press to pair, or none where --shift-s says");
    };
    if 2 * best.pairs.len() < stream.len().min(list.len()) {
        bail!(
            "the times of the list and of {} presses found do not agree: at most {} of {} meet; is it the list of this run? --shift-s says by how much the \
             stream's time is later than the list's",
            stream.len(),
            best.pairs.len(),
            list.len()
        );
    }
    // Another way is as good where it pairs as many, otherwise, and is nearly as steady.
    let as_good = |way: &&Way| {
        way.pairs.len() == best.pairs.len()
            && way.pairs != best.pairs
            && way.unsteady_s < 2.0 * best.unsteady_s + NOTHING_S
    };
    if let Some(other) = ways.iter().find(as_good) {
        bail!(
            "the list can be shifted: press {} may be its line {} or {}; say with --shift-s by how much the stream's time is later, or press at unequal \
             times",
            best.pairs[0].0 + 1,
            best.pairs[0].1 + 1,
            other.pairs[0].1 + 1
        );
    }
    Ok(best.pairs.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unequal(count: usize) -> Vec<Span> {
        let mut t = 0.0;
        (0..count)
            .map(|k| {
                t += 3.0 + 1.5 * (k as f64 * 2.3).sin();
                [t, t + 1.0]
            })
            .collect()
    }

    fn moved(spans: &[Span], shift_s: f64, rate: f64) -> Vec<Span> {
        spans.iter().map(|s| s.map(|t| shift_s + rate * t)).collect()
    }

    #[test]
    fn clocks_may_differ_by_anything_and_run_by_a_hundredth_faster() {
        let list = unequal(40);
        for (shift_s, rate) in [(0.0, 1.0), (1.7e9, 1.0), (-3.0, 1.01), (12.0, 0.985)] {
            // Of a list with times alone.
            let points: Vec<Span> = list.iter().map(|s| [s[0], s[0]]).collect();
            let stream = moved(&list, shift_s, rate);
            let all: Vec<_> = (0..40).map(|k| (k, k)).collect();
            assert_eq!(pair(&stream, &points, None).unwrap(), all, "{shift_s} {rate}");
        }
    }

    #[test]
    fn a_robot_that_is_later_with_every_way_is_followed() {
        let list = unequal(200);
        // Some hundredths of a second a way: 12 s at the end, more than the ways themselves.
        let mut late = 0.0;
        let stream: Vec<Span> = (list.iter().enumerate())
            .map(|(k, s)| {
                late += 0.06 + 0.03 * (k as f64 * 1.7).sin();
                s.map(|t| t + late)
            })
            .collect();
        let all: Vec<_> = (0..200).map(|k| (k, k)).collect();
        assert_eq!(pair(&stream, &list, None).unwrap(), all);
    }

    #[test]
    fn presses_that_are_missing_on_either_side_shift_nothing() {
        let list = unequal(30);
        let stream: Vec<Span> = moved(&list, 5.0, 1.0)
            .into_iter()
            .enumerate()
            .filter(|(k, _)| ![0, 7, 8].contains(k))
            .map(|(_, s)| s)
            .collect();
        let mut shorter = list.clone();
        shorter.remove(12);
        let found = pair(&stream, &shorter, None).unwrap();
        assert_eq!(found.len(), 26);
        for (i, j) in found {
            assert!((stream[i][0] - 5.0 - shorter[j][0]).abs() < 1e-9);
        }
    }

    #[test]
    fn equal_times_of_which_one_is_missing_are_refused_and_a_shift_tells_them() {
        let list: Vec<Span> = (0..10).map(|k| [4.0 * f64::from(k), 4.0 * f64::from(k)]).collect();
        let whole = moved(&list, 2.0, 1.0);
        assert_eq!(pair(&whole, &list, None).unwrap().len(), 10);
        let said = pair(&whole[1..], &list, None).unwrap_err().to_string();
        assert!(said.contains("--shift-s"), "{said}");
        let told = pair(&whole[1..], &list, Some(2.0)).unwrap();
        assert_eq!((told[0], told.len()), ((0, 1), 9));
        // Another run's list.
        let other: Vec<Span> = (0..10)
            .map(|k| [1.3 * f64::from(k * k), 1.3 * f64::from(k * k)])
            .collect();
        assert!(pair(&unequal(10), &other, None).is_err());
    }
}
