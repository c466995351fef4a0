//! Puts the memory map where the linker looks for it, and gives the program the state of the source tree for its
//! introduction.
//!
//! The map has another name here: the linker would take a `memory.x` in the folder where it runs before any other.
use std::{env, error::Error, fs, path::Path, path::PathBuf, process::Command};

/// What the program is made of: a change of any of it makes the tree differ from its commit.
const SOURCES: [&str; 8] = [
    "src",
    "build.rs",
    "memory_map.x",
    "Cargo.toml",
    "Cargo.lock",
    "../../firmware/src",
    "../../firmware/Cargo.toml",
    "../../protocol",
];

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let mut map = fs::read_to_string("memory_map.x")?;
    if env::var_os("CARGO_FEATURE_LAWS").is_some() {
        // The laws' bench keeps whole periods on the stack, and no controller beside it.
        map = map.replace("STACK = 2304", "STACK = 6656");
    }
    if env::var_os("CARGO_FEATURE_DEFMT").is_some() {
        // The log's buffer of 1 KiB, and the formatting of a panic's whole text.
        map = map
            .replace("STACK = 2304", "STACK = 4096")
            .replace("8K - STACK", "12K - STACK");
        println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    }
    fs::write(out.join("memory.x"), map)?;
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rustc-env=SKIN_GIT={}", source_state());
    for source in SOURCES {
        println!("cargo:rerun-if-changed={source}");
    }
    // Whatever moves the commit: the branch that is checked out, and the branch itself, wherever git keeps it.
    let branch = git(&["symbolic-ref", "-q", "HEAD"]);
    for name in ["HEAD", "logs/HEAD", "packed-refs", branch.as_deref().unwrap_or("HEAD")] {
        if let Some(path) = git(&["rev-parse", "--git-path", name]).filter(|p| Path::new(p).exists()) {
            println!("cargo:rerun-if-changed={path}");
        }
    }
    Ok(())
}

/// The commit, with `-dirty` when the program's sources differ from it; empty without git or outside a clone.
fn source_state() -> String {
    let Some(commit) = git(&["describe", "--always"]) else {
        return String::new();
    };
    let status = ["status", "--porcelain", "--"].into_iter().chain(SOURCES);
    let clean = git(&status.collect::<Vec<_>>()).is_some_and(|changes| changes.is_empty());
    if clean { commit } else { format!("{commit}-dirty") }
}

/// What git says, without the end of the line.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let said = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| said.trim_end().to_owned())
}
