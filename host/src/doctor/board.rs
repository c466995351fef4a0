//! The lines on the board itself: who it is, how it started, what its self-test says.

use super::facts::{Facts, NOBODY, Origin};
use super::line::{Cause, Line};
use crate::hello::{CHECKS, lost_reference, suspects};
use protocol::{Check, Hello, ResetCause, SCHEMA, Version};

/// All of them.
pub(crate) fn lines(facts: &Facts) -> Vec<Line> {
    vec![
        port(facts),
        board(facts),
        firmware(facts),
        uptime(facts),
        self_test(facts),
        source(facts),
    ]
}

fn port(facts: &Facts) -> Line {
    let name = "port";
    match (&facts.origin, &facts.hello) {
        (Origin::Recording(_), _) => Line::not_known(name, "a recording has no port"),
        (Origin::Simulated, _) => Line::not_known(name, "the simulated board has no port"),
        (Origin::Port, Ok(_)) => Line::ok(name, facts.source.clone()),
        (Origin::Port, Err(no)) if no.opened => Line::ok(name, format!("{} was opened", facts.source)),
        // What is there and does not open is held by a program, or belongs to another group.
        (Origin::Port, Err(no)) if std::path::Path::new(&facts.source).exists() => Line::bad(
            name,
            &no.why,
            Cause::Software,
            "end the program that holds it; contrib/70-skin.rules gives access to it",
        ),
        (Origin::Port, Err(no)) => Line::bad(
            name,
            &no.why,
            Cause::Wiring,
            "plug the board in; skin list shows the ports that there are",
        ),
    }
}

fn board(facts: &Facts) -> Line {
    let name = "board";
    match &facts.hello {
        Ok(hello) => Line::ok(
            name,
            format!(
                "{}, serial {}, {} electrodes, {} sampled at once",
                hello.board, hello.serial, hello.electrodes, hello.limits.channels
            ),
        ),
        Err(no) if !no.opened => Line::not_known(name, NOBODY),
        Err(no) if no.other_version => Line::bad(name, &no.why, Cause::Software, "skin flash FILE programs the board"),
        Err(no) => Line::bad(
            name,
            &no.why,
            Cause::Wiring,
            "look at cable and power, and whether it is the right port: skin list shows what there is",
        ),
    }
}

fn firmware(facts: &Facts) -> Line {
    let name = "firmware";
    let hello = match &facts.hello {
        Ok(hello) => hello,
        Err(_) => return Line::not_known(name, NOBODY),
    };
    let Version { major, minor } = hello.version;
    let git = if hello.git.is_empty() {
        String::new()
    } else {
        format!(", built from {}", hello.git)
    };
    let text = format!("{}{git}, protocol {major}.{minor}", hello.firmware);
    if hello.version == Version::CURRENT && hello.schema != SCHEMA {
        let other = format!("{text}; its messages are not quite those of this program");
        let advice = "flash the firmware that belongs to this program: skin flash FILE";
        return Line::look(name, other, Cause::Software, advice);
    }
    Line::ok(name, text)
}

/// Why a board started, where that is nothing to be proud of.
fn odd_start(hello: &Hello) -> Option<(&'static str, Cause, &'static str)> {
    Some(match hello.reset {
        ResetCause::Unknown | ResetCause::PowerOn | ResetCause::Pin | ResetCause::Software => return None,
        ResetCause::BrownOut => (
            "its supply sagged",
            Cause::Hardware,
            "look at its supply: another cable, another USB port, a hub with its own",
        ),
        ResetCause::Watchdog => (
            "its firmware hung",
            Cause::Software,
            "report it with skin report, and flash the newest firmware",
        ),
        ResetCause::Panic => (
            "its firmware met a bug",
            Cause::Software,
            "report it with skin report, and flash the newest firmware",
        ),
    })
}

fn uptime(facts: &Facts) -> Line {
    let name = "uptime";
    let hello = match &facts.hello {
        Ok(hello) => hello,
        Err(_) => return Line::not_known(name, NOBODY),
    };
    let measured = match &facts.measured {
        Ok(measured) => measured,
        Err(why) => return Line::not_known(name, why),
    };
    let up_s = measured.frames.last().map_or(0.0, |f| f.time_s);
    let resets = measured.resets();
    let text = format!("up for {up_s:.0} s, started by {}", hello.reset);
    let line = if resets > 0 {
        Line::bad(
            name,
            format!("{text}; reset {resets} times while it was listened to"),
            Cause::Hardware,
            "look at its supply and at the cable: the board loses power, or its reset line is disturbed",
        )
    } else if let Some((what, cause, advice)) = odd_start(hello) {
        Line::look(name, format!("{text}: {what}"), cause, advice)
    } else if !hello.last_panic.is_empty() {
        let text = format!("{text}; it says: {}", hello.last_panic);
        Line::look(name, text, Cause::Hardware, "docs/board.md says what to look at")
    } else {
        Line::ok(name, format!("{text}, no reset seen"))
    };
    line.figure("uptime_s", up_s).figure("resets", resets as f64)
}

fn self_test(facts: &Facts) -> Line {
    let name = "self_test";
    let (test, hello) = match (&facts.self_test, &facts.hello) {
        (Ok(test), Ok(hello)) => (test, hello),
        (Err(why), _) => return Line::not_known(name, why),
        (_, Err(_)) => return Line::not_known(name, NOBODY),
    };
    let failed = CHECKS.iter().filter(|(check, ..)| !test.passed(*check));
    let reference = lost_reference(test, hello).map(str::to_owned);
    let what: Vec<String> = reference
        .into_iter()
        .chain(
            failed.map(|(_, name, what)| format!("{name}: {what}{}", suspects(name, test.suspect, hello.electrodes))),
        )
        .collect();
    let noise = test.noise.codes2().sqrt();
    let line = if what.is_empty() {
        Line::ok(name, "passed")
    } else {
        // Open or shorted electrodes are no fault of the board.
        let only_electrodes = test.failed == Check::Electrodes.bit() && what.len() == 1;
        let (cause, advice) = if only_electrodes {
            (Cause::Wiring, "look at the wires and clamps of these electrodes")
        } else {
            (
                Cause::Hardware,
                "docs/board.md says what to look at; skin hello --phantom OHM finds the part",
            )
        };
        let between = (0..usize::from(hello.electrodes)).filter(|m| test.suspect >> m & 1 == 1);
        let next = |m: usize| (m + 1) % usize::from(hello.electrodes.max(1));
        Line::bad(name, format!("failed: {}", what.join("; ")), cause, advice)
            .electrodes(between.flat_map(|m| [m + 1, next(m) + 1]))
    };
    line.figure("noise_codes_rms", noise)
        .figure("offset_codes", test.offset.codes())
}

/// Below this part of full scale the values are more than twice as noisy as they could be.
const LEAST_AMPLITUDE: f64 = 0.5;

fn source(facts: &Facts) -> Line {
    let name = "source";
    let test = match &facts.self_test {
        Ok(test) => test,
        Err(why) => return Line::not_known(name, why),
    };
    let is = f64::from(test.source_permille) / 1000.0;
    let set = facts.status.as_ref().map(|s| f64::from(s.excitation_permille) / 1000.0);
    let of_set = set
        .as_ref()
        .map_or(String::new(), |set| format!(", set to {:.1} %", 100.0 * set));
    let text = format!("{:.1} % of full scale{of_set}", 100.0 * is);
    let line = if !test.passed(Check::Source) {
        Line::bad(
            name,
            format!("{text}: not what it should be"),
            Cause::Hardware,
            "look at the excitation: docs/board.md, the source's parts and test points",
        )
    } else if set.as_ref().is_ok_and(|set| *set < LEAST_AMPLITUDE) {
        Line::look(
            name,
            format!("{text}: the values are small against the noise"),
            Cause::Software,
            "set it higher: skin settings set --excitation 1000",
        )
    } else {
        Line::ok(name, text)
    };
    line.figure("source_part", is)
}
