//! `skin paper`: the source paper's experiments again, on the simulated skin or of a recorded run, as one report.

use crate::files::positions;
use crate::loaded;
use crate::progress::Progress;
use crate::recorded::SessionRecord;
use crate::recorded_frames::{Part, RecordedFrames};
use crate::usage::Usage;
use anyhow::{Context, Result, bail};
use clap::Args;
use std::collections::{HashMap, VecDeque};
use std::path::{Path, PathBuf};
use studies::paper::recorded::{self, Frame, Run};
use studies::paper::simulated_rig::SimulatedRig;
use studies::paper::{self, Options};

/// Arguments of `skin paper`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder for report.html and report.json; made if need be.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Of a recorded run: those of the paper's figures that need no known touches.
    #[arg(long, value_name = "RECORDING", conflicts_with_all = ["quick", "seed"])]
    from: Option<PathBuf>,
    /// Readings of a force gauge beside the recording: CSV with the columns t_s, from the recording's first frame on, and force_n.
    #[arg(long, value_name = "TABLE", requires = "from", conflicts_with_all = ["quick", "seed"])]
    gauge: Option<PathBuf>,
    #[command(flatten)]
    part: Part,
    /// A tenth of the frames and shorter presses: for a look.
    #[arg(long)]
    quick: bool,
    /// Source of all noise.
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
}

/// Runs the command.
///
/// # Errors
/// A sheet that cannot be modelled, a recording that cannot be read, a file that cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    if arguments.from.is_none() && arguments.part.is_asked() {
        let why = "--from-s, --to-s and --every are for a recording, which --from names";
        return Err(Usage(why.to_owned()).into());
    }
    // Minutes of work are not to end at a folder that cannot be made.
    std::fs::create_dir_all(&arguments.out).map_err(|cause| paper::PaperError::Write {
        file: arguments.out.display().to_string(),
        cause,
    })?;
    let files = match &arguments.from {
        Some(recording) => of_recording(arguments, recording)?,
        None => {
            let options = Options {
                quick: arguments.quick,
                seed: arguments.seed,
            };
            paper::run(&SimulatedRig::new()?, options, &|what| eprintln!("{what} ..."))?.write(&arguments.out)?
        }
    };
    for file in files {
        println!("{}", file.display());
    }
    Ok(())
}

/// Most numbers of all frames together, 1 GB.
const MOST: usize = 125_000_000;

fn of_recording(arguments: &Arguments, path: &Path) -> Result<[PathBuf; 2]> {
    let run = read(arguments, path)?;
    let mut shown: Option<(&str, Progress)> = None;
    let report = recorded::run(&run, &mut |what, done, whole| {
        if shown.as_ref().is_none_or(|(before, _)| *before != what) {
            shown = Some((what, Progress::new(what)));
        }
        if let Some((_, progress)) = &shown {
            progress.at(done, whole);
        }
    });
    let report = report.with_context(|| path.display().to_string())?;
    Ok(report.write(&arguments.out)?)
}

/// The run of a recording: its frames with the touches that were found then.
fn read(arguments: &Arguments, path: &Path) -> Result<Run> {
    let gauge = arguments.gauge.as_deref().map(positions::readings).transpose()?;
    let session = SessionRecord::read(path)?;
    let options = session.options()?;
    let mut recorded = RecordedFrames::open(path, &arguments.part)?;
    let pattern = recorded.pattern(&session.wires)?;
    let mut frames: Vec<Frame> = Vec::new();
    while let Some(frame) = recorded.next()? {
        let (sequence, values_v) = (frame.measured.sequence, frame.measured.values_v);
        if (frames.len() + 1) * values_v.len() > MOST {
            bail!(
                "{}: more than {MOST} values, too many to hold at once; take a part with --from-s and --to-s, or fewer with --every",
                path.display()
            );
        }
        frames.push(Frame {
            sequence,
            at_s: frame.at_s,
            values_v,
            touches: None,
        });
    }
    // Both are in the order of the board's numbers, which begin anew where it was reset.
    let mut places: HashMap<u32, VecDeque<usize>> = HashMap::new();
    for (place, frame) in frames.iter().enumerate() {
        places.entry(frame.sequence).or_default().push_back(place);
    }
    let mut unpressed = Vec::new();
    for sequence in recorded.baseline() {
        unpressed.extend(places.get(sequence).and_then(|list| list.front()));
    }
    let mut from = 0;
    for picture in loaded::pictures(path)? {
        let Some(list) = places.get_mut(&picture.sequence) else {
            continue;
        };
        while list.front().is_some_and(|place| *place < from) {
            list.pop_front();
        }
        if let Some(place) = list.pop_front() {
            from = place;
            frames[place].touches = Some(picture.touches);
        }
    }
    let calibrated = options.calibration.map(|c| c.solid.unit_rise_mpa);
    Ok(Run {
        source: format!(
            "{}: recording of {}, {} {}",
            path.display(),
            session.source,
            session.board.name,
            session.board.serial
        ),
        sheet: session.sheet()?,
        pattern,
        polarity: options.polarity,
        frames,
        unpressed,
        n_per_mm2: calibrated.or(options.uncalibrated_n_per_mm2),
        gauge,
        bytes_per_frame: recorded.bytes_per_frame(),
    })
}
