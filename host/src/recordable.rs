//! What a session needs so that it can be recorded from some frame on.

use crate::recorded::SessionRecord;
use inverse::live::Live;
use inverse::reference::imager::ImagerError;
use recording::{Switch, Tap};
use std::thread::JoinHandle;
use std::time::Instant;

/// What a session needs to be recorded from some frame on.
pub(crate) struct Recordable {
    /// Between the port and the link.
    pub(crate) switch: Switch,
    pub(crate) record: SessionRecord,
    /// A reconstruction that has seen no frame, for a recording that was asked for: it is made beside the pictures, which go on.
    pub(crate) made: Option<JoinHandle<Result<Live, ImagerError>>>,
    /// A recording until its first frame comes, and the reconstruction that begins there.
    pub(crate) begins: Option<(Tap, Live)>,
    pub(crate) since: Instant,
    /// What was said last to whoever asked.
    pub(crate) note: Option<String>,
}

impl Recordable {
    pub(crate) fn new(switch: Switch, record: SessionRecord) -> Self {
        Self {
            switch,
            record,
            made: None,
            begins: None,
            since: Instant::now(),
            note: None,
        }
    }
}
