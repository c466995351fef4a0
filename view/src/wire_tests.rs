//! Frames of the page, written and read back.

use std::sync::Arc;

use super::*;
use crate::SCALE_FLOOR;
use crate::picture::{Grid, Stats, circle_mm};

/// A disc with two touches, an odd number of cells, and a status line.
pub(crate) fn picture(sequence: u64) -> Picture {
    let outline = circle_mm(97.5, 90);
    let grid = Grid::cover(&outline, 5.0).unwrap();
    let values = (0..grid.len()).map(|k| 0.3 * (k % 7) as f32 / 6.0).collect();
    let touch = |id, x_mm, y_mm| Touch {
        id,
        x_mm,
        y_mm,
        rise: 0.25,
        area_mm2: 490.5,
        at_limit: x_mm < 0.0,
        ..Touch::default()
    };
    Picture {
        sequence,
        time_s: 12.5,
        grid: Arc::new(grid),
        outline_mm: Arc::new(outline),
        electrodes_mm: Arc::new(circle_mm(97.5, 16)),
        values,
        touches: vec![touch(Some(3), 12.5, -40.0), touch(None, -1.0, 2.0)],
        stats: Stats {
            frames_per_s: 115.0,
            solve_us: Some(420.0),
            residual: None,
            lost_frames: 5_000_000_000,
            skipped_frames: 7,
            source: "simulated skin".into(),
            baseline: None,
            faulty: vec![2],
            status: Some("taking the baseline, do not touch · 3 s".into()),
            away: None,
            preparing: false,
            uncalibrated: false,
            smoothed: true,
        },
    }
}

/// The frame of the first picture of a scene.
fn first(picture: &Picture) -> Vec<u8> {
    let mut shown = Shown::new(&picture.grid, SCALE_FLOOR);
    shown.take(picture, 1);
    encode(picture, &shown, 4, 99.5, 0)
}

#[test]
fn a_frame_comes_back_as_it_was() {
    let p = picture(u64::from(u32::MAX) + 9);
    let frame = decode(&first(&p)).unwrap();
    assert_eq!(
        (frame.scene, frame.sequence, frame.time_s, frame.published_ms),
        (4, p.sequence, 12.5, 99.5)
    );
    assert_eq!(
        (frame.frames_per_s, frame.solve_us, frame.residual),
        (115.0, Some(420.0), None)
    );
    assert_eq!((frame.lost_frames, frame.skipped_frames), (5_000_000_000, 7));
    assert_eq!((frame.number, frame.base, &frame.touches), (1, 0, &p.touches));
    assert_eq!((&frame.status, frame.smoothed), (&p.stats.status, true));
    let mut cells = Cells::new(p.values.len());
    cells.take(&frame).unwrap();
    let unit = frame.full / 510.0;
    for (step, value) in cells.steps().iter().zip(&p.values) {
        assert!(
            (f32::from(*step) * unit - value).abs() <= 0.5001 * unit,
            "{step} {value}"
        );
    }
    // It builds on nothing: whoever has seen it is not told again.
    assert_eq!(cells.take(&frame), None);
    assert_eq!(Cells::new(p.values.len() - 1).take(&frame), None);
}

#[test]
fn what_cannot_be_shown_becomes_nothing() {
    let mut p = picture(0);
    p.values.fill(f32::NAN);
    p.values[1..4].copy_from_slice(&[f32::INFINITY, -1.0, 0.5]);
    p.stats.status = Some("é".repeat(40_000));
    let frame = decode(&first(&p)).unwrap();
    assert_eq!(frame.runs.len(), 1);
    assert_eq!((frame.runs[0].0, frame.runs[0].1.len()), (3, 1));
    assert_eq!(frame.status.map(|s| s.len()), Some(65_534));
}

#[test]
fn damaged_frames_are_refused() {
    let bytes = first(&picture(1));
    for cut in 0..bytes.len() {
        assert_eq!(decode(&bytes[..cut]), None, "{cut}");
    }
    let mut other = bytes.clone();
    other[3] = b'1';
    assert_eq!(decode(&other), None);
    let mut many = bytes.clone();
    many[80..84].fill(0xff);
    assert_eq!(decode(&many), None);
    // A run longer than what follows.
    let mut long = bytes;
    long[93] = 0x7f;
    long[94] = 0x7f;
    assert_eq!(decode(&long), None);
}

#[test]
fn numbers_take_a_byte_for_every_seven_bits_and_come_back() {
    for (number, length) in [(0, 1), (127, 1), (128, 2), (16_383, 2), (16_384, 3), (0xfff_ffff, 4)] {
        let mut bytes = Vec::new();
        write(&mut bytes, number);
        assert_eq!((bytes.len(), Reader(&bytes).number()), (length, Some(number)));
    }
    assert_eq!(Reader(&[0xff; 5]).number(), None);
}

#[test]
fn requests_of_the_page_are_read() {
    let read = |text| serde_json::from_str::<Request>(text).ok();
    assert_eq!(read(r#"{"kind":"tare"}"#), Some(Request::Tare));
    assert_eq!(read(r#"{"kind":"undo_baseline"}"#), Some(Request::UndoBaseline));
    assert_eq!(
        read(r#"{"kind":"enter","key":"4f1c"}"#),
        Some(Request::Enter { key: "4f1c".into() })
    );
    assert_eq!(
        read(r#"{"kind":"clock","page_ms":3.5}"#),
        Some(Request::Clock { page_ms: 3.5 })
    );
    assert_eq!(read(r#"{"kind":"flash"}"#), None);
}
