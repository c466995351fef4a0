//! `skin dataset`: shards that can be made in parts, and again.

use crate::program::{output, said, text};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

const SCENES: &str = "
frames_per_sheet = 3
baseline_frames = 2
[touch]
count = [1, 1]
[[fault]]
kind = 'contact_raised'
chance = 0.5
ohm = 100
";

/// The shards of a folder.
fn shards(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if name.starts_with("shard-") {
            files.insert(name, std::fs::read(&path).unwrap());
        }
    }
    files
}

#[test]
fn a_dataset_is_made_in_parts_resumed_and_held_apart_from_others() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (scenes, whole, parts) = (at("scenes.toml"), at("whole"), at("parts"));
    std::fs::write(&scenes, SCENES).unwrap();
    let make = |out: &Path, more: &[&str]| {
        let arguments = ["dataset", "--scenes", text(&scenes), "--count", "7", "--out", text(out)];
        output(&[&arguments, more].concat())
    };
    let made = make(&whole, &[]);
    assert!(made.status.success(), "{}", said(&made));
    assert!(said(&made).contains("9 frames are made: whole shards of 3"));
    let all = shards(&whole);
    assert_eq!(
        all.keys().map(String::as_str).collect::<Vec<_>>(),
        ["shard-00000.parquet", "shard-00001.parquet", "shard-00002.parquet"]
    );
    assert!(
        all.values()
            .all(|bytes| bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"))
    );

    // In two parts, in the other order.
    for part in ["2/2", "1/2"] {
        assert!(make(&parts, &["--shard", part]).status.success());
    }
    assert_eq!(shards(&parts), all);

    // A run that was stopped: what is there stays, also if it is another's; what is not is made.
    std::fs::remove_file(whole.join("shard-00001.parquet")).unwrap();
    std::fs::write(whole.join("shard-00002.parquet"), b"finished").unwrap();
    let again = make(&whole, &[]);
    assert_eq!(
        String::from_utf8_lossy(&again.stdout).trim(),
        text(&whole.join("shard-00001.parquet"))
    );
    assert!(said(&again).contains("shard-00002.parquet: is there, and is left as it is"));
    let after = shards(&whole);
    assert_eq!(after["shard-00001.parquet"], all["shard-00001.parquet"]);
    assert_eq!(after["shard-00002.parquet"], b"finished");

    // The same numbers as arrays, beside them.
    assert!(make(&parts, &["--format", "npz", "--shard", "1/3"]).status.success());
    assert!(shards(&parts)["shard-00000.npz"].starts_with(b"PK"));

    std::fs::write(&scenes, SCENES.replace("100", "200")).unwrap();
    let other = make(&whole, &[]);
    assert_eq!(other.status.code(), Some(1));
    assert!(said(&other).contains("shards of another scenes.toml; name another folder with --out"));
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let scenes = folder.path().join("scenes.toml");
    let out = folder.path().join("out");
    let make = |text_of_file: &str, more: &[&str]| {
        std::fs::write(&scenes, text_of_file).unwrap();
        let arguments = [
            "dataset",
            "--scenes",
            text(&scenes),
            "--count",
            "1",
            "--out",
            text(&out),
        ];
        let made = output(&[&arguments, more].concat());
        (made.status.code(), said(&made))
    };
    for (file, words) in [
        ("[touch]\nrise = { near = 1 }", "log_uniform = [low, high]"),
        ("frames = 3", "unknown field `frames`"),
        ("[touch]\nradius_mm = 0", "touch.radius_mm: give numbers above 0"),
        ("[sheet]\nfile = 'none.toml'", "none.toml: cannot be read"),
    ] {
        let (code, said) = make(file, &[]);
        assert_eq!(code, Some(1), "{said}");
        assert!(said.contains("scenes.toml") || words.contains("none"), "{said}");
        assert!(said.contains(words), "{said}");
        assert!(!out.exists(), "{file}");
    }
    let (code, said) = make("", &["--shard", "0/2"]);
    assert_eq!(code, Some(2));
    assert!(said.contains("such as 3/8"), "{said}");
}

/// The disk is full in the middle of a shard: it is named, no part of it stays, and a run after that goes on.
#[test]
fn a_full_disk_leaves_whole_shards_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (scenes, out) = (folder.path().join("scenes.toml"), folder.path().join("out"));
    std::fs::write(&scenes, SCENES).unwrap();
    for format in ["parquet", "npz"] {
        let arguments = [
            "dataset",
            "--scenes",
            text(&scenes),
            "--count",
            "3",
            "--out",
            text(&out),
            "--format",
            format,
        ];
        // Enough for the copies of scenes and sheet.
        let limited = Command::new("sh")
            .args(["-c", "ulimit -f 8; trap '' XFSZ; exec \"$0\" \"$@\""])
            .arg(env!("CARGO_BIN_EXE_skin"))
            .args(arguments)
            .output()
            .unwrap();
        let told = said(&limited);
        let shard = out.join(format!("shard-00000.{format}"));
        let named = format!("{}: cannot be written: File too large", text(&shard));
        assert!(limited.status.code() == Some(1) && told.contains(&named), "{told}");
        assert!(limited.stdout.is_empty());
        let names = std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name());
        let mut names: Vec<_> = names.collect();
        names.sort();
        assert_eq!(names, ["scenes.toml", "sheet.toml"]);
        assert!(output(&arguments).status.success());
        std::fs::remove_file(shard).unwrap();
    }
}
