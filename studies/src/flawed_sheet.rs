//! Presses on simulated sheets with flaws, located by the model alone, by what known presses taught, and by a calibration as
//! `skin calibrate presses` makes it.
//!
//! Random numbers are drawn for each purpose by itself. Places, strengths and noise are therefore the same whatever the flaws are.

use crate::drift::smooth_field;
use crate::error::StudyError;
use crate::scene::{RIM_MM, rng};
use crate::score::quantile;
use crate::test_sheet::{TestSheet, misplaced, noise_v, noisy};
use forward::{DiscTouch, Drive, Sheet};
use hil_sim::Material;
use inverse::batch::{Batch, BatchOptions, OwnFrame};
use inverse::learned::{Press, SeenPress, Setting, learn, model_is_better, told};
use inverse::reference::ToldSheet;
use inverse::reference::baseline::Baseline;
use inverse::reference::imager::Imager;
use inverse::solvers::Method;
use rand::Rng;
use rand::rngs::StdRng;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Presses are within this distance from the middle, and one that is not found counts as so far off.
const REACH_MM: f64 = 80.0;
/// Of the simulated voltages: ten times that of the model.
const ACCURACY: f64 = 1e-4;
const SNR_DB: f64 = 27.0;
/// The frame before a press is a mean: its noise over that of a frame.
const BEFORE: f64 = 0.3;
/// Length over which a sheet is uneven, mm.
const UNEVEN_MM: f64 = 60.0;
/// A press is held so long, with as long a rest after it; its frame is taken so long after it came down, s.
const HELD_S: f64 = 1.5;
const TAKEN_S: f64 = 1.0;
/// Presses that are still felt.
const FELT: usize = 5;

/// What is wrong with the paper's sheet.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flaws {
    /// Standard deviation of an electrode's place along the rim, mm.
    pub off_mm: f64,
    /// Largest part by which a contact differs.
    pub contact: f64,
    /// Standard deviation of the relative resistance, which is uneven over 60 mm.
    pub uneven: f64,
    /// By what part a press tells more at the rim in the direction of x than in the middle.
    pub tilt: f64,
    /// Whether the rubber is [`Material::viscoelastic`]: presses held for 1.5 s, with rests of 1.5 s.
    pub creeps: bool,
}

/// Presses by their distances, mm, and how many coordinates are within two standard deviations.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Located {
    /// In the order of the presses.
    pub errors_mm: Vec<f64>,
    /// Of two for each press.
    pub inside: usize,
}

impl Located {
    fn add(&mut self, found: Option<([f64; 2], [f64; 2])>, place_mm: [f64; 2]) {
        let Some((at, sd)) = found else {
            self.errors_mm.push(REACH_MM);
            return;
        };
        let off = [0, 1].map(|k| at[k] - place_mm[k]);
        self.inside += (0..2).filter(|k| off[*k].abs() < 2.0 * sd[*k]).count();
        self.errors_mm.push(off[0].hypot(off[1]));
    }

    /// With those of another sheet.
    pub fn join(&mut self, other: &Self) {
        self.errors_mm.extend(&other.errors_mm);
        self.inside += other.inside;
    }

    /// Median and 95th percentile, mm.
    pub fn at(&self) -> [f64; 2] {
        [0.5, 0.95].map(|part| quantile(&self.errors_mm, part))
    }

    /// Part of the coordinates that are within two standard deviations.
    pub fn honest_part(&self) -> f64 {
        self.inside as f64 / (2 * self.errors_mm.len()).max(1) as f64
    }
}

/// What became of the presses of one sheet that were not known.
#[derive(Clone, Debug, PartialEq)]
pub struct Compared {
    /// By the model, whose electrodes are fitted to the baseline.
    pub alone: Located,
    /// By what the known presses taught.
    pub taught: Located,
    /// By the calibration.
    pub calibrated: Located,
    /// Whether that is the model.
    pub model_taken: bool,
    /// Whether the model has what the presses told of the sheet.
    pub told_taken: bool,
}

/// A press: the frame just before, the frame with it, and its place.
struct Pressed {
    before: Vec<f64>,
    frame: Vec<f64>,
    place_mm: [f64; 2],
}

impl Pressed {
    fn change(&self) -> Vec<f64> {
        self.frame.iter().zip(&self.before).map(|(v, b)| v - b).collect()
    }
}

/// Random numbers of one sheet for one purpose.
fn drawn(seed: u64, sheet: u64, purpose: u64) -> StdRng {
    rng(seed.wrapping_mul(1_000_003).wrapping_add(10 * sheet + purpose))
}

/// A sheet as it is built.
fn built(flaws: Flaws, rng: &mut StdRng) -> Sheet {
    let mut sheet = misplaced(flaws.off_mm, 0.0, rng);
    for electrode in &mut sheet.electrodes {
        electrode.contact_mm *= 1.0 + flaws.contact * rng.random_range(-1.0..=1.0);
    }
    sheet
}

fn presses(
    imager: &Arc<Imager>,
    flaws: Flaws,
    count: usize,
    (seed, number): (u64, u64),
) -> Result<Vec<Pressed>, StudyError> {
    let sheet = built(flaws, &mut drawn(seed, number, 0));
    let mut sheet = TestSheet::with_accuracy(imager, Drive::PAPER, &sheet, ACCURACY)?;
    let field = smooth_field(flaws.uneven, UNEVEN_MM, &mut drawn(seed, number, 1));
    let (mut places, mut noise) = (drawn(seed, number, 2), drawn(seed, number, 3));
    let rubber = Material::viscoelastic();
    let mut earlier: Vec<DiscTouch> = Vec::new();
    let mut frame = |touches: &[DiscTouch]| {
        if flaws.uneven > 0.0 {
            sheet.uneven_frame(touches, &field)
        } else {
            sheet.clean_frame(touches)
        }
    };
    let untouched = frame(&[])?;
    let mut list: Vec<Pressed> = Vec::new();
    for _ in 0..count {
        let angle = places.random_range(0.0..TAU);
        let radius = places.random_range(0.0_f64..1.0).sqrt() * REACH_MM;
        let place_mm = [radius * angle.cos(), radius * angle.sin()];
        let strength = places.random_range(0.75..1.25) * (1.0 + flaws.tilt * place_mm[0] / RIM_MM);
        let touch = DiscTouch {
            centre_mm: place_mm,
            radius_mm: 12.5,
            rise: 0.2 * strength,
        };
        // What earlier presses left so long after the last one was lifted.
        let dents = |since_s: f64| -> Vec<DiscTouch> {
            let dent = |(back, t): (usize, &DiscTouch)| {
                let crept = rubber.delayed_strain(0.0, [1.0; 2], HELD_S);
                let left_s = since_s + 2.0 * HELD_S * back as f64;
                let left = rubber.delayed_strain(crept, [0.0; 2], left_s) / rubber.instant_per_mpa;
                DiscTouch {
                    rise: left * t.rise,
                    ..*t
                }
            };
            let felt = if flaws.creeps { FELT } else { 0 };
            earlier.iter().rev().take(felt).enumerate().map(dent).collect()
        };
        let left = dents(HELD_S);
        let before = if left.is_empty() {
            untouched.clone()
        } else {
            frame(&left)?
        };
        let pressed = frame(&[vec![touch], dents(HELD_S + TAKEN_S)].concat())?;
        let sigma = noise_v(&pressed, &before, SNR_DB);
        list.push(Pressed {
            before: noisy(before, BEFORE * sigma, &mut noise),
            frame: noisy(pressed, sigma, &mut noise),
            place_mm,
        });
        earlier.push(touch);
    }
    Ok(list)
}

/// As `skin reconstruct TABLE --before LIST` does, with what is told of the sheet.
fn by_model(
    imager: &Imager,
    sheet: Option<ToldSheet>,
    presses: &[Pressed],
) -> Result<(Located, Vec<SeenPress>, Batch), StudyError> {
    let mut imager = imager.clone();
    imager.told = sheet.map(Arc::new);
    let unpressed: Vec<&[f64]> = presses.iter().map(|p| p.before.as_slice()).collect();
    let options = BatchOptions {
        drifts: false,
        noise_frames: usize::MAX,
        ..BatchOptions::of(Method::Nnls)
    };
    let reference = Baseline::of_frames(imager.pattern.len(), &unpressed).values_v;
    let mut batch = Batch::new(Arc::new(imager), &unpressed, options)?;
    let (mut located, mut seen) = (Located::default(), Vec::new());
    fn own(press: &Pressed) -> OwnFrame<'_> {
        OwnFrame {
            before: &press.before,
            values: &press.frame,
        }
    }
    let recovered = batch.recovered(&reference, false, &presses.iter().map(own).collect::<Vec<_>>())?;
    for (k, press) in presses.iter().enumerate() {
        let touches = batch
            .frame(k, &own(press).compared(&reference, recovered.as_ref()))?
            .touches;
        let strongest = touches
            .iter()
            .max_by(|a, b| a.total_mm2.abs().total_cmp(&b.total_mm2.abs()));
        let sd = |v: Option<f64>| v.unwrap_or(0.0);
        let found = strongest.map(|t| ([t.x_mm, t.y_mm], [sd(t.x_sd_mm), sd(t.y_sd_mm)]));
        located.add(found, press.place_mm);
        seen.extend(found.map(|(found_mm, sd_mm)| SeenPress {
            place_mm: press.place_mm,
            found_mm,
            sd_mm,
        }));
    }
    Ok((located, seen, batch))
}

/// A sheet with flaws is calibrated with some presses and tried on others, of which there are so many each. The sheet's number and the
/// seed tell all that is random.
///
/// # Errors
/// [`StudyError`] where a sheet makes no sense, and of fewer than five known presses.
pub fn compare(
    imager: &Arc<Imager>,
    flaws: Flaws,
    (known, others): (usize, usize),
    of: (u64, u64),
) -> Result<Compared, StudyError> {
    let pressed = presses(imager, flaws, known + others, of)?;
    let (known, others) = pressed.split_at(known);
    let press = |p: &Pressed| Press {
        place_mm: p.place_mm,
        change: p.change(),
    };
    let setting = Setting {
        measurements: imager.pattern.measurements(),
        electrodes: imager.pattern.electrodes(),
        turn: 1,
        extent: None,
    };
    let (learned, findings) = learn(&known.iter().map(press).collect::<Vec<_>>(), &setting, |_, _| {})?;
    let mut taught = Located::default();
    let mut before = None;
    for press in others {
        let found = learned.locate(&press.change(), before).presses.first().copied();
        let sd = |c: [[f64; 2]; 2]| [c[0][0].sqrt(), c[1][1].sqrt()];
        taught.add(found.map(|f| (f.place_mm, sd(f.covariance_mm2))), press.place_mm);
        before = found.map(|f| f.place_mm).or(before);
    }
    let (alone, ..) = by_model(imager, None, others)?;
    let (tried, seen, batch) = by_model(imager, Some(ToldSheet::trusted()), known)?;
    let told = told(batch.inspection(), &seen).filter(|told| told.stands);
    let errors = match &told {
        Some(told) => [0.5, 0.95].map(|part| quantile(&told.errors_mm, part)),
        None => tried.at(),
    };
    let model_taken = model_is_better(errors, findings.error_mm);
    let told_taken = model_taken && told.is_some();
    let calibrated = if model_taken {
        by_model(imager, told.map(|told| told.sheet), others)?.0
    } else {
        taught.clone()
    };
    Ok(Compared {
        alone,
        taught,
        calibrated,
        model_taken,
        told_taken,
    })
}
