//! From touches to newtons: every cell of the sheet has the state of its rubber.
//!
//! The rubber creeps, not the touch: a finger that has moved on leaves its dent behind. The state is therefore kept for
//! each cell of a grid. A fitted touch lays its strain on the cells that it covers. The causal inverse of the solid
//! gives their pressures, which add up to the touch's force. Where there is no touch the pressure is 0 and the dent
//! recovers. A dent that is found as a touch has a force of nearly nothing, and is given exactly 0.

use crate::force::solid::{Solid, SolidState, Step};
use crate::reference::imager::Imager;
use crate::touches::touch::Touch;
use std::f64::consts::PI;

/// What forces are computed with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// The rubber.
    pub solid: Solid,
    /// Standard deviation of a force estimated from one frame, N.
    pub force_sd_n: f64,
}

/// Thresholds of a [`ForceMeter`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceMeterOptions {
    /// Least force of a touch, in standard deviations of a force ([`Calibration::force_sd_n`]).
    ///
    /// More turns light touches into 0 N; less gives a force to dents. 3 is passed by noise once in 700 frames. No
    /// experiment is on record.
    pub least_sd: f64,
    /// Further least force of a touch, as a part of the force of the dent below it.
    ///
    /// More hides light touches on a fresh dent; less takes the error of the dent's size for a force. Chosen by hand:
    /// the dent's size is known no better (docs/creep.md, "What falls short").
    pub least_of_dent: f64,
    /// Distance from the edge of a touch within which a cell belongs to the touch, in cells.
    ///
    /// More lets a touch own cells that recover on their own; less cuts off cells that the touch presses in part.
    /// Chosen by hand.
    pub reach_cells: f64,
    /// Points along the side of a cell that decide which part of the cell a touch covers.
    ///
    /// More is slower; less makes the cover coarser. Chosen by hand: 4 gives the cover to a sixteenth.
    pub points: usize,
}

impl Default for ForceMeterOptions {
    fn default() -> Self {
        Self {
            least_sd: 3.0,
            least_of_dent: 0.05,
            reach_cells: 1.5,
            points: 4,
        }
    }
}

/// Estimates forces, frame after frame.
#[derive(Clone, Debug)]
pub struct ForceMeter {
    calibration: Calibration,
    options: ForceMeterOptions,
    centres_mm: Vec<[f64; 2]>,
    cell_mm: f64,
    cells: Vec<SolidState>,
    time_s: Option<f64>,
    /// For every cell: the strain at the end of the interval, MPa, and the touch that it belongs to.
    strain_mpa: Vec<f64>,
    owner: Vec<Option<usize>>,
}

impl ForceMeter {
    /// For the sheet of an imager, which nothing has pressed yet.
    pub fn new(imager: &Imager, calibration: Calibration) -> Self {
        Self::with_options(imager, calibration, ForceMeterOptions::default())
    }

    /// As [`ForceMeter::new`], with other thresholds.
    pub fn with_options(imager: &Imager, calibration: Calibration, options: ForceMeterOptions) -> Self {
        let centres = (0..imager.grid.len()).map(|k| imager.grid.centre(k)).collect();
        Self::on_cells(centres, imager.grid.cell_mm(), calibration, options)
    }

    fn on_cells(centres_mm: Vec<[f64; 2]>, cell_mm: f64, calibration: Calibration, options: ForceMeterOptions) -> Self {
        let cells = centres_mm.len();
        Self {
            calibration,
            options,
            centres_mm,
            cell_mm,
            cells: vec![SolidState::default(); cells],
            time_s: None,
            strain_mpa: vec![0.0; cells],
            owner: vec![None; cells],
        }
    }

    /// The rubber and the noise that forces are computed with.
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// Forgets all dents, for a sheet that has rested.
    pub fn rest(&mut self) {
        self.cells.fill(SolidState::default());
        self.time_s = None;
    }

    /// Writes the force (N) into every touch found at a time (s, of any clock).
    ///
    /// A touch that lowers the resistivity gets none. A clock that goes back counts as no time passed. A force that is no more than noise and dents is exactly 0.
    pub fn update(&mut self, time_s: f64, touches: &mut [Touch]) {
        let step = self
            .calibration
            .solid
            .step(self.time_s.map_or(0.0, |before| time_s - before));
        self.time_s = Some(time_s);
        self.lay(touches);
        let area_mm2 = self.cell_mm * self.cell_mm;
        let mut sums = vec![[0.0; 2]; touches.len()];
        for ((cell, strain), owner) in self.cells.iter_mut().zip(&self.strain_mpa).zip(&self.owner) {
            match owner {
                Some(touch) => {
                    sums[*touch][0] += area_mm2 * cell.pressure(&step, *strain);
                    sums[*touch][1] += area_mm2 * cell.delayed_mpa;
                }
                None => recover(cell, &step),
            }
        }
        for (touch, [force_n, dent_n]) in touches.iter_mut().zip(sums) {
            let Calibration { force_sd_n, .. } = self.calibration;
            let least = self.options.least_sd * force_sd_n + self.options.least_of_dent * dent_n.max(0.0);
            let force_n = if force_n > least { force_n } else { 0.0 };
            touch.force_n = (touch.total_mm2 >= 0.0).then_some(force_n);
        }
    }

    /// Lays the strain of touches on the cells, and assigns the cells to the touches.
    ///
    /// A cell belongs to the touch whose edge is nearest, where that is near enough.
    fn lay(&mut self, touches: &[Touch]) {
        self.strain_mpa.fill(0.0);
        self.owner.fill(None);
        let mut nearest = vec![f64::INFINITY; self.cells.len()];
        let mut covered = Vec::new();
        // Of what lowers the resistivity the calibration knows nothing.
        for (k, touch) in touches.iter().enumerate().filter(|(_, t)| t.total_mm2 >= 0.0) {
            let radius = (touch.area_mm2.max(0.0) / PI).sqrt();
            covered.clear();
            for (c, centre) in self.centres_mm.iter().enumerate() {
                let beyond = (centre[0] - touch.x_mm).hypot(centre[1] - touch.y_mm) - radius;
                if beyond > self.options.reach_cells * self.cell_mm {
                    continue;
                }
                if beyond < nearest[c] {
                    nearest[c] = beyond;
                    self.owner[c] = Some(k);
                }
                let cover = cover(*centre, self.cell_mm, touch, radius, self.options.points);
                if cover > 0.0 {
                    covered.push((c, cover));
                }
            }
            // The sheet takes all of a touch, also of one that reaches over the rim or lies between the points.
            let whole = covered.iter().map(|(_, part)| part).sum::<f64>() * self.cell_mm * self.cell_mm;
            if whole > 0.0 && touch.area_mm2 > 0.0 {
                let mean = touch.total_mm2 / touch.area_mm2;
                let strain = self.calibration.solid.strain_mpa(mean) * touch.area_mm2 / whole;
                for (c, part) in &covered {
                    self.strain_mpa[*c] += strain * part;
                }
            }
        }
    }
}

/// Lets a cell recover that nothing presses.
fn recover(cell: &mut SolidState, step: &Step) {
    if *cell != SolidState::default() {
        cell.press(step, 0.0);
        if cell.delayed_mpa.abs() < f64::MIN_POSITIVE {
            *cell = SolidState::default();
        }
    }
}

/// Part of a cell that a touch covers, from `points` by `points` points. A touch smaller than a cell counts as large as
/// one.
fn cover(centre: [f64; 2], cell_mm: f64, touch: &Touch, radius: f64, points: usize) -> f64 {
    let radius = radius.max(0.5 * cell_mm);
    let at = |k: usize| ((k as f64 + 0.5) / points as f64 - 0.5) * cell_mm;
    let [dx, dy] = [centre[0] - touch.x_mm, centre[1] - touch.y_mm];
    let mut hits = 0;
    for i in 0..points {
        for j in 0..points {
            hits += usize::from((dx + at(i)).hypot(dy + at(j)) <= radius);
        }
    }
    hits as f64 / (points * points) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const AREA_MM2: f64 = PI * 12.5 * 12.5;

    fn meter(exponent: f64) -> ForceMeter {
        let at = |k: usize| -97.5 + 5.0 * (k as f64 + 0.5);
        let all = (0..39 * 39).map(|k| [at(k % 39), at(k / 39)]);
        let inside: Vec<[f64; 2]> = all.filter(|c| c[0].hypot(c[1]) < 97.5).collect();
        let solid = Solid {
            delayed_ratio: 0.4,
            tau_s: 6.0,
            exponent,
            unit_rise_mpa: 0.25,
        };
        ForceMeter::on_cells(
            inside,
            5.0,
            Calibration {
                solid,
                force_sd_n: 0.05,
            },
            ForceMeterOptions::default(),
        )
    }

    fn touch(x_mm: f64, y_mm: f64, rise: f64) -> Touch {
        Touch {
            x_mm,
            y_mm,
            rise,
            area_mm2: AREA_MM2,
            total_mm2: rise * AREA_MM2,
            ..Touch::default()
        }
    }

    proptest! {
        /// Any force history at any place comes back, whatever the resistivity's law.
        #[test]
        fn the_force_of_a_still_touch_comes_back(
            x in -97.0..97.0f64, y in -97.0..97.0f64, exponent in 0.6..1.6f64,
            history in proptest::collection::vec((0.0..5.0f64, 3.0..30.0f64), 1..40),
        ) {
            prop_assume!(x.hypot(y) < 90.0);
            let mut meter = meter(exponent);
            let (solid, mut rubber, mut time_s) = (meter.calibration.solid, SolidState::default(), 0.0);
            meter.update(0.0, &mut []);
            for (dt_s, force_n) in history {
                time_s += dt_s;
                let strain = rubber.press(&solid.step(dt_s), force_n / AREA_MM2);
                let mut seen = [touch(x, y, solid.rise(strain))];
                meter.update(time_s, &mut seen);
                let told = seen[0].force_n.unwrap();
                // A force below the dent's own uncertainty is given as 0.
                let dent = AREA_MM2 * rubber.delayed_mpa;
                if force_n > 0.16 + 0.06 * dent {
                    prop_assert!((told - force_n).abs() < 1e-9, "{told} {force_n}");
                }
            }
        }
    }

    #[test]
    fn a_dent_is_no_force_and_forgets() {
        let mut meter = meter(1.0);
        let solid = meter.calibration.solid;
        let mut rubber = SolidState::default();
        let p = 25.0 / AREA_MM2;
        for k in 0..1000 {
            let step = solid.step(if k == 0 { 0.0 } else { 0.03 });
            let pressure = if k < 500 { p } else { 0.0 };
            let mut seen = [touch(10.0, 5.0, solid.rise(rubber.press(&step, pressure)))];
            meter.update(0.03 * f64::from(k), &mut seen);
            let told = seen[0].force_n.unwrap();
            if k < 500 {
                assert!((told - 25.0).abs() < 1e-9, "{told}");
            } else {
                assert!(seen[0].rise > 0.002, "the dent shows: {}", seen[0].rise);
                assert_eq!(told, 0.0, "at {k}");
            }
        }
        // Beside the dent, a new touch at once has its own force; on it, that of the pressure alone.
        let mut both = [
            touch(-50.0, 0.0, solid.rise(p)),
            touch(10.0, 5.0, solid.rise(p + rubber.delayed_mpa)),
        ];
        meter.update(0.03 * 999.0, &mut both);
        for told in both {
            assert!((told.force_n.unwrap() - 25.0).abs() < 1e-9, "{told:?}");
        }
    }

    #[test]
    fn a_dent_that_is_not_seen_recovers_by_itself() {
        let mut meter = meter(1.0);
        let solid = meter.calibration.solid;
        let mut rubber = SolidState::default();
        let p = 25.0 / AREA_MM2;
        for (t, pressure) in [(0.0, p), (20.0, p), (20.03, 0.0), (26.0, 0.0)] {
            let dt = t - meter.time_s.unwrap_or(t);
            let strain = rubber.press(&solid.step(dt), pressure);
            let mut seen = vec![touch(0.0, 0.0, solid.rise(strain))];
            seen.retain(|_| pressure > 0.0);
            meter.update(t, &mut seen);
        }
        let dent: f64 = meter.cells.iter().map(|c| 25.0 * c.delayed_mpa).sum();
        assert!((dent / (AREA_MM2 * rubber.delayed_mpa) - 1.0).abs() < 1e-9, "{dent}");
        // A clock that goes back, as after the board's reset, does no harm.
        let mut seen = [touch(0.0, 0.0, solid.rise(p + rubber.delayed_mpa))];
        meter.update(0.5, &mut seen);
        assert!((seen[0].force_n.unwrap() - 25.0).abs() < 1e-6);
        meter.rest();
        assert!(meter.cells.iter().all(|c| *c == SolidState::default()));
    }

    /// What lowers the resistivity has no force, and changes none beside it.
    #[test]
    fn what_falls_has_no_force() {
        let (mut alone, mut beside) = (meter(1.0), meter(1.0));
        for k in 0..20 {
            let rise = touch(20.0, 0.0, 0.2);
            let fall = Touch {
                total_mm2: -rise.total_mm2,
                rise: -rise.rise,
                x_mm: -40.0,
                ..rise
            };
            let (mut one, mut two) = ([rise], [rise, fall]);
            alone.update(0.1 * f64::from(k), &mut one);
            beside.update(0.1 * f64::from(k), &mut two);
            assert_eq!((two[0].force_n, two[1].force_n), (one[0].force_n, None));
            assert!(one[0].force_n.is_some());
        }
    }
}
