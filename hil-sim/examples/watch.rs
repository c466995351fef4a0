//! Which few measurements show a touch anywhere: the choice behind [`protocol::Watch::sequential`].
//!
//! All designs of one drive with one sense step, turned round the sheet, are tried: for each the sense pairs are taken that
//! make the least visible touch most visible, inside the converter's range. The board is the drawn one with one channel.
//!
//! `cargo run --release -p skin-hil-sim --example watch`

#[path = "../tests/suite/common/visibility.rs"]
mod visibility;

use protocol::Pair;
use visibility::{Bench, least};

/// Most of the converter's range that a resting value may take.
const FILL: f64 = 0.9 * 2047.5;

/// A design: what it is made of, and the least visible touch of 25 N over the noise.
#[derive(Clone, Debug)]
struct Design {
    separation: u8,
    step: u8,
    sense: Vec<u8>,
    seen: f64,
}

fn pair(from: u8, step: u8) -> Pair {
    Pair {
        plus: (from + step) % 16,
        minus: from % 16,
    }
}

/// Every choice of `count` of a list.
fn choices(list: &[u8], count: usize) -> Vec<Vec<u8>> {
    match (count, list) {
        (0, _) => vec![vec![]],
        (_, []) => vec![],
        (_, [first, rest @ ..]) => {
            let with = choices(rest, count - 1).into_iter().map(|mut c| {
                c.insert(0, *first);
                c
            });
            with.chain(choices(rest, count)).collect()
        }
    }
}

fn main() {
    let bench = Bench::new(&hil_sim::Electronics::drawn_board());
    println!(
        "| drives | of each | values | drive pair | sense step | sense pairs | least visible touch of 25 N, over noise |"
    );
    println!("|---|---|---|---|---|---|---|");
    for (turns, count) in [
        (2, 2),
        (2, 3),
        (4, 1),
        (2, 4),
        (4, 2),
        (8, 1),
        (2, 5),
        (2, 6),
        (4, 3),
        (4, 4),
        (8, 2),
        (8, 3),
    ] {
        let mut best: Option<Design> = None;
        for separation in 1..=8 {
            for step in 1..=8 {
                // Of the drive 0 to `separation`: the sense pairs that touch no driving electrode and fit the range.
                let drive = Pair {
                    plus: 0,
                    minus: separation,
                };
                let free = |n: &u8| {
                    let sense = pair(*n, step);
                    [sense.plus, sense.minus].iter().all(|e| ![0, separation].contains(e))
                };
                let all: Vec<u8> = (0..16).filter(free).collect();
                let codes = bench.resting_codes(&Bench::pattern(all.iter().map(|n| (drive, pair(*n, step)))));
                let fit: Vec<u8> = all
                    .iter()
                    .zip(&codes)
                    .filter(|(_, c)| c.abs() < FILL)
                    .map(|(n, _)| *n)
                    .collect();
                if fit.len() < count {
                    continue;
                }
                // Squares of the changes: of each sense pair, summed over the turned designs.
                let squares: Vec<Vec<f64>> = fit
                    .iter()
                    .map(|n| {
                        let turned = (0..turns).map(|t| {
                            let by = t * 16 / turns;
                            let drive = Pair {
                                plus: (drive.plus + by) % 16,
                                minus: (drive.minus + by) % 16,
                            };
                            (drive, pair(n + by, step))
                        });
                        let changes = bench.changes(&Bench::pattern(turned));
                        changes.column_iter().map(|c| c.norm_squared()).collect()
                    })
                    .collect();
                let numbers: Vec<u8> = (0..fit.len() as u8).collect();
                for choice in choices(&numbers, count) {
                    let sum: Vec<f64> = (0..squares[0].len())
                        .map(|p| choice.iter().map(|c| squares[usize::from(*c)][p]).sum::<f64>().sqrt())
                        .collect();
                    let seen = least(&sum);
                    if best.as_ref().is_none_or(|b| seen > b.seen) {
                        best = Some(Design {
                            separation,
                            step,
                            sense: choice.iter().map(|c| fit[usize::from(*c)]).collect(),
                            seen,
                        });
                    }
                }
            }
        }
        if let Some(d) = best {
            println!(
                "| {turns} | {count} | {} | 0, {} | {} | {:?} | {:.0} |",
                turns as usize * count,
                d.separation,
                d.step,
                d.sense,
                d.seen
            );
        }
    }
}
