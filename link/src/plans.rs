//! The plans that a user can ask for, and the one for live pictures.

use protocol::{Hello, Plan, PlanError, PlanName, QUARTERS, Recipe, Sampling, UnknownPlan};
use std::fmt;
use std::str::FromStr;

/// The plan asked for: a ready-made one of neighbouring pairs, or what suits the board. Times and signal to noise ratios on
/// the paper's 16 electrodes: docs/firmware.md.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlanChoice {
    /// What suits the board: see [`live_plan`].
    #[default]
    Auto,
    /// This one.
    Named(PlanName),
}

impl PlanChoice {
    /// All of them.
    pub fn all() -> impl Iterator<Item = Self> {
        std::iter::once(Self::Auto).chain(PlanName::ALL.into_iter().map(Self::Named))
    }

    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Named(plan) => plan.name(),
        }
    }

    /// One line about it.
    pub fn about(self) -> &'static str {
        match self {
            Self::Auto => "the fastest that is quiet enough: fast, or sequential-fast where there is one channel",
            Self::Named(plan) => plan.about(),
        }
    }

    /// The plan for a board.
    ///
    /// # Errors
    /// [`PlanError`] when the board cannot carry it out.
    pub fn plan(self, board: &Hello) -> Result<Plan, PlanError> {
        match self {
            Self::Auto => live_plan(board),
            Self::Named(name) => plan_for(name, board),
        }
    }
}

impl fmt::Display for PlanChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for PlanChoice {
    type Err = UnknownPlan;

    fn from_str(name: &str) -> Result<Self, UnknownPlan> {
        match name {
            "auto" => Ok(Self::Auto),
            name => name.parse().map(Self::Named),
        }
    }
}

/// A ready-made plan for a board.
///
/// # Errors
/// [`PlanError`] when the board cannot carry it out.
fn plan_for(name: PlanName, board: &Hello) -> Result<Plan, PlanError> {
    let plan = name.plan(board.electrodes)?;
    plan.check(board)?;
    Ok(plan)
}

/// The plan for live pictures, the fastest whose noise the pictures bear: all pairs of a drive at once, one period to
/// settle and one to integrate (115 frames/s on 16 electrodes), where the board has a channel for every electrode; else one
/// pair after the other, a quarter period to settle and one to integrate (14 frames/s); half of the pairs where not all fit,
/// and [`Plan::sparse`] where those neither do, as on 32 electrodes (11 frames/s).
///
/// # Errors
/// [`PlanError`] when the board has too few electrodes to measure anything, or can carry none of them out.
pub fn live_plan(board: &Hello) -> Result<Plan, PlanError> {
    if crowded(board.electrodes) {
        return sparse(board);
    }
    let mut refusal = None;
    for name in [PlanName::Fast, PlanName::SequentialFast, PlanName::Independent] {
        match plan_for(name, board) {
            Ok(plan) => return Ok(plan),
            Err(e) => _ = refusal.get_or_insert(e),
        }
    }
    Err(refusal.unwrap_or(PlanError::Empty))
}

/// Whether a frame has no room for all neighbouring pairs of so many electrodes.
fn crowded(electrodes: u8) -> bool {
    matches!(Plan::adjacent(electrodes), Err(PlanError::Values { .. }))
}

fn sparse(board: &Hello) -> Result<Plan, PlanError> {
    let plan = Plan::sparse(board.electrodes)?;
    plan.check(board)?;
    Ok(plan)
}

/// Scan plan for the adjacent pattern by what a board can do: all pairs of a drive at once, one period to settle and six
/// to integrate (33 frames/s on 16 electrodes, at the noise of the paper's own way of measuring), or one pair after the
/// other with one period each; [`Plan::sparse`] where a frame has no room for all.
///
/// # Errors
/// [`PlanError`] when the board has too few electrodes to measure anything, or more than a plan holds.
pub fn adjacent_plan(hello: &Hello) -> Result<Plan, PlanError> {
    adjacent_plan_for(hello.electrodes, hello.limits.channels)
}

/// The same for a board of so many electrodes and channels.
///
/// # Errors
/// As for [`adjacent_plan`].
pub fn adjacent_plan_for(electrodes: u8, channels: u8) -> Result<Plan, PlanError> {
    if crowded(electrodes) {
        return Plan::sparse(electrodes);
    }
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
    fn every_choice_is_read_by_its_name() {
        for choice in PlanChoice::all() {
            assert_eq!(choice.name().parse(), Ok(choice));
        }
        assert_eq!(PlanChoice::all().count(), 9);
        assert!("faster".parse::<PlanChoice>().is_err());
    }

    #[test]
    fn the_quiet_plan_is_that_of_a_session() {
        let board = board(16, 16);
        let quiet = PlanChoice::Named(PlanName::Quiet);
        assert_eq!(quiet.plan(&board), adjacent_plan(&board));
    }

    #[test]
    fn the_live_plan_is_one_that_the_board_can_carry_out() {
        for electrodes in 4..=16 {
            for channels in [1, electrodes] {
                let board = board(electrodes, channels);
                assert_eq!(live_plan(&board).unwrap().check(&board), Ok(()));
            }
        }
        for electrodes in 18..=32 {
            let board = board(electrodes, 1);
            assert_eq!(live_plan(&board), Ok(Plan::sparse(electrodes).unwrap()));
            assert_eq!(adjacent_plan(&board), live_plan(&board));
        }
        assert_eq!(live_plan(&board(16, 16)), Ok(Plan::fast()));
        assert_eq!(live_plan(&board(16, 1)), Ok(Plan::sequential_fast()));
        let mut small = board(16, 1);
        small.limits.values = 120;
        assert_eq!(live_plan(&small), Ok(Plan::independent()));
        // And what it cannot do is said.
        small.limits.values = 100;
        assert_eq!(live_plan(&small), plan_for(PlanName::Fast, &small));
        assert!(live_plan(&board(3, 3)).is_err());
        assert!(plan_for(PlanName::Fast, &board(16, 1)).is_err());
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
