//! Scenes that come with the simulator: the files of hil-sim/scenes.

const SCENES: [(&str, &str); 14] = [
    ("one-touch", include_str!("../scenes/one-touch.toml")),
    ("two-touches", include_str!("../scenes/two-touches.toml")),
    ("three-touches", include_str!("../scenes/three-touches.toml")),
    ("four-touches", include_str!("../scenes/four-touches.toml")),
    ("creep", include_str!("../scenes/creep.toml")),
    ("hand", include_str!("../scenes/hand.toml")),
    ("slow-press", include_str!("../scenes/slow-press.toml")),
    ("fast-tap", include_str!("../scenes/fast-tap.toml")),
    ("lost-electrode", include_str!("../scenes/lost-electrode.toml")),
    ("drifting-sheet", include_str!("../scenes/drifting-sheet.toml")),
    ("noisy-motor", include_str!("../scenes/noisy-motor.toml")),
    ("crossing", include_str!("../scenes/crossing.toml")),
    ("gestures", include_str!("../scenes/gestures.toml")),
    ("preload", include_str!("../scenes/preload.toml")),
];

/// The names of the library's scenes.
pub fn names() -> impl Iterator<Item = &'static str> {
    SCENES.iter().map(|(name, _)| *name)
}

/// The text of a scene of the library, as [`crate::SceneFile::parse`] takes it.
pub fn text(name: &str) -> Option<&'static str> {
    SCENES.iter().find(|(n, _)| *n == name).map(|(_, text)| *text)
}
