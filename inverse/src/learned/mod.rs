//! Touches on a sheet that no model describes, by what presses at known places taught.
//!
//! Real skins differ from every model: their layers, their contacts and their electronics change what a press does to the
//! measurements. What a press does there is learned instead: [`learn()`] makes [`Learned`] of a few presses, which locates
//! others. docs/real-skins.md tells the method.

mod choice;
mod correction;
mod design;
mod follower;
mod frame;
mod gain;
mod harmonics;
pub mod kernel_ridge;
mod learn;
mod locator;
mod maps;
mod orbits;
mod order;
mod press_taker;
mod rest;
mod search;
mod sensitivities;
mod shift;
mod stale;
mod symmetry;
mod told;
mod validation;

#[cfg(test)]
mod tests;

pub use choice::{Extent, Setting};
pub use correction::StoredCorrection;
pub use design::{Gaps, Marks};
pub use follower::LearnedSheet;
pub(crate) use follower::PressFollower;
pub use frame::Grain;
pub use gain::{Gain, StoredGain};
pub use learn::{FEWEST, FEWEST_FOR_MORE, Findings, LearnError, Learned, Press, Stored, far_off, learn, learn_without};
pub use locator::{Located, Presence};
pub use maps::StoredMaps;
pub use order::Order;
pub use press_taker::{PressTaker, Seen, TakenPress, TakerOptions};
pub use shift::{Shift, shifted, shifted_by_places};
pub use symmetry::turn;
pub use told::{SeenPress, Told, model_is_better, told};
