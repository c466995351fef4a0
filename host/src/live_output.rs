//! What `skin run` shows: the page, JSON lines, the line on the terminal, doubts.

use crate::files::baseline_file::unix_s;
use crate::recorded::pressed;
use crate::say::say;
use anyhow::{Context, Result};
use inverse::pipeline::FrameResult;
use inverse::quality::doubt::Doubt;
use inverse::reference::diagnosis::Fault;
use inverse::reference::drift::Drift;
use inverse::reference::imager::Imager;
use inverse::reference::inspection::Inspection;
use inverse::reference::screening::{Finding, FindingKind};
use inverse::touches::touch::Touch;
use link::{LinkCounters, LinkNotice, MeasuredFrame};
use recording::Counts;
use serde::Serialize;
use std::collections::VecDeque;
use std::io::{IsTerminal, Write};
use std::mem::Discriminant;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};
use view::picture::{BaselineNote, Picture, Stats};
use view::png;
use view::surface::Surface;
use view::web::{Command, LiveView};

/// A doubt that lasts is said again after so long.
const SAID_AGAIN: Duration = Duration::from_secs(10);
/// What is said of the line is shown for so long.
const LINE_SHOWN: Duration = Duration::from_secs(1);

#[derive(Serialize)]
struct Line<'a> {
    frame: u32,
    time_s: f64,
    touches: Vec<&'a Touch>,
    residual: f64,
    gap: f64,
    solve_us: f64,
    lost_frames: u64,
    /// Passed over so far for newer ones.
    skipped_frames: u64,
    /// What the frames are compared with.
    #[serde(skip_serializing_if = "Option::is_none")]
    baseline: Option<BaselineLine<'a>>,
    /// What speaks against the touches.
    #[serde(skip_serializing_if = "Option::is_none")]
    doubt: Option<Doubt>,
    /// What is broken on the board or at its wires.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    faults: &'a [Fault],
    /// What was lost on the line within the last second.
    #[serde(skip_serializing_if = "Option::is_none")]
    line: Option<&'a str>,
    /// What drifted since the baseline.
    #[serde(skip_serializing_if = "Drift::is_none")]
    drift: &'a Drift,
    /// What is left out of all frames, since it is wrong in the baseline.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    left_out: &'a [Finding],
}

/// The baseline in force.
#[derive(Serialize)]
struct BaselineLine<'a> {
    age_s: f64,
    /// Whether it was not taken now, but stored.
    stored: bool,
    /// What speaks against it.
    #[serde(skip_serializing_if = "Option::is_none")]
    warning: Option<&'a str>,
}

impl<'a> BaselineLine<'a> {
    fn of(note: &'a BaselineNote, now_unix_s: f64) -> Self {
        Self {
            // In whole seconds: the system's clock is no more certain.
            age_s: (now_unix_s - note.taken_unix_s).max(0.0).floor(),
            stored: note.stored,
            warning: note.warning.as_deref(),
        }
    }
}

/// Where pictures go, with what was shown before.
pub(crate) struct Output {
    page: Option<LiveView>,
    /// Whether a JSON line is printed for every picture.
    json: bool,
    /// What time it is, s since 1970, in a recording that is played.
    now_unix_s: Option<f64>,
    source: String,
    baseline: Option<BaselineNote>,
    last: Option<Arc<Picture>>,
    /// Of the imager that it was asked of.
    surface: Option<(Arc<Imager>, Surface)>,
    times: VecDeque<f64>,
    /// The line on the terminal, and since when.
    said: String,
    said_at: Instant,
    /// What is left out of the baseline.
    left_out: Vec<Finding>,
    /// What is recorded so far.
    recorded: Option<Counts>,
    /// The kind of doubt that was said last, and when.
    doubted: Option<(Discriminant<Doubt>, Instant)>,
    /// What is broken, as it was said last, and when.
    faults: Vec<Fault>,
    faults_said: Instant,
    /// What was said of the line last, and when.
    line: Option<(String, Instant)>,
    /// When a drift was said last.
    drifted: Option<Instant>,
}

/// A picture that does not change is drawn again after so long.
const REDRAW_S: f64 = 0.25;

impl Output {
    /// To a page, as JSON lines, or to the terminal alone; `source` names the board.
    pub(crate) fn new(page: Option<LiveView>, json: bool, source: String) -> Self {
        Self {
            page,
            json,
            now_unix_s: None,
            source,
            baseline: None,
            last: None,
            surface: None,
            times: VecDeque::new(),
            said: String::new(),
            said_at: Instant::now(),
            left_out: Vec::new(),
            recorded: None,
            doubted: None,
            faults: Vec::new(),
            faults_said: Instant::now(),
            line: None,
            drifted: None,
        }
    }

    /// What the baseline was found to be worth: said with every picture from now on.
    pub(crate) fn left_out(&mut self, inspection: &Inspection) {
        self.left_out = inspection.left_out().cloned().collect();
    }

    /// What somebody at the page asked for.
    pub(crate) fn command(&self) -> Option<Command> {
        self.page.as_ref().and_then(LiveView::command)
    }

    /// A recording is played, and it is this time in it, s since 1970.
    pub(crate) fn set_now(&mut self, unix_s: f64) {
        self.now_unix_s = Some(unix_s);
    }

    /// What is shown.
    pub(crate) fn shown(&self) -> Option<&Arc<Picture>> {
        self.last.as_ref()
    }

    /// What is recorded so far, for the line on the terminal.
    pub(crate) fn set_recorded(&mut self, counts: Counts) {
        self.recorded = Some(counts);
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

    /// Shows a picture on all there is, and says what speaks against it.
    pub(crate) fn show_picture(
        &mut self,
        imager: &Arc<Imager>,
        result: &FrameResult,
        frame: &MeasuredFrame,
        counters: LinkCounters,
    ) -> Result<()> {
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
        let notice = result.notice();
        if let Some(notice) = notice
            && self.drifted.is_none_or(|at| at.elapsed() > SAID_AGAIN)
        {
            say!("notice: frame {}: {notice}", frame.sequence);
            self.drifted = Some(Instant::now());
        }
        let line = self.line_text();
        let status = result.doubt.map(|d| d.to_string());
        let status = status
            .or_else(|| result.faults.first().map(ToString::to_string))
            .or_else(|| line.clone());
        let status = status.or_else(|| notice.map(|n| n.to_string()));
        self.show(imager, result, frame, counters, status)?;
        if self.json {
            let now_unix_s = self.now_unix_s.unwrap_or_else(|| unix_s(SystemTime::now()));
            let baseline = self.baseline.as_ref().map(|note| BaselineLine::of(note, now_unix_s));
            return print(result, frame, counters, baseline, (&self.left_out, line.as_deref()));
        }
        self.status(result);
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

    /// Says something of the line.
    pub(crate) fn say_line(&mut self, notice: LinkNotice) {
        self.end_status();
        say!("warning: {notice}");
        self.line = Some((notice.to_string(), Instant::now()));
    }

    /// What was said of the line a moment ago.
    fn line_text(&self) -> Option<String> {
        let (text, _) = self.line.as_ref().filter(|(_, at)| at.elapsed() < LINE_SHOWN)?;
        Some(text.clone())
    }

    /// Electrodes that are broken, now or in the baseline, from 0.
    fn faulty(&self, result: &FrameResult) -> Vec<usize> {
        let dead = [FindingKind::Electrode, FindingKind::ElectrodeElsewhere];
        let findings = self.left_out.iter().filter(|f| dead.contains(&f.kind));
        let mut out: Vec<usize> = findings.flat_map(|f| f.electrodes.iter().map(|l| l - 1)).collect();
        result
            .faults
            .iter()
            .for_each(|fault| out.extend(fault.electrodes().list()));
        out.sort_unstable();
        out.dedup();
        out
    }

    /// The board's name, with how many values of the baseline are left out.
    fn source_text(&self) -> String {
        match self.left_out.iter().map(|f| f.values).sum::<usize>() {
            0 => self.source.clone(),
            values => format!("{}, {values} values left out", self.source),
        }
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
            solve_us: result.changed.then_some(result.solve_us as f32),
            residual: result.changed.then_some(result.residual as f32),
            lost_frames: counters.lost_frames,
            skipped_frames: counters.skipped_frames,
            source: self.source_text(),
            baseline: self.baseline.clone(),
            faulty: self.faulty(result),
            status,
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
        if let Some(page) = &self.page {
            page.publish(Arc::clone(&picture))?;
        }
        self.last = Some(picture);
        Ok(())
    }

    /// A line on the terminal, written anew at most twice a second, when it says something else.
    fn status(&mut self, result: &FrameResult) {
        if !std::io::stderr().is_terminal() || self.said_at.elapsed() < Duration::from_millis(500) {
            return;
        }
        self.said_at = Instant::now();
        let list: Vec<String> = result
            .touches
            .iter()
            .filter(|t| t.is_pressed())
            .map(|t| {
                let force = t.force_n.map_or(String::new(), |f| format!(" {f:.1} N"));
                format!("({:.0}, {:.0}) mm {:+.0} %{force}", t.x_mm, t.y_mm, 100.0 * t.rise)
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
        if text != self.said {
            eprint!("\r\x1b[K{text}");
            self.said = text;
        }
    }
}

/// One JSON object on stdout.
fn print(
    result: &FrameResult,
    frame: &MeasuredFrame,
    counters: LinkCounters,
    baseline: Option<BaselineLine<'_>>,
    (left_out, line): (&[Finding], Option<&str>),
) -> Result<()> {
    let mut out = std::io::stdout().lock();
    let line = Line {
        frame: frame.sequence,
        time_s: frame.time_s,
        touches: pressed(result),
        residual: result.residual,
        gap: result.gap,
        solve_us: result.solve_us,
        lost_frames: counters.lost_frames,
        skipped_frames: counters.skipped_frames,
        baseline,
        doubt: result.doubt,
        faults: &result.faults,
        line,
        drift: &result.drift,
        left_out,
    };
    serde_json::to_writer(&mut out, &line)?;
    writeln!(out)?;
    Ok(())
}
