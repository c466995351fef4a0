//! Sequences of frames of every kind, without noise.

use super::Happening;
use crate::error::StudyError;
use crate::test_sheet::{TestSheet, noisy};
use forward::DiscTouch;
use nalgebra::DMatrix;
use rand::Rng;
use rand::rngs::StdRng;
use rand_distr::StandardNormal;

/// A sequence of frames of one kind.
#[derive(Clone, Debug)]
pub struct Frames {
    /// What happens.
    pub name: String,
    /// Without noise, V.
    pub clean: Vec<Vec<f64>>,
    /// Touches in each; empty where what is there is no touch, or so wrong that none may be shown.
    pub touches: Vec<usize>,
}

/// Half of a rod's length and width, mm.
const ROD_MM: [f64; 2] = [40.0, 5.0];

impl Frames {
    fn of(name: &str, clean: Vec<Vec<f64>>) -> Self {
        Self {
            name: name.to_owned(),
            clean,
            touches: Vec::new(),
        }
    }

    /// One frame again and again.
    fn still(name: &str, frames: usize, frame: Vec<f64>) -> Self {
        Self::of(name, vec![frame; frames])
    }

    fn with_touches(mut self, touches: usize) -> Self {
        self.touches = vec![touches; self.clean.len()];
        self
    }

    /// What happens on a sheet that is whole.
    ///
    /// # Errors
    /// [`StudyError`] where the sheet has no solution.
    pub fn of_happening(
        sheet: &mut TestSheet,
        happening: Happening,
        frames: usize,
        rng: &mut StdRng,
    ) -> Result<Self, StudyError> {
        let clean = super::sequence(sheet, happening, frames, 0.0, rng)?;
        let touches = (0..frames).map(|k| happening.touches(k).len()).collect();
        Ok(Self {
            touches,
            ..Self::of(happening.name(), clean)
        })
    }

    /// Every frame with noise of this standard deviation, V.
    pub fn noisy(&self, sigma: f64, rng: &mut StdRng) -> Vec<Vec<f64>> {
        self.clean
            .iter()
            .map(|frame| noisy(frame.clone(), sigma, rng))
            .collect()
    }

    /// All kinds, on the paper's sheet.
    ///
    /// # Errors
    /// [`StudyError`] where the sheet has no solution.
    pub fn of_paper(sheet: &mut TestSheet, frames: usize, rng: &mut StdRng) -> Result<Vec<Self>, StudyError> {
        let live = Happening::ALL.into_iter().filter(|h| *h != Happening::IdleUnknownNoise);
        let mut kinds: Vec<Self> = live
            .map(|happening| Self::of_happening(sheet, happening, frames, rng))
            .collect::<Result<_, _>>()?;
        let [one, four] = [Happening::One, Happening::Four].map(|happening| {
            kinds
                .iter()
                .find(|k| k.name == happening.name())
                .map(|k| k.clean.clone())
        });
        let (one, four) = (one.unwrap_or_default(), four.unwrap_or_default());
        let finger = Happening::One.touches(0);

        let empty = sheet.baseline.clone();
        let held = frames / 2;
        let lifted = (0..frames).map(|k| if k < held { one[0].clone() } else { empty.clone() });
        kinds.push(Self {
            touches: (0..frames).map(|k| usize::from(k < held)).collect(),
            ..Self::of("one lifted", lifted.collect())
        });
        let mut strong = Vec::new();
        for k in 0..frames {
            strong.push(sheet.clean_frame(&with_rise(&Happening::Four.touches(k), 1.0))?);
        }
        kinds.push(Self::of("four moving, +100 %", strong).with_touches(4));

        let drifted = drifted(sheet, rng)?;
        kinds.push(Self::still("idle, drifted by 1 %", frames, plus(&empty, &drifted)).with_touches(0));
        let moving = four.iter().map(|frame| plus(frame, &drifted)).collect();
        kinds.push(Self::of("four moving, drifted by 1 %", moving).with_touches(4));
        for (name, electrodes) in [
            ("one still, a contact +30 ohm", &[3][..]),
            ("one still, two contacts +30 ohm", &[3, 9]),
        ] {
            let worse = |r: &mut DMatrix<f64>| electrodes.iter().for_each(|l| r[(*l, *l)] += 30.0);
            let frame = sheet.rewired_frame(&finger, worse)?;
            kinds.push(Self::still(name, frames, frame).with_touches(1));
        }
        kinds.push(lost("one moving, an electrode lost", sheet, &one, &[3], rng).with_touches(1));
        kinds.push(lost("one moving, two electrodes lost", sheet, &one, &[3, 9], rng).with_touches(1));
        kinds.push(lost(
            "idle, four electrodes lost",
            sheet,
            &vec![empty; frames],
            &[1, 4, 9, 13],
            rng,
        ));
        kinds.push(shorted(sheet, frames, &finger)?);
        let exchange = |r: &mut DMatrix<f64>| {
            r.swap_rows(3, 4);
            r.swap_columns(3, 4);
        };
        let exchanged = sheet.rewired_frame(&finger, exchange)?;
        kinds.push(Self::still("one still, two wires exchanged", frames, exchanged));
        kinds.push(rod("a rod", sheet, frames, 3.0)?);
        kinds.push(rod("a rod of metal", sheet, frames, -0.9)?);
        kinds.push(random("random frames, 1 %", sheet, frames, 0.01, rng));
        kinds.push(random("random frames, 30 %", sheet, frames, 0.3, rng));
        kinds.push(random("random frames, 1000 %", sheet, frames, 10.0, rng));
        let turns = (0..frames).map(|k| kinds[k % kinds.len()].clean[k].clone()).collect();
        kinds.push(Self::of("all of these in turn", turns));
        Ok(kinds)
    }

    /// Some kinds, on a sheet with many electrodes.
    ///
    /// # Errors
    /// [`StudyError`] where the sheet has no solution.
    pub fn of_many_electrodes(sheet: &mut TestSheet, frames: usize, rng: &mut StdRng) -> Result<Vec<Self>, StudyError> {
        let mut kinds = Vec::new();
        for happening in [Happening::Idle, Happening::One, Happening::Four] {
            kinds.push(Self::of_happening(sheet, happening, frames, rng)?);
        }
        let one = kinds[1].clean.clone();
        kinds.push(lost("one moving, an electrode lost", sheet, &one, &[3], rng).with_touches(1));
        kinds.push(shorted(sheet, frames, &Happening::One.touches(0))?);
        kinds.push(rod("a rod", sheet, frames, 3.0)?);
        kinds.push(random("random frames, 30 %", sheet, frames, 0.3, rng));
        let (electrodes, values) = (sheet.imager.pattern.electrodes(), sheet.imager.pattern.len());
        for kind in &mut kinds {
            kind.name = format!("{electrodes} electrodes, {values} values: {}", kind.name);
        }
        Ok(kinds)
    }
}

fn with_rise(touches: &[DiscTouch], rise: f64) -> Vec<DiscTouch> {
    touches.iter().map(|t| DiscTouch { rise, ..*t }).collect()
}

fn plus(frame: &[f64], change: &[f64]) -> Vec<f64> {
    frame.iter().zip(change).map(|(v, c)| v + c).collect()
}

/// What 1 % of every contact's drift (rms) and of the gain change, V.
fn drifted(sheet: &mut TestSheet, rng: &mut StdRng) -> Result<Vec<f64>, StudyError> {
    let electrodes = sheet.as_built().electrodes.len();
    let drift = crate::drift::Drift {
        gain: 1.01,
        contacts: (0..electrodes)
            .map(|_| 1.0 + 0.01 * rng.sample::<f64, _>(StandardNormal))
            .collect(),
        ..crate::drift::Drift::none(electrodes)
    };
    let frame = sheet.drifted_frame(&[], &drift)?;
    Ok(frame.iter().zip(&sheet.baseline).map(|(v, b)| v - b).collect())
}

/// The values of these electrodes are of any size, other ones in every frame.
fn lost(name: &str, sheet: &TestSheet, clean: &[Vec<f64>], electrodes: &[usize], rng: &mut StdRng) -> Frames {
    let largest = sheet.baseline.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let mut clean = clean.to_vec();
    for frame in &mut clean {
        for (v, m) in frame.iter_mut().zip(sheet.imager.pattern.measurements()) {
            let of = [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus];
            if of.iter().any(|l| electrodes.contains(l)) {
                *v = rng.random_range(-1.0..1.0) * largest;
            }
        }
    }
    Frames::of(name, clean)
}

/// The wires of two electrodes touch.
fn shorted(sheet: &mut TestSheet, frames: usize, touches: &[DiscTouch]) -> Result<Frames, StudyError> {
    let short = |r: &mut DMatrix<f64>| {
        let column = r.column(2) - r.column(6);
        let row = r.row(2) - r.row(6);
        let across = column[2] - column[6];
        *r -= column * row / across;
    };
    let frame = sheet.rewired_frame(touches, short)?;
    Ok(Frames::still("one still, two electrodes shorted", frames, frame))
}

fn rod(name: &str, sheet: &mut TestSheet, frames: usize, rise: f64) -> Result<Frames, StudyError> {
    let inside = |p: [f64; 2]| p[0].abs() < ROD_MM[0] && (p[1] - 20.0).abs() < ROD_MM[1];
    let frame = sheet.field_frame(|p| if inside(p) { rise } else { 0.0 })?;
    Ok(Frames::still(name, frames, frame))
}

/// Every value off by this part of it, anew in every frame.
fn random(name: &str, sheet: &TestSheet, frames: usize, part: f64, rng: &mut StdRng) -> Frames {
    let clean = (0..frames).map(|_| {
        let values = sheet.baseline.iter();
        values
            .map(|b| b * (1.0 + part * rng.sample::<f64, _>(StandardNormal)))
            .collect()
    });
    Frames::of(name, clean.collect())
}
