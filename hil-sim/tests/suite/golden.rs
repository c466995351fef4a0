//! Same seed, same bytes, on every machine: the first seconds of every scene of the library, byte for byte.
//!
//! What makes it hold: all that is computed is additions, multiplications, divisions and roots in a fixed order, and the
//! functions of the crate `libm`, which are made of those; the sheet is solved by `forward::Solver::portable`. After a change
//! that is meant to change bytes: `UPDATE_GOLDEN=1 cargo test -p skin-hil-sim --test suite golden`.

use crate::common::framed;
use hil_sim::{SceneFile, library};
use protocol::ToBoard;
use std::fmt::Write;
use std::path::Path;

/// What the board sends in the first seconds of a scene, told to start.
fn bytes(name: &str, seed: Option<u64>, most_s: f64) -> Vec<u8> {
    let mut scene = SceneFile::load(Path::new(name)).unwrap();
    if let Some(seed) = seed {
        scene.config.electronics.seed = seed;
    }
    let mut board = scene.board().unwrap();
    board.receive(&framed(&ToBoard::Start));
    board.run(scene.duration_s.min(most_s))
}

/// FNV-1a (Fowler, Noll, Vo), 64 bits.
fn hash(bytes: &[u8]) -> u64 {
    let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, step)
}

#[test]
fn every_scene_gives_the_bytes_it_gave() {
    let mut now = String::new();
    for name in library::names() {
        let bytes = bytes(name, None, 6.0);
        writeln!(now, "{name} {} bytes {:016x}", bytes.len(), hash(&bytes)).unwrap();
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden.txt");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, &now).unwrap();
    }
    let golden = std::fs::read_to_string(&path).unwrap();
    assert_eq!(now, golden.replace('\r', ""));
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let of = |seed| bytes("fast-tap", Some(seed), 2.2);
    let (once, again, other) = (of(5), of(5), of(6));
    assert!(once.len() > 10_000);
    assert_eq!(once, again);
    assert_ne!(once, other);
}
