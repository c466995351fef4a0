//! What was found in scenes, compared with their truth.

use crate::scene::Scene;
use inverse::touches::touch::Touch;

/// Error of a touch that was not found, mm.
pub const MISSED_MM: f64 = 50.0;

/// What was found in scenes of one kind.
#[derive(Clone, Debug, Default)]
pub struct Score {
    /// Number of scenes.
    pub scenes: usize,
    /// Scenes with the right count.
    pub counted: usize,
    /// Scenes with the right count and every touch within 8 mm.
    pub resolved: usize,
    /// Scenes with more touches than there are.
    pub over: usize,
    /// Distance of every true touch to the touch matched with it, mm; [`MISSED_MM`] where there is none.
    pub errors_mm: Vec<f64>,
    /// Error of x and of y over its stated uncertainty.
    pub over_sd: Vec<f64>,
    /// Integrated rise over the true one.
    pub totals: Vec<f64>,
    /// Error of the integrated rise over its stated uncertainty.
    pub total_over_sd: Vec<f64>,
    /// Time from the voltages of a frame to its touches, us, for every frame.
    pub times_us: Vec<f64>,
    /// Scenes whose touches come from the picture and not from the fit.
    pub unfitted: usize,
}

impl Score {
    /// Adds a scene: matches its touches with those found, nearest pairs first.
    pub fn add(&mut self, truth: &Scene, found: &[Touch]) {
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (k, t) in truth.touches.iter().enumerate() {
            for (j, f) in found.iter().enumerate() {
                pairs.push(((f.x_mm - t.centre_mm[0]).hypot(f.y_mm - t.centre_mm[1]), k, j));
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut of = vec![None; truth.touches.len()];
        let mut taken = vec![false; found.len()];
        for (d, k, j) in pairs {
            if of[k].is_none() && !taken[j] && d < MISSED_MM {
                of[k] = Some((d, j));
                taken[j] = true;
            }
        }
        let mut worst = 0.0_f64;
        for (t, o) in truth.touches.iter().zip(&of) {
            let error = o.map_or(MISSED_MM, |o: (f64, usize)| o.0);
            worst = worst.max(error);
            self.errors_mm.push(error);
            if let Some((_, j)) = o {
                let f = &found[*j];
                let peak = t.rise * std::f64::consts::PI * t.radius_mm * t.radius_mm;
                let total = if truth.smooth { 0.5 * peak } else { peak };
                self.totals.push(f.total_mm2 / total);
                self.total_over_sd
                    .extend(f.total_sd_mm2.map(|sd| (f.total_mm2 - total).abs() / sd));
                if let (Some(sx), Some(sy)) = (f.x_sd_mm, f.y_sd_mm) {
                    self.over_sd.push((f.x_mm - t.centre_mm[0]).abs() / sx);
                    self.over_sd.push((f.y_mm - t.centre_mm[1]).abs() / sy);
                }
            }
        }
        self.scenes += 1;
        let right = found.len() == truth.touches.len();
        self.counted += usize::from(right);
        self.over += usize::from(found.len() > truth.touches.len());
        self.resolved += usize::from(right && worst < 8.0);
    }

    /// Part of the scenes with the right count.
    pub fn counted_part(&self) -> f64 {
        self.counted as f64 / self.scenes as f64
    }

    /// Part of the scenes with the right count and every touch within 8 mm.
    pub fn resolved_part(&self) -> f64 {
        self.resolved as f64 / self.scenes as f64
    }

    /// Quantile of the position error, mm.
    pub fn error_mm(&self, part: f64) -> f64 {
        quantile(&self.errors_mm, part)
    }

    /// Part of the coordinates that lie within two of their standard uncertainties.
    pub fn honest_part(&self) -> f64 {
        within_two(&self.over_sd)
    }

    /// Part of the integrated rises that lie within two of their standard uncertainties.
    pub fn honest_total_part(&self) -> f64 {
        within_two(&self.total_over_sd)
    }
}

/// Part of these ratios of error to standard uncertainty that is 2 or less.
fn within_two(over_sd: &[f64]) -> f64 {
    over_sd.iter().filter(|v| **v <= 2.0).count() as f64 / over_sd.len().max(1) as f64
}

/// Quantile: the value below which this part (0 to 1) of the values lies; not a number where there are no values.
pub fn quantile(values: &[f64], part: f64) -> f64 {
    let mut v = values.to_vec();
    v.sort_by(f64::total_cmp);
    let k = (part * v.len() as f64) as usize;
    v.get(k.min(v.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
}
