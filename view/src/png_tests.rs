//! What an image must show, at places known from geometry.

use std::sync::Arc;

use super::*;
use crate::labels;
use crate::picture::{PictureError, Stats, circle_mm};
use crate::sheet::{METAL, round_below, ticks, touch_label};
use inverse::touches::touch::Touch;

/// A disc of 195 mm with 16 electrodes, and one bump.
fn picture(x: f64, y: f64) -> Picture {
    let outline = circle_mm(97.5, 180);
    let grid = Grid::cover(&outline, 5.0).unwrap();
    let bump = |c: [f64; 2]| (0.2 * (-((c[0] - x).powi(2) + (c[1] - y).powi(2)) / 200.0).exp()) as f32;
    Picture {
        sequence: 7,
        time_s: 1.25,
        values: grid.centres_mm().map(bump).collect(),
        grid: Arc::new(grid),
        outline_mm: Arc::new(outline),
        electrodes_mm: Arc::new(circle_mm(97.5, 16)),
        touches: vec![Touch {
            id: Some(1),
            x_mm: x,
            y_mm: y,
            rise: 0.2,
            area_mm2: 490.0,
            ..Touch::default()
        }],
        stats: Stats {
            source: "simulated skin".into(),
            ..Stats::default()
        },
    }
}

fn brightness(canvas: &Canvas, [x, y]: [f32; 2]) -> u32 {
    canvas
        .pixel(x as u32, y as u32)
        .unwrap()
        .iter()
        .map(|&v| u32::from(v))
        .sum()
}

#[test]
fn a_bump_is_brightest_where_it_is() {
    let mut p = picture(40.0, 20.0);
    p.touches.clear();
    let canvas = render(&p, 900).unwrap();
    let layout = Layout::new(&p.outline_mm, 900).unwrap();
    let peak = layout.to_px([40.0, 20.0]);
    let inside = |x: f32, y: f32| {
        let [mx, my] = layout.to_mm([x, y]);
        mx.hypot(my) < 92.0
    };
    let all = (0..900u32).flat_map(|x| (0..layout.height).map(move |y| (x as f32 + 0.5, y as f32 + 0.5)));
    let brightest = all
        .filter(|&(x, y)| inside(x, y))
        .map(|(x, y)| (brightness(&canvas, [x, y]), x, y));
    let top = brightest.clone().map(|b| b.0).max().unwrap();
    // Many pixels share the last colour: their middle is the bump.
    let (mut n, mut sx, mut sy) = (0.0, 0.0, 0.0);
    for (_, x, y) in brightest.filter(|b| b.0 == top) {
        (n, sx, sy) = (n + 1.0, sx + x, sy + y);
    }
    let mm = f64::from((sx / n - peak[0]).hypot(sy / n - peak[1])) / layout.px_per_mm();
    assert!(mm < 0.5, "brightest {mm} mm away");
    // Its colour is the last of the map; the far side has the first.
    let at = |mm: [f64; 2]| layout.to_px(mm).map(|v| v as u32);
    let ([x, y], [fx, fy]) = (at([40.0, 20.0]), at([-60.0, -30.0]));
    assert_eq!(canvas.pixel(x, y), Some(Palette::Inferno.at(1.0)));
    assert_eq!(canvas.pixel(fx, fy), Some(Palette::Inferno.at(0.0)));
}

#[test]
fn outside_the_outline_nothing_of_the_field_is_seen() {
    let mut p = picture(0.0, 0.0);
    p.values.fill(0.3);
    p.touches.clear();
    p.electrodes_mm = Arc::new(Vec::new());
    let canvas = render(&p, 800).unwrap();
    let layout = Layout::new(&p.outline_mm, 800).unwrap();
    for (radius, colour) in [(95.5, Palette::Inferno.at(1.0)), (99.5, BACKGROUND)] {
        for point in circle_mm(radius, 77) {
            let [x, y] = layout.to_px(point).map(|v| v as u32);
            assert_eq!(canvas.pixel(x, y), Some(colour), "{point:?}");
        }
    }
}

#[test]
fn the_touch_is_ringed_and_labelled() {
    let p = picture(-30.0, -10.0);
    let canvas = render(&p, 1000).unwrap();
    let layout = Layout::new(&p.outline_mm, 1000).unwrap();
    let radius = labels::ring_radius_mm(&p.touches[0]);
    for k in 0..8 {
        let (s, c) = (0.3 + f64::from(k)).sin_cos();
        let on_ring = layout.to_px([-30.0 + radius * c, -10.0 + radius * s]);
        if c < 0.9 {
            assert!(brightness(&canvas, on_ring) > 600, "no ring at {k}");
        }
    }
    // The label is to the right of the ring, white on a dark ground.
    let [x, y] = layout.to_px([-30.0 + radius, -10.0]);
    let lit = (0..150).flat_map(|dx| (-8..8).map(move |dy| [x + 12.0 + dx as f32, y + dy as f32]));
    let white = lit.filter(|&q| brightness(&canvas, q) > 650).count();
    assert!(white > 150, "{white} white pixels where the label should be");
    assert_eq!(touch_label(&p.touches[0]), "1  \u{2212}30.0, \u{2212}10.0 mm  +20 %");
}

#[test]
fn electrode_numbers_stand_outside_the_rim() {
    let p = picture(0.0, 0.0);
    let canvas = render(&p, 1000).unwrap();
    let layout = Layout::new(&p.outline_mm, 1000).unwrap();
    for centre in circle_mm(97.5, 16) {
        let [x, y] = layout.to_px(centre).map(|v| v as u32);
        assert_eq!(canvas.pixel(x, y), Some(METAL));
        let [ox, oy] =
            layout.to_px(centre.map(|v| v * (1.0 + f64::from(1.3 * layout.text) / 97.5 / layout.px_per_mm())));
        let near = (-9..9).flat_map(|dx| (-9..9).map(move |dy| [ox + dx as f32, oy + dy as f32]));
        assert!(
            near.map(|q| brightness(&canvas, q)).max() > Some(300),
            "no number at {centre:?}"
        );
    }
}

#[test]
fn the_same_picture_gives_the_same_bytes() {
    let png = || {
        let mut bytes = Vec::new();
        render(&picture(12.0, 34.0), 640)
            .unwrap()
            .encode_png(&mut bytes)
            .unwrap();
        bytes
    };
    let bytes = png();
    assert_eq!(bytes, png());
    assert_eq!(&bytes[..4], b"\x89PNG");
}

#[test]
fn odd_sheets_and_sizes_are_drawn_or_refused() {
    let long = [[0.0, 0.0], [300.0, 0.0], [300.0, 20.0], [0.0, 20.0]];
    let tall = long.map(|p| [p[1], p[0]]);
    for outline in [long, tall] {
        let grid = Grid::cover(&outline, 5.0).unwrap();
        let mut p = picture(0.0, 0.0);
        (p.values, p.grid, p.outline_mm) = (vec![0.1; grid.len()], Arc::new(grid), Arc::new(outline.to_vec()));
        (p.electrodes_mm, p.touches) = (Arc::new(outline.to_vec()), Vec::new());
        render(&p, 500).unwrap();
    }
    let mut p = picture(0.0, 0.0);
    assert!(matches!(render(&p, 100), Err(ImageError::Size { .. })));
    p.values.pop();
    assert!(matches!(
        render(&p, 500),
        Err(ImageError::Picture(PictureError::Length { .. }))
    ));
}

#[test]
fn a_quiet_sheet_is_dark() {
    let mut p = picture(0.0, 0.0);
    p.touches.clear();
    p.values
        .iter_mut()
        .enumerate()
        .for_each(|(k, v)| *v = 0.004 * (k % 3) as f32);
    let canvas = render(&p, 500).unwrap();
    let layout = Layout::new(&p.outline_mm, 500).unwrap();
    assert!(brightness(&canvas, layout.to_px([0.0, 0.0])) < 90);
}

#[test]
fn ticks_are_round() {
    let near = |a: Vec<f64>, b: &[f64]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
    assert!(near(ticks(0.0, 0.23, 5), &[0.0, 0.05, 0.1, 0.15, 0.2]));
    assert!(near(ticks(-1.0, 1.0, 4), &[-1.0, -0.5, 0.0, 0.5, 1.0]));
    assert_eq!(
        [100.0, 56.9, 49.9, 1.0, 0.3].map(round_below),
        [100.0, 50.0, 20.0, 1.0, 0.2]
    );
    assert!(ticks(1.0, 1.0, 5).is_empty() && ticks(0.0, f64::NAN, 5).is_empty());
}
