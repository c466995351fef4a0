//! A scene's time in steps short enough to take what happens in each as a straight line.

use crate::pressure::Bump;
use crate::scene::{Scene, TouchNow};

/// Longest step, s: a straight line over this time misses 0.1 % of a smooth ramp of 0.1 s. Longer steps miss more, shorter
/// ones cost time.
const MOST_S: f64 = 0.005;
/// Farthest that anything moves in a step, mm: a third of a fingertip's radius. Longer steps leave gaps in a moving finger's
/// trail, shorter ones cost time.
const MOST_MM: f64 = 2.0;
/// Times nearer to each other than this are the same, s.
const SAME_S: f64 = 1e-9;

/// A stretch of time within which no touch begins or ends.
#[derive(Clone, Debug)]
pub(crate) struct Step {
    /// When it ends, s after power-up.
    pub(crate) end_s: f64,
    pub(crate) duration_s: f64,
    /// The touches there are, at its two ends.
    pub(crate) touches: Vec<[TouchNow; 2]>,
}

impl Step {
    /// The touches' bumps at both ends.
    pub(crate) fn bumps(&self) -> impl Iterator<Item = (Bump, Bump)> {
        self.touches.iter().flat_map(|[a, b]| a.bumps().zip(b.bumps()))
    }
}

impl Scene {
    /// The steps from one time to a later one.
    pub(crate) fn steps(&self, from_s: f64, to_s: f64) -> impl Iterator<Item = Step> {
        let mut at = from_s;
        std::iter::from_fn(move || {
            if to_s - at <= SAME_S {
                return None;
            }
            let mut local = at;
            let mut duration = (to_s - at).min(MOST_S);
            if let Some(length) = self.loop_s.filter(|l| *l > 0.0) {
                local = at.rem_euclid(length);
                if length - local <= SAME_S {
                    local = 0.0;
                }
                duration = duration.min(length - local);
            }
            for touch in &self.touches {
                let next = touch.keys.iter().map(|k| k.t_s - local).find(|d| *d > SAME_S);
                duration = duration.min(next.unwrap_or(MOST_S));
            }
            let mut touches = self.during(local, duration);
            let farthest = touches.iter().map(|[a, b]| moved_mm(a, b)).fold(0.0, f64::max);
            if farthest > MOST_MM {
                duration = (duration * MOST_MM / farthest).max(SAME_S);
                touches = self.during(local, duration);
            }
            at += duration;
            Some(Step {
                end_s: at,
                duration_s: duration,
                touches,
            })
        })
    }

    fn during(&self, local_s: f64, duration_s: f64) -> Vec<[TouchNow; 2]> {
        let touches = self.touches.iter().enumerate();
        touches
            .filter_map(|(id, touch)| {
                let ends = touch.during(local_s, local_s + duration_s)?;
                Some(ends.map(|key| TouchNow::new(id, touch, &key, &self.material)))
            })
            .collect()
    }
}

/// How far a touch goes, or its rim when it turns.
fn moved_mm(a: &TouchNow, b: &TouchNow) -> f64 {
    let along = libm::hypot(b.x_mm - a.x_mm, b.y_mm - a.y_mm);
    let reach = a.radius_mm.max(b.radius_mm);
    along + reach * (b.angle_deg - a.angle_deg).to_radians().abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::touch::{Key, Shape, Touch};

    #[test]
    fn steps_cover_the_time_and_end_at_every_key() {
        let scene = Scene {
            touches: vec![
                Touch::pressed(Shape::Disc, 5.0, 0.0, 0.0, &[(0.0033, 1.0), (0.0171, 2.0)]),
                Touch::new(
                    Shape::Finger,
                    5.0,
                    vec![Key::new(0.0, 0.0, 0.0, 1.0), Key::new(0.02, 80.0, 0.0, 1.0)],
                ),
            ],
            loop_s: Some(0.031),
            ..Scene::empty()
        };
        let steps: Vec<Step> = scene.steps(0.0, 0.1).collect();
        let ends: Vec<f64> = steps.iter().map(|s| s.end_s).collect();
        assert!((ends.last().unwrap() - 0.1).abs() < 1e-8);
        let total: f64 = steps.iter().map(|s| s.duration_s).sum();
        assert!((total - 0.1).abs() < 1e-8);
        for at in [0.0033, 0.0171, 0.02, 0.031, 0.0343, 0.062, 0.0791] {
            assert!(ends.iter().any(|e| (e - at).abs() < 1e-8), "{at}: {ends:?}");
        }
        for step in &steps {
            for [a, b] in &step.touches {
                assert!(step.duration_s <= MOST_S && (b.x_mm - a.x_mm).abs() < MOST_MM + 1e-9);
            }
        }
    }
}
