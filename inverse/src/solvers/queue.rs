//! A queue of the columns that may enter, the one with the largest gradient first.

use std::collections::BinaryHeap;

/// Columns by the gradient that each had when last computed.
#[derive(Clone, Debug)]
pub(super) struct Queue {
    heap: BinaryHeap<Candidate>,
}

/// A gradient above 0 and its column, ordered by the gradient: the bits of positive numbers are in the numbers' order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Candidate(u64);

impl Candidate {
    #[inline(always)]
    fn new(gradient: f32, j: usize) -> Self {
        Self(u64::from(gradient.to_bits()) << 32 | j as u64)
    }

    #[inline(always)]
    fn gradient(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    #[inline(always)]
    fn column(self) -> usize {
        (self.0 & u64::from(u32::MAX)) as usize
    }
}

impl Queue {
    /// An empty queue with room for as many columns.
    pub(super) fn new(cells: usize) -> Self {
        Self {
            heap: BinaryHeap::with_capacity(cells),
        }
    }

    /// Fills the queue with the columns whose gradients are above a limit of 0 or more.
    #[inline(always)]
    pub(super) fn fill(&mut self, gradients: &[f64], limit: f64) {
        let mut list = std::mem::take(&mut self.heap).into_vec();
        list.clear();
        let each = gradients.iter().enumerate();
        list.extend(
            each.filter(|(_, g)| **g > limit)
                .map(|(j, g)| Candidate::new(*g as f32, j)),
        );
        self.heap = BinaryHeap::from(list);
    }

    /// The column whose gradient is largest, with its present gradient, if that is above a limit.
    ///
    /// A gradient computed earlier stands for the present one until its column comes to the front: a column that enters
    /// takes from its neighbours, and hardly ever adds to one.
    #[inline(always)]
    pub(super) fn next(&mut self, limit: f64, now: impl Fn(usize) -> f64) -> Option<(usize, f64)> {
        while let Some(first) = self.heap.peek().copied() {
            let j = first.column();
            let gradient = now(j);
            if !(gradient > limit) {
                self.heap.pop();
                continue;
            }
            if (gradient as f32) < first.gradient() {
                // The column sinks to its place.
                let next = Candidate::new(gradient as f32, j);
                if let Some(mut top) = self.heap.peek_mut() {
                    *top = next;
                }
                if self.heap.peek() != Some(&next) {
                    continue;
                }
            }
            self.heap.pop();
            return Some((j, gradient));
        }
        None
    }
}
