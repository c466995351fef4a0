//! What happens on the sheet: touches in time, and the truth about them.

use crate::material::Material;
use crate::touch::{Shape, Touch};

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
    /// Radius as in [`Touch`], mm.
    pub radius_mm: f64,
    /// Force, N, more than 0.
    pub force_n: f64,
    /// Relative rise in resistivity at the centre that this touch makes.
    pub peak_rise: f64,
}

impl TouchNow {
    /// Pressure that this touch makes at a place, MPa.
    pub fn pressure_mpa(&self, x_mm: f64, y_mm: f64) -> f64 {
        let distance = (x_mm - self.x_mm).hypot(y_mm - self.y_mm);
        self.shape.pressure_mpa(self.radius_mm, self.force_n, distance)
    }
}

/// Touches on a time line, and the rubber they press.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The touches.
    pub touches: Vec<Touch>,
    /// After this time (s) it starts again; `None`: never.
    pub loop_s: Option<f64>,
    /// What the sheet is made of.
    pub material: Material,
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
        let t_s = match self.loop_s {
            Some(length) if length > 0.0 => t_s.rem_euclid(length),
            _ => t_s,
        };
        let now = |(id, touch): (usize, &Touch)| {
            let key = touch.at(t_s)?;
            let peak_mpa = touch.shape.pressure_mpa(touch.radius_mm, key.force_n, 0.0);
            Some(TouchNow {
                id,
                shape: touch.shape,
                x_mm: key.x_mm,
                y_mm: key.y_mm,
                radius_mm: touch.radius_mm,
                force_n: key.force_n,
                peak_rise: self.material.rise(peak_mpa),
            })
        };
        self.touches.iter().enumerate().filter_map(now).collect()
    }

    /// Relative rise in resistivity at a place and time. The pressures of touches that overlap add.
    pub fn rise(&self, x_mm: f64, y_mm: f64, t_s: f64) -> f64 {
        let pressure = self.truth(t_s).iter().map(|t| t.pressure_mpa(x_mm, y_mm)).sum();
        self.material.rise(pressure)
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
}
