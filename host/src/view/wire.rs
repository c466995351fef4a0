//! The messages between the program and the live page.
//!
//! To the page: a *scene* (JSON text) whenever the sheet or the source changes, and a *frame* (binary) per picture. From
//! the page: one binary byte for every frame it has taken, and small JSON texts for the rest.
//!
//! A frame, little-endian:
//!
//! | at | type | what |
//! |---|---|---|
//! | 0 | 4 bytes | `SKN1` |
//! | 4 | u32 | number of the scene it belongs to |
//! | 8 | u64 | sequence |
//! | 16 | f64 | the board's time, s |
//! | 24 | f64 | when it was published, ms of the server's clock |
//! | 32 | f32 | frames per second |
//! | 36 | f32 | time of the solve, µs; not-a-number if not known |
//! | 40 | f32 | residual; not-a-number if not known |
//! | 44 | f32 | the value that 65535 stands for |
//! | 48 | u64 | lost frames |
//! | 56 | u32 | n, number of values |
//! | 60 | u16 | m, number of touches |
//! | 62 | u16 | s, bytes of the status line |
//! | 64 | n x u16 | values, then padding to a multiple of 4 |
//! | | m x 24 | touches: u32 id (4294967295 = none), f32 x and y in mm, f32 rise, f32 area in mm², f32 force in N or NaN |
//! | | s | status line, UTF-8 |

use serde::{Deserialize, Serialize};

use crate::picture::{Picture, Touch};

/// First bytes of a frame; the last one is the version of this format.
pub const MAGIC: [u8; 4] = *b"SKN2";

const HEADER: usize = 64;
const TOUCH: usize = 24;
const NO_ID: u32 = u32::MAX;

/// What stays the same from frame to frame, as the page is told.
#[derive(Debug, Serialize)]
pub struct Scene<'a> {
    /// Always "scene".
    pub kind: &'static str,
    /// Version of the frame format.
    pub version: u8,
    /// Number of the scene.
    pub scene: u32,
    /// Where the frames come from.
    pub source: &'a str,
    /// Least full scale of the colours, relative rise.
    pub floor: f32,
    /// Columns of the grid.
    pub columns: usize,
    /// Rows of the grid.
    pub rows: usize,
    /// Side of a cell, mm.
    pub cell_mm: f64,
    /// Left edge of the grid, mm.
    pub left_mm: f64,
    /// Lower edge of the grid, mm.
    pub bottom_mm: f64,
    /// Column + columns * row of every value.
    pub cells: Vec<usize>,
    /// The sheet's edge, mm.
    pub outline_mm: &'a [[f64; 2]],
    /// Centres of the electrodes, mm.
    pub electrodes_mm: &'a [[f64; 2]],
}

impl<'a> Scene<'a> {
    /// The scene of a picture.
    pub fn of(picture: &'a Picture, scene: u32, floor: f32) -> Self {
        let grid = &picture.grid;
        let index = |&(column, row): &(u16, u16)| usize::from(column) + grid.columns() * usize::from(row);
        Self {
            kind: "scene",
            version: MAGIC[3] - b'0',
            scene,
            source: &picture.stats.source,
            floor,
            columns: grid.columns(),
            rows: grid.rows(),
            cell_mm: grid.cell_mm(),
            left_mm: grid.left_mm(),
            bottom_mm: grid.bottom_mm(),
            cells: grid.cells().iter().map(index).collect(),
            outline_mm: &picture.outline_mm,
            electrodes_mm: &picture.electrodes_mm,
        }
    }
}

/// A text from the page.
#[derive(Debug, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Request {
    /// Take the baseline anew.
    Tare,
    /// What time is it? The page's own time comes back with the answer.
    Clock {
        /// The page's time, ms.
        page_ms: f64,
    },
}

/// The answer to [`Request::Clock`].
#[derive(Debug, Serialize)]
pub struct Clock {
    /// Always "clock".
    pub kind: &'static str,
    /// The page's time as it was asked, ms.
    pub page_ms: f64,
    /// The server's time, ms.
    pub server_ms: f64,
}

/// A frame as it is read back.
#[derive(Debug, PartialEq)]
pub struct Frame {
    /// Number of its scene.
    pub scene: u32,
    /// Number of the frame.
    pub sequence: u64,
    /// The board's time, s.
    pub time_s: f64,
    /// When it was published, ms of the server's clock.
    pub published_ms: f64,
    /// Frames per second.
    pub frames_per_s: f32,
    /// Time of the solve, µs.
    pub solve_us: Option<f32>,
    /// Residual, 0..1.
    pub residual: Option<f32>,
    /// Lost frames.
    pub lost_frames: u64,
    /// Relative rise per cell.
    pub values: Vec<f32>,
    /// Touches.
    pub touches: Vec<Touch>,
    /// Status line.
    pub status: Option<String>,
}

/// Writes the frame of a picture. Values are limited to the positive, quantised to 1/65535 of the greatest; values that
/// are not finite become 0. At most 65535 touches and bytes of status are kept.
pub fn encode(picture: &Picture, scene: u32, published_ms: f64) -> Vec<u8> {
    let stats = &picture.stats;
    let status = stats.status.as_deref().unwrap_or_default();
    let status = &status[..status.floor_char_boundary(usize::from(u16::MAX))];
    let touches = &picture.touches[..picture.touches.len().min(usize::from(u16::MAX))];
    let usable = |v: &f32| if v.is_finite() { v.max(0.0) } else { 0.0 };
    let full = picture.values.iter().map(usable).fold(0.0, f32::max);
    let full = if full > 0.0 { full } else { 1.0 };

    let mut out = Vec::with_capacity(HEADER + 2 * picture.values.len() + 2 + TOUCH * touches.len() + status.len());
    out.extend(MAGIC);
    out.extend(scene.to_le_bytes());
    out.extend(picture.sequence.to_le_bytes());
    out.extend(picture.time_s.to_le_bytes());
    out.extend(published_ms.to_le_bytes());
    out.extend(stats.frames_per_s.to_le_bytes());
    out.extend(stats.solve_us.unwrap_or(f32::NAN).to_le_bytes());
    out.extend(stats.residual.unwrap_or(f32::NAN).to_le_bytes());
    out.extend(full.to_le_bytes());
    out.extend(stats.lost_frames.to_le_bytes());
    out.extend((picture.values.len() as u32).to_le_bytes());
    out.extend((touches.len() as u16).to_le_bytes());
    out.extend((status.len() as u16).to_le_bytes());
    for value in &picture.values {
        let steps = (usable(value) / full * 65535.0).round() as u16;
        out.extend(steps.to_le_bytes());
    }
    out.resize(out.len().next_multiple_of(4), 0);
    for touch in touches {
        out.extend(touch.id.unwrap_or(NO_ID).to_le_bytes());
        let force = touch.force_n.unwrap_or(f64::NAN);
        for number in [touch.x_mm, touch.y_mm, touch.rise, touch.area_mm2, force] {
            out.extend((number as f32).to_le_bytes());
        }
    }
    out.extend(status.as_bytes());
    out
}

/// Reads a frame; none if the bytes are not one.
pub fn decode(bytes: &[u8]) -> Option<Frame> {
    let mut reader = Reader(bytes);
    if reader.take::<4>()? != MAGIC {
        return None;
    }
    let scene = reader.u32()?;
    let sequence = u64::from_le_bytes(reader.take()?);
    let time_s = f64::from_le_bytes(reader.take()?);
    let published_ms = f64::from_le_bytes(reader.take()?);
    let (frames_per_s, solve_us, residual, full) = (reader.f32()?, reader.f32()?, reader.f32()?, reader.f32()?);
    let lost_frames = u64::from_le_bytes(reader.take()?);
    let (n, m, s) = (
        reader.u32()? as usize,
        usize::from(reader.u16()?),
        usize::from(reader.u16()?),
    );
    // Checked before anything of that size is made.
    if reader.0.len() != (2 * n).next_multiple_of(4) + TOUCH * m + s {
        return None;
    }
    let value = |r: &mut Reader| Some(f32::from(r.u16()?) / 65535.0 * full);
    let values = (0..n).map(|_| value(&mut reader)).collect::<Option<Vec<_>>>()?;
    if n % 2 == 1 {
        reader.u16()?;
    }
    let touch = |r: &mut Reader| {
        let id = Some(r.u32()?).filter(|id| *id != NO_ID);
        let mut number = || r.f32().map(f64::from);
        Some(Touch {
            id,
            x_mm: number()?,
            y_mm: number()?,
            rise: number()?,
            area_mm2: number()?,
            force_n: number().map(|f| Some(f).filter(|f| !f.is_nan()))?,
            ..Touch::default()
        })
    };
    let touches = (0..m).map(|_| touch(&mut reader)).collect::<Option<Vec<_>>>()?;
    let status = std::str::from_utf8(reader.0).ok()?;
    let known = |v: f32| Some(v).filter(|v| !v.is_nan());
    Some(Frame {
        scene,
        sequence,
        time_s,
        published_ms,
        frames_per_s,
        solve_us: known(solve_us),
        residual: known(residual),
        lost_frames,
        values,
        touches,
        status: Some(status.to_owned()).filter(|s| !s.is_empty()),
    })
}

/// Bytes that have not been read yet.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    fn u16(&mut self) -> Option<u16> {
        self.take().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn f32(&mut self) -> Option<f32> {
        self.take().map(f32::from_le_bytes)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::sync::Arc;

    use super::*;
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
                source: "simulated skin".into(),
                status: Some("taking the baseline, do not touch · 3 s".into()),
            },
        }
    }

    #[test]
    fn a_frame_comes_back_as_it_was() {
        let mut p = picture(u64::from(u32::MAX) + 9);
        for keep in [p.values.len(), p.values.len() - 1, 1, 0] {
            p.values.truncate(keep);
            let frame = decode(&encode(&p, 4, 99.5)).unwrap();
            assert_eq!(
                (frame.scene, frame.sequence, frame.time_s, frame.published_ms),
                (4, p.sequence, 12.5, 99.5)
            );
            assert_eq!(
                (frame.frames_per_s, frame.solve_us, frame.residual),
                (115.0, Some(420.0), None)
            );
            assert_eq!((frame.lost_frames, &frame.touches), (5_000_000_000, &p.touches));
            assert_eq!(frame.status, p.stats.status);
            assert_eq!(frame.values.len(), keep);
            let error = frame
                .values
                .iter()
                .zip(&p.values)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f32::max);
            assert!(error <= 0.3 / 65535.0, "{error}");
        }
    }

    #[test]
    fn what_cannot_be_shown_becomes_nothing() {
        let mut p = picture(0);
        p.values = vec![f32::NAN, f32::INFINITY, -1.0, 0.5];
        assert_eq!(decode(&encode(&p, 0, 0.0)).unwrap().values, [0.0, 0.0, 0.0, 0.5]);
        p.values = vec![0.0; 3];
        p.stats.status = Some("é".repeat(40_000));
        let frame = decode(&encode(&p, 0, 0.0)).unwrap();
        assert_eq!(frame.values, [0.0; 3]);
        assert_eq!(frame.status.map(|s| s.len()), Some(65_534));
    }

    #[test]
    fn damaged_frames_are_refused() {
        let bytes = encode(&picture(1), 0, 0.0);
        for cut in 0..bytes.len() {
            assert_eq!(decode(&bytes[..cut]), None, "{cut}");
        }
        let mut other = bytes.clone();
        other[3] = b'1';
        assert_eq!(decode(&other), None);
        let mut many = bytes;
        many[56..60].fill(0xff);
        assert_eq!(decode(&many), None);
    }

    #[test]
    fn a_frame_is_small() {
        // 1,184 cells of 5 mm: two bytes each and little more.
        assert!(encode(&picture(1), 0, 0.0).len() < 2_600);
    }

    #[test]
    fn requests_of_the_page_are_read() {
        let read = |text| serde_json::from_str::<Request>(text).ok();
        assert_eq!(read(r#"{"kind":"tare"}"#), Some(Request::Tare));
        assert_eq!(
            read(r#"{"kind":"clock","page_ms":3.5}"#),
            Some(Request::Clock { page_ms: 3.5 })
        );
        assert_eq!(read(r#"{"kind":"flash"}"#), None);
    }
}
