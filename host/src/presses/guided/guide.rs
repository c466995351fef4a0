//! What somebody who presses is shown and asked: on the terminal and on the page.

use super::arguments::Arguments;
use crate::page;
use crate::run_arguments::ShowArguments;
use crate::say::say;
use ::forward::{Geometry, Sheet};
use anyhow::Result;
use inverse::touches::touch::Touch;
use std::io::{BufRead, IsTerminal};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use view::picture::{Grid, Picture, Stats};
use view::web::{Command, Guide as Shown, LiveView};

/// Side of the cells of the empty picture, over the size of the sheet.
const CELLS: f64 = 1.0 / 40.0;
/// A picture is shown so often.
const EVERY: Duration = Duration::from_millis(50);
/// The last text has so long to reach the pages.
const LAST: Duration = Duration::from_millis(300);

/// What somebody wants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wish {
    /// The last press once more.
    Repeat,
    /// Not this mark.
    Skip,
    /// No more presses.
    Enough,
}

/// Shows and asks.
pub(super) struct Guide {
    page: Option<LiveView>,
    lines: Receiver<String>,
    shown: Shown,
    source: String,
    grid: Arc<Grid>,
    outline_mm: Arc<Vec<[f64; 2]>>,
    electrodes_mm: Arc<Vec<[f64; 2]>>,
    published: Option<Instant>,
    number: u64,
}

impl Guide {
    /// On a sheet; `count` presses are wanted.
    ///
    /// # Errors
    /// The page cannot be served.
    pub(super) fn new(
        arguments: &Arguments,
        sheet: &Sheet,
        source: String,
        count: usize,
        wants_page: bool,
    ) -> Result<Self> {
        let show = ShowArguments {
            listen: arguments.listen,
            no_open: arguments.no_open,
            ..ShowArguments::default()
        };
        let geometry = Geometry::new(sheet)?;
        let outline_mm = geometry.outline().polyline().to_vec();
        let (low, high) = geometry.bounding_box();
        let cell_mm = CELLS * (high[0] - low[0]).max(high[1] - low[1]);
        let (sender, lines) = channel();
        // Ends with its input, or with the program.
        std::thread::spawn(move || {
            for line in std::io::stdin().lock().lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        if std::io::stdin().is_terminal() {
            say!("keys, each with Enter: a presses the last mark again, n skips this mark, q ends here");
        }
        Ok(Self {
            page: wants_page.then(|| page::page(&show)).transpose()?,
            lines,
            shown: Shown {
                count,
                ..Shown::default()
            },
            source,
            grid: Arc::new(Grid::cover(&outline_mm, cell_mm)?),
            outline_mm: Arc::new(outline_mm),
            electrodes_mm: Arc::new(geometry.electrode_centres()),
            published: None,
            number: 0,
        })
    }

    /// What somebody asked for since the last look.
    pub(super) fn wish(&self) -> Option<Wish> {
        let of_page = self
            .page
            .as_ref()
            .and_then(LiveView::command)
            .and_then(|command| match command {
                Command::RepeatPress => Some(Wish::Repeat),
                Command::SkipPress => Some(Wish::Skip),
                _ => None,
            });
        of_page.or_else(|| match self.lines.try_recv().ok()?.trim() {
            "a" | "A" => Some(Wish::Repeat),
            "n" | "N" => Some(Wish::Skip),
            "q" | "Q" => Some(Wish::Enough),
            other => {
                say!("\"{other}\" is no key: a presses the last mark again, n skips this mark, q ends here");
                None
            }
        })
    }

    /// What to do now.
    pub(super) fn ask(&mut self, text: &str, mark_mm: Option<[f64; 2]>, taken_mm: &[[f64; 2]]) {
        self.shown.text = text.to_owned();
        self.shown.mark_mm = mark_mm;
        self.shown.taken_mm = taken_mm.to_vec();
        self.tell();
    }

    /// The last that is told, before the page is gone.
    pub(super) fn end(&mut self, text: &str, taken_mm: &[[f64; 2]]) {
        self.ask(text, None, taken_mm);
        if self.page.is_some() {
            std::thread::sleep(LAST);
        }
    }

    /// What became of the last press; it is said as well.
    pub(super) fn note(&mut self, text: String) {
        say!("{text}");
        self.shown.note = text;
        self.tell();
    }

    fn tell(&self) {
        if let Some(page) = &self.page {
            page.set_guide(self.shown.clone());
        }
    }

    /// Shows that frames come, with what presses there now as far as that is known.
    ///
    /// # Errors
    /// None that a sheet has.
    pub(super) fn show(&mut self, time_s: f64, frame_s: f64, status: &str, located: Option<&Touch>) -> Result<()> {
        let Some(page) = &self.page else { return Ok(()) };
        if self.published.is_some_and(|at| at.elapsed() < EVERY) {
            return Ok(());
        }
        self.published = Some(Instant::now());
        self.number += 1;
        page.publish(Picture {
            sequence: self.number,
            time_s,
            grid: Arc::clone(&self.grid),
            outline_mm: Arc::clone(&self.outline_mm),
            electrodes_mm: Arc::clone(&self.electrodes_mm),
            values: vec![0.0; self.grid.len()],
            touches: located.into_iter().copied().collect(),
            stats: Stats {
                frames_per_s: frame_s.recip() as f32,
                source: self.source.clone(),
                status: Some(status.to_owned()),
                ..Stats::default()
            },
        })?;
        Ok(())
    }
}
