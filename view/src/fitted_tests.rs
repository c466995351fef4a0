//! Laws of pictures and their labels.

use super::*;
use crate::SCALE_FLOOR;
use crate::field::Field;
use crate::picture::{Picture, Stats, circle_mm};
use crate::shown::Shown;
use crate::surface::Surface;
use forward::{DiscTouch, Drive, Model, ModelOptions, Pattern, Sheet, Solver};
use inverse::pipeline::{Reconstructor, ReconstructorOptions};
use inverse::reference::{Reference, imager::Imager, noise::FrameNoise};
use inverse::solvers::Method;
use proptest::prelude::*;
use std::sync::Arc;

/// The greatest value of the smooth field within a radius of a place, mm.
fn peak(picture: &Picture, at: [f64; 2], radius_mm: f64) -> f64 {
    let field = Field::new(&picture.grid, &picture.values);
    let steps = || (-12..=12).map(|k| f64::from(k) / 12.0 * radius_mm);
    let near = steps().flat_map(|dx| steps().map(move |dy| [dx, dy]));
    let near = near.filter(|[dx, dy]| dx.hypot(*dy) <= radius_mm);
    near.map(|[dx, dy]| f64::from(field.at(at[0] + dx, at[1] + dy)))
        .fold(0.0, f64::max)
}

/// The pictures of simulated discs, each pressed alone from the same sheet, by a method; with the imager.
fn pictures(pressed: &[&[DiscTouch]], method: Method) -> Vec<Picture> {
    let (sheet, drive, pattern) = (Sheet::paper(), Drive::PAPER, Pattern::adjacent(16).unwrap());
    let all: Vec<DiscTouch> = pressed.concat();
    let model = Model::new(&sheet, &ModelOptions::for_touches(&all)).unwrap();
    let mut rubber = Solver::new(model.into()).unwrap();
    let baseline_v = drive.frame_v(rubber.electrode_matrix(), &pattern);
    let imager: Arc<Imager> = Imager::new(&sheet, drive, pattern.clone(), 5.0).unwrap().into();
    let surface = Surface::of(&imager).unwrap();
    let options = ReconstructorOptions::for_imager(&imager, method);
    let reference = Reference::new(imager, baseline_v, FrameNoise::Unknown).unwrap();
    let mut reconstructor = Reconstructor::new(reference, options);
    let picture = |touches: &&[DiscTouch]| {
        let frame_v = drive.frame_v(rubber.solve_touches(touches).unwrap(), &pattern);
        let result = reconstructor.frame(&frame_v).unwrap();
        surface.picture(result, 1, 0.0, Stats::default())
    };
    pressed.iter().map(picture).collect()
}

const WEAK: DiscTouch = DiscTouch {
    centre_mm: [-45.0, 15.0],
    radius_mm: 12.0,
    rise: 0.1,
};
const STRONG: DiscTouch = DiscTouch {
    centre_mm: [40.0, -20.0],
    radius_mm: 7.0,
    rise: 0.4,
};

#[test]
fn the_picture_of_simulated_touches_is_as_strong_as_their_labels() {
    let pictures = pictures(&[&[WEAK, STRONG], &[WEAK], &[STRONG]], Method::Nnls);
    for (picture, count) in pictures.iter().zip([2, 1, 1]) {
        assert_eq!(picture.touches.len(), count, "{:?}", picture.touches);
        assert!(!picture.stats.smoothed);
        let mut shown = Shown::new(&picture.grid, SCALE_FLOOR);
        shown.take(picture, 1);
        for touch in &picture.touches {
            let drawn = peak(picture, [touch.x_mm, touch.y_mm], 15.0);
            let label = touch.rise;
            assert!((drawn / label - 1.0).abs() < 0.03, "drawn {drawn}, label {label}");
            assert!(shown.full() >= label as f32, "the scale ends at {}", shown.full());
        }
    }
    let drawn = [WEAK, STRONG].map(|disc| peak(&pictures[0], disc.centre_mm, 15.0));
    assert!(
        drawn[1] > 2.0 * drawn[0],
        "the stronger one is drawn stronger: {drawn:?}"
    );
    // Far from both there is nothing.
    assert_eq!(peak(&pictures[0], [0.0, 60.0], 15.0), 0.0);
}

/// Without a fit there is only the smoothed picture. It says so, and its scale holds the labels nevertheless.
#[test]
fn a_picture_that_no_discs_explain_is_the_methods_own_and_says_so() {
    let picture = &pictures(&[&[STRONG]], Method::Tikhonov)[0];
    assert!(picture.stats.smoothed && !picture.touches.is_empty());
    let distinct = picture.values.iter().filter(|v| **v > 0.0).count();
    assert!(distinct > picture.grid.len() / 2, "{distinct} cells: not a disc's");
    let mut shown = Shown::new(&picture.grid, SCALE_FLOOR);
    shown.take(picture, 1);
    assert!(picture.touches.iter().all(|t| shown.full() >= t.rise.abs() as f32));
}

proptest! {
    /// Wherever it lies between the cells and however small it is: the middle has the rise, and nothing is above it.
    #[test]
    fn the_field_has_the_rise_in_the_middle_and_nothing_more(
        r in 0.0..80.0f64, angle in 0.0..6.3f64, area_mm2 in 0.0..2000.0f64, rise in -0.9..8.0f64,
    ) {
        let outline = circle_mm(97.5, 90);
        let grid = Grid::cover(&outline, 5.0).unwrap();
        let touch = Touch { x_mm: r * angle.cos(), y_mm: r * angle.sin(), rise, area_mm2, ..Touch::default() };
        let values = values(&grid, &[touch]);
        let field = Field::new(&grid, &values);
        let size = rise.abs();
        prop_assert!((f64::from(field.at(touch.x_mm, touch.y_mm)) - size).abs() <= 1e-3 * size);
        // The middle of a spot no larger than a cell may be a little beside its highest point.
        let highest = grid.centres_mm().map(|c| f64::from(field.at(c[0], c[1]))).fold(0.0, f64::max);
        prop_assert!(highest <= 1.03 * size, "{highest} of {size}");
    }
}

#[test]
fn a_touch_without_numbers_is_not_drawn() {
    let grid = Grid::cover(&circle_mm(97.5, 90), 5.0).unwrap();
    let touch = |x_mm, rise, area_mm2| Touch {
        x_mm,
        rise,
        area_mm2,
        ..Touch::default()
    };
    for touch in [
        touch(f64::NAN, 0.2, 100.0),
        touch(0.0, f64::INFINITY, 100.0),
        touch(0.0, 0.2, f64::INFINITY),
        touch(1e12, 0.2, 100.0),
    ] {
        assert!(values(&grid, &[touch]).iter().all(|v| *v == 0.0), "{touch:?}");
    }
}
