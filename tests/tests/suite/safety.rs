//! What the compiler checks for us: no `unsafe` but on boards, where each has its argument, and sums that are checked in every
//! test.

use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn manifest(path: &Path) -> toml::Table {
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    text.parse().unwrap()
}

#[test]
fn no_crate_of_the_workspace_may_be_unsafe() {
    let workspace = manifest(&root().join("Cargo.toml"));
    let members = workspace["workspace"]["members"].as_array().unwrap();
    assert!(members.len() >= 12);
    for member in members {
        let folder = root().join(member.as_str().unwrap()).join("src");
        if member.as_str() == Some("python") {
            // The macros of pyo3 write unsafe code of their own, and allow it there; the crate itself has none.
            for file in std::fs::read_dir(&folder).unwrap() {
                let path = file.unwrap().path();
                let text = std::fs::read_to_string(&path).unwrap();
                assert!(!text.contains("unsafe"), "{}", path.display());
            }
            continue;
        }
        let files = ["lib.rs", "main.rs"].map(|name| folder.join(name));
        let whole = files.iter().find(|file| file.exists()).unwrap();
        let text = std::fs::read_to_string(whole).unwrap();
        assert!(
            text.contains("#![forbid(unsafe_code)]"),
            "{} does not forbid unsafe code",
            whole.display()
        );
    }
}

#[test]
fn every_unsafe_block_of_a_board_has_its_argument() {
    let mut seen = 0;
    for folder in std::fs::read_dir(root().join("boards")).unwrap() {
        let path = folder.unwrap().path().join("Cargo.toml");
        if !path.exists() {
            continue;
        }
        seen += 1;
        let manifest = manifest(&path);
        assert_eq!(
            manifest["lints"]["clippy"]["undocumented_unsafe_blocks"].as_str(),
            Some("deny"),
            "{}",
            path.display()
        );
    }
    assert!(seen >= 4);
    // Clippy sees blocks and impls; functions, foreign items and attributes have theirs as well.
    let mut arguments = 0;
    for file in rust_files(&root().join("boards")) {
        let text = std::fs::read_to_string(&file).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        for (k, line) in lines.iter().enumerate() {
            let code = line.split("//").next().unwrap_or("");
            if code
                .split(|c: char| !c.is_alphanumeric() && c != '_')
                .any(|word| word == "unsafe")
            {
                arguments += 1;
                let before = &lines[k.saturating_sub(6)..=k];
                let argued = before.iter().any(|l| l.contains("SAFETY") || l.contains("# Safety"));
                assert!(argued, "{}:{}: {line}", file.display(), k + 1);
            }
        }
    }
    assert!(arguments > 50);
}

/// All Rust files below a folder, but for what was built there.
fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut out = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() && path.file_name().is_some_and(|name| name != "target") {
            out.append(&mut rust_files(&path));
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            out.push(path);
        }
    }
    out
}

/// The tests are an optimised build with what a release leaves out: overflow checks and debug assertions.
#[test]
fn tests_run_optimised_with_checked_sums_and_assertions() {
    let profile = &manifest(&root().join("Cargo.toml"))["profile"]["dev"];
    assert!(profile["opt-level"].as_integer().unwrap() >= 2);
    let caught = |f: fn()| std::panic::catch_unwind(f).is_err();
    assert!(caught(|| debug_assert!(std::hint::black_box(false))));
    assert!(caught(|| {
        std::hint::black_box(std::hint::black_box(u32::MAX) + std::hint::black_box(1));
    }));
}
