//! Texts of devices, made harmless.

/// A text that a terminal shows and does not obey: whatever is not a printable ASCII character, such as an escape sequence, becomes `?`.
pub(crate) fn printable(text: &str) -> String {
    text.chars()
        .map(|c| if c == ' ' || c.is_ascii_graphic() { c } else { '?' })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_of_a_device_is_obeyed() {
        assert_eq!(printable("skin-1 (A7/x)"), "skin-1 (A7/x)");
        let hostile = "a\u{1b}[2J\u{9b}31m\r\n\u{7}\u{202e}\0b";
        assert_eq!(printable(hostile), "a?[2J?31m?????b");
        assert!((0..=char::MAX as u32).filter_map(char::from_u32).all(|c| {
            let shown = printable(&c.to_string());
            shown.len() == 1 && !shown.contains(char::is_control)
        }));
    }
}
