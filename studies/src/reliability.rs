//! Faults that are there already when the baseline is taken: what is named, and what becomes of the touches.

use crate::error::StudyError;
use crate::scene::{Kind, rng};
use crate::score::Score;
use crate::test_sheet::{TestSheet, noise_v, reconstructor};
use forward::{DiscTouch, Drive, Pair, Pattern};
use inverse::reference::baseline::Baseline;
use inverse::reference::imager::Imager;
use inverse::reference::inspection::{Inspection, InspectionOptions, inspect};
use inverse::reference::wiring::rewire;
use rand::Rng;
use rand::rngs::StdRng;
use rand::seq::index;
use std::sync::Arc;

/// What is broken, in the baseline and in every frame. Electrodes and values are counted from 0.
#[derive(Clone, Debug, PartialEq)]
pub enum BaselineFault {
    /// Nothing.
    None,
    /// All values of these electrodes are noise, up to the frame's largest value.
    Dead(Vec<usize>),
    /// One value is multiplied, in the baseline only.
    Value(usize, f64),
    /// All values have the wrong sign.
    AllSigns,
    /// The drive pair that begins at this electrode has the wrong sign.
    DriveSign(usize),
    /// The sense pair of this electrode and the next has the wrong sign.
    SenseSign(usize),
    /// The wires of these two electrodes are exchanged.
    Exchanged(usize, usize),
}

impl BaselineFault {
    /// So many dead electrodes of `of`, anywhere.
    pub fn dead(count: usize, of: usize, rng: &mut StdRng) -> Self {
        let mut electrodes = index::sample(rng, of, count.min(of)).into_vec();
        electrodes.sort_unstable();
        Self::Dead(electrodes)
    }

    /// What the board measures instead of a frame. Exchanged wires are those of [`wired`] and change nothing here.
    pub fn apply(&self, frame: &mut [f64], pattern: &Pattern, is_baseline: bool, rng: &mut StdRng) {
        let largest = frame.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let begins = |pair: Pair, l: usize| {
            [pair.plus, pair.minus].contains(&l) && [pair.plus, pair.minus].contains(&((l + 1) % pattern.electrodes()))
        };
        for (k, (v, m)) in frame.iter_mut().zip(pattern.measurements()).enumerate() {
            let of = [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus];
            match self {
                Self::Dead(dead) if of.iter().any(|l| dead.contains(l)) => *v = rng.random_range(-1.0..1.0) * largest,
                Self::Value(index, factor) if is_baseline && *index == k => *v *= factor,
                Self::AllSigns => *v = -*v,
                Self::DriveSign(l) if begins(m.drive, *l) => *v = -*v,
                Self::SenseSign(l) if begins(m.sense, *l) => *v = -*v,
                _ => {}
            }
        }
    }
}

/// The imager of what the board really measures when two wires are exchanged: for the frames of a [`TestSheet`].
///
/// # Errors
/// [`StudyError`] for electrodes that there are not.
pub fn wired(imager: &Arc<Imager>, order: &[usize]) -> Result<Arc<Imager>, StudyError> {
    Ok(Arc::new(Imager {
        pattern: rewire(&imager.pattern, order)?,
        ..(**imager).clone()
    }))
}

/// Whether no more electrodes are named than are dead, and these take part in the same values: all that values can tell.
pub fn same_values(pattern: &Pattern, named: &[usize], dead: &[usize]) -> bool {
    let one_of = |electrodes: &[usize], of: [usize; 4]| of.iter().any(|l| electrodes.contains(l));
    named.len() <= dead.len()
        && pattern.measurements().iter().all(|m| {
            let of = [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus];
            one_of(named, of) == one_of(dead, of)
        })
}

/// The finger whose change the noise is measured by.
const FINGER: DiscTouch = DiscTouch {
    centre_mm: [48.0, 0.0],
    radius_mm: 12.5,
    rise: 0.2,
};

/// Ratio of the finger's signal to the noise, dB.
const SNR_DB: f64 = 45.0;

/// A sheet of its own mesh with electrodes off by `off_mm` (standard deviation, mm) and contacts by 30 %, its baseline with a
/// fault and noise at 45 dB, and so many frames of one or two touches with the same fault: what was found.
///
/// # Errors
/// [`StudyError`] where the model has no solution.
pub fn trial(
    imager: &Arc<Imager>,
    fault: &BaselineFault,
    off_mm: f64,
    frames: usize,
    seed: u64,
) -> Result<(Inspection, Score), StudyError> {
    let mut rng = rng(seed);
    let measured = match fault {
        BaselineFault::Exchanged(a, b) => {
            let mut order: Vec<usize> = (0..imager.pattern.electrodes()).collect();
            order.swap(*a, *b);
            wired(imager, &order)?
        }
        _ => Arc::clone(imager),
    };
    let mut sheet = TestSheet::new(&measured, Drive::PAPER, off_mm, 0.3, &mut rng)?;
    let sigma = noise_v(&sheet.clean_frame(&[FINGER])?, &sheet.baseline, SNR_DB);
    let mut unpressed = sheet.empty(sigma, &mut rng);
    fault.apply(&mut unpressed, &imager.pattern, true, &mut rng);
    let baseline = Baseline::of_frames(unpressed.len(), &[&unpressed]);
    let inspection = inspect(imager, baseline, true, &InspectionOptions::default());
    let mut reconstructor = reconstructor(&inspection.imager, &inspection.baseline.values_v)?;
    let mut score = Score::default();
    for k in 0..frames {
        let scene = Kind::Equal(1 + k % 2).scene(&mut rng, SNR_DB);
        let mut frame = sheet.frame(&scene, &mut rng)?;
        fault.apply(&mut frame, &imager.pattern, false, &mut rng);
        score.add(&scene, &reconstructor.frame(&frame)?.touches);
    }
    Ok((inspection, score))
}
