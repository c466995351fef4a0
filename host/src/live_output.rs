//! What `skin run` shows: the page, JSON lines, the line on the terminal, doubts.

use crate::event::{Event, Said};
use crate::files::baseline_file::unix_s;
use crate::json_lines::{self, Beside};
use crate::progress;
use crate::recorded::{SessionRecord, pressed};
use crate::ros2::Node;
use crate::run_arguments::ShowArguments;
use crate::say::{self, say};
use crate::skin_file::Place;
use ::forward::CellGrid;
use anyhow::{Context, Result};
use inverse::pipeline::FrameResult;
use inverse::quality::doubt::Doubt;
use inverse::reference::diagnosis::Fault;
use inverse::reference::imager::Imager;
use inverse::reference::inspection::Inspection;
use inverse::reference::screening::{Finding, FindingKind};
use inverse::touches::gestures::TouchEvent;
use inverse::touches::touch::Touch;
use link::{LinkCounters, MeasuredFrame, Session};
use recording::Counts;
use std::collections::VecDeque;
use std::mem::Discriminant;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};
use view::labels;
use view::picture::{BaselineNote, Picture, Stats};
use view::png;
use view::surface::Surface;
use view::web::{Command, LiveView, Recording, Replay};

/// A doubt that lasts is said again after so long.
const SAID_AGAIN: Duration = Duration::from_secs(10);
/// What is said of the line is shown for so long, s of the board's time.
const LINE_SHOWN_S: f64 = 1.0;

/// Where pictures go, with what was shown before.
pub(crate) struct Output {
    page: Option<LiveView>,
    /// The skin as a node of ROS 2.
    node: Option<Node>,
    /// Whether a JSON line is printed for every picture, and every cell in it.
    json: bool,
    cells: bool,
    /// What time it is, s since 1970, in a recording that is played.
    now_unix_s: Option<f64>,
    /// Whether forces are those of a typical rubber.
    uncalibrated: bool,
    source: String,
    /// Where the sheet is on the robot.
    place: Option<Place>,
    baseline: Option<BaselineNote>,
    /// Whether it is being taken.
    preparing: bool,
    last: Option<Arc<Picture>>,
    /// Of the imager that it was asked of.
    surface: Option<(Arc<Imager>, Surface)>,
    times: VecDeque<f64>,
    /// The line on the terminal, and since when.
    said: String,
    said_at: Instant,
    /// What is left out of the baseline.
    left_out: Vec<Finding>,
    /// Electrodes that were broken in the baseline, from 0.
    broken: Vec<usize>,
    /// What is recorded so far.
    recorded: Option<Counts>,
    /// The kind of doubt that was said last, and when.
    doubted: Option<(Discriminant<Doubt>, Instant)>,
    /// What is broken, as it was said last, and when.
    faults: Vec<Fault>,
    faults_said: Instant,
    /// What was said of the line last, and the board's time of the frame after it, s.
    line: Option<(String, Option<f64>)>,
    /// When a drift was said last.
    drifted: Option<Instant>,
    /// Time that the reconstruction of the last frame took.
    solved: Duration,
    /// What time it was when its touches were told, s since 1970: one for all outputs.
    told_unix_s: f64,
    /// When a source that is not what it was was said last.
    source_said: Option<Instant>,
}

/// A picture that does not change is drawn again after so long.
const REDRAW_S: f64 = 0.25;

impl Output {
    /// To a page, as JSON lines, or to the terminal alone; `source` names the board.
    pub(crate) fn new(page: Option<LiveView>, show: &ShowArguments, source: String) -> Self {
        Self {
            page,
            node: None,
            json: show.json,
            cells: show.cells,
            now_unix_s: None,
            uncalibrated: false,
            source,
            place: None,
            baseline: None,
            preparing: false,
            last: None,
            surface: None,
            times: VecDeque::new(),
            said: String::new(),
            said_at: Instant::now(),
            left_out: Vec::new(),
            broken: Vec::new(),
            recorded: None,
            doubted: None,
            solved: Duration::ZERO,
            told_unix_s: 0.0,
            faults: Vec::new(),
            faults_said: Instant::now(),
            line: None,
            drifted: None,
            source_said: None,
        }
    }

    /// From now on a node of ROS 2 is told, too.
    pub(crate) fn set_node(&mut self, node: Node) {
        self.node = Some(node);
    }

    /// What the baseline was found to be worth: said with every picture from now on.
    pub(crate) fn left_out(&mut self, inspection: &Inspection) {
        self.left_out = inspection.left_out().cloned().collect();
        let broken = [
            FindingKind::Electrode,
            FindingKind::ElectrodeElsewhere,
            FindingKind::Contact,
            FindingKind::Leak,
        ];
        let findings = inspection.findings.iter().filter(|f| broken.contains(&f.kind));
        self.broken = findings.flat_map(|f| f.electrodes.iter().map(|l| l - 1)).collect();
    }

    /// What somebody asked for at the page, or by ROS 2.
    pub(crate) fn command(&self) -> Option<Command> {
        let by_ros = self.node.as_ref().is_some_and(Node::wants_baseline);
        by_ros
            .then_some(Command::Tare)
            .or_else(|| self.page.as_ref().and_then(LiveView::command))
    }

    /// A recording is played, and it is this time in it, s since 1970.
    pub(crate) fn set_now(&mut self, unix_s: f64) {
        self.now_unix_s = Some(unix_s);
    }

    /// What comes next is shown in any case, as in the beginning.
    pub(crate) fn begin_anew(&mut self) {
        self.last = None;
        self.times.clear();
    }

    /// What is shown.
    pub(crate) fn shown(&self) -> Option<&Arc<Picture>> {
        self.last.as_ref()
    }

    /// What is recorded so far, for the line on the terminal; none while nothing is.
    pub(crate) fn set_recorded(&mut self, counts: Option<Counts>) {
        self.recorded = counts;
    }

    /// What the page shows of the recording.
    pub(crate) fn set_recording(&self, recording: Recording) {
        if let Some(page) = &self.page {
            page.set_recording(recording);
        }
    }

    /// What the page shows of a replay's place.
    pub(crate) fn set_replay(&self, replay: Replay) {
        if let Some(page) = &self.page {
            page.set_replay(replay);
        }
    }

    /// Whether somebody looks at the page.
    pub(crate) fn is_watched(&self) -> bool {
        self.page.as_ref().is_some_and(|page| page.clients() > 0)
    }

    /// Ends the line on the terminal, so that what is said next has one of its own.
    pub(crate) fn end_status(&mut self) {
        if !self.said.is_empty() {
            self.said.clear();
            eprintln!();
        }
    }

    /// Takes note of the baseline in force.
    pub(crate) fn set_baseline(&mut self, baseline: Option<BaselineNote>) {
        self.baseline = baseline;
    }

    /// Shows a frame that went into the baseline; so many more are wanted.
    pub(crate) fn show_preparing(
        &mut self,
        imager: &Arc<Imager>,
        frame: &MeasuredFrame,
        counters: LinkCounters,
        left: usize,
    ) -> Result<()> {
        self.preparing = left > 0;
        let status = self.preparing.then(|| "taking the baseline, do not touch".to_owned());
        self.show_nothing(imager, frame, counters, status)
    }

    /// Shows a frame in which nothing was looked for, and why.
    pub(crate) fn show_nothing(
        &mut self,
        imager: &Arc<Imager>,
        frame: &MeasuredFrame,
        counters: LinkCounters,
        status: Option<String>,
    ) -> Result<()> {
        self.show(imager, &FrameResult::nothing(imager), frame, counters, status)
    }

    /// Notes how long the reconstruction of a frame took.
    pub(crate) const fn solved_in(&mut self, took: Duration) {
        self.solved = took;
    }

    /// Tells the touches of a frame and what they did, and says what speaks against them. A line without cells goes out now.
    ///
    /// # Errors
    /// Nobody reads it.
    pub(crate) fn tell(
        &mut self,
        result: &FrameResult,
        frame: &MeasuredFrame,
        counters: LinkCounters,
        events: &[TouchEvent],
    ) -> Result<()> {
        self.preparing = false;
        self.told_unix_s = self.unix_s();
        if self.json && !self.cells {
            self.write_line(result, frame, counters, events)?;
        }
        self.say_faults(result, frame);
        // A fault is said already.
        if let Some(doubt) = result.doubt.filter(|doubt| !matches!(doubt, Doubt::Fault(_))) {
            let kind = std::mem::discriminant(&doubt);
            if self
                .doubted
                .is_none_or(|(last, at)| last != kind || at.elapsed() > SAID_AGAIN)
            {
                say!("warning: frame {}: {doubt}", frame.sequence);
                self.doubted = Some((kind, Instant::now()));
            }
        }
        if let Some(notice) = result.notice()
            && self.drifted.is_none_or(|at| at.elapsed() > SAID_AGAIN)
        {
            say!("notice: frame {}: {notice}", frame.sequence);
            self.drifted = Some(Instant::now());
        }
        Ok(())
    }

    /// Whether an output takes the reconstruction of a frame, and not only its touches.
    pub(crate) fn wants_picture(&self, result: &FrameResult, frame: &MeasuredFrame) -> bool {
        let by_ros = |node: &Node| node.wants_image(result, frame.time_s);
        (self.json && self.cells) || Surface::is_smoothed(result) || self.node.as_ref().is_some_and(by_ros)
    }

    /// Prints the line of a frame.
    fn write_line(
        &mut self,
        result: &FrameResult,
        frame: &MeasuredFrame,
        counters: LinkCounters,
        events: &[TouchEvent],
    ) -> Result<()> {
        let line = self.line_text(frame.time_s);
        let beside = Beside {
            cells: self.cells,
            events,
            unix_s: self.told_unix_s,
            baseline: self.baseline.as_ref(),
            line: line.as_deref(),
            left_out: &self.left_out,
            place: self.place.as_ref(),
        };
        json_lines::write(&json_lines::picture(result, frame, counters, &beside)?)
    }

    /// Shows what was told on all there is, and prints the line with its cells.
    ///
    /// # Errors
    /// Nobody reads it, or the page cannot be served.
    pub(crate) fn show_picture(
        &mut self,
        imager: &Arc<Imager>,
        result: &FrameResult,
        frame: &MeasuredFrame,
        counters: LinkCounters,
        events: &[TouchEvent],
    ) -> Result<()> {
        if self.json && self.cells {
            self.write_line(result, frame, counters, events)?;
        }
        let line = self.line_text(frame.time_s);
        let status = match result.doubt {
            // What is broken besides is said, too.
            None | Some(Doubt::Fault(_)) => faults_text(&result.faults).or_else(|| result.doubt.map(|d| d.to_string())),
            Some(doubt) => Some(doubt.to_string()),
        };
        let status = status.or_else(|| line.clone());
        let status = status.or_else(|| result.notice().map(|n| n.to_string()));
        self.show(imager, result, frame, counters, status)?;
        if let Some(node) = &mut self.node {
            let touches = pressed(result).into_iter().copied().collect();
            node.picture(self.told_unix_s, imager, result, frame, touches);
        }
        if !self.json {
            self.status(result);
        }
        Ok(())
    }

    /// Says what is broken when it is new, and again while it lasts.
    fn say_faults(&mut self, result: &FrameResult, frame: &MeasuredFrame) {
        let again = self.faults_said.elapsed() > SAID_AGAIN;
        let known = |fault: &Fault| self.faults.iter().any(|known| known.is_same(fault));
        let new: Vec<&Fault> = result.faults.iter().filter(|fault| again || !known(fault)).collect();
        for fault in &new {
            say!("warning: frame {}: {fault}", frame.sequence);
        }
        if !new.is_empty() {
            self.faults_said = Instant::now();
        }
        let over = |fault: &&Fault| !result.faults.iter().any(|now| now.is_same(fault));
        if self.faults.iter().any(|fault| over(&fault)) && result.faults.is_empty() {
            say!("notice: frame {}: nothing is broken any more", frame.sequence);
        }
        self.faults.clone_from(&result.faults);
    }

    /// What time it is, s since 1970: now, or in the recording that is played.
    fn unix_s(&self) -> f64 {
        self.now_unix_s.unwrap_or_else(|| unix_s(SystemTime::now()))
    }

    /// Begins with what is known before the first picture: the header of the JSON lines, where they are asked for.
    ///
    /// # Errors
    /// Nobody reads them.
    pub(crate) fn header(&mut self, session: &Session, record: &SessionRecord, grid: &CellGrid) -> Result<()> {
        self.uncalibrated = record.is_uncalibrated();
        self.place.clone_from(&record.place);
        if self.json {
            json_lines::header(session, record, self.cells.then_some(grid))?;
        }
        Ok(())
    }

    /// Tells what happened: on stderr where it is of the line, in JSON, and on the page.
    ///
    /// # Errors
    /// Nobody reads it.
    pub(crate) fn event(&mut self, said: &Said) -> Result<()> {
        let last_s = self.times.back().copied();
        if let Some(node) = &self.node {
            node.event(said);
        }
        if self.json {
            json_lines::event(said, last_s, self.unix_s())?;
        }
        if !said.is_of_line() {
            return Ok(());
        }
        // The board tells it every second.
        let again = match said.event {
            Event::SourceChanged { right: false, .. } => {
                let again = self.source_said.is_none_or(|at| at.elapsed() > SAID_AGAIN);
                if again {
                    self.source_said = Some(Instant::now());
                }
                again
            }
            Event::SourceChanged { right: true, .. } => {
                self.source_said = None;
                true
            }
            _ => true,
        };
        if !again {
            self.line = Some((said.text.clone(), None));
            return Ok(());
        }
        self.end_status();
        let level = if said.is_good() { "notice" } else { "warning" };
        say!("{level}: {}", said.text);
        match said.event {
            Event::BoardAway { .. } | Event::OtherBoard { .. } => self.show_away(Some(&said.text))?,
            Event::BoardBack { .. } => {
                // Rates are counted anew.
                self.times.clear();
                self.show_away(None)?;
            }
            _ => self.line = Some((said.text.clone(), None)),
        }
        Ok(())
    }

    /// Shows the last picture as one that is old, since the board is away, or no more.
    fn show_away(&mut self, why: Option<&str>) -> Result<()> {
        let Some(last) = &self.last else { return Ok(()) };
        let mut picture = Picture::clone(last);
        picture.stats.away = why.map(str::to_owned);
        picture.stats.frames_per_s = 0.0;
        let picture = Arc::new(picture);
        self.publish(picture)
    }

    /// Shows a picture on the page, and tells the node of it.
    fn publish(&mut self, picture: Arc<Picture>) -> Result<()> {
        if let Some(page) = &self.page {
            page.publish(Arc::clone(&picture))?;
        }
        if let Some(node) = &self.node {
            node.shown(&picture);
        }
        self.last = Some(picture);
        Ok(())
    }

    /// What was said of the line a moment ago.
    fn line_text(&mut self, now_s: f64) -> Option<String> {
        let (text, at) = self.line.as_mut()?;
        let shown_s = now_s - *at.get_or_insert(now_s);
        (0.0..LINE_SHOWN_S).contains(&shown_s).then(|| text.clone())
    }

    /// Electrodes that are broken, now or in the baseline, from 0.
    fn faulty(&self, result: &FrameResult) -> Vec<usize> {
        let mut out = self.broken.clone();
        result
            .faults
            .iter()
            .for_each(|fault| out.extend(fault.electrodes().list()));
        out.sort_unstable();
        out.dedup();
        out
    }

    /// The board's name, with how many values of the baseline are left out, and whether frames are searched for faults.
    fn source_text(&self) -> String {
        let mut text = self.source.clone();
        match self.left_out.iter().map(|f| f.values).sum::<usize>() {
            0 => {}
            values => text += &format!(", {values} values left out"),
        }
        if self.left_out.iter().any(|f| f.kind == FindingKind::Unsearched) {
            text += ", not searched for faults";
        }
        if self.left_out.iter().any(|f| f.kind == FindingKind::Ambiguous) {
            text += ", each touch may be at another place";
        }
        if self.left_out.iter().any(|f| f.kind == FindingKind::Moved) {
            text += ", the sheet moved while the baseline was taken";
        }
        for frames in self.left_out.iter().filter(|f| f.kind == FindingKind::Frames) {
            let part = 1.0 - frames.factor.unwrap_or(1.0);
            text += &format!(", {:.0} % of the baseline's frames left out", 100.0 * part);
        }
        if self.left_out.iter().any(|f| f.kind == FindingKind::Untold) {
            text += ", without what presses told of the sheet";
        }
        text
    }

    /// Writes the last picture.
    pub(crate) fn write_png(&self, path: &Path) -> Result<()> {
        let file = path.display();
        let picture = self.last.as_ref();
        let picture = picture.with_context(|| format!("{file}: not written, there was no picture yet"))?;
        png::write_png(picture, path).with_context(|| format!("{file}: cannot write the picture"))
    }

    fn show(
        &mut self,
        imager: &Arc<Imager>,
        result: &FrameResult,
        frame: &MeasuredFrame,
        counters: LinkCounters,
        status: Option<String>,
    ) -> Result<()> {
        if self.times.back().is_some_and(|last| frame.time_s < *last) {
            // The board was reset, and its clock with it.
            self.times.clear();
        }
        self.times.push_back(frame.time_s);
        while self.times.len() > 2 && frame.time_s - self.times[0] > 1.0 {
            self.times.pop_front();
        }
        let span = frame.time_s - self.times[0];
        let stats = Stats {
            frames_per_s: if span > 0.0 {
                ((self.times.len() - 1) as f64 / span) as f32
            } else {
                0.0
            },
            solve_us: result.changed.then_some(self.solved.as_secs_f32() * 1e6),
            residual: result.changed.then_some(result.residual as f32),
            lost_frames: counters.lost_frames,
            skipped_frames: counters.skipped_frames,
            source: self.source_text(),
            baseline: self.baseline.clone(),
            faulty: self.faulty(result),
            status,
            away: None,
            uncalibrated: self.uncalibrated,
            preparing: self.preparing,
            // The surface knows.
            smoothed: false,
        };
        // What shows nothing new is drawn only now and then, for the rates beside it.
        let old = !result.anew && stats.status.is_none();
        if old
            && self
                .last
                .as_ref()
                .is_some_and(|p| (0.0..REDRAW_S).contains(&(frame.time_s - p.time_s)))
        {
            return Ok(());
        }
        let surface = match &self.surface {
            Some((of, surface)) if Arc::ptr_eq(of, imager) => surface,
            _ => &self.surface.insert((Arc::clone(imager), Surface::of(imager)?)).1,
        };
        let mut picture = surface.picture(result, frame.sequence.into(), frame.time_s, stats);
        // A dent that somebody left is in the picture, but it is no touch.
        picture.touches.retain(Touch::is_pressed);
        let picture = Arc::new(picture);
        self.publish(picture)
    }

    /// A line on the terminal, written anew at most twice a second, when it says something else.
    fn status(&mut self, result: &FrameResult) {
        if progress::is_shown() {
            // It is written over this one.
            self.said.clear();
            return;
        }
        // The lines of several skins would overwrite one another.
        if say::skin().is_some()
            || !say::is_terminal(&std::io::stderr())
            || self.said_at.elapsed() < Duration::from_millis(500)
        {
            return;
        }
        self.said_at = Instant::now();
        let list: Vec<String> = result
            .touches
            .iter()
            .filter(|t| t.is_pressed())
            .map(|t| {
                let rise = labels::strength_text(t);
                format!("({:.0}, {:.0}) mm {rise}", t.x_mm, t.y_mm)
            })
            .collect();
        let mut text = if list.is_empty() {
            "no touch".to_owned()
        } else {
            list.join("   ")
        };
        if let Some(counts) = &self.recorded {
            let size_mb = counts.file_bytes as f64 / 1e6;
            text = format!("recorded {} frames, {size_mb:.1} MB   {text}", counts.frames);
        }
        let text = say::cut_to_terminal(&text);
        if text != self.said {
            eprint!("\r\x1b[K{text}");
            self.said = text;
        }
    }
}

/// What is broken, in one text; none where nothing is.
fn faults_text(faults: &[Fault]) -> Option<String> {
    let texts: Vec<String> = faults.iter().map(ToString::to_string).collect();
    (!texts.is_empty()).then(|| texts.join(". Also, "))
}
