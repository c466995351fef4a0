//! The state of the source tree, for a board's introduction. Part of the boards' build scripts.

use std::{path::Path, process::Command};

/// Gives the program the commit as `SKIN_GIT`, and makes cargo run the build script again when it or a source changes.
/// `sources` is what the program is made of: a change of any of it makes the tree differ from its commit.
pub fn tell(sources: &[&str]) {
    println!("cargo:rustc-env=SKIN_GIT={}", source_state(sources));
    for source in sources {
        println!("cargo:rerun-if-changed={source}");
    }
    // Whatever moves the commit: the branch that is checked out, and the branch itself, wherever git keeps it.
    let branch = git(&["symbolic-ref", "-q", "HEAD"]);
    for name in ["HEAD", "logs/HEAD", "packed-refs", branch.as_deref().unwrap_or("HEAD")] {
        if let Some(path) = git(&["rev-parse", "--git-path", name]).filter(|p| Path::new(p).exists()) {
            println!("cargo:rerun-if-changed={path}");
        }
    }
}

/// The commit, with `-dirty` when the program's sources differ from it; empty without git or outside a clone.
fn source_state(sources: &[&str]) -> String {
    let Some(commit) = git(&["describe", "--always"]) else {
        return String::new();
    };
    let status = ["status", "--porcelain", "--"].iter().chain(sources).copied();
    let clean = git(&status.collect::<Vec<_>>()).is_some_and(|changes| changes.is_empty());
    if clean { commit } else { format!("{commit}-dirty") }
}

/// What git says, without the end of the line.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let said = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| said.trim_end().to_owned())
}
