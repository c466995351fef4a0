//! The program as a user starts it.

use std::process::Command;

/// What the program prints when it succeeds.
pub(crate) fn skin(arguments: &[&str]) -> String {
    let run = Command::new(env!("CARGO_BIN_EXE_skin"))
        .args(arguments)
        .output()
        .unwrap();
    assert!(
        run.status.success(),
        "{arguments:?}: {}",
        String::from_utf8_lossy(&run.stderr)
    );
    String::from_utf8(run.stdout).unwrap()
}
