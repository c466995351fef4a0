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
    /// Most contacts and leaks left out of a frame. Each contact takes four to six directions of some 118, a leak one.
    pub most_contacts: usize,
    /// Least relative change of a contact impedance that is a fault; what is smaller is drift.
    pub least_change: f64,
    /// How much more probable a frame must be with it than with drift alone, as a logarithm: 12 is the chance of 2e-5 in any
    /// of 16.
    pub evidence: f64,
    /// Part of a frame's square along the shapes of drift from which the frame alone is asked for a contact. Contacts have
    /// 0.9 and more.
    pub of_frame: f64,
    /// Margin by which leaving out a contact's shapes must lower the cost in a full fit, to stay accepted.
    pub margin: f64,
    /// The same to be accepted.
    pub margin_accepted: f64,
    /// Largest part of what touches leave unexplained that a contact may leave. More accepts contacts that only lessen the
    /// error of a wrong model.
    pub of_unexplained: f64,
    /// Mean squared misfit of touches, in variances of the noise, that counts as explained.
    pub explained: f64,
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
            least_change: 0.1,
            evidence: 12.0,
            of_frame: 0.5,
            margin: 4.0,
            margin_accepted: 12.0,
            of_unexplained: 0.15,
            explained: 1.3,
            full_fits: 4,
            miss_penalty: 2,
            retest_frames: 16,
            retest_soon_frames: 4,
            rejected_frames: 64,
        }
    }
}
