//! `--on EVENT CMD`: commands that are run when a touch does something.
//!
//! A command is given to the shell as it was written. What the touch did is in its environment and nowhere in its text, so that no
//! value can be taken for a part of the command. Each has a thread of its own that starts it and waits for it; while it runs, further
//! events of its kind are counted and nothing is started. The pictures never wait.

use crate::say::{self, say};
use crate::skin_file::Place;
use crate::usage::Usage;
use anyhow::{Context, Result};
use inverse::touches::gestures::{Gesture, TouchEvent};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

/// That a command still runs is said again after so long.
const SAID_AGAIN: Duration = Duration::from_secs(10);

/// Commands, and what became of them.
#[derive(Default)]
pub(crate) struct Commands(Vec<On>);

struct On {
    gesture: Gesture,
    text: String,
    events: Sender<TouchEvent>,
    progress: Arc<Progress>,
    passed_over: u64,
    said: Option<Instant>,
}

#[derive(Default)]
struct Progress {
    busy: AtomicBool,
    started: AtomicU64,
    failed: AtomicU64,
}

impl Commands {
    /// Of what the command line says: events and commands in turn; the sheet is at this place on the robot.
    ///
    /// # Errors
    /// There is no such event; no thread for it.
    pub(crate) fn new(given: &[String], place: Option<&Place>) -> Result<Self> {
        let on = |pair: &[String]| On::new(&pair[0], &pair[1], place.cloned());
        Ok(Self(given.chunks_exact(2).map(on).collect::<Result<_>>()?))
    }

    /// Runs what is to be run, without waiting for anything.
    pub(crate) fn run(&mut self, events: &[TouchEvent]) {
        for event in events {
            self.0
                .iter_mut()
                .filter(|on| on.gesture == event.event)
                .for_each(|on| on.run(event));
        }
    }

    /// Says what became of them.
    pub(crate) fn say(&self) {
        for On {
            gesture,
            text,
            progress,
            passed_over,
            ..
        } in &self.0
        {
            let [started, failed] = [&progress.started, &progress.failed].map(|n| n.load(Ordering::Relaxed));
            let name = gesture.name();
            if *passed_over > 0 || failed > 0 {
                say!(
                    "warning: --on {name} {text}: started {started} times, failed {failed}, not started for {passed_over} events, since it still ran"
                );
            }
            if progress.busy.load(Ordering::Acquire) {
                say!("notice: --on {name} {text}: still runs, and is left running");
            }
        }
    }
}

impl On {
    fn new(name: &str, text: &str, place: Option<Place>) -> Result<Self> {
        let gesture = Gesture::ALL.into_iter().find(|g| g.name() == name);
        let names = || Gesture::ALL.map(Gesture::name).join(", ");
        let gesture = gesture.ok_or_else(|| Usage(format!("--on {name}: no such event; there are {}", names())))?;
        let progress = Arc::new(Progress::default());
        let (events, to_run) = channel();
        let (shared, command, skin) = (Arc::clone(&progress), text.to_owned(), say::skin());
        std::thread::Builder::new()
            .name(format!("on-{name}"))
            .spawn(move || {
                say::set_skin(skin);
                work(&to_run, &command, place.as_ref(), &shared);
            })
            .context("no thread for a command")?;
        Ok(Self {
            gesture,
            text: text.to_owned(),
            events,
            progress,
            passed_over: 0,
            said: None,
        })
    }

    fn run(&mut self, event: &TouchEvent) {
        if self.progress.busy.swap(true, Ordering::AcqRel) {
            self.passed_over += 1;
            if self.said.is_none_or(|at| at.elapsed() > SAID_AGAIN) {
                say!(
                    "warning: --on {} {}: still runs; {} events so far for which it was not started",
                    self.gesture.name(),
                    self.text,
                    self.passed_over
                );
                self.said = Some(Instant::now());
            }
            return;
        }
        // The thread ends with this program only.
        let _ = self.events.send(*event);
    }
}

/// Starts a command for every event, and waits for it.
fn work(events: &Receiver<TouchEvent>, text: &str, place: Option<&Place>, progress: &Progress) {
    for event in events {
        progress.started.fetch_add(1, Ordering::Relaxed);
        let why = match shell(text, &event, place).status() {
            Ok(status) if status.success() => None,
            Ok(status) => Some(status.to_string()),
            Err(error) => Some(error.to_string()),
        };
        if let Some(why) = why
            && progress.failed.fetch_add(1, Ordering::Relaxed) == 0
        {
            say!("warning: --on {} {text}: {why}; said once", event.event.name());
        }
        progress.busy.store(false, Ordering::Release);
    }
}

/// A command of the system's shell. Its output goes to stderr: on stdout are data.
fn shell(text: &str, event: &TouchEvent, place: Option<&Place>) -> Command {
    let mut command = shell_of(text);
    command.envs(environment(event, place));
    command.stdin(Stdio::null()).stdout(Stdio::from(std::io::stderr()));
    command
}

#[cfg(not(windows))]
fn shell_of(text: &str) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", text]);
    command
}

/// `cmd` knows no quotes but its own: with `/S` it takes off the first and the last one, and the text between is as it was typed.
#[cfg(windows)]
fn shell_of(text: &str) -> Command {
    use std::os::windows::process::CommandExt;
    let mut command = Command::new("cmd");
    command.args(["/S", "/C"]).raw_arg(format!("\"{text}\""));
    command
}

/// The environment that says what a touch did.
fn environment(event: &TouchEvent, place: Option<&Place>) -> Vec<(&'static str, String)> {
    let mut out = vec![
        ("SKIN_EVENT", event.event.name().to_owned()),
        ("SKIN_TOUCH", event.touch.to_string()),
    ];
    for (name, value, digits) in [
        ("SKIN_TIME_S", event.time_s, 6),
        ("SKIN_LATENCY_S", event.latency_s, 6),
        ("SKIN_X_MM", event.x_mm, 2),
        ("SKIN_Y_MM", event.y_mm, 2),
        ("SKIN_AREA_MM2", event.area_mm2, 1),
        ("SKIN_DURATION_S", event.duration_s, 6),
        ("SKIN_DISTANCE_MM", event.distance_mm, 2),
    ] {
        out.push((name, format!("{value:.digits$}")));
    }
    if let Some(place) = place {
        out.push(("SKIN_ROBOT_FRAME", place.frame.clone()));
        let names = ["SKIN_ROBOT_X_MM", "SKIN_ROBOT_Y_MM", "SKIN_ROBOT_Z_MM"];
        for (name, mm) in names.into_iter().zip(place.point_mm([event.x_mm, event.y_mm])) {
            out.push((name, format!("{mm:.2}")));
        }
    }
    if let Some(skin) = say::skin() {
        out.push(("SKIN_NAME", skin.to_string()));
    }
    if let Some(force_n) = event.force_n {
        out.push(("SKIN_FORCE_N", format!("{force_n:.2}")));
        out.push(("SKIN_UNCALIBRATED", u8::from(event.uncalibrated).to_string()));
    }
    out
}
