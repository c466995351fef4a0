//! The messages between the program and the live page.
//!
//! To the page: a *scene* (JSON text) whenever the sheet, its broken electrodes, the source, the baseline or the board's presence change;
//! a *recording*, a *guide* and, of a replay, its place (*replay*; JSON texts) whenever there is news of them; and a *frame* (binary) per picture. From
//! the page: one binary byte for every frame it has taken, and small JSON texts for the rest.
//!
//! A frame tells the cells that changed since the frame that this page was sent before; what is a change, [`Shown`] decides. A
//! page begins with cells that are all 0. Little-endian:
//!
//! | at | type | what |
//! |---|---|---|
//! | 0 | 4 bytes | `SKN5` |
//! | 4 | u32 | number of the scene it belongs to |
//! | 8 | u64 | sequence |
//! | 16 | f64 | the board's time, s |
//! | 24 | f64 | when it was published, ms of the server's clock |
//! | 32 | f32 | frames per second |
//! | 36 | f32 | time of the solve, µs; not-a-number if not known |
//! | 40 | f32 | residual; not-a-number if not known |
//! | 44 | f32 | the rise that 510 steps stand for: that of the last colour |
//! | 48 | u64 | lost frames |
//! | 56 | u64 | skipped frames |
//! | 64 | u64 | number of the picture |
//! | 72 | u64 | number of the picture that the cells build on: the page's last, 0 in the beginning |
//! | 80 | u32 | n, bytes of the cells |
//! | 84 | u16 | m, number of touches |
//! | 86 | u16 | s, bytes of the status line |
//! | 88 | u32 | 1 where the cells are those of the smoothed reconstruction, 0 of the fitted touches |
//! | 92 | n | runs of cells: how many to skip, how many follow, their steps; LEB128, low bits first |
//! | | m x 28 | touches: u32 id (4294967295 = none), f32 x and y in mm, f32 rise, f32 area in mm², f32 force in N or NaN, u32 1 where the rise is the model's limit |
//! | | s | status line, UTF-8 |

use serde::{Deserialize, Serialize};

use crate::picture::{BaselineNote, Picture};
use crate::shown::Shown;
use inverse::touches::touch::Touch;

/// First bytes of a frame; the last one is the version of this format.
pub const MAGIC: [u8; 4] = *b"SKN5";

const HEADER: usize = 92;
const TOUCH: usize = 28;
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
    /// The baseline in force; `null` before the first one.
    pub baseline: Option<&'a BaselineNote>,
    /// Why no newer picture comes, where the board is away; else `null`.
    pub away: Option<&'a str>,
    /// Whether the baseline is being taken, so that nothing can be looked for yet.
    pub preparing: bool,
    /// Whether forces are those of a typical rubber.
    pub uncalibrated: bool,
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
    /// Electrodes that are broken, from 0.
    pub faulty: &'a [usize],
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
            baseline: picture.stats.baseline.as_ref(),
            away: picture.stats.away.as_deref(),
            preparing: picture.stats.preparing,
            uncalibrated: picture.stats.uncalibrated,
            floor,
            columns: grid.columns(),
            rows: grid.rows(),
            cell_mm: grid.cell_mm(),
            left_mm: grid.left_mm(),
            bottom_mm: grid.bottom_mm(),
            cells: grid.cells().iter().map(index).collect(),
            outline_mm: &picture.outline_mm,
            electrodes_mm: &picture.electrodes_mm,
            faulty: &picture.stats.faulty,
        }
    }
}

/// A text from the page.
#[derive(Debug, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Request {
    /// May this page command? It shows what its address ends with.
    Enter {
        /// The token, or a ticket for it.
        key: String,
    },
    /// Take the baseline anew.
    Tare,
    /// Bring back the baseline before.
    UndoBaseline,
    /// Record from now on.
    StartRecording,
    /// Close the recording.
    StopRecording,
    /// Press the last mark once more.
    RepeatPress,
    /// Leave out the mark that is to be pressed.
    SkipPress,
    /// Show a recording from here on.
    Seek {
        /// Since its first step, ms.
        at_ms: u64,
    },
    /// Let the replay stand still.
    Pause,
    /// Let it go on.
    Play,
    /// What time is it? The page's own time comes back with the answer.
    Clock {
        /// The page's time, ms.
        page_ms: f64,
    },
}

/// The answer to [`Request::Enter`], and to a command of a page that may not command.
#[derive(Debug, Serialize)]
pub struct Rights<'a> {
    /// Always "rights".
    pub kind: &'static str,
    /// The token, for a page that may command.
    pub token: Option<&'a str>,
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
    /// Relative rise of the last colour.
    pub full: f32,
    /// Whether the cells are those of the reconstruction.
    pub smoothed: bool,
    /// Lost frames.
    pub lost_frames: u64,
    /// Skipped frames.
    pub skipped_frames: u64,
    /// Number of the picture.
    pub number: u64,
    /// Number of the picture it builds on.
    pub base: u64,
    /// Cells that changed: the first of a run, and the steps from there on.
    pub runs: Vec<(usize, Vec<u16>)>,
    /// Touches.
    pub touches: Vec<Touch>,
    /// Status line.
    pub status: Option<String>,
}

/// The cells as a viewer of frames has them.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    number: u64,
    steps: Vec<u16>,
}

impl Cells {
    /// Before the first frame of a scene with so many cells.
    pub fn new(cells: usize) -> Self {
        Self {
            number: 0,
            steps: vec![0; cells],
        }
    }

    /// Takes a frame; none, and nothing changed, if it builds on another picture or has cells that are not there.
    pub fn take(&mut self, frame: &Frame) -> Option<()> {
        let fits = |(start, steps): &(usize, Vec<u16>)| start + steps.len() <= self.steps.len();
        if frame.base != self.number || !frame.runs.iter().all(fits) {
            return None;
        }
        self.number = frame.number;
        for (start, steps) in &frame.runs {
            self.steps[*start..start + steps.len()].copy_from_slice(steps);
        }
        Some(())
    }

    /// Number of the picture they show.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Step of every cell.
    pub fn steps(&self) -> &[u16] {
        &self.steps
    }
}

/// Writes the frame of a picture for a viewer that has seen picture `base` of its scene last (0: none). `shown` has taken the
/// picture. At most 65535 touches and bytes of status are kept.
pub fn encode(picture: &Picture, shown: &Shown, scene: u32, published_ms: f64, base: u64) -> Vec<u8> {
    let stats = &picture.stats;
    let status = stats.status.as_deref().unwrap_or_default();
    let status = &status[..status.floor_char_boundary(usize::from(u16::MAX))];
    let touches = &picture.touches[..picture.touches.len().min(usize::from(u16::MAX))];
    let mut cells = Vec::new();
    let mut end = 0;
    for run in shown.changes(base) {
        write(&mut cells, run.start - end);
        write(&mut cells, run.steps.len());
        run.steps.iter().for_each(|s| write(&mut cells, usize::from(*s)));
        end = run.start + run.steps.len();
    }

    let mut out = Vec::with_capacity(HEADER + cells.len() + TOUCH * touches.len() + status.len());
    out.extend(MAGIC);
    out.extend(scene.to_le_bytes());
    out.extend(picture.sequence.to_le_bytes());
    out.extend(picture.time_s.to_le_bytes());
    out.extend(published_ms.to_le_bytes());
    out.extend(stats.frames_per_s.to_le_bytes());
    out.extend(stats.solve_us.unwrap_or(f32::NAN).to_le_bytes());
    out.extend(stats.residual.unwrap_or(f32::NAN).to_le_bytes());
    out.extend(shown.full().to_le_bytes());
    out.extend(stats.lost_frames.to_le_bytes());
    out.extend(stats.skipped_frames.to_le_bytes());
    out.extend(shown.number().to_le_bytes());
    out.extend(base.to_le_bytes());
    out.extend((cells.len() as u32).to_le_bytes());
    out.extend((touches.len() as u16).to_le_bytes());
    out.extend((status.len() as u16).to_le_bytes());
    out.extend(u32::from(stats.smoothed).to_le_bytes());
    out.extend(cells);
    for touch in touches {
        out.extend(touch.id.unwrap_or(NO_ID).to_le_bytes());
        let force = touch.force_n.unwrap_or(f64::NAN);
        for number in [touch.x_mm, touch.y_mm, touch.rise, touch.area_mm2, force] {
            out.extend((number as f32).to_le_bytes());
        }
        out.extend(u32::from(touch.at_limit).to_le_bytes());
    }
    out.extend(status.as_bytes());
    out
}

/// A number in groups of seven bits, the lowest first; every byte but the last has its highest bit set (LEB128).
fn write(out: &mut Vec<u8>, mut number: usize) {
    while number > 0x7f {
        out.push(number as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
}

/// Reads a frame; none if the bytes are not one.
pub fn decode(bytes: &[u8]) -> Option<Frame> {
    let mut reader = Reader(bytes);
    if reader.take::<4>()? != MAGIC {
        return None;
    }
    let scene = reader.u32()?;
    let sequence = reader.u64()?;
    let time_s = f64::from_le_bytes(reader.take()?);
    let published_ms = f64::from_le_bytes(reader.take()?);
    let (frames_per_s, solve_us, residual, full) = (reader.f32()?, reader.f32()?, reader.f32()?, reader.f32()?);
    let (lost_frames, skipped_frames) = (reader.u64()?, reader.u64()?);
    let (number, base) = (reader.u64()?, reader.u64()?);
    let (n, m, s) = (
        reader.u32()? as usize,
        usize::from(reader.u16()?),
        usize::from(reader.u16()?),
    );
    let smoothed = reader.u32()? != 0;
    // Checked before anything of that size is made.
    if reader.0.len() != n + TOUCH * m + s {
        return None;
    }
    let (cells, rest) = reader.0.split_at_checked(n)?;
    let runs = read_runs(Reader(cells))?;
    reader.0 = rest;
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
            at_limit: r.u32()? != 0,
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
        full,
        smoothed,
        lost_frames,
        skipped_frames,
        number,
        base,
        runs,
        touches,
        status: Some(status.to_owned()).filter(|s| !s.is_empty()),
    })
}

fn read_runs(mut cells: Reader) -> Option<Vec<(usize, Vec<u16>)>> {
    let (mut runs, mut at) = (Vec::new(), 0_usize);
    while !cells.0.is_empty() {
        at = at.checked_add(cells.number()?)?;
        let count = cells.number()?;
        // A step takes a byte at least: checked before anything of that size is made.
        if count > cells.0.len() {
            return None;
        }
        let step = |_| cells.number().and_then(|s| u16::try_from(s).ok());
        runs.push((at, (0..count).map(step).collect::<Option<Vec<_>>>()?));
        at += count;
    }
    Some(runs)
}

/// Bytes that have not been read yet.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    /// What [`write`] wrote, of at most 28 bits.
    fn number(&mut self) -> Option<usize> {
        let mut number = 0;
        for group in 0..4 {
            let [byte] = self.take()?;
            number |= usize::from(byte & 0x7f) << (7 * group);
            if byte < 0x80 {
                return Some(number);
            }
        }
        None
    }

    fn u16(&mut self) -> Option<u16> {
        self.take().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }

    fn f32(&mut self) -> Option<f32> {
        self.take().map(f32::from_le_bytes)
    }
}

#[cfg(test)]
#[path = "wire_tests.rs"]
pub(super) mod tests;
