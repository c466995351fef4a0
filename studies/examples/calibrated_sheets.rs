//! Simulated sheets with flaws, calibrated with twenty presses: what the model says alone, what the presses teach, and what the
//! calibration says. Table: docs/real-skins.md, Sheets with flaws.
//!
//!     cargo run --release -p studies --example calibrated_sheets -- [--sheets N] [--seed S] [--only NAME]

use anyhow::Result;
use forward::Drive;
use studies::flawed_sheet::{Flaws, Located, compare};
use studies::imager;

const KNOWN: usize = 20;
const OTHERS: usize = 40;

fn text(located: &Located) -> String {
    let [median, high] = located.at();
    format!("{median:.3} / {high:.3} | {:.0} %", 100.0 * located.honest_part())
}

fn main() -> Result<()> {
    let given: Vec<String> = std::env::args().collect();
    let after = |name: &str| given.iter().position(|a| a == name).and_then(|k| given.get(k + 1));
    let sheets: u64 = after("--sheets").map_or(Ok(8), |s| s.parse())?;
    let seed: u64 = after("--seed").map_or(Ok(1), |s| s.parse())?;
    let only = after("--only").map_or("", String::as_str);
    let none = Flaws::default();
    let all = Flaws {
        off_mm: 0.5,
        contact: 0.3,
        uneven: 0.1,
        tilt: 0.3,
        creeps: true,
    };
    let off_mm = all.off_mm;
    let list = [
        ("none", none),
        ("electrodes off by 0.5 mm", Flaws { off_mm, ..none }),
        ("contacts off by 30 %", Flaws { contact: 0.3, ..none }),
        ("uneven by 10 %", Flaws { uneven: 0.1, ..none }),
        ("a gain tilted by 30 %", Flaws { tilt: 0.3, ..none }),
        ("creep", Flaws { creeps: true, ..none }),
        ("all at once", all),
    ];
    let imager = imager(Drive::PAPER, 5.0)?;
    println!("seed {seed}, {sheets} sheets, {KNOWN} presses known and {OTHERS} others of each");
    println!("median / 95th percentile, mm, and coordinates within two standard deviations");
    println!("| flaw | model alone | | taught | | calibrated | | over the first row | model taken | sheet told |");
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let mut first = None;
    for (name, flaws) in list.into_iter().filter(|(name, _)| name.contains(only)) {
        let mut sums: [Located; 3] = Default::default();
        let (mut model, mut told) = (0, 0);
        for sheet in 0..sheets {
            let found = compare(&imager, flaws, (KNOWN, OTHERS), (seed, sheet))?;
            model += usize::from(found.model_taken);
            told += usize::from(found.told_taken);
            for (sum, one) in sums.iter_mut().zip([found.alone, found.taught, found.calibrated]) {
                sum.join(&one);
            }
        }
        let at = sums[2].at();
        let perfect = *first.get_or_insert(at);
        let [alone, taught, calibrated] = sums.map(|located| text(&located));
        println!(
            "| {name} | {alone} | {taught} | {calibrated} | {:.2} / {:.2} | {model} of {sheets} | {told} of {sheets} |",
            at[0] / perfect[0],
            at[1] / perfect[1],
        );
    }
    Ok(())
}
