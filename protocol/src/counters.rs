//! What the board counts.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Events since power-up or since [`crate::ToBoard::ResetCounters`]. Each stays at `u32::MAX` once it is there.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// Frames measured and queued.
    pub frames: u32,
    /// Messages dropped whole from the transmit queue because the link was slower than the scan.
    pub dropped: u32,
    /// Frames given up because a sample was lost.
    pub overruns: u32,
    /// Frames given up for any other fault of the front end.
    pub front_end_faults: u32,
    /// Values marked as clipped.
    pub clipped: u32,
    /// Commands understood.
    pub commands: u32,
    /// Commands refused: damaged, unknown or impossible.
    pub refused: u32,
    /// Errors that the serial receiver reported: lost bytes, noise.
    pub receive_errors: u32,
    /// Errors that the serial transmitter reported.
    pub transmit_errors: u32,
    /// Scans of the watch.
    pub watch_scans: u32,
    /// Times that a change woke the board.
    pub wakes: u32,
}

impl Counters {
    /// Adds to one counter, stopping at `u32::MAX`.
    pub fn add(counter: &mut u32, events: u32) {
        *counter = counter.saturating_add(events);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counter_stays_at_its_end() {
        let mut c = Counters {
            overruns: u32::MAX - 1,
            ..Counters::default()
        };
        Counters::add(&mut c.overruns, 5);
        Counters::add(&mut c.overruns, 1);
        assert_eq!(c.overruns, u32::MAX);
    }
}
