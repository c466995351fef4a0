//! What the presses so far taught, while others are taken: it plays back where a press is.

use super::Kept;
use crate::presses::extent::Extent;
use ::forward::{Measurement, Pattern, Sheet};
use anyhow::Result;
use inverse::learned::{FEWEST, Learned, Press, Setting, TakenPress, learn, turn};
use inverse::touches::touch::Touch;

/// So many times as many presses are learned from anew: it takes seconds.
const MORE: f64 = 1.3;
/// What was played back is shown so long, s.
const SHOWN_S: f64 = 2.0;

/// The calibration so far.
pub(super) struct Interim {
    turn: usize,
    extent: Option<inverse::learned::Extent>,
    measurements: Vec<Measurement>,
    electrodes: usize,
    learned: Option<Learned>,
    /// Presses that it was learned from.
    of: usize,
    before_mm: Option<[f64; 2]>,
    shown: Option<(f64, Touch)>,
}

impl Interim {
    /// On a sheet.
    ///
    /// # Errors
    /// It makes no sense.
    pub(super) fn new(sheet: &Sheet) -> Result<Self> {
        Ok(Self {
            turn: turn(sheet)?,
            extent: Extent::of(sheet)?.of_sheet(),
            measurements: Vec::new(),
            electrodes: sheet.electrodes.len(),
            learned: None,
            of: 0,
            before_mm: None,
            shown: None,
        })
    }

    /// What a frame measures.
    pub(super) fn measure(&mut self, pattern: &Pattern) {
        self.measurements = pattern.measurements().to_vec();
    }

    /// Learns from the presses so far, where they are enough and enough more than the last time.
    pub(super) fn learn(&mut self, kept: &[Kept]) {
        if kept.len() < FEWEST || (kept.len() as f64) < MORE * self.of as f64 {
            return;
        }
        let press = |kept: &Kept| {
            Some(Press {
                place_mm: kept.place_mm?,
                change: kept.press.change(),
            })
        };
        let presses: Vec<Press> = kept.iter().filter_map(press).collect();
        let setting = Setting {
            measurements: &self.measurements,
            electrodes: self.electrodes,
            turn: self.turn,
            extent: self.extent,
        };
        // What cannot be learned from yet perhaps can with the next press.
        if let Ok((learned, _)) = learn(&presses, &setting, |_, _| ()) {
            (self.learned, self.of) = (Some(learned), kept.len());
        }
    }

    /// Where a press that was not learned from is by the others, in words.
    pub(super) fn plays_back(&mut self, press: &TakenPress, mark_mm: [f64; 2]) -> Option<String> {
        let before_mm = self.before_mm.replace(mark_mm);
        let learned = self.learned.as_ref()?;
        let presence = learned.locate(&press.change(), before_mm);
        let Some(located) = presence.presses.first() else {
            return Some(format!("; the {} before do not find it", self.of));
        };
        let [x, y] = located.place_mm;
        self.shown = Some((
            press.taken_s,
            Touch {
                x_mm: x,
                y_mm: y,
                rise: located.strength,
                x_sd_mm: Some(located.covariance_mm2[0][0].sqrt()),
                y_sd_mm: Some(located.covariance_mm2[1][1].sqrt()),
                ..Touch::default()
            },
        ));
        let off_mm = (x - mark_mm[0]).hypot(y - mark_mm[1]);
        Some(format!(
            "; {} before put it at {x:.1}, {y:.1} mm, {off_mm:.1} mm off",
            self.of
        ))
    }

    /// What was played back a moment ago.
    pub(super) fn touch(&self, now_s: f64) -> Option<&Touch> {
        let (at_s, touch) = self.shown.as_ref()?;
        (0.0..SHOWN_S).contains(&(now_s - at_s)).then_some(touch)
    }
}
