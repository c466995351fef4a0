//! Scan plans by name, and the one for live pictures.

use protocol::{Hello, Plan, PlanError, QUARTERS, Recipe, Sampling};
use std::fmt;
use std::str::FromStr;

/// A ready-made plan of neighbouring pairs, for any number of electrodes. Times and signal to noise ratios on the paper's
/// 16: docs/firmware.md.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlanName {
    /// What suits the board: see [`live_plan`].
    #[default]
    Auto,
    /// One pair after the other, six periods each, nothing to settle: 339 ms.
    Paper,
    /// One pair after the other, one period to settle and one to integrate: 113 ms.
    Sequential,
    /// The same with a quarter period to settle: 71 ms.
    SequentialFast,
    /// One of each two pairs that reciprocity joins, one period to settle and one to integrate: 56 ms.
    Independent,
    /// All pairs of a drive at once, one period to settle and six to integrate: 30 ms, at the paper's noise.
    Quiet,
    /// All pairs of a drive at once, one period each: 8.7 ms.
    Fast,
    /// The same with a quarter period to settle: 5.4 ms.
    Fastest,
    /// The same without the last two drives, which reciprocity makes up for: 4.8 ms.
    Fourteen,
}

impl PlanName {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::Auto,
        Self::Paper,
        Self::Sequential,
        Self::SequentialFast,
        Self::Independent,
        Self::Quiet,
        Self::Fast,
        Self::Fastest,
        Self::Fourteen,
    ];

    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Paper => "paper",
            Self::Sequential => "sequential",
            Self::SequentialFast => "sequential-fast",
            Self::Independent => "independent",
            Self::Quiet => "quiet",
            Self::Fast => "fast",
            Self::Fastest => "fastest",
            Self::Fourteen => "fourteen",
        }
    }

    /// One line about it.
    pub fn about(self) -> &'static str {
        match self {
            Self::Auto => "the fastest that is quiet enough: fast, or sequential-fast where there is one channel",
            Self::Paper => "the paper's: 208 values one by one, six periods each; 3.0 frames/s",
            Self::Sequential => "208 values one by one, one period to settle and one to integrate; 8.9 frames/s",
            Self::SequentialFast => "the same with a quarter period to settle; 14.2 frames/s",
            Self::Independent => "the 104 independent values one by one, one period each; 17.7 frames/s",
            Self::Quiet => "all pairs of a drive at once, six periods: the paper's noise; 32.9 frames/s",
            Self::Fast => "all pairs of a drive at once, one period each; 115.1 frames/s",
            Self::Fastest => "the same with a quarter period to settle; 184.2 frames/s",
            Self::Fourteen => "the same without the two drives that can be spared; 210.5 frames/s",
        }
    }

    /// The plan for a board.
    ///
    /// # Errors
    /// [`PlanError`] when the board cannot carry it out.
    pub fn plan(self, board: &Hello) -> Result<Plan, PlanError> {
        let plan = self.unchecked(board)?;
        plan.check(board)?;
        Ok(plan)
    }

    fn unchecked(self, board: &Hello) -> Result<Plan, PlanError> {
        let fast = Plan::adjacent(board.electrodes)?;
        let timed = |name: &Plan, plan: Plan| Plan {
            id: name.id,
            settle_quarters: name.settle_quarters,
            integrate_periods: name.integrate_periods,
            sampling: name.sampling,
            ..plan
        };
        Ok(match self {
            Self::Auto => return live_plan(board),
            Self::Quiet => Plan {
                id: 3,
                integrate_periods: 6,
                ..fast
            },
            Self::Paper => timed(&Plan::paper(), fast),
            Self::Sequential => timed(&Plan::sequential(), fast),
            Self::SequentialFast => timed(&Plan::sequential_fast(), fast),
            Self::Fast => fast,
            Self::Fastest => timed(&Plan::fastest(), fast),
            Self::Independent => {
                // Of each two values that reciprocity joins the one of the drive with the lower number.
                let mut plan = timed(&Plan::independent(), fast);
                for (m, slot) in plan.slots.iter_mut().enumerate() {
                    slot.sense &= u32::MAX << m;
                }
                plan.slots.retain(|slot| slot.sense != 0);
                plan
            }
            Self::Fourteen => {
                let mut plan = timed(&Plan::fourteen(), fast);
                plan.slots.truncate(usize::from(board.electrodes).saturating_sub(2));
                plan
            }
        })
    }

    /// The name of a plan that a board has in force, if it is a ready-made one.
    pub fn of(plan: &Plan, board: &Hello) -> Option<Self> {
        Self::ALL[1..].iter().copied().find(|name| {
            let same = |p: Plan| Plan { id: plan.id, ..p } == *plan;
            name.unchecked(board).is_ok_and(same)
        })
    }
}

impl fmt::Display for PlanName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for PlanName {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|p| p.name() == name);
        found.ok_or_else(|| format!("there is no plan called {name}"))
    }
}

/// The plan for live pictures, the fastest whose noise the pictures bear: all pairs of a drive at once, one period to
/// settle and one to integrate (115 frames/s on 16 electrodes), where the board has a channel for every electrode; else one
/// pair after the other, a quarter period to settle and one to integrate (14 frames/s); half of the pairs where not all fit.
///
/// # Errors
/// [`PlanError`] when the board has too few electrodes to measure anything, or can carry none of them out.
pub fn live_plan(board: &Hello) -> Result<Plan, PlanError> {
    let mut refusal = None;
    for name in [PlanName::Fast, PlanName::SequentialFast, PlanName::Independent] {
        match name.plan(board) {
            Ok(plan) => return Ok(plan),
            Err(e) => _ = refusal.get_or_insert(e),
        }
    }
    Err(refusal.unwrap_or(PlanError::Empty))
}

/// Scan plan for the adjacent pattern by what a board can do: all pairs of a drive at once, one period to settle and six
/// to integrate (33 frames/s on 16 electrodes, at the noise of the paper's own way of measuring), or one pair after the
/// other with one period each.
///
/// # Errors
/// [`PlanError`] when the board has too few electrodes to measure anything, or more than a frame holds.
pub fn adjacent_plan(hello: &Hello) -> Result<Plan, PlanError> {
    adjacent_plan_for(hello.electrodes, hello.limits.channels)
}

/// The same for a board of so many electrodes and channels.
///
/// # Errors
/// As for [`adjacent_plan`].
pub fn adjacent_plan_for(electrodes: u8, channels: u8) -> Result<Plan, PlanError> {
    let plan = Plan::adjacent(electrodes)?;
    Ok(if channels >= electrodes {
        Plan {
            id: 3,
            integrate_periods: 6,
            ..plan
        }
    } else {
        Plan {
            id: 4,
            sampling: Sampling::Sequential,
            ..plan
        }
    })
}

/// What a plan or a watch measures, in a line.
pub fn described(recipe: Recipe<'_>, board: &Hello) -> String {
    let values = recipe.value_count();
    let how = match recipe.sampling {
        Sampling::Sequential => "one by one".to_owned(),
        Sampling::Simultaneous => format!("in {} drives", recipe.slots.len()),
    };
    let quarters = recipe.settle_quarters;
    let settle = match (u32::from(quarters) / QUARTERS, u32::from(quarters) % QUARTERS) {
        (whole, 0) => format!("{whole}"),
        _ => format!("{}", f64::from(quarters) / f64::from(QUARTERS)),
    };
    let ms = 1e3 * f64::from(recipe.quarters()) / f64::from(QUARTERS) / board.excitation_hz();
    format!(
        "{values} values {how}, {settle} + {} periods, {ms:.1} ms",
        recipe.integrate_periods
    )
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]
    use super::*;
    use protocol::{Limits, MAX_SLOTS, MAX_VALUES, ResetCause, Version};

    fn board(electrodes: u8, channels: u8) -> Hello {
        Hello {
            version: Version::CURRENT,
            schema: 0,
            firmware: protocol::text(""),
            git: protocol::text(""),
            board: protocol::text(""),
            serial: protocol::text(""),
            electrodes,
            samples_per_period: 16,
            timer_hz: 84_000_000,
            ticks_per_sample: 1425,
            adc_bits: 12,
            adc_span_uv: 3_300_000,
            excitation_uv: 2_250_000,
            gains_milli: [13_000].into_iter().collect(),
            limits: Limits {
                slots: MAX_SLOTS as u8,
                values: MAX_VALUES as u16,
                channels,
                settle_quarters: 1000,
                integrate_periods: 1000,
                amplitudes: 416,
                watch_slots: 8,
                watch_values: 48,
            },
            skew_ticks: 0,
            reset: ResetCause::Unknown,
            last_panic: protocol::text(""),
        }
    }

    #[test]
    fn on_sixteen_electrodes_the_plans_are_the_protocols() {
        let board = board(16, 16);
        for (name, plan) in [
            (PlanName::Paper, Plan::paper()),
            (PlanName::Sequential, Plan::sequential()),
            (PlanName::SequentialFast, Plan::sequential_fast()),
            (PlanName::Independent, Plan::independent()),
            (PlanName::Fast, Plan::fast()),
            (PlanName::Fastest, Plan::fastest()),
            (PlanName::Fourteen, Plan::fourteen()),
        ] {
            assert_eq!(name.plan(&board), Ok(plan.clone()));
            assert_eq!(PlanName::of(&plan, &board), Some(name));
            assert_eq!(name.name().parse(), Ok(name));
        }
        assert_eq!(PlanName::Quiet.plan(&board), adjacent_plan(&board));
        assert_eq!(PlanName::of(&Plan::with_drive_pairs(0), &board), None);
    }

    #[test]
    fn reciprocity_joins_the_values_that_are_left_out_to_those_that_are_not() {
        for electrodes in 4..=16u8 {
            let board = board(electrodes, electrodes);
            let pairs = |name: PlanName| {
                let plan = name.plan(&board).unwrap();
                let list = plan.measurements(electrodes).map(|(d, s)| {
                    // Pair m is electrodes m and m + 1, driven from the first and sensed from the second.
                    (d.plus.min(s.minus), d.plus.max(s.minus))
                });
                let mut list: Vec<(u8, u8)> = list.collect();
                list.sort_unstable();
                list
            };
            let mut all = pairs(PlanName::Fast);
            all.dedup();
            assert_eq!(pairs(PlanName::Independent), all, "{electrodes}");
            let mut fourteen = pairs(PlanName::Fourteen);
            fourteen.dedup();
            assert_eq!(fourteen, all, "{electrodes}");
        }
    }

    #[test]
    fn the_live_plan_is_one_that_the_board_can_carry_out() {
        for electrodes in 4..=16 {
            for channels in [1, electrodes] {
                let board = board(electrodes, channels);
                assert_eq!(live_plan(&board).unwrap().check(&board), Ok(()));
            }
        }
        assert_eq!(live_plan(&board(16, 16)), Ok(Plan::fast()));
        assert_eq!(live_plan(&board(16, 1)), Ok(Plan::sequential_fast()));
        let mut small = board(16, 1);
        small.limits.values = 120;
        assert_eq!(live_plan(&small), Ok(Plan::independent()));
        // And what it cannot do is said.
        small.limits.values = 100;
        assert_eq!(live_plan(&small), PlanName::Fast.plan(&small));
        assert!(live_plan(&board(3, 3)).is_err());
        assert!(PlanName::Fast.plan(&board(16, 1)).is_err());
    }

    #[test]
    fn a_description_has_the_time() {
        let board = board(16, 16);
        let said = described(Plan::fastest().recipe(), &board);
        assert_eq!(said, "208 values in 16 drives, 0.25 + 1 periods, 5.4 ms");
        let said = described(Plan::paper().recipe(), &board);
        assert_eq!(said, "208 values one by one, 0 + 6 periods, 338.7 ms");
    }
}
