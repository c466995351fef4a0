//! What a session needs so that it can be recorded from some frame on.

use crate::recorded::SessionRecord;
use inverse::live::Live;
use recording::{Switch, Tap};
use std::time::Instant;

/// What a session needs to be recorded from some frame on.
pub(crate) struct Recordable<'a> {
    /// Between the port and the link.
    pub(crate) switch: Switch,
    pub(crate) record: SessionRecord,
    /// The reconstruction as it is at the beginning of a session.
    pub(crate) anew: Box<dyn Fn() -> Live + 'a>,
    /// A recording that was asked for, until its first frame comes.
    pub(crate) begins: Option<Tap>,
    pub(crate) since: Instant,
    /// What was said last to whoever asked.
    pub(crate) note: Option<String>,
}

impl<'a> Recordable<'a> {
    pub(crate) fn new(switch: Switch, record: SessionRecord, anew: impl Fn() -> Live + 'a) -> Self {
        Self {
            switch,
            record,
            anew: Box::new(anew),
            begins: None,
            since: Instant::now(),
            note: None,
        }
    }
}
