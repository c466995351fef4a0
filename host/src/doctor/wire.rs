//! The lines on the way from the board to this program: frames that are lost, damage, the rate, the adapter's latency.

use super::facts::{Facts, Measured, Origin};
use super::line::{Cause, Line};
use link::LinkNotice;
use std::path::Path;

/// All of them.
pub(crate) fn lines(facts: &Facts) -> Vec<Line> {
    let measured = match &facts.measured {
        Ok(measured) => [frames(facts, measured), damage(facts, measured), rate(facts, measured)],
        Err(why) => {
            let not = |name| Line::not_known(name, why);
            let frames = match &facts.hello {
                Ok(_) => Line::bad(
                    "frames",
                    why,
                    Cause::Hardware,
                    "look at what the self-test says, and at the cable",
                ),
                Err(_) => not("frames"),
            };
            [frames, not("line"), not("rate")]
        }
    };
    measured.into_iter().chain([latency_timer(facts)]).collect()
}

/// A slower plan takes less of the line.
const SLOWER: &str = "take a slower plan: skin run --plan";
/// What disturbs a line.
const CABLE: &str = "look at the cable, its length and what runs beside it; try another cable and another USB port";

/// What keeps this program from its port.
const BUSY: &str = "this computer is too busy: close other programs, and examine again";

fn frames(facts: &Facts, measured: &Measured) -> Line {
    let name = "frames";
    let (all, lost, span_s) = measured.count();
    let text = format!("{lost} of {all} lost in {span_s:.1} s");
    let counted = facts.counters.as_ref().ok().map(|[before, after]| {
        let grown = |of: fn(&protocol::Counters) -> u32| after_less_before(of(before), of(after));
        [
            grown(|c| c.overruns),
            grown(|c| c.dropped),
            grown(|c| c.front_end_faults),
        ]
    });
    let (why, cause, advice) = match (measured.damaged(), counted) {
        _ if measured.was_late(&facts.origin) => ("they were read too late", Cause::Software, BUSY),
        (damaged, _) if damaged > 0 => ("they arrived damaged", Cause::Wiring, CABLE),
        (_, Some([overruns, ..])) if overruns > 0 => (
            "the board lost samples and gave them up",
            Cause::Hardware,
            "look at its supply; report it with skin report",
        ),
        (_, Some([_, dropped, _])) if dropped > 0 => ("the line is too slow for the plan", Cause::Software, SLOWER),
        (_, Some([.., faults])) if faults > 0 => (
            "the board's front end failed",
            Cause::Hardware,
            "docs/board.md says what to look at",
        ),
        _ => ("it is not known where", Cause::Wiring, CABLE),
    };
    // What the program warns of while it runs.
    let warned = measured.notices.iter().any(|n| matches!(n, LinkNotice::Lost { .. }));
    let line = if let Some(ended) = &measured.ended {
        Line::bad(
            name,
            format!("{text}, then none: {ended}"),
            Cause::Hardware,
            "look at its cable, power and supply",
        )
    } else if lost == 0 {
        Line::ok(name, text)
    } else if warned {
        Line::bad(name, format!("{text}: {why}"), cause, advice)
    } else {
        Line::look(name, format!("{text}: {why}"), cause, advice)
    };
    let line = line.figure("frames", all as f64).figure("lost_frames", lost as f64);
    match counted {
        Some([overruns, dropped, _]) => line
            .figure("board_overruns", overruns.into())
            .figure("board_dropped", dropped.into()),
        None => line,
    }
}

/// A counter's growth; one that began anew after a reset has grown by what it is.
fn after_less_before(before: u32, after: u32) -> u32 {
    after.checked_sub(before).unwrap_or(after)
}

/// From this part of all messages on pictures are missing; one alone is a glitch.
const MUCH_DAMAGE: f64 = 0.01;

fn damage(facts: &Facts, measured: &Measured) -> Line {
    let name = "line";
    let damaged = measured.damaged();
    let whole = u64::from(measured.link.decoder.messages);
    let refused = facts.counters.as_ref().map_or(0, |[before, after]| {
        after_less_before(before.receive_errors, after.receive_errors)
    });
    let text = format!("{damaged} of {} messages damaged", damaged + whole);
    let to_board = format!("{text}; the board met {refused} receive errors");
    let part = damaged as f64 / (damaged + whole).max(1) as f64;
    let line = if damaged > 0 && measured.was_late(&facts.origin) {
        Line::look(name, format!("{text}: they were read too late"), Cause::Software, BUSY)
    } else if damaged > 1 && part > MUCH_DAMAGE {
        Line::bad(name, text, Cause::Wiring, CABLE)
    } else if damaged > 0 {
        Line::look(name, text, Cause::Wiring, CABLE)
    } else if refused > 0 {
        Line::look(name, to_board, Cause::Wiring, CABLE)
    } else {
        Line::ok(name, text)
    };
    line.figure("damaged_messages", damaged as f64)
        .figure("messages", whole as f64)
        .figure("bytes", measured.link.bytes as f64)
        .figure("board_receive_errors", refused.into())
}

/// The board keeps the time of its plan to its crystal; what is further off is another plan.
const RATE_TOLERANCE: f64 = 0.02;
/// Frames must arrive about as fast as they are measured.
const ARRIVAL_TOLERANCE: f64 = 0.1;

fn rate(facts: &Facts, measured: &Measured) -> Line {
    let name = "rate";
    let (_, lost, _) = measured.count();
    let promised = measured.frame_s.recip();
    let made = measured.made_per_s();
    if !made.is_finite() {
        return Line::not_known(name, "no two frames came one after the other");
    }
    let arrived = (measured.frames.len() as f64 - 1.0) / measured.wall_s.max(f64::MIN_POSITIVE);
    let text = format!("{made:.1} frames/s, the plan promises {promised:.1}");
    // Only a board's time is this computer's.
    let by_clock = facts.origin == Origin::Port;
    let line = if (made / promised - 1.0).abs() > RATE_TOLERANCE {
        Line::bad(
            name,
            text,
            Cause::Software,
            "the board does not keep its plan: flash the firmware that belongs to this program",
        )
    } else if by_clock && lost == 0 && (arrived / made - 1.0).abs() > ARRIVAL_TOLERANCE {
        Line::look(
            name,
            format!("{text}; {arrived:.1} frames/s arrive"),
            Cause::Software,
            "the computer or a bridge on the way is too slow: end other programs, look at the network",
        )
    } else {
        Line::ok(name, text)
    };
    let line = line.figure("frames_per_s", made).figure("promised_per_s", promised);
    if by_clock {
        line.figure("arrived_per_s", arrived)
    } else {
        line
    }
}

/// What contrib/70-skin.rules sets, ms.
const BEST_LATENCY_MS: u32 = 1;

fn latency_timer(facts: &Facts) -> Line {
    let name = "latency_timer";
    match &facts.origin {
        Origin::Recording(_) => Line::not_known(name, "a recording has no port"),
        Origin::Simulated => Line::not_known(name, "the simulated board has no adapter"),
        Origin::Port if facts.hello.is_err() => Line::not_known(name, "no port was opened"),
        Origin::Port => timer(&facts.source, Path::new("/sys")),
    }
}

/// The timer of a port's adapter, as the system below `sys` has it.
fn timer(port: &str, sys: &Path) -> Line {
    let name = "latency_timer";
    if !cfg!(target_os = "linux") {
        return Line::not_known(name, "only Linux tells it");
    }
    let Ok(port) = std::fs::canonicalize(port) else {
        return Line::not_known(name, "the port is a bridge, whose adapter is at another computer");
    };
    let file = port
        .file_name()
        .map(|tty| sys.join("class/tty").join(tty).join("device/latency_timer"));
    let ms = file.and_then(|file| std::fs::read_to_string(file).ok());
    match ms.and_then(|ms| ms.trim().parse::<u32>().ok()) {
        None => Line::not_known(name, "the port's adapter has none that Linux tells"),
        Some(ms) if ms <= BEST_LATENCY_MS => Line::ok(name, format!("{ms} ms")).figure("latency_ms", ms.into()),
        Some(ms) => Line::look(
            name,
            format!("{ms} ms: frames arrive up to that much late"),
            Cause::Software,
            "install contrib/70-skin.rules, which sets 1 ms, and plug the board in again",
        )
        .figure("latency_ms", ms.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::line::Light;
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn the_timer_of_the_adapter_is_the_systems() {
        let folder = tempfile::tempdir().unwrap();
        let port = folder.path().join("ttyUSB7");
        std::fs::write(&port, "").unwrap();
        let port = port.to_str().unwrap();
        assert_eq!(timer(port, folder.path()).light, Light::NotKnown);
        let device = folder.path().join("class/tty/ttyUSB7/device");
        std::fs::create_dir_all(&device).unwrap();
        for (ms, light) in [
            ("16\n", Light::Look),
            ("1\n", Light::Ok),
            ("0", Light::Ok),
            ("x", Light::NotKnown),
        ] {
            std::fs::write(device.join("latency_timer"), ms).unwrap();
            let line = timer(port, folder.path());
            assert_eq!(line.light, light, "{ms}: {line:?}");
        }
        let bridge = timer("tcp://robot:3333", folder.path());
        assert!(bridge.light == Light::NotKnown && bridge.text.contains("bridge"));
    }

    #[test]
    fn a_counter_that_began_anew_has_grown_by_what_it_is() {
        assert_eq!(after_less_before(5, 7), 2);
        assert_eq!(after_less_before(5, 3), 3);
    }
}
