//! Memory that a DMA channel reads or writes while the processor does something else.

use core::cell::UnsafeCell;

/// A buffer at a fixed address, for one DMA channel and one owner.
#[repr(C, align(4))]
pub struct Shared<T, const N: usize>(UnsafeCell<[T; N]>);

// SAFETY: there is one core, and each buffer is private to one module, which uses it in the main loop only. What the DMA channel
// does at the same time is the duty of `lend`'s caller; `write` changes an element as one piece.
unsafe impl<T: Send, const N: usize> Sync for Shared<T, N> {}

impl<T: Copy, const N: usize> Shared<T, N> {
    pub const fn new(value: T) -> Self {
        Self(UnsafeCell::new([value; N]))
    }

    /// What a DMA channel's memory address register takes.
    pub fn address(&self) -> u32 {
        self.0.get() as u32
    }

    /// A part that the DMA channel has finished with.
    ///
    /// # Safety
    /// The channel does not write to it while it is lent, or the caller finds out afterwards and throws away what it read.
    pub unsafe fn lend(&self, start: usize, len: usize) -> &[T] {
        core::sync::atomic::compiler_fence(core::sync::atomic::Ordering::Acquire);
        let start = start.min(N);
        let len = len.min(N - start);
        // SAFETY: `start` and `len` are limited to the array, which is initialised and lives for ever in a static. The caller answers
        // for the channel.
        unsafe { core::slice::from_raw_parts(self.0.get().cast::<T>().add(start), len) }
    }

    /// Writes one element; one that is not there is left out.
    pub fn write(&self, index: usize, value: T) {
        if index < N {
            // SAFETY: inside the array, by the test above. One store of at most four bytes, so that a channel reads the old or the new
            // element.
            unsafe { self.0.get().cast::<T>().add(index).write_volatile(value) };
        }
        core::sync::atomic::compiler_fence(core::sync::atomic::Ordering::Release);
    }
}
