//! What a viewer of the live picture sees for a minute: every frame, from the board's front end to the touches.

use forward::Sheet;
use hil_sim::SceneFile;
use std::path::Path;
use studies::chain;

/// Touches come down, wander and go; no contact changes, and nothing else does. Some of the frames are measured while a touch comes
/// down, so that their first and last values do not fit each other.
#[test]
fn touches_that_come_and_go_are_touches_and_no_contacts() {
    let demo = SceneFile::demo(Sheet::paper());
    let fast_tap = SceneFile::load(Path::new("fast-tap")).unwrap();
    for (name, scene, seconds) in [("demo", demo, 25.0), ("fast-tap", fast_tap, 12.0)] {
        for seed in [61, 62] {
            let mut file = scene.clone();
            file.config.electronics.seed = seed;
            let seen = chain::watch(file, seconds, None).unwrap();
            assert!(seen.frames > 1000, "{name}: {seen:?}");
            assert_eq!(
                (seen.contacts, seen.no_touches),
                (vec![], [0, 0]),
                "{name}, seed {seed}"
            );
            if name != "demo" {
                // Dents stay where it was touched.
                continue;
            }
            let part = seen.right as f64 / seen.judged as f64;
            assert!(part >= 0.99, "{name}, seed {seed}: {part}");
            // Fingers of 14 to 23 N, whose radius no one frame tells well.
            let [least, half, largest] = [0.01, 0.5, 0.99].map(|q| studies::quantile(&seen.rises, q));
            assert!(
                least > 0.03 && (0.15..0.3).contains(&half) && largest < 0.5,
                "{least} {half} {largest}"
            );
            let most = studies::quantile(&seen.off_mm, 0.95);
            assert!(most < 0.8, "{name}, seed {seed}: {most} mm");
        }
    }
}
