//! Scenes as files: every one of the library is there, what is written is what happens, and mistakes are pointed at.

use hil_sim::{SceneFile, SceneFileError, Shape, library};
use protocol::PlanName;
use std::path::Path;

fn parse(text: &str) -> SceneFile {
    SceneFile::parse(text, None).unwrap()
}

/// Line, column and message of what is wrong with a text.
fn mistake(text: &str) -> (usize, usize, String) {
    match SceneFile::parse(text, None) {
        Err(SceneFileError::At(at)) => (at.line, at.column, at.message.clone()),
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_library_is_the_folder_and_every_scene_parses() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let mut files: Vec<String> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect();
    files.sort();
    let mut names: Vec<&str> = library::names().collect();
    names.sort_unstable();
    assert_eq!(files, names);
    for name in names {
        let scene = SceneFile::load(Path::new(name)).unwrap();
        assert_eq!(scene, SceneFile::load(&folder.join(format!("{name}.toml"))).unwrap());
        assert!(!scene.title.is_empty() && !scene.description.is_empty(), "{name}");
        // The baseline is taken before anything happens, but for what has rested there for ever; and all of it happens.
        let baseline = [0.0, 1.5].map(|t_s| scene.scene.truth(t_s));
        assert_eq!(baseline[0], baseline[1], "{name}");
        assert_eq!(!baseline[0].is_empty(), scene.scene.preloaded, "{name}");
        let touches = &scene.scene.touches;
        let seen: std::collections::BTreeSet<usize> = (0..(1000.0 * scene.duration_s) as usize)
            .flat_map(|k| scene.scene.truth(1e-3 * k as f64).into_iter().map(|t| t.id))
            .collect();
        assert_eq!(seen.len(), touches.len(), "{name}");
    }
}

#[test]
fn short_forms_are_the_keys_they_stand_for() {
    let scene = parse(
        r#"
duration_s = 20
[[touch]]
shape = "disc"
press = { at_s = 1.0, for_s = 2.0, ramp_s = 0.5, x_mm = 3, y_mm = 4, force_n = 10 }
[[touch]]
shape = "disc"
keys = [{ t_s = 1, x_mm = 3, y_mm = 4 }, { t_s = 1.5, force_n = 10 }, { t_s = 3.5 }, { t_s = 4, force_n = 0 }]
[[touch]]
shape = "finger"
slide = { at_s = 5, for_s = 2, from_mm = [0, 0], to_mm = [10, 20], force_n = 5, to_deg = 90 }
[[touch]]
shape = "pad"
aspect = 0.3
repeat = { at_s = 10, count = 3, press_s = 1, rest_s = 0.5, ramp_s = 0.25, x_mm = 0, y_mm = 0, force_n = 7 }
[[touch]]
shape = "finger"
press = { at_s = 19, x_mm = 0, y_mm = 0, force_n = 1 }
"#,
    );
    let touches = &scene.scene.touches;
    assert_eq!(touches[0], touches[1]);
    let sliding = touches[2].at(6.1).unwrap();
    assert!(
        (sliding.x_mm - 5.0).abs() < 1e-9 && (sliding.y_mm - 10.0).abs() < 1e-9,
        "{sliding:?}"
    );
    assert!((sliding.angle_deg - 45.0).abs() < 1e-9);
    assert_eq!(touches[3].shape, Shape::Pad { aspect: 0.3 });
    for at in [10.0, 12.0, 14.0] {
        assert!((touches[3].at(at + 0.6).unwrap().force_n - 7.0).abs() < 1e-9);
        assert!(touches[3].at(at + 1.75).is_none());
    }
    // What has no end is there for ever.
    assert_eq!(touches[4].at(1e9).unwrap().force_n, 1.0);
}

#[test]
fn a_hand_is_a_palm_and_five_fingers_that_keep_their_places() {
    let scene = parse(
        r#"
duration_s = 20
[[hand]]
keys = [{ t_s = 0, x_mm = 1, y_mm = -30, force_n = 50 }, { t_s = 10, x_mm = 5, angle_deg = 40 }]
"#,
    );
    for t in [0.0, 3.3, 7.7] {
        let now = scene.scene.truth(t);
        assert_eq!(now.len(), 6);
        let force: f64 = now.iter().map(|t| t.force_n).sum();
        assert!((force - 50.0).abs() < 1e-9, "{force}");
        // The middle finger from the palm: always as far, and turned as the hand is.
        let (x, y) = (now[3].x_mm - now[0].x_mm, now[3].y_mm - now[0].y_mm);
        assert!((x.hypot(y) / (36.0 * 2.55) - 1.0).abs() < 2e-3, "{t}: {x} {y}");
        let turned = y.atan2(x).to_degrees() - 90.0;
        assert!(
            (turned - now[0].angle_deg).abs() < 1.0,
            "{t}: {turned} {}",
            now[0].angle_deg
        );
    }
}

#[test]
fn everything_else_arrives() {
    let scene = parse(
        r#"
seed = 99
duration_s = 20
loop_s = 10
preloaded = true
[sheet]
resistivity_sd_percent = 5
correlation_mm = 25
contact_sd_percent = 10
ageing = { resistivity_percent_per_hour = -1, contact_percent_per_hour = 2, acceleration = 100 }
[material]
kind = "elastic"
exponent = 1.5
[electronics]
noise_codes = 0.1
[[electronics.interference]]
frequency_hz = 50
amplitude_v = 0.001
[board]
plan = "paper"
look_s = 0.01
[[stretch]]
keys = [{ t_s = 1, strain_percent = 2 }]
[[fault]]
at_s = 3
kind = "cable_pulled"
"#,
    );
    assert_eq!((scene.config.electronics.seed, scene.scene.variation.seed), (99, 99));
    assert_eq!(scene.config.electronics.noise_codes, 0.1);
    assert_eq!(scene.config.electronics.interference.len(), 1);
    assert_eq!(scene.config.plan, Some(protocol::Plan::paper()));
    assert_eq!(scene.config.look_samples, Some(589));
    assert_eq!(scene.config.faults.len(), 1);
    assert_eq!(scene.scene.loop_s, Some(10.0));
    assert!(scene.scene.preloaded && !scene.scene.material.creeps());
    assert_eq!(scene.scene.material.exponent, 1.5);
    assert_eq!(scene.scene.variation.correlation_mm, 25.0);
    assert_eq!(scene.scene.ageing.acceleration, 100.0);
    assert_eq!(scene.scene.stretch(0.0, 0.0, 5.0), 0.02);
}

#[test]
fn every_ready_made_plan_is_read() {
    let plan = |name: &str| {
        let scene = parse(&format!("duration_s = 5\n[board]\nplan = \"{name}\"\n"));
        scene.config.plan
    };
    for name in PlanName::ALL {
        assert_eq!(plan(name.name()), Some(name.plan(16).unwrap()), "{name}");
    }
    assert_eq!(plan("quiet").unwrap().integrate_periods, 6);
    assert_eq!(plan("adjacent"), None);
}

#[test]
fn a_mistake_is_pointed_at_with_what_is_allowed() {
    let touch = "duration_s = 5\n[[touch]]\nshape = \"disc\"\n";
    let cases: [(&str, (usize, usize), &[&str]); 17] = [
        (
            "duration_s = 5\ncolour = 3\n",
            (2, 1),
            &["colour", "duration_s", "material"],
        ),
        ("duration_s = -5\n", (1, 14), &["-5", "greater than 0"]),
        (
            "duration_s = 5\n[board]\nplan = \"slow\"\n",
            (3, 8),
            &["sequential-fast", "quiet", "adjacent"],
        ),
        ("duration_s = nan\n", (1, 14), &["NaN", "greater than 0"]),
        ("duration_s = \"long\"\n", (1, 14), &["string"]),
        ("title = \"x\"\n", (1, 1), &["duration_s"]),
        (
            "duration_s = 5\n[material]\nkind = \"steel\"\n",
            (3, 8),
            &["steel", "elastic", "viscoelastic"],
        ),
        (
            "duration_s = 5\n[material]\nexponent = 0.5\n",
            (3, 12),
            &["0.5", "1 or more"],
        ),
        (
            "duration_s = 5\n[electronics]\nnoise = 3\n",
            (3, 1),
            &["noise", "noise_codes"],
        ),
        (
            "duration_s = 5\n[electronics]\nadc_bits = 17\n",
            (2, 1),
            &["adc_bits", "between 1 and 16"],
        ),
        (
            "duration_s = 5\n[[fault]]\nat_s = 1\nkind = \"gone\"\n",
            (4, 8),
            &["gone", "cable_pulled"],
        ),
        (
            "duration_s = 5\n[[fault]]\nat_s = 1\nkind = { electrode_open = { electrode = 17 } }\n",
            (2, 1),
            &["17", "count from 1"],
        ),
        (
            "duration_s = 5\n[[stretch]]\nx_mm = 3\nkeys = [{ t_s = 1, strain_percent = 2 }]\n",
            (2, 1),
            &["radius_mm"],
        ),
        (
            "duration_s = 5\n[sheet]\nfile = \"none.toml\"\n",
            (3, 8),
            &["none.toml", "cannot be read"],
        ),
        ("duration_s = 5\n[[hand]]\n", (2, 1), &["exactly one of keys and press"]),
        ("duration_s = = 5\n", (1, 14), &[]),
        ("", (1, 1), &["duration_s"]),
    ];
    for (text, (line, column), words) in cases {
        let found = mistake(text);
        assert_eq!((found.0, found.1), (line, column), "{text}: {}", found.2);
        for word in words {
            assert!(found.2.contains(word), "{text}: {} does not say {word}", found.2);
        }
    }
    let touches: [(&str, (usize, usize), &[&str]); 6] = [
        ("", (2, 1), &["exactly one of keys, press, tap, slide and repeat"]),
        ("aspect = 0.5\n", (2, 1), &["only a pad"]),
        ("full_size_n = 5\n", (2, 1), &["full_size_n"]),
        (
            "keys = [{ t_s = 1 }, { t_s = 1 }]\n",
            (4, 22),
            &["t_s is 1", "go on in time"],
        ),
        ("keys = [{ t_s = 1, force_n = -2 }]\n", (4, 30), &["-2", "0 or more"]),
        ("press = { at_s = 1, x_mm = 0, y_mm = 0 }\n", (4, 9), &["force_n"]),
    ];
    for (rest, (line, column), words) in touches {
        let found = mistake(&format!("{touch}{rest}"));
        assert_eq!((found.0, found.1), (line, column), "{rest}: {}", found.2);
        for word in words {
            assert!(found.2.contains(word), "{rest}: {} does not say {word}", found.2);
        }
    }
}

#[test]
fn an_error_of_a_file_names_it_and_shows_the_line() {
    let folder = std::env::temp_dir().join(format!("skin-scene-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("wrong.toml");
    std::fs::write(&path, "duration_s = 5\n\n[sheet]\nfile = \"sheet.toml\"\n").unwrap();
    std::fs::write(
        folder.join("sheet.toml"),
        "sheet_resistance_ohm = 1000.0\noutline = 3\n",
    )
    .unwrap();
    let error = SceneFile::load(&path).unwrap_err().to_string();
    for word in [
        "wrong.toml",
        "line 4, column 8",
        "sheet.toml",
        "line 2",
        "file = \"sheet.toml\"",
    ] {
        assert!(error.contains(word), "{error}");
    }
    assert!(
        SceneFile::load(&folder.join("none.toml"))
            .unwrap_err()
            .to_string()
            .contains("none.toml")
    );
    std::fs::remove_dir_all(&folder).unwrap();
    let unknown = SceneFile::load(Path::new("no-such-scene")).unwrap_err().to_string();
    assert!(
        unknown.contains("no-such-scene") && unknown.contains("fast-tap"),
        "{unknown}"
    );
}

#[test]
fn a_scene_that_no_memory_holds_is_refused_with_its_place() {
    let turned = "duration_s = 5\n[[hand]]\nkeys = [{ t_s = 0, force_n = 5 }, { t_s = 1, angle_deg = 1e11 }]\n";
    let (line, _, message) = mistake(turned);
    assert!(line == 2 && message.contains("more than 100000"), "{line}: {message}");
    let (line, column, message) = mistake("duration_s = 1e300\n");
    assert!(
        (line, column) == (1, 14) && message.contains("1e12 at most"),
        "{message}"
    );
}
