//! Numbers in hexadecimal.

/// Eight digits, the most significant first.
pub fn hexadecimal(value: u32, digits: &mut [u8]) {
    for (k, digit) in digits.iter_mut().rev().take(8).enumerate() {
        let nibble = (value >> (4 * k) & 15) as u8;
        *digit = if nibble < 10 { b'0' + nibble } else { b'a' + nibble - 10 };
    }
}
