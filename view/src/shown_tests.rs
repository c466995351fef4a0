//! Laws of what the pages show.

use proptest::prelude::*;

use super::*;
use crate::field::Field;
use crate::picture::{Stats, circle_mm};
use crate::wire::{Cells, decode, encode};

fn disc() -> Arc<Grid> {
    Arc::new(Grid::cover(&circle_mm(97.5, 90), 15.0).unwrap())
}

fn picture(grid: &Arc<Grid>, time_s: f64, values: Vec<f32>) -> Picture {
    Picture {
        sequence: 0,
        time_s,
        grid: Arc::clone(grid),
        outline_mm: Arc::new(circle_mm(97.5, 90)),
        electrodes_mm: Arc::default(),
        values,
        touches: Vec::new(),
        stats: Stats::default(),
    }
}

/// What may happen to the cells from one picture to the next.
#[derive(Clone, Debug)]
enum Change {
    Nothing,
    Noise(f32),
    Some(Vec<(prop::sample::Index, f32)>),
    Scaled(f32),
    Cleared,
}

fn change() -> impl Strategy<Value = Change> {
    let value = prop_oneof![4 => 0.0..0.4f32, 1 => Just(f32::NAN), 1 => -1.0..100.0f32, 1 => Just(f32::MAX)];
    prop_oneof![
        Just(Change::Nothing),
        (0.0..0.02f32).prop_map(Change::Noise),
        prop::collection::vec((any::<prop::sample::Index>(), value), 1..20).prop_map(Change::Some),
        (0.1..4.0f32).prop_map(Change::Scaled),
        Just(Change::Cleared),
    ]
}

fn applied(values: &mut [f32], change: &Change) {
    match change {
        Change::Nothing => {}
        Change::Noise(size) => {
            for (k, v) in values.iter_mut().enumerate() {
                *v += size * ((k * 7919 % 13) as f32 / 13.0 - 0.5);
            }
        }
        Change::Some(list) => list.iter().for_each(|(at, v)| *at.get_mut(values) = *v),
        Change::Scaled(by) => values.iter_mut().for_each(|v| *v *= by),
        Change::Cleared => values.fill(0.0),
    }
}

proptest! {
    /// However many pictures a viewer misses, what it puts together from the differences is the whole picture, the same as
    /// for one that has just come; it is told no more than the whole takes, and what is shown is within a step of the values.
    #[test]
    fn differences_put_together_are_the_whole(
        changes in prop::collection::vec((change(), 0.0..3.0f64, any::<[bool; 3]>()), 1..40)
    ) {
        let grid = disc();
        let mut values = vec![0.0; grid.len()];
        let mut shown = Shown::new(&grid, SCALE_FLOOR);
        let mut viewers = [const { None }; 3].map(|_: Option<()>| Cells::new(grid.len()));
        let mut time_s = 0.0;
        for (k, (change, wait_s, looks)) in changes.iter().enumerate() {
            applied(&mut values, change);
            time_s += wait_s;
            let picture = picture(&grid, time_s, values.clone());
            shown.take(&picture, k as u64 + 1);
            let mut fresh = Cells::new(grid.len());
            fresh.take(&decode(&encode(&picture, &shown, 1, 0.0, 0)).unwrap()).unwrap();
            prop_assert_eq!(fresh.steps(), shown.steps());
            for viewer in viewers.iter_mut().zip(looks).filter(|(_, looks)| **looks).map(|(v, _)| v) {
                let bytes = encode(&picture, &shown, 1, 0.0, viewer.number());
                prop_assert!(bytes.len() <= 92 + 6 + 3 * grid.len());
                viewer.take(&decode(&bytes).unwrap()).unwrap();
                prop_assert_eq!(viewer.steps(), shown.steps());
            }
            let unit = shown.full() / f32::from(STEPS);
            for (step, value) in shown.steps().iter().zip(&values) {
                let wanted = (usable(*value) / unit).min(f32::from(u16::MAX));
                prop_assert!((f32::from(*step) - wanted).abs() < 1.01, "{} {}", step, wanted);
            }
        }
    }

    /// Noise below the eye changes nothing.
    #[test]
    fn changes_below_a_step_are_none(values in prop::collection::vec(0.0..0.5f32, 137), noise in prop::collection::vec(-0.49..0.49f32, 137)) {
        let grid = disc();
        prop_assume!(values.len() >= grid.len());
        let values = &values[..grid.len()];
        let mut shown = Shown::new(&grid, SCALE_FLOOR);
        shown.take(&picture(&grid, 0.0, values.to_vec()), 1);
        let unit = shown.full() / f32::from(STEPS);
        let moved: Vec<f32> = values.iter().zip(&noise).map(|(v, n)| v + n * unit).collect();
        let before = shown.full();
        shown.take(&picture(&grid, 0.1, moved), 2);
        // Unless the peak was just below a notch.
        prop_assume!(shown.full() == before);
        prop_assert_eq!(shown.changes(1).count(), 0);
    }
}

#[test]
fn what_is_told_grows_with_what_changed() {
    let grid = disc();
    let mut values = vec![0.2; grid.len()];
    let mut shown = Shown::new(&grid, SCALE_FLOOR);
    shown.take(&picture(&grid, 0.0, values.clone()), 1);
    for (k, cells) in [0, 1, 5, 20].into_iter().enumerate() {
        values[..cells].iter_mut().for_each(|v| *v -= 0.01);
        shown.take(&picture(&grid, 0.0, values.clone()), k as u64 + 2);
        let told: usize = shown.changes(k as u64 + 1).map(|r| r.steps.len()).sum();
        assert_eq!(told, cells);
    }
}

#[test]
fn the_scale_holds_the_field_and_goes_down_only_after_a_while() {
    let grid = Arc::new(Grid::cover(&circle_mm(97.5, 90), 5.0).unwrap());
    let bump = |height: f64, x_mm: f64| -> Vec<f32> {
        let at = |c: [f64; 2]| (height * (-((c[0] - x_mm).powi(2) + c[1] * c[1]) / 150.0).exp()) as f32;
        grid.centres_mm().map(at).collect()
    };
    let mut shown = Shown::new(&grid, SCALE_FLOOR);
    let mut take = |time_s: f64, values: Vec<f32>, number: u64| {
        shown.take(&picture(&grid, time_s, values), number);
        shown.full()
    };
    assert_eq!(take(0.0, vec![0.03; grid.len()], 1), SCALE_FLOOR);
    let high = take(0.1, bump(0.4, 3.0), 2);
    // The whole field is below it, and it is no more than a notch and the cells' smoothing above.
    let field = Field::new(&grid, &bump(0.4, 3.0));
    let peak = (0..400)
        .map(|k| field.at(f64::from(k) * 0.05 - 7.0, 0.0))
        .fold(0.0, f32::max);
    assert!(high >= 0.99 * peak && high < 1.25 * peak, "{high} {peak}");
    // A bump that moves on, a little lower, changes nothing.
    for k in 0..300u32 {
        let values = bump(0.39, 0.1 * f64::from(k));
        assert_eq!(take(0.2 + 0.01 * f64::from(k), values, 3 + u64::from(k)), high);
    }
    assert_eq!(take(4.0, bump(0.1, 0.0), 400), high);
    assert_eq!(take(5.9, bump(0.1, 0.0), 401), high);
    let low = take(6.1, bump(0.1, 0.0), 402);
    assert!((0.25..0.3).contains(&(low / high)), "{low} {high}");
}
