//! The recording of `skin run`: begun with the session by `--record`, or at the page, as often as somebody asks.

use crate::live_run::Run;
use crate::recorded::{Notes, Touching};
use crate::recording_file::{self, RecordTo};
use crate::say::{self, say};
use anyhow::{Result, anyhow, bail};
use inverse::live::Live;
use recording::Recorder;
use std::time::Instant;
use view::web::Recording as Shown;

impl Run<'_> {
    /// Tells the page and the terminal what is recorded, and says why nothing is any more.
    pub(crate) fn tell_recording(&mut self) {
        let counts = self.recorder.as_ref().map(Recorder::counts);
        self.output.set_recorded(counts);
        let failure = self.recorder.as_mut().and_then(Recorder::failure);
        if let Some(why) = &failure {
            say!("warning: {why}; the picture goes on");
        }
        let Some(recordable) = &mut self.recordable else { return };
        recordable.note = failure.or(recordable.note.take());
        let seconds = recordable.since.elapsed().as_secs();
        self.output.set_recording(Shown {
            file: self.recorder.as_ref().map(|recorder| recorder.file().to_owned()),
            bytes: counts.map_or(0, |counts| counts.file_bytes),
            seconds: self.recorder.as_ref().map_or(0, |_| seconds),
            note: recordable.note.clone(),
        });
    }

    /// Begins to record, as soon as there is a reconstruction that begins with the recording; the page is told where it cannot be.
    pub(crate) fn start_recording(&mut self) {
        if self.recorder.is_some() || self.recordable.as_ref().is_some_and(|r| r.made.is_some()) {
            return;
        }
        match self.prepare_recording() {
            Ok(()) => self.note_recording(Some("the recording begins in a moment".to_owned())),
            Err(why) => self.say_of_recording(Err(why)),
        }
    }

    fn say_of_recording(&mut self, outcome: Result<()>) {
        let note = outcome.err().map(|why| format!("not recorded: {why:#}"));
        if let Some(note) = &note {
            say!("warning: {note}");
        }
        self.note_recording(note);
    }

    /// Why nothing can be recorded now.
    fn may_record(&self) -> Result<()> {
        if self.notes.is_some() {
            bail!("all skins are recorded into one file already, by --record");
        }
        if self.wanted.is_some() || self.live.baseline().is_none() {
            bail!("the baseline is being taken; ask again when it is there");
        }
        if self.session.is_away() {
            bail!("the board is away; ask again when it is back");
        }
        Ok(())
    }

    /// A replay begins with a reconstruction that has seen no frame, so that of the recording begins so, too. To make it takes a while.
    fn prepare_recording(&mut self) -> Result<()> {
        self.may_record()?;
        let Some(recordable) = &mut self.recordable else {
            bail!("a replay is not recorded: what it shows is in its file");
        };
        let (mut anew, baseline) = (self.live.anew(), self.live.baseline().cloned());
        let make = move || {
            if let Some(baseline) = baseline {
                anew.resume(baseline)?;
            }
            Ok(anew)
        };
        let thread = std::thread::Builder::new().name("recordable".to_owned());
        recordable.made = Some(thread.spawn(make)?);
        Ok(())
    }

    /// Goes on with a recording that was asked for, once its reconstruction is made.
    pub(crate) fn go_on_recording(&mut self) {
        let made = self
            .recordable
            .as_mut()
            .and_then(|r| r.made.take_if(|made| made.is_finished()));
        if let Some(made) = made {
            let outcome = made
                .join()
                .map_err(|_| anyhow!("the reconstruction cannot be made"))
                .and_then(|live| self.try_to_record(live?));
            self.say_of_recording(outcome);
        }
    }

    /// From the next frame on that comes by the port.
    fn try_to_record(&mut self, anew: Live) -> Result<()> {
        self.may_record()?;
        let Some(recordable) = &mut self.recordable else {
            return Ok(());
        };
        let to = RecordTo::new(None)?;
        let tap = to.tap().clone();
        recordable.record.started_unix_s = tap.clock().started_unix_s();
        let recorder = to.begin(&recordable.record)?;
        tap.introduce(self.session.hello(), self.session.plan())?;
        recordable.switch.set(Some(tap.clone()));
        recordable.since = Instant::now();
        recordable.begins = Some((tap, anew));
        self.recorder = recorder;
        Ok(())
    }

    /// Begins with the steps of a recording that was asked for, if this frame is in it and no baseline is being taken.
    ///
    /// # Errors
    /// The baseline in force cannot be put in force, or nobody reads that it is.
    pub(crate) fn begin_recording(&mut self, sequence: u32) -> Result<()> {
        if self.wanted.is_some() {
            return Ok(());
        }
        let Some(recordable) = &mut self.recordable else {
            return Ok(());
        };
        let Some((tap, mut anew)) = recordable.begins.take_if(|(tap, _)| tap.has(sequence)) else {
            return Ok(());
        };
        let Some(baseline) = self.live.baseline().cloned() else {
            return Ok(());
        };
        let notes = Notes::new(tap, &recordable.record);
        // Another one may have been taken since it was made.
        if !anew.baseline().is_some_and(|of| of.is_same(&baseline)) {
            anew = anew.anew();
            anew.resume(baseline.clone())?;
        }
        let touching = Touching {
            numbered: self.live.numbered(),
            gestures: self.gestures.clone(),
        };
        anew.go_on(touching.numbered.clone());
        notes.resume(&baseline, Some(touching));
        *self.live = anew;
        self.notes = Some(notes);
        self.in_force()
    }

    /// Closes the recording.
    pub(crate) fn stop_recording(&mut self) {
        if let Some(recordable) = &mut self.recordable {
            recordable.made = None;
        }
        let Some(recorder) = self.recorder.take() else { return };
        if let Some(recordable) = &mut self.recordable {
            recordable.switch.set(None);
            recordable.begins = None;
        }
        self.notes = None;
        let file = recorder.file().to_owned();
        let note = match recording_file::finish(recorder) {
            Ok(()) => format!("recorded: {file}"),
            Err(why) => {
                say!("warning: {why:#}");
                let note = format!("{file}: {why:#}");
                // The program goes on, and its exit code will tell.
                if self.not_recorded.is_ok() {
                    self.not_recorded = Err(why);
                }
                note
            }
        };
        say::record_no_more();
        self.note_recording(Some(note));
    }

    fn note_recording(&mut self, note: Option<String>) {
        if let Some(recordable) = &mut self.recordable {
            recordable.note = note;
        }
        self.tell_recording();
    }
}
