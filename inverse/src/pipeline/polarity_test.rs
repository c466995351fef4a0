//! Which way touches change the resistivity: said, or learned from frame to frame.

use crate::pipeline::result::FrameResult;
use crate::touches::polarity::Polarity;
use crate::touches::touch::Touch;

/// Frames with touches of one sign from which that is known to be the sheet's.
const LEARNED_FRAMES: usize = 8;
/// Something that rested on the sheet when the baseline was taken falls where it lay, each time that it is lifted, and nowhere else. Falls
/// that came and went at places so far from one another, mm, are touches. Chosen by hand: more than a finger that comes back misses its
/// place by.
const OTHER_PLACE_MM: f64 = 15.0;
/// Frames that touches of one sign do not explain until such a one is tried again with both.
const RETRY_FRAMES: usize = 16;

/// Follows the polarity of the frames of one baseline.
pub(crate) struct PolarityTest {
    said: Option<Polarity>,
    sequence: bool,
    learned: Option<Polarity>,
    /// Whether that was learned since the sheet was last quiet.
    just_learned: bool,
    /// With what the next frame is fitted first.
    now: Polarity,
    /// Frames of one baseline with rises, and with falls alone since the sheet was last quiet.
    rises: usize,
    falls: usize,
    /// Where the strongest of these falls was last, mm; and where others had come and gone before.
    falls_at: [f64; 2],
    fell_at: Option<[f64; 2]>,
    /// Those with rises until the sheet was last quiet.
    rises_before: usize,
    /// Such frames until both signs are tried again.
    until: usize,
    /// Whether touches of both signs explained the frame then, in places that it does not tell.
    unplaced: bool,
}

impl PolarityTest {
    /// `said` is none where it is to be learned. Frames that are no `sequence` teach nothing.
    pub(crate) fn new(said: Option<Polarity>, sequence: bool) -> Self {
        Self {
            said,
            sequence,
            learned: None,
            just_learned: false,
            now: said.unwrap_or_default(),
            rises: 0,
            falls: 0,
            falls_at: [0.0; 2],
            fell_at: None,
            rises_before: 0,
            until: 0,
            unplaced: false,
        }
    }

    /// What frames taught.
    pub(crate) fn learned(&self) -> Option<Polarity> {
        self.learned
    }

    /// That the frames of an earlier baseline taught it.
    pub(crate) fn know(&mut self, learned: Option<Polarity>) {
        self.learned = learned;
        self.now = self.known().unwrap_or_default();
    }

    /// A frame was explained by touches of one sign.
    pub(crate) fn note_explained(&mut self) {
        self.unplaced = false;
    }

    /// A frame goes by that both signs might explain.
    pub(crate) fn pass(&mut self) {
        self.until = self.until.saturating_sub(1);
    }

    /// With what the frame is fitted first.
    pub(crate) fn now(&self) -> Polarity {
        self.now
    }

    /// Whether both signs explained the frame in which they were tried last, by touches in places that it does not tell.
    pub(crate) fn is_unplaced(&self) -> bool {
        self.unplaced
    }

    /// What the sheet's touches do, as far as that is known.
    fn known(&self) -> Option<Polarity> {
        self.said.or(self.learned)
    }

    /// Whether a frame is to be fitted with both signs: one that is not explained; and one with a new touch as long as the
    /// sheet is not known, since a fall in one place is much like rises in others.
    pub(crate) fn asks(&self, new: bool, unexplained: bool) -> bool {
        let due = unexplained && self.until == 0;
        self.now != Polarity::Either && (due || (new && self.known().is_none()))
    }

    /// The frame was explained with both signs, and not with one.
    pub(crate) fn widen(&mut self) {
        (self.now, self.until, self.unplaced) = (Polarity::Either, 0, false);
    }

    /// It was not, or only by touches whose places it does not tell (`unplaced`): back to what it was, until the next time. What moves has
    /// places soon, so that after such touches the next frame is tried.
    pub(crate) fn narrow(&mut self, now: Polarity, unplaced: bool) {
        (self.now, self.unplaced) = (now, unplaced);
        self.until = if self.sequence && !unplaced { RETRY_FRAMES } else { 0 };
    }

    /// The sheet is quiet: what was there has gone, so that it was a touch; or what had gone is there again.
    pub(crate) fn clear(&mut self) {
        if self.sequence && self.falls >= LEARNED_FRAMES && self.known().is_none() {
            let at = self.falls_at;
            let before = *self.fell_at.get_or_insert(at);
            if (at[0] - before[0]).hypot(at[1] - before[1]) > OTHER_PLACE_MM {
                self.learned = Some(Polarity::Down);
            }
        }
        self.now = self.known().unwrap_or_default();
        (self.falls, self.until, self.just_learned, self.unplaced) = (0, 0, false, false);
        self.rises_before = self.rises;
    }

    /// A fault explains what frames have shown since the sheet was last quiet: they taught nothing.
    pub(crate) fn unlearn(&mut self) {
        if std::mem::take(&mut self.just_learned) {
            self.learned = None;
            self.now = self.known().unwrap_or_default();
        }
        (self.rises, self.falls) = (self.rises_before, 0);
    }

    /// Learns from a frame's result. What cannot be a touch is taken out of its touches. The strongest of these: where it is,
    /// something lay on the sheet when the baseline was taken.
    pub(crate) fn learn(&mut self, result: &mut FrameResult) -> Option<Touch> {
        let explained = result.changed && result.misfit.is_some();
        let is_rise = |t: &Touch| t.rise > 0.0;
        let rises = result.touches.iter().any(is_rise);
        if !explained || self.said == Some(Polarity::Either) {
            return None;
        }
        if !self.sequence {
            self.now = self.known().unwrap_or_default();
            let said = self.said?;
            return strange(said, result);
        }
        if rises {
            self.rises += 1;
            if self.rises >= LEARNED_FRAMES && self.known().is_none() {
                (self.learned, self.just_learned) = (Some(Polarity::Up), true);
            }
        } else if let Some(strongest) = strongest(&result.touches) {
            self.falls += 1;
            self.falls_at = [strongest.x_mm, strongest.y_mm];
        }
        let sheet = self.known().unwrap_or_default();
        if !result.touches.iter().any(|t| !sheet.allows(t.rise)) {
            self.now = sheet;
            return None;
        }
        // Falls alone may still be touches of a sheet of which nothing is known.
        let touches = (self.known().is_none() && !rises).then(|| result.touches.clone());
        let gone = strange(sheet, result);
        if let Some(touches) = touches {
            result.touches = touches;
        }
        gone
    }
}

/// Takes the touches out of a result that change the resistivity the other way. The strongest of them.
fn strange(sheet: Polarity, result: &mut FrameResult) -> Option<Touch> {
    let strange = strongest(result.touches.iter().filter(|t| !sheet.allows(t.rise)));
    result.touches.retain(|t| sheet.allows(t.rise));
    strange
}

fn strongest<'a>(touches: impl IntoIterator<Item = &'a Touch>) -> Option<Touch> {
    let by_strength = |a: &&Touch, b: &&Touch| a.total_mm2.abs().total_cmp(&b.total_mm2.abs());
    touches.into_iter().max_by(by_strength).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::touches::touch::Touch;

    /// Frames with one touch of this rise.
    fn show(test: &mut PolarityTest, rise: f64, frames: usize) {
        show_at(test, [0.0; 2], rise, frames);
    }

    fn show_at(test: &mut PolarityTest, [x_mm, y_mm]: [f64; 2], rise: f64, frames: usize) {
        for _ in 0..frames {
            let mut result = FrameResult {
                changed: true,
                misfit: Some(1.0),
                touches: vec![Touch {
                    rise,
                    x_mm,
                    y_mm,
                    ..Touch::default()
                }],
                ..FrameResult::default()
            };
            test.learn(&mut result);
        }
    }

    /// What rested on the sheet may be lifted and come back as often as it likes: falls at one place are no sheet's sign, at two they are.
    #[test]
    fn what_comes_back_to_its_place_teaches_no_sign() {
        let mut test = PolarityTest::new(None, true);
        for bounce in 0..10 {
            show_at(
                &mut test,
                [30.0 + f64::from(bounce % 3), 20.0],
                -0.3,
                10 * LEARNED_FRAMES,
            );
            test.clear();
            assert_eq!(test.known(), None, "{bounce}");
        }
        let mut rises = PolarityTest::new(None, true);
        rises.fell_at = test.fell_at;
        show_at(&mut rises, [-20.0, 50.0], 0.3, LEARNED_FRAMES);
        assert_eq!(rises.known(), Some(Polarity::Up));
        show_at(&mut test, [-20.0, 50.0], -0.3, LEARNED_FRAMES);
        test.clear();
        assert_eq!(test.known(), Some(Polarity::Down));
    }

    /// What many frames show alone is the sheet's sign; what turned out to be a fault says nothing of it.
    #[test]
    fn a_fault_teaches_no_sign() {
        for (rise, learned) in [(0.3, Polarity::Up), (-0.3, Polarity::Down)] {
            for frames in [LEARNED_FRAMES, 10 * LEARNED_FRAMES] {
                let mut test = PolarityTest::new(None, true);
                show_at(&mut test, [40.0, 0.0], rise, frames);
                test.clear();
                show(&mut test, rise, frames);
                let mut broken = PolarityTest::new(None, true);
                show(&mut broken, rise, frames);
                broken.unlearn();
                show(&mut broken, rise, LEARNED_FRAMES - 1);
                for test in [&mut test, &mut broken] {
                    test.clear();
                }
                assert_eq!((test.known(), broken.known()), (Some(learned), None), "{rise} {frames}");
                assert_eq!(broken.now(), Polarity::default());
                // What was shown before, or known, stays.
                let mut taps = PolarityTest::new(None, true);
                show(&mut taps, 0.3, LEARNED_FRAMES - 1);
                taps.clear();
                show(&mut taps, rise, frames);
                taps.unlearn();
                show(&mut taps, 0.3, 1);
                assert_eq!(taps.known(), Some(Polarity::Up));
                show(&mut test, rise, frames);
                test.unlearn();
                test.clear();
                assert_eq!(test.known(), Some(learned));
            }
        }
    }
}
