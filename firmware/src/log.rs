//! What goes to a board's log, where it has one: never from what runs for every block of samples.

/// Logs at a level of `defmt`, or is nothing. In one line, so that tests/boards.sh can take it out and find the same image.
macro_rules! log {
    ($level:ident, $($text:tt)*) => {
        #[cfg(feature = "defmt")]
        defmt::$level!($($text)*);
    };
}
