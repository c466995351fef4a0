//! Messages waiting for the link. The scan never waits for it.

use core::cell::Cell;
use embedded_hal_nb::serial::Write;
use heapless::Vec;
use protocol::{MAX_FROM_BOARD_LEN, Outgoing, encode};

/// Most messages that wait, however short they are: the answers to a burst of commands. Each costs four bytes of RAM;
/// older messages make room for more.
const MESSAGES: usize = 16;

/// One framed message.
#[derive(Clone, Copy, Debug)]
struct Packet {
    len: u16,
    /// Measured values, of which the newest count, rather than an answer.
    measured: bool,
}

/// A queue of framed messages in `N` bytes. When there is no room for another, messages are dropped whole: the oldest frame
/// of values that is not on the wire yet, or if there is none the oldest answer. What is on the wire is always finished.
#[derive(Debug)]
pub struct Outbox<const N: usize> {
    bytes: [u8; N],
    /// Where the first packet begins; the others follow it without a gap.
    start: usize,
    /// Packets, oldest first; the first is the one on the wire.
    packets: Vec<Packet, MESSAGES>,
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
            assert!(N >= MAX_FROM_BOARD_LEN, "the largest message must fit an empty queue");
            assert!(N <= u16::MAX as usize);
        }
        Self {
            bytes: [0; N],
            start: 0,
            packets: Vec::new(),
            sent: 0,
            delimited: false,
        }
    }

    /// Messages waiting, the one on the wire included.
    pub fn len(&self) -> usize {
        self.packets.len()
    }

    /// Whether nothing is waiting.
    pub fn is_empty(&self) -> bool {
        self.packets.is_empty()
    }

    /// Queues a message. Returns how many were dropped for it; when only the one on the wire is left and there is still no
    /// room, that is the message itself.
    pub fn push(&mut self, message: &Outgoing<'_>) -> u32 {
        let mut dropped = 0;
        loop {
            if !self.packets.is_full() {
                let end = self.start + self.used();
                let room = self.bytes.get_mut(end..).unwrap_or_default();
                if let Ok(framed) = encode(message, room) {
                    let packet = Packet {
                        len: framed.len() as u16,
                        measured: matches!(message, Outgoing::Frame(_)),
                    };
                    let _ = self.packets.push(packet);
                    return dropped;
                }
                if self.start > 0 {
                    self.move_bytes(self.start, end, 0);
                    self.start = 0;
                    continue;
                }
            }
            dropped += 1;
            if !self.make_room() {
                return dropped;
            }
        }
    }

    /// Bytes of all packets.
    fn used(&self) -> usize {
        self.packets.iter().map(|p| usize::from(p.len)).sum()
    }

    /// Drops one message; false if there is none to drop.
    fn make_room(&mut self) -> bool {
        let on_the_wire = usize::from(self.sent > 0);
        let oldest = self.packets.iter().skip(on_the_wire).position(|p| p.measured);
        let victim = oldest.map_or(on_the_wire, |k| k + on_the_wire);
        if victim >= self.packets.len() {
            return false;
        }
        let before: usize = self.packets.iter().take(victim).map(|p| usize::from(p.len)).sum();
        let end = self.start + self.used();
        let from = self.start + before;
        if let Some(packet) = self.take_out(victim) {
            self.move_bytes(from + usize::from(packet.len), end, from);
        }
        true
    }

    // The slices' and vectors' own ways for the next two can panic, as far as the compiler knows: the hot path must not.

    /// Moves the bytes of a range to another place before it.
    fn move_bytes(&mut self, start: usize, end: usize, to: usize) {
        let bytes = Cell::from_mut(&mut self.bytes[..]).as_slice_of_cells();
        let from = bytes.get(start..end).unwrap_or_default();
        for (to, from) in bytes.iter().skip(to).zip(from) {
            to.set(from.get());
        }
    }

    /// Takes a packet out of the list; those behind it move up.
    fn take_out(&mut self, index: usize) -> Option<Packet> {
        let tail = Cell::from_mut(self.packets.get_mut(index..)?).as_slice_of_cells();
        let taken = tail.first()?.get();
        for (place, next) in tail.iter().zip(tail.iter().skip(1)) {
            place.set(next.get());
        }
        self.packets.pop();
        Some(taken)
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
        while let Some(first) = self.packets.first() {
            let len = usize::from(first.len);
            let Some(byte) = self.bytes.get(self.start + self.sent) else {
                break;
            };
            let result = link.write(*byte);
            if matches!(result, Err(nb::Error::WouldBlock)) {
                break;
            }
            self.sent += 1;
            if self.sent >= len {
                self.sent = 0;
                self.start += len;
                self.take_out(0);
                if self.packets.is_empty() {
                    self.start = 0;
                }
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
