//! ROS 2: the messages, and `--ros2`, which makes every skin a node on the robot's network without ROS on this computer.
//!
//! The nodes speak DDS by themselves (RustDDS). A thread of its own sends what the skins' threads hand over; these never wait for it.

pub(crate) mod messages;

#[cfg(not(feature = "ros2"))]
mod absent;
#[cfg(feature = "ros2")]
mod endpoints;
#[cfg(feature = "ros2")]
mod environment;
#[cfg(feature = "ros2")]
mod facts;
#[cfg(feature = "ros2")]
mod mailbox;
#[cfg(feature = "ros2")]
mod publisher;
#[cfg(feature = "ros2")]
mod replies;
#[cfg(feature = "ros2")]
mod tare;

#[cfg(not(feature = "ros2"))]
pub(crate) use absent::{Node, Ros2};
#[cfg(feature = "ros2")]
pub(crate) use mailbox::Node;
#[cfg(feature = "ros2")]
pub(crate) use publisher::Ros2;

use crate::run_arguments::ShowArguments;
use crate::skin_file::Place;
use anyhow::Result;

/// What a node is of.
pub(crate) struct Described<'a> {
    /// The skin's name, of several.
    pub(crate) skin: Option<&'a str>,
    pub(crate) place: Option<&'a Place>,
    /// The board's serial number.
    pub(crate) serial: &'a str,
    /// Whether a baseline can be taken, as it cannot in a recording that is played.
    pub(crate) live: bool,
}

/// Joins the network where that is asked for.
///
/// # Errors
/// It cannot be.
pub(crate) fn start(show: &ShowArguments) -> Result<Option<Ros2>> {
    let namespace = show.ros2.as_ref();
    namespace.map(|namespace| Ros2::start(namespace.as_deref())).transpose()
}

/// The name of a skin that has none.
pub(crate) const SKIN: &str = "skin";
