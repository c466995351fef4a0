//! The GREIT figures of merit of a method's pictures over the radius of the sheet.

use crate::error::StudyError;
use crate::greit::{Figures, Pixels};
use crate::scene::{Fault, Scene, rng};
use crate::test_sheet::{TestSheet, imager_for};
use forward::{DiscTouch, Drive};
use inverse::pipeline::{Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::imager::Imager;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use rand::Rng;
use serde::Serialize;
use std::sync::Arc;
use view::field::Field;
use view::picture::Grid;
use view::surface::grid_of;

/// Parts of the sheet's radius at which a touch is put.
pub const RADII: [f64; 9] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8];
const RIM_MM: f64 = 97.5;
const TIP_MM: f64 = 12.5;
const RISE: f64 = 0.2;
/// Side of the pixels for the figures, mm: 65 pixels across the sheet, as in EIDORS.
const PIXEL_MM: f64 = 3.0;

/// Figures at one radius, means over the touches there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ring {
    /// Distance of the touches from the middle over the sheet's radius.
    pub radius: f64,
    /// Integrated rise over the true one.
    pub amplitude: f64,
    /// The amplitude response AR: the same, divided by its value in the middle.
    pub response: f64,
    /// Position error PE, mm: positive where the touch is shown too near to the middle.
    pub position_mm: f64,
    /// Distance between the touch shown and the true one, mm.
    pub distance_mm: f64,
    /// Resolution RES; a perfect picture of the tip has 0.128.
    pub resolution: f64,
    /// Shape deformation SD.
    pub deformation: f64,
    /// Ringing RNG.
    pub ringing: f64,
}

/// The figures of a method with its usual options, for one disc of 25 mm and +20 % at 27 dB. The noise is estimated
/// from the frame. Every radius of [`RADII`] has `touches` such discs, one a frame, all round. The figures are those
/// of the shown field, on pixels of 3 mm.
///
/// # Errors
/// [`StudyError`] where the sheet cannot be modelled.
pub fn profile(drive: Drive, method: Method, touches: usize, seed: u64) -> Result<Vec<Ring>, StudyError> {
    profile_with(drive, method, touches, seed, |o| o)
}

/// [`profile`] with other options than the usual ones.
///
/// # Errors
/// [`StudyError`] where the sheet cannot be modelled.
pub fn profile_with(
    drive: Drive,
    method: Method,
    touches: usize,
    seed: u64,
    change: impl Fn(ReconstructorOptions) -> ReconstructorOptions,
) -> Result<Vec<Ring>, StudyError> {
    let imager = imager_for(method, drive, method.cell_mm())?;
    profile_on(&imager, drive, method, touches, seed, change)
}

/// [`profile_with`] on an imager of the paper's sheet.
///
/// # Errors
/// [`StudyError`] where the sheet cannot be modelled.
pub fn profile_on(
    imager: &Arc<Imager>,
    drive: Drive,
    method: Method,
    touches: usize,
    seed: u64,
    change: impl Fn(ReconstructorOptions) -> ReconstructorOptions,
) -> Result<Vec<Ring>, StudyError> {
    let mut rng = rng(seed);
    let mut sheet = TestSheet::new(imager, drive, 0.0, 0.0, &mut rng)?;
    let usual = ReconstructorOptions::for_imager(imager, method);
    let reference = Reference::new(imager.clone(), sheet.baseline.clone(), FrameNoise::Unknown)?;
    let mut r = Reconstructor::new(reference, change(usual));
    let grid = grid_of(imager)?;
    let pixels = Pixels::of_disc(RIM_MM, PIXEL_MM);
    let mut rings: Vec<Ring> = Vec::new();
    for radius in RADII {
        let turn: f64 = rng.random_range(0.0..1.0);
        let mut figures = Vec::new();
        for k in 0..touches {
            let angle = (k as f64 + turn) / touches as f64 * std::f64::consts::TAU;
            let at = [radius * RIM_MM * angle.cos(), radius * RIM_MM * angle.sin()];
            let scene = Scene {
                touches: vec![DiscTouch {
                    centre_mm: at,
                    radius_mm: TIP_MM,
                    rise: RISE,
                }],
                smooth: false,
                snr_db: 27.0,
                fault: Fault::None,
            };
            let frame = sheet.frame(&scene, &mut rng)?;
            let found = r.frame(&frame)?;
            figures.extend(Figures::of(&pixels, &shown(&grid, &found.x, &pixels), at));
        }
        rings.push(mean(radius, &figures, rings.first()));
    }
    Ok(rings)
}

/// The field as a viewer draws it, negative values included.
fn shown(grid: &Grid, x: &[f64], pixels: &Pixels) -> Vec<f64> {
    let values: Vec<f32> = x.iter().map(|x| *x as f32).collect();
    let field = Field::new(grid, &values);
    let at = |p: &[f64; 2]| f64::from(field.at(p[0], p[1]));
    pixels.centres_mm.iter().map(at).collect()
}

fn mean(radius: f64, figures: &[Figures], middle: Option<&Ring>) -> Ring {
    let over = |value: fn(&Figures) -> f64| figures.iter().map(value).sum::<f64>() / figures.len() as f64;
    let amplitude = over(|f| f.amplitude_mm2) / (RISE * std::f64::consts::PI * TIP_MM * TIP_MM);
    Ring {
        radius,
        amplitude,
        response: amplitude / middle.map_or(amplitude, |m| m.amplitude),
        position_mm: over(|f| f.position_mm),
        distance_mm: over(|f| f.distance_mm),
        resolution: over(|f| f.resolution),
        deformation: over(|f| f.deformation),
        ringing: over(|f| f.ringing),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Requirement on the shown picture: an amplitude response within 15 % from the middle to 80 % of the radius.
    #[test]
    fn the_amplitude_response_is_uniform() {
        for drive in [Drive::PAPER, Drive::Current { amplitude_a: 1e-3 }] {
            let rings = profile(drive, Method::Nnls, 12, 77).unwrap();
            assert_eq!(rings.len(), RADII.len());
            for ring in rings {
                assert!((ring.response - 1.0).abs() < 0.15, "{drive:?}: {ring:?}");
                assert!(ring.distance_mm < 2.0 && ring.deformation < 0.15, "{drive:?}: {ring:?}");
                // Without negative values there is no ringing.
                assert_eq!(ring.ringing, 0.0);
            }
        }
    }
}
