//! The frames of a recording in volts, whether they were shown or not, and those of its baseline.

use crate::files::measurements::{Column, MeasurementTable};
use crate::files::sheet_line::SheetLine;
use crate::number;
use crate::reading::Reading;
use crate::recorded::{LiveRecord, SessionRecord};
use crate::recover::lacks;
use crate::sheet::rewired;
use ::forward::{Pattern, Sheet};
use anyhow::{Result, bail};
use clap::Args;
use link::MeasuredFrame;
use protocol::{Command, Decoder, FromBoard, Hello, MAX_FROM_BOARD_LEN, Plan};
use recording::{Playback, Speed, Topic};
use std::path::Path;

/// Which frames of a recording, on the command line.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct Part {
    /// Of a recording: frames from so many seconds after its first frame on.
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = number::allowed("a time in seconds, 0 or above", |s| s >= 0.0), hide_short_help = true)]
    from_s: Option<f64>,
    /// Of a recording: frames up to so many seconds after its first frame.
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = number::positive("a time in seconds above 0"), hide_short_help = true)]
    to_s: Option<f64>,
    /// Of a recording: every N-th frame.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), hide_short_help = true)]
    every: Option<u64>,
}

impl Part {
    /// Whether the command line asks for a part.
    pub(crate) fn is_asked(&self) -> bool {
        self.from_s.is_some() || self.to_s.is_some() || self.every.is_some()
    }

    fn takes(&self, number: u64, at_s: f64) -> bool {
        number.is_multiple_of(self.every.unwrap_or(1))
            && at_s >= self.from_s.unwrap_or(0.0)
            && at_s <= self.to_s.unwrap_or(f64::INFINITY)
    }
}

/// A frame of a recording.
pub(crate) struct RecordedFrame {
    pub(crate) measured: MeasuredFrame,
    /// When it was measured, ns since 1970 (UTC).
    pub(crate) unix_ns: u64,
    /// Time since the recording's first frame, s: the board's, and over a reset the host's.
    pub(crate) at_s: f64,
}

/// The frames of a recording.
pub(crate) struct RecordedFrames {
    reader: Reading,
    decoder: Decoder<MAX_FROM_BOARD_LEN>,
    hello: Hello,
    plan: Plan,
    started: bool,
    /// Board's time, ns of the host and time since the first frame of the frame before.
    before: Option<(f64, u64, f64)>,
    /// Frames so far, and bytes of the wire since the first of them was to come.
    count: u64,
    wire_bytes: u64,
    part: Part,
    /// Numbers of the frames of the baseline that was taken first, while it is read.
    baseline: Vec<u32>,
    /// Frames that it still wanted.
    left: Option<usize>,
    complete: bool,
}

impl RecordedFrames {
    /// Opens a recording.
    ///
    /// # Errors
    /// It cannot be read, or no board introduced itself in it.
    pub(crate) fn open(path: &Path, part: &Part) -> Result<Self> {
        let board = Playback::open(path, Speed::Unpaced)?;
        Ok(Self {
            reader: Reading::open(path)?,
            decoder: Decoder::new(),
            hello: board.hello().clone(),
            plan: board.plan().clone(),
            started: false,
            before: None,
            count: 0,
            wire_bytes: 0,
            part: part.clone(),
            baseline: Vec::new(),
            left: None,
            complete: false,
        })
    }

    /// What the values of a frame are, with the wires where they lead.
    ///
    /// # Errors
    /// A plan that makes no sense.
    pub(crate) fn pattern(&self, wires: &[usize]) -> Result<Pattern> {
        let pair = |p: protocol::Pair| [usize::from(p.plus), usize::from(p.minus)];
        let pairs = self.plan.measurements(self.hello.electrodes);
        let pairs = pairs.map(|(drive, sense)| [pair(drive), pair(sense)]);
        rewired(Pattern::from_pairs(self.hello.electrodes.into(), pairs)?, wires)
    }

    /// The next frame of the part that is asked for; none at the end.
    ///
    /// # Errors
    /// The file cannot be read.
    pub(crate) fn next(&mut self) -> Result<Option<RecordedFrame>> {
        while let Some(message) = self.reader.next()? {
            let (publish_ns, topic) = (message.publish_ns, message.topic);
            if topic == Some(Topic::Live) && !self.complete {
                match serde_json::from_slice(message.data) {
                    Ok(LiveRecord::Baseline { frame, left }) => {
                        self.baseline.push(frame);
                        // It begins anew where the sheet moved meanwhile.
                        if self.left.replace(left).is_some_and(|before| left > before) {
                            self.baseline.clear();
                        }
                        self.complete = left == 0;
                    }
                    // It was given up.
                    Ok(LiveRecord::Tare | LiveRecord::Resume { .. }) => {
                        self.baseline.clear();
                        self.left = None;
                    }
                    _ => {}
                }
            }
            if topic != Some(Topic::Board) {
                continue;
            }
            if self.started {
                self.wire_bytes += message.data.len() as u64;
            }
            let mut decoded = None;
            self.decoder
                .push(message.data, |m: Result<FromBoard, _>| decoded = m.ok());
            let frame = match decoded {
                Some(FromBoard::Ack(Command::Start)) => {
                    self.started = true;
                    continue;
                }
                Some(FromBoard::Frame(frame)) => frame,
                _ => continue,
            };
            let fits = frame.plan == self.plan.id && frame.values.len() == self.plan.value_count();
            // A recording may begin when the board was started already, and then has no answer to it.
            if !fits {
                continue;
            }
            self.started = true;
            let measured = MeasuredFrame::of(&self.hello, &self.plan, &frame);
            let at_s = self.before.map_or(0.0, |(time_s, ns, at_s)| {
                let step_s = measured.time_s - time_s;
                at_s + if step_s >= 0.0 {
                    step_s
                } else {
                    1e-9 * publish_ns.saturating_sub(ns) as f64
                }
            });
            self.before = Some((measured.time_s, publish_ns, at_s));
            let number = self.count;
            self.count += 1;
            if self.part.takes(number, at_s) {
                return Ok(Some(RecordedFrame {
                    measured,
                    unix_ns: publish_ns,
                    at_s,
                }));
            }
        }
        if let Some(lacks) = lacks(self.reader.ended(), self.reader.damaged(), self.reader.nameless()) {
            eprintln!("{}: {lacks}; what is there is read", self.reader.file());
        }
        Ok(None)
    }

    /// Bytes of the wire for every frame so far, with all that comes between frames; none before the first.
    pub(crate) fn bytes_per_frame(&self) -> Option<f64> {
        (self.count > 0).then(|| self.wire_bytes as f64 / self.count as f64)
    }

    /// Numbers of the frames that made the first baseline, once the frames were read.
    pub(crate) fn baseline(&self) -> &[u32] {
        if self.complete { &self.baseline } else { &[] }
    }
}

/// Frames that a table takes: 200 MB of 208 values.
const MOST_COLUMNS: usize = 120_000;

/// A recording as a table: its sheet, and the columns of its baseline.
pub(crate) struct RecordedTable {
    pub(crate) table: MeasurementTable,
    pub(crate) sheet: Sheet,
    pub(crate) session: SessionRecord,
    /// The first and the last column, where the part has all of them.
    pub(crate) baseline: Option<String>,
}

/// Reads a recording as a table. Its columns are named by the seconds since the first frame.
///
/// # Errors
/// It cannot be read, or is too long for a table.
pub(crate) fn table(path: &Path, part: &Part) -> Result<RecordedTable> {
    let session = SessionRecord::read(path)?;
    let sheet = session.sheet()?;
    let mut frames = RecordedFrames::open(path, part)?;
    let pattern = frames.pattern(&session.wires)?;
    let mut columns: Vec<Column> = Vec::new();
    let mut sequences = Vec::new();
    while let Some(frame) = frames.next()? {
        if columns.len() >= MOST_COLUMNS {
            bail!(
                "{}: more than {MOST_COLUMNS} frames, too many for a table; take a part with --from-s and --to-s, or fewer with --every",
                path.display()
            );
        }
        sequences.push(frame.measured.sequence);
        columns.push(Column {
            name: format!("t{:.4}", frame.at_s),
            values: frame.measured.values_v,
        });
    }
    if columns.is_empty() {
        bail!("{}: no frames in the part that is asked for", path.display());
    }
    // Two frames in a tenth of a millisecond are those before and after a reset.
    let mut seen = std::collections::HashSet::new();
    for (k, column) in columns.iter_mut().enumerate() {
        if !seen.insert(column.name.clone()) {
            column.name = format!("{}n{k}", column.name);
            seen.insert(column.name.clone());
        }
    }
    let of_baseline = frames.baseline();
    let place = |sequence: Option<&u32>| sequences.iter().position(|s| Some(s) == sequence);
    let ends = place(of_baseline.first()).zip(place(of_baseline.last()));
    let baseline = ends.map(|(first, last)| format!("{}-{}", columns[first].name, columns[last].name));
    let table = MeasurementTable {
        file: path.display().to_string(),
        measurements: pattern.measurements().to_vec(),
        electrodes: pattern.electrodes(),
        infinite: 0,
        columns,
        sheet: Some(SheetLine::of(&sheet)?),
        rows: Some(pattern.len()),
        drive: None,
        notes: Vec::new(),
    };
    Ok(RecordedTable {
        table,
        sheet,
        session,
        baseline,
    })
}
