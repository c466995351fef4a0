//! The memory map where the linker finds it, and the state of the source tree for the board's introduction.
use std::{env, error::Error, fs, path::PathBuf, process::Command};

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::copy("memory.x", out.join("memory.x"))?;
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed=memory.x");

    // Without git, or outside a clone, the state is unknown and stays empty.
    let git = Command::new("git").args(["describe", "--always", "--dirty"]).output();
    let state = git
        .ok()
        .filter(|o| o.status.success())
        .map(|o| o.stdout)
        .unwrap_or_default();
    println!("cargo:rustc-env=SKIN_GIT={}", String::from_utf8(state)?.trim());
    println!("cargo:rerun-if-changed=../../../.git/HEAD");
    Ok(())
}
