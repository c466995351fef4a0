//! What frames are compared with: the baseline, the model of the sheet it was taken on, and what it says of the electrodes.

mod bad_contacts;
pub mod baseline;
pub mod departure;
pub mod diagnosis;
mod difference;
pub mod drift;
pub mod electrode_fit;
mod golden_sections;
pub mod imager;
pub mod inspection;
mod low_rank;
pub(crate) mod moved;
pub mod noise;
mod resolution;
pub mod screening;
mod taken;
mod told_sheet;
pub mod wiring;
mod written;

pub use difference::Difference;
pub use drift::Drift;
pub use resolution::rounding;
pub use taken::Reference;
pub use told_sheet::ToldSheet;
pub(crate) use told_sheet::normalised;
