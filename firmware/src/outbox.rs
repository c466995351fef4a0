//! Messages waiting for the link. The scan never waits for it.

use embedded_hal_nb::serial::Write;
use heapless::Vec;
use protocol::{FromBoard, MAX_FROM_BOARD_LEN, encode};

/// One framed message.
#[derive(Clone, Debug)]
struct Packet {
    bytes: [u8; MAX_FROM_BOARD_LEN],
    len: usize,
    /// Measured values, of which the newest count, rather than an answer.
    measured: bool,
}

/// A queue of `N` framed messages (2 or more). When it is full, a message is dropped whole: the oldest frame of values
/// that is not on the wire yet, or if there is none the oldest answer. What is on the wire is always finished.
#[derive(Debug)]
pub struct Outbox<const N: usize> {
    packets: [Packet; N],
    /// Packets in use, oldest first; the first is the one on the wire.
    order: Vec<u8, N>,
    /// Bytes of the first packet that are sent.
    sent: usize,
    /// Whether the wire was delimited once, so that noise before power-up does not cost the first message.
    delimited: bool,
}

impl<const N: usize> Default for Outbox<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Outbox<N> {
    /// An empty queue.
    pub const fn new() -> Self {
        const {
            assert!(N >= 2 && N <= 255);
        }
        Self {
            packets: [const {
                Packet {
                    bytes: [0; MAX_FROM_BOARD_LEN],
                    len: 0,
                    measured: false,
                }
            }; N],
            order: Vec::new(),
            sent: 0,
            delimited: false,
        }
    }

    /// Messages waiting, the one on the wire included.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Whether nothing is waiting.
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Queues a message. Returns how many were dropped for it, 0 or 1.
    pub fn push(&mut self, message: &FromBoard) -> u32 {
        let mut dropped = 0;
        let free = match (0..N as u8).find(|k| !self.order.contains(k)) {
            Some(free) => free,
            None => {
                dropped = 1;
                self.make_room()
            }
        };
        let Some(packet) = self.packets.get_mut(usize::from(free)) else {
            return 1;
        };
        match encode(message, &mut packet.bytes) {
            Ok(bytes) => packet.len = bytes.len(),
            // Cannot happen: the buffer holds the largest message. Nothing is queued then.
            Err(_) => return dropped + 1,
        }
        packet.measured = matches!(message, FromBoard::Frame(_));
        let _ = self.order.push(free);
        dropped
    }

    /// Drops one message and returns its place.
    fn make_room(&mut self) -> u8 {
        let on_the_wire = usize::from(self.sent > 0);
        let measured = |k: &u8| self.packets.get(usize::from(*k)).is_some_and(|p| p.measured);
        let victim = self
            .order
            .iter()
            .skip(on_the_wire)
            .position(measured)
            .map_or(on_the_wire, |k| k + on_the_wire);
        self.order.remove(victim)
    }

    /// Hands bytes to the link until it takes no more. Returns how many it took.
    ///
    /// # Errors
    /// What the link reported, with the byte lost; the rest is tried again next time, and the receiver sees a damaged
    /// message.
    pub fn pump<W: Write<u8>>(&mut self, link: &mut W) -> Result<usize, W::Error> {
        let mut taken = 0;
        if !self.delimited {
            match link.write(0) {
                Err(nb::Error::WouldBlock) => return Ok(0),
                result => {
                    self.delimited = true;
                    sorted(result)?;
                    taken += 1;
                }
            }
        }
        while let Some(first) = self.order.first() {
            let Some(packet) = self.packets.get(usize::from(*first)) else {
                break;
            };
            let rest = packet.bytes.get(self.sent..packet.len).unwrap_or_default();
            let Some((byte, more)) = rest.split_first() else {
                break;
            };
            let result = link.write(*byte);
            if matches!(result, Err(nb::Error::WouldBlock)) {
                break;
            }
            self.sent += 1;
            if more.is_empty() {
                self.sent = 0;
                self.order.remove(0);
            }
            sorted(result)?;
            taken += 1;
        }
        Ok(taken)
    }
}

/// The result without the case that was dealt with.
fn sorted<E>(result: nb::Result<(), E>) -> Result<(), E> {
    match result {
        Err(nb::Error::Other(e)) => Err(e),
        Ok(()) | Err(nb::Error::WouldBlock) => Ok(()),
    }
}
