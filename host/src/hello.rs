//! `skin hello`: who the board is, and how it is.

use crate::board::{Choice, Connected};
use anyhow::{Result, bail};
use clap::Args;
use link::Link;
use protocol::{Check, FromBoard, Hello, SelfTest, ToBoard};
use serde_json::json;
use std::time::Duration;

/// Arguments of `skin hello`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    board: Choice,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
    /// Do not run the self-test.
    #[arg(long)]
    no_test: bool,
}

/// Longest that a self-test takes, the drive pairs of a sequential board included.
const TEST_TIME: Duration = Duration::from_secs(10);

/// The parts of the self-test and what is wrong when one fails.
const CHECKS: [(Check, &str, &str); 5] = [
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
];

/// Runs the command.
///
/// # Errors
/// No board, or a failed self-test.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let Connected { link, hello, source } = arguments.board.connect()?;
    let test = if arguments.no_test {
        None
    } else {
        Some(self_test(&link)?)
    };
    let failed: Vec<_> = CHECKS
        .iter()
        .filter(|(check, ..)| test.as_ref().is_some_and(|t| !t.passed(*check)))
        .collect();
    if arguments.json {
        println!("{}", as_json(&hello, test.as_ref(), &source));
    } else {
        describe(&hello, &source);
        if let Some(test) = &test {
            println!(
                "self-test   source at {:.1} % of full scale, noise {:.2} codes rms, offset {:.1} codes",
                f64::from(test.source_permille) / 10.0,
                test.noise.codes2().sqrt(),
                test.offset.codes(),
            );
            println!("            {}", if failed.is_empty() { "passed" } else { "FAILED:" });
            for (_, name, what) in &failed {
                println!(
                    "            {name}: {what}{}",
                    suspects(name, test.suspect, hello.electrodes)
                );
            }
        }
    }
    if !failed.is_empty() {
        bail!("the board does not pass its self-test; see docs/board.md for what to look at");
    }
    Ok(())
}

fn suspects(name: &str, bits: u32, electrodes: u8) -> String {
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

fn self_test(link: &Link) -> Result<SelfTest> {
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
    println!("started by  {:?}", hello.reset);
    if !hello.last_panic.is_empty() {
        println!("last panic  {}", hello.last_panic);
    }
}

fn as_json(hello: &Hello, test: Option<&SelfTest>, source: &str) -> serde_json::Value {
    let test = test.map(|t| {
        let failed: Vec<&str> = CHECKS
            .iter()
            .filter(|(c, ..)| !t.passed(*c))
            .map(|(_, name, _)| *name)
            .collect();
        json!({
            "failed": failed,
            "source_permille": t.source_permille,
            "offset_codes": t.offset.codes(),
            "noise_codes_rms": t.noise.codes2().sqrt(),
            "suspect_drive_pairs": (0..32).filter(|m| t.suspect >> m & 1 == 1).collect::<Vec<u32>>(),
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
