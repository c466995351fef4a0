//! `skin info`: what is in a recording.

use crate::files::sheet_line::SheetLine;
use crate::json;
use crate::reading::Reading;
use crate::recorded::SessionRecord;
use crate::recording_file::in_words;
use crate::recover::{ended, lacks};
use crate::skin_file;
use anyhow::Result;
use clap::Args;
use protocol::{Decoder, FromBoard, Hello, MAX_FROM_BOARD_LEN};
use recording::Topic;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Arguments of `skin info`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The recording.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

/// Frames that are further apart are a gap, s of the host's time: so far a link that works never keeps them apart.
const GAP_S: f64 = 0.5;
/// Gaps that are listed; all are counted.
const MOST_LISTED: usize = 20;

/// A time without frames.
#[derive(Debug, Serialize)]
struct Gap {
    /// After the beginning, s.
    at_s: f64,
    length_s: f64,
}

/// What is in a recording.
#[derive(Debug, Serialize)]
pub(crate) struct Info {
    file: String,
    bytes: u64,
    /// "closed", ...
    ended: &'static str,
    damaged_chunks: usize,
    began_unix_s: f64,
    duration_s: f64,
    session: SessionRecord,
    sheet: String,
    pub(crate) frames: u64,
    frames_per_s: f64,
    /// By the board's numbers.
    lost_frames: u64,
    /// That were damaged on the way.
    damaged_messages: u64,
    /// Passed over for newer ones when pictures were made.
    skipped_frames: u64,
    resets: u64,
    gaps: u64,
    longest_gaps: Vec<Gap>,
    pictures: u64,
    pictures_with_touches: u64,
    touches: u64,
    doubted_pictures: u64,
    warnings: u64,
    /// The recorder was too slow for.
    lost_messages: u64,
    lost_bytes: u64,
    drift_ppm: Option<f64>,
    messages: BTreeMap<String, u64>,
}

#[derive(Default)]
struct Counts {
    first_ns: Option<u64>,
    last_ns: u64,
    last_frame_ns: Option<u64>,
    last_sequence: Option<u32>,
    hellos: u64,
    frames: u64,
    lost: u64,
    damaged: u64,
    resets: u64,
    gaps: u64,
    listed: Vec<Gap>,
    pictures: u64,
    touched: u64,
    touches: u64,
    newest_id: Option<u32>,
    doubted: u64,
    skipped: u64,
    warnings: u64,
    clock: ClockLine,
    messages: BTreeMap<String, u64>,
}

#[derive(Default, Deserialize)]
struct ClockLine {
    drift_ppm: Option<f64>,
    lost_messages: u64,
    lost_bytes: u64,
}

#[derive(Deserialize)]
struct TouchesLine {
    touches: Vec<IdLine>,
    skipped_frames: u64,
    doubt: Option<serde::de::IgnoredAny>,
}

#[derive(Deserialize)]
struct IdLine {
    id: Option<u32>,
}

#[derive(Deserialize)]
struct LogLine {
    level: u8,
}

impl Counts {
    fn board(&mut self, decoded: Option<FromBoard>, log_ns: u64, hello: &mut Option<Hello>) {
        match decoded {
            Some(FromBoard::Frame(frame)) => {
                self.frames += 1;
                if let Some(last) = self.last_sequence.replace(frame.sequence) {
                    let gap = frame.sequence.wrapping_sub(last).wrapping_sub(1);
                    if gap < u32::MAX / 2 {
                        self.lost += u64::from(gap);
                    } else {
                        self.resets += 1;
                    }
                }
                let last_ns = self.last_frame_ns.replace(log_ns);
                let length_s = last_ns.map_or(0.0, |last| 1e-9 * log_ns.saturating_sub(last) as f64);
                if length_s > GAP_S {
                    self.gaps += 1;
                    let began = last_ns
                        .unwrap_or(log_ns)
                        .saturating_sub(self.first_ns.unwrap_or(log_ns));
                    self.listed.push(Gap {
                        at_s: 1e-9 * began as f64,
                        length_s,
                    });
                    if self.listed.len() > MOST_LISTED {
                        self.listed.sort_by(|a, b| b.length_s.total_cmp(&a.length_s));
                        self.listed.truncate(MOST_LISTED);
                    }
                }
            }
            Some(FromBoard::Hello(said)) => {
                self.hellos += 1;
                hello.get_or_insert(said);
            }
            Some(_) => {}
            None => self.damaged += 1,
        }
    }

    fn json(&mut self, topic: Topic, data: &[u8]) {
        match topic {
            Topic::Touches => {
                let Ok(line) = serde_json::from_slice::<TouchesLine>(data) else {
                    return;
                };
                self.pictures += 1;
                self.touched += u64::from(!line.touches.is_empty());
                self.doubted += u64::from(line.doubt.is_some());
                self.skipped = line.skipped_frames;
                for id in line.touches.iter().filter_map(|t| t.id) {
                    // Numbers are given once, and rise.
                    if self.newest_id.is_none_or(|newest| id > newest) {
                        self.newest_id = Some(id);
                        self.touches += 1;
                    }
                }
            }
            Topic::Log => {
                let line = serde_json::from_slice::<LogLine>(data);
                self.warnings += u64::from(line.is_ok_and(|l| l.level >= 3));
            }
            Topic::Clock => {
                if let Ok(clock) = serde_json::from_slice(data) {
                    self.clock = clock;
                }
            }
            _ => {}
        }
    }
}

/// Reads a recording from end to end.
///
/// # Errors
/// It cannot be read.
pub(crate) fn of(path: &Path) -> Result<Info> {
    let session = SessionRecord::read(path)?;
    let mut reader = Reading::open(path)?;
    let mut decoder = Decoder::<MAX_FROM_BOARD_LEN>::new();
    let mut hello = None;
    let mut counts = Counts::default();
    let named = recording::split(path).1.is_some();
    while let Some(message) = reader.next()? {
        // What is another skin's is in the account of that.
        if named && message.topic.is_none() {
            continue;
        }
        counts.first_ns = Some(
            counts
                .first_ns
                .map_or(message.log_ns, |first| first.min(message.log_ns)),
        );
        counts.last_ns = counts.last_ns.max(message.log_ns);
        let name = message.topic.map_or("other", Topic::name);
        match counts.messages.get_mut(name) {
            Some(count) => *count += 1,
            None => {
                counts.messages.insert(name.to_owned(), 1);
            }
        }
        match message.topic {
            Some(Topic::Board) => {
                let mut decoded = None;
                decoder.push(message.data, |m: Result<FromBoard, _>| decoded = m.ok());
                counts.board(decoded, message.log_ns, &mut hello);
            }
            Some(topic) => counts.json(topic, message.data),
            None => {}
        }
    }
    let duration_s = counts
        .first_ns
        .map_or(0.0, |first| 1e-9 * counts.last_ns.saturating_sub(first) as f64);
    counts.listed.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    Ok(Info {
        file: path.display().to_string(),
        bytes: reader.bytes(),
        ended: reader.ended().map_or("", ended),
        damaged_chunks: reader.damaged(),
        began_unix_s: session.started_unix_s,
        duration_s,
        sheet: SheetLine::of(&session.sheet()?)?.to_string(),
        session,
        frames: counts.frames,
        frames_per_s: if duration_s > 0.0 {
            counts.frames as f64 / duration_s
        } else {
            0.0
        },
        lost_frames: counts.lost,
        damaged_messages: counts.damaged,
        skipped_frames: counts.skipped,
        resets: counts.resets,
        gaps: counts.gaps,
        longest_gaps: counts.listed,
        pictures: counts.pictures,
        pictures_with_touches: counts.touched,
        touches: counts.touches,
        doubted_pictures: counts.doubted,
        warnings: counts.warnings,
        lost_messages: counts.clock.lost_messages,
        lost_bytes: counts.clock.lost_bytes,
        drift_ppm: counts.clock.drift_ppm,
        messages: counts.messages,
    })
}

/// Runs the command.
///
/// # Errors
/// The file cannot be read.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let skins = skin_file::asked(&arguments.file)?;
    let infos: Vec<Info> = skins.iter().map(|(_, file)| of(file)).collect::<Result<_>>()?;
    let mut out = crate::say::stdout();
    for ((skin, _), info) in skins.iter().zip(&infos) {
        match (arguments.json, skin) {
            // A line for every skin; each says its name in its session.
            (true, _) => {
                out.write_all(&json::line(info)?)?;
            }
            (false, None) => write!(out, "{}", words(info)?)?,
            (false, Some(skin)) => writeln!(out, "skin        {skin}\n{}", words(info)?)?,
        }
    }
    Ok(())
}

fn words(info: &Info) -> Result<String> {
    let mut text = String::new();
    let (session, board) = (&info.session, &info.session.board);
    let damaged = lacks(None, info.damaged_chunks, 0).map_or_else(String::new, |lacks| format!("; {lacks}"));
    writeln!(
        text,
        "recording   {:.1} MB, {}{damaged}",
        info.bytes as f64 / 1e6,
        info.ended
    )?;
    writeln!(
        text,
        "began       {}, {:.1} s long, by {}",
        in_words(info.began_unix_s),
        info.duration_s,
        session.program
    )?;
    writeln!(
        text,
        "board       {}, serial {}, firmware {}, from {}",
        board.name, board.serial, board.firmware, session.source
    )?;
    writeln!(text, "sheet       {}", info.sheet)?;
    let calibrated = if session.calibration.is_some() {
        "with a calibration"
    } else {
        "without a calibration"
    };
    writeln!(
        text,
        "frames      {} of {} values, {:.1} a second; {} lost, {} damaged, {} passed over for newer ones",
        info.frames, session.values, info.frames_per_s, info.lost_frames, info.damaged_messages, info.skipped_frames
    )?;
    match info.drift_ppm {
        Some(ppm) => writeln!(
            text,
            "clock       the board's seconds are {ppm:+.1} ppm longer than the host's"
        )?,
        None => writeln!(text, "clock       too short to tell the board's drift")?,
    }
    writeln!(
        text,
        "pictures    {}, {} with touches, {} doubted; {} touches, {calibrated}",
        info.pictures, info.pictures_with_touches, info.doubted_pictures, info.touches
    )?;
    writeln!(
        text,
        "gaps        {} longer than {GAP_S} s, {} resets",
        info.gaps, info.resets
    )?;
    for gap in &info.longest_gaps {
        writeln!(text, "            {:.1} s at {:.1} s", gap.length_s, gap.at_s)?;
    }
    if info.lost_messages > 0 || info.lost_bytes > 0 {
        writeln!(
            text,
            "not kept    {} messages and {} bytes that the disk was too slow for",
            info.lost_messages, info.lost_bytes
        )?;
    }
    let topics: Vec<String> = info.messages.iter().map(|(name, n)| format!("{name} {n}")).collect();
    writeln!(text, "messages    {}; {} warnings", topics.join(", "), info.warnings)?;
    Ok(text)
}
