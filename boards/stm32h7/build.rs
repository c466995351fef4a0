//! Puts the memory map where the linker looks for it, and gives the program the state of the source tree for its
//! introduction.
//!
//! The map has another name here: the linker would take a `memory.x` in the folder where it runs before any other.

#[path = "../stm32f4/source_state.rs"]
mod source_state;

use std::{env, error::Error, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy("memory_map.x", out.join("memory.x"))?;
    println!("cargo:rustc-link-search={}", out.display());
    if env::var_os("CARGO_FEATURE_DEFMT").is_some() {
        println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    }
    source_state::tell(&[
        "src",
        "build.rs",
        "memory_map.x",
        "Cargo.toml",
        "Cargo.lock",
        // The files that both boards share are there.
        "../stm32f4/src",
        "../stm32f4/source_state.rs",
        "../../firmware/src",
        "../../firmware/Cargo.toml",
        "../../protocol",
    ]);
    Ok(())
}
