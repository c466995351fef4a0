//! From a picture to touches: smooth, find the peaks that stand out, measure each over its own ground.

use crate::picture::Touch;
use forward::CellGrid;

/// What counts as a touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchOptions {
    /// Standard deviation of the smoothing before peaks are sought, mm.
    pub smoothing_mm: f64,
    /// A peak weaker than this fraction of the strongest is none.
    pub least_of_strongest: f64,
    /// A peak must rise above the saddle to a higher one by this fraction of its own height.
    pub prominence: f64,
    /// A peak weaker than this relative rise is none.
    pub least_rise: f64,
}

/// Finds touches on one grid. Holds the smoothing weights and scratch: nothing is allocated from frame to frame but the
/// list itself.
#[derive(Clone, Debug)]
pub struct TouchFinder {
    options: TouchOptions,
    /// For every cell its neighbours (itself included) with their weights.
    kernel: Vec<Vec<(u32, f64)>>,
    /// The eight neighbours of every cell.
    neighbours: Vec<Vec<u32>>,
    centres: Vec<[f64; 2]>,
    area_mm2: f64,
    smooth: Vec<f64>,
    order: Vec<u32>,
    /// Peak whose ground a cell belongs to, and every peak's height at the saddle where it met a higher one.
    ground: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl TouchFinder {
    /// Prepares for a grid.
    pub fn new(grid: &CellGrid, options: TouchOptions) -> Self {
        let reach = (3.0 * options.smoothing_mm / grid.cell_mm()).ceil() as i64;
        let near = |cell: usize, reach: i64| {
            let [c, r] = grid.cells()[cell].map(i64::from);
            let mut out = Vec::new();
            for dr in -reach..=reach {
                for dc in -reach..=reach {
                    if let (Ok(c), Ok(r)) = (usize::try_from(c + dc), usize::try_from(r + dr))
                        && let Some(other) = grid.at(c, r)
                    {
                        out.push((other as u32, (dc * dc + dr * dr) as f64));
                    }
                }
            }
            out
        };
        let variance = (options.smoothing_mm / grid.cell_mm()).powi(2);
        let kernel = (0..grid.len())
            .map(|cell| {
                // Normalised over the cells there are, so that a touch at the rim is not dimmed.
                let mut weights: Vec<(u32, f64)> = near(cell, reach)
                    .into_iter()
                    .map(|(k, d2)| (k, (-0.5 * d2 / variance.max(1e-12)).exp()))
                    .collect();
                let sum: f64 = weights.iter().map(|w| w.1).sum();
                weights.iter_mut().for_each(|w| w.1 /= sum);
                weights
            })
            .collect();
        let neighbours = (0..grid.len())
            .map(|cell| {
                near(cell, 1)
                    .into_iter()
                    .filter(|(k, _)| *k as usize != cell)
                    .map(|(k, _)| k)
                    .collect()
            })
            .collect();
        Self {
            options,
            kernel,
            neighbours,
            centres: (0..grid.len()).map(|k| grid.centre(k)).collect(),
            area_mm2: grid.cell_mm().powi(2),
            smooth: vec![0.0; grid.len()],
            order: (0..grid.len() as u32).collect(),
            ground: vec![NONE; grid.len()],
        }
    }

    /// The touches of a picture (relative rise of every cell), strongest first.
    pub fn find(&mut self, x: &[f64]) -> Vec<Touch> {
        for (out, kernel) in self.smooth.iter_mut().zip(&self.kernel) {
            *out = kernel.iter().map(|(k, w)| w * x[*k as usize]).sum();
        }
        let smooth = &self.smooth;
        let highest = smooth.iter().copied().fold(0.0, f64::max);
        let least = (self.options.least_of_strongest * highest).max(self.options.least_rise);
        if highest <= 0.0 || highest < self.options.least_rise {
            return Vec::new();
        }
        self.order
            .sort_unstable_by(|a, b| smooth[*b as usize].total_cmp(&smooth[*a as usize]).then(a.cmp(b)));
        self.ground.fill(NONE);
        // Flood from the top: a cell without a higher neighbour starts a peak, one between two joins them, and the lower
        // peak is judged there by how far it stands above the saddle.
        let mut peaks: Vec<Peak> = Vec::new();
        for cell in &self.order {
            let here = *cell as usize;
            if smooth[here] < 0.5 * least {
                break;
            }
            let mut own: Option<usize> = None;
            for n in &self.neighbours[here] {
                let g = self.ground[*n as usize];
                if g == NONE {
                    continue;
                }
                let other = root(&peaks, g as usize);
                own = match own {
                    None => Some(other),
                    Some(mine) if mine == other => Some(mine),
                    Some(mine) => {
                        let (high, low) = if peaks[mine].height >= peaks[other].height {
                            (mine, other)
                        } else {
                            (other, mine)
                        };
                        let stands = peaks[low].height - smooth[here] >= self.options.prominence * peaks[low].height;
                        if !stands {
                            peaks[low].merged = Some(high);
                        }
                        // A peak that stands keeps its ground; the saddle goes to the higher one.
                        Some(high)
                    }
                };
            }
            let mine = own.unwrap_or_else(|| {
                peaks.push(Peak {
                    height: smooth[here],
                    merged: None,
                });
                peaks.len() - 1
            });
            self.ground[here] = mine as u32;
        }
        let mut touches: Vec<Touch> = (0..peaks.len())
            .filter(|k| peaks[*k].merged.is_none() && peaks[*k].height >= least)
            .map(|k| self.measure(k, &peaks, x))
            .collect();
        touches.sort_by(|a, b| b.rise.total_cmp(&a.rise));
        touches
    }

    /// Centroid, area and height of one peak over its ground above half its height.
    fn measure(&self, peak: usize, peaks: &[Peak], x: &[f64]) -> Touch {
        let half = 0.5 * peaks[peak].height;
        let (mut sum, mut sx, mut sy, mut cells, mut rise) = (0.0, 0.0, 0.0, 0.0, 0.0_f64);
        for (cell, ground) in self.ground.iter().enumerate() {
            if *ground == NONE || root(peaks, *ground as usize) != peak || self.smooth[cell] < half {
                continue;
            }
            let w = x[cell].max(0.0);
            let [cx, cy] = self.centres[cell];
            sum += w;
            sx += w * cx;
            sy += w * cy;
            cells += 1.0;
            rise = rise.max(x[cell]);
        }
        Touch {
            id: None,
            x_mm: sx / sum,
            y_mm: sy / sum,
            rise,
            area_mm2: cells * self.area_mm2,
            total_mm2: sum * self.area_mm2,
            ..Touch::default()
        }
    }
}

struct Peak {
    height: f64,
    merged: Option<usize>,
}

fn root(peaks: &[Peak], mut k: usize) -> usize {
    while let Some(next) = peaks[k].merged {
        k = next;
    }
    k
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Geometry, Sheet};

    fn finder() -> (CellGrid, TouchFinder) {
        let grid = CellGrid::new(&Geometry::new(&Sheet::paper()).unwrap(), 5.0).unwrap();
        let options = TouchOptions {
            smoothing_mm: 5.0,
            least_of_strongest: 0.2,
            prominence: 0.2,
            least_rise: 0.005,
        };
        let finder = TouchFinder::new(&grid, options);
        (grid, finder)
    }

    fn bumps(grid: &CellGrid, at: &[[f64; 3]]) -> Vec<f64> {
        (0..grid.len())
            .map(|k| {
                let c = grid.centre(k);
                at.iter()
                    .map(|[x, y, h]| h * (-0.5 * ((c[0] - x).powi(2) + (c[1] - y).powi(2)) / 64.0).exp())
                    .sum()
            })
            .collect()
    }

    #[test]
    fn separate_bumps_are_found_where_they_are_strongest_first() {
        let (grid, mut finder) = finder();
        let truth = [[-40.0, 11.0, 0.1], [33.0, 42.0, 0.3], [20.0, -51.0, 0.2]];
        let touches = finder.find(&bumps(&grid, &truth));
        assert_eq!(touches.len(), 3);
        for (t, k) in touches.iter().zip([1, 2, 0]) {
            assert!((t.x_mm - truth[k][0]).hypot(t.y_mm - truth[k][1]) < 0.7, "{t:?}");
            assert!((t.rise / truth[k][2] - 1.0).abs() < 0.1, "{t:?}");
        }
    }

    #[test]
    fn two_bumps_that_run_into_one_another_are_one() {
        let (grid, mut finder) = finder();
        assert_eq!(
            finder.find(&bumps(&grid, &[[0.0, 0.0, 0.2], [12.0, 0.0, 0.2]])).len(),
            1
        );
        assert_eq!(
            finder.find(&bumps(&grid, &[[0.0, 0.0, 0.2], [32.0, 0.0, 0.2]])).len(),
            2
        );
    }

    #[test]
    fn nothing_is_nothing() {
        let (grid, mut finder) = finder();
        assert!(finder.find(&vec![0.0; grid.len()]).is_empty());
        assert!(finder.find(&vec![0.001; grid.len()]).is_empty());
    }
}
