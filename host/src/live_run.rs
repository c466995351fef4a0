//! Moves the frames of `skin run` and `skin replay` to pictures, whatever happens to the board meanwhile.

use crate::baselines::{Baselines, MOVED_SAID};
use crate::commands::Commands;
use crate::event::{Event, Said};
use crate::live_output::Output;
use crate::progress::Progress;
use crate::recordable::Recordable;
use crate::recorded::Notes;
use crate::replayed::Replayed;
use crate::run_arguments::ShowArguments;
use crate::run_session::passed_s;
use crate::say::say;
use crate::{recording_file, sheet};
use anyhow::Result;
use hil_sim::SimPort;
use inverse::live::{Live, LiveFrame};
use inverse::reference::baseline::Baseline;
use inverse::touches::gestures::Gestures;
use link::{ConnectionEvent, LinkNotices, MeasuredFrame, Session};
use protocol::{Watch, Watching};
use recording::Recorder;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use view::picture::BaselineNote;
use view::web::Command as PageCommand;

/// A frame that is older than others that wait by so much is not shown any more, s of the board's time: more than an adapter holds
/// back and hands over at once (16 ms), less than the eye sees.
pub(crate) const LAG_S: f64 = 0.05;
/// A board that says nothing for so long is gone: its port is opened anew.
pub(crate) const SILENCE: Duration = Duration::from_secs(3);

/// Memory for frames that wait where every frame is to be shown, bytes; docs/reliability.md says for how long.
pub(crate) const HELD: usize = 64 << 20;

/// A session that shows its pictures.
pub(crate) struct Run<'a> {
    pub(crate) show: &'a ShowArguments,
    /// End after so long, s of the board's time since the first picture.
    pub(crate) seconds: Option<f64>,
    pub(crate) every_frame: bool,
    pub(crate) session: &'a Session,
    pub(crate) live: &'a mut Live,
    pub(crate) gestures: Gestures,
    /// What is run when a touch does something.
    pub(crate) commands: Commands,
    pub(crate) output: &'a mut Output,
    pub(crate) baselines: &'a mut Baselines,
    pub(crate) watch: Option<Watch>,
    /// The simulated skin, until its scene is shown.
    pub(crate) held: Option<SimPort>,
    /// Frames that a baseline still wants; none while no baseline is taken.
    pub(crate) wanted: Option<usize>,
    /// Whether a baseline renews itself where something has gone: not after an earlier one was wanted back.
    pub(crate) renews: bool,
    /// What is recorded of it, and by whom.
    pub(crate) notes: Option<Notes>,
    pub(crate) recorder: Option<Recorder>,
    /// What became of the first recording that somebody ended at the page and that is not complete.
    pub(crate) not_recorded: Result<()>,
    /// What recordings from the page begin with; none in a replay.
    pub(crate) recordable: Option<Recordable>,
    /// A recording that is played.
    pub(crate) replayed: Option<Replayed>,
}

impl Run<'_> {
    /// Frames to pictures, until somebody ends it.
    ///
    /// # Errors
    /// The board stopped with an error, or what is shown cannot be.
    pub(crate) fn pump(&mut self, stop: &AtomicBool) -> Result<()> {
        let mut pictures = 0;
        let mut notices = LinkNotices::default();
        let mut last: Option<MeasuredFrame> = None;
        // The board's time since the first picture, s; after a reset it goes on.
        let mut shown_s = 0.0;
        if self.live.baseline().is_some() {
            self.show_newest();
            self.in_force()?;
        } else {
            self.wanted = Some(usize::MAX);
        }
        while !stop.load(Ordering::Relaxed)
            && self.show.frames.is_none_or(|n| pictures < n)
            && self.seconds.is_none_or(|s| shown_s < s)
        {
            self.go_on_recording();
            self.tell_recording();
            if let Some(command) = self.output.command() {
                self.obey(command)?;
            }
            if self.every_frame && self.session.link().was_full() {
                say!(
                    "warning: frames were lost, since all memory for those that wait is taken ({} MB): what reads the output, or this machine, is slower than the board",
                    HELD >> 20
                );
            }
            let frame = self.session.frame(Duration::from_millis(100))?;
            while let Some(event) = self.session.event() {
                self.happened(&Said::from(&event))?;
                if let ConnectionEvent::Restored { firmware, .. } = &event {
                    // What came before says nothing of what comes now.
                    notices = LinkNotices::default();
                    if firmware.is_some() {
                        say!(
                            "its values may differ a little: a new baseline is taken, do not touch; the page can undo it"
                        );
                        self.obey(PageCommand::Tare)?;
                    }
                }
            }
            while let Some(notice) = self.session.notice() {
                self.happened(&Said::from(&notice))?;
            }
            if self.session.is_away() {
                self.session.check_silence(SILENCE)?;
                continue;
            }
            let watched = matches!(self.session.watching(), Watching::Asleep | Watching::Learning);
            if !watched && let Some(notice) = notices.take(&self.session.link().counters(), frame.as_ref()) {
                self.happened(&Said::from(&notice))?;
            }
            let Some(frame) = frame else {
                if let (Watching::Asleep | Watching::Learning, Some(last)) = (self.session.watching(), &last) {
                    let status = Some("nothing touches: the board watches".to_owned());
                    self.output
                        .show_nothing(self.live.imager(), last, self.session.link().counters(), status)?;
                }
                self.session.check_silence(SILENCE)?;
                continue;
            };
            if self.is_before_the_scene(&frame) {
                continue;
            }
            self.begin_recording(frame.sequence)?;
            if self.take(&frame)? {
                if let Some(baseline) = self.live.rested().filter(|_| self.renews) {
                    say!(
                        "what lay on the sheet in the baseline has gone, and nothing touches: a new baseline is in force; the page can undo it"
                    );
                    self.renew(baseline)?;
                }
                pictures += 1;
                // What came before the first picture is no part: the baseline, and what passed while that was looked into.
                if let Some(last) = last.as_ref().filter(|_| pictures > 1) {
                    shown_s += passed_s(last.time_s, frame.time_s, self.session.frame_s());
                }
            }
            last = Some(frame);
        }
        Ok(())
    }

    /// Tells what happened to the line, now or in the recording that is played, and records it.
    ///
    /// # Errors
    /// Nobody reads it.
    pub(crate) fn happened(&mut self, said: &Said) -> Result<()> {
        if matches!(said.event, Event::BoardAway { .. }) {
            self.live.gap();
        }
        if let Some(notes) = &self.notes {
            notes.event(said);
        }
        self.output.event(said)
    }

    /// A new baseline is taken from now on.
    ///
    /// # Errors
    /// Nobody reads that it is.
    pub(crate) fn begin_baseline(&mut self) -> Result<()> {
        self.live.tare();
        self.output.event(&Said::baseline_begun())
    }

    /// Says what became of it, and closes what is open.
    ///
    /// # Errors
    /// Why it ended, or what cannot be written.
    pub(crate) fn end(mut self, outcome: Result<()>) -> Result<()> {
        let counters = self.session.link().counters();
        tracing::info!("{counters:?}");
        if counters.skipped_frames > 0 {
            say!(
                "{} of {} frames were passed over for newer ones: they came faster than this machine could reconstruct them, or while it prepared the model",
                counters.skipped_frames,
                counters.frames
            );
        }
        self.output.end_status();
        self.commands.say();
        let recorded = self.recorder.take().map_or(Ok(()), recording_file::finish);
        let png = self.show.png.as_deref();
        let written = png.map_or(Ok(()), |path| self.output.write_png(path));
        // Why it ended comes first.
        outcome.and(self.not_recorded).and(recorded).and(written)
    }

    /// What somebody at the page asks for.
    fn obey(&mut self, command: PageCommand) -> Result<()> {
        // A baseline is made of frames, all of them; and the board's watch has learned another one.
        match command {
            PageCommand::Tare => {
                self.session.set_watch(None);
                self.session.keep_all();
                self.begin_baseline()?;
                if let Some(notes) = &self.notes {
                    notes.tare();
                }
                self.output.set_baseline(self.baselines.note(true));
                self.wanted = Some(usize::MAX);
                self.renews = true;
            }
            PageCommand::UndoBaseline => {
                let taking = self.wanted.is_some();
                if let Some(baseline) = self.baselines.undo(taking) {
                    self.session.set_watch(None);
                    if self.watch.is_some() {
                        say!("the board does not watch until a new baseline is taken");
                    }
                    self.wanted = None;
                    // It was wanted back: it stays until somebody asks for another.
                    self.renews = false;
                    if let Some(notes) = &self.notes {
                        notes.resume(&baseline, None);
                    }
                    self.live.resume(baseline)?;
                    self.show_newest();
                    self.in_force()?;
                }
            }
            PageCommand::StartRecording => self.start_recording(),
            PageCommand::StopRecording => self.stop_recording(),
            // Of a guided calibration, which this is not.
            PageCommand::RepeatPress | PageCommand::SkipPress => {}
            // A board cannot go back; the page of one does not ask.
            PageCommand::Seek { .. } | PageCommand::Pause | PageCommand::Play => {}
        }
        Ok(())
    }

    /// Puts a baseline in force that frames at rest made.
    fn renew(&mut self, baseline: Baseline) -> Result<()> {
        if let Some(notes) = &self.notes {
            notes.resume(&baseline, None);
        }
        // Frames are not to pile up meanwhile.
        self.show_newest();
        let told = Progress::new("inspecting the baseline");
        self.live.resume(baseline.clone())?;
        drop(told);
        self.baselines.taken(baseline);
        // Nothing touches: the board learns its own.
        self.session.set_watch(self.watch.clone());
        self.in_force()
    }

    /// Whether a frame was measured before the simulated skin's scene began. The pictures begin with the scene.
    fn is_before_the_scene(&mut self, frame: &MeasuredFrame) -> bool {
        let Some(held) = &self.held else { return false };
        if self.wanted.is_some() {
            return false;
        }
        let before = held.scene_began_s().is_none_or(|began_s| frame.time_s < began_s);
        if !before {
            self.held = None;
        }
        before
    }

    /// Puts a frame into the baseline, or shows its picture; whether it was a picture.
    pub(crate) fn take(&mut self, frame: &MeasuredFrame) -> Result<bool> {
        if self.wanted == Some(1) {
            // It is the last one, and none can be passed over any more. What follows here takes a while: frames are not to
            // pile up, and the board learns its own baseline meanwhile.
            self.show_newest();
            if let Some(watch) = &self.watch {
                self.session.set_watch(Some(watch.clone()));
            }
        }
        let mut counters = self.session.link().counters();
        let imager = Arc::clone(self.live.imager());
        let began = Instant::now();
        // The last frame of a baseline makes all that depends on it.
        let told = (self.wanted == Some(1)).then(|| Progress::new("inspecting the baseline"));
        let taken = self.live.frame(frame.time_s, &frame.values_v);
        drop(told);
        self.output.solved_in(began.elapsed());
        match taken? {
            LiveFrame::Baseline { left, again } => {
                if again {
                    // Frames are not to be passed over, and what the board learned meanwhile is none of the sheet at rest.
                    self.session.set_watch(None);
                    self.session.keep_all();
                    say!("{MOVED_SAID}");
                }
                self.wanted = Some(left).filter(|left| *left > 0);
                if let Some(notes) = &self.notes {
                    notes.baseline_frame(frame, left);
                }
                self.output.show_preparing(self.live.imager(), frame, counters, left)?;
                if let (0, Some(baseline)) = (left, self.live.baseline()) {
                    if self.replayed.is_none() {
                        self.baselines.taken(baseline.clone());
                    }
                    self.in_force()?;
                }
                Ok(false)
            }
            LiveFrame::Picture(result) => {
                let events = self.gestures.update(frame.time_s, &result.touches);
                if let Some(replayed) = &mut self.replayed {
                    replayed.compare(result, events, &mut counters)?;
                }
                // Touches and what they did go out first: they need no picture.
                self.output.tell(result, frame, counters, events)?;
                self.commands.run(events);
                if let Some(notes) = &mut self.notes {
                    notes.picture(result, frame, counters, events);
                }
                let shown = if self.output.wants_picture(result, frame) {
                    self.live.picture()
                } else {
                    Some(result)
                };
                if let Some(result) = shown {
                    self.output.show_picture(&imager, result, frame, counters, events)?;
                }
                if let Some(notes) = &mut self.notes {
                    notes.preview(self.output.shown());
                }
                Ok(true)
            }
        }
    }

    /// From now on the newest frame counts, unless every frame is asked for.
    fn show_newest(&self) {
        if !self.every_frame {
            self.session.skip_over(LAG_S);
        }
    }

    /// A baseline is in force: it is told which, and a scene that waits for it begins.
    ///
    /// # Errors
    /// Nobody reads it.
    pub(crate) fn in_force(&mut self) -> Result<()> {
        let note = self.baselines.note(false);
        if self.replayed.is_none() {
            self.in_force_as(note.clone())?;
        }
        if let Some(inspection) = self.live.inspection() {
            sheet::say(inspection);
            self.output.left_out(inspection);
            if let Some(notes) = &mut self.notes {
                notes.in_force(note, inspection.left_out().cloned().collect());
            }
        }
        if let Some(held) = &self.held {
            held.begin_scene();
        }
        Ok(())
    }

    /// Tells what is said of the baseline in force.
    ///
    /// # Errors
    /// Nobody reads it.
    pub(crate) fn in_force_as(&mut self, note: Option<BaselineNote>) -> Result<()> {
        let stored = note.as_ref().is_some_and(|n| n.stored);
        self.output.set_baseline(note);
        self.output.event(&Said::baseline_in_force(stored))
    }
}
