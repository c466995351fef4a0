//! Who the chip is.

#[path = "../../stm32f4/src/hexadecimal.rs"]
mod hexadecimal;

pub use hexadecimal::hexadecimal;

/// The chip's number, three words (RM0433 section 61.1).
const UNIQUE_ID: *const u32 = 0x1FF1_E800 as *const u32;

/// The chip's number in hexadecimal.
pub fn serial_number(out: &'static mut [u8; 24]) -> &'static str {
    for (word, digits) in (0..).zip(out.chunks_exact_mut(8)) {
        // SAFETY: `out` has room for three words, so `word` is 0 to 2. Every STM32H743 has three words of read-only memory
        // there.
        let value = unsafe { UNIQUE_ID.add(word).read_volatile() };
        hexadecimal(value, digits);
    }
    core::str::from_utf8(out).unwrap_or_default()
}
