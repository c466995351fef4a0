//! Faults of the board, the line and single values: what is said of them, how soon, and what becomes of the touches.
//!
//! The emulated board runs in simulated time. Its frames go through the link and the live reconstruction, as those of `skin run`
//! do. `cargo run --release -p studies --example faults` makes the table of docs/reliability.md.

mod case;
mod rig;

pub use case::{Case, ValueFault, cases};
pub use rig::Bench;

use crate::score::quantile;

/// When a fault comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    /// While a finger presses, which lifts later.
    UnderTouch,
    /// While nothing touches; a finger comes later.
    AtRest,
    /// Before the baseline is taken; a finger comes and goes later.
    Baseline,
}

impl When {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::UnderTouch, Self::AtRest, Self::Baseline];

    /// As in a table.
    pub fn name(self) -> &'static str {
        match self {
            Self::UnderTouch => "under a touch",
            Self::AtRest => "at rest",
            Self::Baseline => "in the baseline",
        }
    }
}

/// A touch further from its place than this is wrong, mm.
const WRONG_MM: f64 = 5.0;

/// What became of the frames of a scene since its fault.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// What was said, in order: when, s of the board's time since the fault, and what. What the baseline or the start says is at 0.
    pub said: Vec<(f64, String)>,
    /// What the last frame's faults are.
    pub last: Vec<String>,
    /// Frames under a finger: all, those with one touch within 5 mm, those without that are not doubted, those that are doubted.
    pub touched: Counts,
    /// The same of frames without a finger. Right are those without a touch.
    pub rest: Counts,
    /// Distance of the touch from the finger, mm, in frames under a finger that are not doubted and have touches.
    pub off_mm: Vec<f64>,
    /// The touch's total in these frames, mm².
    pub totals: Vec<f64>,
    /// Its standard deviation of position, mm, where known.
    pub sd_mm: Vec<f64>,
    /// Time of the reconstruction of every frame since the fault, s.
    pub took_s: Vec<f64>,
    /// Why the session ended, where it did.
    pub ended: Option<String>,
}

/// Frames of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// How many.
    pub frames: usize,
    /// Right ones, doubted or not.
    pub right: usize,
    /// Wrong ones that are shown without a doubt.
    pub silent: usize,
    /// Doubted ones.
    pub doubted: usize,
}

impl Counts {
    fn add(&mut self, right: bool, doubted: bool) {
        self.frames += 1;
        self.right += usize::from(right);
        self.doubted += usize::from(doubted);
        self.silent += usize::from(!right && !doubted);
    }

    fn text(&self) -> String {
        match self.frames {
            0 => "no frame".to_owned(),
            n => format!("{} / {} / {} of {n}", self.right, self.silent, self.doubted),
        }
    }
}

impl Outcome {
    /// The head of a table of outcomes.
    pub const HEAD: &'static str = "\
| fault | when | named as | after, s | touched: right / wrong and silent / doubted | position mm, median / worst | total off, median | rest: right / wrong and silent / doubted | ms a frame |
|---|---|---|---|---|---|---|---|---|";

    /// A row of a table: `total` is that of the finger without a fault, mm².
    pub fn row(&self, case: &Case, when: When, total: f64) -> String {
        let first = self.naming(case);
        let (named, after) = match (first, &self.ended) {
            (Some((after_s, text)), _) if after_s.is_finite() => (short(text), format!("{after_s:.2}")),
            (Some((_, text)), _) => (short(text), "ended".to_owned()),
            (None, Some(why)) => (short(why), "ended".to_owned()),
            (None, None) => match self.said.first() {
                Some((_, text)) => (format!("**not named**: {}", short(text)), "never".to_owned()),
                None => ("**nothing**".to_owned(), "never".to_owned()),
            },
        };
        let off = match self.off_mm.is_empty() {
            true => "-".to_owned(),
            false => format!(
                "{:.2} / {:.1}",
                quantile(&self.off_mm, 0.5),
                quantile(&self.off_mm, 1.0)
            ),
        };
        let of = match self.totals.is_empty() {
            true => "-".to_owned(),
            false => format!("{:+.0} %", 100.0 * (quantile(&self.totals, 0.5) / total - 1.0)),
        };
        format!(
            "| {} | {} | {named} | {after} | {} | {off} | {of} | {} | {:.1} |",
            case.name,
            when.name(),
            self.touched.text(),
            self.rest.text(),
            1e3 * self.took_s.iter().sum::<f64>() / self.took_s.len().max(1) as f64,
        )
    }

    /// When the fault was named, s, and how; none where it never was.
    pub fn naming(&self, case: &Case) -> Option<(f64, &str)> {
        let first = |word: &String| self.said.iter().find(|(_, text)| text.contains(word.as_str()));
        let all = |words: &Vec<String>| {
            let said: Option<Vec<_>> = words.iter().map(first).collect();
            said?.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))
        };
        let named = case.named.iter().filter_map(all).min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some((named.0, named.1.as_str()))
    }
}

/// The first words of a sentence.
fn short(text: &str) -> String {
    let end = text.find([':', ';']).unwrap_or(text.len());
    let text: String = text.chars().take(end.min(100)).collect();
    text.replace('|', "/")
}

impl When {
    /// When the finger is down with all its force, when the fault comes, and when nothing touches, as parts of the scene's length:
    /// begin and end.
    pub(crate) fn times(self) -> ([f64; 2], f64, [f64; 2]) {
        match self {
            Self::UnderTouch => ([0.1, 0.7], 0.25, [0.8, 1.0]),
            Self::AtRest => ([0.6, 1.0], 0.1, [0.1, 0.5]),
            Self::Baseline => ([0.15, 0.6], 0.0, [0.75, 1.0]),
        }
    }
}

/// Whether a touch is where it should be.
pub(crate) fn is_near(off_mm: f64) -> bool {
    off_mm <= WRONG_MM
}
