//! Who may know whom: the layers of docs/architecture.md, held against the manifests.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Crates of the workspace, and those of them that each may name in its dependencies.
const MAY_KNOW: [(&str, &[&str]); 12] = [
    ("protocol", &[]),
    ("forward", &[]),
    ("firmware", &["protocol"]),
    ("firmware/parts", &["firmware"]),
    ("link", &["protocol"]),
    ("recording", &["protocol"]),
    ("inverse", &["forward"]),
    ("hil-sim", &["firmware", "forward", "protocol"]),
    ("view", &["inverse", "forward"]),
    (
        "studies",
        &["inverse", "view", "link", "forward", "protocol", "hil-sim"],
    ),
    (
        "host",
        &[
            "studies",
            "view",
            "inverse",
            "link",
            "recording",
            "hil-sim",
            "forward",
            "protocol",
        ],
    ),
    ("python", &["host", "inverse", "forward"]),
];
/// What each may name besides in its tests.
const MAY_KNOW_IN_TESTS: [(&str, &[&str]); 2] = [("link", &["hil-sim", "forward"]), ("firmware/parts", &["protocol"])];
/// Registry crates of `inverse`: no I/O, no pool of threads, no server.
const OF_INVERSE: [&str; 7] = [
    "arrayvec",
    "nalgebra",
    "pulp",
    "serde",
    "statrs",
    "thiserror",
    "tracing",
];

fn allowed(list: &[(&str, &[&str])], name: &str) -> BTreeSet<String> {
    let found = list.iter().find(|(n, _)| *n == name);
    found.map_or(BTreeSet::new(), |(_, known)| {
        known.iter().map(|k| (*k).to_owned()).collect()
    })
}

fn manifest(folder: &str) -> toml::Table {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("..")
        .join(folder)
        .join("Cargo.toml");
    std::fs::read_to_string(&path)
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()))
        .parse()
        .unwrap()
}

/// Names in a manifest's tables of this kind, also those for one target only.
fn named(manifest: &toml::Table, kind: &str) -> BTreeSet<String> {
    let of = |table: &toml::Table| -> Vec<String> {
        let list = table.get(kind).and_then(toml::Value::as_table);
        list.map_or(Vec::new(), |l| l.keys().cloned().collect())
    };
    let targets = manifest.get("target").and_then(toml::Value::as_table);
    let own = targets
        .into_iter()
        .flat_map(|t| t.values())
        .filter_map(toml::Value::as_table);
    of(manifest).into_iter().chain(own.flat_map(of)).collect()
}

#[test]
fn crates_know_only_those_below_them() {
    let workspace = manifest(".");
    let members = workspace["workspace"]["members"].as_array().unwrap();
    let members: BTreeSet<String> = members.iter().map(|m| m.as_str().unwrap().to_owned()).collect();
    let listed: BTreeSet<String> = MAY_KNOW.iter().map(|(n, _)| (*n).to_owned()).collect();
    let unknown: Vec<&String> = members
        .iter()
        .filter(|m| *m != "tests" && !listed.contains(*m))
        .collect();
    assert!(
        unknown.is_empty(),
        "{unknown:?}: say in docs/architecture.md and here who may know whom of new crates"
    );
    let mut forbidden: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for name in &listed {
        let manifest = manifest(name);
        let known = allowed(&MAY_KNOW, name);
        let in_tests = &allowed(&MAY_KNOW_IN_TESTS, name) | &known;
        for (kind, allowed) in [
            ("dependencies", &known),
            ("build-dependencies", &known),
            ("dev-dependencies", &in_tests),
        ] {
            for other in named(&manifest, kind).iter().filter(|d| listed.contains(*d)) {
                if !allowed.contains(other) {
                    forbidden
                        .entry(name.clone())
                        .or_default()
                        .push(format!("{other} ({kind})"));
                }
            }
        }
    }
    assert!(
        forbidden.is_empty(),
        "forbidden by docs/architecture.md, who may know whom: {forbidden:#?}"
    );
}

#[test]
fn the_reconstruction_needs_no_server_no_threads_and_no_files() {
    let inverse = named(&manifest("inverse"), "dependencies");
    let registry: Vec<&String> = inverse
        .iter()
        .filter(|d| *d != "forward" && !OF_INVERSE.contains(&d.as_str()))
        .collect();
    assert!(
        registry.is_empty(),
        "inverse depends on {registry:?}: what does I/O goes into link, view or host; give a reason in docs/dependencies.md \
         and name it here if it does none"
    );
}

/// The board crates stand outside of the workspace, and see the library only.
#[test]
fn boards_know_firmware_and_protocol_only() {
    let boards = Path::new(env!("CARGO_MANIFEST_DIR")).join("../boards");
    let mut seen = 0;
    for folder in std::fs::read_dir(boards).unwrap() {
        let folder = folder.unwrap().path();
        if !folder.join("Cargo.toml").exists() {
            continue;
        }
        seen += 1;
        let name = folder.file_name().unwrap().to_str().unwrap().to_owned();
        let ours = named(&manifest(&format!("boards/{name}")), "dependencies");
        for (crate_name, _) in MAY_KNOW.iter().filter(|(n, _)| ours.contains(*n)) {
            let emulator = name == "emulator" && ["hil-sim", "forward"].contains(crate_name);
            assert!(
                emulator || ["firmware", "protocol"].contains(crate_name),
                "boards/{name} may not know {crate_name}"
            );
        }
    }
    assert!(seen >= 3);
}
