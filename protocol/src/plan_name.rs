//! The ready-made plans by name.

use crate::plan::Plan;
use crate::plan_error::PlanError;
use core::fmt;
use core::str::FromStr;

/// A ready-made plan of neighbouring pairs, for any number of electrodes. Times are those on 16 electrodes at 3684 Hz.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PlanName {
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
    /// The same without the last two drives, whose values reciprocity joins to others: 4.8 ms.
    Fourteen,
}

impl PlanName {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Paper,
        Self::Sequential,
        Self::SequentialFast,
        Self::Independent,
        Self::Quiet,
        Self::Fast,
        Self::Fastest,
        Self::Fourteen,
    ];

    /// As on a command line and in a file.
    pub const fn name(self) -> &'static str {
        match self {
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

    /// One line about it, for a help text. Rates are those on 16 electrodes.
    pub const fn about(self) -> &'static str {
        match self {
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

    /// The plan for a board of `electrodes`, 4 to 17. Whether the board has the channels and gains for it is
    /// [`Plan::check`]'s to say.
    ///
    /// # Errors
    /// As for [`Plan::adjacent`].
    pub fn plan(self, electrodes: u8) -> Result<Plan, PlanError> {
        let adjacent = Plan::adjacent(electrodes)?;
        let timed = |like: Plan| Plan {
            slots: adjacent.slots.clone(),
            ..like
        };
        Ok(match self {
            Self::Paper => timed(Plan::paper()),
            Self::Sequential => timed(Plan::sequential()),
            Self::SequentialFast => timed(Plan::sequential_fast()),
            Self::Independent => timed(Plan::independent()).without_reciprocals(),
            Self::Quiet => timed(Plan::quiet()),
            Self::Fast => adjacent,
            Self::Fastest => timed(Plan::fastest()),
            Self::Fourteen => timed(Plan::fourteen()).without_spare_drives(electrodes),
        })
    }

    /// The name of a plan in force on a board of `electrodes`, if it is a ready-made one. [`Plan::id`] does not matter.
    pub fn of(plan: &Plan, electrodes: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|name| {
            let same = |p: Plan| Plan { id: plan.id, ..p } == *plan;
            name.plan(electrodes).is_ok_and(same)
        })
    }
}

impl fmt::Display for PlanName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// There is no ready-made plan of the name given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnknownPlan;

impl fmt::Display for UnknownPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("there is no plan of this name; give ")?;
        for (k, plan) in PlanName::ALL.into_iter().enumerate() {
            let before = match k {
                0 => "",
                _ if k + 1 == PlanName::ALL.len() => " or ",
                _ => ", ",
            };
            write!(f, "{before}{}", plan.name())?;
        }
        Ok(())
    }
}

impl core::error::Error for UnknownPlan {}

impl FromStr for PlanName {
    type Err = UnknownPlan;

    fn from_str(name: &str) -> Result<Self, UnknownPlan> {
        Self::ALL.into_iter().find(|p| p.name() == name).ok_or(UnknownPlan)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::ToString;
    use std::vec::Vec;

    #[test]
    fn on_sixteen_electrodes_the_plans_are_the_papers_and_its_variants() {
        for (name, plan) in [
            (PlanName::Paper, Plan::paper()),
            (PlanName::Sequential, Plan::sequential()),
            (PlanName::SequentialFast, Plan::sequential_fast()),
            (PlanName::Independent, Plan::independent()),
            (PlanName::Quiet, Plan::quiet()),
            (PlanName::Fast, Plan::fast()),
            (PlanName::Fastest, Plan::fastest()),
            (PlanName::Fourteen, Plan::fourteen()),
        ] {
            assert_eq!(name.plan(16), Ok(plan.clone()));
            assert_eq!(PlanName::of(&plan, 16), Some(name));
            assert_eq!(name.to_string().parse(), Ok(name));
        }
        assert_eq!(PlanName::of(&Plan::with_drive_pairs(0), 16), None);
        assert!(PlanName::ALL.into_iter().all(|name| name.plan(3).is_err()));
    }

    #[test]
    fn reciprocity_joins_the_values_left_out_to_those_that_are_measured() {
        for electrodes in 4..=16u8 {
            let pairs = |name: PlanName| {
                let plan = name.plan(electrodes).unwrap();
                // Pair m is electrodes m and m + 1, driven from the first and sensed from the second.
                let list = plan
                    .measurements(electrodes)
                    .map(|(d, s)| (d.plus.min(s.minus), d.plus.max(s.minus)));
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
    fn an_unknown_name_is_answered_with_all_names() {
        let error = "faster".parse::<PlanName>().unwrap_err().to_string();
        assert!(PlanName::ALL.iter().all(|p| error.contains(p.name())), "{error}");
        assert!(error.ends_with("fastest or fourteen"), "{error}");
    }
}
