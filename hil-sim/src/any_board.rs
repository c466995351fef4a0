//! A board whatever its sheet, and what its ports do with locks and bytes.

use crate::board::SimBoard;
use crate::sheet::SheetModel;
use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A board, whatever its sheet.
pub(crate) trait AnyBoard: Send {
    fn now(&self) -> u64;
    /// True time, s.
    fn now_s(&self) -> f64;
    /// When the scene began, s of true time; `None` while it is held.
    fn scene_began_s(&self) -> Option<f64>;
    fn begin_scene(&mut self);
    /// How often the cable was put back; `None` while it is pulled.
    fn plugged(&self) -> Option<u32>;
    fn is_idle(&mut self) -> bool;
    fn receive(&mut self, bytes: &[u8]);
    fn step(&mut self, out: &mut VecDeque<u8>);
}

impl<S: SheetModel> AnyBoard for SimBoard<S> {
    fn now(&self) -> u64 {
        SimBoard::now(self)
    }

    fn now_s(&self) -> f64 {
        SimBoard::now_s(self)
    }

    fn scene_began_s(&self) -> Option<f64> {
        SimBoard::scene_began_s(self)
    }

    fn begin_scene(&mut self) {
        SimBoard::begin_scene(self);
    }

    fn plugged(&self) -> Option<u32> {
        SimBoard::plugged(self)
    }

    fn is_idle(&mut self) -> bool {
        SimBoard::is_idle(self)
    }

    fn receive(&mut self, bytes: &[u8]) {
        SimBoard::receive(self, bytes);
    }

    fn step(&mut self, out: &mut VecDeque<u8>) {
        SimBoard::step(self, |byte| out.push_back(byte));
    }
}

/// A lock is only poisoned by a panic elsewhere, and bytes are bytes.
pub(crate) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Moves what fits from a queue to a buffer.
pub(crate) fn drain(queue: &mut VecDeque<u8>, buffer: &mut [u8]) -> usize {
    let n = queue.len().min(buffer.len());
    for (place, byte) in buffer.iter_mut().zip(queue.drain(..n)) {
        *place = byte;
    }
    n
}
