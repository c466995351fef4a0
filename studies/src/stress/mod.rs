//! A stress programme: what must hold for the solvers and the way of a frame on any data, checked law by law.
//!
//! The tests run a short form; `skin bench --stress` a long one.

mod frames;
mod methods;
mod solver;

use crate::error::StudyError;
use inverse::solvers::Problem;
use nalgebra::{DMatrix, DVector};
use rand::Rng;
use rand::rngs::StdRng;
use serde::Serialize;

/// Result of one check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Verdict {
    /// What must hold.
    pub law: &'static str,
    /// Whether it held in every case.
    pub passed: bool,
    /// Cases tried and the worst figure, or the first case that failed.
    pub detail: String,
}

/// How much is tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Effort {
    /// Random problems a check.
    pub problems: usize,
    /// Warm frames of the small problem that wanders without end.
    pub wandering: u64,
    /// Warm frames of the sheet.
    pub sheet: usize,
    /// The source of all that is drawn.
    pub seed: u64,
}

impl Effort {
    /// Some seconds: what the tests do.
    pub const SHORT: Self = Self {
        problems: 100,
        wandering: 2_000,
        sheet: 60,
        seed: 1,
    };
    /// Some ten seconds.
    pub const LONG: Self = Self {
        problems: 1_000,
        wandering: 500_000,
        sheet: 2_000,
        seed: 1,
    };
}

/// Runs every check; `progress` is called with the result of each.
///
/// # Errors
/// [`StudyError`] where the sheet cannot be modelled.
pub fn run(effort: Effort, mut progress: impl FnMut(&Verdict)) -> Result<Vec<Verdict>, StudyError> {
    let mut verdicts = Vec::new();
    let mut end = |v: Verdict| {
        progress(&v);
        verdicts.push(v);
    };
    let checks: [fn(Effort) -> Verdict; 12] = [
        solver::scales,
        solver::ridges,
        solver::degenerate,
        solver::contradictions,
        solver::rubbish,
        solver::denormals,
        solver::single_precision,
        solver::wandering,
        methods::plain,
        methods::ridged,
        methods::linear,
        methods::rubbish,
    ];
    for check in checks {
        end(check(effort));
    }
    end(frames::rubbish(effort)?);
    end(frames::warm_is_cold(effort)?);
    Ok(verdicts)
}

/// Collects the cases of one check.
struct Check {
    law: &'static str,
    cases: u64,
    worst: f64,
    failure: Option<String>,
}

impl Check {
    fn new(law: &'static str) -> Self {
        Self {
            law,
            cases: 0,
            worst: 0.0,
            failure: None,
        }
    }

    /// A case whose figure must not be above a limit; a figure that is no number fails.
    fn most(&mut self, figure: f64, limit: f64, case: impl FnOnce() -> String) {
        self.cases += 1;
        let within = figure <= limit;
        if !within && self.failure.is_none() {
            self.failure = Some(format!("{}: {figure:.1e} is above {limit:.1e}", case()));
        }
        self.worst = self.worst.max(figure);
    }

    /// A case that must be true.
    fn holds(&mut self, holds: bool, case: impl FnOnce() -> String) {
        self.cases += 1;
        if !holds && self.failure.is_none() {
            self.failure = Some(case());
        }
    }

    fn verdict(self) -> Verdict {
        let passed = self.failure.is_none() && self.cases > 0;
        Verdict {
            law: self.law,
            passed,
            detail: self
                .failure
                .unwrap_or_else(|| format!("{} cases, worst {:.0e}", self.cases, self.worst)),
        }
    }
}

/// Entries between -1 and 1.
fn random(rows: usize, cells: usize, rng: &mut StdRng) -> DMatrix<f64> {
    DMatrix::from_fn(rows, cells, |_, _| rng.random_range(-1.0..1.0))
}

fn random_b(rows: usize, rng: &mut StdRng) -> DVector<f64> {
    DVector::from_fn(rows, |_, _| rng.random_range(-1.0..1.0))
}

/// `A` over `ridge I`, and `b` over 0: plain least squares with the ridge as further rows.
fn stacked(a: &DMatrix<f64>, b: &DVector<f64>, ridge: f64) -> (Problem, DVector<f64>) {
    let (rows, cells) = a.shape();
    let mut whole = DMatrix::zeros(rows + cells, cells);
    whole.rows_mut(0, rows).copy_from(a);
    whole.rows_mut(rows, cells).fill_diagonal(ridge);
    let mut right = DVector::zeros(rows + cells);
    right.rows_mut(0, rows).copy_from(b);
    (Problem::new(&whole, 0.0), right)
}

/// Largest `|min(x_j |a_j|, -g_j / |a_j|)|` over `|b|`, from the whole matrix: a proof that owes nothing to a solver.
fn violation(a: &DMatrix<f64>, b: &DVector<f64>, x: &DVector<f64>, ridge: f64) -> f64 {
    let pull = a.tr_mul(&(b - a * x)) - x * (ridge * ridge);
    let each = a.column_iter().zip(x.iter().zip(&pull)).map(|(c, (x, g))| {
        let norm = c.norm().hypot(ridge);
        if norm > 0.0 {
            (x * norm).min(-g / norm).abs()
        } else {
            x.abs()
        }
    });
    each.fold(0.0, f64::max) / b.norm().max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_holds_in_short() {
        let verdicts = run(Effort::SHORT, |_| ()).unwrap();
        let failed: Vec<&Verdict> = verdicts.iter().filter(|v| !v.passed).collect();
        assert!(failed.is_empty(), "{failed:#?}");
        assert_eq!(verdicts.len(), 14);
    }

    #[test]
    fn a_check_fails_on_no_case_a_false_one_and_what_is_no_number() {
        assert!(!Check::new("none").verdict().passed);
        for figure in [2.0, f64::NAN] {
            let mut check = Check::new("most");
            check.most(0.5, 1.0, String::new);
            check.most(figure, 1.0, || "here".to_owned());
            let verdict = check.verdict();
            assert!(!verdict.passed && verdict.detail.contains("here"));
        }
        let mut check = Check::new("holds");
        check.holds(true, String::new);
        assert!(check.verdict().passed);
    }
}
