//! `skin recover`: a whole file of one that was cut short or is damaged.

use crate::files::replace::beside;
use crate::progress::Progress;
use anyhow::{Context, Result, bail};
use clap::Args;
use recording::{Ended, Reader, Recovered, Writer, recover};
use serde_json::json;
use std::path::PathBuf;

/// Arguments of `skin recover`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The recording that was cut short, by a power cut or a kill, or that is damaged. It is only read.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The new file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
}

/// How a file ended, in words.
pub(crate) fn ended(ended: Ended) -> &'static str {
    match ended {
        Ended::Whole => "closed",
        Ended::Short => "closed without an index, as when the disk is full",
        Ended::Cut => "cut short, or still being written",
    }
}

/// What a file lacks that was read to its end; none where it is whole. `nameless`: messages without a topic.
pub(crate) fn lacks(ended: Option<Ended>, damaged: usize, nameless: u64) -> Option<String> {
    let cut = (ended == Some(Ended::Cut)).then(|| "the file was cut short".to_owned());
    let chunks = match damaged {
        0 => None,
        1 => Some("a chunk of up to 1 MB is damaged".to_owned()),
        damaged => Some(format!("{damaged} chunks of up to 1 MB are damaged")),
    };
    let nameless =
        (nameless > 0).then(|| format!("{nameless} messages are lost whose topic was named in what is damaged"));
    let all: Vec<String> = [cut, chunks, nameless].into_iter().flatten().collect();
    (!all.is_empty()).then(|| all.join(", and "))
}

/// Runs the command.
///
/// # Errors
/// The file is no recording, or the new one cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let whole = std::fs::metadata(&arguments.file)
        .with_context(|| arguments.file.display().to_string())?
        .len();
    let mut reader = Reader::open(&arguments.file)?;
    let progress = Progress::new("recovering");
    let out = &arguments.out;
    if out.try_exists().is_ok_and(|there| there) {
        bail!(
            "{}: there is such a file; name another one, or remove it",
            out.display()
        );
    }
    // No part passes for the whole: it gets its name at the end.
    let beside = beside(out);
    let written = Writer::create(&beside)
        .and_then(|to| recover(&mut reader, to, |bytes| progress.at(bytes as usize, whole as usize)))
        .map_err(anyhow::Error::from)
        .and_then(|recovered| {
            std::fs::rename(&beside, out).with_context(|| format!("{}: cannot be written", out.display()))?;
            Ok(recovered)
        });
    if written.is_err() {
        let _ = std::fs::remove_file(&beside);
    }
    drop(progress);
    let Recovered {
        messages,
        from_to_ns,
        ended: how,
        damaged,
        bytes,
    } = written?;
    let nameless = reader.nameless();
    let was = ended(how);
    let span_s = from_to_ns.map_or(0.0, |(from, to)| 1e-9 * to.saturating_sub(from) as f64);
    if arguments.json {
        println!(
            "{}",
            json!({"messages": messages, "span_s": span_s, "was": was, "damaged_chunks": damaged, "lost_messages": nameless, "bytes": bytes, "bytes_before": whole})
        );
    } else {
        println!(
            "{}: {messages} messages over {span_s:.1} s, {bytes} bytes; {} was {was}, {whole} bytes",
            arguments.out.display(),
            arguments.file.display()
        );
        if let Some(lacks) = lacks(None, damaged, nameless) {
            eprintln!("{}: {lacks}", arguments.file.display());
        }
    }
    Ok(())
}
