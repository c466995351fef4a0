//! How much of what cannot be read is answered: noise on the line must not take it from the frames.

/// Answers to what cannot be read, in a second that begins with the first of them. With the notice of what was passed over
/// these are nine messages of twelve bytes at most: a thousandth of the line. Fewer leave a person's own tries unanswered.
const ANSWERS: u32 = 8;

/// What was answered and what was passed over.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Answers {
    /// When the second under way is over, in samples since power-up.
    until: u64,
    given: u32,
    passed_over: u32,
}

impl Answers {
    /// Nothing came yet.
    pub(crate) const NONE: Self = Self {
        until: 0,
        given: 0,
        passed_over: 0,
    };

    /// Something came that cannot be read: whether it is answered.
    pub(crate) fn answers(&mut self, now: u64, second: u64) -> bool {
        if now >= self.until && self.passed_over == 0 {
            self.until = now.saturating_add(second);
            self.given = 0;
        }
        let answered = self.given < ANSWERS;
        if answered {
            self.given += 1;
        } else {
            self.passed_over = self.passed_over.saturating_add(1);
        }
        answered
    }

    /// Whether something is to be told once the second is over.
    pub(crate) fn is_owing(&self) -> bool {
        self.passed_over > 0
    }

    /// What was passed over, once the second is over.
    pub(crate) fn take(&mut self, now: u64) -> Option<u32> {
        (now >= self.until && self.passed_over > 0).then(|| core::mem::take(&mut self.passed_over))
    }
}
