//! What the board does while nothing touches, and what it says meanwhile.

use crate::hello::Hello;
use crate::plan::{Pair, Recipe, Sampling, Slot};
use crate::value::Value;
use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Most slots of a watch.
pub const MAX_WATCH_SLOTS: usize = 8;
/// Most values of a watch.
pub const MAX_WATCH_VALUES: usize = 48;

/// A few drives that show a touch anywhere. While nothing touches, the board measures only these, compares them with their
/// baseline itself, and sends heartbeats instead of frames. A change brings the plan with the next drive.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Watch {
    /// Quarter periods to wait after every switch.
    pub settle_quarters: u16,
    /// Whole periods to integrate for every value.
    pub integrate_periods: u16,
    /// One value after the other, or all of a slot at once.
    pub sampling: Sampling,
    /// Quarter periods to rest after each scan of the watch.
    pub rest_quarters: u16,
    /// Scans that the baseline and its noise are learned from, 2 or more.
    pub learn_scans: u16,
    /// The board wakes when the mean over the values of (change / noise)^2 is this many 256ths or more. Without a touch
    /// the mean is 256 on average; over n values its distribution is that of chi-square with n degrees of freedom over n.
    pub threshold: u16,
    /// After so many frames the watch is scanned once between them, 1 or more.
    pub frames_between: u16,
    /// After so many of those scans in a row without a change the board goes back to watching, 1 or more.
    pub quiet_scans: u16,
    /// A heartbeat after so many scans without a change, 1 or more.
    pub heartbeat_scans: u16,
    /// Drive pairs in the order of measuring.
    pub slots: Vec<Slot, MAX_WATCH_SLOTS>,
}

impl Watch {
    /// For the paper's disc: two long drives, 135 degrees wide, and of each the six sense pairs of the wide side, which fit
    /// the gain of neighbouring drives. A scan of 2.5 periods shows the least visible touch of 25 N at 129 times its noise,
    /// where all 208 values together show 161; then it rests 10 periods. The threshold is passed by chance once in 10^10.
    pub fn paper() -> Self {
        let slot = |plus: u8| Slot {
            drive: Pair {
                plus,
                minus: (plus + 6) % 16,
            },
            sense_step: 1,
            // Six pairs, beginning two beyond the drive's second electrode.
            sense: (0..6).fold(0, |bits, k| bits | 1 << ((plus + 8 + k) % 16)),
            gain: 0,
        };
        Self {
            settle_quarters: 1,
            integrate_periods: 1,
            sampling: Sampling::Simultaneous,
            rest_quarters: 40,
            learn_scans: 64,
            threshold: 1600,
            frames_between: 8,
            quiet_scans: 4,
            heartbeat_scans: 295,
            slots: [slot(0), slot(8)].into_iter().collect(),
        }
    }

    /// For a board with one channel, on the paper's disc: eight drives 90 degrees wide all round, and of each one sense pair
    /// across them. Each of the eight values takes a quarter period and one, and the board can wake after each. A scan of
    /// 10 periods shows the least visible touch of 25 N at 202 times its noise; then it rests 20 periods. The threshold
    /// is passed by chance once in 10^11. `hil-sim/examples/watch.rs` chooses the pairs.
    pub fn sequential() -> Self {
        let slot = |plus: u8| Slot {
            drive: Pair {
                plus,
                minus: (plus + 4) % 16,
            },
            sense_step: 6,
            sense: 1 << ((plus + 2) % 16),
            gain: 0,
        };
        Self {
            settle_quarters: 1,
            integrate_periods: 1,
            sampling: Sampling::Sequential,
            rest_quarters: 80,
            learn_scans: 128,
            threshold: 2304,
            frames_between: 1,
            quiet_scans: 4,
            heartbeat_scans: 123,
            slots: (0..8).map(|k| slot(2 * k)).collect(),
        }
    }

    /// The watch for a board that samples so many channels at once: [`Watch::paper`] where there is one for every electrode,
    /// else [`Watch::sequential`]. `None` for other than the paper's 16 electrodes, for which none was chosen.
    pub fn for_board(board: &Hello) -> Option<Self> {
        (board.electrodes == 16).then(|| {
            if board.limits.channels >= board.electrodes {
                Self::paper()
            } else {
                Self::sequential()
            }
        })
    }

    /// What a scan needs to know.
    pub fn recipe(&self) -> Recipe<'_> {
        Recipe {
            settle_quarters: self.settle_quarters,
            integrate_periods: self.integrate_periods,
            sampling: self.sampling,
            quadrature: false,
            slots: &self.slots,
        }
    }
}

/// What the board is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Watching {
    /// There is no watch, or no scan.
    #[default]
    Off,
    /// It learns the baseline of the watch.
    Learning,
    /// Nothing touches: it scans the watch and sends heartbeats.
    Asleep,
    /// Something touches, or did so lately: it sends frames.
    Awake,
}

/// Sign of life of a board that watches, every [`Watch::heartbeat_scans`] and at each change of state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Heartbeat {
    /// When, in samples since power-up.
    pub time: u64,
    /// What it does from now on.
    pub state: Watching,
    /// The mean of (change / noise)^2 over the values of the watch, in 256ths; the largest since the last heartbeat.
    pub level: u16,
    /// Scans of the watch since power-up, wrapping.
    pub scans: u32,
}

/// What the board takes for untouched.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Baseline {
    /// Scans it was learned from; 0 while it is not learned yet.
    pub scans: u16,
    /// Of every value of the watch, in its order.
    pub values: Vec<Value, MAX_WATCH_VALUES>,
    /// Variance of each that the change test reckons with, in sixteenths of a squared [`Value`]: 4096 are a squared code.
    pub variance: Vec<u16, MAX_WATCH_VALUES>,
}
