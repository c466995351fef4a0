//! The scene that is shown when there is no board: one to four fingers.

use crate::board::SimConfig;
use crate::scene::Scene;
use crate::scene_file::SceneFile;
use crate::touch::Touch;
use forward::{Geometry, Sheet};

/// Radius of the paper's sheet, which the places are for, mm.
const PAPER_RADIUS_MM: f64 = 97.5;
/// Time that a finger takes to come down or to lift, s.
const RAMP_S: f64 = 0.25;

impl Scene {
    /// One to four fingers that come, move and go, for ever. Each round of 24 s begins with more than a second without any
    /// touch, so that the baseline can be taken. Fingers stay 45 mm from each other and 20 mm from the rim of the
    /// paper's sheet.
    pub fn demo() -> Self {
        // First one finger wanders, a second comes to it and leaves again.
        let wanderer = Touch::finger(
            &[
                (1.6, -30.0, 20.0),
                (2.6, -30.0, 20.0),
                (6.0, 40.0, 30.0),
                (9.0, 10.0, -40.0),
                (10.0, 10.0, -40.0),
            ],
            20.0,
            RAMP_S,
        );
        let visitor = Touch::finger(
            &[(4.5, -20.0, -45.0), (6.0, -30.0, -40.0), (8.5, -60.0, 10.0)],
            15.0,
            RAMP_S,
        );
        // Then one hand of four: down one after the other, a turn of 60 degrees, up one after the other.
        let hand = (0..4).map(|k| {
            let k = f64::from(k);
            let place = |degrees: f64| {
                let angle = (45.0 + 90.0 * k + degrees).to_radians();
                (58.0 * libm::cos(angle), 58.0 * libm::sin(angle))
            };
            let mut path = vec![(12.5 + 0.8 * k, place(0.0).0, place(0.0).1)];
            for step in 0..=12 {
                let (x, y) = place(5.0 * f64::from(step));
                path.push((16.0 + 0.3 * f64::from(step), x, y));
            }
            let (x, y) = place(60.0);
            path.push((20.0 + 0.8 * k, x, y));
            Touch::finger(&path, 14.0 + 3.0 * k, RAMP_S)
        });
        Self {
            touches: [wanderer, visitor].into_iter().chain(hand).collect(),
            loop_s: Some(24.0),
            ..Self::empty()
        }
    }
}

impl SceneFile {
    /// [`Scene::demo`] on a sheet, with the default board: one round. Its places are stretched as the sheet's bounding box is.
    pub fn demo(sheet: Sheet) -> Self {
        let mut scene = Scene::demo();
        // What is no sheet is refused where its rubber is made.
        if let Ok(geometry) = Geometry::new(&sheet) {
            let (low, high) = geometry.bounding_box();
            let stretched = |axis: usize, at_mm: f64| {
                let (middle, half) = (0.5 * (low[axis] + high[axis]), 0.5 * (high[axis] - low[axis]));
                middle + at_mm * (half / PAPER_RADIUS_MM)
            };
            for key in scene.touches.iter_mut().flat_map(|touch| &mut touch.keys) {
                (key.x_mm, key.y_mm) = (stretched(0, key.x_mm), stretched(1, key.y_mm));
            }
        }
        Self {
            title: "One to four fingers".to_owned(),
            description: "Fingers that come, move and go, for ever.".to_owned(),
            duration_s: scene.loop_s.unwrap_or_default(),
            sheet,
            scene,
            config: SimConfig::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::Outline;

    #[test]
    fn the_demo_keeps_its_distances_and_shows_one_to_four() {
        let scene = Scene::demo();
        let mut seen = [0; 5];
        for step in 0..2400 {
            let t = f64::from(step) * 0.01;
            let now = scene.truth(t);
            assert!(t > 1.2 || now.is_empty(), "{t}");
            seen[now.len()] += 1;
            for (k, a) in now.iter().enumerate() {
                assert!(a.x_mm.hypot(a.y_mm) <= PAPER_RADIUS_MM - 20.0, "{t} {a:?}");
                for b in &now[..k] {
                    let apart = (a.x_mm - b.x_mm).hypot(a.y_mm - b.y_mm);
                    assert!(apart >= 45.0, "{t}: {apart}");
                }
            }
        }
        // Each number for a second or more.
        assert!(seen.iter().all(|n| *n >= 100), "{seen:?}");
    }

    #[test]
    fn the_demo_stays_on_any_sheet_of_its_box() {
        assert_eq!(SceneFile::demo(Sheet::paper()).scene.touches, Scene::demo().touches);
        let strip = Sheet {
            outline: Outline::Rectangle {
                width_mm: 240.0,
                height_mm: 100.0,
                centre_mm: [500.0, -20.0],
            },
            ..Sheet::disc(195.0, 4, 10.0, 1.0, 1000.0)
        };
        let geometry = Geometry::new(&strip).unwrap();
        let scene = SceneFile::demo(strip).scene;
        for step in 0..2400 {
            for touch in scene.truth(f64::from(step) * 0.01) {
                assert!(geometry.is_clear([touch.x_mm, touch.y_mm], 9.0), "{touch:?}");
            }
        }
    }
}
