//! `skin report`: what whoever is to find a fault needs to know, in one zip file.

use crate::baselines;
use crate::config::Config;
use crate::doctor::{Examination, Examined, Facts, Origin, Witness, measure};
use crate::files::baseline_file::{self, Subject, unix_s};
use crate::files::replace::replace;
use crate::files::zip::Zip;
use crate::recorded::{PROGRAM, Recorded, SessionRecord};
use crate::recording_file::{compact, in_words};
use crate::say::{self, say};
use ::forward::Sheet;
use anyhow::{Context, Result};
use clap::Args;
use inverse::live::LiveOptions;
use link::Session;
use recording::{Reader, Recorder, Topic, WaitingRecorder};
use serde_json::{Value, json};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Arguments of `skin report`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    examined: Examined,
    /// The file [default: skin-report-TIME.zip].
    #[arg(value_name = "FILE.zip")]
    file: Option<PathBuf>,
}

/// What a part of the report holds.
enum Content {
    Text(String),
    /// A copy of a file, as it is.
    Copy(PathBuf),
    /// It is left out, and why.
    Absent(String),
}

/// A part of the report.
struct Part {
    name: &'static str,
    about: &'static str,
    content: Content,
}

/// Largest recording that goes with a report, bytes: what can be attached.
const MOST_BYTES: u64 = 24_000_000;
/// Lines of the log that go with a report: the last ones.
const LOG_LINES: usize = 200;

/// Runs the command.
///
/// # Errors
/// The file cannot be written; what is asked for makes no sense. A board that is not there is no error.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let now_unix_s = unix_s(SystemTime::now());
    let named = || PathBuf::from(format!("skin-report-{}.zip", compact(now_unix_s)));
    let path = arguments.file.clone().unwrap_or_else(named);
    let examined = &arguments.examined;
    let beside = Beside::new(&path);
    let (facts, recording) = measured(examined, &beside.0)?;
    let examination = Examination::of(&facts, examined.state_dir.as_deref());
    let mut parts = vec![
        part(
            "doctor.txt",
            "what skin doctor found",
            Content::Text(examination.words(false)),
        ),
        part(
            "doctor.json",
            "the same for programs",
            Content::Text(serde_json::to_string_pretty(&examination)?),
        ),
        part(
            "versions.json",
            "program, system, board",
            Content::Text(versions(&facts)?),
        ),
        part(
            "settings.txt",
            "what the board was set to, and its plan",
            settings(&facts),
        ),
        part("log.txt", "the last lines that the program said", log(&facts)?),
        part("recording.mcap", "what board and program sent each other", recording),
    ];
    parts.extend(files(&facts, examined)?);
    let text = contents(&parts);
    write(&path, &text, &parts).with_context(|| format!("{}: cannot be written", path.display()))?;
    eprint!("{text}");
    eprintln!("{}: written; look into it before it is sent", path.display());
    Ok(())
}

fn part(name: &'static str, about: &'static str, content: Content) -> Part {
    Part { name, about, content }
}

/// A recording beside the report, until it is in it.
struct Beside(PathBuf);

impl Beside {
    fn new(path: &Path) -> Self {
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".{}.mcap", std::process::id()));
        Self(name.into())
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        // Perhaps there is none.
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Facts, and what passed as a recording; or the recording that they are of.
fn measured(examined: &Examined, beside: &Path) -> Result<(Facts, Content)> {
    let mut waiting = Some(Recorder::waiting());
    let tap = waiting.as_ref().map(|w| w.tap().clone());
    let mut recorder = None;
    let mut begin = |session: &Session, sheet: &Sheet, source: &str| {
        recorder = waiting
            .take()
            .map(|w| begun(w, session, sheet, source, &examined.wires, beside));
    };
    let witness = tap.as_ref().map(|tap| Witness { tap, begin: &mut begin });
    let facts = measure(examined, witness)?;
    let content = match (&facts.origin, recorder, &facts.hello, &facts.measured) {
        (Origin::Recording(path), ..) => small_enough(path, "send it by itself"),
        (_, Some(recorder), ..) => match recorder.and_then(finished) {
            Ok(()) => small_enough(beside, "take fewer --seconds"),
            Err(why) => Content::Absent(format!("{why:#}")),
        },
        (.., Err(no), _) => Content::Absent(no.why.clone()),
        (.., Err(why)) => Content::Absent(why.clone()),
        (..) => Content::Absent("nothing was recorded".to_owned()),
    };
    Ok((facts, content))
}

/// A recording of a session that begins.
fn begun(
    waiting: WaitingRecorder,
    session: &Session,
    sheet: &Sheet,
    source: &str,
    wires: &[usize],
    beside: &Path,
) -> Result<Recorder> {
    let of = Recorded {
        hello: session.hello(),
        source,
        values: session.plan().value_count(),
        sheet,
        wires,
        presses: None,
    };
    let started_unix_s = waiting.tap().clock().started_unix_s();
    let record = SessionRecord::new(&of, &LiveOptions::default(), started_unix_s)?;
    let mut recorder = waiting.into_file(beside)?;
    recorder.begin(&record)?;
    Ok(recorder)
}

/// Closes a recording, and says what is missing in it.
fn finished(recorder: Recorder) -> Result<()> {
    let counts = recorder.finish()?;
    if counts.lost_messages > 0 || counts.lost_bytes > 0 {
        say!(
            "warning: the disk was too slow for {} bytes of the recording, which are missing",
            counts.lost_bytes
        );
    }
    Ok(())
}

/// A recording as a part; what to do where it is too large.
fn small_enough(path: &Path, advice: &str) -> Content {
    match std::fs::metadata(path) {
        Ok(file) if file.len() <= MOST_BYTES => Content::Copy(path.to_owned()),
        Ok(file) => Content::Absent(format!("it has {:.0} MB, {advice}", 1e-6 * file.len() as f64)),
        Err(why) => Content::Absent(why.to_string()),
    }
}

/// What the program said: as a recording has it that was examined, and now.
fn log(facts: &Facts) -> Result<Content> {
    let mut lines = match &facts.origin {
        Origin::Recording(path) => recorded_lines(path)?,
        _ => Vec::new(),
    };
    lines.extend(say::last_lines().into_iter().map(|line| line + "\n"));
    if lines.is_empty() {
        return Ok(Content::Absent("the program said nothing".to_owned()));
    }
    Ok(Content::Text(lines[lines.len().saturating_sub(LOG_LINES)..].concat()))
}

/// What the program said while a recording was made.
fn recorded_lines(path: &Path) -> Result<Vec<String>> {
    let mut reader = Reader::open(path)?;
    let mut lines = Vec::new();
    while let Some(line) = reader.find(Topic::Log)? {
        let line: Value = serde_json::from_slice(&line)?;
        let at_s = line["timestamp"]["sec"].as_f64().unwrap_or_default();
        lines.push(format!(
            "{}  {}\n",
            in_words(at_s),
            line["message"].as_str().unwrap_or_default()
        ));
    }
    Ok(lines)
}

fn settings(facts: &Facts) -> Content {
    let status = match &facts.status {
        Ok(status) => format!("{status:#?}\n"),
        Err(why) => format!("settings: not known: {why}\n"),
    };
    match &facts.measured {
        Ok(measured) => Content::Text(format!("{status}{:#?}\n", measured.plan)),
        Err(why) => Content::Text(format!("{status}plan: not known: {why}\n")),
    }
}

/// Of the program, the system and the board.
fn versions(facts: &Facts) -> Result<String> {
    let line = |file: &str, key: &str| {
        let text = std::fs::read_to_string(file).ok()?;
        let line = text.lines().find_map(|l| l.strip_prefix(key))?;
        Some(line.trim_matches('"').to_owned())
    };
    let versions = json!({
        "program": PROGRAM,
        "protocol": [protocol::Version::CURRENT.major, protocol::Version::CURRENT.minor],
        "schema": protocol::SCHEMA,
        "system": std::env::consts::OS,
        "processor": std::env::consts::ARCH,
        "distribution": line("/etc/os-release", "PRETTY_NAME="),
        "kernel": line("/proc/sys/kernel/osrelease", ""),
        "board": facts.hello.as_ref().ok().map(|hello| format!("{hello:?}")),
    });
    Ok(serde_json::to_string_pretty(&versions)?)
}

/// Files of this computer that the program uses, as they are.
fn files(facts: &Facts, examined: &Examined) -> Result<Vec<Part>> {
    let none = |what: &str| Content::Absent(format!("no {what} is used"));
    let of = |path: Option<PathBuf>, what: &str| match path {
        Some(path) => std::fs::read_to_string(&path).map_or_else(
            |why| Content::Absent(format!("{}: {why}", path.display())),
            Content::Text,
        ),
        None => none(what),
    };
    let config = Config::load()?;
    let sheet = match (&facts.origin, examined.sheet.clone().or(config.sheet)) {
        (Origin::Recording(_), _) => Content::Absent("it is in the recording".to_owned()),
        (_, path) => of(path, "file for the sheet, but the paper's disc,"),
    };
    let stored = match (&facts.hello, &facts.measured) {
        (Ok(hello), Ok(measured)) => baselines::folder(examined.state_dir.as_deref(), hello).map(|folder| {
            let subject = Subject::new(hello, &facts.sheet, &measured.plan);
            baseline_file::path(&folder, &subject)
        }),
        _ => None,
    };
    Ok(vec![
        part(
            "config.toml",
            "the configuration file",
            of(Config::file().filter(|file| file.exists()), "configuration file"),
        ),
        part("sheet.toml", "the sheet's file", sheet),
        part(
            "calibration.toml",
            "the calibration's file",
            of(config.calibration, "calibration"),
        ),
        part(
            "baseline.toml",
            "the stored baseline of this board",
            of(stored, "stored baseline"),
        ),
    ])
}

/// What is inside and what is not, for whoever opens it and whoever sends it.
fn contents(parts: &[Part]) -> String {
    let mut text = format!("A report of {PROGRAM}. It holds\n");
    for Part { name, about, content } in parts {
        match content {
            Content::Absent(why) => text += &format!("- no {name} ({about}): {why}\n"),
            _ => text += &format!("- {name}: {about}\n"),
        }
    }
    text += "Personal in it are serial numbers of boards, names of ports and files, and what you wrote into the files. The path of your \
             home folder is ~ in all texts; the recording is as it is.\n";
    shortened(&text)
}

/// The path of the home folder often is a person's name.
fn shortened(text: &str) -> String {
    let home = std::env::var("HOME").or_else(|_| std::env::var("USERPROFILE"));
    match home {
        Ok(home) if home.len() > 1 => text.replace(&home, "~"),
        _ => text.to_owned(),
    }
}

/// Writes the report, as a whole or not at all.
fn write(path: &Path, contents: &str, parts: &[Part]) -> std::io::Result<()> {
    replace(path, |file| {
        let mut zip = Zip::new(file);
        zip.begin("README.txt")?;
        zip.put(contents.as_bytes())?;
        for Part { name, content, .. } in parts {
            match content {
                Content::Text(text) => {
                    zip.begin(name)?;
                    zip.put(shortened(text).as_bytes())?;
                }
                Content::Copy(from) => {
                    zip.begin(name)?;
                    let (mut from, mut buffer) = (File::open(from)?, vec![0; 1 << 16]);
                    loop {
                        match from.read(&mut buffer)? {
                            0 => break,
                            n => zip.put(&buffer[..n])?,
                        }
                    }
                }
                Content::Absent(_) => {}
            }
        }
        zip.finish()
    })
}
