//! What a frame takes, counted in steps: the same on every machine.

/// Rank and values of the paper's sheet, at which the steps were measured.
const RANK: f64 = 118.0;
const VALUES: f64 = 208.0;
const ELECTRODES: f64 = 16.0;

/// What a frame took, in steps that take long.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Pictures with their fits of touches.
    pub fits: usize,
    /// Evaluations of the response to one touch in these fits, or what responses that were not there took, in as many.
    pub evaluations: usize,
    /// Solutions of the sheet with touches.
    pub solutions: usize,
    /// Problems made anew for other values or contacts.
    pub problems: usize,
    /// Tables of responses made for them.
    pub tables: usize,
    /// Parts of searches for what is broken: three for one fault, and three or six more for each beside which another is looked for.
    pub search_parts: usize,
}

/// How long the steps take about on a processor of 2023, ms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Costs {
    fit: f64,
    pub(crate) evaluation: f64,
    pub(crate) solution: f64,
    problem: f64,
    table: f64,
    pub(crate) search_part: f64,
}

impl Costs {
    /// Of frames with so many values and electrodes, and a problem of this rank.
    pub(crate) fn new(rank: usize, values: usize, electrodes: usize) -> Self {
        let rank = (rank as f64 / RANK).max(1.0);
        let values = (values as f64 / VALUES).max(1.0);
        let electrodes = (electrodes as f64 / ELECTRODES).max(1.0);
        Self {
            fit: 0.3 * rank,
            // A response is as long as the rank, and a larger table is less in the cache.
            evaluation: 0.006 * rank.powf(1.5),
            // The mesh is as fine.
            solution: 8.0,
            problem: 8.0 * rank * values,
            table: 7.0 * rank * values,
            // Pairs of electrodes.
            search_part: 5.0 * electrodes * electrodes,
        }
    }

    /// Of so much work.
    pub(crate) fn of(&self, work: Work) -> f64 {
        self.fit * work.fits as f64
            + self.evaluation * work.evaluations as f64
            + self.solution * work.solutions as f64
            + self.problem * work.problems as f64
            + self.table * work.tables as f64
            + self.search_part * work.search_parts as f64
    }
}
