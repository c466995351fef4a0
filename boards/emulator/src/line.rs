//! The far end of the serial line.

use crate::world::locked;
use rigless::chip::Timeline;
use rigless::chip::uart::Peer;
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

/// Bytes both ways; clones are the same line.
#[derive(Clone, Debug, Default)]
pub struct Line {
    /// What the board sent, and when, ns.
    pub sent: Arc<Mutex<Vec<(u64, u8)>>>,
    /// What it is going to be sent.
    pub input: Arc<Mutex<VecDeque<u8>>>,
}

/// Snapshots are not taken.
impl Store for Line {}

impl Peer for Line {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        locked(&self.sent).push((context.now().0, word as u8));
    }

    fn transmit(&mut self, _now: VirtualNanos) -> Option<u16> {
        locked(&self.input).pop_front().map(u16::from)
    }
}
