//! What a frame may take, and has taken.

use super::{FrameSolver, Task};
use crate::pipeline::work::{Costs, Work};
use crate::quality::contact::Cause;
use crate::reference::Difference;
use crate::reference::drift::Drifting;
use crate::touches::fit::fitter::{Allowed, Fitter};

/// Solutions of the sheet that a frame of a sequence may take, and how long evaluations of a fit of it may, ms. The next frame goes on.
const MOST_SOLUTIONS: usize = 2;
const FIT_MS: f64 = 9.0;
/// A fit of fewer is hardly one.
const LEAST_EVALUATIONS: usize = 1000;
/// What a frame of a sequence may have taken before anything else is asked of it, and until which a solution has to be at its end, ms.
const MOST_MS: f64 = 20.0;
/// What making its problem may take, ms, for a frame to be solved with it: only problems of many values take longer.
const MOST_MAKING_MS: f64 = 40.0;

impl FrameSolver {
    /// Begins a frame: nothing was done for it. Time for so many parts of a search is kept free.
    pub(crate) fn begin_frame(&mut self, owed: usize) {
        self.keeps_free = owed > 0;
        self.work = Work {
            search_parts: owed,
            ..Work::default()
        };
        self.fitter.iter_mut().for_each(Fitter::begin_frame);
    }

    /// How long the steps of a frame take.
    pub(crate) fn costs(&self) -> Costs {
        let pattern = &self.imager.pattern;
        Costs::new(self.rank().unwrap_or(0), pattern.len(), pattern.electrodes())
    }

    /// Lets the next fit take what a fit may, and solve the sheet where the frame has time for that.
    pub(super) fn allow(&mut self) {
        let mut allowed = Allowed::default();
        if self.options.sequence {
            let costs = self.costs();
            let beside = costs.of(self.work) / costs.evaluation;
            allowed = Allowed {
                evaluations: LEAST_EVALUATIONS.max((FIT_MS / costs.evaluation) as usize),
                solutions: MOST_SOLUTIONS,
                a_solution: costs.solution / costs.evaluation,
                until: MOST_MS / costs.evaluation - beside,
            };
        }
        self.fitter.iter_mut().for_each(|fitter| fitter.allow(allowed));
    }

    /// Whether the frame has taken as long as it may: what else is to be asked waits for the next.
    pub(crate) fn is_spent(&self) -> bool {
        self.options.sequence && self.costs().of(self.work()) > MOST_MS
    }

    /// Makes the problem ready in which something else drifts than in the one in use; whether anything had to be made.
    pub(crate) fn make_ready(&mut self, own: Task, other: Drifting) -> bool {
        let before = self.made();
        self.prepare(own.difference, (other, own.changed));
        self.switch(own.difference, (own.drifting, own.changed));
        self.options.sequence && self.made() != before
    }

    /// Makes a problem the one in use, and its tables where the frame has time for them. Whether making took so long that the frame is not
    /// solved.
    pub(crate) fn prepare(&mut self, difference: &Difference, left_out: (Drifting, &[Cause])) -> bool {
        let before = self.made();
        self.switch(difference, left_out);
        if !self.took_long_since(before) {
            self.tabulate(false);
        }
        self.took_long_since(before)
    }

    /// Whether making problems and tables took long since there were so many.
    fn took_long_since(&self, (problems, tables): (usize, usize)) -> bool {
        let made = Work {
            problems: self.work.problems - problems,
            tables: self.work.tables - tables,
            ..Work::default()
        };
        self.options.sequence && self.costs().of(made) > MOST_MAKING_MS
    }

    /// Whether the frame was solved, with whatever came of it.
    pub(crate) fn has_solved(&self) -> bool {
        self.work.fits > 0
    }

    /// Problems and tables that were made in the frame.
    pub(crate) fn made(&self) -> (usize, usize) {
        (self.work.problems, self.work.tables)
    }

    /// Parts of a search for what is broken that the frame has time to begin, after so many.
    pub(crate) fn search_parts(&self, done: usize) -> usize {
        if !self.options.sequence {
            return usize::MAX;
        }
        let costs = self.costs();
        let taken = costs.of(Work {
            search_parts: done,
            ..self.work()
        });
        ((MOST_MS - taken).max(0.0) / costs.search_part).ceil() as usize
    }

    /// Takes note of the parts of searches for what is broken in this frame.
    pub(crate) fn note_search_parts(&mut self, done: usize) {
        self.work.search_parts = self.work.search_parts.max(done);
    }

    /// Whether time for a search is kept free in this frame.
    pub(crate) fn keeps_free(&self) -> bool {
        self.keeps_free
    }

    /// What the frame has taken so far.
    pub(crate) fn work(&self) -> Work {
        Work {
            evaluations: self.fitter.as_ref().map_or(0, Fitter::evaluations),
            solutions: self.fitter.as_ref().map_or(0, Fitter::solutions),
            ..self.work
        }
    }
}
