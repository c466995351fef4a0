//! The duties of a front end.

use crate::capture::{Capture, QUARTER_SAMPLES, Window};
use crate::error::{Error, ErrorKind};
use crate::fold::Folded;
use crate::front_end::FrontEnd;
use crate::route::{Route, Sense};
use protocol::QUARTERS;

/// A duty that a front end does not keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Violation {
    /// It reported an error where none was due.
    Refused(ErrorKind),
    /// A block does not start at a boundary of quarter periods.
    Phase {
        /// The time it gave.
        time: u64,
    },
    /// A block does not hold whole quarter periods of the channels asked for.
    Shape {
        /// Samples in it.
        samples: usize,
        /// Channels it says it has.
        channels: u8,
    },
    /// A block's number does not follow the one before.
    Sequence {
        /// Number expected.
        expected: u32,
        /// Number found.
        found: u32,
    },
    /// A block's time does not follow the one before, in the same window.
    Gap {
        /// Time expected.
        expected: u64,
        /// Time found.
        found: u64,
    },
    /// A window opened before its settling was over.
    Settling {
        /// Earliest time allowed.
        earliest: u64,
        /// Time found.
        found: u64,
    },
    /// A window lent another number of quarter periods than asked for.
    Quarters {
        /// Asked for.
        expected: u32,
        /// Lent.
        found: u32,
    },
    /// The signal is not in phase with the excitation at the phase that the blocks' times give.
    Signal {
        /// In-phase sum.
        in_phase: i64,
        /// Quadrature sum.
        quadrature: i64,
    },
    /// Samples were lost and nothing was said.
    SilentOverrun,
    /// Nothing came, however often it was polled.
    Stuck,
}

/// Polls without a block before a front end counts as stuck. Fewer may accuse a slow front end; more only delay the report.
const PATIENCE: u32 = 50_000_000;

/// Runs every law on a front end that lends samples. `route` must put a voltage on its first channel in phase with the excitation, of at least
/// half the converter's range from peak to peak. `channels` is how many channels `route` has, `bits` how many a code has.
/// `stall` must let more time pass than the front end has room for blocks.
///
/// # Errors
/// The first duty found broken. The excitation is then left on.
pub fn check<F: FrontEnd + Capture>(
    front: &mut F,
    route: &Route,
    channels: u8,
    bits: u8,
    mut stall: impl FnMut(&mut F),
) -> Result<(), Violation> {
    let refused = |e: F::Error| Violation::Refused(e.kind());
    let channels = match route.sense {
        Sense::One(_) | Sense::Source => 1,
        Sense::All { .. } => channels,
    };
    front.switch_on().map_err(refused)?;
    front.select(route).map_err(refused)?;
    let mut ledger = Ledger {
        bits,
        next: None,
        end: 0,
    };
    for (settle_quarters, periods) in [(0, 1), (4, 1), (1, 2), (13, 4), (0, 5), (3, 1), (6, 40)] {
        let window = Window {
            settle_quarters,
            periods,
            channels,
        };
        Capture::begin(front, window).map_err(refused)?;
        in_phase(&ledger.read(front, window)?)?;
    }

    // A window begun anew lends its own periods only.
    let long = Window {
        settle_quarters: 0,
        periods: 1000,
        channels,
    };
    let short = Window { periods: 3, ..long };
    Capture::begin(front, long).map_err(refused)?;
    Capture::begin(front, short).map_err(refused)?;
    ledger.read(front, short)?;

    // Lost samples are said, and the next window is whole again.
    Capture::begin(front, long).map_err(refused)?;
    stall(front);
    match ledger.read(front, long) {
        Err(Violation::Refused(ErrorKind::Overrun)) => {}
        Err(other) => return Err(other),
        Ok(_) => return Err(Violation::SilentOverrun),
    }
    ledger.next = None;
    // What the source is filtered by may have to swing in again.
    let after = Window {
        settle_quarters: 2 * QUARTERS as u16,
        ..short
    };
    Capture::begin(front, after).map_err(refused)?;
    in_phase(&ledger.read(front, after)?)?;
    front.switch_off().map_err(refused)
}

/// The first channel is in phase with the excitation.
fn in_phase(folded: &Folded) -> Result<(), Violation> {
    let (p, _) = folded.correlate(0);
    if p.in_phase <= 0 || p.quadrature.abs() > p.in_phase / 4 {
        return Err(Violation::Signal {
            in_phase: p.in_phase,
            quadrature: p.quadrature,
        });
    }
    Ok(())
}

/// What the blocks so far lead one to expect.
struct Ledger {
    /// Bits of a code.
    bits: u8,
    /// Number of the next block.
    next: Option<u32>,
    /// Time after the last block, in samples.
    end: u64,
}

impl Ledger {
    /// Reads a window that was just opened.
    fn read<F: FrontEnd + Capture>(&mut self, front: &mut F, window: Window) -> Result<Folded, Violation> {
        let mut folded = Folded::of_bits(self.bits);
        folded.reset(window.channels);
        let wanted = QUARTERS * u32::from(window.periods);
        let mut earliest = self.end + u64::from(window.settle_quarters) * QUARTER_SAMPLES as u64;
        while folded.quarters() < wanted {
            let seen = poll(front, |block| {
                let shape = Violation::Shape {
                    samples: block.samples.len(),
                    channels: block.channels,
                };
                if !block.time.is_multiple_of(QUARTER_SAMPLES as u64) {
                    return Err(Violation::Phase { time: block.time });
                }
                folded.add(block).map_err(|_| shape)?;
                let quarters = block.quarters().ok_or(shape)?;
                Ok((block.time, block.sequence, quarters))
            })?;
            let (time, sequence, quarters) = seen.ok_or(Violation::Stuck)??;
            if let Some(expected) = self.next.filter(|n| *n != sequence) {
                return Err(Violation::Sequence {
                    expected,
                    found: sequence,
                });
            }
            if time < earliest {
                return Err(Violation::Settling { earliest, found: time });
            }
            let first = folded.quarters() == quarters;
            if !first && time != self.end {
                return Err(Violation::Gap {
                    expected: self.end,
                    found: time,
                });
            }
            self.next = Some(sequence.wrapping_add(1));
            self.end = time + u64::from(quarters) * QUARTER_SAMPLES as u64;
            earliest = self.end;
        }
        // A block more than asked for is as wrong as one less.
        let more = front.poll_block(|block| block.quarters().unwrap_or(0));
        let surplus = more.unwrap_or(0);
        let found = folded.quarters() + surplus;
        if found != wanted {
            return Err(Violation::Quarters {
                expected: wanted,
                found,
            });
        }
        Ok(folded)
    }
}

/// Polls until a block comes; `None` if none does.
fn poll<F: Capture, R>(
    front: &mut F,
    mut f: impl FnMut(&crate::capture::Block<'_>) -> R,
) -> Result<Option<R>, Violation> {
    for _ in 0..PATIENCE {
        match front.poll_block(&mut f) {
            Ok(r) => return Ok(Some(r)),
            Err(nb::Error::WouldBlock) => {}
            Err(nb::Error::Other(e)) => return Err(Violation::Refused(e.kind())),
        }
    }
    Ok(None)
}
