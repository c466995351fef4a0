//! Several skins in one process: a thread and a name for each, one page, one recording.

use crate::ending;
use crate::page::pages;
use crate::recording_file::{self, RecordTo};
use crate::ros2;
use crate::run_arguments::SourceArguments;
use crate::run_session::{Outputs, Ran, Within, one};
use crate::say::{self, say};
use crate::skin_file::{self, SkinsRecord};
use crate::thread_load::Load;
use crate::usage::Usage;
use anyhow::{Context, Result, anyhow};
use recording::Recorder;
use std::path::Path;
use std::sync::Arc;
use std::thread::ScopedJoinHandle;
use std::time::Duration;

/// The recorder is asked so often whether it still records.
const LOOK: Duration = Duration::from_millis(100);

/// All skins of a file at once. One that fails is said at once, and the others go on.
///
/// # Errors
/// The file cannot be understood, the page or the recording not be begun, or why the first of the skins failed.
pub(crate) fn live(file: &Path, arguments: &SourceArguments, outputs: &Outputs<'_>) -> Result<()> {
    if outputs.show.png.is_some() {
        let why = "--png is for one skin; the page of each saves its picture";
        return Err(Usage(why.to_owned()).into());
    }
    let skins = skin_file::read(file)?;
    let of_each: Vec<SourceArguments> = skins
        .iter()
        .map(|skin| skin.arguments(arguments).with_context(|| skin.name.clone()))
        .collect::<Result<_>>()?;
    let stop = ending::flag()?;
    let ros = ros2::start(outputs.show)?;
    let mut recorder = outputs
        .record
        .map(|to| RecordTo::new(to)?.begin_several(&SkinsRecord::of(&skins)))
        .transpose()?;
    let names: Vec<&str> = skins.iter().map(|skin| skin.name.as_str()).collect();
    let mut served = if outputs.page {
        pages(outputs.show, &names)?
    } else {
        Vec::new()
    }
    .into_iter();
    let outcome = std::thread::scope(|scope| {
        let (stop, ros) = (&*stop, ros.as_ref());
        let threads: Vec<ScopedJoinHandle<'_, Result<Ran>>> = skins
            .iter()
            .zip(&of_each)
            .map(|(skin, arguments)| {
                let within = Within {
                    stop,
                    recording: recorder.as_ref().map(|r| RecordTo::Skin(r.tap().named(&skin.name))),
                    skin: Some(skin),
                    page: served.next(),
                    ros,
                };
                let run = move || {
                    say::set_skin(Some(Arc::from(skin.name.as_str())));
                    let outcome = one(arguments, outputs, within);
                    if let Err(why) = &outcome {
                        say!("warning: {why:#}; the other skins go on");
                    }
                    outcome.with_context(|| skin.name.clone())
                };
                Ok(std::thread::Builder::new()
                    .name(skin.name.clone())
                    .spawn_scoped(scope, run)?)
            })
            .collect::<Result<_>>()?;
        let mut load = Load::default();
        while !threads.iter().all(ScopedJoinHandle::is_finished) {
            std::thread::sleep(LOOK);
            load.look();
            if let Some(why) = recorder.as_mut().and_then(Recorder::failure) {
                say!("warning: {why}; the pictures go on");
            }
        }
        let ended = threads.into_iter().map(|thread| match thread.join() {
            Ok(outcome) => outcome,
            Err(_) => Err(anyhow!("the thread of a skin ended badly")),
        });
        let (ran, failed): (Vec<_>, Vec<_>) = ended.partition(Result::is_ok);
        let ran: Vec<Ran> = ran.into_iter().flatten().collect();
        say_sum(&ran, &load);
        // The first failure of all.
        failed.into_iter().find_map(Result::err).map_or(Ok(()), Err)
    });
    outcome.and(recorder.take().map_or(Ok(()), recording_file::finish))
}

/// Says what all skins together came to, and what it cost.
fn say_sum(ran: &[Ran], load: &Load) {
    let sum = |count: fn(&Ran) -> u64| ran.iter().map(count).sum::<u64>();
    // A simulated board that this machine cannot compute in time is slow, and loses nothing.
    let slowest = ran.iter().map(|r| r.board_s / r.host_s).fold(f64::INFINITY, f64::min);
    say!(
        "{} skins: {} frames, {} lost, {} passed over for newer ones; the slowest board's second took {:.2} s{load}",
        ran.len(),
        sum(|r| r.counters.frames),
        sum(|r| r.counters.lost_frames),
        sum(|r| r.counters.skipped_frames),
        slowest.recip()
    );
}
