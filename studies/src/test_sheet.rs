//! A simulated sheet: a finer mesh than the imager's, the nonlinear model, and noise.

use crate::drift::Drift;
use crate::error::StudyError;
use crate::scene::{Fault, RIM_MM, Scene, Worse};
use forward::field::conductivity_of;
use forward::{DiscTouch, Drive, ElectrodeMatrix, ForwardError, Model, ModelOptions, Pattern, Place, Sheet, Solver};
use inverse::pipeline::{Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::electrode_fit;
use inverse::reference::imager::Imager;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use nalgebra::DMatrix;
use rand::Rng;
use rand::rngs::StdRng;
use rand_distr::StandardNormal;
use std::sync::Arc;

/// A simulated sheet that is measured. The imager knows nothing of the sheet but its baseline.
pub struct TestSheet {
    /// The imager for the frames; its electrodes are at their nominal places.
    pub imager: Arc<Imager>,
    /// The drive.
    pub drive: Drive,
    /// Voltages of the untouched sheet, V, without noise.
    pub baseline: Vec<f64>,
    solver: Solver,
}

impl TestSheet {
    /// The paper's sheet, built with the errors of [`misplaced`].
    ///
    /// # Errors
    /// [`ForwardError`] where electrodes overlap.
    pub fn new(
        imager: &Arc<Imager>,
        drive: Drive,
        off_mm: f64,
        contact: f64,
        rng: &mut StdRng,
    ) -> Result<Self, ForwardError> {
        Self::of_sheet(imager, drive, &misplaced(off_mm, contact, rng))
    }

    /// Any sheet, as it is built.
    ///
    /// # Errors
    /// [`ForwardError`] where electrodes overlap.
    pub fn of_sheet(imager: &Arc<Imager>, drive: Drive, sheet: &Sheet) -> Result<Self, ForwardError> {
        Self::with_accuracy(imager, drive, sheet, 5e-5)
    }

    /// The same whose voltages have this relative error at most: 5e-5 by default, 1e-3 that of an imager.
    ///
    /// # Errors
    /// As for [`TestSheet::of_sheet`].
    pub fn with_accuracy(
        imager: &Arc<Imager>,
        drive: Drive,
        sheet: &Sheet,
        accuracy: f64,
    ) -> Result<Self, ForwardError> {
        let options = ModelOptions {
            accuracy,
            ..ModelOptions::default()
        };
        let solver = Solver::new(Arc::new(Model::new(sheet, &options)?))?;
        Ok(Self {
            baseline: drive.frame_v(solver.electrode_matrix(), &imager.pattern),
            imager: Arc::clone(imager),
            drive,
            solver,
        })
    }

    /// The frame of a scene with its noise, V.
    ///
    /// # Errors
    /// [`ForwardError`] where the model has no solution: a touch with a rise of -1 or less.
    pub fn frame(&mut self, scene: &Scene, rng: &mut StdRng) -> Result<Vec<f64>, ForwardError> {
        let (drive, pattern) = (self.drive, &self.imager.pattern);
        let frame_v = |matrix: &ElectrodeMatrix| drive.frame_v(matrix, pattern);
        let mut v = if scene.smooth {
            let conductivity = conductivity_of(self.solver.model().mesh(), |p| {
                scene
                    .touches
                    .iter()
                    .map(|t| {
                        let (dx, dy) = (p[0] - t.centre_mm[0], p[1] - t.centre_mm[1]);
                        t.rise * (-0.5 * (dx * dx + dy * dy) / (0.5 * t.radius_mm).powi(2)).exp()
                    })
                    .sum()
            });
            frame_v(self.solver.solve(&conductivity)?)
        } else {
            self.clean_frame(&scene.touches)?
        };
        let sigma = noise_v(&v, &self.baseline, scene.snr_db);
        add_noise(&mut v, sigma, rng);
        self.spoil(&mut v, scene.fault, rng);
        Ok(v)
    }

    /// The frame of discs without noise, V.
    ///
    /// # Errors
    /// [`ForwardError`] where the model has no solution.
    pub fn clean_frame(&mut self, touches: &[DiscTouch]) -> Result<Vec<f64>, ForwardError> {
        let (drive, pattern) = (self.drive, &self.imager.pattern);
        // The mesh follows the edges of the discs. Both frames of the difference are on this mesh.
        let touched = drive.frame_v(self.solver.solve_touches(touches)?, pattern);
        let untouched = drive.frame_v(self.solver.solve_untouched_there()?, pattern);
        let change = touched.iter().zip(&untouched).map(|(t, u)| t - u);
        Ok(self.baseline.iter().zip(change).map(|(b, c)| b + c).collect())
    }

    /// The frame of discs without noise, V, with these contacts (electrode, change) worse than at the baseline.
    ///
    /// # Errors
    /// [`ForwardError`] where the model has no solution.
    pub fn worse_frame(&mut self, touches: &[DiscTouch], worse: &[(usize, Worse)]) -> Result<Vec<f64>, ForwardError> {
        let model = Arc::clone(self.solver.model());
        let sheet = model.sheet();
        let mut contacts: Vec<f64> = sheet.electrodes.iter().map(|e| e.contact_mm).collect();
        for (l, worse) in worse {
            if let Worse::Face(ohm) = worse {
                // The contact impedance, in mm of sheet, is that of the whole contact times its length.
                let length = match sheet.electrodes[*l].place {
                    Place::Angle { width_mm, .. } | Place::Arc { width_mm, .. } | Place::Point { width_mm, .. } => {
                        width_mm
                    }
                    Place::Inside { radius_mm, .. } => std::f64::consts::TAU * radius_mm,
                };
                contacts[*l] += ohm * length / sheet.sheet_resistance_ohm;
            }
        }
        let mut solver = Solver::new(Arc::new(model.with_contacts(&contacts)?))?;
        let mut potentials = solver.solve_touches(touches)?.potentials_ohm().clone();
        for (l, worse) in worse {
            if let Worse::Wire(ohm) = worse {
                potentials[(*l, *l)] += ohm;
            }
        }
        let (drive, pattern) = (self.drive, &self.imager.pattern);
        let touched = drive.frame_v(&ElectrodeMatrix::from_potentials(potentials), pattern);
        self.solver.solve_touches(touches)?;
        let untouched = drive.frame_v(self.solver.solve_untouched_there()?, pattern);
        let change = touched.iter().zip(&untouched).map(|(t, u)| t - u);
        Ok(self.baseline.iter().zip(change).map(|(b, c)| b + c).collect())
    }

    /// The frame of discs without noise, V, with a resistance of so many ohm between two wires since the baseline.
    ///
    /// # Errors
    /// [`ForwardError`] where the model has no solution.
    pub fn leaky_frame(
        &mut self,
        touches: &[DiscTouch],
        [a, b]: [usize; 2],
        ohm: f64,
    ) -> Result<Vec<f64>, ForwardError> {
        let r = self.solver.solve_touches(touches)?.potentials_ohm();
        // A conductor between two nodes of a network (Sherman and Morrison 1950).
        let column = r.column(a) - r.column(b);
        let across = ohm + column[a] - column[b];
        let potentials = r - &column * column.transpose() / across;
        let (drive, pattern) = (self.drive, &self.imager.pattern);
        let touched = drive.frame_v(&ElectrodeMatrix::from_potentials(potentials), pattern);
        let untouched = drive.frame_v(self.solver.solve_untouched_there()?, pattern);
        let change = touched.iter().zip(&untouched).map(|(t, u)| t - u);
        Ok(self.baseline.iter().zip(change).map(|(b, c)| b + c).collect())
    }

    /// The frame of discs without noise, V, after this drift since the baseline.
    ///
    /// # Errors
    /// [`ForwardError`] where the model has no solution.
    pub fn drifted_frame(&mut self, touches: &[DiscTouch], drift: &Drift) -> Result<Vec<f64>, ForwardError> {
        let model = Arc::clone(self.solver.model());
        // A contact impedance is given in mm of sheet: it shrinks against a sheet whose resistance grows.
        let electrodes = model.sheet().electrodes.iter().zip(&drift.contacts);
        let contacts: Vec<f64> = electrodes.map(|(e, c)| e.contact_mm * c / drift.resistance).collect();
        let mut solver = Solver::new(Arc::new(model.with_contacts(&contacts)?))?;
        let potentials = solver.solve_touches(touches)?.potentials_ohm() * drift.resistance;
        let (drive, pattern) = (self.drive, &self.imager.pattern);
        let drifted = drive.frame_v(&ElectrodeMatrix::from_potentials(potentials), pattern);
        self.solver.solve_touches(touches)?;
        // Both frames of the difference are on this mesh.
        let untouched = drive.frame_v(self.solver.solve_untouched_there()?, pattern);
        let change = drifted.iter().zip(&untouched).map(|(d, u)| d - u);
        let channels = pattern.measurements().iter().map(|m| drift.channels[m.sense.plus]);
        Ok(self
            .baseline
            .iter()
            .zip(change)
            .zip(channels)
            .map(|((b, c), channel)| drift.gain * channel * (b + c))
            .collect())
    }

    /// The frame of discs on a sheet whose resistivity has risen by a smooth field since the baseline (a place in mm to the relative
    /// rise), V without noise.
    ///
    /// # Errors
    /// [`ForwardError`] where the model has no solution: a rise of -1 or less.
    pub fn uneven_frame(
        &mut self,
        touches: &[DiscTouch],
        rise: impl Fn([f64; 2]) -> f64,
    ) -> Result<Vec<f64>, ForwardError> {
        let pressed = |p: [f64; 2]| -> f64 {
            let inside = |t: &&DiscTouch| (p[0] - t.centre_mm[0]).hypot(p[1] - t.centre_mm[1]) < t.radius_mm;
            touches.iter().filter(inside).map(|t| t.rise).sum()
        };
        // Discs whose edges the mesh does not follow, and without them: the rest of the discs' change is that of a mesh that does.
        let both = self.field_frame(|p| (1.0 + rise(p)) * (1.0 + pressed(p)) - 1.0)?;
        let discs = self.field_frame(pressed)?;
        let exact = self.clean_frame(touches)?;
        Ok(exact
            .iter()
            .zip(both.iter().zip(&discs))
            .map(|(e, (b, d))| e + b - d)
            .collect())
    }

    /// The frame of any rises of the resistivity (a place in mm to the relative rise), V without noise.
    ///
    /// # Errors
    /// [`ForwardError`] where the model has no solution: a rise of -1 or less.
    pub fn field_frame(&mut self, rise: impl Fn([f64; 2]) -> f64) -> Result<Vec<f64>, ForwardError> {
        let conductivity = conductivity_of(self.solver.model().mesh(), rise);
        Ok(self
            .drive
            .frame_v(self.solver.solve(&conductivity)?, &self.imager.pattern))
    }

    /// The frame of discs without noise, V, after a change of the electrodes' matrix.
    ///
    /// # Errors
    /// [`ForwardError`] where the model has no solution.
    pub fn rewired_frame(
        &mut self,
        touches: &[DiscTouch],
        rewire: impl Fn(&mut DMatrix<f64>),
    ) -> Result<Vec<f64>, ForwardError> {
        let mut potentials = self.solver.solve_touches(touches)?.potentials_ohm().clone();
        rewire(&mut potentials);
        let matrix = ElectrodeMatrix::from_potentials(potentials);
        Ok(self.drive.frame_v(&matrix, &self.imager.pattern))
    }

    fn spoil(&self, v: &mut [f64], fault: Fault, rng: &mut StdRng) {
        let l = rng.random_range(0..16);
        let largest = self.baseline.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let stuck = rng.random_range(-1.0..1.0) * largest;
        for (v, m) in v.iter_mut().zip(self.imager.pattern.measurements()) {
            let touches = [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus].contains(&l);
            match fault {
                Fault::Electrode if touches => *v = rng.random_range(-1.0..1.0) * largest,
                Fault::Missing if touches => *v = f64::NAN,
                Fault::Stuck if m.sense.plus == l => *v = stuck,
                _ => {}
            }
        }
    }

    /// The reconstructor for single frames of this sheet. The electrodes are fitted to the baseline, and the noise is
    /// estimated from every frame.
    ///
    /// # Errors
    /// [`StudyError`] where the imager is not of this sheet.
    pub fn reconstructor(&self) -> Result<Reconstructor, StudyError> {
        reconstructor(&self.fitted_imager(), &self.baseline)
    }

    /// The same for a sequence of frames, with what is known of their noise.
    ///
    /// # Errors
    /// As for [`TestSheet::reconstructor`].
    pub fn live_reconstructor(&self, noise: FrameNoise) -> Result<Reconstructor, StudyError> {
        live_reconstructor(&self.fitted_imager(), &self.baseline, noise)
    }

    /// The imager with the electrodes fitted to the baseline; the nominal imager where the fit fails.
    pub fn fitted_imager(&self) -> Arc<Imager> {
        electrode_fit::find(&self.imager, &self.baseline).map_or_else(|| Arc::clone(&self.imager), |f| f.imager)
    }

    /// The sheet as it is built, with the errors of its electrodes and contacts.
    pub fn as_built(&self) -> &Sheet {
        self.solver.model().sheet()
    }

    /// A frame of the untouched sheet with noise of this standard deviation, V.
    pub fn empty(&self, sigma: f64, rng: &mut StdRng) -> Vec<f64> {
        noisy(self.baseline.clone(), sigma, rng)
    }
}

/// The paper's sheet with errors: electrodes displaced along the rim by `off_mm` (standard deviation, mm), and contact
/// resistances changed by up to the part `contact` of them, evenly distributed.
pub fn misplaced(off_mm: f64, contact: f64, rng: &mut StdRng) -> Sheet {
    let mut sheet = Sheet::paper();
    for e in &mut sheet.electrodes {
        if let Place::Angle { angle_deg, .. } = &mut e.place {
            let off: f64 = rng.sample(StandardNormal);
            *angle_deg += (off_mm * off / RIM_MM).to_degrees();
        }
        e.contact_mm *= 1.0 + contact * rng.random_range(-1.0..=1.0);
    }
    sheet
}

/// The paper's sheet with an electrode that slipped along its rim, mm counter-clockwise.
pub fn slipped(electrode: usize, by_mm: f64) -> Sheet {
    let mut sheet = Sheet::paper();
    if let Some(Place::Angle { angle_deg, .. }) = sheet.electrodes.get_mut(electrode).map(|e| &mut e.place) {
        *angle_deg += (by_mm / RIM_MM).to_degrees();
    }
    sheet
}

/// Adds white noise of this standard deviation, V, to a frame.
pub fn noisy(mut frame: Vec<f64>, sigma: f64, rng: &mut StdRng) -> Vec<f64> {
    add_noise(&mut frame, sigma, rng);
    frame
}

fn add_noise(v: &mut [f64], sigma: f64, rng: &mut StdRng) {
    for v in v {
        *v += sigma * rng.sample::<f64, _>(StandardNormal);
    }
}

/// The imager of the paper's sheet with the adjacent pattern and cells of this size, mm.
///
/// # Errors
/// [`StudyError`] for a size that gives no cells or too many.
pub fn imager(drive: Drive, cell_mm: f64) -> Result<Arc<Imager>, StudyError> {
    let pattern = Pattern::adjacent(16)?;
    Ok(Arc::new(Imager::new(&Sheet::paper(), drive, pattern, cell_mm)?))
}

/// The same for a method: see [`Imager::for_method`].
///
/// # Errors
/// [`StudyError`] for a size that gives no cells or too many.
pub fn imager_for(method: Method, drive: Drive, cell_mm: f64) -> Result<Arc<Imager>, StudyError> {
    let pattern = Pattern::adjacent(16)?;
    Ok(Arc::new(Imager::for_method(
        method,
        &Sheet::paper(),
        drive,
        pattern,
        cell_mm,
    )?))
}

/// The reconstructor for single frames, with the electrodes where the imager has them. The noise is estimated from
/// every frame.
///
/// # Errors
/// [`StudyError`] where the baseline does not have the length of the imager's pattern.
pub fn reconstructor(imager: &Arc<Imager>, baseline: &[f64]) -> Result<Reconstructor, StudyError> {
    let options = ReconstructorOptions::for_imager(imager, Method::Nnls);
    let reference = Reference::new(Arc::clone(imager), baseline.to_vec(), FrameNoise::Unknown)?;
    Ok(Reconstructor::new(reference, options))
}

/// The same for a sequence of frames, with what is known of their noise.
///
/// # Errors
/// As for [`reconstructor`].
pub fn live_reconstructor(
    imager: &Arc<Imager>,
    baseline: &[f64],
    noise: FrameNoise,
) -> Result<Reconstructor, StudyError> {
    let options = ReconstructorOptions::for_imager(imager, Method::Nnls);
    let reference = Reference::new(Arc::clone(imager), baseline.to_vec(), noise)?;
    Ok(Reconstructor::new(reference, options.of_sequence()))
}

/// Standard deviation of the noise of a value, V, for this ratio of signal to noise. The signal is the change from the
/// baseline; both are 2-norms over the frame.
pub fn noise_v(clean: &[f64], baseline: &[f64], snr_db: f64) -> f64 {
    let change: f64 = clean.iter().zip(baseline).map(|(a, b)| (a - b).powi(2)).sum();
    (change / clean.len() as f64).sqrt() * 10.0_f64.powf(-snr_db / 20.0)
}
