//! `skin hello`: who the board is, and how it is.

use crate::board::{Choice, Connected};
use crate::event::Said;
use crate::phantom::Tried;
use crate::recorded_board::{self, ONLY_LIVE, RecordedBoard};
use crate::say::say;
use crate::{json, number, phantom, simulated_skin};
use anyhow::{Result, bail};
use clap::Args;
use hil_sim::{Fault, Preset};
use link::phantom::{Finding, Known, channels, read};
use link::{Link, LinkError, settings};
use protocol::{Check, FromBoard, Hello, Notice, ResetCause, SelfTest, ToBoard};
use serde_json::json;
use std::io::Write;
use std::time::Duration;

/// Arguments of `skin hello`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    board: Choice,
    #[command(flatten)]
    recorded: recorded_board::From,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
    /// Do not run the self-test.
    #[arg(long)]
    no_test: bool,
    /// The production test: a ring of equal resistors of so many ohm is in the place of the sheet, one between neighbouring
    /// electrodes. Every value is held against theory, and what is wrong is named (docs/board.md).
    #[arg(long, value_name = "OHM", conflicts_with_all = ["no_test", "from"], value_parser = number::positive("a resistance in ohm above 0"))]
    phantom: Option<f64>,
    /// What an ohmmeter shows between two neighbouring electrodes of that ring, unplugged, ohm. The values alone cannot tell a
    /// ring of smaller resistors from switches of more.
    #[arg(long, value_name = "OHM", requires = "phantom", conflicts_with_all = ["no_test", "from"], value_parser = number::positive("a resistance in ohm above 0"))]
    measured: Option<f64>,
    /// The electronics of the simulated board: sixteen_channels, ideal, drawn_board or drawn_sixteen (docs/simulator.md).
    #[arg(long, value_name = "NAME", requires = "simulate", conflicts_with_all = ["port", "serial", "from"])]
    preset: Option<Preset>,
    /// Something that breaks on the simulated board, as for `skin sim`, such as amplifier_dead@0 or wires_swapped:5,6@0; repeatable.
    #[arg(long, value_name = "KIND@AT[+FOR]", requires = "simulate", conflicts_with_all = ["port", "serial", "from"])]
    fault: Vec<Fault>,
}

impl Arguments {
    /// The ring in the place of the sheet, if there is one.
    fn ring(&self) -> Option<Known> {
        self.phantom.map(|said_ohm| Known {
            said_ohm,
            between_ohm: self.measured,
        })
    }
}

/// Longest that a self-test takes, the drive pairs of a sequential board included.
const TEST_TIME: Duration = Duration::from_secs(10);

/// The parts of the self-test and what is wrong when one fails.
pub(crate) const CHECKS: [(Check, &str, &str); 8] = [
    (
        Check::Source,
        "source",
        "the source has not the amplitude it should have",
    ),
    (
        Check::Offset,
        "offset",
        "an amplifier does not rest in the middle of its range",
    ),
    (
        Check::Noise,
        "noise",
        "there is more noise than the electronics has by itself",
    ),
    (Check::Electrodes, "electrodes", "electrodes are open or shorted"),
    (Check::Store, "store", "the memory for settings cannot be read"),
    (
        Check::Amplifier,
        "amplifier",
        "the amplifier of the sense pairs gives no signal: look at U3, R12 and PA0",
    ),
    (
        Check::Linearity,
        "linearity",
        "the amplifier of the sense pairs saturates or clips: look at its supply",
    ),
    (
        Check::Phase,
        "phase",
        "source or sense pairs are out of phase: look at the filters' parts",
    ),
];

/// Mean of the source's own channel below the middle of the range, codes, from which on half of the source's amplitude means
/// that the reference of the drive is at ground: without it each end gives every other half wave.
const NO_REFERENCE_CODES: f64 = -200.0;
/// Thousandths of the source's amplitude that such a board shows.
const HALF_PERMILLE: std::ops::Range<u16> = 400..600;
/// Part of the range by which the mean of a channel without its reference is off, or more: half of it, less a half wave's mean,
/// 1/pi of half the range at most.
const HALF_RANGE: f64 = 0.3;

/// What a lost reference is recognised by, in words.
pub(crate) fn lost_reference(test: &SelfTest, hello: &Hello) -> Option<&'static str> {
    let range = hello.range_codes();
    if test.offset.codes() < -HALF_RANGE * range {
        return Some("the reference of 1.65 V is lost: look at U1D, R3, R4 and TP5");
    }
    let half = HALF_PERMILLE.contains(&test.source_permille);
    (half && test.source_offset.codes() < NO_REFERENCE_CODES)
        .then_some("the reference V_R is lost: look at U1C, R1, R2 and TP4")
}

/// Runs the command.
///
/// # Errors
/// No board, or a failed self-test.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let examined = match arguments.recorded.board()? {
        Some(recorded) => Examined::of_recording(recorded, arguments.no_test),
        None => Examined::of_board(arguments)?,
    };
    if arguments.json {
        crate::say::stdout().write_all(&json::line(&examined.as_json())?)?;
    } else {
        examined.describe();
    }
    if examined.tried.as_ref().is_some_and(|tried| !tried.passed()) {
        bail!("the board does not pass on the phantom; docs/board.md says what to look at");
    }
    if !examined.failed().is_empty() || !examined.channels.is_empty() {
        bail!("the board does not pass its self-test; see docs/board.md for what to look at");
    }
    Ok(())
}

/// What is known of a board.
struct Examined {
    source: String,
    hello: Hello,
    careful: Option<Notice>,
    test: Option<SelfTest>,
    tried: Option<Tried>,
    channels: Vec<Finding>,
    /// Why its channels were not tried.
    untried: Option<String>,
    /// Why it was started anew while it was recorded; none of a live board.
    restarts: Option<Vec<ResetCause>>,
}

impl Examined {
    fn of_recording(recorded: RecordedBoard, no_test: bool) -> Self {
        Self {
            source: recorded.source,
            hello: recorded.hello,
            careful: recorded.careful,
            test: recorded.self_test.filter(|_| !no_test),
            tried: None,
            channels: Vec::new(),
            untried: Some(ONLY_LIVE.to_owned()),
            restarts: Some(recorded.restarts),
        }
    }

    fn of_board(arguments: &Arguments) -> Result<Self> {
        let Connected { link, hello, source } = connected(arguments)?;
        // Before the self-test: what restarted it may come again.
        let (_, careful) = settings::status(&link)?;
        let test = if arguments.no_test {
            None
        } else {
            Some(self_test(&link)?)
        };
        let passed = test.as_ref().is_some_and(|test| failed(test).is_empty());
        let tried = match (arguments.ring(), &test) {
            (Some(known), Some(test)) => Some(phantom::test(&link, &hello, known, test)?),
            _ => None,
        };
        // The self-test sees the amplifier behind the multiplexers; a ring shows the others as well.
        let (channels, untried) = if tried.is_none() && passed && hello.limits.channels > 1 {
            match read(&link, &hello) {
                Ok(readings) => (channels(&readings, usize::from(hello.electrodes)), None),
                Err(LinkError::Refused(why)) => (Vec::new(), Some(why)),
                Err(e) => return Err(e.into()),
            }
        } else {
            (Vec::new(), None)
        };
        if let Some(why) = &untried {
            say!("the channels were not tried: {why}");
        }
        Ok(Self {
            source,
            hello,
            careful,
            test,
            tried,
            channels,
            untried,
            restarts: None,
        })
    }

    /// The parts of the self-test that failed, with what is wrong.
    fn failed(&self) -> Vec<(&'static str, &'static str)> {
        self.test.as_ref().map_or_else(Vec::new, failed)
    }

    fn lost_reference(&self) -> Option<&'static str> {
        self.test.as_ref().and_then(|test| lost_reference(test, &self.hello))
    }

    fn as_json(&self) -> serde_json::Value {
        let mut json = as_json(&self.hello, self.test.as_ref(), &self.source);
        json["careful"] = json!(self.careful.as_ref().map(Said::from));
        json["lost_reference"] = json!(self.lost_reference());
        json["channels"] = json!(self.channels.iter().map(phantom::finding).collect::<Vec<_>>());
        json["channels_not_tried"] = json!(self.untried);
        json["phantom"] = json!(self.tried.as_ref().map(phantom::as_json));
        let restarts = |all: &Vec<ResetCause>| all.iter().map(|why| format!("{why:?}")).collect::<Vec<_>>();
        json["recorded_restarts"] = json!(self.restarts.as_ref().map(restarts));
        json
    }

    fn describe(&self) {
        describe(&self.hello, &self.source);
        if let Some(careful) = &self.careful {
            println!("careful     {careful}");
        }
        match &self.restarts {
            Some(restarts) if !restarts.is_empty() => {
                let causes: Vec<String> = restarts.iter().map(|why| format!("{why:?}")).collect();
                println!(
                    "restarted   {} times while recorded: {}",
                    restarts.len(),
                    causes.join(", ")
                );
            }
            _ => {}
        }
        if let Some(test) = &self.test {
            self.describe_test(test);
        }
        if self.restarts.is_some() {
            let what = if self.test.is_some() {
                "channels   "
            } else {
                "self-test  "
            };
            println!("{what} {ONLY_LIVE}");
        }
        if !self.channels.is_empty() {
            println!("channels    FAILED, or something touched the sheet meanwhile (then try again):");
        }
        for finding in &self.channels {
            println!("            {}: {finding}", finding.name());
        }
        if let Some(tried) = &self.tried {
            phantom::describe(tried);
        }
    }

    fn describe_test(&self, test: &SelfTest) {
        let failed = self.failed();
        println!(
            "self-test   source at {:.1} % of full scale, noise {:.2} codes rms, offset {:.1} codes",
            f64::from(test.source_permille) / 10.0,
            test.noise.codes2().sqrt(),
            test.offset.codes(),
        );
        println!("            {}", if failed.is_empty() { "passed" } else { "FAILED:" });
        if let Some(reference) = self.lost_reference() {
            println!("            {reference}");
        }
        for (name, what) in failed {
            println!(
                "            {name}: {what}{}",
                suspects(name, test.suspect, self.hello.electrodes)
            );
        }
    }
}

/// The parts of a self-test that failed, with what is wrong.
fn failed(test: &SelfTest) -> Vec<(&'static str, &'static str)> {
    let failed = CHECKS.iter().filter(|(check, ..)| !test.passed(*check));
    failed.map(|(_, name, what)| (*name, *what)).collect()
}

/// The board, or a simulated one with what was asked for.
fn connected(arguments: &Arguments) -> Result<Connected> {
    let plain = arguments.preset.is_none() && arguments.fault.is_empty() && arguments.phantom.is_none();
    if plain || !arguments.board.is_simulated() {
        return arguments.board.connect();
    }
    let preset = arguments.preset.unwrap_or_default();
    arguments.board.connect_or(None, |sheet| {
        simulated_skin::bench(&sheet, preset, &arguments.fault, arguments.ring())
    })
}

/// Where electrodes are open or shorted, in words; nothing for other parts of the test.
pub(crate) fn suspects(name: &str, bits: u32, electrodes: u8) -> String {
    if name != "electrodes" {
        return String::new();
    }
    // Pair m is of electrodes m and m + 1 from 0, and the last one closes the ring; people count from 1.
    let pairs: Vec<String> = (0..32)
        .filter(|m| bits >> m & 1 == 1)
        .map(|m| format!("{}-{}", m + 1, (m + 1) % u32::from(electrodes.max(1)) + 1))
        .collect();
    format!(" (between {})", pairs.join(", "))
}

/// Lets the board test itself.
///
/// # Errors
/// No answer, a refusal, a lost port.
pub(crate) fn self_test(link: &Link) -> Result<SelfTest> {
    let answer = link.ask("a self-test", ToBoard::SelfTest, TEST_TIME, |m| match m {
        FromBoard::SelfTest(test) => Some(test),
        _ => None,
    })?;
    Ok(answer)
}

fn describe(hello: &Hello, source: &str) {
    let git = if hello.git.is_empty() {
        String::new()
    } else {
        format!(", built from {}", hello.git)
    };
    println!("port        {source}");
    println!("board       {}, serial {}", hello.board, hello.serial);
    println!("firmware    {}{git}", hello.firmware);
    println!(
        "protocol    {}.{}, schema {:08x}",
        hello.version.major, hello.version.minor, hello.schema
    );
    println!(
        "excitation  {:.1} Hz ({} Hz / {} / {}), {:.2} V amplitude",
        hello.excitation_hz(),
        hello.timer_hz,
        hello.ticks_per_sample,
        hello.samples_per_period,
        f64::from(hello.excitation_uv) * 1e-6
    );
    println!(
        "electrodes  {}, {} sampled at once, {} bits",
        hello.electrodes, hello.limits.channels, hello.adc_bits
    );
    println!("started by  {}", hello.reset);
    if !hello.last_panic.is_empty() {
        println!("last panic  {}", hello.last_panic);
    }
}

fn as_json(hello: &Hello, test: Option<&SelfTest>, source: &str) -> serde_json::Value {
    let test = test.map(|t| {
        let failed: Vec<&str> = failed(t).into_iter().map(|(name, _)| name).collect();
        json!({
            "failed": failed,
            "source_permille": t.source_permille,
            "offset_codes": t.offset.codes(),
            "noise_codes_rms": t.noise.codes2().sqrt(),
            "suspect_drive_pairs": (0..32).filter(|m| t.suspect >> m & 1 == 1).collect::<Vec<u32>>(),
            "source_offset_codes": t.source_offset.codes(),
            "bent_drive_pairs": (0..32).filter(|m| t.bent >> m & 1 == 1).collect::<Vec<u32>>(),
            "drive_pair_codes": t.drive_pairs.iter().map(|v| v.codes()).collect::<Vec<f64>>(),
            "sense_pair_codes": t.sense_pairs.iter().map(|v| v.codes()).collect::<Vec<f64>>(),
        })
    });
    json!({
        "port": source,
        "board": hello.board.as_str(),
        "serial": hello.serial.as_str(),
        "firmware": hello.firmware.as_str(),
        "git": hello.git.as_str(),
        "protocol": [hello.version.major, hello.version.minor],
        "schema": hello.schema,
        "electrodes": hello.electrodes,
        "channels": hello.limits.channels,
        "excitation_hz": hello.excitation_hz(),
        "timer_hz": hello.timer_hz,
        "ticks_per_sample": hello.ticks_per_sample,
        "reset": format!("{:?}", hello.reset),
        "last_panic": hello.last_panic.as_str(),
        "self_test": test,
    })
}
