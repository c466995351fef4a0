//! What the pages show: every cell as a step on the scale of the colours, changed only where the change can be seen.
//!
//! A step is half of what lies between two of the 256 colours. A cell keeps its step until its value is a whole step away from
//! it, so what is shown is never further from the value than half a colour, and noise below that changes nothing. The smooth
//! field between the cells is a mean of them and no further from the truth than they are.
//!
//! The scale changes by notches, up at once and down only when it was too large for a while: what a colour means stays the same
//! while something moves, and the cells keep their steps.

use std::sync::Arc;

use crate::SCALE_FLOOR;
use crate::picture::{Grid, Picture};

/// Steps from nothing to the last colour.
pub const STEPS: u16 = 510;

/// Notches of the scale in an octave.
const NOTCHES: f32 = 4.0;

/// The scale goes down when it was too large for so long, s of the board's time.
const STEADY_S: f64 = 2.0;

/// Changed cells with at most so many others between them are told in one run, and the others with them: a run of its own
/// costs as much.
const BETWEEN: usize = 2;

/// What the last colour stands for.
#[derive(Clone, Debug, PartialEq)]
struct Scale {
    floor: f32,
    notch: i32,
    /// Since when a lower one would have done, and the greatest peak since.
    lower: Option<(f64, f32)>,
}

impl Scale {
    fn new(floor: f32) -> Self {
        let usable = floor.is_finite() && floor > 0.0;
        Self {
            floor: if usable { floor } else { SCALE_FLOOR },
            notch: 0,
            lower: None,
        }
    }

    fn full(&self) -> f32 {
        self.floor * (self.notch as f32 / NOTCHES).exp2()
    }

    /// The lowest notch that a peak fits below.
    fn notch_for(&self, peak: f32) -> i32 {
        // 100 octaves: beyond that a number of 32 bits ends.
        (NOTCHES * (peak / self.floor).log2())
            .ceil()
            .clamp(0.0, 100.0 * NOTCHES) as i32
    }

    /// Takes the peak of the next picture; whether the scale is another now.
    fn take(&mut self, peak: f32, time_s: f64) -> bool {
        let before = self.notch;
        let wanted = self.notch_for(peak);
        if wanted >= self.notch {
            self.notch = wanted;
            self.lower = None;
        } else {
            let (since, greatest) = self.lower.unwrap_or((time_s, peak));
            // A clock that began anew starts the wait anew.
            let (since, greatest) = (since.min(time_s), greatest.max(peak));
            self.lower = Some((since, greatest));
            if time_s - since >= STEADY_S {
                self.notch = self.notch_for(greatest);
                self.lower = None;
            }
        }
        self.notch != before
    }
}

/// Cells one after the other and their steps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run<'a> {
    /// The first cell.
    pub start: usize,
    /// The steps of this and the following cells.
    pub steps: &'a [u16],
}

/// What is shown of one scene after any number of its pictures.
#[derive(Clone, Debug)]
pub struct Shown {
    grid: Arc<Grid>,
    /// Value of every place of the grid's rectangle.
    places: Vec<u32>,
    scale: Scale,
    number: u64,
    steps: Vec<u16>,
    /// Number of the picture that changed the cell last.
    changed: Vec<u64>,
}

/// No value.
const NOBODY: u32 = u32::MAX;

impl Shown {
    /// Nothing yet of a scene on this grid: every step is 0, the number too. `floor`: least full scale, relative rise.
    pub fn new(grid: &Arc<Grid>, floor: f32) -> Self {
        let mut places = vec![NOBODY; grid.columns() * grid.rows()];
        for (k, &(column, row)) in grid.cells().iter().enumerate() {
            places[usize::from(column) + grid.columns() * usize::from(row)] = k as u32;
        }
        Self {
            grid: Arc::clone(grid),
            places,
            scale: Scale::new(floor),
            number: 0,
            steps: vec![0; grid.len()],
            changed: vec![0; grid.len()],
        }
    }

    /// Takes the next picture, `number` greater than those before and with a value for every cell of the grid.
    pub fn take(&mut self, picture: &Picture, number: u64) {
        self.number = number;
        let anew = self.scale.take(self.peak(picture), picture.time_s);
        let unit = f32::from(STEPS) / self.scale.full();
        for ((step, changed), value) in self.steps.iter_mut().zip(&mut self.changed).zip(&picture.values) {
            let exact = usable(*value) * unit;
            if anew || (exact - f32::from(*step)).abs() >= 1.0 {
                // Too large for 16 bits is the greatest; every colour is the last there.
                let next = exact.round() as u16;
                if next != *step {
                    (*step, *changed) = (next, number);
                }
            }
        }
    }

    /// Number of the last picture taken.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Relative rise of the last colour.
    pub fn full(&self) -> f32 {
        self.scale.full()
    }

    /// Step of every cell, in the order of the values.
    pub fn steps(&self) -> &[u16] {
        &self.steps
    }

    /// The cells that are not as they were after picture `base`, in order; after 0: those that are not, or were once not, 0.
    pub fn changes(&self, base: u64) -> impl Iterator<Item = Run<'_>> {
        let mut from = 0;
        std::iter::from_fn(move || {
            let is_news = |k: &usize| self.changed[*k] > base;
            let start = (from..self.steps.len()).find(is_news)?;
            let mut end = start + 1;
            while let Some(next) = (end..self.steps.len().min(end + BETWEEN + 1)).find(is_news) {
                end = next + 1;
            }
            from = end;
            Some(Run {
                start,
                steps: &self.steps[start..end],
            })
        })
    }

    /// What the scale must hold: the smooth field and the labels.
    fn peak(&self, picture: &Picture) -> f32 {
        self.field_peak(&picture.values).max(picture.greatest_rise())
    }

    /// The greatest value of the smooth field at the cells' centres, or less if that is below the floor.
    fn field_peak(&self, values: &[f32]) -> f32 {
        let greatest = values.iter().map(|v| usable(*v)).fold(0.0, f32::max);
        if greatest <= self.scale.floor {
            return greatest;
        }
        // A lone cell keeps 4/9 of its height, so the peak is not at a cell that is lower.
        let strong = self.grid.cells().iter().zip(values);
        strong
            .filter(|(_, v)| usable(**v) >= 4.0 / 9.0 * greatest)
            .map(|(cell, _)| self.smooth(*cell, values))
            .fold(0.0, f32::max)
    }

    /// The uniform cubic B-spline at a cell's centre; cells outside the sheet are as the mean of those inside.
    fn smooth(&self, (column, row): (u16, u16), values: &[f32]) -> f32 {
        let near = |k: u16, side: usize| {
            let k = usize::from(k);
            (k.saturating_sub(1)..(k + 2).min(side)).map(move |n| (n, if n == k { 4.0 } else { 1.0 }))
        };
        let (mut sum, mut weights) = (0.0, 0.0);
        for (r, up) in near(row, self.grid.rows()) {
            for (c, across) in near(column, self.grid.columns()) {
                let place = self.places[c + self.grid.columns() * r];
                if let Some(value) = values.get(place as usize) {
                    sum += up * across * usable(*value);
                    weights += up * across;
                }
            }
        }
        sum / weights
    }
}

/// What can be shown of a value: nothing of one that is negative or not finite.
fn usable(value: f32) -> f32 {
    if value.is_finite() { value.max(0.0) } else { 0.0 }
}

#[cfg(test)]
#[path = "shown_tests.rs"]
mod tests;
