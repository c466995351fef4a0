//! How often in a row the board was restarted by faults of its own, kept where a reset does not reach.

use protocol::ResetCause;

/// From so many resets in a row on the stored settings are left alone.
const WITHOUT_SETTINGS: u8 = 3;

/// Seconds of measuring after which the resets before count no more. Less takes a fault that comes late in a plan for none;
/// more keeps a board careful that a single glitch restarted.
const GOOD_LIFE_S: u64 = 30;

/// Upper half of the word that is kept. Its lower half is the count and the count's complement: what memory holds after
/// power came is taken for one in 2^24 times.
const MARK: u32 = 0x5C1F_0000;

/// The lives before this one, as far as they ended badly.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lives {
    resets: u8,
    /// Since when the board measures, in samples since power-up.
    since: u64,
}

impl Lives {
    /// Nothing is known yet.
    pub(crate) const NONE: Self = Self { resets: 0, since: 0 };

    /// Another life, which began for this reason, with the word of the one before. A supply that sags tells nothing of the
    /// firmware; whoever resets the board otherwise wants it as it was told to be.
    pub(crate) fn begun(cause: ResetCause, word: u32) -> Self {
        let resets = match cause {
            ResetCause::Panic | ResetCause::Watchdog => count(word).saturating_add(1),
            ResetCause::BrownOut => count(word),
            ResetCause::Unknown | ResetCause::PowerOn | ResetCause::Pin | ResetCause::Software => 0,
        };
        Self { resets, since: 0 }
    }

    /// What is to be kept for the next life.
    pub(crate) fn word(self) -> u32 {
        MARK | u32::from(self.resets) << 8 | u32::from(!self.resets)
    }

    /// Resets in a row by faults of its own.
    pub(crate) fn resets(self) -> u8 {
        self.resets
    }

    /// Whether the stored settings are to be taken up.
    pub(crate) fn takes_settings(self) -> bool {
        self.resets < WITHOUT_SETTINGS
    }

    /// The board begins to measure.
    pub(crate) fn measures_from(&mut self, now: u64) {
        self.since = now;
    }

    /// It still measures: true if this makes the life a good one, and the resets before count no more.
    pub(crate) fn still_measures(&mut self, now: u64, second: u64) -> bool {
        let good = self.resets > 0 && now.saturating_sub(self.since) >= second.saturating_mul(GOOD_LIFE_S);
        if good {
            self.resets = 0;
        }
        good
    }
}

/// The count in a word; 0 where none was kept.
fn count(word: u32) -> u8 {
    let resets = (word >> 8) as u8;
    let lives = Lives { resets, since: 0 };
    if lives.word() == word { resets } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_is_kept_and_anything_else_is_none() {
        let mut found = 0u32;
        for resets in 0..=255u8 {
            let word = Lives { resets, since: 0 }.word();
            assert_eq!(count(word), resets);
            // No single bit makes another count of it.
            for bit in 0..32 {
                assert_eq!(count(word ^ 1 << bit), 0, "{resets} {bit}");
            }
        }
        for word in (0..u32::MAX).step_by(4099) {
            found += u32::from(count(word) > 0);
        }
        assert_eq!((count(0), count(u32::MAX)), (0, 0));
        assert!(found <= 1, "{found}");
    }

    #[test]
    fn only_faults_of_its_own_count_and_only_a_long_life_clears_them() {
        use ResetCause::{BrownOut, Panic, Pin, PowerOn, Software, Unknown, Watchdog};
        let mut word = 0x1234_5678;
        for (cause, resets) in [
            (PowerOn, 0),
            (Panic, 1),
            (Watchdog, 2),
            (BrownOut, 2),
            (Panic, 3),
            (Watchdog, 4),
            (Pin, 0),
            (Watchdog, 1),
            (Software, 0),
            (Panic, 1),
            (Unknown, 0),
        ] {
            let lives = Lives::begun(cause, word);
            assert_eq!(
                (lives.resets(), lives.takes_settings()),
                (resets, resets < 3),
                "{cause:?}"
            );
            word = lives.word();
        }
        let mut lives = Lives::begun(Panic, word);
        lives.measures_from(1000);
        assert!(!lives.still_measures(1000 + 299, 10) && lives.resets() == 1);
        assert!(lives.still_measures(1000 + 300, 10) && lives.resets() == 0);
        assert!(!lives.still_measures(5000, 10));
        // It never comes round.
        assert_eq!(
            Lives::begun(Panic, Lives { resets: 255, since: 0 }.word()).resets(),
            255
        );
    }
}
