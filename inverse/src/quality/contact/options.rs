//! When a contact counts as changed.

/// Thresholds of the contact test. Costs are chi-square plus the number of parameters, so that differences of costs are
/// penalised likelihood ratios.
///
/// They were chosen together, by hand, on `cargo run --release -p studies --example contacts` (columns "named", "another named" and
/// the touches' errors beside a worse contact) and `--example live` (column "contacts named", which is to stay 0).
/// docs/results.md has both tables.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactOptions {
    /// Frames one after another in which a contact must explain more than touches do, 1 or more. More makes false contacts
    /// rarer and names true ones later. A single frame that decides named 12 contacts in the demo, 20 in `fast-tap`.
    pub frames: usize,
    /// Most contacts left out of a frame. Each takes three to five directions of some 118.
    pub most_contacts: usize,
    /// Radii around an electrode, over the sheet's reach: touches within one of them may be what its contact makes of the
    /// frame. From those at the electrode, over those further off, to all, then none. A touch within the second is reason to
    /// test the electrode.
    pub near: [f64; 5],
    /// Margin by which a contact must lower the cost against the touches it replaces: in a linear fit to be worth a full
    /// one, and in a full one to stay accepted. Less costs time, more keeps true contacts from being tested.
    pub margin: f64,
    /// The same in a full fit, to be accepted.
    pub margin_accepted: f64,
    /// The same in a linear fit beside all touches, where the test is the best of sixteen: any electrode may explain noise.
    pub margin_beside: f64,
    /// Largest part of what touches leave unexplained that a contact may leave. More accepts contacts that only lessen the
    /// error of a wrong model.
    pub of_unexplained: f64,
    /// The same for a contact in place of all touches, of which some may be touches.
    pub of_all: f64,
    /// Mean squared misfit of touches, in variances of the noise, from which contacts are tested wherever the touches are.
    pub explained: f64,
    /// The same, from which a contact alone is tried, whatever the touches are.
    pub unexplained: f64,
    /// Largest part of the data that such a contact may leave.
    pub of_data: f64,
    /// Residual of a contact without the touches' freedom, over that of noise, up to which its linear fit is worth the time.
    pub quick: f64,
    /// Most linear fits in a frame. Each takes some 10 us.
    pub most_tries: usize,
    /// Frames at the end in which the full fit is compared.
    pub full_fits: usize,
    /// Frames that name an electrode which are undone by one that does not.
    pub miss_penalty: usize,
    /// Frames until an accepted contact is tested again.
    pub retest_frames: usize,
    /// The same after an inconclusive test.
    pub retest_soon_frames: usize,
    /// Frames for which a rejected electrode is no candidate.
    pub rejected_frames: usize,
}

impl Default for ContactOptions {
    fn default() -> Self {
        Self {
            frames: 16,
            most_contacts: 3,
            near: [0.15, 0.36, 0.6, f64::INFINITY, 0.0],
            margin: 4.0,
            margin_accepted: 12.0,
            margin_beside: 30.0,
            of_unexplained: 0.15,
            of_all: 0.5,
            explained: 1.3,
            unexplained: 4.0,
            of_data: 0.7,
            quick: 3.0,
            most_tries: 6,
            full_fits: 4,
            miss_penalty: 2,
            retest_frames: 16,
            retest_soon_frames: 4,
            rejected_frames: 64,
        }
    }
}
