//! What happens on the sheet: touches in time, and the truth about them.

use crate::material::{Kernel, Material};
use crate::pressure::Bump;
use crate::stretch::Stretch;
use crate::touch::{Key, Shape, Touch};
use crate::variation::{Ageing, Variation};

/// One touch as it is at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchNow {
    /// Which touch of the scene.
    pub id: usize,
    /// What touches.
    pub shape: Shape,
    /// Centre, mm.
    pub x_mm: f64,
    /// Centre, mm.
    pub y_mm: f64,
    /// Radius as in [`Touch`], under the present force, mm.
    pub radius_mm: f64,
    /// How far it is turned, degrees counter-clockwise.
    pub angle_deg: f64,
    /// Force, N, more than 0.
    pub force_n: f64,
    /// Relative rise in resistivity at the centre that this touch makes at once; what it makes with time is a [`Probe`]'s
    /// to say.
    pub peak_rise: f64,
}

impl TouchNow {
    pub(crate) fn new(id: usize, touch: &Touch, key: &Key, material: &Material) -> Self {
        let mut now = Self {
            id,
            shape: touch.shape,
            x_mm: key.x_mm,
            y_mm: key.y_mm,
            radius_mm: touch.radius_under_mm(key.force_n),
            angle_deg: key.angle_deg,
            force_n: key.force_n,
            peak_rise: 0.0,
        };
        now.peak_rise = material.rise(now.pressure_mpa(now.x_mm, now.y_mm));
        now
    }

    /// Pressure that this touch makes at a place, MPa.
    pub fn pressure_mpa(&self, x_mm: f64, y_mm: f64) -> f64 {
        self.bumps().map(|b| b.pressure_mpa([x_mm, y_mm])).sum()
    }

    pub(crate) fn bumps(&self) -> impl Iterator<Item = Bump> {
        let centre = [self.x_mm, self.y_mm];
        self.shape.bumps(self.radius_mm, self.force_n, centre, self.angle_deg)
    }
}

/// Touches on a time line, and the rubber they press, with all that is its own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The touches.
    pub touches: Vec<Touch>,
    /// After this time (s) it starts again; `None`: never.
    pub loop_s: Option<f64>,
    /// What the sheet is made of.
    pub material: Material,
    /// Whether what presses at power-up has pressed for ever; else it begins to press then.
    pub preloaded: bool,
    /// How the sheet itself is stretched.
    pub stretches: Vec<Stretch>,
    /// How it differs from an even sheet.
    pub variation: Variation,
    /// How it ages.
    pub ageing: Ageing,
}

impl Scene {
    /// A sheet that nobody touches.
    pub fn empty() -> Self {
        Self::default()
    }

    /// Touches that are always there.
    pub fn still(touches: Vec<Touch>) -> Self {
        Self {
            touches,
            ..Self::default()
        }
    }

    /// The touches that press at `t_s` seconds after power-up, in the order of the scene.
    pub fn truth(&self, t_s: f64) -> Vec<TouchNow> {
        let t_s = self.local_s(t_s);
        let now = |(id, touch): (usize, &Touch)| Some(TouchNow::new(id, touch, &touch.at(t_s)?, &self.material));
        self.touches.iter().enumerate().filter_map(now).collect()
    }

    /// Time since the scene began, or began again, s.
    pub(crate) fn local_s(&self, t_s: f64) -> f64 {
        match self.loop_s {
            Some(length) if length > 0.0 => t_s.rem_euclid(length),
            _ => t_s,
        }
    }

    /// Strain at a place and time by which the sheet is stretched: stretching positive.
    pub fn stretch(&self, x_mm: f64, y_mm: f64, t_s: f64) -> f64 {
        let t_s = self.local_s(t_s);
        let each = self.stretches.iter().map(|s| s.strain(t_s) * s.share([x_mm, y_mm]));
        each.sum()
    }

    /// Pressure at a place and time, MPa: those of touches that overlap add.
    pub fn pressure_mpa(&self, x_mm: f64, y_mm: f64, t_s: f64) -> f64 {
        self.truth(t_s).iter().map(|t| t.pressure_mpa(x_mm, y_mm)).sum()
    }

    /// Relative rise in resistivity at a place and time by what is there at once: touches and stretching.
    pub fn rise(&self, x_mm: f64, y_mm: f64, t_s: f64) -> f64 {
        let pressed = self.material.instant_per_mpa * self.pressure_mpa(x_mm, y_mm, t_s);
        self.material.rise_of_strain(pressed - self.stretch(x_mm, y_mm, t_s))
    }

    /// Follows the rubber at a place from power-up on.
    pub fn probe(&self, x_mm: f64, y_mm: f64) -> Probe<'_> {
        let delayed_mpa = if self.preloaded {
            self.pressure_mpa(x_mm, y_mm, 0.0)
        } else {
            0.0
        };
        Probe {
            scene: self,
            place_mm: [x_mm, y_mm],
            t_s: 0.0,
            delayed_mpa,
        }
    }
}

/// Follows the strain at one place of a scene's rubber through time.
#[derive(Clone, Debug)]
pub struct Probe<'a> {
    scene: &'a Scene,
    place_mm: [f64; 2],
    t_s: f64,
    delayed_mpa: f64,
}

impl Probe<'_> {
    /// Lets time pass up to `t_s`; a time before the present one changes nothing.
    pub fn advance(&mut self, t_s: f64) {
        let material = &self.scene.material;
        for step in self.scene.steps(self.t_s, t_s) {
            let kernel = Kernel::new(material, step.duration_s);
            let added: f64 = step
                .bumps()
                .map(|(from, to)| from.delayed_mpa(&to, &kernel, self.place_mm))
                .sum();
            self.delayed_mpa = kernel.decay * self.delayed_mpa + added;
        }
        self.t_s = self.t_s.max(t_s);
    }

    /// Strain now: what came at once (less any stretching), and what came with time.
    pub fn strains(&self) -> [f64; 2] {
        let material = &self.scene.material;
        let [x, y] = self.place_mm;
        [
            material.instant_per_mpa * self.scene.pressure_mpa(x, y, self.t_s) - self.scene.stretch(x, y, self.t_s),
            material.delayed_per_mpa * self.delayed_mpa,
        ]
    }

    /// Relative rise in resistivity now, by strain: over the untouched sheet at the same place and of the same age.
    pub fn rise(&self) -> f64 {
        self.scene.material.rise_of_strain(self.strains().iter().sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_touch_raises_the_resistivity_by_a_fifth() {
        let scene = Scene::still(vec![Touch::tip(10.0, -5.0, 25.0)]);
        assert!((scene.rise(10.0, -5.0, 3.0) - 0.2).abs() < 1e-12);
        assert!((scene.rise(22.4, -5.0, 3.0) - 0.2).abs() < 1e-12);
        assert_eq!(scene.rise(22.6, -5.0, 3.0), 0.0);
        assert!((scene.truth(0.0)[0].peak_rise - 0.2).abs() < 1e-12);
    }

    #[test]
    fn a_loop_starts_again() {
        let scene = Scene {
            loop_s: Some(4.0),
            ..Scene::still(vec![Touch::finger(&[(1.0, 0.0, 0.0), (2.0, 9.0, 0.0)], 5.0, 0.1)])
        };
        assert_eq!(scene.truth(1.5), scene.truth(9.5));
        assert!(scene.truth(3.0).is_empty());
    }

    #[test]
    fn a_probe_follows_creep_and_recovery_under_a_tip() {
        let scene = Scene {
            material: Material::viscoelastic(),
            touches: vec![Touch::pressed(
                Shape::Disc,
                12.5,
                0.0,
                0.0,
                &[(1.0, 25.0), (11.0, 25.0)],
            )],
            ..Scene::empty()
        };
        let mut probe = scene.probe(3.0, 4.0);
        let mut rise = |t| {
            probe.advance(t);
            probe.rise()
        };
        let grown = |t: f64| 1.0 - (-t / 5.0).exp();
        assert_eq!(rise(0.99), 0.0);
        assert!((rise(3.5) - 0.2 * (1.0 + grown(2.5) / 3.0)).abs() < 1e-12);
        assert!((rise(15.0) - 0.2 / 3.0 * grown(10.0) * (1.0 - grown(4.0))).abs() < 1e-12);
        assert!(scene.probe(20.0, 0.0).rise() == 0.0);
    }

    #[test]
    fn what_is_there_at_power_up_starts_then_or_has_crept_already() {
        let scene = Scene {
            material: Material::viscoelastic(),
            ..Scene::still(vec![Touch::tip(0.0, 0.0, 25.0)])
        };
        let preloaded = Scene {
            preloaded: true,
            ..scene.clone()
        };
        assert!((scene.probe(0.0, 0.0).rise() - 0.2).abs() < 1e-12);
        let mut probe = preloaded.probe(0.0, 0.0);
        probe.advance(7.0);
        assert!((probe.rise() - 0.2 * 4.0 / 3.0).abs() < 1e-12);
    }

    /// When a scene is looked at does not matter, nor where its loop ends.
    #[test]
    fn the_history_is_the_scenes_and_not_the_lookers() {
        let loops = Scene {
            material: Material::viscoelastic(),
            touches: vec![Touch::finger(&[(0.2, -20.0, 0.0), (0.9, 20.0, 3.0)], 10.0, 0.1)],
            loop_s: Some(1.1),
            ..Scene::empty()
        };
        let rise = |looks: &[f64]| {
            let mut probe = loops.probe(1.0, 2.0);
            looks.iter().for_each(|t| probe.advance(*t));
            probe.rise()
        };
        let once = rise(&[7.3]);
        let often: Vec<f64> = (0..=7300).map(|k| f64::from(k) * 1e-3).collect();
        assert!(
            once > 1e-4 && (rise(&often) / once - 1.0).abs() < 1e-3,
            "{once} {}",
            rise(&often)
        );
    }
}
