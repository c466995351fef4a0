//! What a session needs so that it can be recorded from some frame on.

use crate::recorded::SessionRecord;
use recording::{Switch, Tap};
use std::time::Instant;

/// What a session needs to be recorded from some frame on.
pub(crate) struct Recordable {
    /// Between the port and the link.
    pub(crate) switch: Switch,
    pub(crate) record: SessionRecord,
    /// A recording that was asked for, until its first frame comes.
    pub(crate) begins: Option<Tap>,
    pub(crate) since: Instant,
    /// What was said last to whoever asked.
    pub(crate) note: Option<String>,
}

impl Recordable {
    pub(crate) fn new(switch: Switch, record: SessionRecord) -> Self {
        Self {
            switch,
            record,
            begins: None,
            since: Instant::now(),
            note: None,
        }
    }
}
