//! From a picture to touches: smooth, find the peaks that stand out, measure each over its own ground.

use crate::touches::touch::Touch;
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
    smoothing: Smoothing,
    /// The eight neighbours of every cell.
    neighbours: Vec<Vec<u32>>,
    centres: Vec<[f64; 2]>,
    area_mm2: f64,
    smooth: Vec<f64>,
    order: Vec<u32>,
    /// Peak whose ground a cell belongs to, and every peak's height at the saddle where it met a higher one.
    ground: Vec<u32>,
    peaks: Vec<Peak>,
}

const NONE: u32 = u32::MAX;

impl TouchFinder {
    /// Prepares for a grid.
    pub fn new(grid: &CellGrid, options: TouchOptions) -> Self {
        let near = |cell: usize| {
            let [c, r] = grid.cells()[cell].map(i64::from);
            let around = (-1..=1).flat_map(move |dr| (-1..=1).map(move |dc| (c + dc, r + dr)));
            around.filter_map(|(c, r)| grid.at(usize::try_from(c).ok()?, usize::try_from(r).ok()?))
        };
        let neighbours = (0..grid.len())
            .map(|cell| near(cell).filter(|k| *k != cell).map(|k| k as u32).collect())
            .collect();
        Self {
            options,
            smoothing: Smoothing::new(grid, options.smoothing_mm),
            neighbours,
            centres: (0..grid.len()).map(|k| grid.centre(k)).collect(),
            area_mm2: grid.cell_mm().powi(2),
            smooth: vec![0.0; grid.len()],
            order: Vec::with_capacity(grid.len()),
            peaks: Vec::new(),
            ground: vec![NONE; grid.len()],
        }
    }

    /// The touches of a picture (relative rise of every cell), strongest first; `touches` is emptied before.
    pub fn find(&mut self, x: &[f64], touches: &mut Vec<Touch>) {
        touches.clear();
        self.smoothing.smooth(x, &mut self.smooth);
        let smooth = &self.smooth;
        let highest = smooth.iter().copied().fold(0.0, f64::max);
        let least = (self.options.least_of_strongest * highest).max(self.options.least_rise);
        if highest <= 0.0 || highest < self.options.least_rise {
            return;
        }
        self.order.clear();
        self.order
            .extend((0..smooth.len() as u32).filter(|k| smooth[*k as usize] >= 0.5 * least));
        self.order
            .sort_unstable_by(|a, b| smooth[*b as usize].total_cmp(&smooth[*a as usize]).then(a.cmp(b)));
        self.ground.fill(NONE);
        // Flood from the top: a cell without a higher neighbour starts a peak, one between two joins them, and the lower
        // peak is judged there by how far it stands above the saddle.
        let mut peaks = std::mem::take(&mut self.peaks);
        peaks.clear();
        for cell in &self.order {
            let here = *cell as usize;
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
        let stand = (0..peaks.len()).filter(|k| peaks[*k].merged.is_none() && peaks[*k].height >= least);
        touches.extend(stand.map(|k| self.measure(k, &peaks, x)));
        touches.sort_unstable_by(|a, b| b.rise.total_cmp(&a.rise));
        self.peaks = peaks;
    }

    /// Centroid, area and height of one peak over its ground above half its height.
    fn measure(&self, peak: usize, peaks: &[Peak], x: &[f64]) -> Touch {
        let half = 0.5 * peaks[peak].height;
        let (mut sum, mut sx, mut sy, mut cells, mut rise) = (0.0, 0.0, 0.0, 0.0, 0.0_f64);
        for cell in self.order.iter().map(|cell| *cell as usize) {
            // In falling order.
            if self.smooth[cell] < half {
                break;
            }
            if root(peaks, self.ground[cell] as usize) != peak {
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

/// A bell of a standard deviation over the cells there are, normalised so that a touch at the rim is not dimmed. Rows and
/// columns of the lattice are smoothed one after the other.
#[derive(Clone, Debug)]
struct Smoothing {
    taps: Vec<f64>,
    /// Columns of the lattice, with the bell's reach on both sides.
    columns: usize,
    /// Place of every cell in the padded lattice, and one over the weight of the cells around it.
    places: Vec<u32>,
    scale: Vec<f64>,
    lattice: Vec<f64>,
    half: Vec<f64>,
}

impl Smoothing {
    fn new(grid: &CellGrid, deviation_mm: f64) -> Self {
        let reach = (3.0 * deviation_mm / grid.cell_mm()).ceil() as i32;
        let variance = (deviation_mm / grid.cell_mm()).powi(2).max(1e-12);
        let taps: Vec<f64> = (-reach..=reach)
            .map(|d| (-0.5 * f64::from(d * d) / variance).exp())
            .collect();
        let pad = reach as usize;
        let (columns, rows) = grid.shape();
        let (columns, rows) = (columns + 2 * pad, rows + 2 * pad);
        let places = grid
            .cells()
            .iter()
            .map(|[c, r]| ((*r as usize + pad) * columns + *c as usize + pad) as u32)
            .collect();
        let mut smoothing = Self {
            taps,
            columns,
            places,
            scale: vec![1.0; grid.len()],
            lattice: vec![0.0; columns * rows],
            half: vec![0.0; columns * rows],
        };
        let mut weights = vec![0.0; grid.len()];
        smoothing.smooth(&vec![1.0; grid.len()], &mut weights);
        smoothing.scale = weights.iter().map(|w| 1.0 / w).collect();
        smoothing
    }

    fn smooth(&mut self, x: &[f64], out: &mut [f64]) {
        for (place, x) in self.places.iter().zip(x) {
            self.lattice[*place as usize] = *x;
        }
        convolve(&self.lattice, &self.taps, 1, &mut self.half);
        convolve(&self.half, &self.taps, self.columns, &mut self.lattice);
        for ((place, scale), out) in self.places.iter().zip(&self.scale).zip(out) {
            *out = scale * self.lattice[*place as usize];
        }
        self.lattice.fill(0.0);
    }
}

/// `out_k = sum of taps_i x_(k + (i - middle) step)`, where all of these exist.
fn convolve(x: &[f64], taps: &[f64], step: usize, out: &mut [f64]) {
    let reach = taps.len() / 2 * step;
    let end = x.len().saturating_sub(reach);
    out.fill(0.0);
    let Some(inner) = out.get_mut(reach..end) else { return };
    for (i, tap) in taps.iter().enumerate() {
        for (out, x) in inner.iter_mut().zip(&x[i * step..]) {
            *out += tap * x;
        }
    }
}

#[derive(Clone, Debug)]
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

    fn find(finder: &mut TouchFinder, x: &[f64]) -> Vec<Touch> {
        let mut touches = vec![Touch::default()];
        finder.find(x, &mut touches);
        touches
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
        let touches = find(&mut finder, &bumps(&grid, &truth));
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
            find(&mut finder, &bumps(&grid, &[[0.0, 0.0, 0.2], [12.0, 0.0, 0.2]])).len(),
            1
        );
        assert_eq!(
            find(&mut finder, &bumps(&grid, &[[0.0, 0.0, 0.2], [32.0, 0.0, 0.2]])).len(),
            2
        );
    }

    #[test]
    fn smoothing_keeps_what_is_even_and_spreads_a_cell_as_a_bell() {
        let grid = CellGrid::new(&Geometry::new(&Sheet::paper()).unwrap(), 5.0).unwrap();
        let mut smoothing = Smoothing::new(&grid, 5.0);
        let mut out = vec![0.0; grid.len()];
        smoothing.smooth(&vec![0.3; grid.len()], &mut out);
        assert!(out.iter().all(|v| (v - 0.3).abs() < 1e-14));
        let from_middle = |k: usize| grid.centre(k)[0].hypot(grid.centre(k)[1]);
        let middle = (0..grid.len())
            .min_by(|a, b| from_middle(*a).total_cmp(&from_middle(*b)))
            .unwrap();
        let mut one = vec![0.0; grid.len()];
        one[middle] = 1.0;
        smoothing.smooth(&one, &mut out);
        let along = (-3..=3).map(|d| (-0.5 * f64::from(d * d)).exp()).sum::<f64>();
        for (k, v) in out.iter().enumerate() {
            let [x, y] = [0, 1].map(|i| (grid.centre(k)[i] - grid.centre(middle)[i]) / 5.0);
            let inside = x.abs().max(y.abs()) < 3.5;
            let bell = if inside {
                (-0.5 * (x * x + y * y)).exp() / (along * along)
            } else {
                0.0
            };
            assert!((v - bell).abs() < 1e-15, "{x} {y}: {v} {bell}");
        }
    }

    #[test]
    fn nothing_is_nothing() {
        let (grid, mut finder) = finder();
        assert!(find(&mut finder, &vec![0.0; grid.len()]).is_empty());
        assert!(find(&mut finder, &vec![0.001; grid.len()]).is_empty());
    }
}
