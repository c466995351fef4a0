//! Columns that may enter, the one with the largest gradient first.

use std::collections::BinaryHeap;

/// Candidates by the gradient that each had when it was last computed.
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
    /// Room for as many columns.
    pub(super) fn new(cells: usize) -> Self {
        Self {
            heap: BinaryHeap::with_capacity(cells),
        }
    }

    /// Takes the columns whose gradients are above a limit of 0 or more.
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

    /// The column whose gradient is largest, if that is above a limit, with the gradient as it is now.
    ///
    /// A gradient that was computed earlier stands for the present one until its column is the first: what enters takes from its
    /// neighbours, and hardly ever adds to one.
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
                // It sinks to where it belongs.
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
