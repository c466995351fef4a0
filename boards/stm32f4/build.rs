//! Puts the memory map where the linker looks for it, and gives the program the state of the source tree for its
//! introduction.
//!
//! The map has another name here: the linker would take a `memory.x` in the folder where it runs before any other.
mod source_state;

use std::{env, error::Error, fs, path::PathBuf};

/// What the program is made of: a change of any of it makes the tree differ from its commit.
const SOURCES: [&str; 9] = [
    "src",
    "build.rs",
    "source_state.rs",
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
    source_state::tell(&SOURCES);
    Ok(())
}
