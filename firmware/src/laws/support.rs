//! The duties of clock, watchdog, store and the word that outlives a reset.

use crate::capture::{Block, Capture, Window};
use crate::front_end::FrontEnd;
use crate::support::{Clock, Scratch, Sector, Store, Watchdog};

/// A duty that is not kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SupportViolation {
    /// The clock went back.
    Backwards {
        /// What it said before.
        before: u64,
        /// What it said then.
        after: u64,
    },
    /// The clock and the samples do not go together: a window ended at a time that the clock has not reached, or long
    /// before it.
    Rate {
        /// End of the window, in samples since power-up.
        window: u64,
        /// What the clock said when it was lent.
        clock: u64,
    },
    /// The front end reported an error.
    FrontEnd,
    /// The word that outlives a reset is not what was kept.
    Forgot {
        /// What was kept.
        expected: u32,
        /// What was recalled.
        found: u32,
    },
    /// The watchdog bit though it was fed.
    Bit,
    /// The watchdog did not bite though it was not fed.
    Slept,
    /// The store reported an error where none was due, or none where one was due.
    Refused,
    /// The store does not give back what it was given.
    Content {
        /// Where.
        sector: Sector,
        /// Where in it.
        offset: u32,
        /// What was expected.
        expected: u8,
        /// What was found.
        found: u8,
    },
}

/// The clock never goes back and counts the samples of the front end: each block is lent after its last sample, and within
/// two periods of it, by the clock. `both` gives access to the two.
///
/// # Errors
/// The first duty found broken.
pub fn clock<T, F: FrontEnd + Capture, C: Clock>(
    both: &mut T,
    front: impl Fn(&mut T) -> &mut F,
    clock: impl Fn(&mut T) -> &mut C,
) -> Result<(), SupportViolation> {
    let failed = |_| SupportViolation::FrontEnd;
    front(both).switch_on().map_err(failed)?;
    let mut before = clock(both).now();
    for periods in [1, 3, 20] {
        let window = Window {
            settle_quarters: 1,
            periods,
            channels: 1,
        };
        Capture::begin(front(both), window).map_err(failed)?;
        let mut left = window.quarters() - 1;
        while left > 0 {
            let polled = front(both).poll_block(|b: &Block<'_>| (b.time + b.samples.len() as u64, b.quarters()));
            let after = clock(both).now();
            if after < before {
                return Err(SupportViolation::Backwards { before, after });
            }
            before = after;
            match polled {
                Ok((end, quarters)) => {
                    if after < end || after > end + 32 {
                        return Err(SupportViolation::Rate {
                            window: end,
                            clock: after,
                        });
                    }
                    left = left.saturating_sub(quarters.unwrap_or(left));
                }
                Err(nb::Error::WouldBlock) => {}
                Err(nb::Error::Other(_)) => return Err(SupportViolation::FrontEnd),
            }
        }
    }
    front(both).switch_off().map_err(failed)
}

/// The watchdog stays quiet while it is fed every half time-out, and bites when it is not fed for two. `wait` lets half a
/// time-out pass, `bit` says whether it has bitten.
///
/// # Errors
/// The first duty found broken.
pub fn watchdog<W: Watchdog>(
    dog: &mut W,
    mut wait: impl FnMut(&mut W),
    mut bit: impl FnMut(&mut W) -> bool,
) -> Result<(), SupportViolation> {
    for _ in 0..20 {
        dog.feed();
        wait(dog);
        if bit(dog) {
            return Err(SupportViolation::Bit);
        }
    }
    for _ in 0..4 {
        wait(dog);
    }
    if bit(dog) { Ok(()) } else { Err(SupportViolation::Slept) }
}

/// The word is what was kept last, bit for bit. That it outlives a reset only a reset shows.
///
/// # Errors
/// The first duty found broken.
pub fn scratch<W: Scratch>(word: &mut W) -> Result<(), SupportViolation> {
    let before = word.recall();
    let patterns = [0, u32::MAX, 0x5555_AAAA, 0x1234_5678, before];
    for expected in patterns {
        word.keep(expected);
        let found = word.recall();
        if found != expected {
            return Err(SupportViolation::Forgot { expected, found });
        }
    }
    Ok(())
}

/// The store keeps what is written, erases one sector without the other, and refuses what is beyond its end. It is empty
/// afterwards.
///
/// # Errors
/// The first duty found broken.
pub fn store<S: Store>(store: &mut S) -> Result<(), SupportViolation> {
    let refused = |_| SupportViolation::Refused;
    let len = store.sector_len();
    let byte = |sector, k: u32| (k.wrapping_mul(31) ^ if sector == Sector::A { 5 } else { 77 }) as u8;
    for sector in [Sector::A, Sector::B] {
        store.erase(sector).map_err(refused)?;
        expect(store, sector, |_| 0xFF)?;
        // In pieces of all sizes, of whole units.
        let unit = store.write_len().max(1);
        let (mut at, mut size) = (0, unit);
        while at < len {
            let mut piece = [0; 32];
            let n = size.min(len - at);
            for (k, place) in (at..).zip(piece.iter_mut().take(n as usize)) {
                *place = byte(sector, k);
            }
            store
                .write(sector, at, piece.get(..n as usize).unwrap_or_default())
                .map_err(refused)?;
            at += n;
            size = size % 32 + unit;
        }
    }
    for sector in [Sector::A, Sector::B] {
        expect(store, sector, |k| byte(sector, k))?;
    }
    store.erase(Sector::A).map_err(refused)?;
    expect(store, Sector::A, |_| 0xFF)?;
    expect(store, Sector::B, |k| byte(Sector::B, k))?;
    if store.read(Sector::A, len, &mut [0]).is_ok() || store.write(Sector::A, len, &[0]).is_ok() {
        return Err(SupportViolation::Refused);
    }
    store.erase(Sector::B).map_err(refused)
}

/// A sector holds these bytes.
fn expect<S: Store>(store: &mut S, sector: Sector, byte: impl Fn(u32) -> u8) -> Result<(), SupportViolation> {
    for offset in 0..store.sector_len() {
        let mut found = [0];
        store
            .read(sector, offset, &mut found)
            .map_err(|_| SupportViolation::Refused)?;
        let ([found], expected) = (found, byte(offset));
        if found != expected {
            return Err(SupportViolation::Content {
                sector,
                offset,
                expected,
                found,
            });
        }
    }
    Ok(())
}
