//! Who the chip is.

#[path = "hexadecimal.rs"]
mod hexadecimal;

pub use hexadecimal::hexadecimal;

use crate::chip::UNIQUE_ID;

/// The chip's number in hexadecimal.
pub fn serial_number(out: &'static mut [u8; 24]) -> &'static str {
    for (word, digits) in (0..).zip(out.chunks_exact_mut(8)) {
        // SAFETY: `out` has room for three words, so `word` is 0 to 2. The chip has three words of read-only memory there.
        let value = unsafe { UNIQUE_ID.add(word).read_volatile() };
        hexadecimal(value, digits);
    }
    core::str::from_utf8(out).unwrap_or_default()
}
