//! A stream of frames to touches by what presses taught: each frame is compared with the sheet just before it was touched, as the
//! presses were.

use super::gain::Gain;
use super::learn::Learned;
use super::locator::{Located, Presence};
use super::order::Order;
use crate::pipeline::FrameResult;
use crate::quality::doubt::{Doubt, DoubtOptions};
use crate::reference::imager::{Imager, ImagerError};
use crate::touches::touch::Touch;
use forward::Measurement;
use std::sync::Arc;

/// What locates presses, and the measurements that it was learned from.
#[derive(Clone)]
pub struct LearnedSheet {
    /// What locates presses. The unit of the changes is the volt.
    pub learned: Arc<Learned>,
    /// The measurements, in the order of its values.
    pub measurements: Vec<Measurement>,
    /// What force a press has, where it is known.
    pub gain: Option<Arc<Gain>>,
}

/// How fast the sheet at rest is followed, s: rubber that was pressed and what warms up take longer, the press of a finger does not
/// take as long. Chosen by hand.
const FOLLOWED_S: f64 = 2.0;
/// Standard deviations across a distribution's full width at half of its height.
const WIDTH: f64 = 2.354_82;

/// Locates the presses of frame after frame.
pub(crate) struct PressFollower {
    learned: Arc<Learned>,
    gain: Option<Arc<Gain>>,
    order: Order,
    imager: Arc<Imager>,
    /// The sheet while nothing touches.
    rest_v: Vec<f64>,
    /// Where the press before this one was, and where the present one is, mm.
    before_mm: Option<[f64; 2]>,
    now_mm: Option<[f64; 2]>,
    result: FrameResult,
}

impl PressFollower {
    /// From a baseline on. The picture is drawn in the cells of an imager.
    pub(crate) fn new(sheet: &LearnedSheet, imager: Arc<Imager>, baseline_v: &[f64]) -> Self {
        Self {
            learned: Arc::clone(&sheet.learned),
            gain: sheet.gain.clone(),
            order: Order::new(&sheet.measurements, imager.pattern.measurements()),
            rest_v: baseline_v.to_vec(),
            before_mm: None,
            now_mm: None,
            result: FrameResult::nothing(&imager),
            imager,
        }
    }

    pub(crate) fn imager(&self) -> &Arc<Imager> {
        &self.imager
    }

    /// The last frame's result.
    pub(crate) fn result(&self) -> &FrameResult {
        &self.result
    }

    /// Locates the presses of a frame (V) that was measured so long after the one before, s.
    ///
    /// # Errors
    /// [`ImagerError`] when the frame does not have the pattern's length.
    pub(crate) fn frame(&mut self, values_v: &[f64], interval_s: Option<f64>) -> Result<&mut FrameResult, ImagerError> {
        self.imager.fits(&self.rest_v, values_v)?;
        let change: Vec<f64> = values_v.iter().zip(&self.rest_v).map(|(v, rest)| v - rest).collect();
        let ordered = self.order.ordered(&change);
        let used = ordered.iter().filter(|v| v.is_finite()).count();
        let few = (used as f64) < DoubtOptions::default().least_values * self.order.len() as f64;
        let presence = if few {
            Presence::default()
        } else {
            self.learned.locate(&ordered, self.before_mm)
        };
        if let Some(press) = presence.presses.first() {
            self.now_mm = Some(press.place_mm);
        } else {
            self.before_mm = self.now_mm.take().or(self.before_mm);
            self.follow(values_v, interval_s.unwrap_or(0.0));
        }
        let doubt = if few {
            let of = self.order.len();
            Some(Doubt::FewValues { used, of })
        } else {
            presence.doubt()
        };
        self.show(&presence, used, doubt);
        Ok(&mut self.result)
    }

    /// Nothing touches: the sheet at rest is a little more like this.
    fn follow(&mut self, values_v: &[f64], interval_s: f64) {
        let part = 1.0 - (-interval_s.max(0.0) / FOLLOWED_S).exp();
        for (rest, v) in self.rest_v.iter_mut().zip(values_v) {
            if !v.is_finite() {
                continue;
            }
            *rest = if rest.is_finite() {
                *rest + part * (v - *rest)
            } else {
                *v
            };
        }
    }

    fn show(&mut self, presence: &Presence, used: usize, doubt: Option<Doubt>) {
        // A spot as wide as what maps can tell apart.
        let sd_mm = self.learned.resolution_mm() / WIDTH;
        let result = &mut self.result;
        result.x.fill(0.0);
        for press in &presence.presses {
            for (cell, x) in result.x.iter_mut().enumerate() {
                let centre = self.imager.grid.centre(cell);
                let square = (centre[0] - press.place_mm[0]).powi(2) + (centre[1] - press.place_mm[1]).powi(2);
                *x += press.strength * (-0.5 * square / (sd_mm * sd_mm)).exp();
            }
        }
        result.touches.clear();
        result.touches.extend(
            presence
                .presses
                .iter()
                .map(|press| touch(press, sd_mm, self.gain.as_deref())),
        );
        result.changed = !presence.presses.is_empty();
        result.residual = 1.0 - presence.explained;
        result.misfit = result.changed.then_some(presence.misfit);
        result.rejected = self.order.among(&presence.wild);
        result.used = used - result.rejected.len();
        result.doubt = doubt;
    }
}

/// A press as a touch: its rise is its strength over the usual one, and its area that of the spot that is drawn.
fn touch(press: &Located, sd_mm: f64, gain: Option<&Gain>) -> Touch {
    let area_mm2 = std::f64::consts::TAU * sd_mm * sd_mm;
    Touch {
        x_mm: press.place_mm[0],
        y_mm: press.place_mm[1],
        rise: press.strength,
        area_mm2,
        total_mm2: press.strength * area_mm2,
        x_sd_mm: Some(press.covariance_mm2[0][0].sqrt()),
        y_sd_mm: Some(press.covariance_mm2[1][1].sqrt()),
        total_sd_mm2: Some(press.strength_sd * area_mm2),
        force_n: gain.map(|gain| gain.newtons(press.place_mm, press.strength)),
        ..Touch::default()
    }
}
