//! The lines on this computer: the stored baseline, whether it keeps up, room for recordings.

use super::facts::{Facts, Measured, Origin};
use super::line::{Cause, Line};
use crate::baselines::{age, folder, words};
use crate::files::baseline_file::{self, BaselineFileError, Subject};
use anyhow::Result;
use forward::{DiscTouch, Solver};
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::reference::departure::{Departure, DriftOptions};
use inverse::reference::imager::Imager;
use link::ports::BAUD;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// All of them; baselines are stored in this folder, or in the usual one.
pub(crate) fn lines(facts: &Facts, state: Option<&Path>) -> Vec<Line> {
    vec![baseline(facts, state), processor(facts), disk(Path::new("."))]
}

/// Hours from which on an older baseline explains no more drift than it does already.
fn old_h(options: &DriftOptions) -> f64 {
    (options.most - options.restart) / options.per_hour
}

fn baseline(facts: &Facts, state: Option<&Path>) -> Line {
    let name = "baseline";
    if let Origin::Recording(_) = facts.origin {
        return Line::not_known(name, "what this computer has stored says nothing of a recording");
    }
    let hello = match &facts.hello {
        Ok(hello) => hello,
        Err(_) => return Line::not_known(name, "no board answered, and each has its own"),
    };
    let measured = match &facts.measured {
        Ok(measured) => measured,
        Err(why) => return Line::not_known(name, why),
    };
    let Some(folder) = folder(state, hello) else {
        return Line::not_known(
            name,
            "there is no folder for it: a simulated board has none without --state-dir",
        );
    };
    let subject = Subject::new(hello, &facts.sheet, &measured.plan);
    let anew = "start skin run once with nothing on the sheet";
    let stored = match baseline_file::read(&baseline_file::path(&folder, &subject), &subject) {
        Ok(stored) => stored,
        Err(BaselineFileError::Missing { .. }) => {
            return Line::look(name, "none of this board is stored", Cause::Software, anew);
        }
        Err(why) => return Line::look(name, why.to_string(), Cause::Software, anew),
    };
    let options = DriftOptions::default();
    let old = age(&stored);
    let age_h = old.as_secs_f64() / 3600.0;
    let departure = Departure::of(&measured.baseline, &stored.baseline, age_h, &options);
    let text = format!("{} old", words(old));
    let line = match &departure {
        Some(d) if d.differs => Line::look(
            name,
            format!(
                "{text}; the sheet differs by {:.2} %, drift explains {:.2} %",
                100.0 * d.change,
                100.0 * d.expected
            ),
            Cause::Wiring,
            "lift what rests on the sheet, or take a new one: skin run --baseline replace",
        ),
        _ if age_h > old_h(&options) => Line::look(name, format!("{text}: it may have drifted"), Cause::Software, anew),
        Some(d) => Line::ok(name, format!("{text}, the sheet differs by {:.2} %", 100.0 * d.change)),
        None => Line::look(
            name,
            format!("{text}, with too few values to compare"),
            Cause::Software,
            anew,
        ),
    };
    let line = line.figure("baseline_age_s", old.as_secs_f64());
    match departure {
        Some(d) => line.figure("baseline_change", d.change),
        None => line,
    }
}

/// Frames that are timed.
const TIMED: usize = 15;
/// Part of a frame's time that making its picture may take, so that the rest of the program keeps up, too.
const BUSY: f64 = 0.7;

fn processor(facts: &Facts) -> Line {
    let name = "processor";
    let measured = match &facts.measured {
        Ok(measured) => measured,
        Err(why) => return Line::not_known(name, why),
    };
    let imager = match &measured.imager {
        Ok(imager) => imager,
        Err(why) => return Line::not_known(name, why),
    };
    let taken_s = match picture_s(imager, measured) {
        Ok(Some(taken_s)) => taken_s,
        Ok(None) => return Line::not_known(name, "the baseline gives no picture"),
        Err(why) => return Line::not_known(name, format!("no picture could be made: {why:#}")),
    };
    let part = taken_s / measured.frame_s;
    let text = format!(
        "{:.1} ms for a picture with two touches, a frame takes {:.1} ms{}",
        1e3 * taken_s,
        1e3 * measured.frame_s,
        load()
    );
    let line = if part <= BUSY {
        Line::ok(name, text)
    } else {
        Line::look(
            name,
            format!("{text}: frames will be passed over"),
            Cause::Software,
            "end other programs, or take a slower plan: touches stay right, but there are fewer pictures a second",
        )
    };
    line.figure("picture_ms", 1e3 * taken_s)
        .figure("frame_ms", 1e3 * measured.frame_s)
}

/// How busy the machine is, where it says so.
fn load() -> String {
    let load = std::fs::read_to_string("/proc/loadavg").ok();
    let load = load.and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    load.map_or(String::new(), |load| {
        format!("; load {load:.1} on {processors} processors")
    })
}

/// Median time of a frame with two touches that change through the live chain, s. None where the baseline gives no picture of them.
fn picture_s(imager: &Arc<Imager>, measured: &Measured) -> Result<Option<f64>> {
    let baseline = &measured.baseline;
    if !baseline.values_v.iter().any(|v| v.is_finite() && *v != 0.0) {
        return Ok(None);
    }
    let mut live = Live::new(Arc::clone(imager), LiveOptions::default());
    live.resume(baseline.clone())?;
    let mut solver = Solver::new(imager.model.clone())?;
    let reach = imager.reach_mm();
    let touch = |x: f64, rise: f64| DiscTouch {
        centre_mm: [x * reach, 0.1 * reach],
        radius_mm: 0.12 * reach,
        rise,
    };
    let mut factors = Vec::new();
    for rise in [0.2, 0.3] {
        let touched = solver
            .solve_touches(&[touch(-0.4, rise), touch(0.4, 0.5 - rise)])?
            .clone();
        let untouched = solver.solve_untouched_there()?;
        let frames = [&touched, untouched].map(|matrix| imager.drive.frame_v(matrix, &imager.pattern));
        let ratio: Vec<f64> = frames[0].iter().zip(&frames[1]).map(|(a, b)| a / b).collect();
        factors.push(ratio);
    }
    let mut times = Vec::new();
    for (k, ratio) in factors.iter().cycle().take(TIMED).enumerate() {
        let values: Vec<f64> = baseline.values_v.iter().zip(ratio).map(|(b, r)| b * r).collect();
        let began = Instant::now();
        let made = live.frame(measured.frame_s * (k as f64 + 1.0), &values)?;
        let taken_s = began.elapsed().as_secs_f64();
        if matches!(made, LiveFrame::Picture(result) if result.anew && result.changed) {
            times.push(taken_s);
        }
    }
    times.sort_by(f64::total_cmp);
    Ok(times.get(times.len() / 2).copied())
}

/// Bytes a second of the board's line, start and stop bit off: no recording of it grows faster by much.
const LINE_BYTES_PER_S: f64 = BAUD as f64 / 10.0;
/// Room for so many hours is enough.
const ENOUGH_H: f64 = 1.0;
/// And with room for so many no recording should be begun.
const TOO_LITTLE_H: f64 = 1.0 / 60.0;

fn disk(folder: &Path) -> Line {
    match room(folder) {
        Ok(bytes) => of_room(bytes),
        Err(why) => Line::not_known("disk", why),
    }
}

/// The line of a disk with so much room.
fn of_room(bytes: u64) -> Line {
    let name = "disk";
    let hours = bytes as f64 / LINE_BYTES_PER_S / 3600.0;
    let text = format!(
        "{:.1} GB free here: recordings of {hours:.1} h at the line's full rate",
        1e-9 * bytes as f64
    );
    let advice = "remove what is not needed, or record into another folder";
    let line = if hours < TOO_LITTLE_H {
        Line::bad(name, text, Cause::Hardware, advice)
    } else if hours < ENOUGH_H {
        Line::look(name, text, Cause::Hardware, advice)
    } else {
        Line::ok(name, text)
    };
    line.figure("free_bytes", bytes as f64)
}

/// Bytes that a user may still write.
#[cfg(unix)]
fn room(folder: &Path) -> Result<u64, String> {
    let disk = rustix::fs::statvfs(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
}

/// Bytes that a user may still write.
#[cfg(not(unix))]
fn room(_: &Path) -> Result<u64, String> {
    Err("this system is not asked for it".to_owned())
}

#[cfg(test)]
mod tests {
    use super::super::line::Light;
    use super::*;

    #[test]
    fn room_for_an_hour_is_enough_and_for_a_minute_too_little() {
        let hour = 3600 * u64::from(BAUD / 10);
        for (bytes, light) in [
            (hour, Light::Ok),
            (hour - 1, Light::Look),
            (hour / 60, Light::Look),
            (hour / 60 - 1, Light::Bad),
            (0, Light::Bad),
        ] {
            assert_eq!(of_room(bytes).light, light, "{bytes}");
        }
    }

    /// What the system says agrees with what `df` prints.
    #[cfg(unix)]
    #[test]
    fn the_room_is_what_the_system_says() {
        let folder = tempfile::tempdir().unwrap();
        assert!(room(folder.path()).unwrap() > 0);
        assert!(room(&folder.path().join("no such folder")).is_err());
    }
}
