//! The large part of a controller's state.

use crate::change::ChangeTest;
use crate::outbox::Outbox;
use crate::scan::Scan;
use crate::settings::Settings;
use protocol::{Decoder, MAX_TO_BOARD_LEN, SelfTest};

/// Bytes of messages that can wait for the link: two frames of 208 values, or one with quadrature and some answers. More
/// costs RAM and lets frames become older before they are dropped; less than 1160 cannot hold the largest message.
const QUEUE: usize = 1280;

/// All of a controller that is large, about 5 KiB. A board keeps it in a static, since a stack that could build it would
/// have to be as large again.
#[derive(Debug)]
pub struct Memory {
    pub(crate) decoder: Decoder<MAX_TO_BOARD_LEN>,
    pub(crate) outbox: Outbox<QUEUE>,
    pub(crate) scan: Scan,
    pub(crate) settings: Settings,
    pub(crate) change: ChangeTest,
    pub(crate) report: SelfTest,
}

impl Default for Memory {
    fn default() -> Self {
        Self::new()
    }
}

impl Memory {
    /// As at power-up.
    pub const fn new() -> Self {
        Self {
            decoder: Decoder::new(),
            outbox: Outbox::new(),
            scan: Scan::new(),
            settings: Settings::NONE,
            change: ChangeTest::new(),
            report: SelfTest::NONE,
        }
    }
}
