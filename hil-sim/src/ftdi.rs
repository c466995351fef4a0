//! The USB side of an FT232R and its driver: bytes reach a reader in lumps.
//!
//! The chip sends a packet when it has 62 bytes, or when its latency timer runs out, with the bytes there are, possibly none.
//! The timer starts anew with every packet. The driver asks for eight packets at a time. It passes them on when all are
//! there, or with the first packet that is not full.

use std::collections::VecDeque;

/// Bytes of the line in a full packet, which has two more for the chip's state.
const PACKET_BYTES: usize = 62;
/// Bytes that the driver waits for.
const TRANSFER_BYTES: usize = 8 * PACKET_BYTES;

/// Bytes on their way through the adapter.
#[derive(Clone, Debug)]
pub(crate) struct Ftdi {
    latency_s: f64,
    timer_s: f64,
    /// Bytes in the chip, fewer than a packet has.
    chip: Vec<u8>,
    /// Bytes in the driver, fewer than a transfer has.
    transfer: Vec<u8>,
}

impl Ftdi {
    /// An adapter with this latency timer, s.
    pub(crate) fn new(latency_s: f64) -> Self {
        Self {
            latency_s,
            timer_s: 0.0,
            chip: Vec::with_capacity(PACKET_BYTES),
            transfer: Vec::with_capacity(TRANSFER_BYTES),
        }
    }

    /// A byte comes from the line.
    pub(crate) fn push(&mut self, time_s: f64, byte: u8, reader: &mut VecDeque<u8>) {
        self.poll(time_s, reader);
        self.chip.push(byte);
        if self.chip.len() == PACKET_BYTES {
            self.timer_s = time_s;
            self.transfer.append(&mut self.chip);
            if self.transfer.len() == TRANSFER_BYTES {
                reader.extend(self.transfer.drain(..));
            }
        }
    }

    /// Looks at the latency timer.
    pub(crate) fn poll(&mut self, time_s: f64, reader: &mut VecDeque<u8>) {
        if time_s >= self.timer_s + self.latency_s {
            self.timer_s = time_s;
            reader.extend(self.transfer.drain(..));
            reader.extend(self.chip.drain(..));
        }
    }

    /// Whether nothing is under way.
    pub(crate) fn is_empty(&self) -> bool {
        self.chip.is_empty() && self.transfer.is_empty()
    }

    /// Forgets what is under way, as when the port is opened.
    pub(crate) fn purge(&mut self) {
        self.chip.clear();
        self.transfer.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BYTE_S: f64 = 10e-6;

    /// Frames of so many bytes at this distance, sent at 1 Mbit/s: when each byte reached the reader, and the sizes of lumps.
    fn stream(latency_s: f64, frame: usize, every_s: f64, frames: usize) -> (Vec<(f64, f64)>, Vec<usize>) {
        let mut ftdi = Ftdi::new(latency_s);
        let (mut reader, mut sent, mut out, mut lumps) = (VecDeque::new(), Vec::new(), Vec::new(), Vec::new());
        let every = (every_s / BYTE_S).round() as usize;
        for k in 0..every * (frames + 4) {
            let now = k as f64 * BYTE_S;
            let (n, place) = (k / every, k % every);
            if n < frames && place < frame {
                sent.push(now);
                ftdi.push(now, sent.len() as u8, &mut reader);
            } else {
                ftdi.poll(now, &mut reader);
            }
            if !reader.is_empty() {
                lumps.push(reader.len());
                for byte in reader.drain(..) {
                    assert_eq!(byte, (out.len() + 1) as u8, "in order");
                    out.push((sent[out.len()], now));
                }
            }
        }
        assert_eq!(out.len(), sent.len(), "nothing stays behind");
        (out, lumps)
    }

    #[test]
    fn a_stream_comes_in_lumps_of_eight_packets_and_the_timer_never_runs_out() {
        let (bytes, lumps) = stream(16e-3, 451, 8.7e-3, 200);
        assert!(lumps[..lumps.len() - 1].iter().all(|n| *n == 496), "{lumps:?}");
        // The first byte of a transfer waits for 495 more, which may straddle two of the 4.2 ms between frames.
        // The last of all wait for the timer.
        let most = bytes[..bytes.len() - 496]
            .iter()
            .map(|(sent, seen)| seen - sent)
            .fold(0.0, f64::max);
        assert!((0.008..0.0136).contains(&most), "{most}");
    }

    #[test]
    fn a_short_timer_passes_on_each_frame_with_its_end() {
        for latency_s in [1e-3, 2e-3] {
            let (bytes, _) = stream(latency_s, 451, 8.7e-3, 100);
            for frame in bytes.chunks(451) {
                let (sent, seen) = frame[450];
                assert!(seen - sent <= latency_s + 1.1 * BYTE_S, "{}", seen - sent);
            }
        }
    }

    #[test]
    fn a_lone_answer_waits_for_the_timer_and_no_longer() {
        let (bytes, lumps) = stream(16e-3, 30, 0.1, 20);
        let waits: Vec<f64> = bytes.chunks(30).map(|c| c[29].1 - c[29].0).collect();
        assert!(waits.iter().all(|w| *w <= 16e-3 + BYTE_S), "{waits:?}");
        assert!(waits.iter().any(|w| *w > 4e-3), "{waits:?}");
        assert!(lumps.iter().all(|n| *n <= 30));
    }
}
